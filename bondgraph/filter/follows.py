"""States that start where others stand: an inertia that a forgotten elasticity sets free, a command that comes late."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.simulate.model import Model


@dataclass(frozen=True)
class Follow:
    """Where a state starts: on a straight line in other states and in inputs, by name, at the first sample.

    One that ``rests`` starts where its rate vanishes; the line is that at the parameters of which it was told, and
    moves with them.

    Examples
    --------
    >>> Follow(1.0, (("w_motor", 0.25), ("torque", 2.0))).value({"w_motor": 40.0, "torque": 1.5, "w_fan": 0.0})
    14.0
    """

    constant: float
    slopes: tuple[tuple[str, float], ...] = ()
    rests: bool = False

    def value(self, known: Mapping[str, float]) -> float:
        """The start, given states and inputs by name; one that is not known has no part in it."""
        return self.constant + sum(slope * known.get(name, 0.0) for name, slope in self.slopes)


def with_followers(model: Model, x0: FloatArray, u: FloatArray, follows: Mapping[str, Follow]) -> FloatArray:
    """Initial states (n_x,), those that follow where the others and the inputs u (n_u,) lead them."""
    names = model.names("state")
    known = dict(zip((*names, *model.names("input")), map(float, (*x0, *u)), strict=True))
    found = np.array(x0)
    for row, name in enumerate(names):
        if name in follows:
            found[row] = follows[name].value(known)
    return found
