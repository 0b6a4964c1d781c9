"""A corrected declaration that says where the states of its effects start.

In a loop they start where the model without them leads (:mod:`.followers`). A declaration can say so where that is one
signal of the log: the command of a lag, the speed of an inertia behind a gear. The load of a spring is a sum of several
signals, and stays at its declared value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.coherent import Displayed
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.editing import copy
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Integral, Start
from bondgraph.declare.revision import revise_initial, revise_start
from bondgraph.derive.equations import State
from bondgraph.errors import DeclarationError
from bondgraph.estimate.initial import directly_measured
from bondgraph.filter.follows import Follow
from bondgraph.simulate.late import first_inputs, inputs_of
from bondgraph.simulate.model import Model
from bondgraph.text import inflected
from bondgraph.units import dimension

#: What else moves a start by less than this share of it is the error of differences.
_ALONE = 1e-6


def with_declared_starts(
    built: BuiltModel, follows: Mapping[str, Follow], logs: Sequence[MatchedLog], paths: Sequence[FloatArray]
) -> tuple[BuiltModel, tuple[str, ...]]:
    """The model whose graph declares the starts that states follow, and the states that no single signal starts.

    Parameters
    ----------
    built
        The corrected model.
    follows
        Where states start, by name; those that the model does not have mean nothing.
    logs, paths
        Matched logs and the states along them, (n_x, n): how large signals are.
    """
    names = built.model.names("state")
    owned = {state.symbol.name: state for state in built.equations.states}
    due = {name: follow for name, follow in follows.items() if name in names and owned[name].start is None}
    sizes = _sizes(built.model, logs, paths)
    known = {name: follow for name, follow in follows.items() if name in names}
    measured, alone = (_measured(built.model, logs[0], led) for led in (known, {}))
    due |= {name: Follow(0.0) for name in measured if name not in (*alone, *due) and owned[name].start is None}
    graph = copy(built.graph)
    left = []
    for name, follow in due.items():
        if _is_as_declared(follow, sizes, float(built.model.x0()[names.index(name)])) and name not in measured:
            continue
        state = built.model.states[names.index(name)]
        start = measured.get(name) or _single(state, follow, sizes, built.model, measured) or alone.get(name)
        if start is None or not _declared(graph, owned[name], start):
            left.append(name)
    return (build(graph) if len(left) < len(due) else built), tuple(left)


def with_estimated_starts(built: BuiltModel, begun: Mapping[str, float]) -> BuiltModel:
    """The model whose graph lets states start at the numbers where they began in logs, by name, as far as it can."""
    owned = {state.symbol.name: state for state in built.equations.states}
    graph, revised = copy(built.graph), False
    for name, value in begun.items():
        try:
            revise_initial(graph, owned[name].element, value)
        except DeclarationError:
            continue
        revised = True
    return build(graph) if revised else built


def start_cautions(states: Sequence[str]) -> list[str]:
    """Start values that a simulation of the corrected declaration needs and no single signal of a log gives."""
    if not states:
        return []
    return [
        f"the corrected declaration starts {', '.join(states)} at the declared value, since no single signal of a log "
        f"tells where {inflected(states, 'it stands', 'they stand')}; the fits here begin where the other states lead "
        f"{inflected(states, 'it', 'them')} - give --initial to simulate a log that begins in motion"
    ]


def _sizes(model: Model, logs: Sequence[MatchedLog], paths: Sequence[FloatArray]) -> dict[str, float]:
    """The largest values of all states and inputs."""
    together = [
        np.vstack([path[: len(model.states)], inputs_of(model, log)]) for log, path in zip(logs, paths, strict=True)
    ]
    largest = np.abs(np.nan_to_num(np.concatenate(together, axis=1))).max(axis=1)
    return dict(zip((*model.names("state"), *model.names("input")), map(float, largest), strict=True))


def _measured(model: Model, log: MatchedLog, follows: Mapping[str, Follow]) -> dict[str, Start]:
    """The states that an output of their unit shows times a factor, as what they are of it."""
    found = directly_measured(model, first_inputs(model, log), model.theta(**dict(log.theta_overrides)), follows)
    return {
        model.states[state].name: Start(model.outputs[output].name, _rounded(1.0 / slope))
        for output, (state, slope, offset) in found.items()
        if abs(offset) <= _ALONE * abs(slope) and _are_alike(model.outputs[output], model.states[state])
    }


def _are_alike(signal: Displayed, state: Displayed) -> bool:
    """True where a declaration may start the state at the signal: a factor in it has no unit."""
    return not signal.unit or not state.unit or dimension(signal.unit) == dimension(state.unit)


def _single(
    state: Displayed, follow: Follow, sizes: Mapping[str, float], model: Model, measured: Mapping[str, Start]
) -> Start | None:
    """The one signal that a start follows, None where it is more than one or not in the log."""
    parts = {name: abs(slope) * sizes.get(name, 0.0) for name, slope in follow.slopes}
    name = max(parts, key=lambda one: parts[one], default="")
    rest = abs(follow.constant) + sum(part for one, part in parts.items() if one != name)
    if not name or not rest <= _ALONE * parts[name]:
        return None
    slope = dict(follow.slopes)[name]
    unfit = [one.name for one in model.inputs if one.letters or one.rate_of or one.late_of]  # in no log
    start = Start(name, _rounded(slope)) if name in model.names("input") and name not in unfit else None
    shown = measured.get(name)
    if shown is not None:
        start = Start(shown.signal, _rounded(slope * shown.factor))
    if start is None:
        return None
    signal: Displayed = (
        model.inputs[model.index("input", start.signal)]
        if start.signal in model.names("input")
        else model.outputs[model.index("output", start.signal)]
    )
    return start if _are_alike(signal, state) else None


def _is_as_declared(follow: Follow, sizes: Mapping[str, float], declared: float) -> bool:
    """True for a start that depends on no signal, and is the declared one."""
    moved = sum(abs(slope) * sizes.get(name, 0.0) for name, slope in follow.slopes)
    return moved <= _ALONE * abs(declared) and abs(follow.constant - declared) <= _ALONE * abs(declared)


def _rounded(factor: float) -> float:
    """A factor without the last digits, which are those of differences."""
    return float(f"{factor:.7g}")


def _declared(graph: BondGraph, state: State, start: Start) -> bool:
    """Declare the start of a state in the graph itself; False where it belongs to a part or a field."""
    is_integral = isinstance(graph._quantities.get(state.symbol.name), Integral)
    try:
        revise_start(graph, state.symbol.name if is_integral else state.element, start.signal, start.factor)
    except DeclarationError:
        return False
    return True
