"""Derive: causality, state equations, dependent storages, algebraic loops, dimensions, Jacobians."""
