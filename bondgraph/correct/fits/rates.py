"""Rates of inputs: what storages take up that follow an input, such as an inertia that turns at a measured speed.

Such a storage brings no state. It takes an effort by the slope of the input, which runs straight from sample to sample,
so that every log tells it. Models are compared on the same inputs: rates that a storage may need are therefore made
inputs of the declared model before anything is fitted; none of its equations uses them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.data.rates import slopes
from bondgraph.declare.editing import copy, handle, with_input_rates
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import Derivation
from bondgraph.derive.equations import Assignment, ImplicitLoop, StateEquations
from bondgraph.errors import BondGraphError
from bondgraph.simulate.model import Model

#: The storage by which a junction is asked what it follows.
_STORAGE = "storage_that_asks"


def with_followed_rates(graph: BondGraph) -> BondGraph:
    """The graph with the rates among its inputs that a storage at any of its junctions would need.

    The graph itself is returned where none would need any.

    Examples
    --------
    >>> g = BondGraph("shaker")
    >>> speed = g.input("speed", "m/s")
    >>> table = g.one_junction("table")
    >>> _ = g.flow_source("coil", speed, at=table)
    >>> _ = g.resistance("guide", g.parameter("c", 2.0, "N s/m"), at=table)
    >>> [one.name for one in with_followed_rates(g).inputs]
    ['speed', 'd_speed']
    """
    followed: dict[str, None] = {}
    for node in graph.flatten().nodes.values():
        if node.is_junction:
            followed.update(dict.fromkeys(_followed(graph, node.name)))
    return with_input_rates(graph, tuple(followed)) if followed else graph


def _followed(graph: BondGraph, junction: str) -> list[str]:
    """Inputs whose rates a storage at a junction takes up: its flow, or effort, depends on them.

    It need not be a source that gives it: a ratio that follows an input ties a junction to it as well.
    """
    trial = copy(graph)
    at = handle(trial, junction)
    size = trial.parameter(f"size_of_{_STORAGE}", 1.0, "")
    declare = trial.inertance if at.kind == "1" else trial.compliance
    declare(_STORAGE, size, at=at)
    try:
        causal = assign_causality(trial)
        if _STORAGE not in dict(causal.derivative):
            return []
        equations = Derivation(causal).equations(bonds=True)  # the load on a source too, which no sensor may show
    except BondGraphError:  # no storage fits there
        return []
    return [one.rate_of for one in equations.inputs if one.rate_of]


def rated(logs: Sequence[MatchedLog], before: Model, after: Model) -> tuple[MatchedLog, ...]:
    """Logs matched to one model as logs of another that has further rates among its inputs, which follow from the logs.

    Parameters
    ----------
    logs
        Matched to ``before``.
    before, after
        The models; all inputs of the second that the first does not have are rates of inputs.
    """
    return tuple(_rated(log, before, after) for log in logs)


def _rated(log: MatchedLog, before: Model, after: Model) -> MatchedLog:
    own, rows, notes = before.names("input"), [], list(log.notes)
    for info in after.inputs:
        if info.name in own:
            rows.append(log.u[own.index(info.name)])
        else:
            rows.append(slopes(log.time, log.u[own.index(info.rate_of)]))
            notes.append(_note(info.rate_of))
    return replace(log, u=np.array(rows).reshape(-1, log.time.size), notes=tuple(notes))


def _note(name: str) -> str:
    return f"the slope of input {name!r} is taken from its samples, since energy is stored that follows it"


def with_notes_of_used_rates(logs: Sequence[MatchedLog], equations: StateEquations) -> list[MatchedLog]:
    """Logs without the notes on slopes that no equation of a model uses."""
    loops = [one for one in equations.assignments if isinstance(one, ImplicitLoop)]
    said = [one for one in equations.assignments if isinstance(one, Assignment)]
    said += [one for loop in loops for one in loop.body]
    every = [one.expression for one in said] + [one.expression for one in equations.outputs]
    every += [*equations.derivatives, *(residual for loop in loops for residual in loop.residuals)]
    used = {symbol for expression in every for symbol in expression.free_symbols}
    idle = {_note(one.rate_of) for one in equations.inputs if one.rate_of and one.symbol not in used}
    return [replace(log, notes=tuple(note for note in log.notes if note not in idle)) for log in logs]
