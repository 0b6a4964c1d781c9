"""Generated modules read as programs."""
