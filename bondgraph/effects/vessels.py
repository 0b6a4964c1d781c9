"""Vessels: gas that is compressed, air in oil, tanks whose section changes.

References: Pourmovahed, Otis (1990), ASME J. Dyn. Syst. Meas. Control 112(1), for gas that exchanges little heat while
it is compressed; Gholizadeh, Burton, Schoenau (2011), International Journal of Fluid Power 12(3), for air in oil;
Chaudhry (2014), Applied Hydraulic Transients, chapter 11, for surge tanks with chambers.
"""

from __future__ import annotations

from sympy import Expr, Rational, sign

from bondgraph.declare.domains import HYDRAULIC, ROTATION
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.functions import maximum, minimum
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.effects.places import Words, has_effort, is_motion, over
from bondgraph.effects.storages import bend, capacity_beside, spring_at

_GAS_LAW = "Pourmovahed, Otis (1990), ASME J. Dyn. Syst. Meas. Control 112(1)"
_SURGE = "Chaudhry (2014), Applied Hydraulic Transients, chapter 11"
#: Names of laws in each domain.
_GAS = Words("air_spring", hydraulic="gas_accumulator")
#: Share of its volume by which gas is compressed at most; further on the storage is straight, with a finite effort.
COMPRESSED = 0.9
#: Volume of air in oil at most, as a multiple of what the oil gives way up to the largest pressure: a convention.
_MOST_AIR = 10.0
#: Rise of the pressure with the volume beyond a step of a tank, as a share of that below it, less one: from a tank ten
#: times as wide to one ten times as narrow, a convention.
_STEP = (-0.9, 9.0)
#: Absolute pressure of the surroundings, from which gauges count [Pa].
_ATMOSPHERE = 1.01325e5
#: The own variable of a compliance.
_STRETCH = symbol("displacement")


def stepped_tank(g: BondGraph, at: Place) -> Effect | None:
    """A tank that is wider or narrower beyond a level: a surge shaft with a chamber, a funnel, a reservoir's banks.

    The level is above where its volume is positive, and below where it is negative.
    """
    vessel = spring_at(g, at) if has_effort(at) and at.domain == HYDRAULIC else None
    if vessel is None:
        return None
    name = f"stepped_tank_{at.name}"
    c = g.parameter(f"c_{name}", 0.0, "1", "share by which the pressure rises faster with the volume there", _STEP)
    bounds = (-vessel.way, vessel.way)
    level = g.parameter(f"level_{name}", 0.5 * vessel.way, vessel.unit, "volume where the section changes", bounds)

    def stepped(old: Expr) -> Expr:
        beyond = sign(level) * maximum(sign(level) * (_STRETCH - level), 0)
        return old + c * (old - old.xreplace({_STRETCH: _STRETCH - beyond}))

    bend(g, vessel, stepped)
    return Effect(
        "stepped_tank", vessel.name, "effort = declared(V) + c*(declared(V) - declared(g)) beyond V = g", (c.name,),
        shapes=(level.name,), reference=_SURGE, manoeuvre="slow filling through all levels",
    )  # fmt: skip


def gas_storage(g: BondGraph, at: Place) -> Effect | None:
    """Gas that pushes back the more steeply the less volume is left to it: a hydraulic accumulator, an air spring.

    It is compressed fast, with little heat exchanged, from where the declared law has no displacement; c is one over
    the volume there. It is negative where a spring is compressed by a negative displacement.
    """
    is_accumulator = has_effort(at) and at.domain == HYDRAULIC
    is_spring = is_motion(at) and at.domain != ROTATION  # no gas resists a twist
    spring = spring_at(g, at, straight=False) if is_accumulator or is_spring else None
    if spring is None:
        return None
    word = _GAS.at(at)
    name = f"{word}_{at.name}"
    limit = 3.0 / spring.way
    meaning = "1 over the displacement that would leave no volume"
    lower = 0.0 if is_accumulator else -limit
    c = g.parameter(f"c_{name}", 0.0, over("1", spring.unit), meaning, (lower, limit))
    bend(g, spring, lambda old: old.xreplace({_STRETCH: _polytropic(c)}))
    return Effect(
        word, spring.name, "effort = declared(y), y = ((1 - c*q)^(-4/3) - 1)/(4/3*c), q = displacement", (c.name,),
        reference=_GAS_LAW, manoeuvre="small and large displacements in one log",
    )  # fmt: skip


def _polytropic(c: Expr) -> Expr:
    """Displacement at which a straight storage has the effort of a gas, exact where c is zero.

    An exponent of 4/3 lies between those of slow and fast compression, 1 and 1.4. With r the third root of the share of
    the volume that is left, ``(r^-4 - 1)/(1 - r^3)`` is a ratio of sums, in which nothing cancels as c vanishes.
    """
    r = (1 - minimum(c * _STRETCH, COMPRESSED)) ** Rational(1, 3)
    return Rational(3, 4) * _STRETCH * (1 + r) * (1 + r**2) / (r**4 * (1 + r + r**2))


def entrained_air(g: BondGraph, at: Place) -> Effect | None:
    """Air in oil or water, which is compressed first: a capacity that falls as the pressure rises.

    P is the absolute pressure where the declared one is zero, that of the surroundings where gauges show it.
    """
    declared = capacity_beside(g, at) if has_effort(at) and at.domain == HYDRAULIC else None
    if declared is None:
        return None
    name, size = f"entrained_air_{at.name}", at.scale.effort
    most = _MOST_AIR * declared[0] * size
    c = g.parameter(f"c_{name}", 0.0, "m^3", f"volume of air at {at.label} where the pressure is zero", (0.0, most))
    bounds = (min(0.1 * _ATMOSPHERE, 0.01 * size), max(10.0 * _ATMOSPHERE, size))
    least = g.parameter(f"P_{name}", _ATMOSPHERE, "Pa", "absolute pressure where the declared one is zero", bounds)

    def compressed(pressure: Expr) -> Expr:
        above = maximum(pressure, -least / 2)  # with less the air would fill the machine
        return c * above / (above + least)

    g.compliance(name, displacement=compressed, at=at.junction)
    return Effect(
        "entrained_air", name, "volume = declared + c*effort/(effort + P)", (c.name,), shapes=(least.name,),
        reference="Gholizadeh, Burton, Schoenau (2011), International Journal of Fluid Power 12(3)",
        manoeuvre="the same steps at a low and at a high pressure",
    )  # fmt: skip
