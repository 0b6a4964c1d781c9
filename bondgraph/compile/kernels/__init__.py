"""Kernels that are the same for every model, compiled from their own text: what they are given, and instructions."""
