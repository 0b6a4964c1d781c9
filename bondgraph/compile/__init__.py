"""Compiler of generated modules: text, tape, passes, lanes of machine code."""
