"""A problem whose members are evaluated by the workers of an executor, for searches that ask many at once.

A search asks for values, terms or derivatives of a batch of members. The batch is cut in blocks of as many members as
the compiled filter takes side by side, whoever computes, and each block is a task. A member's numbers do not depend on
those beside it, so that a search is the same in every bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from bondgraph.compile.lanes.text import LANES
from bondgraph.data.log import MatchedLog
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.likelihoods import Batch, CeilingLikelihood, FilterLikelihood, LikelihoodFunction
from bondgraph.estimate.objective import Below, Expand, Expansion, FloatArray, Objective, Terms
from bondgraph.execute.shared import Shared
from bondgraph.execute.tasks import in_order
from bondgraph.filter.filter_model import FilterModel

#: What a worker evaluates members with: likelihood, filter model and logs.
_Part = tuple[LikelihoodFunction, FilterModel, tuple[MatchedLog, ...]]


@dataclass(frozen=True)
class SpreadLikelihood:
    """A likelihood of which workers evaluate the members."""

    own: LikelihoodFunction
    executor: Executor
    part: Shared[_Part]

    def nll(self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch) -> FloatArray:
        """Negative log-likelihood, shape (members,)."""
        return np.concatenate(in_order(self.executor, _nll, [(self.part, some) for some in _blocks(batch)]))

    def nll_below(
        self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch, ceilings: FloatArray
    ) -> Below:
        """Negative log-likelihood as far as it is below ceilings (members,)."""
        blocks = _blocks(batch)
        tasks = [(self.part, some, ceilings[LANES * k : LANES * (k + 1)]) for k, some in enumerate(blocks)]
        found = in_order(self.executor, _nll_below, tasks)
        return Below(*(np.concatenate([getattr(one, name.name) for one in found]) for name in fields(Below)))

    def terms(self, filter_model: FilterModel, logs: Sequence[MatchedLog], batch: Batch) -> Terms:
        """Scalar terms, rows ordered by log, output, sample."""
        found = in_order(self.executor, _terms, [(self.part, some) for some in _blocks(batch)])
        return Terms(np.hstack([one.innovations for one in found]), np.hstack([one.log_scales for one in found]))


@dataclass(frozen=True)
class SpreadExpand:
    """Derivatives of a problem, those of each point by a worker."""

    own: Expand
    executor: Executor
    problem: Problem

    @cached_property
    def _shared(self) -> Shared[Problem]:
        return Shared.of(self.problem)

    def __call__(self, objective: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
        """Expansions at points (n, members) with difference steps (n, members)."""
        tasks = [(self.own, self._shared, points[:, [m]], steps[:, [m]]) for m in range(points.shape[1])]
        return tuple(in_order(self.executor, _expand, tasks))


def spread(problem: Problem, executor: Executor | None) -> Problem:
    """The problem with members evaluated by workers; as it is without an executor.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1})
    >>> time = np.arange(40) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> problem = bg.pose(swing, log, ["length"])
    >>> points = np.linspace(0.1, 0.9, 40)[np.newaxis]
    >>> with ThreadPoolExecutor(2) as executor:
    ...     bool((spread(problem, executor).nll(points) == problem.nll(points)).all())
    True
    """
    if executor is None:
        return problem
    parts = []
    for part in problem.parts:
        likelihood = part.likelihood
        there = replace(likelihood, threads=1) if isinstance(likelihood, FilterLikelihood) else likelihood
        shared: Shared[_Part] = Shared.of((there, part.filter_model, part.logs))
        parts.append(replace(part, likelihood=SpreadLikelihood(likelihood, executor, shared)))
    return problem.with_parts(parts)


def spread_expand(jacobian: Expand, problem: Problem, executor: Executor | None) -> Expand:
    """Derivatives of a problem as workers compute them; as they are without an executor."""
    return jacobian if executor is None else SpreadExpand(jacobian, executor, problem)


def _blocks(batch: Batch) -> list[Batch]:
    """The members of a batch, a block of them in each."""
    members = batch.theta.shape[1]
    return [_members(batch, slice(first, first + LANES)) for first in range(0, members, LANES)]


def _members(batch: Batch, own: slice) -> Batch:
    some: dict[str, Any] = {
        one.name: np.ascontiguousarray(getattr(batch, one.name)[..., own]) for one in fields(batch) if one.name != "x0"
    }
    return Batch(x0=tuple(np.ascontiguousarray(x0[..., own]) for x0 in batch.x0), **some)


def _nll(shared: Shared[_Part], batch: Batch) -> FloatArray:
    likelihood, filter_model, logs = shared.open()
    return likelihood.nll(filter_model, logs, batch)


def _nll_below(shared: Shared[_Part], batch: Batch, ceilings: FloatArray) -> Below:
    likelihood, filter_model, logs = shared.open()
    if not isinstance(likelihood, CeilingLikelihood):
        return Below.whole(likelihood.nll(filter_model, logs, batch))
    return likelihood.nll_below(filter_model, logs, batch, ceilings)


def _terms(shared: Shared[_Part], batch: Batch) -> Terms:
    likelihood, filter_model, logs = shared.open()
    return likelihood.terms(filter_model, logs, batch)


def _expand(jacobian: Expand, shared: Shared[Problem], point: FloatArray, steps: FloatArray) -> Expansion:
    (found,) = jacobian(shared.open(), point, steps)
    return found
