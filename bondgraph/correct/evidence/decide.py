"""Decisions: which candidate, if any, the training logs ask for.

A candidate must pass three hurdles, all corrected for the number of candidates tried (Bonferroni): the likelihood
ratio test; a test of its coefficient with the block-sandwich variance, which coloured noise does not deceive; and the
Bayesian information criterion. Held-out logs take no part.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np
from scipy import stats

from bondgraph.correct.constants import BLOCKS, FAINT, INDIFFERENT, MOSTLY, POWER
from bondgraph.correct.evidence.trials import Detectable, Evidence, Trial
from bondgraph.correct.fits.times import summed, term_times
from bondgraph.correct.fits.whiteness import is_white
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.scores.score import Scores, robust_variance, solve
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.effect import Effect
from bondgraph.estimate.fitted import Fit, restricted
from bondgraph.estimate.objective import Expansion, Terms
from bondgraph.estimate.symmetric import scaled_eigen

#: A direction of parameters with less than this share of the largest information leaves no trace in logs: scaled to
#: unit information its condition index is above 300, where 100 is called severe (Belsley, Kuh, Welsch 1980, Regression
#: Diagnostics, section 3.2).
_UNSEEN = 1e-5


def judge(base: Fit, refit: Fit, effect: Effect, tried: int, gated: bool = False) -> Evidence:
    """Evidence of a refit against the fit without the effect; a switching time counts as one more parameter."""
    gain = base.nll - refit.nll
    count = len(effect.parameters) + gated
    measured = int(sum(np.isfinite(log.y).sum() for log in refit.problem.logs))
    ratio = float(stats.chi2.sf(2.0 * max(gain, 0.0), count))
    penalty = 0.5 * count * math.log(max(measured, 2)) + math.log(max(tried, 1))
    robust = min(
        robust_p_value(refit, effect.coefficients, effect.shapes),
        gauge_p_value(gain, refit, effect.coefficients, effect.shapes),
    )
    robust = 1.0 if within_a_sample(refit, effect) else robust
    return Evidence(gain, min(1.0, ratio * tried), min(1.0, robust * tried), gain - penalty, tried)


def within_a_sample(fitted: Fit, effect: Effect) -> str:
    """Objection to a command that is late by less than half of the usual interval between samples; empty if none.

    By half an interval an input that is held between samples is later than one that runs straight, and nobody knows
    which it was: of a cell sampled every 2 s a lag of 0.07 s was found where a polarisation of 45 s was missing. One
    sensor may be late beside others by less than a sample, and its filter mostly is.
    """
    name = effect.coefficients[0] if effect.coefficients and effect.adds_state and not effect.channel else ""
    names = fitted.problem.filter_model.model.names("parameter")
    if name not in names or fitted.problem.filter_model.model.parameters[names.index(name)].unit != "s":
        return ""
    interval = float(np.median(np.concatenate([np.diff(log.time) for log in fitted.problem.logs])))
    if fitted.values.get(name, math.inf) >= 0.5 * interval:
        return ""
    return f"it takes less than half of the {interval:.3g} s between samples, in which nobody knows how inputs run"


def robust_p_value(
    fitted: Fit, coefficients: Sequence[str], shapes: Sequence[str] = (), uneven: bool = False, share: float = 1.0
) -> float:
    """P-value of coefficients being zero, by their block-sandwich variance; Hotelling's statistic if several.

    A coefficient of which nothing but zero is left counts as absent, one that rests on another bound as free: it is no
    less far from zero than that. With ``uneven`` the degrees of freedom are those of :func:`effective_blocks`: a
    scatter that rests on two or three blocks of time is itself hardly known. ``share`` is the part of what the logs
    tell of the coefficients that counts.

    ``shapes`` are taken as they are: where the coefficients are zero they mean nothing, so that their scatter is none
    of the coefficients'. With it a threshold or the reach of an exponential would move a coefficient by its own size,
    and no law of such a shape could be told from zero. Reference: Davies (1987), Biometrika 74(1).
    """
    times = term_times(fitted.problem)
    present = np.isin(fitted.problem.names, list(coefficients)) & (fitted.problem.values(fitted.point) != 0.0)
    free = (~fitted.held | present) & ~np.isin(fitted.problem.names, list(shapes))
    variance = np.zeros((free.size, free.size))
    variance[np.ix_(free, free)] = robust_variance(restricted(fitted.expansion, free), times)
    rows, distances = [], []
    for name in coefficients:
        index = fitted.problem.names.index(name)
        value = float(fitted.problem.values(fitted.point)[index])
        if value != 0.0 and variance[index, index] > 0.0:
            rows.append(index)
            distances.append(value / fitted.problem.free[index].slope(value))
    if not rows:
        return 1.0
    distance = np.array(distances)
    squared = share * float(distance @ solve(variance[np.ix_(rows, rows)], distance[:, np.newaxis])[:, 0])
    size = len(rows)
    count = float(max(int(times.block.max()) + 1, size + 2))
    if uneven:
        count = min(count, effective_blocks(fitted, [fitted.problem.names[row] for row in rows]))
        if count <= size:
            return 1.0
    return float(stats.f.sf(squared * (count - size) / (size * (count - 1)), size, count - size))


def doubt(fitted: Fit, effect: Effect) -> float:
    """P-value of an effect that is in a model; zero of one without a coefficient that could be tested.

    Where the logs leave a gauge, its gain is half its squared distance from zero along what they see.
    """
    if not effect.coefficients:
        return 0.0
    p_value = robust_p_value(fitted, effect.coefficients, effect.shapes)
    return min(p_value, gauge_p_value(None, fitted, effect.coefficients, effect.shapes))


def gauge_p_value(gain: float | None, fitted: Fit, coefficients: Sequence[str], shapes: Sequence[str] = ()) -> float:
    """P-value of a gain in nats where the logs leave a direction of the parameters free, one where they leave none.

    Along a gauge all parameters scale together, a coefficient up and down but never to zero; its distance from zero in
    standard errors depends on how it is written then, and says nothing. A gain does not: it is compared with what the
    scatter of blocks has over that of white noise in the directions that the logs see. A gain that is not known (None)
    is half the squared distance of the coefficients from zero in these. References: Gregory and Veall (1985),
    Econometrica 53(6), on distances; Kent (1982), Biometrika 69(1).
    """
    free = ~fitted.held & ~np.isin(fitted.problem.names, list(shapes))
    expansion = restricted(fitted.expansion, free)
    rows = np.isin(np.array(fitted.problem.names)[free], list(coefficients))
    found = scaled_eigen(expansion.information)
    seen = found.values > _UNSEEN * found.largest
    if seen.all() or not rows.any():
        return 1.0
    basis = found.scale[:, np.newaxis] * found.vectors[:, seen]
    along = _along(expansion, basis)
    both = (robust_variance(along, term_times(fitted.problem)), solve(along.information, np.eye(basis.shape[1])))
    covariance = basis @ both[1] @ basis.T
    robust, white = (np.diag(basis @ variance @ basis.T)[rows] for variance in both)
    known = white > 0.0
    if gain is None:
        values = fitted.problem.values(fitted.point)[free][rows]
        moving = [one for one, moves in zip(fitted.problem.free, free, strict=True) if moves]
        own = [one for one, coefficient in zip(moving, rows, strict=True) if coefficient]
        away = np.array([value / one.slope(value) for one, value in zip(own, values, strict=True)])
        gain = 0.5 * float(away @ solve(covariance[np.ix_(rows, rows)], away[:, np.newaxis])[:, 0])
    inflation = float(np.max(robust[known] / white[known], initial=1.0))
    return float(stats.chi2.sf(2.0 * max(gain, 0.0) / inflation, int(rows.sum())))


def _along(expansion: Expansion, basis: FloatArray) -> Expansion:
    """The expansion in the coordinates of a basis (n, m)."""
    terms = expansion.terms
    if terms is not None:
        columns = np.zeros((basis.shape[0] + 1, basis.shape[1] + 1))
        columns[0, 0], columns[1:, 1:] = 1.0, basis
        terms = Terms(terms.innovations @ columns, terms.log_scales @ columns)
    gradient, information = basis.T @ expansion.gradient, basis.T @ expansion.information @ basis
    return Expansion(gradient, information, expansion.evaluations, terms)


def effective_blocks(fitted: Fit, coefficients: Sequence[str]) -> float:
    """How many blocks of equal weight tell as much of the scatter of coefficients as those that they rest on.

    One over the sum of the squared shares of the blocks in what the logs tell of a coefficient; of several coefficients
    the least, of none that are free all blocks. Reference: Carter, Schnepel and Steigerwald (2017), Review of Economics
    and Statistics 99(4).
    """
    times = term_times(fitted.problem)
    count = int(times.block.max()) + 1
    told = _told(fitted, coefficients)
    if not told.size:
        return float(count)
    blocks = summed(times.series(told), times.block, count)
    shares = blocks / np.maximum(blocks.sum(axis=0), np.finfo(float).tiny)
    return float(np.min(1.0 / np.maximum((shares**2).sum(axis=0), np.finfo(float).tiny)))


def channel_shares(fitted: Fit, coefficients: Sequence[str]) -> dict[str, float]:
    """How much of what the logs tell of coefficients each channel does, of several the largest share.

    Zero for all channels if none of the coefficients is free.
    """
    names = fitted.problem.filter_model.model.names("output")
    told = _told(fitted, coefficients)
    if not told.size:
        return dict.fromkeys(names, 0.0)
    rows = np.concatenate([np.repeat(np.arange(len(names)), len(log)) for log in fitted.problem.logs])
    channels = summed(told[: rows.size], rows, len(names))
    shares = channels / np.maximum(channels.sum(axis=0), np.finfo(float).tiny)
    return dict(zip(names, map(float, shares.max(axis=1)), strict=True))


def _told(fitted: Fit, coefficients: Sequence[str]) -> FloatArray:
    """What each term tells of coefficients with the free parameters taken out, those that are free: (n_terms, k)."""
    free = ~fitted.held
    names = [name for name, moves in zip(fitted.problem.names, free, strict=True) if moves]
    rows = [names.index(name) for name in coefficients if name in names]
    expansion = restricted(fitted.expansion, free)
    if not rows or expansion.terms is None:
        return np.empty((0, 0))
    own: FloatArray = expansion.terms.innovations[:, 1:] @ solve(expansion.information, np.eye(len(names)))[:, rows]
    return own**2


def robust_ratio_p_value(gain: float, fitted: Fit, coefficients: Sequence[str]) -> float:
    """P-value of a gain of likelihood in nats, less what the scatter of blocks has over that of white noise.

    The distance of coefficients from zero takes for known what rests on a bound beside them, and would not rest there
    without them; a gain does not. Reference: Kent (1982), Biometrika 69(1).
    """
    free = ~fitted.held
    names = [name for name, moves in zip(fitted.problem.names, free, strict=True) if moves]
    rows = [names.index(name) for name in coefficients if name in names]
    if not rows:
        return 1.0
    expansion = restricted(fitted.expansion, free)
    robust = np.diag(robust_variance(expansion, term_times(fitted.problem)))[rows]
    white = np.diag(solve(expansion.information, np.eye(len(names))))[rows]
    seen = white > 0.0
    inflation = float(np.max(robust[seen] / white[seen], initial=1.0))
    return float(stats.chi2.sf(2.0 * max(gain, 0.0) / inflation, len(rows)))


def hurdle(logs: Sequence[MatchedLog], tried: int, level: float) -> float:
    """The likelihood gain in nats that one coefficient needs to pass all three hurdles."""
    measured = _measured(logs)
    each = level / max(tried, 1)
    ratio = 0.5 * float(stats.chi2.isf(each, 1))
    robust = 0.5 * float(stats.t.isf(0.5 * each, BLOCKS)) ** 2
    return max(ratio, robust, 0.5 * math.log(max(measured, 2)) + math.log(max(tried, 1)))


def _measured(logs: Sequence[MatchedLog]) -> int:
    """Number of measured values in logs."""
    return sum(int(np.isfinite(log.y).sum()) for log in logs)


def detectable(
    vanishing: Sequence[Candidate],
    found: Scores,
    need: float,
    logs: Sequence[MatchedLog],
    unseen: Collection[int] = (),
) -> tuple[Detectable, ...]:
    """The size at which each candidate would have been found nine times in ten.

    The root of twice the gain is nearly normal around size * sqrt(information) with unit variance; it must pass the
    root of twice the ``need``, and move what is measured by as much as is told. Of an effect with several coefficients
    the first is meant. Its bounds say how large all else at its place is: one that would have to be larger cannot be
    detected.

    Parameters
    ----------
    vanishing
        The candidates.
    found
        Their scores.
    need
        Gain in nats that passes the tests, see :func:`hurdle`.
    logs
        The training logs. With d of its noise at each of their measurements an effect gains half of d squared; over a
        horizon it moves predictions by more than that.
    unseen
        Positions of candidates that move nothing measured, whatever their size: nothing is said of them.
    """
    reach = max(math.sqrt(2.0 * need), FAINT * math.sqrt(_measured(logs))) + float(stats.norm.ppf(POWER))
    listed = []
    for k, (one, told) in enumerate(zip(vanishing, found.information, strict=True)):
        if k in unseen:
            continue
        name = one.effect.coefficients[0]
        info = one.model.parameters[one.model.index("parameter", name)]
        size = reach / math.sqrt(told) if told > 0.0 else math.inf
        size = size if size <= max(map(abs, one.bounds(name))) else math.inf  # no such law is meant
        label, shown = (one.effect.name, one.place.label), info.shown(size)
        listed.append(Detectable(*label, name, shown, info.display_unit, taken=not told > 0.0))
    return tuple(listed)


def choose(trials: Sequence[Trial], level: float) -> Trial | None:
    """The refitted candidate with the largest penalised gain among those that pass, or None.

    Nothing contradicts a fault of the only sensor. It is chosen where no law explains as much, believed or not, and
    nothing stays unexplained beside it: a law that is not believed may stand for another of its kind, and a fault for a
    part of what is missing. A law that explains less than half of what such a fault does, a lag aside, is no answer
    then. Nor is its drift told from what is slow in the machine: the last of a cell's relaxations was one. A law that
    only takes energy is preferred to a fault of a sensor that is as likely, and a further part of a known law to one
    more law.
    """
    passed = passing(trials, level)
    if passed and has_one_sensor(passed[0]):
        laws = [trial for trial in passed if not trial.candidate.effect.channel]
        told = max((preferred_gain(one) for one in trials if not one.candidate.effect.channel), default=-math.inf)
        faults = [one for one in passed if is_fault(one)]
        most = max((preferred_gain(one) for one in faults if outdoes(one)), default=-math.inf)
        passed = [one for one in faults if preferred_gain(one) > told + INDIFFERENT and leaves_white(one, level)] or [
            one for one in laws if preferred_gain(one) > MOSTLY * most
        ]
    best = max(passed, key=preferred_gain, default=None)
    preferred = [one for one in passed if one.completes]
    if best is not None and best.candidate.effect.channel:  # machines lose energy more often than sensors fail
        preferred += [one for one in passed if one.candidate.passive and not one.candidate.effect.channel]
    own = max(preferred, key=preferred_gain, default=None)
    if best is not None and own is not None and preferred_gain(own) > preferred_gain(best) - INDIFFERENT:
        return own
    return best


def passing(trials: Sequence[Trial], level: float) -> list[Trial]:
    """The refitted candidates that pass all hurdles, and that nothing is known against."""
    fitted = [trial for trial in trials if trial.fit is not None and trial.transfers and not trial.small]
    return [trial for trial in fitted if trial.evidence is not None and trial.evidence.accepted(level)]


def is_fault(trial: Trial) -> bool:
    """True for a fault of a sensor that may be told from the machine: no drift, which whatever is slow in it does."""
    return bool(trial.candidate.effect.channel) and trial.candidate.effect.kind != "drift"


def outdoes(trial: Trial) -> bool:
    """True for a fault of a sensor that says more than a law where it explains much more: no lag.

    A lag colours the noise of a machine as whatever wanders in it does: a load in pulses was one by 182 nats.
    """
    return is_fault(trial) and trial.candidate.effect.kind != "lag"


def leaves_white(trial: Trial, level: float) -> bool:
    """True for a trial that leaves innovations that could be white."""
    assert trial.fit is not None  # it was refitted
    return is_white(trial.fit, level)


def has_one_sensor(trial: Trial) -> bool:
    """True where a single channel was measured."""
    assert trial.fit is not None  # it was refitted
    seen = np.array([np.isfinite(log.y).any(axis=1) for log in trial.fit.problem.logs]).any(axis=0)
    return int(seen.sum()) == 1


def preferred_gain(trial: Trial) -> float:
    """Penalised gain by which trials are ranked, less a handicap of a formula and of a regime."""
    if trial.evidence is None:
        return -math.inf
    effect = trial.candidate.effect
    preferred = trial.completes or not (effect.formula or effect.regime)  # a known law that acts everywhere is
    return trial.evidence.bic_gain - (0.0 if preferred else INDIFFERENT)
