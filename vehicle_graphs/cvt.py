"""Parts of a mechanical rubber-belt CVT: each function extends a graph by one clutch or law.

The clutches shift on a junction of their own, whose flow is the speed at which the primary sheave closes. Three things
tie it to the rest: the flyweights (a gyrator from the crankshaft), the belt of fixed length (a transformer to the
secondary sheave) and the torque that the helix feels (an effort at the secondary sheave).

Sources: wedge traction and torque feedback of flyweight and helix clutches after Aaen, *Clutch Tuning Handbook* (1986),
and Oliver, Hornung, Shapiro, *Design equations for a speed and torque controlled variable ratio V-belt transmission*,
SAE 730003 (1973). That sheaves which share a belt balance in the ratio of their wrap angles follows from virtual work.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from sympy import Expr, cos, tan, tanh

from bondgraph.declare.functions import maximum, minimum
from bondgraph.declare.graph import BondGraph, Handle
from vehicle_graphs.cvt_geometry import (
    BeltGeometry,
    FlyweightRamp,
    flyweight_motion,
    rounded,
    secondary_radius,
    wrap_angles,
)

# Below this rest of the loop 1 - K gain the secondary has locked itself: its limit is a thousand times its springs.
_SELF_LOCKED = 1e-3


@dataclass(frozen=True)
class BeltRadii:
    """Signals that follow from the position of a belt of fixed length.

    ``wrap_ratio`` is the wrap angle of the primary over that of the secondary; it is also -d r_s/d r_p of the belt, and
    so the ratio in which axial forces balance. ``opening`` is the travel of the secondary sheave from its rest.
    """

    primary: Expr
    secondary: Expr
    wrap_ratio: Expr
    opening: Expr


def belt_radii(g: BondGraph, belt: BeltGeometry, primary: Expr, sheave_angle: Expr) -> BeltRadii:
    """Declare the tables of a belt of fixed length, as functions of the primary radius [m].

    Examples
    --------
    >>> g = BondGraph("variator")
    >>> radius, angle = g.parameter("radius", 0.03, "m"), g.parameter("angle", 0.22, "rad")
    >>> radii = belt_radii(g, BeltGeometry(0.231, 0.864, 0.0246, 0.075), radius, angle)
    >>> radii.wrap_ratio
    wrap_ratio(radius)
    """
    knots = np.linspace(belt.smallest_primary, belt.largest_primary, 61)
    radii = secondary_radius(belt, knots)
    around_primary, around_secondary = wrap_angles(belt, knots, radii)
    radius_table = g.table(
        "secondary_radius_at", rounded(knots), rounded(radii), "m", "m",
        meaning="secondary radius that keeps the length of the belt, against the primary radius",
    )  # fmt: skip
    wrap_table = g.table(
        "wrap_ratio", rounded(knots), rounded(around_primary / around_secondary), "1", "m",
        meaning="wrap angle of the primary over that of the secondary, against the primary radius",
    )  # fmt: skip
    rest = g.parameter("secondary_radius_rest", rounded(radii)[0], "m", "secondary radius at the lowest ratio")
    secondary = g.signal("secondary_radius", radius_table(primary), "m", "effective radius of the secondary")
    opening = g.signal(
        "secondary_opening", (rest - secondary) * tan(sheave_angle), "m", "travel of the secondary sheave from its rest"
    )
    return BeltRadii(primary, secondary, wrap_table(primary), opening)


def flyweights(
    g: BondGraph,
    name: str,
    ramp: FlyweightRamp,
    *,
    crank: Handle,
    shift: Handle,
    mass: Expr,
    travel: Expr,
    largest: float,
) -> Expr:
    """Flyweights that press the sheaves together: a gyrator between the crankshaft and the shift; returns their force.

    The axial force of a mass m at radius r(x) is ``m r dr/dx omega^2``. As a gyrator of modulus ``m r dr/dx omega`` the
    power that closes the sheaves is taken from the crankshaft. ``largest`` [m] is how far the tables reach.
    """
    knots = np.linspace(0.0, largest, 91)
    radius, lift = flyweight_motion(ramp, knots)
    radius_table = g.table(
        f"{name}_radius", rounded(knots), rounded(radius), "m", "m", meaning="radius of the rollers at a sheave travel"
    )
    lift_table = g.table(
        f"{name}_lift", rounded(knots), rounded(lift), "1", "m", meaning="radial lift of the rollers per sheave travel"
    )
    modulus = mass * radius_table(travel) * lift_table(travel) * crank.flow
    g.gyrator(name, modulus, source=crank, target=shift)
    return modulus * crank.flow


def torque_feedback_gain(torque_share: Expr, secondary_radius: Expr, helix_radius: Expr, helix_angle: Expr) -> Expr:
    """Axial force of the helix per belt force: ``share r_s/(r_h tan(angle))``.

    The movable sheave rests on the helix with the torque that it carries: half of the belt's where both sheaves grip
    alike, all of it where the fixed one is free.
    """
    return torque_share * secondary_radius / (helix_radius * tan(helix_angle))


def belt_traction(
    g: BondGraph,
    name: str,
    *,
    at: Handle,
    primary_clamp: Expr,
    secondary_clamp: Expr,
    feedback_gain: Expr,
    traction: Expr,
    sheave_angle: Expr,
    slip_speed: Expr,
) -> Handle:
    """Slip of the belt as a dissipator: Coulomb friction on the faces of a wedge, smoothed at standstill.

    The weaker clamp limits the belt force, ``F <= K min(S_p, S_s)`` with ``K = 2 mu/cos(angle)``. In drive the
    secondary clamp grows with the force, ``S_s = S_0 + gain F``; that loop has one solution, written out here: the
    secondary allows ``K S_0/(1 - K gain)``, without limit once ``K gain`` reaches 1, where it locks itself.
    """
    slope = g.signal("belt_friction", 2 * traction / cos(sheave_angle), "1", "belt force per clamp force in full slip")
    slack = maximum(1 - slope * feedback_gain, _SELF_LOCKED)
    drive = g.signal(
        "drive_limit", slope * minimum(primary_clamp, secondary_clamp / slack), "N", "belt force in full slip, driving"
    )
    overrun = g.signal(
        "overrun_limit", slope * minimum(primary_clamp, secondary_clamp), "N", "belt force in full slip, overrun"
    )

    def force(slip: Any) -> Any:
        return drive * tanh(maximum(slip, 0) / slip_speed) + overrun * tanh(minimum(slip, 0) / slip_speed)

    return g.resistance(name, force, at=at)
