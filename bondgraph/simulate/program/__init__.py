"""Equations of a generated module as programs: lists of operations that can be differentiated and printed."""
