"""A study of how well missing effects are found: simulated machines with a known effect, and the loop closed on them.

``python -m vehicle_graphs.effect_study --out study`` runs it; see :mod:`vehicle_graphs.effect_study.__main__`.
"""
