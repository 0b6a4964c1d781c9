"""Shaping filters as effects: white noise with a memory, in the place of that of a state or beside a sensor.

Of first order, and of second order for what keeps a rhythm:

    dx/dt = -x/T + noise
    dx/dt = -x/T - w*y + noise, dy/dt = w*x - y/T, w = 2*pi/P

See :mod:`bondgraph.correct.search.disturbances` and :mod:`bondgraph.correct.search.rhythms`, which search for them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sympy
from sympy import Symbol

from bondgraph.build import BuiltModel, build
from bondgraph.correct.models.candidates import Candidate, placed, times_of
from bondgraph.correct.models.failures import attempted
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import copy, handle
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.declare.elements import Node
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.revision import replace_signal, revise_integral, revise_output

#: Kind of effect of a disturbance.
DISTURBANCE = "disturbance"
#: Name of one that keeps a rhythm.
RHYTHM = "rhythm"
#: A rhythm is looked for within this factor of the line of a spectrum: in a log of four periods a line is so wide.
_NEAR = 1.25
_REFERENCE = "Maybeck (1979), Stochastic Models, Estimation, and Control 1, section 4.11"


def at_state(built: BuiltModel, train: Sequence[MatchedLog], state: str) -> tuple[Candidate, str] | None:
    """The disturbance in the place of the white noise of a state; None where there is no place for it."""
    node = _storage_of(built, state)
    place = _place_of(built, state, node)
    return None if place is None else _made(built, _function(state, node, times_of(train)), place, state)


def at_sensor(built: BuiltModel, train: Sequence[MatchedLog], output: str) -> tuple[Candidate, str] | None:
    """Noise of a sensor with a memory; None where it has no place."""
    return _made(built, _sensor_function(output, times_of(train)), Place.sensor(output, Scale(1.0, 1.0)), "")


def rhythm_at_state(
    built: BuiltModel, train: Sequence[MatchedLog], state: str, seconds: float
) -> tuple[Candidate, str] | None:
    """The disturbance that repeats about every so many ``seconds``, at a state; None where it has no place."""
    node = _storage_of(built, state)
    place = _place_of(built, state, node)
    longest = times_of(train)[1]
    return None if place is None else _made(built, _rhythm(state, node, seconds, longest), place, state)


def state_under(disturbance: Candidate, states: Sequence[str]) -> str | None:
    """The state on which a disturbance acts, of those of a model; None of one of a sensor."""
    return next((one for one in states if _named(DISTURBANCE, one) == disturbance.effect.element), None)


def is_memory(parameter: str) -> bool:
    """True for the name of a time of noise: that in which a disturbance forgets, or keeps its rhythm.

    Examples
    --------
    >>> is_memory("T_disturbance_sensor_speed"), is_memory("T_actuator_lag_motor")
    (True, False)
    """
    return parameter.startswith((f"T_{DISTURBANCE}_", f"T_{RHYTHM}_"))


def _named(kind: str, state: str) -> str:
    return f"{kind}_{state}".replace(".", "_")


def _made(built: BuiltModel, function: EffectFunction, place: Place, state: str) -> tuple[Candidate, str] | None:
    """The candidate of a disturbance and the state whose white noise it replaces; None where the graph refuses it."""
    graph = copy(built.graph)
    effect = attempted(lambda: function(graph, placed(graph, place)), lambda why: None)
    if effect is None:
        return None
    model = attempted(lambda: build(graph).model, lambda why: None)
    return None if model is None else (Candidate(function, place, effect, model), state)


def _storage_of(built: BuiltModel, state: str) -> Node | None:
    """The storage whose state it is; None for an integral of a signal."""
    found = next((one.element for one in built.equations.states if one.symbol.name == state), None)
    return built.causal.graph.nodes.get(found) if found is not None else None


def _place_of(built: BuiltModel, state: str, node: Node | None) -> Place | None:
    one = Scale(1.0, 1.0)
    if node is None:
        known = state in {integral.name for integral in built.graph.flatten().integrals}
        return Place.sensor(state, one) if known else None
    bonds = [bond for bond in built.causal.graph.bonds if node.name in (bond.source, bond.target)]
    ends = [bond.target if bond.source == node.name else bond.source for bond in bonds]
    junctions = [end for end in ends if built.causal.graph.nodes[end].is_junction]
    return Place(handle(built.graph, junctions[0]), one) if len(junctions) == 1 else None


def _function(state: str, node: Node | None, times: tuple[float, float]) -> EffectFunction:
    """The effect function of a disturbance that acts on a state."""
    lower, upper = times

    def disturbance(g: BondGraph, at: Place) -> Effect | None:
        name = _named(DISTURBANCE, state)
        time = g.parameter(f"T_{name}", float(np.sqrt(lower * upper)), "s", "correlation time", (lower, upper))
        own = g.integral(name, lambda x: -x / time, _unit(g, at, state, node), _meaning(at, state, node))
        law = f"{_acting(g, at, state, node, own)}, dx/dt = -x/T + noise"
        return Effect(
            DISTURBANCE, name, law, (), adds_state=True, shapes=(time.name,), reference=_REFERENCE, kind=DISTURBANCE
        )

    return disturbance


def _rhythm(state: str, node: Node | None, seconds: float, longest: float) -> EffectFunction:
    """The effect function of a disturbance that repeats about every so many ``seconds``; ``longest`` is a log."""

    def rhythm(g: BondGraph, at: Place) -> Effect | None:
        name, bounds = _named(RHYTHM, state), (seconds, max(longest, 2.0 * seconds))
        time = g.parameter(f"T_{name}", float(np.sqrt(bounds[0] * bounds[1])), "s", "time it keeps its rhythm", bounds)
        around = (seconds / _NEAR, seconds * _NEAR)
        period = g.parameter(f"P_{name}", seconds, "s", "time after which it repeats", around)
        unit, meaning, rate = _unit(g, at, state, node), _meaning(at, state, node), 2 * sympy.pi / period
        own = g.integral(name, 0, unit, meaning)
        quarter = g.integral(f"{name}_quarter", lambda y: rate * own - y / time, unit, f"{meaning}, a quarter later")
        revise_integral(g, name, -own / time - rate * quarter)
        law = f"{_acting(g, at, state, node, own)}, dx/dt = -x/T - 2*pi*y/P + noise, dy/dt = 2*pi*x/P - y/T"
        return Effect(
            RHYTHM, name, law, (), adds_state=True, shapes=(time.name, period.name), reference=_REFERENCE,
            kind=DISTURBANCE,
        )  # fmt: skip

    return rhythm


def _unit(g: BondGraph, at: Place, state: str, node: Node | None) -> str:
    """The unit of what acts on a state."""
    if node is None:
        return next(one.unit for one in g.flatten().integrals if one.name == state)
    return "" if at.domain is None else at.domain.effort_unit if _at_flow(g, at) else at.domain.flow_unit


def _at_flow(g: BondGraph, at: Place) -> bool:
    """True at a 1-junction, where what acts is an effort."""
    return g.flatten().nodes[at.junction.name].kind == "1"


def _meaning(at: Place, state: str, node: Node | None) -> str:
    return f"what wanders beside {state}" if node is None else f"what nothing measures at {at.label}"


def _acting(g: BondGraph, at: Place, state: str, node: Node | None, own: Symbol) -> str:
    """Text of how a signal acts on a state, which it does from then on."""
    if node is None:
        replace_signal(g, state, own)
        return f"{state} + x"
    source = g.effort_source if _at_flow(g, at) else g.flow_source
    source(f"{own.name}_source", own, at=at.junction)
    return f"{'effort' if _at_flow(g, at) else 'flow'} = x"


def _sensor_function(output: str, times: tuple[float, float]) -> EffectFunction:
    """The effect function of a sensor whose noise has a memory."""
    lower, upper = times

    def disturbance(g: BondGraph, at: Place) -> Effect | None:
        name = f"{DISTURBANCE}_sensor_{at.name}"
        unit = next(one.unit for one in g.outputs if one.name == output)
        time = g.parameter(f"T_{name}", float(np.sqrt(lower * upper)), "s", "correlation time", (lower, upper))
        own = g.integral(name, lambda x: -x / time, unit, f"what the sensor of {output} adds")
        revise_output(g, output, lambda shown: shown + own)
        return Effect(
            DISTURBANCE, name, "shown = true + x, dx/dt = -x/T + noise", (), adds_state=True, shapes=(time.name,),
            reference=_REFERENCE, channel=output, kind=DISTURBANCE,
        )  # fmt: skip

    disturbance.__dict__["for_sensors"] = True
    return disturbance
