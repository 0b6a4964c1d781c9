"""Data: measured logs in and out, checked before any computation."""
