"""Terrain: inclination of the ground and height of the vehicle, as integrals along the way."""

from __future__ import annotations

from sympy import sin

from bondgraph.declare.graph import BondGraph


def terrain() -> BondGraph:
    """The ground under the vehicle: inputs ``speed`` (forward velocity) and ``inclination_rate``.

    The rate of the inclination is zero unless given; a filter takes it as noise, the inclination as a random walk.

    Examples
    --------
    >>> [integral.name for integral in terrain().integrals]
    ['inclination', 'height']
    """
    g = BondGraph("terrain", doc=__doc__)
    speed = g.input("speed", "m/s", "forward velocity")
    rate = g.input("inclination_rate", "rad/s", "rate at which the inclination of the ground changes", default=0.0)
    slope = g.integral("inclination", rate, "rad", "inclination of the ground, uphill positive")
    g.integral("height", speed * sin(slope), "m", "height of the vehicle")
    return g
