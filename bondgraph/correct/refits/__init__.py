"""Refits of the candidates that promise most, the comparison of those that ended close, and the decision."""
