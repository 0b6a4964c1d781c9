"""Score tests: how much the likelihood would gain by each candidate, from one linearisation and without refits.

With the whitened innovations z and log scales log s of the fitted model and their derivatives with respect to the free
parameters F and the coefficients J of a candidate, its score r and information D are

    r = -(g_J - I_JF I_FF^-1 g_F),      D = I_JJ - I_JF I_FF^-1 I_FJ,

the free parameters projected out. r' D^-1 r is chi-square with as many degrees of freedom as it has coefficients when
nothing is missing, and half of it is the gain in nats that a refit may expect; D^-1 r are the coefficients it would
find. Reference: Rao (1948), Proc. Cambridge Phil. Soc. 44(1); Engle (1984), Handbook of Econometrics II, chapter 13.

Neighbouring innovations are not independent under coloured noise, nor Gaussian in practice. Sums of the score over
blocks of time are nearly both, so every p-value is the larger of that of the chi-square and of Hotelling's statistic
with the scatter of these sums: White (1982), Econometrica 50(1); Hotelling (1931), Ann. Math. Statist. 2(3). With many
coefficients the statistic is deflated instead, see :func:`rao_scott`. The scatter is that at the estimated step, not at
zero: what is missing is no noise, and an effect that acts now and then would widen the scatter by which it is judged.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from bondgraph.correct.constants import CHANCE
from bondgraph.correct.fits.times import Times
from bondgraph.errors import EstimationError
from bondgraph.estimate.objective import Expansion, FloatArray
from bondgraph.estimate.symmetric import scaled_eigen

#: Information left of a candidate, free parameters projected out, below which nothing but rounding is left of it.
LEFT = 1e-7
#: Two candidates' coefficients more alike than this are one but for rounding.
_SINGULAR = 1e-9
#: Responses (or signals) whose correlation is larger than this are one and the same but for rounding.
SAME = 1.0 - 1e-6
#: Up to so many coefficients blocks of time determine their covariance.
_FEW = 3


@dataclass(frozen=True)
class Scores:
    """Score statistics of several candidates, each array (candidates,) unless said.

    ``information`` is what the data tell of the candidate's leading coefficient beyond the free parameters, zero where
    these take all of its response; ``steps`` the coefficients that a linear model would find, one array per candidate;
    ``gain`` the likelihood gain in nats; ``correlation`` (candidates, candidates) how alike their responses are once
    the free parameters have taken their share; ``follow`` (free, candidates) how the free parameters move with the
    step, per unit of the leading coefficient. ``p_value`` is the larger of that of the chi-square test and of one that
    holds under coloured noise too, not yet corrected for the number of candidates.
    """

    information: FloatArray
    steps: tuple[FloatArray, ...]
    gain: FloatArray
    correlation: FloatArray
    follow: FloatArray
    p_value: FloatArray

    @property
    def step(self) -> FloatArray:
        """The leading coefficient of each candidate."""
        return np.array([step[0] for step in self.steps])

    def follows(self, index: int) -> FloatArray:
        """How the free parameters move when a candidate makes its whole step, shape (free,)."""
        moved: FloatArray = self.follow[:, index] * (self.steps[index][0] or float(len(self.steps[index]) > 1))
        return moved


@dataclass(frozen=True)
class Projected:
    """Scores (n,) and information (n, n) of all coefficients with the free parameters taken out.

    ``share`` (free, n) is how these follow, ``seen`` (n,) which coefficients leave more than rounding;
    ``expansion`` and ``times`` are what they were made of, no times where innovations are taken as independent.
    """

    score: FloatArray
    information: FloatArray
    share: FloatArray
    seen: np.ndarray
    expansion: Expansion
    times: Times | None = None

    def sums(self, own: Sequence[int], step: FloatArray) -> FloatArray:
        """Scores of some coefficients at ``step`` over blocks of time, shape (blocks, own), see :meth:`Times.sums`.

        Raises
        ------
        EstimationError
            If the expansion has no terms, or their times are not known.
        """
        if self.expansion.terms is None or self.times is None:
            raise EstimationError("a variance that holds under coloured noise needs the terms of the expansion")
        terms, share = self.expansion.terms, self.share[:, own]
        columns = [1 + self.share.shape[0] + k for k in own]
        slopes, scales = self._free
        left = terms.innovations[:, columns] + slopes @ share
        loud = terms.log_scales[:, columns] + scales @ share
        pieces = left * (terms.innovations[:, 0] + left @ step)[:, np.newaxis] + loud
        return self.times.sums(self.times.series(-pieces))

    @functools.cached_property
    def _free(self) -> tuple[FloatArray, FloatArray]:
        """Derivatives of innovations and log scales by the free parameters, in rows of their own: asked for often."""
        terms, free = self.expansion.terms, self.share.shape[0]
        if terms is None:
            return np.empty((0, free)), np.empty((0, free))
        columns = slice(1, 1 + free)
        return np.ascontiguousarray(terms.innovations[:, columns]), np.ascontiguousarray(terms.log_scales[:, columns])


def project(expansion: Expansion, free: int, times: Times | None = None) -> Projected:
    """Take the first ``free`` coordinates out of the scores of the others.

    Parameters
    ----------
    expansion
        Gradient and information of a problem in the free parameters, then the candidates' coefficients, at the fit.
    free
        How many coordinates are free parameters.
    times
        Times of the terms, for tests that hold under coloured noise.
    """
    information, gradient = expansion.information, expansion.gradient
    inner, outer = slice(0, free), slice(free, gradient.size)
    share = solve(information[inner, inner], information[inner, outer])
    score = -(gradient[outer] - share.T @ gradient[inner])
    left = information[outer, outer] - information[outer, inner] @ share
    own = np.maximum(np.diag(information[outer, outer]), np.finfo(float).tiny)
    return Projected(score, left, -share, np.diag(left) > LEFT * own, expansion, times)


def scores(
    expansion: Expansion,
    free: int,
    one_sided: np.ndarray,
    times: Times | None = None,
    sizes: Sequence[int] | None = None,
) -> Scores:
    """Score tests of the coordinates after the first ``free`` ones.

    Parameters
    ----------
    expansion, free, times
        As for :func:`project`; without times innovations are taken as independent.
    one_sided
        Which coefficients may only be positive, shape (coefficients,); a negative score gains nothing there.
    sizes
        How many neighbouring coefficients belong to each candidate; None: one each.

    Examples
    --------
    >>> import numpy as np
    >>> X = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 3.0]])
    >>> z = np.array([0.0, 1.0, 2.0, 3.0]) - 1.5            # a straight line, of which only the mean was fitted
    >>> expansion = Expansion(-X.T @ z, X.T @ X, 1)
    >>> scores(expansion, 1, np.array([True])).step.round(6).tolist()
    [1.0]
    """
    found = project(expansion, free, times)
    sizes = [1] * one_sided.size if sizes is None else sizes
    edges = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    steps, gain, p_value = [], np.zeros(len(sizes)), np.ones(len(sizes))
    mixed = np.zeros((one_sided.size, len(sizes)))
    for j, (first, end) in enumerate(itertools.pairwise(edges)):
        own = list(range(first, end))
        step, gain[j], p_value[j] = best_step(found, own, one_sided[first:end])
        steps.append(step)
        mixed[own, j] = step if len(own) > 1 and np.any(step) else np.eye(len(own))[0]
    left = mixed.T @ found.information @ mixed
    size = np.sqrt(np.maximum(np.diag(left), 0.0))
    seen = np.array([found.seen[first:end].any() for first, end in itertools.pairwise(edges)], dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = np.where(np.outer(seen, seen), left / np.outer(size, size), 0.0)
    leading = edges[:-1]
    told = np.where(found.seen[leading], np.maximum(np.diag(found.information)[leading], 0.0), 0.0)
    unit = np.where(mixed[leading, np.arange(len(sizes))] == 0.0, 1.0, mixed[leading, np.arange(len(sizes))])
    return Scores(told, tuple(steps), gain, correlation, found.share @ (mixed / unit), p_value)


def best_step(found: Projected, own: Sequence[int], one_sided: np.ndarray) -> tuple[FloatArray, float, float]:
    """Step (k,), gain in nats and p-value of one candidate with the coefficients ``own``.

    Where coefficients may only be positive, the best point of the quadratic inside is taken; its p-value is that of as
    many degrees of freedom as there are coefficients, which is on the safe side. It is the larger of those of white and
    of coloured innovations, unless the first already is that of chance.
    """
    score, information = found.score[own], found.information[np.ix_(own, own)]
    step, gain = np.zeros(len(own)), 0.0
    usable = [k for k in range(len(own)) if found.seen[own[k]]]
    for count in range(len(usable), 0, -1):
        for chosen in map(list, itertools.combinations(usable, count) if one_sided.any() else [usable]):
            trial = solve(information[np.ix_(chosen, chosen)], score[chosen][:, np.newaxis])[:, 0]
            if np.any(trial[one_sided[chosen]] < 0.0):
                continue
            own_gain = 0.5 * float(score[chosen] @ trial)
            if own_gain > gain:
                step, gain = np.zeros(len(own)), own_gain
                step[chosen] = trial
        if gain > 0.0 or not one_sided.any():
            break
    if gain <= 0.0:
        return step, 0.0, 1.0
    moved = [k for k in range(len(own)) if step[k] != 0.0]
    p_value = float(stats.chi2.sf(2.0 * gain, len(usable)))
    if found.times is not None and p_value < CHANCE:
        rows = [own[k] for k in moved]
        sums = found.sums(rows, step[moved])
        if len(rows) > _FEW:
            p_value = max(p_value, rao_scott(2.0 * gain, found.information[np.ix_(rows, rows)], sums))
        else:
            p_value = max(p_value, hotelling(found.score[rows], sums))
    return step, gain, p_value


def hotelling(score: FloatArray, sums: FloatArray) -> float:
    """P-value of scores (k,) being zero, given their sums over blocks (blocks, k): Hotelling's T-squared."""
    count, size = sums.shape
    if count <= size + 1:
        return 1.0
    scatter = np.atleast_2d(np.cov(sums, rowvar=False)) * count
    distance = float(score @ solve(scatter, score[:, np.newaxis])[:, 0])
    return float(stats.f.sf(distance * (count - size) / (size * (count - 1)), size, count - size))


def rao_scott(statistic: float, information: FloatArray, sums: FloatArray) -> float:
    """P-value of a score statistic with many degrees of freedom, deflated by how much the scores scatter too much.

    Hotelling's statistic inverts a covariance that few blocks do not determine. The mean inflation, the trace of the
    scatter over the information, is known well from them; taken two by two, so that slow colour is seen. Reference: Rao
    and Scott (1981), J. American Statistical Association 76(374).
    """
    pairs = np.add.reduceat(sums, np.arange(0, sums.shape[0], 2), axis=0)
    count, size = pairs.shape
    scatter = np.atleast_2d(np.cov(pairs, rowvar=False)) * count
    inflation = max(1.0, float(np.trace(solve(information, scatter))) / size)
    return float(stats.f.sf(statistic / (size * inflation), size, count - 1))


def score_pieces(expansion: Expansion) -> FloatArray:
    """The gradient's pieces, shape (n_terms, n).

    Raises
    ------
    EstimationError
        If the expansion has no terms.
    """
    if expansion.terms is None:
        raise EstimationError("a variance that holds under coloured noise needs the terms of the expansion")
    pieces: FloatArray = (
        expansion.terms.innovations[:, 1:] * expansion.terms.innovations[:, :1] + expansion.terms.log_scales[:, 1:]
    )
    return pieces


def robust_variance(terms: Expansion, times: Times) -> FloatArray:
    """Covariance of the estimate by the block sandwich, shape (n, n).

    Each sample moves the estimate by the inverse information times its share of the score. The scatter of these over
    blocks of time, see :meth:`bondgraph.correct.fits.times.Times.sums`, gives an honest variance under coloured noise.
    Reference: White (1982), Econometrica 50(1); Newey and West (1987), Econometrica 55(3), for dependent data.

    Parameters
    ----------
    terms
        Expansion at the fit, with its terms.
    times
        Times of the terms.
    """
    bread = solve(terms.information, np.eye(terms.information.shape[0]))
    sums = times.sums(times.series(score_pieces(terms)) @ bread)
    count = sums.shape[0]
    sums -= sums.mean(axis=0)
    variance: FloatArray = sums.T @ sums * (count / max(count - 1, 1))
    return variance


def solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a symmetric system in scaled coordinates; coordinates and directions without information get zero."""
    if matrix.size == 0:
        return np.zeros((0, right.shape[1]))
    found = scaled_eigen(matrix)
    inverse = found.inverse(found.values > max(_SINGULAR * found.largest, 0.0))
    known = np.where((found.scale > 0.0)[:, np.newaxis], right, 0.0)  # else nothing times what is not finite
    solution: FloatArray = found.scale[:, np.newaxis] * (inverse @ (found.scale[:, np.newaxis] * known))
    return solution
