"""Relatives of a law: those that draw nearly the same curve of the same signals at the same place.

A score is taken where a law has no size yet, at a few values of its shapes. Of a basin that runs over at an edge it
promised a quarter of what the law explains, and a leak above a level was taken, which is near it. Once one law of a
signal has been fitted its curve tells more than any score: laws of the same signal, and terms of the library, are
fitted to the curve, which costs no run of a filter. What the fit with the law that leads predicts of them in its place
says which of them are refitted from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from bondgraph.correct.constants import INDIFFERENT
from bondgraph.correct.evidence.context import Context, coefficients
from bondgraph.correct.evidence.decide import choose
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import Candidate, Variant, candidates
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.search.incumbents import Prediction, predicted_by_swap
from bondgraph.correct.search.refit import refit
from bondgraph.correct.shapes.completions import arguments
from bondgraph.correct.shapes.curves import Curve, DrawnLaw, curve_of, departure, drawn_law
from bondgraph.correct.shapes.formula import formula_of
from bondgraph.correct.shapes.library import library, two_signals
from bondgraph.correct.shapes.offered import Residual, formula_at
from bondgraph.correct.shapes.subsets import Sum
from bondgraph.data.log import FloatArray
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

    What leads is what would be chosen, a law that gains clearly more, which may have been refused for its form alone,
    and the foremost product: of the forms of its factors few were refitted. Where a relative of that leads now, its own
    are looked at in turn. None of stiff models, whose refits are costly, and none of a product that gains as little as
    what the form of a law leaves.
    """
    done = list(trials)
    if context.base.problem.filter_model.is_stiff:
        return done
    chosen, foremost = choose(done, context.level), _foremost(done)
    if foremost is not None and (chosen is None or foremost.gain > chosen.gain + INDIFFERENT):
        leads = [foremost, chosen]
    else:
        leads = [chosen]
    for lead in leads:
        if lead is not None and not (_is_product(lead) and left.is_of_a_form(lead.gain)):
            done = _beside(lead, done, left, context, report)
    seen = set[str]()
    while (product := _foremost([one for one in done if _is_product(one)])) and product.candidate.label not in seen:
        if left.is_of_a_form(product.gain):
            break
        seen.add(product.candidate.label)
        done = _beside(product, done, left, context, report)
    return in_plainer_words(done, left, context.level)


def _beside(lead: Trial, trials: Sequence[Trial], left: Residual, context: Context, report: Report) -> list[Trial]:
    """The trials, relatives of a law refitted that promise clearly more than it."""
    done = list(trials)
    curve = attempted(lambda: curve_of(lead, left.signals), lambda why: None)
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
    curve = attempted(lambda: curve_of(whole, left.signals, beside), lambda why: None)
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
        if curve is None or curve.signals != own.signals or departure(own, curve) > _SAME:
            continue
        behind = min(trial.evidence.bic_gain, other.evidence.bic_gain - INDIFFERENT)
        label = other.candidate.label
        return replace(trial, evidence=replace(trial.evidence, bic_gain=behind), words_for=label)
    return trial


def _drawn(trial: Trial, left: Residual) -> Curve | None:
    """The curve of a trial; None where it was not refitted, or is no function of one signal."""
    return None if trial.fit is None else attempted(lambda: curve_of(trial, left.signals), lambda why: None)


def _is_plainer(other: Trial, trial: Trial, level: float) -> bool:
    """True for another law there that passes the tests, with fewer parameters, or with as many and no formula."""
    same = other.candidate.place.label == trial.candidate.place.label and other.gate is None
    saved = len(trial.candidate.effect.parameters) - len(other.candidate.effect.parameters)
    plain = saved > 0 or (saved == 0 and formula_of(other.candidate.function) is None)
    return same and plain and other.evidence is not None and other.evidence.accepted(level)


def _is_product(trial: Trial) -> bool:
    formula = formula_of(trial.candidate.function)
    return formula is not None and len(formula.signals) == 2 and not trial.forms


def _refitted(trial: Trial, prediction: Prediction, context: Context, tried: int) -> Trial:
    return trial.attempted(lambda: refit(trial, prediction.starts, context, tried=tried, promised=prediction.gain))


def _foremost(trials: Sequence[Trial]) -> Trial | None:
    laws = [one for one in trials if one.fit is not None and one.gate is None and not one.candidate.effect.channel]
    return max(laws, key=lambda one: one.gain, default=None)


def _terms(lead: Trial, curve: Curve, left: Residual) -> list[tuple[None, Trial]]:
    """A trial for each kind of term in the signals of a curve."""
    probe = next(one for one in left.probed if one.place.label == lead.candidate.place.label)
    terms = library([curve.signal], curve.signal) if curve.by is None else two_signals(curve.by, curve.signal)
    known = [curve.signal] if curve.by is None else [curve.signal, curve.by]
    kinds = {one.kind.name: one for one in terms}
    found: list[tuple[None, Trial]] = []
    for term in kinds.values():
        count = len(term.kind.laws)
        formula = formula_at(probe, Sum((term,), np.zeros(count), 0.0, 0.0), known)
        made, _ = candidates(left.built, [formula.effect()], [probe.place])
        found += [(None, Trial(one, 0.0)) for one in made if one.label != lead.candidate.label]
    return found


def _near(trials: Sequence[tuple[int | None, Trial]], curve: Curve, context: Context) -> list[_Relative]:
    """The laws that come near a curve, with their numbers there."""
    found = []
    for index, trial in trials:
        try:
            graph = trial.candidate.apply(context.built.graph)
        except DeclarationError:
            continue
        if arguments(trial, graph) != curve.signals:
            continue
        law = drawn_law(trial, graph, curve.signal, curve.by, context.base.values)
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


def _unfitted(trials: Sequence[Trial], lead: Trial, curve: Curve, left: Residual) -> list[tuple[int | None, Trial]]:
    """Laws with shapes at the place of another one of which only a score is known, with their numbers, and terms.

    No terms where widths of the law that leads are not known yet.
    """
    known: list[tuple[int | None, Trial]] = [
        (k, one)
        for k, one in enumerate(trials)
        if one.fit is None and one.candidate.effect.shapes and _is_plain(one, lead)
    ]
    fitted = {one.candidate.label for one in trials if one.fit is not None}
    terms = [(k, one) for k, one in _terms(lead, curve, left) if one.candidate.label not in fitted]
    return known if lead.candidate.effect.widths else [*known, *terms]


def _is_plain(trial: Trial, lead: Trial) -> bool:
    """True for a law of the dictionary at the place of another one, without memory and in all of the logs."""
    effect = trial.candidate.effect
    same = trial.candidate.place.label == lead.candidate.place.label
    plain = not (effect.adds_state or effect.channel or effect.regime) and trial.gate is None
    return trial is not lead and same and plain and formula_of(trial.candidate.function) is None


def _predicted(lead: Trial, near: Sequence[_Relative], context: Context) -> list[tuple[_Relative, Prediction]]:
    """Relatives that promise clearly more than the law that leads, the best first; of a product the best in any case.

    The forms of a factor lie far apart: what one step from the curve of another promises of them is too little.
    """
    told = predicted_by_swap(lead, [one.trial.candidate for one in near], [one.variant for one in near], context)
    least = -np.inf if _is_product(lead) else lead.gain + INDIFFERENT
    better = [
        (one, prediction)
        for one, prediction in zip(near, told, strict=True)
        if prediction is not None and prediction.gain > least
    ]
    return sorted(better, key=lambda pair: -pair[1].gain)[:_MOST]


def _fitted(
    law: DrawnLaw, own: Sequence[FreeParameter], candidate: Candidate, curve: Curve
) -> tuple[float, FloatArray]:
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
