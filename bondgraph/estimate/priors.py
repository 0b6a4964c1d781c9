"""Priors: what is known of parameters before any log is seen, as distributions.

Each prior is a sum of squares of terms z(values), to which the negative logarithm of its density is equal but for a
constant: (z1^2 + z2^2 + ...) / 2. So a prior enters a likelihood like measurements with unit variance, with an exact
contribution to value, gradient and Fisher information.

    Normal             z = (v - mean) / std
    LogNormal          z = (log v - log median + sigma^2) / sigma, since its density falls by 1 / v besides
    MultivariateNormal z = L^-1 (c - mean) with the covariance L L', of values or of their logarithms
    Uniform            no term: it narrows the bounds

Reference: Gelman, Carlin, Stern, Dunson, Vehtari, Rubin (2013), Bayesian Data Analysis, 3rd ed., appendix A.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.linalg import solve_triangular

from bondgraph.arrays import FloatArray
from bondgraph.errors import EstimationError, listed
from bondgraph.estimate.transforms import Scale


@runtime_checkable
class Prior(Protocol):
    """Distribution of one or several parameters, in the units of the model."""

    @property
    def names(self) -> tuple[str, ...]:
        """Free or tied parameters that it is about."""

    def terms(self, values: FloatArray) -> FloatArray:
        """Terms z, shape (n_terms, members), at values (n_names, members) in the order of the names."""

    def slopes(self, values: FloatArray) -> FloatArray:
        """Derivatives of the terms by the values, shape (n_terms, n_names), at values (n_names,)."""

    def support(self, name: str) -> tuple[float, float]:
        """Ends of the values that are possible at all."""

    def spread(self, name: str) -> float:
        """Standard deviation of a value, to first order in that of its logarithm; infinite where bounds tell."""


def _require(condition: bool | np.bool_, name: str, problem: str) -> None:
    if not condition:
        raise EstimationError(f"prior of {name!r}: {problem}", where=(name,))


@dataclass(frozen=True)
class Normal:
    """Normal distribution of one parameter.

    Raises
    ------
    EstimationError
        If the standard deviation is not positive, or a number is not finite.

    Examples
    --------
    >>> Normal("m", 1200.0, 50.0).terms(np.array([[1300.0]])).tolist()
    [[2.0]]
    """

    name: str
    mean: float
    std: float

    def __post_init__(self) -> None:
        good = math.isfinite(self.mean) and 0.0 < self.std < math.inf
        _require(good, self.name, f"mean {self.mean:g} and std {self.std:g} must be finite, the std above zero")

    @property
    def names(self) -> tuple[str, ...]:
        """The parameter."""
        return (self.name,)

    def terms(self, values: FloatArray) -> FloatArray:
        """Terms z, shape (1, members)."""
        found: FloatArray = (values - self.mean) / self.std
        return found

    def slopes(self, values: FloatArray) -> FloatArray:
        """Derivative of the term, shape (1, 1)."""
        return np.array([[1.0 / self.std]])

    def support(self, name: str) -> tuple[float, float]:
        """Everything."""
        return -math.inf, math.inf

    def spread(self, name: str) -> float:
        """The standard deviation."""
        return self.std


@dataclass(frozen=True)
class LogNormal:
    """Lognormal distribution of one positive parameter, by its median and the standard deviation of its logarithm.

    Raises
    ------
    EstimationError
        If median or sigma are not positive.

    Examples
    --------
    >>> known = LogNormal("k", 2.0, 0.5)
    >>> known.terms(np.array([[2.0 * math.exp(-0.25)]])).round(12).tolist()  # the mode
    [[0.0]]
    """

    name: str
    median: float
    sigma: float

    def __post_init__(self) -> None:
        good = 0.0 < self.median < math.inf and 0.0 < self.sigma < math.inf
        _require(good, self.name, f"median {self.median:g} and sigma {self.sigma:g} must be above zero and finite")

    @property
    def names(self) -> tuple[str, ...]:
        """The parameter."""
        return (self.name,)

    def terms(self, values: FloatArray) -> FloatArray:
        """Terms z, shape (1, members); infinite at zero and below."""
        with np.errstate(divide="ignore", invalid="ignore"):
            away = np.log(values / self.median)
        found: FloatArray = np.where(values > 0.0, away + self.sigma**2, -np.inf) / self.sigma
        return found

    def slopes(self, values: FloatArray) -> FloatArray:
        """Derivative of the term, shape (1, 1)."""
        return np.array([[1.0 / (self.sigma * float(values[0]))]])

    def support(self, name: str) -> tuple[float, float]:
        """Positive values."""
        return 0.0, math.inf

    def spread(self, name: str) -> float:
        """Standard deviation to first order."""
        return self.sigma * self.median


@dataclass(frozen=True)
class Uniform:
    """Uniform distribution of one parameter: nothing but bounds.

    Raises
    ------
    EstimationError
        If the bounds are not two finite numbers, the lower first.
    """

    name: str
    lower: float
    upper: float

    def __post_init__(self) -> None:
        good = math.isfinite(self.lower) and math.isfinite(self.upper) and self.lower < self.upper
        _require(good, self.name, f"bounds {self.lower:g} to {self.upper:g} must be two finite numbers, lower first")

    @property
    def names(self) -> tuple[str, ...]:
        """The parameter."""
        return (self.name,)

    def terms(self, values: FloatArray) -> FloatArray:
        """No terms, shape (0, members)."""
        return np.empty((0, *values.shape[1:]))

    def slopes(self, values: FloatArray) -> FloatArray:
        """No terms, shape (0, 1)."""
        return np.empty((0, 1))

    def support(self, name: str) -> tuple[float, float]:
        """Within the bounds."""
        return self.lower, self.upper

    def spread(self, name: str) -> float:
        """The bounds tell."""
        return math.inf


@dataclass(frozen=True)
class MultivariateNormal:
    """Normal distribution of several parameters together, or of the logarithms of some.

    Parameters
    ----------
    parameters
        Names.
    mean
        Means, in the order of the names: of the values, or of their logarithms.
    covariance
        Rows of the covariance, in the same order.
    scales
        ``"linear"`` or ``"log"`` for each name; empty: all linear.

    Raises
    ------
    EstimationError
        If the sizes do not fit, or the covariance is not symmetric and positive definite.

    Examples
    --------
    >>> known = MultivariateNormal(("a", "b"), (1.0, 2.0), ((4.0, 0.0), (0.0, 9.0)))
    >>> known.terms(np.array([[3.0], [5.0]])).tolist()
    [[1.0], [1.0]]
    """

    parameters: tuple[str, ...]
    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    scales: tuple[Scale, ...] = ()

    def __post_init__(self) -> None:
        size, what = len(self.parameters), ", ".join(self.parameters)
        rows = {len(row) for row in self.covariance}
        fits = len(self.mean) == size == len(self.covariance) and rows <= {size} and len(self.scales) in (0, size)
        _require(size > 0 and fits, what, "names, means, covariance and scales have different sizes")
        _require(len(set(self.parameters)) == size, what, "a name stands twice")
        _require(set(self.scales) <= {"linear", "log"}, what, f"scales {self.scales} must be 'linear' or 'log'")
        matrix = np.array(self.covariance)
        symmetric = np.isfinite(matrix).all() and np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0)
        positive = symmetric and float(np.diag(matrix).min()) > 0.0
        std = np.sqrt(np.diag(matrix)) if positive else np.ones(size)
        positive = positive and float(np.linalg.eigvalsh(matrix / np.outer(std, std)).min()) > 0.0
        _require(positive and np.isfinite(self.mean).all(), what, "the covariance is not symmetric positive definite")

    @classmethod
    def of(
        cls, names: Sequence[str], mean: FloatArray, covariance: FloatArray, scales: Sequence[Scale] = ()
    ) -> MultivariateNormal:
        """The distribution of arrays: mean (n,) and covariance (n, n)."""
        symmetric = 0.5 * (covariance + covariance.T)
        return cls(tuple(names), tuple(mean.tolist()), tuple(map(tuple, symmetric.tolist())), tuple(scales))

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters."""
        return self.parameters

    @cached_property
    def _logarithmic(self) -> FloatArray:
        return np.array([scale == "log" for scale in self.scales or ("linear",) * len(self.parameters)])

    @cached_property
    def _root(self) -> FloatArray:
        found: FloatArray = np.linalg.cholesky(np.array(self.covariance))
        return found

    def terms(self, values: FloatArray) -> FloatArray:
        """Terms z, shape (n_names, members); infinite where a logarithm does not exist."""
        own = values.copy()
        rows = np.flatnonzero(self._logarithmic)
        with np.errstate(divide="ignore", invalid="ignore"):
            own[rows] = np.where(own[rows] > 0.0, np.log(own[rows]), -np.inf)
        possible = np.isfinite(own).all(axis=0)
        found = np.full(own.shape, np.inf)
        away = own[:, possible] - np.array(self.mean)[:, np.newaxis]
        found[:, possible] = solve_triangular(self._root, away, lower=True)
        return found

    def slopes(self, values: FloatArray) -> FloatArray:
        """Derivatives of the terms by the values, shape (n_names, n_names)."""
        inner = np.diag(np.where(self._logarithmic, 1.0 / values, 1.0))
        found: FloatArray = solve_triangular(self._root, inner, lower=True)
        return found

    def support(self, name: str) -> tuple[float, float]:
        """Everything, or positive values where the logarithm is normal."""
        return (0.0 if self._logarithmic[self.parameters.index(name)] else -math.inf), math.inf

    def spread(self, name: str) -> float:
        """Marginal standard deviation, to first order."""
        k = self.parameters.index(name)
        std = math.sqrt(self.covariance[k][k])
        return std * math.exp(self.mean[k]) if self._logarithmic[k] else std


def read_priors(priors: Prior | Sequence[Prior]) -> tuple[Prior, ...]:
    """One prior, or several.

    Raises
    ------
    OptionError
        If something else is given.

    Examples
    --------
    >>> read_priors(Normal("mass", 1200.0, 50.0))
    (Normal(name='mass', mean=1200.0, std=50.0),)
    """
    return tuple(listed("priors", priors, Prior, "prior"))  # type: ignore[type-abstract]


def prior_terms(priors: Sequence[Prior], values: Mapping[str, FloatArray], members: int) -> FloatArray:
    """Terms of all priors, shape (n_terms, members), at values (members,) by name."""
    rows = [prior.terms(np.array([values[name] for name in prior.names])) for prior in priors]
    return np.concatenate([np.empty((0, members)), *rows])


def prior_slopes(
    priors: Sequence[Prior], values: Mapping[str, float], slopes: Mapping[str, FloatArray], size: int
) -> FloatArray:
    """Derivatives (n_terms, n) of all terms by n coordinates, from those (n,) of the values, by name."""
    rows = [
        prior.slopes(np.array([values[name] for name in prior.names])) @ np.array([slopes[n] for n in prior.names])
        for prior in priors
    ]
    return np.concatenate([np.empty((0, size)), *rows])
