"""Why a filter ended: the law that has no value at a sigma point, if that was it and not the integration.

The unscented filter asks the model at points away from the mean. Where a law ends (the root of a level, the logarithm
of a pressure) some of them may lie beyond, although every true state does not; shorter steps do not help then.
"""

from __future__ import annotations

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.samples import Samples
from bondgraph.filter.sigma_points import lower_factor
from bondgraph.filter.ukf import Member
from bondgraph.simulate.integrators import RK4
from bondgraph.simulate.stiff import Rosenbrock
from bondgraph.simulate.undefined import Undefined, first_undefined
from bondgraph.simulate.watched import WatchedEquations

_ADVICE = (
    "write a law that goes on beyond (as sign(x)*sqrt(abs(x)) does for sqrt(x)), or make the filter surer of the state"
    " (initial_std, process noise)"
)


def cause(
    filter_model: FilterModel, samples: Samples, member: Member, last: int, mean: FloatArray, cov: FloatArray
) -> str:
    """What ended a filter after node ``last``, -1 before the first, in words; empty where it was no law.

    Parameters
    ----------
    filter_model, samples, member
        The filter, the log, and the numbers it ran with.
    last
        The last node that was finished.
    mean, cov
        The belief after that node, (n_s,) and (n_s, n_s); of no meaning before the first.
    """
    if filter_model.appended:
        return ""
    if last < 0:
        mean, cov = filter_model.start_mean(member.theta, member.x0), member.initial_lower @ member.initial_lower.T
    elif last + 1 < samples.time.size:
        cov = cov + samples.noise_start[last] * member.process_cov
    points = filter_model.points.draw(mean, lower_factor(cov).lower)
    with np.errstate(all="ignore"):
        found = _on_the_way(filter_model, samples, member.theta, last, points)
    if found is None:
        return ""
    t = float(samples.time[max(last, 0)])
    return f"a law has no value at a sigma point of the filter, after t = {t:.6g} s: {found} - {_ADVICE}"


def _on_the_way(
    filter_model: FilterModel, samples: Samples, theta: FloatArray, last: int, points: FloatArray
) -> Undefined | None:
    """The first assignment without a value where the points are moved to the next node and measured there."""
    model, k = filter_model.model, last + 1
    if k >= samples.time.size:
        return None
    if k > 0:
        substeps = int(samples.substeps[k - 1])
        stiff = filter_model.is_stiff
        used = Rosenbrock(filter_model.method, substeps, float(samples.grading[k - 1])) if stiff else RK4(substeps)
        watched = WatchedEquations(model, theta)
        state = used.init(float(samples.time[k - 1]), points)
        moved, _ = used.step(watched, samples.segment(k), samples.time[k : k + 1], state)
        if watched.found:
            return watched.found[0]
        points = moved[:, 0]
    if not np.isfinite(points).all():
        return None
    return first_undefined(model, "output", float(samples.time[k]), points, samples.u[:, k], theta)
