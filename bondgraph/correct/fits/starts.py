"""Where logs start: initial states that no sensor shows and that the filter does not find by itself.

A filter begins with what is assumed of a state, a wide Gaussian, and one update has to find it. With straight output
equations that is exact. Around a law that is not (a spring behind play) the update takes one slope for all of it, ends
beside the state, and is sure of it; what follows looks like an effect that acts in the beginning. Then the start is
estimated like any other parameter, with what was assumed of it as its prior: Ljung (1999), System Identification,
section 4.3. Where the update is exact both ways have the same likelihood, but for the width that the start keeps in its
posterior (Laplace's approximation); so that what is gained beyond that says whether the update was wrong.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from bondgraph.data.log import FloatArray
from bondgraph.errors import EstimationError
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.initial import first_shown
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.filter.filter_model import FilterModel

#: A start is doubted if the innovations of so many samples after it are this large by chance.
_FIRST, _DOUBTED = 10, 1e-3
#: Nats beyond what the posterior's width accounts for at which the update was wrong.
_CLEAR = 3.0
#: Starts are searched within so many standard deviations, first in steps of half of one, within this of the middle.
_REACH, _TRIED = 6.0, np.linspace(-2.5, 2.5, 11)
#: An estimated start is as uncertain for the filter as this share of what was assumed.
_SURE = 0.02


def with_starts(fitted: Fit, journal: Journal | None = None) -> Fit:
    """The fit, or one with the starts of all logs estimated, if the filter did not find them.

    Stiff models keep their starts: their expansions know of parameters and noise levels alone.
    """
    problem = fitted.problem
    own = _starts(problem)
    if not own or problem.filter_model.is_stiff or not _doubted(fitted):
        return fitted
    values = fitted.values
    free = [replace(one, start=float(np.clip(values[one.name], one.lower, one.upper))) for one in problem.free]
    wider = EstimationProblem(_sure(problem.filter_model, own), problem.logs, (*free, *own), problem.initial)
    point = _searched(wider, np.concatenate([fitted.point, [one.start for one in own]]), len(own))
    try:
        found = fit(wider, starts=[point], journal=journal)
    except EstimationError:
        return fitted
    return found if fitted.nll - found.nll - posterior_width(found, own) > _CLEAR else fitted


def _starts(problem: EstimationProblem) -> tuple[FreeParameter, ...]:
    """The starts that no sensor shows, of every log, as free parameters; none that is free already."""
    filter_model, model = problem.filter_model, problem.filter_model.model
    shown = {one.state for one in first_shown(model, problem.logs[0], model.theta()).values()}
    known = {parameter.target.name for parameter in problem.free if parameter.target.kind == "x0"}
    found = []
    for row, name in enumerate(model.names("state")):
        std = filter_model.initial_std.get(name, 0.0)
        if row in shown or name in known or std <= 0.0:
            continue
        for log, x0 in zip(problem.logs, problem.initial_states, strict=True):
            middle, reach = float(x0[row]), _REACH * std
            found.append(FreeParameter(f"x0({name}, {log.name})", middle - reach, middle + reach, middle, middle, std))
    return tuple(found)


def _doubted(fitted: Fit) -> bool:
    """Whether the first innovations are larger than chance makes them."""
    runs = fitted.runs(fitted.problem.logs)
    squares = sum(float(np.sum(run.whitened[:, :_FIRST] ** 2)) for run in runs)
    return float(stats.chi2.sf(squares, sum(int(run.measured_channels[:_FIRST].sum()) for run in runs))) < _DOUBTED


def _sure(filter_model: FilterModel, own: tuple[FreeParameter, ...]) -> FilterModel:
    """The filter that takes these starts as they are given."""
    tight = {one.target.name: _SURE * one.prior_std for one in own if one.prior_std is not None}
    return replace(filter_model, initial_std={**filter_model.initial_std, **tight})


def _searched(problem: EstimationProblem, point: FloatArray, count: int) -> FloatArray:
    """A point (n,) with its last coordinates, the starts, where the likelihood is best, one after the other."""
    found = point.copy()
    for k in range(point.size - count, point.size):
        parameter = problem.free[k]
        assert parameter.prior_std is not None  # all of them have one
        tried = np.repeat(found[:, np.newaxis], _TRIED.size, axis=1)
        tried[k] = parameter.start + _TRIED * parameter.prior_std
        values = problem.nll(tried)
        found = tried[:, int(np.argmin(np.where(np.isfinite(values), values, np.inf)))]
    return found


def posterior_width(fitted: Fit, own: tuple[FreeParameter, ...]) -> float:
    """Nats by which free parameters with a prior seem better estimated than integrated over."""
    std = fitted.std
    return sum(float(np.log(one.prior_std / min(std[one.name], one.prior_std))) for one in own if one.prior_std)
