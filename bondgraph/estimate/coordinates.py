"""Coordinates of a problem: free parameters with their transforms, and the priors on their values.

What searches see of any problem is here; what its logs say is in :mod:`bondgraph.estimate.problem` for one filter model
and in :mod:`bondgraph.estimate.joint` for several.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bondgraph.errors import EstimationError, suggest
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.objective import Below, BoolArray, FloatArray, Terms
from bondgraph.estimate.priors import Normal, Prior, prior_slopes, prior_terms

if TYPE_CHECKING:
    from bondgraph.data.log import MatchedLog


class AbstractProblem(ABC):
    """An objective over free parameters: negative log-likelihood of logs plus priors, in coordinates."""

    if TYPE_CHECKING:  # fields of the problems that are final

        @property
        def free(self) -> tuple[FreeParameter, ...]: ...  # noqa: D102

        @property
        def priors(self) -> tuple[Prior, ...]: ...  # noqa: D102

        @property
        def logs(self) -> tuple[MatchedLog, ...]: ...  # noqa: D102

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the model, or of the models."""

    @abstractmethod
    def known_values(self, values: FloatArray) -> Mapping[str, FloatArray]:
        """Free and tied quantities by name, each (members,), at values of the free ones (n, members)."""

    @abstractmethod
    def known_slopes(self, point: FloatArray) -> Mapping[str, FloatArray]:
        """Derivatives (n,) of free and tied quantities by the coordinates, by name, at a point (n,)."""

    @abstractmethod
    def nll(self, points: FloatArray) -> FloatArray:
        """Negative log-likelihood plus priors at coordinates (n, members), shape (members,)."""

    @abstractmethod
    def nll_below(self, points: FloatArray, ceilings: FloatArray) -> Below:
        """Values as :meth:`nll` as far as they are below ceilings (members,); above, members may be given up."""

    @abstractmethod
    def terms(self, points: FloatArray) -> Terms:
        """Scalar terms at coordinates (n, members): innovations by log, output and sample, then priors."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters, in the order of the coordinates."""
        return tuple(parameter.name for parameter in self.free)

    @cached_property
    def lower(self) -> FloatArray:
        """Lower bounds of the coordinates, shape (n,)."""
        return np.array([parameter.coordinate(parameter.lower) for parameter in self.free])

    @cached_property
    def upper(self) -> FloatArray:
        """Upper bounds of the coordinates, shape (n,)."""
        return np.array([parameter.coordinate(parameter.upper) for parameter in self.free])

    @cached_property
    def start(self) -> FloatArray:
        """Coordinates at which searches start, shape (n,)."""
        return np.array([parameter.coordinate(parameter.start) for parameter in self.free])

    @cached_property
    def noise_levels(self) -> BoolArray:
        """Which coordinates are logarithms of the standard deviations of noises, shape (n,)."""
        return np.array([p.scale == "log" and p.target.kind in ("std", "process") for p in self.free], dtype=np.bool_)

    def values(self, points: FloatArray) -> FloatArray:
        """Values of the free parameters at coordinates (n, *batch), in the units of the model."""
        rows = [parameter.values(row) for parameter, row in zip(self.free, points, strict=True)]
        return np.array(rows).reshape(points.shape)

    def slopes(self, point: FloatArray) -> FloatArray:
        """Derivative of each free value by its own coordinate at a point (n,), shape (n,)."""
        values = self.values(point)
        return np.array([parameter.slope(float(v)) for parameter, v in zip(self.free, values, strict=True)])

    @cached_property
    def all_priors(self) -> tuple[Prior, ...]:
        """Those of single free parameters, then those of the problem."""
        own = [
            Normal(one.name, one.prior_mean, one.prior_std)
            for one in self.free
            if one.prior_mean is not None and one.prior_std is not None
        ]
        return (*own, *self.priors)

    def prior_terms(self, points: FloatArray) -> FloatArray:
        """Terms of the priors at coordinates (n, members), shape (n_terms, members)."""
        values = self.known_values(self.values(points)) if self.all_priors else {}
        return prior_terms(self.all_priors, values, points.shape[1])

    def prior_slopes(self, point: FloatArray) -> FloatArray:
        """Derivatives of the terms of the priors by the coordinates at a point (n,), shape (n_terms, n)."""
        if not self.all_priors:
            return np.empty((0, point.size))
        known = self.known_values(self.values(point)[:, np.newaxis])
        values = {name: float(row[0]) for name, row in known.items()}
        return prior_slopes(self.all_priors, values, self.known_slopes(point), point.size)

    def prior_values(self, points: FloatArray) -> FloatArray:
        """Sum of the priors at coordinates (n, members), but for a constant, shape (members,)."""
        values: FloatArray = 0.5 * np.sum(self.prior_terms(points) ** 2, axis=0)
        return values


def checked_priors(
    free: Sequence[FreeParameter], tied: Sequence[str], priors: Sequence[Prior]
) -> tuple[FreeParameter, ...]:
    """Free parameters with bounds as narrow as the priors' support.

    Raises
    ------
    EstimationError
        If a prior is about something that is not free, contradicts the bounds, or says a second thing of a parameter.
    """
    found = {one.name: one for one in free}
    told = [one.name for one in free if one.prior_mean is not None]
    for name, prior in [(name, one) for one in priors for name in one.names]:
        if name not in found and name not in tied:
            raise EstimationError(
                f"prior of {name!r}: it is not free{suggest(name, tuple(found))} - free it, or drop its prior",
                where=(name,),
            )
        if name in told:
            raise EstimationError(
                f"prior of {name!r}: it has two - give one, or one for several together", where=(name,)
            )
        told.append(name)
        lower, upper = prior.support(name)
        if name in found:
            found[name] = _narrowed(found[name], lower, upper)
        elif np.isfinite(upper):
            raise EstimationError(
                f"prior of {name!r}: it is tied, so that no bound can hold it - give bounds to what it follows from",
                where=(name,),
            )
    return tuple(found[one.name] for one in free)


def _narrowed(parameter: FreeParameter, lower: float, upper: float) -> FreeParameter:
    low, high = max(parameter.lower, lower), min(parameter.upper, upper)
    if low == parameter.lower and high == parameter.upper:
        return parameter
    if not low < high:
        raise EstimationError(
            f"prior of {parameter.name!r}: it leaves nothing of the bounds {parameter.lower:.6g} to "
            f"{parameter.upper:.6g} - change either",
            where=(parameter.name,),
        )
    return replace(parameter, lower=low, upper=high, start=min(max(parameter.start, low), high))
