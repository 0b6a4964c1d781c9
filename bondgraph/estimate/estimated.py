"""What follows from an optimum and its covariance: the filter with the estimated noises, intervals, the next prior."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bondgraph.errors import EstimationError, suggest
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.objective import FloatArray
from bondgraph.estimate.priors import MultivariateNormal
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.filter.filter_model import FilterModel

#: 97.5 % point of the standard normal distribution.
_Z95 = 1.959963984540054


def estimated_filter(problem: EstimationProblem, point: FloatArray) -> FilterModel:
    """The filter model of a problem with the noise levels and correlations that coordinates (n,) say."""
    declared = problem.filter_model
    stds: dict[str, dict[str, float]] = {"std": {}, "process": {}, "x0_std": {}}
    pairs: dict[str, dict[tuple[str, str], float]] = {"corr": {}, "process_corr": {}, "x0_corr": {}}
    for target, value in problem.numbers(point):
        if target.kind in stds:
            stds[target.kind][target.name] = float(value)
        elif target.kind in pairs and target.other is not None:
            pairs[target.kind][target.name, target.other] = float(value)
    return replace(
        declared.with_process(stds["process"]),
        measurement_noise={**declared.measurement_noise, **stds["std"]},
        initial_std={**declared.initial_std, **stds["x0_std"]},
        measurement_correlation={**declared.measurement_correlation, **pairs["corr"]},
        process_correlation={**declared.process_correlation, **pairs["process_corr"]},
        initial_correlation={**declared.initial_correlation, **pairs["x0_corr"]},
    )


def normal_interval(parameter: FreeParameter, value: float, std: float, reach: float = _Z95) -> tuple[float, float]:
    """Interval of a value with a standard deviation, normal in its coordinate, within the bounds.

    ``reach`` counts standard deviations to each side (default: those of 95 %).

    Examples
    --------
    >>> share = FreeParameter("eta", 0.0, 1.0, 0.5, scale="logit")
    >>> lower, upper = normal_interval(share, 0.98, 0.02)
    >>> round(lower, 3), round(upper, 3)
    (0.869, 0.997)
    """
    if not math.isfinite(std):
        return parameter.lower, parameter.upper
    lower, upper = parameter.transform.around(value, reach * std, parameter.lower, parameter.upper)
    return max(lower, parameter.lower), min(upper, parameter.upper)


def next_prior(
    problem: Problem, point: FloatArray, covariance: FloatArray, at_bound: Sequence[str], names: Sequence[str]
) -> MultivariateNormal:
    """The likelihood around an optimum (n,) to second order as a prior, see ``Estimate.as_prior``.

    ``covariance`` (n, n) is that of the coordinates, NaN for what is not identifiable.

    Raises
    ------
    EstimationError
        If nothing was told of a name.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> time = np.arange(100) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 100)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> fit = bg.estimate(swing, log, ["length"], bg.Settings(method="gradient", starts=1))
    >>> fit.as_prior().names
    ('length',)
    """
    told = [
        one
        for one, variance in zip(problem.free, np.diag(covariance), strict=True)
        if math.isfinite(variance) and one.name not in at_bound and one.scale != "logit"
    ]
    known = [one.name for one in told]
    wanted = list(names) or [one.name for one in told if one.target.kind == "parameter"]
    missing = next((name for name in wanted if name not in known), "" if wanted else "any parameter")
    if missing:
        remedy = (
            f"there are {', '.join(known)}"
            if known
            else "fix some, or take the logs of both stages at once (pose_joint)"
        )
        raise EstimationError(
            f"as_prior: the logs told nothing of {missing} that a normal distribution could hold"
            f"{suggest(missing, known)} - {remedy}",
            where=(missing,),
        )
    rows = [problem.names.index(name) for name in wanted]
    scales = [problem.free[row].scale for row in rows]
    return MultivariateNormal.of(wanted, point[rows], covariance[np.ix_(rows, rows)], scales)
