"""Curves of laws: what a fitted law adds at a place over the values of its signal that the logs visit.

A law of two signals that one of them scales has the curve of its other factor: of a resistance that grows as a battery
empties the resistance over the charge, whatever the current.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sympy import Expr, Float, Symbol, diff

from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.places.probes import Signal, argument
from bondgraph.correct.shapes.completions import arguments
from bondgraph.correct.shapes.forms import whole_law
from bondgraph.data.log import FloatArray
from bondgraph.declare.functions import numeric
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol

#: Points over which curves are compared, drawn as often as the logs visit them. A convention.
_POINTS = 400
_X = Symbol("x_of_the_curve", real=True)


@dataclass(frozen=True)
class Curve:
    """Curve of a fitted law: what it adds, at values of its signal, both (n,); of two signals its share of ``by``.

    ``is_bent``: what is declared at the place may take a line of it, of two signals a constant: only the rest counts.
    """

    signal: Signal
    x: FloatArray
    y: FloatArray
    is_bent: bool = True
    by: Signal | None = None

    @property
    def signals(self) -> frozenset[str]:
        """Names of the signals that the law depends on."""
        return frozenset({self.signal.name} if self.by is None else {self.signal.name, self.by.name})

    def rest(self, y: FloatArray) -> FloatArray:
        """The part of a curve over the same values that counts, all (n,).

        Examples
        --------
        >>> of = Signal("flow of hub", "rad/s", (np.array([1.0, 2.0]),))
        >>> Curve(of, np.array([1.0, 2.0]), np.array([3.0, 6.0])).rest(np.array([3.0, 6.0])).tolist()
        [0.0, 0.0]
        """
        taken = self.x if self.by is None else np.ones_like(self.x)
        size = float(taken @ taken)
        if not self.is_bent or not size > 0.0:
            return y
        left: FloatArray = y - taken * (float(taken @ y) / size)
        return left


@dataclass(frozen=True)
class DrawnLaw:
    """Law as a function of its signal and of its own numbers, by name; ``sizes`` says which of these scale it."""

    added: Callable[..., Any]
    names: tuple[str, ...]
    sizes: tuple[bool, ...]

    def drawn(self, x: FloatArray, values: Sequence[float] | FloatArray) -> FloatArray:
        """The law at values of its signal, both (n,)."""
        with np.errstate(all="ignore"):
            return np.broadcast_to(np.asarray(self.added(x, *values), dtype=np.float64), x.shape)


def curve_of(lead: Trial, known: Sequence[Signal], beside: Sequence[Trial] = ()) -> Curve | None:
    """The curve of a fitted law over what the logs visit, with others beside it, their place its own.

    None where it is neither a function of one signal of those that are ``known``, nor one that another one scales.
    """
    assert lead.fit is not None and lead.built is not None  # it leads
    graph, values = lead.built.graph, lead.fit.values
    here = [one for one in beside if one.candidate.place.label == lead.candidate.place.label]
    read = frozenset[str]().union(*(arguments(one, graph) or () for one in (lead, *here)))
    for signal, by in _roles(read, known):
        laws = [drawn_law(one, graph, signal, by, values) for one in (lead, *here)]
        if laws[0] is None or (by is not None and None in laws):
            continue
        x = _visited(signal, by)
        y = np.sum([law.drawn(x, [values[name] for name in law.names]) for law in laws if law is not None], axis=0)
        return Curve(signal, x, y, by=by) if np.isfinite(y).all() and y.any() else None
    return None


def _roles(read: frozenset[str], known: Sequence[Signal]) -> list[tuple[Signal, Signal | None]]:
    """The signals that a law may be a curve of, each with the one that scales it; of one signal none does."""
    own = [one for one in known if one.name in read]
    if len(own) != len(read) or len(own) not in (1, 2):
        return []
    return [(own[0], None)] if len(own) == 1 else [(own[0], own[1]), (own[1], own[0])]


def _visited(signal: Signal, by: Signal | None) -> FloatArray:
    """Values (n,) of a signal, as often as the logs visit them; by the square of what scales it, if that is given."""
    together = np.concatenate(signal.values)
    order = np.argsort(together, kind="stable")
    if by is None:
        rows = np.linspace(0, order.size - 1, min(order.size, _POINTS)).round().astype(int)
        plain: FloatArray = together[order][rows]
        return plain
    weight = np.cumsum(np.concatenate(by.values)[order] ** 2)
    at = np.searchsorted(weight, np.linspace(0.0, weight[-1], min(order.size, _POINTS)))
    chosen: FloatArray = together[order][np.minimum(at, order.size - 1)]
    return chosen


def drawn_law(
    trial: Trial, graph: BondGraph, signal: Signal, by: Signal | None, known: Mapping[str, float]
) -> DrawnLaw | None:
    """The law of a trial in its signal, for one of ``by``; None where it depends on more than these and its numbers.

    ``known`` are the values of what is free.
    """
    found = whole_law(trial, graph)
    if found is None:
        return None
    effect = trial.candidate.effect
    fixed = {
        symbol(one.name): Float(known.get(one.name, one.value))
        for one in graph.flatten().parameters
        if one.name not in effect.parameters
    }
    law = found[1].xreplace(fixed)
    if by is not None and not _is_scaled(law, argument(by.name)):
        return None
    ones = {} if by is None else {argument(by.name): Float(1.0)}
    whole = law.xreplace({argument(signal.name): _X, **ones})
    own = [name for name in effect.parameters if symbol(name) in whole.free_symbols]
    if not whole.free_symbols <= {_X, *map(symbol, own)}:
        return None
    added = whole - whole.xreplace({symbol(one): Float(0.0) for one in effect.coefficients})
    sizes = tuple(name in effect.coefficients for name in own)
    return DrawnLaw(numeric([_X, *map(symbol, own)], added), tuple(own), sizes) if any(sizes) else None


def _is_scaled(law: Expr, by: Expr) -> bool:
    """True for a law that is proportional to a signal."""
    return law.xreplace({by: Float(0.0)}) == 0 and by not in diff(law, by).free_symbols


def departure(one: Curve, other: Curve) -> float:
    """The share of the square of a curve that a multiple of another one leaves, a line (a constant) aside."""
    y, by = one.rest(one.y), other.rest(other.y)
    sizes = float(y @ y) * float(by @ by)
    return 1.0 - float(y @ by) ** 2 / sizes if sizes > 0.0 else 1.0
