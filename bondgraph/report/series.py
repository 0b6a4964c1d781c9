"""Plain values that the report's figures and tables are made of; nothing here knows how they were computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bondgraph.correct.fits.assess import rms_interval
from bondgraph.text import count

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Prediction:
    """One channel of one log as a model gives it, each of shape (n,): NaN where there is none.

    ``one_step`` is what the filter expects before each measurement, ``simulated`` a free run from where the log begins.
    """

    one_step: FloatArray | None = None
    simulated: FloatArray | None = None

    def within(self, window: slice) -> Prediction:
        """The same at some of the samples."""
        return Prediction(*(None if one is None else one[window] for one in (self.one_step, self.simulated)))


@dataclass(frozen=True, repr=False)
class ChannelSeries:
    """A measured channel with the model's predictions before and after a correction.

    ``time`` and ``measured`` (n,), NaN where nothing was measured; ``noise_std`` in the channel's unit, NaN if unknown.
    """

    log: str
    channel: str
    unit: str
    time: FloatArray
    measured: FloatArray
    before: Prediction
    after: Prediction | None = None
    noise_std: float = float("nan")
    held_out: bool = False

    def within(self, window: slice) -> ChannelSeries:
        """The same at some of the samples."""
        after = None if self.after is None else self.after.within(window)
        return replace(
            self, time=self.time[window], measured=self.measured[window], before=self.before.within(window), after=after
        )

    def __repr__(self) -> str:
        return f"<ChannelSeries {self.log}, {self.channel} [{self.unit}]: {count(self.time.size, 'sample')}>"


@dataclass(frozen=True)
class StateBand:
    """A state as a filter or smoother knows it: ``mean``, ``std`` and what was measured of it (or NaN), each (n,)."""

    name: str
    unit: str
    time: FloatArray
    mean: FloatArray
    std: FloatArray
    measured: FloatArray


@dataclass(frozen=True)
class FilteredLog:
    """What a filter made of a log: bands of states and measured outputs, and innovations in the band expected of them.

    The ``mean`` of an innovation's band is zero, its ``std`` what the filter expects, ``measured`` the innovation.
    """

    log: str
    beliefs: tuple[StateBand, ...]
    innovations: tuple[StateBand, ...]


@dataclass(frozen=True)
class MissingEffort:
    """The missing effort (or flow) at a place against another quantity, with the law found.

    ``x`` and ``missing`` (n,) are what the data say at each sample; ``law_x``, ``law`` and the optional band ``lower``,
    ``upper`` (k,) what the found effect says. Labels carry units: ``"omega of shaft [rad/s]"``.
    """

    title: str
    x_label: str
    y_label: str
    x: FloatArray
    missing: FloatArray
    law_x: FloatArray
    law: FloatArray
    law_text: str
    lower: FloatArray | None = None
    upper: FloatArray | None = None


@dataclass(frozen=True)
class ChannelError:
    """Errors of one channel in one log before and after a correction, in the channel's unit; NaN where unknown.

    ``samples`` is the number of measurements, the weight with which errors of several logs are pooled. The 95 %
    intervals are those of the errors after the correction, by blocks of time.
    """

    log: str
    channel: str
    unit: str
    held_out: bool
    one_step_before: float
    one_step_after: float
    simulation_before: float
    simulation_after: float
    noise_std: float = float("nan")
    samples: int = 1
    one_step_ci95: tuple[float, float] = (float("nan"), float("nan"))
    simulation_ci95: tuple[float, float] = (float("nan"), float("nan"))


@dataclass(frozen=True)
class ParameterChange:
    """One free parameter before and after; ``ci95`` of the value after, ``at_bound`` if it rests on a bound."""

    name: str
    unit: str
    before: float
    after: float
    ci95: tuple[float, float]
    at_bound: bool = False
    meaning: str = ""


@dataclass(frozen=True)
class Coefficient:
    """One coefficient of a found effect with its 95 % interval."""

    name: str
    value: float
    unit: str
    ci95: tuple[float, float]


@dataclass(frozen=True)
class FoundEffect:
    """An effect that was added: what it is, where, its law, and how sure that is (name of a measure, its value)."""

    name: str
    element: str
    junction: str
    law: str
    coefficients: tuple[Coefficient, ...]
    evidence: tuple[tuple[str, str], ...] = ()
    meaning: str = ""


@dataclass(frozen=True)
class Tried:
    """One alternative that was considered; ``delta_nll`` is the gain of log-likelihood in nats."""

    name: str
    junction: str
    delta_nll: float
    why: str
    chosen: bool = False
    indistinguishable: bool = False
    separate: str = ""


@dataclass(frozen=True)
class Power:
    """The smallest size of an effect that the logs would have shown; infinite where none would."""

    effect: str
    junction: str
    size: float
    unit: str


@dataclass(frozen=True)
class Step:
    """One decision on the way: its round, what was done to what, and why."""

    round: int
    action: str
    what: str
    why: str


def rmse(difference: FloatArray) -> float:
    """Root of the mean square, NaN entries left out; NaN if nothing is left.

    Examples
    --------
    >>> round(rmse(np.array([3.0, np.nan, 4.0])), 4)
    3.5355
    """
    finite = difference[np.isfinite(difference)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else float("nan")


def channel_errors(series: Sequence[ChannelSeries]) -> tuple[ChannelError, ...]:
    """The errors of each series, from its measurements and predictions.

    Examples
    --------
    >>> time = np.arange(3.0)
    >>> speed = ChannelSeries("run", "v", "m/s", time, time, Prediction(simulated=time + 2), Prediction(simulated=time))
    >>> (row,) = channel_errors([speed])
    >>> row.simulation_before, row.simulation_after
    (2.0, 0.0)
    """

    def error(one: ChannelSeries, predicted: FloatArray | None) -> float:
        return float("nan") if predicted is None else rmse(one.measured - predicted)

    def interval(one: ChannelSeries, predicted: FloatArray | None) -> tuple[float, float]:
        return (float("nan"),) * 2 if predicted is None else rms_interval(one.measured - predicted)

    rows = []
    for one in series:
        after = one.after or Prediction()
        rows.append(
            ChannelError(
                one.log, one.channel, one.unit, one.held_out,
                error(one, one.before.one_step), error(one, after.one_step),
                error(one, one.before.simulated), error(one, after.simulated), one.noise_std,
                int(np.isfinite(one.measured).sum()),
                interval(one, after.one_step), interval(one, after.simulated),
            )
        )  # fmt: skip
    return tuple(rows)
