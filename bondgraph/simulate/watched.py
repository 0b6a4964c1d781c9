"""Equations that note the first law without a value while an integrator asks them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.simulate.stiff import ModelEquations
from bondgraph.simulate.undefined import Undefined, first_undefined


@dataclass(frozen=True)
class WatchedEquations(ModelEquations):
    """Equations of a model that note, in ``found``, the first assignment without a value at a finite state.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> model = pendulum()
    >>> watched = WatchedEquations(model, model.theta(length=0.0))
    >>> with np.errstate(all="ignore"):
    ...     slopes = watched(0.0, model.x0(), model.u0())
    >>> watched.found[0].assignment
    'restoring = gravity / length * np.sin(angle)'
    """

    found: list[Undefined] = field(default_factory=list)

    def __call__(self, t: float, x: FloatArray, u: FloatArray) -> FloatArray:
        """dx/dt, shape (n_x, *batch); the first law without a value at a finite state is kept."""
        slopes = self.model.rhs(t, x, u, self.theta)
        if not self.found and np.isfinite(x).all() and not np.isfinite(slopes).all():
            points = x[:, np.newaxis] if x.ndim == 1 else x
            first = first_undefined(self.model, "rhs", t, points, u, self.theta)
            self.found.extend([] if first is None else [first])
        return slopes
