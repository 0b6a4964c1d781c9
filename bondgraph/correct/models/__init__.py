"""The declared model made ready to run, and every graph-extending candidate that physics allows at its places."""
