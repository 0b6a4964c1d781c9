"""Fitting a model to logs, and what a fit leaves: its filter, its starts, whiteness, errors before and after."""
