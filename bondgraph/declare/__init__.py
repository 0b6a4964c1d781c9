"""Declare: domains, units, quantities, elements, graphs, composition and graph files."""
