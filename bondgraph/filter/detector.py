"""A detector of changes on line: which of some changes has happened to a machine, with a declared rate of false alarms.

For every change a filter with the changed parameters runs beside the nominal one. The sum of their log-likelihood
ratios since it was last below zero (Page's cumulative sum) is the evidence for the change; where it falls below zero
the changed filter starts again from the nominal belief, as if the change happened then. An alarm is raised where the
evidence for a change reaches the threshold, and names the change with the most.

As long as nothing changes, a likelihood ratio has the mean one, whatever it is conditioned on. Each start therefore
reaches the threshold h with a chance of at most exp(-h), and with N changes the mean number of samples to a false alarm
is at least exp(h)/N. The threshold follows from the declared mean time between false alarms without simulation; it
holds as far as the nominal filter is right about its machine.

References: Page (1954), Continuous inspection schemes, Biometrika 41; Lorden (1971), Procedures for reacting to a
change in distribution, Ann. Math. Statist. 42(6), for the bound; Willsky and Jones (1976), A generalized likelihood
ratio approach to the detection and estimation of jumps in linear systems, IEEE Trans. Automatic Control 21(1).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.errors import FilterError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.online import OnlineFilter
from bondgraph.filter.online_state import FilterStep
from bondgraph.filter.samples import MeasuredLog
from bondgraph.frames import frame
from bondgraph.shown import own_axes
from bondgraph.simulate.late import inputs_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

    from bondgraph.simulate.task import Vector


@dataclass(frozen=True, repr=False)
class DetectorStep:
    """What a sample says: the step of the nominal filter, and the evidence for each change, nats.

    ``alarm`` is the change that is named, empty where the evidence for none has reached the threshold.
    """

    step: FilterStep
    evidence: Mapping[str, float]
    alarm: str

    def __repr__(self) -> str:
        return f"<DetectorStep at {self.step.time:.6g} s: {self.alarm or 'no alarm'}>"


class ChangeDetector:
    """Filters of a machine and of its changes over one stream, and the evidence for each change.

    Parameters
    ----------
    filter_model
        Model and noises; its method must be decided.
    changes
        Parameters by name and value after each change, by the name of the change. A change of another size is found
        too if it is more than half as large.
    false_alarm_every
        Mean time between false alarms that is declared, s: at least as long.
    interval
        Time between samples, s.
    theta, x0
        Parameters before any change and mean initial states, by name or as vectors; None: declared ones.
    compiled
        Use the compiled kernel.

    Raises
    ------
    FilterError, ModelError
        If there is no change, a change changes nothing or names no parameter, or a number is impossible.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.02}, {"deflection": 0.01}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> changes = {"longer": {"length": 1.5}, "damped": {"damping": 1.0}}
    >>> detector = bg.ChangeDetector(swing, changes, false_alarm_every=3600.0, interval=0.05, compiled=False)
    >>> round(detector.threshold, 2)  # log(2 changes times 72000 samples)
    11.88
    >>> time = np.arange(120) * 0.05
    >>> before = bg.simulate(swing.model, time[:61], x0={"angle": 0.1})
    >>> after = bg.simulate(swing.model, time[60:], theta={"length": 1.5}, x0=before.x[:, -1])  # from 3 s on
    >>> y = np.hstack([before.y[:, :-1], after.y])
    >>> found = detector.watch(bg.MatchedLog("swing", time, np.zeros((1, 120)), y))
    >>> found.alarm, 3.0 < found.alarm_time < 4.5
    ('longer', True)
    """

    def __init__(
        self,
        filter_model: FilterModel,
        changes: Mapping[str, Mapping[str, float]],
        *,
        false_alarm_every: float,
        interval: float,
        theta: Vector = None,
        x0: Vector = None,
        compiled: bool = True,
    ) -> None:
        self.nominal = OnlineFilter(filter_model, theta, interval=interval, x0=x0, compiled=compiled)
        self._changed = {
            name: OnlineFilter(
                filter_model, _with(filter_model, self.nominal.member.theta, name, values), interval=interval, x0=x0,
                compiled=compiled,
            )
            for name, values in changes.items()
        }  # fmt: skip
        samples = false_alarm_every / interval
        if not changes or not (math.isfinite(samples) and samples > 1.0):
            raise FilterError(
                f"{filter_model.model.name}: {len(changes)} changes with false_alarm_every={false_alarm_every!r} s"
                " - name at least one change, and a time that is longer than the interval between samples",
                where=(filter_model.model.name, "false_alarm_every"),
            )
        #: Evidence at which an alarm is raised, nats.
        self.threshold = math.log(len(changes) * samples)
        self._evidence = dict.fromkeys(changes, 0.0)

    def __repr__(self) -> str:
        names = ", ".join(self._changed)
        return f"<ChangeDetector {self.nominal.filter_model.model.name}: {names}; threshold {self.threshold:.4g}>"

    def step(self, t: float, u: Vector = None, y: Vector = None) -> DetectorStep:
        """Take a sample; arguments as for :meth:`bondgraph.filter.online.OnlineFilter.step`.

        Raises
        ------
        FilterError, ModelError
            As there. A late sample is not accepted and says nothing of any change.
        """
        before = self.nominal.state
        nominal = self.nominal.step(t, u, y)
        if nominal.accepted:
            for name, changed in self._changed.items():
                if self._evidence[name] <= 0.0:
                    changed.adopt(before)
                rival = changed.step(t, u, y)
                gain = rival.log_likelihood - nominal.log_likelihood if rival.accepted else -math.inf
                self._evidence[name] = max(0.0, self._evidence[name] + gain)
        likeliest = max(self._evidence, key=lambda name: self._evidence[name])
        alarm = likeliest if self._evidence[likeliest] >= self.threshold else ""
        return DetectorStep(nominal, dict(self._evidence), alarm)

    def watch(self, log: MeasuredLog, *, until_alarm: bool = False) -> Detection:
        """Take all samples of a log as a stream, or those up to the first alarm.

        Raises
        ------
        FilterError, ModelError
            If the log does not fit the model.
        """
        steps: list[DetectorStep] = []
        u = inputs_of(self.nominal.filter_model.model, log)
        for k, t in enumerate(log.time):
            steps.append(self.step(float(t), u[:, k], log.y[:, k]))
            if until_alarm and steps[-1].alarm:
                break
        evidence = {name: np.array([step.evidence[name] for step in steps]) for name in self._changed}
        first = next((step for step in steps if step.alarm), None)
        return Detection(
            log.name, np.array(log.time[: len(steps)]), evidence, self.threshold, first.alarm if first else "",
            first.step.time if first else math.nan,
        )  # fmt: skip


@dataclass(frozen=True, repr=False)
class Detection:
    """What a detector found in a log: evidence (n,) in nats for each change over time (n,), the first alarm and when.

    ``alarm`` is empty and ``alarm_time`` NaN where there is none.
    """

    log_name: str
    time: FloatArray
    evidence: Mapping[str, FloatArray]
    threshold: float
    alarm: str
    alarm_time: float

    def __repr__(self) -> str:
        return f"<Detection {self.log_name}: {self._found()}>"

    def summary(self) -> str:
        """The first alarm, and the largest evidence for each change."""
        rows = [f"  {name}: evidence up to {np.max(values):.4g} nats" for name, values in self.evidence.items()]
        return "\n".join([f"{self.log_name}: {self._found()}; threshold {self.threshold:.4g} nats", *rows])

    def to_dataframe(self) -> pandas.DataFrame:
        """Evidence for each change over time, columns ``name [nat]``.

        Raises
        ------
        DataError
            If pandas is not installed.
        """
        return frame({f"{name} [nat]": values for name, values in self.evidence.items()}, self.time, "time [s]")

    def plot(self, ax: Axes | None = None) -> Axes:
        """The evidence over time with the threshold and the alarm, on these or on new axes; needs matplotlib."""
        axes = own_axes(ax)
        for name, values in self.evidence.items():
            axes.plot(self.time, np.maximum(values, 0.1), label=name)
        axes.axhline(self.threshold, color="0.3", linestyle="--", label="threshold")
        if self.alarm:
            axes.axvline(self.alarm_time, color="0.6", linewidth=1.0)
            axes.annotate(self.alarm, (self.alarm_time, self.threshold), xytext=(4, 4), textcoords="offset points")
        axes.set(xlabel="time [s]", ylabel="evidence [nat]", yscale="log", title=self.log_name)
        axes.legend(loc="upper left", fontsize="small")
        return axes

    def _found(self) -> str:
        return f"{self.alarm} at {self.alarm_time:.6g} s" if self.alarm else "no alarm"


def _with(filter_model: FilterModel, theta: FloatArray, change: str, values: Mapping[str, float]) -> FloatArray:
    """Parameters (n_theta,) after a change."""
    model = filter_model.model
    after = theta.copy()
    for name, value in values.items():
        row = model.index("parameter", name)
        if row in filter_model.appended_index:
            raise FilterError(
                f"{model.name}: change {change!r} names {name!r}, which the filter follows as a state - choose one",
                where=(model.name, change, name),
            )
        after[row] = value
    if np.array_equal(after, theta):
        raise FilterError(
            f"{model.name}: change {change!r} changes no parameter - give values other than before",
            where=(model.name, change),
        )
    return after
