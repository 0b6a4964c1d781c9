"""Gaps: play in front of a declared spring, and couplings that lose contact altogether.

A dead zone in front of a spring says nothing of the damper beside it. Where both sit behind the gap, as in the teeth of
a gear or the claws of a coupling, neither carries anything as long as it is open: the model of Nordin, Galic and
Gutman (1997), International Journal of Adaptive Control and Signal Processing 11(1), with a dead zone for each.

References: Nordin, Gutman (2002), Automatica 38(10), a survey of backlash in drives.
"""

from __future__ import annotations

from sympy import Abs, Expr

from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.expressions import signal
from bondgraph.declare.functions import clip
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_laws
from bondgraph.effects.places import elements_at, is_motion
from bondgraph.effects.storages import Spring, spring_at

_SURVEY = "Nordin, Gutman (2002), Automatica 38(10)"
_MANOEUVRE = "loads that change their sign"
#: Gaps from which a search begins, as shares of the largest: half a decade apart, so that one is near. A convention.
_AMPLITUDES = (0.03, 0.1, 0.3)


def backlash(g: BondGraph, at: Place) -> Effect | None:
    """Play in front of a declared spring: it carries nothing until the gap is taken up."""
    spring = spring_at(g, at) if is_motion(at) else None
    if spring is None:
        return None
    gap = _opened(g, at, spring, f"backlash_{at.name}")
    return Effect(
        "backlash", spring.name, "effort = k*(displacement - clip(displacement, -b, b))", (gap.name,),
        amplitudes=_AMPLITUDES, reference=_SURVEY, manoeuvre=_MANOEUVRE,
    )  # fmt: skip


def clearance(g: BondGraph, at: Place) -> Effect | None:
    """A gap in front of a declared spring and the dampers beside it: claws, teeth or pins that touch nothing inside."""
    spring = spring_at(g, at) if is_motion(at) else None
    dampers = [node for node in elements_at(g, at, "R") if node.law("effort") is not None]
    if spring is None or not dampers or any("." in node.name for node in dampers):
        return None
    name = f"clearance_{at.name}"
    gap = _opened(g, at, spring, name)
    meaning = "part of the gap over which the dampers let go"
    w = g.parameter(f"w_{name}", at.smoothing * spring.way, spring.unit, meaning)
    open_by = gap - Abs(signal("displacement", spring.name))
    for node in dampers:
        revise_laws(g, node.name, lambda laws: {"effort": laws["effort"] * (1 - clip(open_by / w, 0, 1))})
    return Effect(
        "clearance", spring.name, "effort = k*(displacement - clip(displacement, -b, b)), no damping inside",
        (gap.name,), amplitudes=_AMPLITUDES, widths=(w.name,), reference=_SURVEY, manoeuvre=_MANOEUVRE,
    )  # fmt: skip


def _opened(g: BondGraph, at: Place, spring: Spring, name: str) -> Expr:
    """Half of the play in front of a spring, free; the spring carries what is beyond it."""
    gap: Expr = g.parameter(f"gap_{name}", 0.0, spring.unit, f"half of the play at {at.label}", (0.0, 2.0 * spring.way))
    way = symbol("displacement")
    beyond = way - clip(way, -gap, gap)
    revise_laws(g, spring.name, lambda laws: {"effort": laws["effort"].xreplace({way: beyond})})
    return gap
