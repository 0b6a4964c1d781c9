"""Does a likelihood depend on rounding? A filter can multiply the last digit of its parameters by many powers of ten.

An integration step that is too long for a saturating law (a tyre, a belt) jumps across the zone in which it grips, now
to one side and now to the other, and each jump multiplies what went before. After some hundred samples the value is
another one when a parameter moves by one unit in the last place. It is the steps that do so: square-root forms of the
covariance, which keep small directions to the last digit, move as much, and finer steps do not move at all.

Two ways tell. Exact derivatives grow with the amplification, at no cost: see :func:`depends_on_rounding`. Where there
are none, twins that differ in the last place are filtered beside the member: see :func:`conditioning`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Unpack

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import FloatArray
from bondgraph.filter.batch import run_batches
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.members import MemberValues, per_log
from bondgraph.filter.runs import prepared
from bondgraph.filter.samples import MeasuredLog
from bondgraph.simulate.outcome import Outcome

#: Share of a value by which rounding may move it.
NEGLIGIBLE_SHARE = 1e-6

#: Twins beside the member; their signs are drawn, and one of three meets what amplifies.
_TWINS = 3

#: Rounding at every step moves a value that many times as much as rounding of the parameters: on the recorded drives
#: of the vehicle, with steps that are too long, 150 to 1400 times.
_ROUNDINGS = 1000.0


@dataclass(frozen=True)
class Conditioning:
    """How much a negative log-likelihood ``nll`` moves in ``nats`` when its parameters move in the last place.

    Examples
    --------
    >>> Conditioning(50000.0, 900.0).outcome.name, Conditioning(50000.0, 1e-8).outcome.name
    ('ILL_CONDITIONED', 'OK')
    >>> print(Conditioning(80000.0, 1e-8))
    rounding moves the likelihood by 1e-08 nats (negligible)
    """

    nll: float
    nats: float

    @property
    def negligible(self) -> bool:
        """Whether rounding leaves the value alone for all purposes."""
        return self.nats <= NEGLIGIBLE_SHARE * (1.0 + abs(self.nll))

    @property
    def outcome(self) -> Outcome:
        """``OK`` or ``ILL_CONDITIONED``."""
        return Outcome.OK if self.negligible else Outcome.ILL_CONDITIONED

    def __str__(self) -> str:
        verdict = "negligible" if self.negligible else "too much - use more substeps, or method 'auto'"
        return f"rounding moves the likelihood by {self.nats:.3g} nats ({verdict})"


def conditioning(
    filter_model: FilterModel,
    logs: MeasuredLog | Sequence[MeasuredLog],
    theta: npt.ArrayLike | None = None,
    *,
    compiled: bool = True,
    **values: Unpack[MemberValues],
) -> Conditioning:
    """Filter logs with one set of numbers and with twins that differ in the last place of parameters and start.

    Parameters
    ----------
    filter_model, logs
        As for :func:`bondgraph.filter.likelihood.likelihood`.
    theta
        Parameters (n_theta,); None: declared values.
    **values
        Numbers of that member, see :class:`bondgraph.filter.members.MemberValues`.

    Returns
    -------
    Conditioning
        Infinite ``nats`` where some of them fail; ``nll`` is infinite where all do, which is another matter.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1})
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> conditioning(swing, log, compiled=False).negligible
    True
    """
    listed = logs if isinstance(logs, Sequence) else (logs,)
    model = filter_model.model
    rng = np.random.default_rng(0)
    x0 = [model.x0(theta) if one is None else one for one in per_log("x0", values.get("x0"), len(listed))]
    moved: MemberValues = {**values, "x0": [_twins(np.asarray(one, dtype=np.float64), rng) for one in x0]}
    parameters = _twins(model.theta() if theta is None else np.asarray(theta, dtype=np.float64), rng)
    used, samples, batches = prepared(filter_model, listed, parameters, moved, compiled)
    nll = np.sum([run.verdicts.nll for run in run_batches(used, samples, batches, 0, 1, compiled)], axis=0)
    if not np.isfinite(nll).any():
        return Conditioning(np.inf, 0.0)
    return Conditioning(float(nll[0]), float(np.max(np.abs(nll - nll[0]))) if np.isfinite(nll).all() else np.inf)


def _twins(numbers: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Numbers (n,), and beside them the same moved by one unit in the last place up or down, (n, 1 + twins)."""
    ends = rng.choice([-np.inf, np.inf], size=(numbers.size, _TWINS))
    own = numbers.reshape(-1, 1)
    # a zero stays: the number next to it is no rounding of anything
    return np.hstack([own, np.where(own == 0.0, own, np.nextafter(own, ends))])


def depends_on_rounding(value: float, gradient: FloatArray, reach: FloatArray) -> bool:
    """Whether derivatives (D,) of a value are so large that rounding of all steps moves it noticeably.

    Parameters
    ----------
    value
        Size of the value, as a sum of magnitudes, nats.
    gradient
        Its derivatives in directions, (D,).
    reach
        How far each direction must be followed to change a number by its own size, (D,).

    Examples
    --------
    >>> depends_on_rounding(5e4, np.array([1e18]), np.ones(1)), depends_on_rounding(8e4, np.array([1e6]), np.ones(1))
    (True, False)
    """
    unit = 0.5 * float(np.finfo(np.float64).eps)
    moved = _ROUNDINGS * unit * np.abs(gradient) * reach
    return bool(np.any(moved > NEGLIGIBLE_SHARE * (1.0 + value)))
