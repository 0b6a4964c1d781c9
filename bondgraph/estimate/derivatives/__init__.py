"""Derivatives of the likelihood: exact, of a filter linearised along itself, by differences."""
