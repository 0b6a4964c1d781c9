"""Evidence: what speaks for a refitted candidate, and whether that holds on data it was not estimated from."""
