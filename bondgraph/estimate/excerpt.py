"""The beginning of long logs: a search far from its optimum learns as much there as from all, and sooner.

Each log is cut to the same share of its samples, from its start: there the state is known best, and a launch shows more
of a machine than any other part. What a fit reports is always of the whole.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar, cast

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.data.select import beginnings
from bondgraph.estimate.joint import Problem

ProblemT = TypeVar("ProblemT", bound=Problem)

#: Samples, over all logs, that a search far from its optimum looks at.
ENOUGH = 1600
#: Logs that are longer than that by less than this factor are taken whole.
_WORTH = 1.5


def excerpt(
    problem: ProblemT, enough: float = ENOUGH, least: int = 1, *, every_channel: bool = True
) -> ProblemT | None:
    """The same problem on the beginnings of its logs; None where that would save or show too little.

    Parameters
    ----------
    problem
        The problem on whole logs.
    enough
        Samples over all logs.
    least
        Samples of each log, where it has them.
    every_channel
        Logs are taken whole where a channel of theirs is not measured in their beginning. A swarm, whose cost must stay
        within bounds, does without it.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.estimate.problem import pose
    >>> from bondgraph.filter.filter_model import FilterModel
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1})
    >>> time = np.arange(4000) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 4000)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> problem = pose(swing, log, ["length"])
    >>> len(excerpt(problem, 1000).logs[0]), excerpt(problem, 3000)
    (1000, None)
    """
    share = enough / sum(len(log) for log in problem.logs)
    if share * _WORTH >= 1.0:
        return None
    parts = []
    for part in problem.parts:
        logs = beginnings(part.logs, share, least)
        seen, whole = ([np.isfinite(log.y).any(axis=1).tolist() for log in given] for given in (logs, part.logs))
        if every_channel and seen != whole:
            return None
        parts.append(replace(part, logs=logs))
    return cast(ProblemT, problem.with_parts(parts))


def on_beginnings(problem: Problem, point: FloatArray) -> float:
    """The negative log-likelihood of the beginnings of the logs at a point (n,); of all of them where these are short.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.estimate.problem import pose
    >>> from bondgraph.filter.filter_model import FilterModel
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1})
    >>> time = np.arange(100) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 100)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> problem = pose(swing, log, ["length"])
    >>> on_beginnings(problem, problem.start) == float(problem.nll(problem.start[:, np.newaxis])[0])
    True
    """
    return float((excerpt(problem) or problem).nll(point[:, np.newaxis])[0])
