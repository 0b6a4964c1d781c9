"""Formulas for shapes that no law of the dictionary has: a typed library of terms, best subsets, elements, words."""
