"""Estimate: parameters that maximise the likelihood of measured logs."""
