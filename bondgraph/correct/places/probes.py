"""Probes: an unknown effort at every 1-junction, an unknown flow at every 0-junction, an unknown error of every sensor.

What a unit of each does to rates and outputs along the filtered path is found once, from one model that holds them all;
any course over time, or function of a signal, is then a product. So places are searched, and shapes outside every
dictionary estimated, without deriving anything again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from sympy import Expr

from bondgraph.build import BuiltModel, model_of
from bondgraph.correct.models.bonds import bond_model
from bondgraph.correct.scores.scoring import Linearisation
from bondgraph.data.log import FloatArray
from bondgraph.declare.editing import copy, handle
from bondgraph.declare.effect import Place
from bondgraph.declare.expressions import signal as variable_signal
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.derive.causality import assign_causality, bond_labels
from bondgraph.derive.derivation import Derivation
from bondgraph.errors import BondGraphError
from bondgraph.filter.linear.response import Change, Path, model_change
from bondgraph.simulate.model import Model

Variable = Literal["effort", "flow", "sensor"]

#: A probe is applied at this share of the size of the variable it changes.
_SHARE = 1e-3
#: Knots of a free function that a gated law has to be worth more than, as of those that stay unexplained. A
#: convention: enough for two bends, and each knot costs power.
FUNCTION_KNOTS = 8


@dataclass(frozen=True)
class Probe:
    """One place and what a unit of the unknown there changes, one lane per log."""

    place: Place
    variable: Variable
    changes: tuple[Change, ...]


@dataclass(frozen=True)
class Signal:
    """A quantity along the paths of all logs, each (n,); something missing may depend on it.

    ``stored``: it is a state of the machine, which may have a name of its own as an input has.
    """

    name: str
    unit: str
    values: tuple[FloatArray, ...]
    stored: bool = False


def variable_of(place: Place) -> Variable:
    """What would be missing at a place."""
    if place.output:
        return "sensor"
    return "effort" if place.junction.kind == "1" else "flow"


def junctions(where: Sequence[Place]) -> list[Place]:
    """The places at junctions."""
    return [place for place in where if place.bond is None and not place.output]


def probed_model(graph: BondGraph, where: Sequence[Place]) -> tuple[Model, dict[str, str]]:
    """The model with a source of size zero at every junction that takes one, and their parameters by label of place.

    Examples
    --------
    >>> from bondgraph.declare.effect import Scale
    >>> g = BondGraph("mass")
    >>> body = g.one_junction("body")
    >>> _ = g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body)
    >>> model, names = probed_model(g, [Place(handle(g, "body"), Scale(1.0, 1.0))])
    >>> names, model.rhs(0.0, np.zeros(1), np.zeros(0), model.theta(probe_body=4.0)).tolist()
    ({'body': 'probe_body'}, [-2.0])
    """
    wanted = junctions(where)
    try:
        return _with_sources(graph, wanted)
    except BondGraphError:  # one of them is refused: find out which
        taken = [place for place in wanted if _takes(graph, place)]
        return _with_sources(graph, taken)


def _takes(graph: BondGraph, place: Place) -> bool:
    try:
        _with_sources(graph, [place])
    except BondGraphError:
        return False
    return True


def _with_sources(graph: BondGraph, where: Sequence[Place]) -> tuple[Model, dict[str, str]]:
    extended = copy(graph)
    names = {}
    for place in where:
        name = f"probe_{place.name}"
        unknown = extended.parameter(name, 0.0, "", f"unknown at {place.label}")
        declare = extended.effort_source if variable_of(place) == "effort" else extended.flow_source
        declare(f"source_{name}", -unknown, at=handle(extended, place.junction.name))
        names[place.label] = name
    equations = Derivation(assign_causality(extended)).equations()
    return model_of(equations, f"{graph.name} (probed)"), names


def probes(built: BuiltModel, linear: Linearisation, where: Sequence[Place]) -> tuple[Probe, ...]:
    """A probe for every junction that takes one, and for every sensor.

    A missing effort or flow counts as one that is taken away (a loss); a sensor's error as what it adds.
    """
    model, names = probed_model(built.graph, where)
    found = []
    for place in where:
        variable = variable_of(place)
        if place.label in names:
            size = _SHARE * (place.scale.effort if variable == "effort" else place.scale.flow)
            changes = tuple(_source(log.path, model, names[place.label], size) for log in linear.logs)
            found.append(Probe(place, variable, changes))
        elif place.output:
            row = linear.model.index("output", place.output)
            found.append(Probe(place, variable, tuple(_sensor(log.path, linear.model, row) for log in linear.logs)))
    return tuple(found)


def _source(path: Path, probed: Model, name: str, size: float) -> Change:
    return model_change(path, probed, probed.theta(**path.parameters(probed), **{name: size}), size)


def _sensor(path: Path, model: Model, row: int) -> Change:
    still = np.zeros((len(model.states), path.time.size - 1, 1))
    outputs = np.zeros((len(model.outputs), path.time.size, 1))
    outputs[row] = 1.0
    return Change(still, still, outputs)


def shaped(change: Change, course: FloatArray) -> Change:
    """A unit change that follows courses (lanes, n), a lane each."""
    over = course.T
    return Change(change.start * over[:-1], change.end * over[1:], change.outputs * over)


def signals(built: BuiltModel, linear: Linearisation, where: Sequence[Place]) -> tuple[Signal, ...]:
    """Quantities that something missing may depend on, those that move.

    Flows of 1-junctions, efforts of 0-junctions, displacements and momenta of storages, positions, inputs, time. Rates
    of inputs are none: no law of a graph can name them.
    """
    model = bond_model(built.causal)
    labels = bond_labels(built.causal)
    own = len(built.equations.outputs)
    flat = built.causal.graph
    values = []
    for log in linear.logs:
        with np.errstate(all="ignore"):
            theta = model.theta(**log.path.parameters(model))
            values.append(model.output(log.path.time, log.path.before, log.path.u, theta)[own:])
    found = []
    for place in junctions(where):
        bond = flat.incidence()[place.junction.name][0][0]
        effort = variable_of(place) == "flow"
        row = bond if effort else len(labels) + bond
        unit = "" if place.domain is None else (place.domain.effort_unit if effort else place.domain.flow_unit)
        name = f"{'effort' if effort else 'flow'} of {place.label}"
        found.append(Signal(name, unit, tuple(rows[row] for rows in values)))
    found += _stored(built, linear)
    for row, info in enumerate(linear.model.inputs):
        if not info.rate_of and not info.late_of:
            found.append(Signal(info.name, info.unit, tuple(log.path.u[row] for log in linear.logs)))
    found.append(Signal("time", "s", tuple(log.path.time for log in linear.logs)))
    return tuple(signal for signal in found if _moves(signal))


def _stored(built: BuiltModel, linear: Linearisation) -> list[Signal]:
    """Displacements and momenta of storages, and positions that the graph integrates.

    What a disturbance or a late sensor stores, which an effect brought with it, moves nothing but by that effect.
    """
    brought = linear.base.problem.filter_model.follows
    found = []
    for state in built.equations.states:
        name = state.symbol.name
        if state.variable in ("displacement", "momentum"):
            name = f"{state.variable} of {state.element}"
        elif state.variable != "integral" or name in brought:
            continue  # the flow or effort of a junction
        row = linear.model.index("state", state.symbol.name)
        found.append(Signal(name, state.unit, tuple(log.path.before[row] for log in linear.logs), stored=True))
    return found


def argument(name: str) -> Expr:
    """The expression of the signal that :func:`signals` gives this name.

    Examples
    --------
    >>> argument("displacement of spring"), argument("time")
    (displacement(spring), t)
    """
    variable, separator, node = name.partition(" of ")
    if separator:
        return variable_signal(variable, node)
    return symbol("t" if name == "time" else name)


def _moves(signal: Signal) -> bool:
    together = np.concatenate(signal.values)
    return bool(np.isfinite(together).all() and np.ptp(together) > 1e-9 * np.abs(together).max())


def knots(signal: Signal, count: int, beyond: float = 0.5) -> FloatArray:
    """Distinct knots between which the signal is found about equally often, ``beyond`` percent of it outside the ends.

    Functions are held outside; with nothing beyond, every straight line is among them.
    """
    together = np.concatenate(signal.values)
    spread = np.ptp(together)
    shares = np.concatenate([[beyond], np.linspace(0.0, 100.0, count)[1:-1], [100.0 - beyond]])
    placed = np.percentile(together, shares)
    kept = [placed[0]]
    for value in placed[1:]:
        if value - kept[-1] > 0.2 * spread / count:
            kept.append(value)
    return np.array(kept)


def is_switch(signal: Signal) -> bool:
    """True for a signal of few values, which has no functions but steps.

    Examples
    --------
    >>> is_switch(Signal("clutch", "1", (np.repeat([0.0, 1.0], 50),)))
    True
    """
    return knots(signal, FUNCTION_KNOTS, beyond=0.0).size < 3


def hats(values: FloatArray, at: FloatArray) -> FloatArray:
    """Piecewise linear functions (knots, n) that are one at their own knot and zero at the others; held outside.

    Examples
    --------
    >>> hats(np.array([0.0, 0.5, 3.0]), np.array([0.0, 1.0, 2.0])).tolist()
    [[1.0, 0.5, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1.0]]
    """
    return np.array([np.interp(values, at, one) for one in np.eye(at.size)])
