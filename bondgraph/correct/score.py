"""Score tests: how much the likelihood would gain by each candidate, from one linearisation and without refits.

With the whitened innovations z and log scales log s of the fitted model and their derivatives with respect to the free
parameters F and the candidates' coefficients, the score r_j of candidate j and its information d_j are

    r_j = -(g_j - I_jF I_FF^-1 g_F),      d_j = I_jj - I_jF I_FF^-1 I_Fj,

the free parameters projected out. r_j^2 / d_j is chi-square with one degree of freedom when nothing is missing, and
half of it is the gain in nats that a refit may expect; r_j / d_j is the coefficient it would find. Reference: Rao
(1948), Proc. Cambridge Phil. Soc. 44(1); Engle (1984), Handbook of Econometrics II, chapter 13.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from bondgraph.errors import EstimationError
from bondgraph.estimate.objective import Expansion, FloatArray

#: Information left of a candidate, free parameters projected out, below which nothing but rounding is left of it.
_LEFT = 1e-7


@dataclass(frozen=True)
class Scores:
    """Score statistics of several candidates, each array (candidates,).

    ``information`` is what the data tell of each coefficient beyond the free parameters, zero where these take all of
    its response; ``step`` the coefficient that a linear model would find, ``gain`` the likelihood gain in nats,
    ``correlation`` (candidates, candidates) how alike their responses are once the free parameters have taken their
    share, ``follow`` (free, candidates) how the free parameters move with each coefficient. ``p_value`` is the larger
    of that of the chi-square test and of one that holds under coloured noise too, not yet corrected for the number of
    candidates.
    """

    score: FloatArray
    information: FloatArray
    step: FloatArray
    gain: FloatArray
    correlation: FloatArray
    follow: FloatArray
    p_value: FloatArray


def scores(expansion: Expansion, free: int, one_sided: np.ndarray, blocks: np.ndarray | None = None) -> Scores:
    """Score tests of the coordinates after the first ``free`` ones.

    Parameters
    ----------
    expansion
        Gradient and information of a problem in the free parameters, then the candidates' coefficients, at the fit.
    free
        How many coordinates are free parameters.
    one_sided
        Which candidates may only be positive, shape (candidates,); a negative score gains nothing there.
    blocks
        Block of time of each term, shape (n_terms,), as for :func:`robust_variance`; None: innovations are taken as
        independent.

    Examples
    --------
    >>> import numpy as np
    >>> X = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 3.0]])
    >>> z = np.array([0.0, 1.0, 2.0, 3.0]) - 1.5            # a straight line, of which only the mean was fitted
    >>> expansion = Expansion(-X.T @ z, X.T @ X, 1)
    >>> scores(expansion, 1, np.array([True])).step.round(6).tolist()
    [1.0]
    """
    information, gradient = expansion.information, expansion.gradient
    inner, outer = slice(0, free), slice(free, gradient.size)
    share = _solve(information[inner, inner], information[inner, outer])
    score = -(gradient[outer] - share.T @ gradient[inner])
    left = information[outer, outer] - information[outer, inner] @ share
    own = np.diag(information[outer, outer])
    projected = np.maximum(np.diag(left), 0.0)
    seen = projected > _LEFT * np.maximum(own, np.finfo(float).tiny)
    projected = np.where(seen, projected, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.where(seen, score / projected, 0.0)
        gain = np.where(seen, 0.5 * score**2 / projected, 0.0)
        scale = np.sqrt(np.outer(projected, projected))
        correlation = np.where(np.outer(seen, seen), left / scale, 0.0)
    gain = np.where(one_sided & (score < 0.0), 0.0, gain)
    p_value = stats.chi2.sf(2.0 * gain, 1)
    if blocks is not None:
        p_value = np.maximum(p_value, _robust_p_value(expansion, share, score, blocks))
    return Scores(score, projected, step, gain, correlation, -share, np.where(gain > 0.0, p_value, 1.0))


def _robust_p_value(expansion: Expansion, share: FloatArray, score: FloatArray, blocks: np.ndarray) -> FloatArray:
    """Two-sided p-values of the projected scores with the scatter of their sums over blocks of time."""
    sums = _block_sums(expansion, blocks)
    free = share.shape[0]
    own = sums[:, free:] - sums[:, :free] @ share
    count = own.shape[0]
    scatter = np.sum((own - own.mean(axis=0)) ** 2, axis=0) * count / max(count - 1, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(scatter > 0.0, np.abs(score) / np.sqrt(scatter), 0.0)
    p_value: FloatArray = 2.0 * stats.t.sf(distance, max(count - 1, 1))
    return p_value


def _block_sums(expansion: Expansion, blocks: np.ndarray) -> FloatArray:
    """The gradient's pieces summed over each block of time, shape (blocks, n)."""
    if expansion.terms is None:
        raise EstimationError("a variance that holds under coloured noise needs the terms of the expansion")
    z, slopes_z = expansion.terms.innovations[:, 0], expansion.terms.innovations[:, 1:]
    pieces = slopes_z * z[:, np.newaxis] + expansion.terms.log_scales[:, 1:]
    inside = blocks >= 0
    sums = np.zeros((int(blocks.max()) + 1, pieces.shape[1]))
    np.add.at(sums, blocks[inside], pieces[inside])
    return sums


def robust_variance(terms: Expansion, blocks: np.ndarray) -> FloatArray:
    """Covariance of the estimate by the block sandwich, shape (n, n).

    Sums of the score over blocks of time are nearly independent even where neighbouring innovations are not, so their
    scatter gives an honest variance under coloured noise. Reference: White (1982), Econometrica 50(1); Newey and West
    (1987), Econometrica 55(3), for dependent data.

    Parameters
    ----------
    terms
        Expansion at the fit, with its terms.
    blocks
        Block of each term, shape (n_terms,), -1 for terms without a time (priors).
    """
    sums = _block_sums(terms, blocks)
    count = sums.shape[0]
    sums -= sums.mean(axis=0)
    meat = sums.T @ sums * (count / max(count - 1, 1))
    bread = _solve(terms.information, np.eye(terms.information.shape[0]))
    variance: FloatArray = bread @ meat @ bread
    return variance


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a symmetric system in scaled coordinates, directions without information left out."""
    if matrix.size == 0:
        return np.zeros((0, right.shape[1]))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(scale[:, np.newaxis] * matrix * scale)
    kept = values > 1e-10 * values.max()
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    solution: FloatArray = scale[:, np.newaxis] * (inverse @ (scale[:, np.newaxis] * right))
    return solution
