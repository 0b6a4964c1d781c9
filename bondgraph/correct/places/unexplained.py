"""What fits no known effect: an unknown effort or flow at a place as a free function of a signal, with its band.

The function is piecewise linear between knots where the signal is found about equally often. Its values at the knots
are as many coefficients, estimated with everything else free in the linearised filter; what the free parameters can
imitate is left to them. Splines as elements of unknown shape: Wahba (1990), Spline Models for Observational Data; as a
test of a law against an unknown one: Eubank (1999), Nonparametric Regression and Spline Smoothing, chapter 3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from sympy import Expr

from bondgraph.correct.places.probes import Probe, Signal, Variable, argument, hats, knots, shaped
from bondgraph.correct.scores.score import SAME, Projected, best_step, solve
from bondgraph.correct.scores.scoring import Linearisation
from bondgraph.data.log import FloatArray
from bondgraph.declare.effect import Effect, EffectFunction, Place
from bondgraph.declare.functions import maximum, minimum
from bondgraph.declare.graph import BondGraph
from bondgraph.execute.threads import available_cores, in_threads
from bondgraph.filter.linear.response import Change

#: Information left of an effect, beside a function without a law, below which the function contains it.
_LEFT = 1e-4
#: Functions of which free parameters leave less than this share of the information are theirs: exact twins leave up to
#: 0.3 %, since a parameter acts where the filter stands after a measurement, a function where it stood before.
_THEIRS = 1e-2
#: A combination of knots with a smaller share of the information than this is one that no sample meets.
_UNMET = 1e-9
#: A parameter that takes at least this share of what the foremost takes of a function is named with it.
_SHARED = 0.3
#: Knots of a spline element.
_KNOTS = 8
#: Standard deviations in a band: nineteen of twenty values lie in it.
_BANDS = 2.0
#: A named effect is not needed beside a spline if what it adds is this likely by chance.
_NEEDLESS = 0.01


@dataclass(frozen=True, repr=False)
class Unexplained:
    """What is missing at a place as a function of a signal, which no known effect explains.

    ``knots``, ``values``, ``std`` (knots,): the shape in the unit of the missing variable and its standard deviation by
    blocks of time. What free parameters can take of it, ``taken`` by name, is left out: a straight line in the
    displacement of a spring whose stiffness is free. ``gain`` in nats; ``p_value`` corrected for all functions
    tried. ``like`` names the places that explain it as well.
    """

    place: Place
    variable: Variable
    signal: str
    signal_unit: str
    unit: str
    knots: FloatArray
    values: FloatArray
    std: FloatArray
    gain: float
    p_value: float
    like: tuple[str, ...] = ()
    taken: tuple[str, ...] = ()

    def __repr__(self) -> str:
        where = f"{self.variable} at {self.place.label} as a function of {self.signal}"
        return f"<Unexplained {where}: gain {self.gain:.4g} nats, p = {self.p_value:.2g}>"


@dataclass(frozen=True)
class Spline:
    """A function of one signal at one place that was tried: its values at the knots, their band, gain and p-value.

    ``taken``: names of the free parameters that take a part of any such function, which the values leave out.
    """

    probe: Probe
    signal: Signal
    knots: FloatArray
    values: FloatArray
    std: FloatArray
    gain: float
    p_value: float
    taken: tuple[str, ...] = ()

    @property
    def is_constant(self) -> bool:
        """True for values that are clearly not zero, and all the same within their bands: a load, no function.

        So shows a storage that begins elsewhere than where it was declared.
        """
        middle, band = float(np.median(self.values)), _BANDS * self.std
        return bool((np.abs(self.values) > band).all() and (np.abs(self.values - middle) <= band).all())


def splines(linear: Linearisation, found: Sequence[Probe], known: Sequence[Signal]) -> tuple[Spline, ...]:
    """Score a function of every signal at every place; a sensor's error only as one of what it shows or of time."""
    tried: list[Spline] = []
    for probe in found:
        allowed = [one for one in known if probe.variable != "sensor" or one.name == "time"]
        wanted = [(one, at) for one in allowed if (at := knots(one, _KNOTS, beyond=0.0)).size > 2]
        tried += _each_scored(linear, probe, wanted)
    return tuple(tried)


def _each_scored(linear: Linearisation, probe: Probe, wanted: Sequence[tuple[Signal, FloatArray]]) -> list[Spline]:
    """Functions of several signals at one place, each given with its knots."""
    columns = _columns(linear, probe, wanted)
    edges = np.cumsum([0, *(at.size for _, at in wanted)])
    found: dict[int, Spline] = {}

    def score(k: int) -> None:
        found[k] = _scored(linear, probe, *wanted[k], columns[:, edges[k] : edges[k + 1]])

    in_threads(available_cores(), score, range(len(wanted)))
    return [found[k] for k in range(len(wanted))]


def _columns(linear: Linearisation, probe: Probe, wanted: Sequence[tuple[Signal, FloatArray]]) -> FloatArray:
    """Responses (n_terms, knots of all signals) to functions of signals, each given with its knots."""

    def one_signal(part: int, log: int) -> Change:
        one, at = wanted[part]
        return shaped(probe.changes[log], hats(one.values[log], at))

    return linear.responses([at.size for _, at in wanted], one_signal)[0]


def _scored(linear: Linearisation, probe: Probe, one: Signal, at: FloatArray, columns: FloatArray) -> Spline:
    projected = linear.projected(columns)
    kept, taken = beyond_free(linear, projected)
    if taken:
        projected = linear.projected(columns @ kept)
    own = list(range(kept.shape[1]))
    step, gain, p_value = best_step(projected, own, np.zeros(len(own), dtype=bool))
    cov = _cov(projected, own, step)
    values, variance = kept @ step, np.maximum(np.einsum("ij,jk,ik->i", kept, cov, kept), 0.0)
    return Spline(probe, one, at, values, np.sqrt(variance), gain, p_value, taken)


def distinct(known: Sequence[Signal]) -> list[Signal]:
    """Signals of which none is another times a constant; of such the first."""
    kept: list[Signal] = []
    shapes: list[FloatArray] = []
    for one in known:
        values = np.concatenate(one.values)
        centred = values - values.mean()
        shape = centred / max(math.sqrt(np.sum(centred**2)), np.finfo(float).tiny)
        if all(abs(float(np.sum(shape * other))) < SAME for other in shapes):
            kept.append(one)
            shapes.append(shape)
    return kept


def unexplained(tried: Sequence[Spline], measured: int, level: float) -> Unexplained | None:
    """The function that explains most, if it passes the tests: p-values times the number tried, and the BIC."""
    best: Spline | None = None
    count = len(tried)
    for one in tried:
        penalty = 0.5 * one.knots.size * math.log(max(measured, 2)) + math.log(count)
        ahead = best is None or one.gain > best.gain + 1e-6
        if one.p_value * count < level and one.gain > penalty and ahead and not one.is_constant:
            best = one
    if best is None:
        return None
    like = [
        one.probe.place.label
        for one in tried
        if one is not best and one.signal.name == best.signal.name and best.gain - one.gain < 1.0
    ]
    return Unexplained(
        best.probe.place, best.probe.variable, best.signal.name, best.signal.unit, _unit(best.probe), best.knots,
        best.values, best.std, best.gain, best.p_value * count, tuple(like), best.taken,
    )  # fmt: skip


def beyond_free(linear: Linearisation, found: Projected) -> tuple[FloatArray, tuple[str, ...]]:
    """The functions that free parameters do not take, as an orthonormal basis (knots, kept), and who takes the others.

    A free parameter that does to the sensors what some function of the signal would leaves nothing of it to be told.
    The data fix no more of a shape than what is at right angles to these, at knots that are met about equally often.
    """
    size = found.score.size
    whole = found.expansion.information[-size:, -size:]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(whole), np.finfo(float).tiny))
    own = whole * np.outer(scale, scale)
    values, vectors = np.linalg.eigh(own)
    white = vectors[:, values > _UNMET * values[-1]]
    white = white / np.sqrt(values[values > _UNMET * values[-1]])
    left, turned = np.linalg.eigh(white.T @ (found.information * np.outer(scale, scale)) @ white)
    lost = (scale[:, np.newaxis] * (white @ turned))[:, left < _THEIRS]
    if not lost.shape[1] or lost.shape[1] == size:
        return np.eye(size), ()
    basis, _ = np.linalg.qr(lost, mode="complete")
    return basis[:, lost.shape[1] :], _takers(linear, found, lost)


def _takers(linear: Linearisation, found: Projected, lost: FloatArray) -> tuple[str, ...]:
    """Names of the parameters that take most of each function (knots, lost)."""
    fitted = linear.base
    names = [fitted.problem.free[k] for k in np.flatnonzero(~fitted.held)]
    told = np.sqrt(np.maximum(np.diag(found.expansion.information)[: len(names)], 0.0))
    moved = np.abs(found.share @ lost) * told[:, np.newaxis]
    parameters = [k for k, one in enumerate(names) if one.target.kind == "parameter"]
    takers = [names[k].name for k in parameters if (moved[k] > _SHARED * moved[parameters].max(axis=0)).any()]
    return tuple(takers)


def _cov(found: Projected, own: Sequence[int], step: FloatArray) -> FloatArray:
    """Covariance of a step: that of white noise, widened where blocks of time scatter more."""
    information = found.information[np.ix_(own, own)]
    bread = solve(information, np.eye(len(own)))
    sums = found.sums(own, step)
    sums -= sums.mean(axis=0)
    blocks = bread @ (sums.T @ sums) @ bread
    wider = np.sqrt(np.maximum(np.diag(blocks) / np.maximum(np.diag(bread), np.finfo(float).tiny), 1.0))
    cov: FloatArray = bread * np.outer(wider, wider)
    return cov


def _unit(probe: Probe) -> str:
    domain = probe.place.domain
    if domain is None:
        return ""
    return domain.effort_unit if probe.variable == "effort" else domain.flow_unit


def needless(linear: Linearisation, tried: Sequence[Spline], chosen: Unexplained, coefficients: Sequence[str]) -> bool:
    """True where an effect of the model would be dropped beside the function: a wrong near relative."""
    own = next(k for k in tried if k.probe.place.label == chosen.place.label and k.signal.name == chosen.signal)
    return contained(linear, own, coefficients)


def contained(linear: Linearisation, function: Spline, coefficients: Sequence[str]) -> bool:
    """True where a free function leaves nothing to do for coefficients of the model.

    With both free, what the coefficients still add is a quadratic form in where they would then be.
    """
    fitted, probe, one, at = linear.base, function.probe, function.signal, function.knots
    columns = linear.columns([shaped(probe.changes[k], hats(one.values[k], at)) for k in range(len(linear.logs))])
    expansion = linear.expansion(columns)
    kept = [fitted.problem.names[k] for k in np.flatnonzero(~fitted.held)]
    rows = [kept.index(name) for name in coefficients if name in kept]
    if not rows:
        return True
    others = [k for k in range(expansion.gradient.size) if k not in rows]
    information, gradient = expansion.information, expansion.gradient
    follow = solve(information[np.ix_(others, others)], information[np.ix_(others, rows)])
    left = information[np.ix_(rows, rows)] - information[np.ix_(rows, others)] @ follow
    if np.any(np.diag(left) < _LEFT * np.diag(information)[rows]):
        return True  # the function contains the effect
    score = -(gradient[rows] - follow.T @ gradient[others])
    values = np.array([fitted.values[kept[row]] for row in rows]) + solve(left, score[:, np.newaxis])[:, 0]
    return float(stats.chi2.sf(float(values @ left @ values), len(rows))) > _NEEDLESS


def table_effect(found: Unexplained) -> EffectFunction:
    """The unexplained function as an effect: an element whose law is a table with its points as parameters."""

    def tabulated(g: BondGraph, at: Place) -> Effect | None:
        if at.label != found.place.label or at.output:
            return None
        name = f"table_{at.name}"
        reach = 4.0 * float(np.abs(found.values).max() + found.std.max())
        points = [
            g.parameter(f"{name}_{k}", 0.0, found.unit, f"missing at {knot:.4g} {found.signal_unit}", (-reach, reach))
            for k, knot in enumerate(found.knots)
        ]
        hats_there = _hat_laws(argument(found.signal), found.knots)
        law = sum(point * hat for point, hat in zip(points, hats_there, strict=True))
        if found.variable == "effort":
            g.effort_source(name, -law, at=at.junction)
        else:
            g.flow_source(name, -law, at=at.junction)
        text = f"{found.variable} = table({found.signal}), {found.knots.size} points"
        return Effect("table", name, text, tuple(point.name for point in points))

    tabulated.__name__ = f"table_of_{found.signal.replace(' ', '_')}"
    return tabulated


def _hat_laws(x: Expr, at: FloatArray) -> list[Expr]:
    """The functions of :func:`bondgraph.correct.places.probes.hats` as expressions."""
    laws: list[Expr] = []
    for k in range(at.size):
        rise = (x - at[k - 1]) / (at[k] - at[k - 1]) if k else 1.0
        fall = (at[k + 1] - x) / (at[k + 1] - at[k]) if k + 1 < at.size else 1.0
        laws.append(maximum(0.0, minimum(1.0, minimum(rise, fall))))
    return laws
