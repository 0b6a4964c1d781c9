"""Generate: readable numpy modules from state equations, and the check that they have not drifted."""
