"""Transfer: does an effect predict data that it was not estimated from.

With thousands of samples whatever correlates with a residual gains likelihood on the data it was fitted to. So the
training data are cut into folds: each log is one where there are three at least, else blocks of time. With and without
the effect everything is estimated without a fold, and the fold is predicted. No refit is needed for that: the optimum
without a fold lies one Newton step away, by the scores and the Fisher information of the fold,

    x - (I - I_f)^-1 (g - g_f).

What one fold tells of other parameters than the effect's, and the rest hardly, stays as it is: without the launch that
closes a clutch nothing is known of the clutch, and the launch cannot be predicted with any law. A fold that tells more
of the effect itself than all others together is no test of it: the largest current of a choke, seen once, asks the rest
to extrapolate, and there the forms of two laws part that are alike elsewhere. What it gains does not count.

Reference: Rad and Maleki (2020), J. Royal Stat. Soc. B 82(4); Giordano, Stephenson, Liu, Jordan and Broderick (2019),
AISTATS, for approximate cross-validation. The gain over all folds must be above zero by more than its scatter over
blocks of time, and not be that of one fold alone; and over the horizon no channel may be predicted clearly worse,
unless the others gain more by it: where two laws lack, the first may wait for its partner.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from bondgraph.correct.constants import CHANCE, FOLDS, LOGS_AS_FOLDS
from bondgraph.correct.fits.compared import Compared, Errors, is_worse, judged, squares
from bondgraph.correct.fits.horizon import horizon, predicted, windows
from bondgraph.correct.fits.times import summed, term_times
from bondgraph.correct.scores.score import solve
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.effect import Effect
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.objective import BoolArray, Terms, expansion_of
from bondgraph.estimate.symmetric import scaled_eigen

#: Information of a coefficient that is left without a fold, as a share of all of it, below which nothing is known.
_NOTHING = 1e-6
#: A step that makes its data less likely by more nats than a fit is known to is cut to a quarter; if that does too, the
#: fit stays where it is.
_CLEARLY, _SHARES = 0.5, (0.25, 0.0)


@dataclass(frozen=True)
class Fold:
    """A part of the training data: the log it lies in and its first and last sample."""

    log: int
    first: int
    last: int
    name: str


@dataclass(frozen=True)
class Transfer:
    """What an effect gains where it was not estimated.

    ``gains``: in nats by fold; their sum is ``gain``, with its standard ``error`` by blocks of time and ``p_value``;
    ``fold_error`` is that by folds. ``compared``: predictions over the horizon, without the effect and with it.
    ``untested`` are folds that tell most of the effect; they are none of ``folds``.
    """

    folds: tuple[str, ...]
    gains: tuple[float, ...]
    error: float
    fold_error: float
    p_value: float
    compared: tuple[Compared, ...] = ()
    untested: tuple[str, ...] = ()

    @property
    def gain(self) -> float:
        """Nats over all folds."""
        return sum(self.gains)

    @property
    def passes(self) -> bool:
        """Whether the effect transfers."""
        return not self.why_not

    @property
    def why_not(self) -> str:
        """What speaks against it, empty if nothing does."""
        worse = [str(one) for one in self.compared if one.clearly] if is_worse(self.compared) else []
        if not self.p_value < CHANCE:
            return f"left out, the folds gain {self.gain:.3g} ± {self.error:.3g} nats (p = {self.p_value:.2g})"
        if not self.gain > self.fold_error:
            largest = self.folds[int(np.argmax(self.gains))]
            return f"left out, the folds gain {self.gain:.3g} ± {self.fold_error:.3g} nats, all of it in {largest}"
        return worse[0] if worse else ""


def transfer(base: Fit, refit: Fit, effect: Effect) -> Transfer:
    """How an effect of a refit predicts what it was not estimated from, against the fit without it on the same logs."""
    logs = refit.problem.logs
    cut = folds(logs)
    without, with_it = left_out(base, cut, ()), left_out(refit, cut, effect.coefficients)
    series = with_it.likelihoods - without.likelihoods
    tested = np.flatnonzero(with_it.tested)
    kept, rows = [cut[k] for k in tested], [_rows(logs, cut)[k] for k in tested]
    gains = tuple(float(series[one].sum()) for one in rows)
    seen = np.concatenate([np.arange(one.start, one.stop) for one in rows])
    _, blocks = np.unique(term_times(refit.problem).block[seen], return_inverse=True)
    sums = summed(series[seen, np.newaxis], blocks, int(blocks.max()) + 1)[:, 0]
    error = float(np.std(sums, ddof=1)) * math.sqrt(sums.size)
    fold_error = float(np.std(gains, ddof=1)) * math.sqrt(len(gains))
    p_value = float(stats.t.sf(sum(gains) / error, sums.size - 1)) if error > 0.0 and math.isfinite(error) else 1.0
    ahead = _ahead(base, refit, without.points[:, tested], with_it.points[:, tested], kept)
    untested = tuple(one.name for one in cut if one not in kept)
    return Transfer(tuple(one.name for one in kept), gains, error, fold_error, p_value, ahead, untested)


def folds(logs: Sequence[MatchedLog]) -> tuple[Fold, ...]:
    """The folds of training logs.

    Examples
    --------
    >>> log = MatchedLog("run", 0.1 * np.arange(13), np.empty((0, 13)), np.empty((0, 13)))
    >>> [(one.first, one.last) for one in folds([log])]
    [(0, 1), (2, 3), (4, 5), (6, 7), (8, 9), (10, 12)]
    """
    if len(logs) >= LOGS_AS_FOLDS:
        return tuple(Fold(k, 0, log.time.size - 1, log.name) for k, log in enumerate(logs))
    total = sum(float(log.time[-1] - log.time[0]) for log in logs)
    found = []
    for k, log in enumerate(logs):
        count = math.ceil(FOLDS * float(log.time[-1] - log.time[0]) / total - 1e-9)
        edges = [log.time.size * j // count for j in range(count + 1)]
        for first, end in itertools.pairwise(edges):
            name = f"{log.name}, {log.time[first]:.4g} to {log.time[end - 1]:.4g} s"
            found.append(Fold(k, first, end - 1, name))
    return tuple(found)


def _rows(logs: Sequence[MatchedLog], cut: Sequence[Fold]) -> list[slice]:
    """The samples of each fold among those of all logs."""
    starts = np.cumsum([0, *(log.time.size for log in logs)])
    return [slice(int(starts[one.log]) + one.first, int(starts[one.log]) + one.last + 1) for one in cut]


@dataclass(frozen=True)
class LeftOut:
    """Where a fit would be without each fold, and how it predicts that fold there.

    ``points`` (n, folds); ``likelihoods`` (samples,) of each sample but for their constants, at the point made without
    its fold; ``tested`` (folds,): which folds can be predicted, since the others tell as much of the effect. All where
    fewer than two can.
    """

    points: FloatArray
    likelihoods: FloatArray
    tested: BoolArray


def left_out(fitted: Fit, cut: Sequence[Fold], coefficients: Sequence[str]) -> LeftOut:
    """A fit without each fold; ``coefficients`` of which nothing is known without a fold are zero there."""
    problem, terms = fitted.problem, fitted.expansion.terms
    assert terms is not None  # every fit of a loop has them
    times = term_times(problem)
    inside = np.full(int(times.sample.max()) + 1, -1)
    for k, rows in enumerate(_rows(problem.logs, cut)):
        inside[rows] = k
    of_term = np.where(times.sample >= 0, inside[times.sample], -1)
    points = np.repeat(fitted.point[:, np.newaxis], len(cut), axis=1)
    zero = np.zeros(points.shape, dtype=bool)
    of_effect = [problem.names.index(name) for name in coefficients]
    tested = np.ones(len(cut), dtype=bool)
    for k in range(len(cut)):
        rest = of_term != k
        left = expansion_of(terms.innovations[rest], terms.log_scales[rest], 0)
        along = _told_elsewhere(fitted, left.information, of_effect)
        tested[k] = _tells_as_much(fitted, left.information, of_effect)
        step = -along @ solve(along.T @ left.information @ along, along.T @ left.gradient[:, np.newaxis])[:, 0]
        points[:, k] = np.clip(fitted.point + step, problem.lower, problem.upper)
        known = np.diag(left.information) >= _NOTHING * np.diag(fitted.expansion.information)
        zero[of_effect, k] = ~known[of_effect] & (problem.lower[of_effect] <= 0.0)
    points[zero] = 0.0
    points, seen = _towards_likelier(fitted, points, of_term, zero)
    series = times.series(-(0.5 * seen.innovations**2 + seen.log_scales))
    found = np.empty(series.shape[0])
    for k, rows in enumerate(_rows(problem.logs, cut)):
        found[rows] = series[rows, k]
    return LeftOut(points, found, tested if tested.sum() > 1 else np.ones_like(tested))


def _tells_as_much(fitted: Fit, without: FloatArray, of_effect: Sequence[int]) -> bool:
    """True where all but a fold tell as much of an effect as that does, beside what they tell of other parameters."""
    free = np.flatnonzero(~fitted.held)
    own = np.isin(free, of_effect)
    if not own.any():
        return True
    whole, left = (_beside_others(one[np.ix_(free, free)], own) for one in (fitted.expansion.information, without))
    found = scaled_eigen(whole)
    seen = found.values > _NOTHING * found.largest
    white = found.scale[:, np.newaxis] * found.vectors[:, seen] / np.sqrt(found.values[seen])
    return bool(np.linalg.eigvalsh(white.T @ left @ white).min(initial=1.0) >= 0.5)


def _beside_others(information: FloatArray, own: BoolArray) -> FloatArray:
    """The information of some coordinates with the others free, too: its Schur complement."""
    mixed = information[np.ix_(~own, own)]
    schur: FloatArray = information[np.ix_(own, own)] - mixed.T @ solve(information[np.ix_(~own, ~own)], mixed)
    return schur


def _told_elsewhere(fitted: Fit, without: FloatArray, of_effect: Sequence[int]) -> FloatArray:
    """Directions (n, kept) in which a fit moves when a fold is left out, by the information that is left then.

    Those of the effect, and of the other parameters those of which the fold tells less than all others together.
    """
    rows = np.flatnonzero(~fitted.held)
    own = np.array([row for row in rows if row in of_effect], dtype=np.intp)
    others = np.array([row for row in rows if row not in of_effect], dtype=np.intp)
    found = scaled_eigen(fitted.expansion.information[np.ix_(others, others)])
    seen = found.values > _NOTHING * found.largest
    white = found.scale[:, np.newaxis] * found.vectors[:, seen] / np.sqrt(found.values[seen])
    left, turned = np.linalg.eigh(white.T @ without[np.ix_(others, others)] @ white)
    kept = white @ turned[:, left > 0.5]
    directions = np.zeros((fitted.point.size, own.size + kept.shape[1]))
    directions[own, range(own.size)] = 1.0
    directions[others, own.size :] = kept
    return directions


def _towards_likelier(
    fitted: Fit, points: FloatArray, of_term: np.ndarray, zero: np.ndarray
) -> tuple[FloatArray, Terms]:
    """The points (n, folds) and what is seen there, steps cut that make what each was made for clearly less likely.

    Far from the optimum the step of a likelihood that is not quadratic may lead anywhere. What is ``zero`` stays so.
    """
    problem, terms = fitted.problem, fitted.expansion.terms
    assert terms is not None  # as above
    start = np.where(zero, 0.0, fitted.point[:, np.newaxis])
    least = _without(_repeated(terms, points.shape[1]), of_term)
    least = np.where(zero.any(axis=0), np.inf, least)  # without the effect it may be less likely
    points, seen = points.copy(), problem.terms(points)
    for share in _SHARES:
        worse = np.flatnonzero(~(_without(seen, of_term) <= least + _CLEARLY))
        if not worse.size:
            break
        points[:, worse] = (start + share * (points - start))[:, worse]
        again = problem.terms(points[:, worse]) if share or zero[:, worse].any() else _repeated(terms, worse.size)
        for name in ("innovations", "log_scales"):
            getattr(seen, name)[:, worse] = getattr(again, name)
    return points, seen


def _repeated(terms: Terms, count: int) -> Terms:
    """The terms at the point of an expansion, so many times."""
    return terms.members(np.zeros(count, dtype=np.intp))


def _without(terms: Terms, of_term: np.ndarray) -> FloatArray:
    """Negative log-likelihood of everything but each fold, shape (folds,), of the member made without it."""
    nll = 0.5 * terms.innovations**2 + terms.log_scales
    return np.array([float(nll[of_term != k, k].sum()) for k in range(nll.shape[1])])


def _ahead(
    base: Fit, refit: Fit, without: FloatArray, with_it: FloatArray, cut: Sequence[Fold]
) -> tuple[Compared, ...]:
    """Predictions of left-out folds over the horizon, without the effect and with it."""
    logs = refit.problem.logs
    seconds = horizon(refit, logs)
    infos = refit.problem.filter_model.model.outputs
    names = [info.name for info in infos]
    noise = refit.problem.batch(refit.point[:, np.newaxis]).noise_std[:, 0]
    pieces: dict[str, list[tuple[float, float, int]]] = {}
    for k, fold in enumerate(cut):
        own, before = logs[fold.log], base.problem.logs[fold.log]
        parts = [(a, b) for a, b in windows(own, seconds) if fold.first <= (a + b) // 2 <= fold.last]
        if not parts:
            continue
        needed = np.arange(own.time.size) <= parts[-1][1]
        own, before = own.rows(needed), before.rows(needed)
        shown = [
            _predicted(replace(base, point=without[:, k]), before, parts),
            _predicted(replace(refit, point=with_it[:, k]), own, parts),
        ]
        for row, name in enumerate(names):
            pieces.setdefault(name, []).extend(squares(own.y[row], [y[row] for y in shown], parts))
    found = []
    for row, info in enumerate(infos):
        told = np.array(pieces.get(info.name, []), dtype=np.float64).reshape(-1, 3)
        if told.size:
            columns = told[:, 0], told[:, 1], told[:, 2]
            found.append(Errors("left-out", "prediction", info.name, *columns, float(noise[row]), info))
    return tuple(judged(one, False, len(found)) for one in found)


def _predicted(fitted: Fit, log: MatchedLog, parts: Sequence[tuple[int, int]]) -> FloatArray:
    (run,) = fitted.runs([log])
    return predicted(fitted, log, run, parts)
