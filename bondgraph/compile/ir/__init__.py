"""Programs: lists of elementary operations, and their evaluation in numpy."""
