"""Bodies whose inertia changes with where they stand: a chain that is laid down, a rope that is wound, an arm.

Reference: Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 9, for inertances that depend on a position.
"""

from __future__ import annotations

from math import sqrt

from sympy import Expr, Rational

from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.places import is_motion, over, position_at
from bondgraph.effects.relaxation import rate_of_storage
from bondgraph.effects.storages import inertance_beside, spring_at

_BODIES = "Karnopp, Margolis, Rosenberg (2012), System Dynamics, chapter 9"


def inertia_by_position(g: BondGraph, at: Place) -> Effect | None:
    """Inertia that changes with the position: a chain that moves along, a rope on a drum, a load on a turning arm.

    It keeps its energy: where it grows along the way, half of what it gains per length times the square of the speed
    holds the body back. The declared inertia is that at the position zero.
    """
    declared = inertance_beside(g, at.junction) if is_motion(at) else None
    acceleration = None if declared is None else rate_of_storage(g, at, "I", "flow", "momentum", "effort")
    where = _position(g, at)
    if declared is None or acceleration is None or where is None:
        return None
    q, unit, way = where
    name = f"inertia_by_position_{at.name}"
    parts: list[Expr] = []
    for power, meaning in ((1, "slope"), (2, "bend")):
        limit = declared[0] / way**power
        parts.append(
            g.parameter(
                f"c{power}_{name}", 0.0, over(declared[1], unit, power), f"{meaning} of the inertia over the position",
                (-limit, limit),
            )
        )  # fmt: skip
    more, rise = parts[0] * q + parts[1] * q**2, parts[0] + 2 * parts[1] * q
    flow = at.junction.flow
    g.effort_source(name, -(more * acceleration + Rational(1, 2) * rise * flow**2), at=at.junction)
    return Effect(
        "inertia_by_position", name, "effort = (c1*q + c2*q^2)*d(flow)/dt + (c1/2 + c2*q)*flow^2",
        tuple(one.name for one in parts), reference=_BODIES,
        manoeuvre="quick changes of the speed at both ends of the way",
    )  # fmt: skip


def _position(g: BondGraph, at: Place) -> tuple[Expr, str, float] | None:
    """The position of a body, its unit and how far it goes: as declared, or that of its spring."""
    if (spring := spring_at(g, at, straight=False)) is not None:
        return signal("displacement", spring.name), spring.unit, spring.way
    known = position_at(g, at)
    shortest, longest = at.times
    return None if known is None else (*known, at.scale.flow * sqrt(shortest * longest))
