"""Simulate: load and compile generated modules, integrate them over inputs."""
