"""A fitted model: its optimum with everything that tests and reports need of it."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.estimate.derivatives.linearised import expansion_along
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.objective import BoolArray, Expansion, SearchOutcome
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import unknown_drives
from bondgraph.estimate.solvers.steps import held_at_walls, newton_decrement
from bondgraph.estimate.symmetric import scaled_eigen
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.linear.response import LinearLog, linearise
from bondgraph.filter.runs import run
from bondgraph.simulate.model import Model
from bondgraph.text import few

#: Process noise this share of the way up from its lower bound stands in for nothing.
_LITTLE = 0.2


@dataclass(frozen=True, repr=False)
class Fit:
    """A fitted model: the problem, the coordinates of its optimum, and the expansion of the likelihood there."""

    problem: EstimationProblem
    point: FloatArray
    nll: float
    expansion: Expansion
    evaluations: int
    outcome: SearchOutcome

    def __repr__(self) -> str:
        end = f"NLL {self.nll:.6g}; {self.outcome.value.partition(' - ')[0]}"
        return f"<Fit {self.problem.filter_model.model.name}: free {few(self.problem.names)}; {end}>"

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name, in the units of the model."""
        return dict(zip(self.problem.names, map(float, self.problem.values(self.point)), strict=True))

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of the coordinates by name (of the logarithm, where that is the coordinate).

        What rests on a bound counts as known to the others; its own is that which it would have given the others.
        """
        free = ~self.held
        std = np.array(standard_deviations(self.expansion))
        std[free] = standard_deviations(restricted(self.expansion, free))
        return dict(zip(self.problem.names, map(float, std), strict=True))

    @property
    def held(self) -> BoolArray:
        """Which coordinates rest on a bound beyond which the likelihood would still rise, shape (n,)."""
        return held_at_walls(self.problem, self.point, self.expansion.gradient)

    @property
    def theta(self) -> FloatArray:
        """Parameters of the model at the optimum, shape (n_theta,)."""
        theta: FloatArray = self.problem.batch(self.point[:, np.newaxis]).theta[:, 0]
        return theta

    def theta_of(self, model: Model) -> FloatArray:
        """Parameters of another model, shape (n_theta,): estimates where it has them, else declared values."""
        own = dict(zip(self.problem.filter_model.model.names("parameter"), map(float, self.theta), strict=True))
        known = model.names("parameter")
        return model.theta(**{name: value for name, value in own.items() if name in known})

    @property
    def elsewhere(self) -> FilterModel:
        """The filter for logs whose starts were not estimated: it is as unsure of them as the priors were."""
        wide = {one.target.name: one.prior_std for one in self.problem.free if one.target.log and one.prior_std}
        own = self.problem.filter_model
        return replace(own, initial_std={**own.initial_std, **wide}) if wide else own

    @functools.cached_property
    def begun(self) -> Mapping[str, tuple[float, float]]:
        """Where the starts of single logs were estimated, by state: their mean, and how far from it another log begins.

        Of several logs that is the standard deviation of one more like them, of one what was assumed of it.
        """
        found: dict[str, list[FreeParameter]] = {}
        for one in self.problem.free:
            if one.target.kind == "x0" and one.target.log and one.prior_std:
                found.setdefault(one.target.name, []).append(one)
        begun = {}
        for state, own in found.items():
            values = np.array([self.values[one.name] for one in own])
            assumed = max(one.prior_std or 0.0 for one in own)
            spread = float(np.std(values, ddof=1) * np.sqrt(1.0 + 1.0 / values.size)) if values.size > 1 else assumed
            std = max(spread, *(self.std[one.name] for one in own))
            begun[state] = (float(values.mean()), min(std, assumed))
        return begun

    @functools.cached_property
    def own_runs(self) -> tuple[FilterRun, ...]:
        """The filter over the logs that were fitted, at the optimum: many ask for it, and it is costly."""
        return tuple(self._filtered(self.problem.logs))

    @functools.cached_property
    def linear_logs(self) -> tuple[LinearLog, ...]:
        """The filter linearised along its runs over the logs that were fitted: many ask for it, and it is costly."""
        pairs = zip(self.own_runs, self.problem.logs, strict=True)
        return tuple(linearise(one.raise_if_failed(), log, self.theta) for one, log in pairs)

    @functools.cached_property
    def with_other_steps(self) -> dict[tuple[object, ...], Fit]:
        """The same fit with other integration steps, as far as somebody has made it."""
        return {}

    @functools.cached_property
    def linear_promise(self) -> float:
        """Nats that one more step promises by the filter of a stiff model, linearised along itself."""
        expansion = expansion_along(self.problem, self.point, self.own_runs, self.linear_logs)
        return newton_decrement(self.problem, self.point, expansion)

    @functools.cached_property
    def driven(self) -> float:
        """Nats that the fit loses where process noise that drives its states falls to its lower bounds.

        None is lost where it is hardly more than these (logarithms). A state that walks anyway, the slope of an unknown
        road, does not count.
        """
        problem = self.problem
        walking = unknown_drives(problem.filter_model.model, problem.logs)
        counted = np.array([one.target.kind == "process" and one.target.name not in walking for one in problem.free])
        risen = (self.point - problem.lower) / (problem.upper - problem.lower)
        if not np.any(risen[counted] > _LITTLE):
            return 0.0
        lowered = np.where(counted, problem.lower, self.point)
        return float(problem.nll(lowered[:, np.newaxis])[0]) - self.nll

    def fits(self, logs: Sequence[MatchedLog]) -> bool:
        """True for the logs that were fitted."""
        own = self.problem.logs
        return len(logs) == len(own) and all(one is other for one, other in zip(logs, own, strict=True))

    def runs(self, logs: Sequence[MatchedLog]) -> list[FilterRun]:
        """The filter over logs (these or others) at the optimum."""
        if self.fits(logs):
            return list(self.own_runs)
        return self._filtered(logs) if logs else []

    def _filtered(self, logs: Sequence[MatchedLog]) -> list[FilterRun]:
        names = {log.name for log in logs}
        own = names <= {parameter.target.log for parameter in self.problem.free}
        filter_model, begun = self.problem.filter_model, {} if own else self.begun
        if begun:
            wide = {name: std for name, (_, std) in begun.items()}
            filter_model = replace(filter_model, initial_std={**filter_model.initial_std, **wide})
        rows = [filter_model.model.index("state", name) for name in begun]
        middle = [mean for mean, _ in begun.values()]
        kept = [k for k, one in enumerate(self.problem.free) if one.target.log is None or one.target.log in names]
        free = tuple(self.problem.free[k] for k in kept)
        problem = EstimationProblem(filter_model, tuple(logs), free, self.problem.initial)
        batch = problem.batch(self.point[kept][:, np.newaxis])
        for x0 in batch.x0:
            x0[rows, 0] = middle
        return [
            run(
                problem.filter_model, log, batch.theta[:, 0],
                noise_std=batch.noise_std[:, 0], process_std=batch.process_std[:, 0], x0=x0[:, 0],
            )
            for log, x0 in zip(logs, batch.x0, strict=True)
        ]  # fmt: skip


def at_optimum(fitted: Fit) -> tuple[FreeParameter, ...]:
    """The free parameters of a fit, starting from its optimum."""
    values = fitted.values
    return tuple(
        replace(parameter, start=min(max(values[parameter.name], parameter.lower), parameter.upper))
        for parameter in fitted.problem.free
    )


def restricted(expansion: Expansion, kept: BoolArray) -> Expansion:
    """The expansion in some of its coordinates, the others held."""
    terms = expansion.terms
    if terms is not None:
        columns = np.flatnonzero(np.concatenate([[True], kept]))
        terms = terms.members(columns)
    return Expansion(expansion.gradient[kept], expansion.information[np.ix_(kept, kept)], expansion.evaluations, terms)


def standard_deviations(expansion: Expansion) -> FloatArray:
    """Standard deviations from the Fisher information, shape (n,); infinite where there is none."""
    found = scaled_eigen(expansion.information)
    inverse = found.inverse(found.values > 1e-12 * max(found.largest, np.finfo(float).tiny))
    known = found.scale > 0.0
    std: FloatArray = np.where(known, found.scale * np.sqrt(np.maximum(np.diag(inverse), 0.0)), np.inf)
    return std
