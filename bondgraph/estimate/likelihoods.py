"""How likely logs are, for many members at once: the likelihoods that an estimation problem can have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Protocol, runtime_checkable

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.free import Target
from bondgraph.estimate.objective import Below, FloatArray, Terms
from bondgraph.filter.batch import run_batches
from bondgraph.filter.ceiling import run_below
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import filtered_share, first_failures, whitened_innovations
from bondgraph.filter.members import MemberValues
from bondgraph.filter.runs import prepared
from bondgraph.simulate.outcome import Outcome


@dataclass(frozen=True)
class Batch:
    """Numbers of several members: theta (n_theta, members), noise_std (n_y, members), process_std (n_s, members).

    ``x0`` has one array (n_x, members) per log; ``initial_std`` (n_s, members), and correlations of the sensors
    (n_y, n_y, members), of process noise and of initial states (n_s, n_s, members).
    """

    theta: FloatArray
    noise_std: FloatArray
    process_std: FloatArray
    x0: tuple[FloatArray, ...]
    initial_std: FloatArray
    noise_correlation: FloatArray
    process_correlation: FloatArray
    initial_correlation: FloatArray

    @classmethod
    def declared(cls, filter_model: FilterModel, starts: Sequence[FloatArray], members: int) -> Batch:
        """The numbers of a filter model, with an initial state (n_x,) per log, for each of several members."""

        def spread(array: FloatArray) -> FloatArray:
            return np.repeat(array[..., np.newaxis], members, axis=-1)

        own = filter_model
        return cls(
            theta=spread(own.model.theta()),
            noise_std=spread(own.noise_std),
            process_std=spread(own.process_std),
            x0=tuple(spread(start) for start in starts),
            initial_std=spread(own.start_std),
            noise_correlation=spread(own.noise_correlations),
            process_correlation=spread(own.process_correlations),
            initial_correlation=spread(own.start_correlations),
        )

    def zeros(self) -> Batch:
        """Zeros of the same shapes."""
        own = {one.name: getattr(self, one.name) for one in fields(self) if one.name != "x0"}
        return Batch(x0=tuple(map(np.zeros_like, self.x0)), **{name: np.zeros_like(a) for name, a in own.items()})

    def written(
        self, filter_model: FilterModel, logs: Sequence[MatchedLog], numbers: Sequence[tuple[Target, FloatArray]]
    ) -> Batch:
        """The same batch after rows (members,) were written into it, each where its target stands."""
        model, outputs, states = filter_model.model, filter_model.model.names("output"), filter_model.state_names
        levels = {"std": self.noise_std, "process": self.process_std, "x0_std": self.initial_std}
        pairs = {
            "corr": self.noise_correlation, "process_corr": self.process_correlation,
            "x0_corr": self.initial_correlation,
        }  # fmt: skip
        for target, row in numbers:
            if target.kind == "parameter":
                self.theta[model.index("parameter", target.name)] = row
            elif target.kind in levels:
                levels[target.kind][(outputs if target.kind == "std" else states).index(target.name)] = row
            elif target.other is not None:
                names = outputs if target.kind == "corr" else states
                i, j = names.index(target.name), names.index(target.other)
                pairs[target.kind][i, j] = pairs[target.kind][j, i] = row
            else:
                for log, start in zip(logs, self.x0, strict=True):
                    if target.log in (None, log.name):
                        start[model.index("state", target.name)] = row
        return self

    def values(self, member: int | None = None) -> MemberValues:
        """What a filter is given beside theta: of all members, or of one."""
        own: slice | int = slice(None) if member is None else member
        return {
            "noise_std": self.noise_std[..., own],
            "process_std": self.process_std[..., own],
            "x0": [x0[..., own] for x0 in self.x0],
            "initial_std": self.initial_std[..., own],
            "noise_correlation": self.noise_correlation[..., own],
            "process_correlation": self.process_correlation[..., own],
            "initial_correlation": self.initial_correlation[..., own],
        }


class LikelihoodFunction(Protocol):
    """How likely logs are, for the members of a batch."""

    def nll(self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch) -> FloatArray:
        """Negative log-likelihood, shape (members,), infinite for members that fail."""

    def terms(self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch) -> Terms:
        """Scalar terms, rows ordered by log, output, sample."""


@runtime_checkable
class CeilingLikelihood(Protocol):
    """A likelihood function that can give up members which cannot come below a ceiling."""

    def nll_below(
        self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch, ceilings: FloatArray
    ) -> Below:
        """Negative log-likelihood as far as it is below ceilings (members,)."""


@dataclass(frozen=True)
class FilterLikelihood:
    """The likelihood by the unscented Kalman filter.

    ``threads`` None uses every core and changes no number; ``compiled`` False filters in plain numpy, slowly.
    """

    threads: int | None = None
    compiled: bool = True

    def nll(self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch) -> FloatArray:
        """Negative log-likelihood, shape (members,)."""
        used, samples, members = prepared(filter_model, logs, batch.theta, batch.values(), self.compiled)
        runs = run_batches(used, samples, members, 0, self.threads, self.compiled)
        values: FloatArray = np.sum([run.verdicts.nll for run in runs], axis=0)
        return values

    def nll_below(
        self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch, ceilings: FloatArray
    ) -> Below:
        """Negative log-likelihood as far as it is below ceilings (members,), see :mod:`bondgraph.filter.ceiling`."""
        used, samples, members = prepared(filter_model, logs, batch.theta, batch.values(), self.compiled)
        runs = run_below(used, samples, members, ceilings, self.threads, self.compiled)
        values: FloatArray = np.sum([run.verdicts.nll for run in runs], axis=0)
        abandoned = np.array([outcome is Outcome.ABANDONED for outcome in first_failures(runs)])
        return Below(values, abandoned, filtered_share(runs))

    def terms(self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch) -> Terms:
        """Scalar terms, rows ordered by log, output, sample."""
        used, samples, members = prepared(filter_model, logs, batch.theta, batch.values(), self.compiled)
        runs = run_batches(used, samples, members, 1, self.threads, self.compiled)
        records, count = [whitened_innovations(run) for run in runs], batch.theta.shape[1]
        return Terms(
            np.concatenate([record.values.reshape(-1, count) for record in records]),
            np.concatenate([record.log_scales.reshape(-1, count) for record in records]),
        )
