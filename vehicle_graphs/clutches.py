"""Clutches of the Ranger's CVT: the primary with flyweights against a pressure spring, the secondary with its helix.

Both press on the belt along the axis. The primary's sheave carries the state of shifting: it closes where the primary
presses harder than the secondary, seen through the belt of fixed length. Published clutch work: Aaen, *Clutch Tuning
Handbook* (1986); Oliver, Hornung, Shapiro, SAE 730003 (1973).
"""

from __future__ import annotations

from sympy import Symbol

from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.functions import clip, maximum
from bondgraph.declare.graph import BondGraph
from bondgraph.errors import DeclarationError

#: Belt released, the spring of the secondary holds the sheave so far in its lower stop [m].
RELEASED = -0.000249959694589
#: No clamp force presses the sheave further into a stop [m].
YIELDING = 0.005


def sheave_travel(g: BondGraph) -> Symbol:
    """Travel between the stops of the primary sheave, which also limits the radius of the belt."""
    x_max = g.parameter("x_max", 0.0296, "m", "travel of the primary sheave between its stops")
    g.require(x_max, "the upper stop of the sheave lies above the lower one")
    return x_max


def primary_clutch(start: float = RELEASED) -> BondGraph:
    """Primary clutch: port ``sheave``, input ``crank_speed``; signal ``F_p`` is its clamp force.

    Parameters
    ----------
    start
        Where the sheave stands at first, in m.

    Raises
    ------
    DeclarationError
        If it starts further beyond a stop than a stop yields.

    Examples
    --------
    >>> [element.name for element in primary_clutch().nodes.values()]
    ['sheave', 'stops', 'shift_friction', 'flyweights']
    """
    g = BondGraph("primary_clutch", doc=__doc__)
    speed = g.input("crank_speed", "rad/s", "speed of the crankshaft, which the flyweights feel")
    x_max = sheave_travel(g)
    k_st = g.parameter("k_st", 1e6, "N/m", "stiffness of the end stops")
    c_x = g.parameter("c_x", 6000.0, "N s/m", "resistance to shifting: belt, bushings")
    sheave = g.one_junction("sheave", TRANSLATION)
    stops = g.compliance(
        "stops", lambda x: k_st * maximum(x - x_max, 0) - k_st * maximum(-x, 0), at=sheave,
        initial=_between_stops(g, start), state="sheave_displacement",
    )  # fmt: skip
    g.resistance("shift_friction", c_x, at=sheave)
    x = stops.displacement
    m_fw = g.parameter("m_fw", 0.174, "kg", "flyweights, all together; stands for m_fw r_f0 td0", (0.12, 0.24))
    r_f0 = g.parameter("r_f0", 0.050, "m", "radius of the flyweights, sheave open")
    r_f1 = g.parameter("r_f1", 0.025, "m", "growth of that radius over the travel")
    td0 = g.parameter("td0", 0.69, "1", "axial force per centrifugal force, sheave open")
    td1 = g.parameter("td1", -0.15, "1", "change of that ratio over the travel")
    F_p0 = g.parameter("F_p0", 150.0, "N", "preload of the pressure spring", (80.0, 250.0))
    k_p = g.parameter("k_p", 25.3e3, "N/m", "rate of the pressure spring", (15e3, 36e3))
    s = g.signal("travel_share", clip(x / x_max, 0, 1), "1", "sheave travel from open 0 to closed 1")
    weights = m_fw * (r_f0 + r_f1 * s) * speed**2 * (td0 + td1 * s)
    clamp = g.signal("F_p", maximum(weights - F_p0 - k_p * maximum(x, 0), 0), "N", "clamp force of the primary")
    g.effort_source("flyweights", clamp, at=sheave)
    return g


def _between_stops(g: BondGraph, start: float) -> float:
    """The start of the sheave, if it lies between its stops."""
    longest = next(parameter.value for parameter in g.parameters if parameter.name == "x_max")
    if not -YIELDING <= start <= longest + YIELDING:
        raise DeclarationError(
            f"primary_clutch: the sheave starts at {1e3 * start:.4g} mm, beyond its stops at 0 and "
            f"{1e3 * longest:.4g} mm, which yield by {1e3 * YIELDING:.4g} mm at most - start it between them",
            where=("sheave_displacement",),
        )
    return start


def secondary_clutch() -> BondGraph:
    """Secondary clutch: port ``sheave``, inputs ``travel`` and ``belt_torque``.

    The helix adds the axial force of half the belt's torque, in drive only.

    Examples
    --------
    >>> [element.name for element in secondary_clutch().nodes.values()]
    ['sheave', 'spring', 'helix']
    """
    g = BondGraph("secondary_clutch", doc=__doc__)
    travel = g.input("travel", "m", "travel of the primary sheave")
    torque = g.input("belt_torque", "N m", "torque of the belt on the pulley")
    F_s0 = g.parameter("F_s0", 400.0, "N", "preload of the spring")
    k_s = g.parameter("k_s", 17e3, "N/m", "rate of the spring, per travel of the primary")
    r_h = g.parameter("r_h", 0.045, "m", "radius of the helix; stands for r_h tan_h", (0.030, 0.065))
    tan_h = g.parameter("tan_h", 1.0, "1", "tangent of the helix angle")
    sheave = g.one_junction("sheave", TRANSLATION)
    # a spring, but its travel is that of the primary, which is the state: it needs no storage of its own
    g.effort_source("spring", -F_s0 - k_s * maximum(travel, 0), at=sheave)
    g.effort_source("helix", -maximum(torque, 0) / (2 * r_h * tan_h), at=sheave)
    return g
