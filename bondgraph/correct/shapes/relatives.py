"""Relatives of a law: those that draw nearly the same curve of the same signal at the same place.

A score is taken where a law has no size yet, at a few values of its shapes. Of a basin that runs over at an edge it
promised a quarter of what the law explains, and a leak above a level was taken, which is near it. Once one law of a
signal has been fitted its curve tells more than any score: laws of the same signal, and terms of the library, are
fitted to the curve, which costs no run of a filter. What the fit with the law that leads predicts of them in its place
says which of them are refitted from there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from sympy import Float, Symbol

from bondgraph.correct.constants import INDIFFERENT
from bondgraph.correct.evidence.context import Context, coefficients
from bondgraph.correct.evidence.decide import choose
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import Candidate, Variant, candidates
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.places.probes import Signal, argument
from bondgraph.correct.search.incumbents import Prediction, predicted_by_swap
from bondgraph.correct.search.refit import refit
from bondgraph.correct.shapes.completions import arguments
from bondgraph.correct.shapes.forms import whole_law
from bondgraph.correct.shapes.formula import formula_of
from bondgraph.correct.shapes.library import library
from bondgraph.correct.shapes.offered import Residual, formula_at
from bondgraph.correct.shapes.subsets import Sum
from bondgraph.data.log import FloatArray
from bondgraph.declare.functions import numeric
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.errors import DeclarationError
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.local import Report
from bondgraph.filter.filter_model import FilterModel

#: A law that leaves less than this share of the square of a curve is a relative. The share only limits how many are
#: predicted, and the prediction decides: a convention.
_LEFT = 0.1
#: Curves that differ by less than this share of their square are called one, 3 % of their size: a convention, by which
#: powers of 1.9 and 2 are one law, and powers of 1.75 and 2 are two.
_SAME = 1e-3
#: Relatives that are refitted at most: what a loop may take, as the refits of formulas.
_MOST = 2
#: Steps of a fit to a curve at most, for three numbers or four.
_STEPS = 50
#: Points over which curves are compared, drawn as often as the logs visit them.
_POINTS = 400
_X = Symbol("x_of_the_curve", real=True)


@dataclass(frozen=True)
class _Curve:
    """Curve of a fitted law: what it adds, at values of its signal, both (n,).

    ``is_bent``: what is declared at the place may take a line of it, so that only the rest of it counts.
    """

    signal: Signal
    x: FloatArray
    y: FloatArray
    is_bent: bool = True

    def rest(self, y: FloatArray) -> FloatArray:
        """The part of a curve over the same values that counts, all (n,)."""
        size = float(self.x @ self.x)
        if not self.is_bent or not size > 0.0:
            return y
        left: FloatArray = y - self.x * (float(self.x @ y) / size)
        return left


@dataclass(frozen=True)
class _Law:
    """Law as a function of its signal and of its own numbers, by name; ``sizes`` says which of these scale it."""

    added: Callable[..., Any]
    names: tuple[str, ...]
    sizes: tuple[bool, ...]

    def drawn(self, x: FloatArray, values: Sequence[float] | FloatArray) -> FloatArray:
        """The law at values of its signal, both (n,)."""
        with np.errstate(all="ignore"):
            return np.broadcast_to(np.asarray(self.added(x, *values), dtype=np.float64), x.shape)


@dataclass(frozen=True)
class _Relative:
    """A law that comes near a curve: its number among the trials, or none of a term; the shapes and sizes there.

    ``share`` is what it leaves of the square of the curve.
    """

    trial: Trial
    index: int | None
    variant: Variant
    share: float


def with_relatives(trials: Sequence[Trial], left: Residual, context: Context, report: Report) -> list[Trial]:
    """The trials, relatives refitted that promise clearly more than the law that leads.

    What leads is what would be chosen, and a law that gains clearly more: it may have been refused for its form alone.
    None of stiff models, whose refits are costly.
    """
    done = list(trials)
    if context.base.problem.filter_model.is_stiff:
        return done
    chosen, foremost = choose(done, context.level), _foremost(done)
    if foremost is not None and (chosen is None or foremost.gain > chosen.gain + INDIFFERENT):
        done = _beside(foremost, done, left, context, report)
    if chosen is not None:
        done = _beside(chosen, done, left, context, report)
    return in_plainer_words(done, left, context.level)


def _beside(lead: Trial, trials: Sequence[Trial], left: Residual, context: Context, report: Report) -> list[Trial]:
    """The trials, relatives of a law refitted that promise clearly more than it."""
    done = list(trials)
    curve = attempted(lambda: _curve(lead, left), lambda why: None)
    near = [] if curve is None else _near(_unfitted(done, lead, curve, left), curve, context)
    told = attempted(lambda: _predicted(lead, near, context), lambda why: [])
    for k, (one, prediction) in enumerate(told):
        report("refit relatives of the law that leads", k, len(told))
        made = _refitted(one.trial, prediction, context, context.tried + len(near))
        if made.evidence is None:
            continue
        done = [*done, made] if one.index is None else [made if j == one.index else old for j, old in enumerate(done)]
    if told:
        report("refit relatives of the law that leads", len(told), len(told))
    return done


def single_laws(
    whole: Trial, trials: Sequence[Trial], left: Residual, context: Context, beside: Sequence[Trial] = ()
) -> list[tuple[Trial, tuple[FreeParameter, ...]]]:
    """Laws that draw nearly the curve of a sum of laws, the nearest first, and their numbers where they do.

    Parameters
    ----------
    whole
        The sum, with its fit and its model.
    trials
        Laws that may draw it; terms of the library are offered beside them.
    left, context
        The residual of the fit with the sum, and what refits start from.
    beside
        Further laws of the sum, with the same fit and model. Those of another signal or place draw nothing here.

    A straight part of the sum may be a law of its own or lie in what is declared: curves are compared with it and
    without it.
    """
    curve = attempted(lambda: _curve(whole, left, beside), lambda why: None)
    if curve is None:
        return []
    known = {one.candidate.label: one for one in trials if _is_plain(one, whole)}
    offered = [*enumerate(known.values()), *_terms(whole, curve, left)]
    near: list[_Relative] = []
    for seen in (replace(curve, is_bent=False), curve):
        near += sorted(_near(offered, seen, context), key=lambda one: one.share)[:_MOST]
    filter_model = context.base.problem.filter_model
    return [(one.trial, _numbers(one, replace(filter_model, model=one.trial.candidate.model))) for one in near]


def _numbers(relative: _Relative, filter_model: FilterModel) -> tuple[FreeParameter, ...]:
    """The coefficients and shapes of a relative, to start where it is near the curve."""
    candidate, variant = relative.trial.candidate, relative.variant
    own = coefficients(candidate, filter_model, variant)
    sizes = dict(zip(candidate.effect.coefficients, variant.sizes, strict=True))
    starts = [float(np.clip(sizes.get(one.name, one.start), one.lower, one.upper)) for one in own]
    return tuple(replace(one, start=start) for one, start in zip(own, starts, strict=True))


def in_plainer_words(trials: Sequence[Trial], left: Residual, level: float) -> list[Trial]:
    """The trials; formulas behind a law that draws the same curve with no more parameters, and passes the tests.

    With many samples the exponent of a spring that hardens with the cube is told from 3 by what is left of its sensor.
    """
    return [_behind_plainer(one, trials, left, level) for one in trials]


def _behind_plainer(trial: Trial, trials: Sequence[Trial], left: Residual, level: float) -> Trial:
    formula = formula_of(trial.candidate.function)
    if formula is None or trial.evidence is None:
        return trial
    own = _drawn(trial, left)
    for other in trials:
        if own is None or other.evidence is None or not _is_plainer(other, trial, level):
            continue
        curve = _drawn(other, left)
        if curve is None or curve.signal.name != own.signal.name or _departure(own, curve) > _SAME:
            continue
        behind = min(trial.evidence.bic_gain, other.evidence.bic_gain - INDIFFERENT)
        label = other.candidate.label
        return replace(trial, evidence=replace(trial.evidence, bic_gain=behind), words_for=label)
    return trial


def _drawn(trial: Trial, left: Residual) -> _Curve | None:
    """The curve of a trial; None where it was not refitted, or is no function of one signal."""
    return None if trial.fit is None else attempted(lambda: _curve(trial, left), lambda why: None)


def _is_plainer(other: Trial, trial: Trial, level: float) -> bool:
    """True for another law there that passes the tests, with fewer parameters, or with as many and no formula."""
    same = other.candidate.place.label == trial.candidate.place.label and other.gate is None
    saved = len(trial.candidate.effect.parameters) - len(other.candidate.effect.parameters)
    plain = saved > 0 or (saved == 0 and formula_of(other.candidate.function) is None)
    return same and plain and other.evidence is not None and other.evidence.accepted(level)


def _departure(one: _Curve, other: _Curve) -> float:
    """The share of the square of a curve that a multiple of another one leaves, a line aside."""
    y, by = one.rest(one.y), other.rest(other.y)
    sizes = float(y @ y) * float(by @ by)
    return 1.0 - float(y @ by) ** 2 / sizes if sizes > 0.0 else 1.0


def _refitted(trial: Trial, prediction: Prediction, context: Context, tried: int) -> Trial:
    return trial.attempted(lambda: refit(trial, prediction.starts, context, tried=tried))


def _foremost(trials: Sequence[Trial]) -> Trial | None:
    laws = [one for one in trials if one.fit is not None and one.gate is None and not one.candidate.effect.channel]
    return max(laws, key=lambda one: one.gain, default=None)


def _curve(lead: Trial, left: Residual, beside: Sequence[Trial] = ()) -> _Curve | None:
    """The curve of a fitted law over what the logs visit, with others; None where it is no function of one signal."""
    assert lead.fit is not None and lead.built is not None  # it leads
    graph, values = lead.built.graph, lead.fit.values
    here = [one for one in beside if one.candidate.place.label == lead.candidate.place.label]
    read = frozenset[str]().union(*(arguments(one, graph) or () for one in (lead, *here)))
    signal = next((one for one in left.signals if read == frozenset({one.name})), None)
    laws = [] if signal is None else [_law(one, graph, signal, values) for one in (lead, *here)]
    if signal is None or laws[0] is None:
        return None
    visited = np.sort(np.concatenate(signal.values))
    x = visited[np.linspace(0, visited.size - 1, min(visited.size, _POINTS)).round().astype(int)]
    y = np.sum([law.drawn(x, [values[name] for name in law.names]) for law in laws if law is not None], axis=0)
    return _Curve(signal, x, y) if np.isfinite(y).all() and y.any() else None


def _law(trial: Trial, graph: BondGraph, signal: Signal, known: Mapping[str, float]) -> _Law | None:
    """The law of a trial in its signal; None where it depends on more than that and its own numbers.

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
    whole = found[1].xreplace(fixed).xreplace({argument(signal.name): _X})
    own = [name for name in effect.parameters if symbol(name) in whole.free_symbols]
    if not whole.free_symbols <= {_X, *map(symbol, own)}:
        return None
    added = whole - whole.xreplace({symbol(one): Float(0.0) for one in effect.coefficients})
    sizes = tuple(name in effect.coefficients for name in own)
    return _Law(numeric([_X, *map(symbol, own)], added), tuple(own), sizes) if any(sizes) else None


def _terms(lead: Trial, curve: _Curve, left: Residual) -> list[tuple[None, Trial]]:
    """A trial for each kind of term in the signal of a curve."""
    probe = next(one for one in left.probed if one.place.label == lead.candidate.place.label)
    kinds = {one.kind.name: one for one in library([curve.signal], curve.signal)}
    found: list[tuple[None, Trial]] = []
    for term in kinds.values():
        count = len(term.kind.laws)
        formula = formula_at(probe, Sum((term,), np.zeros(count), 0.0, 0.0), [curve.signal])
        made, _ = candidates(left.built, [formula.effect()], [probe.place])
        found += [(None, Trial(one, 0.0)) for one in made if one.label != lead.candidate.label]
    return found


def _near(trials: Sequence[tuple[int | None, Trial]], curve: _Curve, context: Context) -> list[_Relative]:
    """The laws that come near a curve, with their numbers there."""
    found = []
    for index, trial in trials:
        try:
            graph = trial.candidate.apply(context.built.graph)
        except DeclarationError:
            continue
        if arguments(trial, graph) != frozenset({curve.signal.name}):
            continue
        law = _law(trial, graph, curve.signal, context.base.values)
        own = coefficients(trial.candidate, replace(context.base.problem.filter_model, model=trial.candidate.model))
        if law is None or law.names != tuple(one.name for one in own):
            continue
        share, values = _fitted(law, own, trial.candidate, curve)
        if share < _LEFT:
            count = sum(law.sizes)
            shapes = dict(zip(law.names[count:], map(float, values[count:]), strict=True))
            small = trial.candidate.variants[0].sizes  # a size of zero tells no response
            probed = tuple(float(one) or size for one, size in zip(values[:count], small, strict=True))
            found.append(_Relative(trial, index, Variant(shapes, probed), share))
    return found


def _unfitted(trials: Sequence[Trial], lead: Trial, curve: _Curve, left: Residual) -> list[tuple[int | None, Trial]]:
    """Laws with shapes at the place of another one of which only a score is known, with their numbers, and terms.

    No terms where widths of the law that leads are not known yet.
    """
    known: list[tuple[int | None, Trial]] = [
        (k, one)
        for k, one in enumerate(trials)
        if one.fit is None and one.candidate.effect.shapes and _is_plain(one, lead)
    ]
    return known if lead.candidate.effect.widths else [*known, *_terms(lead, curve, left)]


def _is_plain(trial: Trial, lead: Trial) -> bool:
    """True for a law of the dictionary at the place of another one, without memory and in all of the logs."""
    effect = trial.candidate.effect
    same = trial.candidate.place.label == lead.candidate.place.label
    plain = not (effect.adds_state or effect.channel or effect.regime) and trial.gate is None
    return trial is not lead and same and plain and formula_of(trial.candidate.function) is None


def _predicted(lead: Trial, near: Sequence[_Relative], context: Context) -> list[tuple[_Relative, Prediction]]:
    """Relatives that promise clearly more than the law that leads, the best first."""
    told = predicted_by_swap(lead, [one.trial.candidate for one in near], [one.variant for one in near], context)
    better = [
        (one, prediction)
        for one, prediction in zip(near, told, strict=True)
        if prediction is not None and prediction.gain > lead.gain + INDIFFERENT
    ]
    return sorted(better, key=lambda pair: -pair[1].gain)[:_MOST]


def _fitted(law: _Law, own: Sequence[FreeParameter], candidate: Candidate, curve: _Curve) -> tuple[float, FloatArray]:
    """The share of what counts of a curve's square that a law leaves at best, and its numbers there."""
    sizes = np.array(law.sizes)
    # bounds of coefficients only scale a search; zero is one that is kept
    lower = np.array([-np.inf if size and one.lower < 0.0 else one.lower for one, size in zip(own, sizes, strict=True)])
    upper = np.array([np.inf if size and one.upper > 0.0 else one.upper for one, size in zip(own, sizes, strict=True)])
    whole, far = float(curve.rest(curve.y) @ curve.y), 10.0 * float(np.abs(curve.y).max())
    best = (np.inf, np.array([one.start for one in own]))
    if not whole > 0.0:
        return best

    def misses(values: FloatArray) -> FloatArray:
        drawn = law.drawn(curve.x, values)
        drawn = np.where(np.isfinite(drawn), np.clip(drawn, -far, far), far)
        missed: FloatArray = curve.rest(drawn - curve.y) / np.sqrt(whole)
        return missed

    for variant in candidate.variants:
        start = np.array([variant.shapes.get(one.name, one.start) for one in own])
        start[sizes] = variant.sizes
        unit = law.drawn(curve.x, start)
        largest = float(np.abs(unit).max())  # the thirtieth power of a temperature overflows in a square
        if not (0.0 < largest < np.inf) or not (bent := curve.rest(unit / largest)).any():
            continue
        start[sizes] *= float(bent @ curve.y) / float(bent @ bent) / largest
        begun, scale = np.clip(start, lower, upper), np.where(start != 0.0, np.abs(start), 1.0)
        found = least_squares(misses, begun, bounds=(lower, upper), x_scale=scale, max_nfev=_STEPS)
        if 2.0 * found.cost < best[0]:
            best = (2.0 * float(found.cost), found.x)
    return best
