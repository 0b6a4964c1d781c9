"""Correct: find the residual, locate it, explain it by a missing effect, add the effect to the graph."""
