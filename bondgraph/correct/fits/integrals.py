"""States that do nothing but integrate others: a position whose speed is what a machine is about.

Such a state never forgets. What pushed a carriage unseen and is over stays in all later positions, so that errors of
its free simulation tell little of what a model lacks, and those of its speed do.
"""

from __future__ import annotations

import numpy as np

from bondgraph.correct.fits.horizon import slopes_along
from bondgraph.data.log import FloatArray
from bondgraph.estimate.fitted import Fit


def integrating(fitted: Fit) -> tuple[str, ...]:
    """States that do nothing but integrate others: no noise drives them, and they hardly act back.

    With the Jacobian J along the logs such a state k has no rate of its own; by the states that it acts upon it would
    come back at ``J[j, k] J[k, j] / J[j, j]``, which must take longer than the logs last.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.estimate.local import fit
    >>> from bondgraph.estimate.problem import pose
    >>> from bondgraph.filter.filter_model import FilterModel
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1}, substeps=4)
    >>> time = np.arange(80) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 80)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> integrating(fit(pose(swing, log, ["length"])))  # the angle pulls back
    ()
    """
    problem = fitted.problem
    model, logs = problem.filter_model.model, problem.logs
    longest = max(float(log.time[-1] - log.time[0]) for log in logs)
    names = [name for name in model.names("state") if name not in problem.filter_model.process_noise]
    rows = {name: model.index("state", name) for name in names}
    for log, run in zip(logs, fitted.own_runs if rows else (), strict=bool(rows)):
        for slopes in slopes_along(fitted, log, run):
            with np.errstate(all="ignore"):
                back = np.abs(slopes * slopes.T / np.diag(slopes)[:, np.newaxis])
            rows = {name: k for name, k in rows.items() if slopes[k, k] == 0.0 and _seldom(back[:, k], k, longest)}
    return tuple(rows)


def _seldom(back: FloatArray, own: int, longest: float) -> bool:
    """True where a state comes back by none of the others (n,) within some time; one without a path has no number."""
    return bool(np.nansum(np.delete(back, own)) * longest < 1.0)
