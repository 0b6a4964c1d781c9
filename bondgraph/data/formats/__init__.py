"""Formats of logs: each reader brings a file to a table of columns, which :mod:`bondgraph.data.read` makes a log of."""
