"""The report of a chain of corrections: the toolkit's own, of the model that a chain began with and that it ended with.

Errors of free simulation before and after, parameters with their intervals, every decision with its reason, what else
was tried, and the drawn graph with what was added.
"""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bondgraph.build import build
from bondgraph.data.log import Log, MatchedLog
from bondgraph.data.matching import match
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.estimate.fitted import Fit
from bondgraph.report.collect import Runs, added_nodes, channel_series, parameter_changes, versions
from bondgraph.report.declared import drawing_of
from bondgraph.report.html import Provenance, ReportData
from bondgraph.report.series import ChannelSeries, Step, Tried, channel_errors
from bondgraph.simulate.model import Model
from bondgraph.simulate.trajectory import Trajectory

#: Half the width of a 95 % interval in standard deviations.
_HALF_WIDTH = 1.96


@dataclass(frozen=True)
class Command:
    """How a command of the examples was called, for the end of its report."""

    name: str
    arguments: Sequence[str]
    begun: float = field(default_factory=time.monotonic)

    def made(self, training: Sequence[Log] = (), held_out: Sequence[Log] = (), seed: int | None = None) -> Provenance:
        """How the report was made, with the logs that were read."""
        line = shlex.join(["python", "-m", f"vehicle_graphs.{self.name}", *self.arguments])
        read, unseen = (tuple(Path(log.source or log.name).name for log in logs) for logs in (training, held_out))
        return Provenance(line, seed, versions(), read, unseen, time.monotonic() - self.begun)


@dataclass(frozen=True)
class Fitted:
    """A declared graph with fitted values, and the 95 % intervals of those that have one."""

    graph: BondGraph
    values: Mapping[str, float]
    ci95: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    at_bound: tuple[str, ...] = ()


def intervals(fit: Fit) -> dict[str, tuple[float, float]]:
    """95 % intervals of a fit by name, from the curvature of its likelihood; what rests on a bound has none."""
    problem = fit.problem
    reach = np.array([_HALF_WIDTH * fit.std[name] for name in problem.names])
    ends = (np.clip(fit.point + sign * reach, problem.lower, problem.upper) for sign in (-1.0, 1.0))
    lower, upper = (problem.values(end) for end in ends)
    return {
        name: (float(low), float(high))
        for name, low, high, held in zip(problem.names, lower, upper, fit.held, strict=True)
        if not held
    }


def held(fit: Fit) -> tuple[str, ...]:
    """Names of the parameters that rest on a bound."""
    return tuple(name for name, rests in zip(fit.problem.names, fit.held, strict=True) if rests)


def chain_report(
    title: str,
    before: Fitted,
    after: Fitted,
    logs: tuple[Sequence[Log], Sequence[Log]],
    simulated: Callable[[Model, Mapping[str, float], MatchedLog], Trajectory],
    history: Sequence[Step],
    made: Provenance,
    *,
    tried: Sequence[Tried] = (),
    notes: Sequence[str] = (),
) -> ReportData:
    """The report of a chain as plain values.

    Parameters
    ----------
    title
        Of the machine.
    before, after
        The fitted graphs with which the chain began and ended; both have the same outputs.
    logs
        For training, and held out.
    simulated
        Free simulation of a model at values along a log.
    history
        What was added in every step, and why.
    made
        Command and logs.
    tried
        What else was tried in the last step.
    notes
        Caveats.
    """
    models = [build(one.graph).model for one in (before, after)]
    series: list[ChannelSeries] = []
    for group, is_held_out in zip(logs, (False, True), strict=True):
        for log in group:
            earlier, later = (
                Runs(None, simulated(model, one.values, match(log, model)))
                for model, one in zip(models, (before, after), strict=True)
            )
            series += channel_series(models[1], match(log, models[1]), earlier, later, held_out=is_held_out)
    count = sum(one.action == "added" for one in history)
    added = ", ".join(one.what for one in history if one.action == "added")
    return ReportData(
        title=title,
        verdict="effect found" if count else "no missing effect",
        explanation=f"Added one by one: {added}." if count else "Nothing that was tried was worth its parameters.",
        errors=channel_errors(series),
        series=tuple(series),
        drawing=drawing_of(assign_causality(after.graph)),
        added=added_nodes(before.graph, after.graph),
        alternatives=tuple(tried),
        parameters=parameter_changes(models[1], before.values, after.values, after.ci95, after.at_bound),
        history=tuple(history),
        notes=tuple(notes),
        made=made,
        subtitle="The graph with which the chain began and that with which it ended, both fitted to the training logs.",
    )
