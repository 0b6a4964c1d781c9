"""Rules of a particle swarm: whom a particle listens to, how its weights change, what happens at a wall."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import FloatArray
from bondgraph.errors import EstimationError


class Neighbourhood(Protocol):
    """Whose best position draws each particle."""

    def informants(self, values: FloatArray) -> npt.NDArray[np.intp]:
        """The particle that informs each, shape (members,), given the values of their bests (members,)."""


@dataclass(frozen=True)
class Global:
    """Every particle listens to the best of all: fast, and soon in one place.

    Examples
    --------
    >>> Global().informants(np.array([3.0, 1.0, 2.0])).tolist()
    [1, 1, 1]
    """

    def informants(self, values: FloatArray) -> npt.NDArray[np.intp]:
        """The particle that informs each, shape (members,)."""
        return np.full(values.size, int(np.argmin(values)), dtype=np.intp)


@dataclass(frozen=True)
class Ring:
    """Every particle listens to itself and its two neighbours on a ring: slow, and many places for long.

    Reference: Kennedy and Mendes (2002), Population structure and particle swarm performance, IEEE CEC.

    Examples
    --------
    >>> Ring().informants(np.array([3.0, 1.0, 2.0, 0.5, 4.0])).tolist()
    [1, 1, 3, 3, 3]
    """

    def informants(self, values: FloatArray) -> npt.NDArray[np.intp]:
        """The particle that informs each, shape (members,)."""
        own = np.arange(values.size)
        return _best_of(values, np.array([own, (own - 1) % values.size, (own + 1) % values.size]))


@dataclass(frozen=True)
class VonNeumann:
    """Every particle listens to itself and its four neighbours on a torus, whose rows are as long as they are many.

    Reference: Kennedy and Mendes (2002), Population structure and particle swarm performance, IEEE CEC.

    Examples
    --------
    >>> VonNeumann().informants(np.array([3.0, 1.0, 2.0, 0.5, 4.0, 6.0])).tolist()
    [1, 3, 3, 3, 3, 3]
    """

    def informants(self, values: FloatArray) -> npt.NDArray[np.intp]:
        """The particle that informs each, shape (members,); particles beyond a full torus stand in its last rows."""
        count = values.size
        row = max(1, round(math.sqrt(count)))
        own = np.arange(count)
        return _best_of(values, np.array([own, *((own + step) % count for step in (-1, 1, -row, row))]))


def _best_of(values: FloatArray, candidates: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    chosen: npt.NDArray[np.intp] = candidates[np.argmin(values[candidates], axis=0), np.arange(values.size)]
    return chosen


class Schedule(Protocol):
    """How the weights of a swarm change."""

    def weights(self, share: float) -> tuple[float, float, float]:
        """Inertia, cognitive and social weight after a share of the iterations."""


@dataclass(frozen=True)
class Constriction:
    """Weights that make the particles converge whatever they find.

    Reference: Clerc and Kennedy (2002), The particle swarm - explosion, stability, and convergence in a
    multidimensional complex space, IEEE Trans. Evolutionary Computation 6(1), 58-73.

    Raises
    ------
    EstimationError
        If ``phi`` is not above four.

    Examples
    --------
    >>> [round(weight, 4) for weight in Constriction().weights(0.5)]
    [0.7298, 1.4962, 1.4962]
    """

    phi: float = 4.1

    def __post_init__(self) -> None:
        if not self.phi > 4.0:
            raise EstimationError(f"swarm: constriction needs phi = {self.phi:g} above 4", where=("phi",))

    def weights(self, share: float) -> tuple[float, float, float]:
        """Inertia, cognitive and social weight."""
        factor = 2.0 / abs(2.0 - self.phi - math.sqrt(self.phi**2 - 4.0 * self.phi))
        return factor, 0.5 * factor * self.phi, 0.5 * factor * self.phi


@dataclass(frozen=True)
class FallingInertia:
    """Inertia that falls in a straight line: far flights first, a fine search last.

    Reference: Shi and Eberhart (1999), Empirical study of particle swarm optimization, IEEE CEC, 1945-1950.

    Examples
    --------
    >>> FallingInertia().weights(0.5)[0]
    0.65
    """

    first: float = 0.9
    last: float = 0.4
    cognitive: float = 2.0
    social: float = 2.0

    def weights(self, share: float) -> tuple[float, float, float]:
        """Inertia, cognitive and social weight after a share of the iterations."""
        return self.first + (self.last - self.first) * min(share, 1.0), self.cognitive, self.social


class Walls(Protocol):
    """What happens to particles that leave the box."""

    def keep(
        self, positions: FloatArray, velocities: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Positions inside and velocities, both (n, members); bounds (n,)."""


@dataclass(frozen=True)
class Reflecting:
    """They are thrown back; one that flew further than the box is wide stays at the wall it would be thrown to.

    Examples
    --------
    >>> Reflecting().keep(np.array([[1.25, -3.0]]), np.array([[0.5, -4.0]]), np.array([0.0]), np.array([1.0]))
    (array([[0.75, 1.  ]]), array([[-0.5,  4. ]]))
    """

    def keep(
        self, positions: FloatArray, velocities: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Positions inside and velocities, both (n, members)."""
        low, high = lower[:, np.newaxis], upper[:, np.newaxis]
        outside = (positions < low) | (positions > high)
        mirrored = np.where(
            positions < low, 2.0 * low - positions, np.where(positions > high, 2.0 * high - positions, positions)
        )
        return np.clip(mirrored, low, high), np.where(outside, -velocities, velocities)


@dataclass(frozen=True)
class Clipping:
    """They stay at the wall and stand still in that coordinate.

    Examples
    --------
    >>> Clipping().keep(np.array([[1.25, 0.5]]), np.array([[0.5, -4.0]]), np.array([0.0]), np.array([1.0]))
    (array([[1. , 0.5]]), array([[ 0., -4.]]))
    """

    def keep(
        self, positions: FloatArray, velocities: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Positions inside and velocities, both (n, members)."""
        inside = np.clip(positions, lower[:, np.newaxis], upper[:, np.newaxis])
        return inside, np.where(inside == positions, velocities, 0.0)


@dataclass(frozen=True)
class Periodic:
    """They come in again at the other side, as suits angles.

    Examples
    --------
    >>> Periodic().keep(np.array([[1.25, -0.25]]), np.array([[0.5, -4.0]]), np.array([0.0]), np.array([1.0]))
    (array([[0.25, 0.75]]), array([[ 0.5, -4. ]]))
    """

    def keep(
        self, positions: FloatArray, velocities: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Positions inside and velocities, both (n, members)."""
        low, width = lower[:, np.newaxis], (upper - lower)[:, np.newaxis]
        share = np.divide(positions - low, width, out=np.zeros(positions.shape), where=width > 0.0)
        inside = (share >= 0.0) & (share <= 1.0)
        return np.where(inside, positions, low + width * np.mod(share, 1.0)), velocities
