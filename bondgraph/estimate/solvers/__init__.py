"""Searches: each is a type with ``init``, ``step``, ``ended`` and ``result``, and one file.

:mod:`bondgraph.estimate.solvers.abstract` says what a search is, :mod:`bondgraph.estimate.methods` which of them an
estimation takes under which name. A search of one's own is a subclass of ``AbstractSearch`` given to ``Settings``.
"""
