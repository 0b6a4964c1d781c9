"""States that an output shows by a curve: the volume behind a level in a cone, the flux behind a saturated current.

An output that depends on one state alone, straight or not, says where that state is: where the curve shows what was
measured. Newton's steps find it, halved where they overshoot (Nocedal and Wright 2006, Numerical Optimization, ch. 11).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from bondgraph.estimate.objective import BoolArray, FloatArray
from bondgraph.filter.follows import Follow, with_followers
from bondgraph.simulate.model import Model

#: Steps after which the search for a point of a curve is given up: one that is nearly straight takes four, one whose
#: slope changes a thousandfold a dozen.
_MOST_STEPS = 50
#: Where less than this share is left, the next step is exact: its square, which Newton leaves, is below rounding.
_NEAR = 1e-7
#: Difference that may be left between curve and measurement, as a share of it: rounding of long laws.
_CLOSE = 1e-9
#: A curve that is flatter than this share of its slope where the search began tells nothing: a sensor at its ceiling, a
#: spring inside its gap. A convention.
FLAT = 1e-2
#: Difference of a state for second derivatives, as a share of it: the cube root of rounding, where central differences
#: err least (Nocedal and Wright 2006, section 8.1). A state at zero moves by its square.
_APART = 1e-5


@dataclass(frozen=True)
class OnCurve:
    """A state that an output shows: its position, its value, and the output's slope there.

    ``straight``: the slope is the same everywhere.
    """

    state: int
    value: float
    slope: float
    straight: bool = False


def shown_by_curves(
    model: Model,
    u: FloatArray,
    theta: FloatArray,
    measured: Mapping[int, float],
    known: tuple[FloatArray, BoolArray],
    follows: Mapping[str, Follow] | None = None,
) -> dict[int, OnCurve]:
    """The states that outputs show alone, beside what is known, by output; where two show one state the first counts.

    Parameters
    ----------
    model, u, theta
        The model at inputs (n_u,) and parameters (n_theta,).
    measured
        What outputs show, by position.
    known
        States (n_x,), and which of them are known; the others are where a search begins.
    follows
        States that start where others lead them.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("hopper")
    >>> vessel = g.zero_junction("vessel", bg.HYDRAULIC)
    >>> C, k = g.parameter("C", 2e-6, "m^3/Pa"), g.parameter("k", 1e-10, "m^3/Pa^2")
    >>> _ = g.compliance("water", lambda V: ((C**2 + 4 * k * V) ** 0.5 - C) / (2 * k), at=vessel, state="V")
    >>> _ = g.resistance("outlet", 1e8, at=vessel)
    >>> g.measure_effort("p", vessel, unit="Pa")
    >>> model = bg.build(g).model
    >>> x0, unknown = model.x0(), np.array([False])
    >>> found = shown_by_curves(model, model.u0(), model.theta(), {0: 5000.0}, (x0, unknown))
    >>> round(found[0].value, 9)  # C p + k p^2
    0.0125
    """
    x0, held = known
    found: dict[int, OnCurve] = {}
    for output, value in measured.items():
        state = single_state(model, output, held, follows or {})
        if state is None or state in {one.state for one in found.values()}:
            continue

        def curve(x: FloatArray, output: int = output, state: int = state) -> tuple[FloatArray, FloatArray]:
            at, own = x0.copy(), np.zeros(x0.size)
            at[state], own[state] = x[0], 1.0
            at, ahead = (with_followers(model, one, u, follows or {}) for one in (at, at + own))
            by_state = model.jacobian_x(0.0, at, u, theta, "output")[output]
            return model.output(0.0, at, u, theta)[[output]], np.array([by_state @ (ahead - at)])

        at, slope = inverted(curve, x0[[state]], value)
        if np.isfinite(at[0]):
            found[output] = OnCurve(state, float(at[0]), float(slope[0]))
    return found


def single_state(model: Model, output: int, held: BoolArray, follows: Mapping[str, Follow]) -> int | None:
    """The only state on which an output depends that is not held (n_x,), with those that follow it; None without one.

    It is read from the equations: what a coefficient of zero leaves out counts.
    """
    jacobian, names = model.program.jacobian("output", "x"), model.names("state")
    acting = {int(x) for row, x in zip(jacobian.rows, jacobian.columns, strict=True) if int(row) == output}
    led = {row for row in acting if names[row] in follows}
    leading = {names.index(one) for row in led for one, _ in follows[names[row]].slopes if one in names}
    acting = {row for row in acting - led | leading if not held[row]}
    return acting.pop() if len(acting) == 1 else None


def inverted(
    curve: Callable[[FloatArray], tuple[FloatArray, FloatArray]], start: FloatArray, value: float
) -> tuple[FloatArray, FloatArray]:
    """Where curves (members,) show a value, and their slopes there; nan where steps from the start find no such place.

    Parameters
    ----------
    curve
        What is shown at points (members,), and its slopes.
    start
        Where the steps begin, (members,).
    value
        What is shown.

    Examples
    --------
    >>> at, slope = inverted(lambda x: (np.exp(x), np.exp(x)), np.array([0.0, 5.0]), 2.0)
    >>> at.round(12).tolist() == [0.69314718056] * 2, slope.round(9).tolist()
    (True, [2.0, 2.0])
    """
    with np.errstate(all="ignore"):
        x, share = start.copy(), np.ones(start.size)
        shown, slope = curve(x)
        steep, last = np.abs(slope), False
        for _ in range(_MOST_STEPS):
            step = (value - shown) / slope
            ahead = x + share * step
            there, slopes = curve(ahead)
            nearer = np.abs(value - there) <= np.abs(value - shown)
            x, shown, slope = np.where(nearer, (ahead, there, slopes), (x, shown, slope))
            share = np.where(nearer, 1.0, 0.5 * share)
            if last or not (np.isfinite(step) & (share > _CLOSE)).any():
                break
            last = bool((np.abs(value - shown) <= _NEAR * _size(value, slope, x)).all())
        met = np.abs(value - shown) <= _CLOSE * _size(value, slope, x)
        told = met & (np.abs(slope) > FLAT * steep)
    return np.where(told, x, np.nan), slope


def bends(
    model: Model,
    at: tuple[float, FloatArray, FloatArray, FloatArray],
    place: tuple[int, int],
    moved: tuple[FloatArray, FloatArray],
    turned: FloatArray,
) -> FloatArray:
    """Derivatives (n,) of the slope of a curve by coordinates, as the state moves with them.

    Parameters
    ----------
    model, at
        The model, and the time, states (n_x, 1), inputs (n_u, 1) and parameters (n_theta, 1) there.
    place
        Output and state.
    moved
        How the states (n_x,) move with the shown one, and the shown one with the coordinates (n,).
    turned
        Derivatives (n_theta, n) of the parameters by the coordinates.
    """
    time, x, u, theta = at
    output, state = place
    along, by_coordinates = moved
    apart = _APART * float(np.abs(x[state, 0])) or _APART**2
    sides = [x + side * apart * along[:, np.newaxis] for side in (1.0, -1.0)]
    slopes = [along @ model.jacobian_x(time, one, u, theta, "output")[output, :, 0] for one in sides]
    by_theta = [model.jacobian_theta(time, one, u, theta, "output")[output, :, 0] @ turned for one in sides]
    found: FloatArray = (by_theta[0] - by_theta[1] + (slopes[0] - slopes[1]) * by_coordinates) / (2.0 * apart)
    return found


def _size(value: float, slope: FloatArray, x: FloatArray) -> FloatArray:
    """How large what is compared is: the value, and what the state makes of it."""
    return np.maximum(abs(value), np.abs(slope * x))
