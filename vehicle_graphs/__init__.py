"""Vehicles and effects declared as bond graphs."""
