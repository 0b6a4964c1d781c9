"""The other split of what a model does not explain between the noise of its states and that of its sensors.

A likelihood may have an optimum for each: a noisy process seen by perfect sensors, and noisy sensors that see a quiet
process. From a sensor with next to no noise no derivative leads to the other one, since what is next to nothing
changes nothing by growing a little. No sensor is perfect, so such a fit is looked for once more from the quiet side.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import judge
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.scores.quiet import quiet_fit
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit

#: Most iterations of the search from the quiet side, and what a further one must promise, as of any refit.
_ITERATIONS, _TOLERANCE = 25, 0.05
#: Information of the logarithm of a level of which a log tells nothing: it may as well be e times larger.
_TOLD = 1.0
#: Shares of the way, in logarithms, from the lowest process noise to that of the fit at which a search may begin; the
#: best by its value does, and the search decides the rest.
_RAISED = (0.0, 0.25, 0.5)


def split_again(trial: Trial, context: Context) -> Trial:
    """The trial with the better one of two splits of its noise, where that of a sensor is next to nothing."""
    if trial.fit is None or trial.evidence is None:
        return trial
    found = from_quiet_side(trial.fit, context.journal)
    if found is None:
        return trial
    evidence = judge(context.base, found, trial.candidate.effect, trial.evidence.tried, trial.gate is not None)
    evidence = replace(evidence, p_robust=max(evidence.p_robust, trial.evidence.p_robust))
    remark = f"with noise of the sensors in place of noise of the states it gains {evidence.delta_nll:.1f} nats"
    remark = f"{remark} instead of {trial.evidence.delta_nll:.1f}"
    return replace(trial, fit=found, evidence=evidence, remark=f"{trial.remark}; {remark}" if trial.remark else remark)


def from_quiet_side(fitted: Fit, journal: Journal | None = None) -> Fit | None:
    """The fit with noisy sensors and a quiet process; None where no sensor's noise is next to nothing, or no better.

    Raises
    ------
    EstimationError
        If the model diverges from there.
    """
    problem = fitted.problem
    process = np.array([one.target.kind == "process" for one in problem.free])
    sensors = np.array([one.target.kind == "std" for one in problem.free])
    silent = sensors & (np.diag(fitted.expansion.information) < _TOLD)
    quiet = quiet_fit(fitted, problem.logs, journal) if silent.any() else None
    if quiet is None:
        return None
    values = {**fitted.values, **quiet.values}
    start = np.array([one.coordinate(float(np.clip(values[one.name], one.lower, one.upper))) for one in problem.free])
    low = np.where(process, problem.lower, start)
    starts = [low + share * (start - low) for share in _RAISED]
    found = fit(problem, _ITERATIONS, _TOLERANCE, starts, journal=journal)
    return found if found.nll < fitted.nll - _TOLERANCE else None
