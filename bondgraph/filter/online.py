"""A filter that takes its samples one by one, as they come, and gives the numbers of a log filtered as a whole.

A step is the recursion of :mod:`bondgraph.filter.kernel` over one interval, so that a stream has the bits that
:func:`bondgraph.filter.runs.run` gives for the same samples in a log, gaps and missing channels included. Several
samples of one time update the belief one after the other. A sample that is older than the latest one is refused, or,
within a declared time, taken in: the filter goes back to the belief before it, and over all later samples again.
"""

from __future__ import annotations

import bisect
import hashlib
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.compile.machine_code import has_numba
from bondgraph.errors import FilterError
from bondgraph.filter.adaptive import AdaptiveNoise, NoiseBelief, updated
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.online_given import check_options, given_inputs, given_member, given_outputs
from bondgraph.filter.online_interval import Intervals
from bondgraph.filter.online_state import FilterStep, OnlineState, Remembered
from bondgraph.filter.online_steps import CompiledSteps, Moved, NumpySteps, StepEngine
from bondgraph.filter.samples import MeasuredLog
from bondgraph.simulate.late import inputs_of
from bondgraph.simulate.outcome import Outcome

if TYPE_CHECKING:
    from bondgraph.simulate.task import Vector


class OnlineFilter:
    """An unscented Kalman filter over a stream of samples.

    Parameters
    ----------
    filter_model
        Model and noises. Its method must be decided (not ``"auto"``); steps that were planned along logs are not used.
    theta
        Parameters by name or as a vector (n_theta,); None: declared values.
    interval
        Usual time between samples, s, which decides the integration steps as the median interval of a log does; None:
        the first interval.
    x0
        Mean initial states by name or as a vector (n_x,); None: declared ones.
    history
        Time for which samples are remembered, s, so that later ones may come before them; zero refuses all late ones.
        A late sample costs as much as all remembered ones after it.
    adaptive
        Follow the noise levels of the sensors, see :class:`bondgraph.filter.adaptive.AdaptiveNoise`.
    compiled
        Use the compiled kernel (and numpy where numba is missing), or numpy. One object serves one thread.

    Raises
    ------
    FilterError, ModelError
        If the method is not decided, a name is unknown, a shape does not fit, or a number is impossible.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> online = bg.OnlineFilter(swing, interval=0.05, history=0.2, compiled=False)
    >>> for k in range(8):
    ...     step = online.step(0.05 * k, {"drive": 0.0}, {"deflection": 0.1 * np.cos(0.15 * k)})
    >>> step.mean.round(2), step.accepted
    (array([ 0.05, -0.34]), True)
    >>> online.step(0.22, y={"deflection": 0.08}).replayed
    3
    """

    def __init__(
        self,
        filter_model: FilterModel,
        theta: Vector = None,
        *,
        interval: float | None = None,
        x0: Vector = None,
        history: float = 0.0,
        adaptive: AdaptiveNoise | None = None,
        compiled: bool = True,
    ) -> None:
        check_options(filter_model, interval, history, adaptive)
        self.filter_model = filter_model
        self.member = given_member(filter_model, theta, x0)
        self.history, self.adaptive = float(history), adaptive
        fast = compiled and has_numba()
        engine = CompiledSteps if fast else NumpySteps
        self._engine: StepEngine = engine(filter_model, self.member)
        self._intervals = Intervals.of(filter_model, math.nan if interval is None else float(interval), fast)
        self._remembered: list[Remembered] = []

    def __repr__(self) -> str:
        when = f"at {self.time:.6g} s" if self._remembered else "no sample yet"
        return f"<OnlineFilter {self.filter_model.model.name}: {when}>"

    @property
    def time(self) -> float:
        """Time of the latest sample, s; NaN before the first."""
        return self._remembered[-1].time if self._remembered else math.nan

    @property
    def nll(self) -> float:
        """Negative log-likelihood of all accepted samples."""
        return self._remembered[-1].nll if self._remembered else 0.0

    @property
    def state(self) -> OnlineState:
        """All that was learnt so far, to be saved or given to another filter of the same model."""
        return OnlineState(self._digest, self._intervals.interval, tuple(self._remembered))

    def restore(self, state: OnlineState) -> None:
        """Go on from a state.

        Raises
        ------
        FilterError
            If it is that of another filter model, or of other parameters.
        """
        if state.digest != self._digest:
            raise FilterError(
                f"{self.filter_model.model.name}: the state belongs to another filter model or other parameters"
                " - restore it into the filter it was taken from",
                where=(self.filter_model.model.name,),
            )
        self._remembered = list(state.remembered)
        if state.interval != self._intervals.interval:
            self._intervals = replace(self._intervals, interval=state.interval)

    def adopt(self, state: OnlineState) -> None:
        """Go on from what a filter of the same model with other parameters believes; the sum of its nll is kept.

        Raises
        ------
        FilterError
            If its states are others.
        """
        size = len(self.filter_model.state_names)
        if any(one.mean.size != size for one in state.remembered):
            raise FilterError(f"{self.filter_model.model.name}: the state belongs to a filter with other states")
        self._remembered = list(state.remembered)

    def step(self, t: float, u: Vector = None, y: Vector = None) -> FilterStep:
        """Take a sample.

        Parameters
        ----------
        t
            Its time, s.
        u
            Inputs at that time, by name or as a vector (n_u,), coherent SI; those not given keep their value, before
            the first sample their default. A late sample takes them from those around it.
        y
            Measured outputs, by name or as a vector (n_y,), coherent SI; NaN or not named where missing.

        Returns
        -------
        FilterStep
            A sample that is too late, or with which the filter would fail, is not accepted and changes nothing.

        Raises
        ------
        FilterError
            If the time or an input is not finite, a name is unknown, a shape does not fit, or a channel is measured
            whose noise is not declared.
        """
        name = self.filter_model.model.name
        if not math.isfinite(t):
            raise FilterError(f"{name}: step at t = {t!r} - give a finite time", where=(name, "t"))
        time, measured = float(t), given_outputs(self.filter_model.model, self.member.noise_std, y)
        if self._remembered and time < self.time:
            return self._late(time, u, measured)
        return self._append(
            time,
            given_inputs(self.filter_model.model, u, self._remembered[-1].u if self._remembered else None),
            measured,
        )

    def follow(self, log: MeasuredLog) -> FilterRun:
        """Take all samples of a log as a stream, and keep what each gave.

        Raises
        ------
        FilterError
            If the log does not fit the model, or a sample is not accepted.

        Examples
        --------
        >>> import bondgraph as bg
        >>> from bondgraph.simulate.example import pendulum
        >>> swing = bg.FilterModel(
        ...     pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1, "length": 0.1}, 2,
        ...     appended={"length": 0.01},  # per sqrt(s): it drifts
        ... )
        >>> time = np.arange(40) * 0.05
        >>> log = bg.MatchedLog("swing", time, np.zeros((1, 40)), 0.1 * np.cos(3.1 * time)[np.newaxis])
        >>> run = bg.OnlineFilter(swing, interval=0.05, compiled=False).follow(log)
        >>> run.plot("length").get_ylabel()
        'length [m]'
        """
        known = self.filter_model.model.theta(**dict(log.theta_overrides))
        rows = [self.filter_model.model.index("parameter", name) for name in log.theta_overrides]
        if np.any(known[rows] != self.member.theta[rows]):
            raise FilterError(
                f"{log.name}: the log knows {', '.join(log.theta_overrides)}, and the filter has other values"
                " - make the filter with theta as the log has it",
                where=(log.name, *log.theta_overrides),
            )
        steps, u = [], inputs_of(self.filter_model.model, log)
        for k, t in enumerate(log.time):
            steps.append(self.step(float(t), u[:, k], log.y[:, k]))
            if not steps[-1].accepted:
                raise FilterError(f"{log.name}: the sample at {t:.6g} s is not accepted: {steps[-1].reason}")

        def stacked(name: str) -> FloatArray:
            return np.stack([getattr(step, name) for step in steps], axis=-1)

        cov = stacked("cov")
        return FilterRun(
            self.filter_model, log.name, np.array(log.time), np.array(log.y), stacked("predicted_mean"),
            stacked("predicted_cov"), stacked("mean"), cov, np.full_like(cov, np.nan), stacked("output_mean"),
            stacked("output_cov"), stacked("whitened"), stacked("log_scales"), 0, Outcome.OK, float(log.time[-1]),
        )  # fmt: skip

    def _append(self, time: float, u: FloatArray, y: FloatArray) -> FilterStep:
        """Take a sample that is not older than the latest one."""
        if self._remembered and math.isnan(self._intervals.interval) and time > self.time:
            self._intervals = replace(self._intervals, interval=time - self.time, _shapes={})
        moved, noise, u_end = self._moved(time, u, y)
        step = self._told(time, y, moved, noise)
        if moved.outcome is not Outcome.OK:
            return self._refused(step, moved.outcome.value.partition(" - ")[0], moved.outcome)
        nll = self.nll + moved.nll
        self._remembered.append(Remembered(time, u_end, y, moved.mean, moved.lower, nll, noise))
        self._forget()
        return step

    def _forget(self) -> None:
        """Keep what late samples may need: those within the history, and the belief before them."""
        oldest = bisect.bisect_left(self._remembered, self.time - self.history, key=lambda one: one.time)
        del self._remembered[: max(oldest - 1, 0) if self.history else -1]

    def _moved(self, time: float, u: FloatArray, y: FloatArray) -> tuple[Moved, NoiseBelief | None, FloatArray]:
        """The belief after a sample, that of the sensors, and the inputs at its time."""
        noise = self._faded(time)
        cov = self.member.noise_cov if noise is None else np.diag(noise.variance)
        silent = y if noise is None else np.full_like(y, np.nan)
        if not self._remembered:
            log = self._intervals.first(time, u, silent)
            moved = self._engine.first(log, cov)
        else:
            last = self._remembered[-1]
            log = self._intervals.between(last.time, last.u, time, u, silent)
            moved = self._engine.move(log, last.mean, last.lower, cov)
            if moved.outcome is Outcome.DIVERGED:  # as a member of a batch, with every step cut in two
                log = self._intervals.between(last.time, last.u, time, u, silent, finer=2)
                moved = self._engine.move(log, last.mean, last.lower, cov)
        u_end = log.u[-1].copy()
        if noise is None or moved.outcome is not Outcome.OK:
            return moved, noise, u_end
        known = updated(noise, y, moved.output_mean, moved.output_cov - cov)
        log = self._intervals.between(time, u_end, time, u_end, y)
        after = self._engine.move(log, moved.mean, moved.lower, np.diag(known.variance))
        return after._replace(predicted_mean=moved.mean, predicted_cov=moved.cov), known, u_end

    def _faded(self, time: float) -> NoiseBelief | None:
        """What is believed of the sensors' noise before a sample; None where their levels are declared."""
        if self.adaptive is None:
            return None
        if not self._remembered:
            return self.adaptive.start(self.member.noise_std, self._intervals.interval)
        noise = self._remembered[-1].noise
        assert noise is not None  # the first sample starts it
        return self.adaptive.faded(noise, time - self.time)

    def _late(self, time: float, u: Vector, y: FloatArray) -> FilterStep:
        """Take a sample that is older than the latest one: go back before it, and over all later ones again."""
        place = bisect.bisect_right(self._remembered, time, key=lambda one: one.time)
        if place == 0 or self.time - time > self.history:
            reason = f"it is {self.time - time:.6g} s late, and samples are remembered for {self.history:g} s"
            return self._refused(self._silent(), reason)
        before, later = self._remembered[:place], self._remembered[place:]
        everything = self._remembered
        self._remembered = before
        samples = [(time, given_inputs(self.filter_model.model, u, self._between(before[-1], later[0], time)), y)]
        for sample in samples + [(one.time, one.u, one.y) for one in later]:
            step = self._append(*sample)
            if not step.accepted:
                self._remembered = everything
                return self._refused(self._silent(), step.reason, step.outcome)
        return replace(step, replayed=len(later))

    def _between(self, before: Remembered, after: Remembered, time: float) -> FloatArray:
        """Inputs (n_u,) at a time between two samples."""
        share = (time - before.time) / (after.time - before.time)
        return before.u + np.where(self._intervals.hold, 0.0, share * (after.u - before.u))

    def _told(self, time: float, y: FloatArray, moved: Moved, noise: NoiseBelief | None) -> FilterStep:
        std = self.member.noise_std if noise is None else np.sqrt(noise.variance)
        return FilterStep(
            time, moved.predicted_mean, moved.predicted_cov, moved.mean, moved.cov, moved.output_mean,
            moved.output_cov, y - moved.output_mean, moved.whitened, moved.log_scales, std,
        )  # fmt: skip

    def _silent(self) -> FilterStep:
        """The belief as it is, with nothing measured."""
        last = self._remembered[-1]
        cov, n_y = last.lower @ last.lower.T, self.member.noise_std.size
        none, zero = np.full(n_y, np.nan), np.zeros(n_y)
        std = self.member.noise_std if last.noise is None else np.sqrt(last.noise.variance)
        return FilterStep(
            last.time, last.mean, cov, last.mean, cov, none, np.full((n_y, n_y), np.nan), none, zero, zero, std
        )

    def _refused(self, step: FilterStep, reason: str, outcome: Outcome = Outcome.OK) -> FilterStep:
        kept = self._silent() if self._remembered else step
        return replace(kept, accepted=False, reason=reason, outcome=outcome)

    @property
    def _digest(self) -> str:
        numbers = b"".join(np.ascontiguousarray(one).tobytes() for one in (self.member.theta, self.member.x0))
        text = f"{self.filter_model.digest} {self.adaptive}"
        return hashlib.sha256(text.encode() + numbers).hexdigest()[:24]
