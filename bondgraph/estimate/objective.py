"""What the searches minimise: a negative log-likelihood over a box of coordinates, many points at once.

A Gaussian likelihood factorises over its scalar measurements, each given all before it: with the innovation e_i, its
standard deviation s_i and z_i = e_i / s_i,

    nll = sum_i ( z_i^2 / 2 + log s_i + log(2 pi) / 2 ).

So its exact gradient, and the Fisher information by which a scoring step is scaled, need nothing but the derivatives of
z and of log s:

    gradient    = sum_i ( z_i dz_i + dlog s_i )
    information = sum_i ( (dz_i + z_i dlog s_i)' (dz_i + z_i dlog s_i) + 2 dlog s_i' dlog s_i ),

where dz_i + z_i dlog s_i is the derivative of the innovation itself over its standard deviation. Least squares are the
case s_i = 1. Reference: Gupta and Mehra (1974), Computational aspects of maximum likelihood estimation and reduction in
sensitivity function calculations, IEEE Trans. Automatic Control 19(6).
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from bondgraph.compile.machine_code import has_numba, load_kernel
from bondgraph.estimate import products_kernel
from bondgraph.execute.threads import available_cores, in_threads

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

#: From so many products on compiled code sums them; of fewer it saves nothing.
_MANY_PRODUCTS = 1_000_000


class SearchOutcome(enum.Enum):
    """How a search ended; the value is the message."""

    CONVERGED = "converged: no step promises a better likelihood"
    STALLED = "stopped: the likelihood did not improve for the number of iterations given as patience"
    ITERATION_LIMIT = "stopped at the limit of iterations - raise it, or resume, if the trace still falls"
    INTERRUPTED = "interrupted: this is the best point so far - continue with resume"
    NO_PROGRESS = (
        "stopped: no step along the gradient improves the likelihood, which is not smooth here"
        " - use more substeps, smooth the kinks of the model, or narrow the bounds"
    )
    JOINED = "ended: a better start is or has been here"
    GIVEN_UP = "given up: too far behind a better start"
    NO_DERIVATIVES = (
        "stopped: the derivatives of the likelihood are not finite here"
        " - use more substeps, smooth the kinks of the model, or narrow the bounds"
    )
    ILL_CONDITIONED = (
        "stopped where rounding moves the likelihood: its differences to other points mean nothing"
        " - use more substeps, or method 'auto', which plans them"
    )
    NO_FINITE_POINT = (
        "failed: the likelihood has a finite value at no point tried"
        " - declare values near which the model follows the logs, narrow the bounds, or use more substeps"
    )

    @property
    def succeeded(self) -> bool:
        """Whether the point returned is an optimum as far as the search can tell."""
        return self in (SearchOutcome.CONVERGED, SearchOutcome.STALLED)


@dataclass(frozen=True)
class Terms:
    """Scalar terms of a likelihood at several points.

    ``innovations`` are the z_i and ``log_scales`` the log s_i, both (n_terms, members); zero where nothing was
    measured, NaN in the column of a member that failed.
    """

    innovations: FloatArray
    log_scales: FloatArray

    def members(self, columns: npt.NDArray[np.intp]) -> Terms:
        """The terms of some members."""
        return Terms(self.innovations[:, columns], self.log_scales[:, columns])

    def sums(self) -> FloatArray:
        """Values of the likelihood but for its constant, shape (members,); infinite where a member failed."""
        with np.errstate(over="ignore", invalid="ignore"):
            sums: FloatArray = 0.5 * (self.innovations**2).sum(axis=0) + self.log_scales.sum(axis=0)
        return np.where(np.isfinite(sums), sums, np.inf)


class Objective(Protocol):
    """A negative log-likelihood over a box; ``lower`` equal to ``upper`` holds a coordinate fixed."""

    @property
    def lower(self) -> FloatArray:
        """Lower bounds, shape (n,)."""

    @property
    def upper(self) -> FloatArray:
        """Upper bounds, shape (n,)."""

    def nll(self, points: FloatArray) -> FloatArray:
        """Values at points (n, members), shape (members,); infinite where the model fails."""

    def terms(self, points: FloatArray) -> Terms:
        """Scalar terms at points (n, members)."""


@dataclass(frozen=True)
class Below:
    """Values that matter below a ceiling only, each (members,).

    ``nll`` is infinite where the model fails and where a member was given up, because its value is certain to exceed
    its ceiling: ``abandoned``. ``share`` is the part of an evaluation that each took.
    """

    nll: FloatArray
    abandoned: BoolArray
    share: FloatArray

    @classmethod
    def whole(cls, nll: FloatArray) -> Below:
        """Evaluations that nobody cut short."""
        return cls(nll, np.zeros(nll.shape, dtype=np.bool_), np.ones(nll.shape))


@runtime_checkable
class CeilingObjective(Protocol):
    """An objective that can give up members which cannot come below a ceiling, without a change of the others."""

    def nll_below(self, points: FloatArray, ceilings: FloatArray) -> Below:
        """Values at points (n, members) as far as they are below ceilings (members,)."""


def nll_below(objective: Objective, points: FloatArray, ceilings: FloatArray) -> Below:
    """Values at points (n, members) as far as they are below ceilings (members,); all of them where that saves nothing.

    Examples
    --------
    >>> class Line:
    ...     lower, upper = np.array([-10.0]), np.array([10.0])
    ...     def nll(self, points):
    ...         return points[0]
    >>> nll_below(Line(), np.array([[1.0, 2.0]]), np.array([0.0, 5.0])).nll.tolist()
    [1.0, 2.0]
    """
    if isinstance(objective, CeilingObjective):
        return objective.nll_below(points, ceilings)
    return Below.whole(objective.nll(points))


@dataclass(frozen=True)
class Expansion:
    """Gradient (n,) and Fisher information (n, n) of an objective at one point, and the evaluations they took.

    ``terms``, if known, holds the terms there in its first column and their derivatives in n more; with them a search
    can correct its steps for the curvature of the model.
    """

    gradient: FloatArray
    information: FloatArray
    evaluations: int
    terms: Terms | None = None

    @property
    def is_finite(self) -> bool:
        """Whether gradient and information are numbers that a step can be made of."""
        return bool(np.isfinite(self.gradient).all() and np.isfinite(self.information).all())

    @property
    def sum(self) -> float:
        """The likelihood there but for its constant; NaN where the terms are not known."""
        return float(self.terms.members(np.array([0])).sums()[0]) if self.terms is not None else float("nan")

    def around(self, seen: Terms) -> Expansion:
        """The expansion around other terms (n_terms, 1), of a point or a filter close by, with the same derivatives.

        A whitened innovation is z = e/s, so dz = de/s - z dlog s: kept are de/s and dlog s, and z is the one that is
        seen. The derivatives must be known.
        """
        assert self.terms is not None  # whoever asks has formed them
        known_z, known_s = self.terms.innovations, self.terms.log_scales
        errors = known_z[:, 1:] + known_z[:, :1] * known_s[:, 1:]
        slopes = errors - seen.innovations * known_s[:, 1:]
        return expansion_of(
            np.hstack([seen.innovations, slopes]), np.hstack([seen.log_scales, known_s[:, 1:]]), self.evaluations
        )


#: Expansions of an objective at points (n, members) with difference steps (n, members).
Expand = Callable[[Objective, FloatArray, FloatArray], tuple[Expansion, ...]]


@dataclass(frozen=True)
class TraceRow:
    """State of a search after an iteration."""

    stage: str
    iteration: int
    evaluations: int
    nll: float
    point: tuple[float, ...]


#: Called after every iteration.
Progress = Callable[[TraceRow], None]


def silent(row: TraceRow) -> None:
    """Report nothing."""


def fitted_expansion(objective: Objective, point: FloatArray, jacobian: Expand) -> Expansion:
    """Expansion at a point (n,) of which nothing is known: a coarse one chooses the steps of the second.

    Steps are a tenth of each coordinate's standard deviation given the others.
    """
    coarse = 1e-4 * (objective.upper - objective.lower)[:, np.newaxis]
    (first,) = jacobian(objective, point[:, np.newaxis], coarse)
    told = np.maximum(np.nan_to_num(np.diag(first.information)), 1e-300)[:, np.newaxis]
    (second,) = jacobian(objective, point[:, np.newaxis], np.clip(0.1 / np.sqrt(told), 1e-5 * coarse, coarse))
    return replace(second, evaluations=first.evaluations + second.evaluations)


def expansion_of(innovations: FloatArray, log_scales: FloatArray, evaluations: int) -> Expansion:
    """Gradient and information from terms and their derivatives, both (n_terms, 1 + n)."""
    z, slopes_z, slopes_s = innovations[:, 0], innovations[:, 1:], log_scales[:, 1:]
    slopes_e = slopes_z + z[:, np.newaxis] * slopes_s
    gradient = over_terms(slopes_z, z[:, np.newaxis])[:, 0] + slopes_s.sum(axis=0)
    information = over_terms(slopes_e, slopes_e)
    scaled = np.flatnonzero(slopes_s.any(axis=0))
    moving = slopes_s[:, scaled]
    information[np.ix_(scaled, scaled)] += 2.0 * over_terms(moving, moving)
    return Expansion(gradient, information, evaluations, Terms(innovations, log_scales))


def over_terms(left: FloatArray, right: FloatArray) -> FloatArray:
    """Sums over terms of the products of columns, ``left.T @ right`` of (n_terms, n) and (n_terms, m).

    Not by a BLAS: many rows and few columns are no work for several threads, which on a busy machine wait for each
    other several hundred times longer than the sums take, and whose number would show in the last digits. Of columns
    with themselves half is summed.

    Examples
    --------
    >>> over_terms(np.ones((3, 2)), np.arange(3.0)[:, np.newaxis]).tolist()
    [[3.0], [3.0]]
    """
    count, across = left.shape[1], right.shape[1]
    if left.shape[0] * count * across < _MANY_PRODUCTS or not has_numba():
        plain: FloatArray = np.einsum("ia,ib->ab", left, right)
        return plain
    sums, own = np.zeros((count, across)), left is right
    first = np.ascontiguousarray(left)
    last = first if own else np.ascontiguousarray(right)
    products = load_kernel(products_kernel).products
    threads = min(available_cores(), -(-count // products_kernel.TILE))

    def some(tile: int) -> None:
        products(first, last, own, tile, threads, np.empty((products_kernel.TILE, across)), sums)

    in_threads(threads, some, range(threads))
    return np.tril(sums) + np.tril(sums, -1).T if own else sums
