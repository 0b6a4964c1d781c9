"""Bond graphs to corrected models: declare a machine, derive and generate its model, explain its measurements."""

__version__ = "0.1.0"
