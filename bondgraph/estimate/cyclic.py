"""States that a model repeats itself in: angles that act by their sine and cosine, and are known but for whole turns.

Whoever knows nothing of such a state knows that it lies anywhere in one turn. A larger uncertainty spreads the sigma
points of a filter over many turns: what it then makes of a sine has nothing to do with the machine.
"""

from __future__ import annotations

import math

import numpy as np

from bondgraph.arrays import BoolArray, FloatArray
from bondgraph.simulate.model import Model

#: Standard deviation of what is anywhere in one turn, rad.
ANYWHERE = 2.0 * math.pi / math.sqrt(12.0)
#: Points at which a model is compared with itself one turn on, and the share of its values that is rounding there.
_POINTS, _ROUNDING = 8, 1e-9


def repeats(model: Model, sizes: FloatArray) -> BoolArray:
    """True for states (n_x,) in which a turn of 2 pi changes nothing of a model, and a part of it does.

    Parameters
    ----------
    model
        The model.
    sizes
        How large each state gets, shape (n_x,).

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = pendulum()
    >>> swing.names("state"), repeats(swing, np.array([0.5, 1.0])).tolist()
    (('angle', 'rate'), [True, False])
    """
    chance = np.random.default_rng(1)
    points = [model.x0() + sizes * chance.uniform(-1.0, 1.0, sizes.size) for _ in range(_POINTS)]
    seen = np.array([_values(model, point) for point in points])
    rounding = _ROUNDING * np.max(np.abs(seen), axis=0, initial=0.0)
    found = np.zeros(sizes.size, dtype=np.bool_)
    for k in range(sizes.size):
        turn = 2.0 * math.pi * (np.arange(sizes.size) == k)
        turned = [np.array([_values(model, point + share * turn) for point in points]) for share in (1.0, 0.3)]
        with np.errstate(invalid="ignore"):  # rates that are infinite here and there do not repeat
            whole, part = (np.abs(one - seen) for one in turned)
        found[k] = bool(np.all(whole <= rounding) and np.any(part > rounding))
    return found


def _values(model: Model, x: FloatArray) -> FloatArray:
    """Rates, then outputs of a model at a state (n_x,); not a number where it has none."""
    u, theta = model.u0(), model.theta()
    with np.errstate(all="ignore"):
        return np.concatenate([model.rhs(0.0, x, u, theta), model.output(0.0, x, u, theta)])
