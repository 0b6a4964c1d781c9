"""States that begin at rest beside others: what a late sensor holds where its machine stood before a log.

Their rates vanish there, r(x, theta) = 0 with rates linear in them, so that they go with the other states and with
parameters: a thermometer in a well begins at the heat of its body over the capacity, for every capacity that is tried.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.simulate.model import Model

#: Time, states (n_x, members), inputs (n_u, members) and parameters (n_theta, members).
At: TypeAlias = tuple[float, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class Rests:
    """The positions of states of a model that begin at rest."""

    model: Model
    rows: tuple[int, ...] = ()

    @property
    def own(self) -> list[int]:
        """The positions as an index of arrays."""
        return list(self.rows)

    def states(self, at: At) -> FloatArray:
        """The states (n_x, members), those at rest where their rates vanish."""
        if not self.rows:
            return at[1]
        found = at[1].copy()
        found[self.own] += self._solved(at, self.model.rhs(*at)[self.own][:, np.newaxis])[:, 0]
        return found

    def leads(self, at: At) -> FloatArray:
        """How they go with each of the other states, (rows, n_x, members); nothing with one another."""
        if not self.rows:
            return np.zeros((0, *at[1].shape))
        found = self._solved(at, self.model.jacobian_x(*at)[self.own])
        found[:, self.own] = 0.0
        return found

    def by_coordinates(self, at: At, turned: FloatArray) -> FloatArray:
        """Derivatives (rows, n) by coordinates at one member, beside others that stay.

        ``turned`` (n_theta, n) are those of the parameters.
        """
        if not self.rows:
            return np.zeros((0, turned.shape[1]))
        by_theta = self.model.jacobian_theta(*at)[self.own, :, 0] @ turned
        return self._solved(at, by_theta[:, :, np.newaxis])[:, :, 0]

    def _solved(self, at: At, right: FloatArray) -> FloatArray:
        """How far they must move (rows, columns, members) so that rates (rows, columns, members) vanish."""
        by_own = np.moveaxis(self.model.jacobian_x(*at)[self.own][:, self.own], 2, 0)
        inverse = np.linalg.pinv(np.nan_to_num(by_own))  # no move, where nothing moves the rates
        return -np.moveaxis(inverse @ np.moveaxis(np.nan_to_num(right), 2, 0), 0, 2)


def rests_of(model: Model, parameters: Collection[int], names: Collection[str]) -> Rests:
    """The states of some names, if any of some parameters moves where they rest; otherwise none of them."""
    rows = tuple(model.index("state", name) for name in names)
    jacobian = model.program.jacobian("rhs", "theta")
    pairs = zip(map(int, jacobian.rows), map(int, jacobian.columns), strict=True)
    return Rests(model, rows if any(row in rows and column in parameters for row, column in pairs) else ())


def shown_through(model: Model, parameters: Collection[int], rests: Rests) -> set[int]:
    """The outputs that show states by a law with any of some parameters in it, of their own or of a state at rest."""
    shown, by_theta = model.program.jacobian("output", "x"), model.program.jacobian("output", "theta")
    told = zip(map(int, by_theta.rows), map(int, by_theta.columns), strict=True)
    late = zip(map(int, shown.rows), map(int, shown.columns), strict=True)
    return {row for row, column in told if column in parameters} | {row for row, column in late if column in rests.rows}
