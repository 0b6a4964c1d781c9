"""Second derivatives of a likelihood, from its exact gradient, with an error that is measured.

The compiled filter has no second tangents. Instead the exact gradient is differenced, at two step lengths along every
coordinate. Their combination is of fourth order (Richardson 1911; Abramowitz and Stegun 1964, 25.3.21 once integrated),
and two things tell how good it is: what the shorter step alone would have given, and how far the matrix is from
symmetric, which no formula here enforces.

:func:`exact_hessian` has second derivatives without differences, in numpy and a few tens of times slower.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bondgraph.errors import EstimationError, require_kind
from bondgraph.estimate.derivatives.exact import exact_derivatives
from bondgraph.estimate.joint import JointProblem, Problem
from bondgraph.estimate.likelihoods import Batch, FilterLikelihood
from bondgraph.estimate.objective import Expand, FloatArray, fitted_expansion
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.filter.choice import choose_method
from bondgraph.filter.curvature import Curvature, MovingMember, curvature
from bondgraph.filter.second_order import Jet
from bondgraph.text import inflected

#: Shorter of both steps, in standard deviations of a coordinate given the others. A gradient is right to about 1e-9 of
#: a nat per standard deviation, so rounding leaves 1e-8, and the fourth order as much of a likelihood of 100 samples.
_STEP = 0.05
#: Exact slopes of what takes no filter are differenced over this: a cube root of rounding, best for that.
#: Press et al. (2007), Numerical Recipes, section 5.7.
_START_STEP = 6e-6
#: Relative difference up to which two values of a likelihood are the same.
_SAME = 1e-7


@dataclass(frozen=True)
class Hessian:
    """Second derivatives of a negative log-likelihood in the coordinates of its problem.

    Parameters
    ----------
    names
        Free parameters.
    matrix
        Shape (n, n), symmetric; NaN in rows and columns of coordinates that rest on a bound.
    error
        Half of the asymmetry before both halves were averaged, or a fifteenth of the difference to the second order if
        that is more, shape (n, n).
    information
        Fisher information there, shape (n, n), to compare.
    evaluations
        Evaluations that it took.
    """

    names: tuple[str, ...]
    matrix: FloatArray
    error: FloatArray
    information: FloatArray
    evaluations: int

    @property
    def relative_error(self) -> float:
        """Largest error with every coordinate in units of its standard deviation given the others."""
        scale = 1.0 / np.sqrt(np.diag(self.information))
        return float(np.nanmax(self.error * np.outer(scale, scale)))


def exact_hessian(problem: Problem, point: FloatArray | None = None) -> Hessian:
    """Second derivatives of the negative log-likelihood of a problem, forward over the tangents of its filters.

    They cost some milliseconds for each integration step, see :mod:`bondgraph.filter.curvature`. ``error`` is half of
    the asymmetry, which is rounding. Where logs begin, what is tied and what priors say takes no filter: its second
    derivatives are central differences of exact first ones.

    Parameters
    ----------
    problem
        Free parameters and logs, whose likelihood is that of the filter; correlations are not free.
    point
        Coordinates, shape (n,); None: where searches start. It may rest on bounds.

    Raises
    ------
    EstimationError
        If the problem is another one, or the filter fails there.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> time = np.arange(60) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 60)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> problem = bg.pose(swing, log, ["length", "damping"])
    >>> exact, differenced = exact_hessian(problem), hessian(problem)
    >>> exact.relative_error < 1e-10, bool((np.abs(exact.matrix - differenced.matrix) <= 2 * differenced.error).all())
    (True, True)
    """
    where = _at(problem, point)
    for part in problem.parts:
        _require_exact(part)
    known = fitted_expansion(problem, where, exact_derivatives)
    own, total = float(problem.prior_values(where[:, np.newaxis])[0]), _prior_curvature(problem, where)
    for part, rows in zip(problem.parts, problem.rows, strict=True):
        found = _curvatures(part, where[rows])
        own += sum(one.nll for one in found)
        total[np.ix_(rows, rows)] += np.sum([one.hessian for one in found], axis=0)
    value = float(problem.nll(where[:, np.newaxis])[0])
    if not (known.is_finite and abs(own - value) <= _SAME * (1.0 + abs(value))):
        raise EstimationError(
            f"{problem.name}: no second derivatives at this point, where the filter fails or multiplies rounding - "
            "start nearer to plausible values, or use more substeps",
            where=(problem.name,),
        )
    asymmetry = 0.5 * np.abs(total - total.T)
    return Hessian(problem.names, 0.5 * (total + total.T), asymmetry, known.information, known.evaluations + 1)


def _at(problem: Problem, point: FloatArray | None) -> FloatArray:
    """The point, checked."""
    require_kind("hessian", problem, (EstimationProblem, JointProblem), "posed problem")
    where = problem.start if point is None else np.asarray(point, dtype=np.float64)
    if where.shape != problem.start.shape:
        raise EstimationError(
            f"{problem.name}: second derivatives at a point of shape {where.shape} - give a coordinate for each of "
            f"{', '.join(problem.names)}",
            where=("point",),
        )
    return where


def _require_exact(problem: EstimationProblem) -> None:
    """Refuse what has no exact second derivatives."""
    free = {parameter.target.kind for parameter in problem.free}
    wrong = next(
        (
            what
            for what, holds in (
                ("another likelihood than the filter's", not isinstance(problem.likelihood, FilterLikelihood)),
                ("free correlations", not free <= {"parameter", "std", "process", "x0", "x0_std"}),
            )
            if holds
        ),
        None,
    )
    if wrong is not None:
        raise EstimationError(
            f"{problem.name}: there are no exact second derivatives with {wrong} - take hessian, which differences "
            "exact gradients",
            where=(problem.name, wrong),
        )


def _curvatures(problem: EstimationProblem, point: FloatArray) -> list[Curvature]:
    """Curvature of the likelihood of each log at a point (n,)."""
    filter_model = choose_method(problem.filter_model, problem.logs)
    return [curvature(filter_model, *each) for each in zip(problem.logs, _moving(problem, point), strict=True)]


def _moving(problem: EstimationProblem, point: FloatArray) -> list[MovingMember]:
    """The numbers of each log with their derivatives by the coordinates at a point (n,)."""
    here, moved = _numbers(problem.batch(point[:, np.newaxis])), _numbers(problem.batch_slopes(point))
    if problem.ties:
        bent = _slopes_of(lambda at: _numbers(problem.batch_slopes(at)), point)
    else:
        values = list(map(float, problem.values(point)))
        # every other number moves with one coordinate at most, so that it bends with that coordinate as the value does
        bends = np.array([one.bend(v) / one.slope(v) for one, v in zip(problem.free, values, strict=True)])
        bent = [(slopes * bends)[..., np.newaxis] * np.eye(point.size) for slopes in moved]
    if problem.beginnings.move:
        bent[_LEVELS:] = _slopes_of(lambda at: _numbers(problem.batch_slopes(at))[_LEVELS:], point)
    jets = [Jet(v[:, 0], d, h) for v, d, h in zip(here, moved, bent, strict=True)]
    theta, process, noise, width, *starts = jets
    return [MovingMember(theta, start, width, process, noise) for start in starts]


def _numbers(batch: Batch) -> list[FloatArray]:
    """Parameters and levels, then how uncertain the beginnings of logs are, and where each begins."""
    return [batch.theta, batch.process_std, batch.noise_std, batch.initial_std, *batch.x0]


#: How many groups of :func:`_numbers` stand before the beginnings of logs.
_LEVELS = 3


def _slopes_of(slopes: Callable[[FloatArray], list[FloatArray]], point: FloatArray) -> list[FloatArray]:
    """Second derivatives (rows, n, n) of groups of numbers: central differences of their exact first ones (rows, n)."""
    found = [np.zeros((*one.shape, point.size)) for one in slopes(point)]
    for k in range(point.size):
        away = np.zeros(point.size)
        away[k] = _START_STEP * max(1.0, abs(float(point[k])))
        for own, ahead, behind in zip(found, slopes(point + away), slopes(point - away), strict=True):
            own[:, :, k] = (ahead - behind) / (2.0 * away[k])
    return [0.5 * (own + own.transpose(0, 2, 1)) for own in found]


def _prior_curvature(problem: Problem, point: FloatArray) -> FloatArray:
    """Second derivatives (n, n) of half the squares of the terms of the priors."""
    slopes, terms = problem.prior_slopes(point), problem.prior_terms(point[:, np.newaxis])[:, 0]
    found: FloatArray = np.einsum("ta,tb->ab", slopes, slopes)
    if terms.size:
        (bent,) = _slopes_of(lambda at: [problem.prior_slopes(at)], point)
        found = found + np.einsum("t,tab->ab", terms, bent)
    return found


def hessian(problem: Problem, point: FloatArray | None = None, jacobian: Expand = exact_derivatives) -> Hessian:
    """Second derivatives of the negative log-likelihood of a problem.

    Parameters
    ----------
    problem
        Free parameters and logs.
    point
        Coordinates, shape (n,); None: where searches start.
    jacobian
        Gives the gradient; by default the exact one of the filter.

    Raises
    ------
    EstimationError
        If the gradient is not finite there, the data say nothing about a coordinate, or all of them rest on bounds.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> time = np.arange(60) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 60)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> found = hessian(bg.pose(swing, log, ["length", "damping"]))
    >>> found.matrix.shape, found.relative_error < 1e-5
    ((2, 2), True)
    """
    where = _at(problem, point)
    expansion = fitted_expansion(problem, where, jacobian)
    information = np.diag(expansion.information)
    if not (np.isfinite(information).all() and (information > 0.0).all()):
        silent = [name for name, told in zip(problem.names, information, strict=True) if not told > 0.0]
        raise EstimationError(
            f"{problem.name}: no second derivatives at this point, the data say nothing about"
            f" {', '.join(silent)} - fix {inflected(silent, 'it', 'these')}, or start where the model does not diverge",
            where=tuple(silent),
        )
    room = np.minimum(where - problem.lower, problem.upper - where)
    steps = np.minimum(_STEP / np.sqrt(information), 0.4 * room)
    free = np.flatnonzero(steps > 1e-4 * _STEP / np.sqrt(information))
    if not free.size:
        raise EstimationError(
            f"{problem.name}: every coordinate rests on a bound, so no second derivatives exist"
            " - widen the bounds, or take a point inside",
            where=problem.names,
        )
    slopes, spent = _gradient_slopes(problem, where, steps, free, jacobian)
    short, long = slopes
    best = (4.0 * short - long) / 3.0
    size = where.size
    matrix, error = np.full((size, size), np.nan), np.full((size, size), np.nan)
    block = np.ix_(free, free)
    matrix[block] = 0.5 * (best + best.T)
    error[block] = np.maximum(0.5 * np.abs(best - best.T), np.abs(best - short) / 15.0)
    return Hessian(problem.names, matrix, error, expansion.information, expansion.evaluations + spent)


def _gradient_slopes(
    problem: Problem, point: FloatArray, steps: FloatArray, free: np.ndarray, jacobian: Expand
) -> tuple[tuple[FloatArray, FloatArray], int]:
    """Central differences of the gradient by the free coordinates, over one step and over two, each (m, m)."""
    shares = np.array([1.0, -1.0, 2.0, -2.0])
    points = np.repeat(point[:, np.newaxis], 4 * free.size, axis=1)
    for k, row in enumerate(free):
        points[row, 4 * k : 4 * k + 4] += shares * steps[row]
    widths = np.repeat(0.1 * np.maximum(steps, 1e-300)[:, np.newaxis], points.shape[1], axis=1)
    found = jacobian(problem, points, widths)
    gradients = np.array([one.gradient[free] for one in found]).reshape(free.size, 4, free.size)
    if not np.isfinite(gradients).all():
        raise EstimationError(
            f"{problem.name}: the gradient is not finite around this point"
            " - use more substeps, or start nearer to plausible values",
            where=problem.names,
        )
    lengths = steps[free][:, np.newaxis]
    short = (gradients[:, 0] - gradients[:, 1]) / (2.0 * lengths)
    long = (gradients[:, 2] - gradients[:, 3]) / (4.0 * lengths)
    return (short.T, long.T), sum(one.evaluations for one in found)
