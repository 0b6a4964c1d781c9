"""The beginning of long logs: a search far from its optimum learns as much there as from all, and sooner.

Each log is cut to the same share of its samples, from its start: there the state is known best, and a launch shows more
of a machine than any other part. What a fit reports is always of the whole.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.data.select import beginnings
from bondgraph.estimate.problem import EstimationProblem

#: Samples, over all logs, that a search far from its optimum looks at.
ENOUGH = 1600
#: Logs that are longer than that by less than this factor are taken whole.
_WORTH = 1.5


def excerpt(problem: EstimationProblem, enough: int = ENOUGH) -> EstimationProblem | None:
    """The same problem on the beginnings of its logs; None where that would save or show too little.

    Parameters
    ----------
    problem
        The problem on whole logs.
    enough
        Samples over all logs.
    """
    share = enough / sum(len(log) for log in problem.logs)
    if share * _WORTH >= 1.0:
        return None
    logs = beginnings(problem.logs, share)
    seen, whole = (
        [np.isfinite(log.y).any(axis=1).tolist() for log in given] for given in (logs, problem.logs)
    )  # fmt: skip
    return replace(problem, logs=logs) if seen == whole else None
