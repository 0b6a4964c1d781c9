"""Shaping filters as effects: white noise with a memory, in the place of that of a state or beside a sensor.

    dx/dt = -x/T + noise

See :mod:`bondgraph.correct.search.disturbances`, which searches for them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.correct.models.candidates import Candidate, placed, times_of
from bondgraph.correct.models.failures import attempted
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import copy, handle
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.declare.elements import Node
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.revision import replace_signal, revise_output

#: Kind of effect of a disturbance.
DISTURBANCE = "disturbance"
_REFERENCE = "Maybeck (1979), Stochastic Models, Estimation, and Control 1, section 4.11"


def at_state(built: BuiltModel, train: Sequence[MatchedLog], state: str) -> tuple[Candidate, str] | None:
    """The disturbance in the place of the white noise of a state; None where there is no place for it."""
    node = _storage_of(built, state)
    place = _place_of(built, state, node)
    return None if place is None else _made(built, _function(state, node, times_of(train)), place, state)


def at_sensor(built: BuiltModel, train: Sequence[MatchedLog], output: str) -> tuple[Candidate, str] | None:
    """Noise of a sensor with a memory; None where it has no place."""
    return _made(built, _sensor_function(output, times_of(train)), Place.sensor(output, Scale(1.0, 1.0)), "")


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
        name = f"{DISTURBANCE}_{state}".replace(".", "_")
        flat = g.flatten()
        time = g.parameter(f"T_{name}", float(np.sqrt(lower * upper)), "s", "correlation time", (lower, upper))
        if node is None:
            unit = next(one.unit for one in flat.integrals if one.name == state)
            own = g.integral(name, lambda x: -x / time, unit, f"what wanders beside {state}")
            replace_signal(g, state, own)
            law = f"{state} + x, dx/dt = -x/T + noise"
        else:
            domain, at_flow = at.domain, flat.nodes[at.junction.name].kind == "1"
            unit = "" if domain is None else domain.effort_unit if at_flow else domain.flow_unit
            own = g.integral(name, lambda x: -x / time, unit, f"what nothing measures at {at.label}")
            source = g.effort_source if at_flow else g.flow_source
            source(f"{name}_source", own, at=at.junction)
            law = f"{'effort' if at_flow else 'flow'} = x, dx/dt = -x/T + noise"
        return Effect(
            DISTURBANCE, name, law, (), adds_state=True, shapes=(time.name,), reference=_REFERENCE, kind=DISTURBANCE
        )

    return disturbance


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
