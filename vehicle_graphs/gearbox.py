"""Gearbox behind the CVT: secondary shaft, gear wheels, output shaft with the losses of the mesh.

Neutral is a ratio of zero: the axle turns, the secondary shaft stands. Shaft and axle are rigidly geared, so of their
inertias one is a dependent storage, as the causality assignment finds.
"""

from __future__ import annotations

from sympy import Piecewise

from bondgraph.declare.domains import ROTATION
from bondgraph.declare.graph import BondGraph

#: The lever's letters as the ratios they stand for; parameters refine the ratio.
GEARS = {"H": 10.0, "L": 22.0, "R": -20.0, "N": 0.0}


def gearbox() -> BondGraph:
    """Gearbox: ports ``shaft`` (secondary pulley) and ``output`` (axles), inputs ``gear`` and ``belt_torque``.

    Examples
    --------
    >>> gearbox().inputs[0].letters
    (('H', 10.0), ('L', 22.0), ('R', -20.0), ('N', 0.0))
    """
    g = BondGraph("gearbox", doc=__doc__)
    gear = g.input("gear", "1", "gear lever", default=GEARS["H"], letters=GEARS)
    belt_torque = g.input("belt_torque", "N m", "torque of the belt on the secondary pulley")
    G_H = g.parameter("G_H", 10.0, "1", "shaft over axle speed in high gear")
    G_L = g.parameter("G_L", 22.0, "1", "shaft over axle speed in low gear")
    G_R = g.parameter("G_R", -20.0, "1", "shaft over axle speed in reverse")
    eta = g.parameter("eta", 0.95, "1", "share of the belt's torque that arrives at the axle")
    J_s = g.parameter("J_s", 0.03, "kg m^2", "secondary clutch and shaft")
    G = g.signal(
        "G", Piecewise((G_L, gear > 16), (G_H, gear > 5), (G_R, gear < -5), (0, True)), "1",
        "ratio of the engaged gear, 0 in neutral",
    )  # fmt: skip
    shaft = g.one_junction("shaft", ROTATION)
    output = g.one_junction("output", ROTATION)
    g.inertance("secondary", J_s, at=shaft)
    g.transformer("gears", 1 / G, shaft, output)
    # The share eta holds in both directions, a simplification: in overrun this source feeds the vehicle, so it is a
    # signed loss and no dissipator.
    g.effort_source("mesh_loss", -(1 - eta) * G * belt_torque, at=output)
    return g
