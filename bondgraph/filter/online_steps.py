"""A filter over one interval at a time: the compiled kernel of whole logs, or its numpy form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.filter import kernel
from bondgraph.filter.belief import Belief, Prediction, predict, update
from bondgraph.filter.compiled import CompiledFilter, filter_rules, scratch
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.kernel_record import Record
from bondgraph.filter.kernel_types import Log, Members, Part, Verdicts
from bondgraph.filter.online_interval import as_samples
from bondgraph.filter.samples import Samples
from bondgraph.filter.ukf import Member, measurement, transition
from bondgraph.simulate.outcome import OUTCOMES, Outcome


class Moved(NamedTuple):
    """What an interval gives: the belief before and after its measurement, what was expected, what was said.

    Means (n_s,), covariances and the lower factor of the last (n_s, n_s); outputs (n_y,) and (n_y, n_y).
    """

    outcome: Outcome
    nll: float
    predicted_mean: FloatArray
    predicted_cov: FloatArray
    output_mean: FloatArray
    output_cov: FloatArray
    whitened: FloatArray
    log_scales: FloatArray
    mean: FloatArray
    cov: FloatArray
    lower: FloatArray


class StepEngine(Protocol):
    """Moves a belief over an interval."""

    def first(self, log: Log, noise_cov: FloatArray) -> Moved:
        """The update of the prior with a first sample."""

    def move(self, log: Log, mean: FloatArray, lower: FloatArray, noise_cov: FloatArray) -> Moved:
        """The belief after the interval and its measurement, whose noise has the covariance ``noise_cov``."""


@dataclass(frozen=True)
class NumpySteps:
    """The numpy filter over intervals."""

    filter_model: FilterModel
    member: Member

    def first(self, log: Log, noise_cov: FloatArray) -> Moved:
        """As :class:`StepEngine` says."""
        member, lower = self.member, self.member.initial_lower
        start = self.filter_model.start_mean(member.theta, member.x0)
        belief = Belief(start, lower @ lower.T, lower)
        return self._updated(as_samples(log), Prediction(belief, np.empty((0, 0)), 0, Outcome.OK), noise_cov)

    def move(self, log: Log, mean: FloatArray, lower: FloatArray, noise_cov: FloatArray) -> Moved:
        """As :class:`StepEngine` says."""
        cov, samples = self.member.process_cov, as_samples(log)
        prediction = Prediction(Belief(mean, lower @ lower.T, lower), np.empty((0, 0)), 0, Outcome.OK)
        with np.errstate(all="ignore"):  # what overflows is told by the outcome
            for k in range(1, samples.time.size):
                if samples.time[k] == samples.time[k - 1]:
                    continue
                belief = prediction.belief
                if samples.noise_start[k - 1] > 0.0:
                    belief = Belief.of(belief.mean, belief.cov + cov * samples.noise_start[k - 1])
                move = transition(self.filter_model, samples, k, self.member.theta)
                prediction = predict(belief, move, cov * samples.noise_end[k - 1], self.filter_model.points)
                if prediction.outcome is not Outcome.OK:
                    break
            return self._updated(samples, prediction, noise_cov)

    def _updated(self, samples: Samples, prediction: Prediction, noise_cov: FloatArray) -> Moved:
        model, last = self.filter_model, samples.time.size - 1
        measure = measurement(model, samples, last, self.member.theta)
        done = update(prediction.belief, samples.y[:, last], measure, noise_cov, model.points, model.robustness)
        failed = prediction.outcome if prediction.outcome is not Outcome.OK else done.outcome
        before, after = prediction.belief, done.belief
        return Moved(
            failed, -done.log_likelihood, before.mean, before.cov, done.output_mean, done.output_cov, done.whitened,
            done.log_scales, after.mean, after.cov, after.lower,
        )  # fmt: skip


class _Call(NamedTuple):
    """A call of the kernel that is ready but for the contents of its arrays."""

    run: Callable[[], None]
    part: Part
    kept: tuple[FloatArray, ...]


class CompiledSteps:
    """The compiled kernel over intervals, with scratch of its own: one object serves one thread."""

    def __init__(self, filter_model: FilterModel, member: Member) -> None:
        compiled = CompiledFilter.of(filter_model)
        lanes = compiled.lanes
        vectors = (member.theta, member.x0, member.initial_lower, member.process_cov, member.noise_cov)
        self.filter_model = filter_model
        self._run = compiled.filter_members
        self._equations = kernel.Equations(lanes.prepare, lanes.advance, lanes.measure)
        self._rules, self._work = filter_rules(filter_model, lanes), scratch(filter_model, lanes, 1)
        self._members = Members(*(np.array(one, dtype=np.float64, order="C")[..., np.newaxis] for one in vectors))
        self._verdicts = Verdicts(np.zeros(1), *(np.zeros(1, dtype=np.int64) for _ in range(3)))
        self._calls: dict[int, _Call] = {}

    def first(self, log: Log, noise_cov: FloatArray) -> Moved:
        """As :class:`StepEngine` says."""
        return self._moved(self._call(log, 0), noise_cov)

    def move(self, log: Log, mean: FloatArray, lower: FloatArray, noise_cov: FloatArray) -> Moved:
        """As :class:`StepEngine` says."""
        call = self._call(log, 1)
        call.part.mean[:, 0] = mean
        call.part.lower[..., 0] = lower
        return self._moved(call, noise_cov)

    def _moved(self, call: _Call, noise_cov: FloatArray) -> Moved:
        self._members.noise_cov[..., 0] = noise_cov
        verdicts = self._verdicts
        verdicts.nll[0] = 0.0
        verdicts.outcome[0] = 0
        call.run()
        outcome, nll = OUTCOMES[verdicts.outcome[0]], float(verdicts.nll[0])
        return Moved(outcome, nll, *(one.copy() for one in (*call.kept, call.part.lower[..., 0])))

    def _call(self, log: Log, begin: int) -> _Call:
        """The call for an interval; those of one shape come in the same arrays."""
        if id(log) not in self._calls:
            n_s, nodes = len(self.filter_model.state_names), log.time.size - 1
            part = Part(begin, nodes, np.zeros((n_s, 1)), np.zeros((n_s, n_s, 1)))
            record = _record(self.filter_model, nodes)
            run = self._run.prepared(
                self._equations, log, self._rules, self._members, 0, 1, part, self._verdicts, record,
                self._work,
            )  # fmt: skip
            arrays = (
                record.predicted_mean, record.predicted_cov, record.output_mean, record.output_cov, record.whitened,
                record.log_scales, record.filtered_mean, record.filtered_cov,
            )  # fmt: skip
            self._calls[id(log)] = _Call(run, part, tuple(one[..., nodes - 1, 0] for one in arrays))
        return self._calls[id(log)]


def _record(filter_model: FilterModel, nodes: int) -> Record:
    n_s, n_y = len(filter_model.state_names), len(filter_model.model.outputs)
    sizes: dict[str, tuple[int, ...]] = {
        "whitened": (n_y,), "log_scales": (n_y,), "predicted_mean": (n_s,), "predicted_cov": (n_s, n_s),
        "filtered_mean": (n_s,), "filtered_cov": (n_s, n_s), "cross_cov": (n_s, n_s), "output_mean": (n_y,),
        "output_cov": (n_y, n_y),
    }  # fmt: skip
    arrays: dict[str, Any] = {name: np.zeros((*size, nodes, 1)) for name, size in sizes.items()}
    return Record(2, **arrays)
