"""Parameters that rest on bounds beside a law: the fit with the law, searched once more from where they are declared.

What is missing drives parameters into a corner: without the delay of a hot-air blower its heater was as light as
allowed and its tube took all the heat. A refit begins in that corner, and may find its law there without finding out
of it: the delay gained 1443 nats of 1930, and any of seven further laws the rest, which no law is needed for.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from bondgraph.correct.constants import INDIFFERENT
from bondgraph.correct.models.failures import attempted
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit

_ITERATIONS, _TOLERANCE = 60, 0.05


def off_bounds(fitted: Fit, own: Collection[str], journal: Journal) -> Fit:
    """The fit, or a clearly likelier one that is found from the declared values of parameters that rest on bounds.

    Parameters
    ----------
    fitted
        A fit with a law. Of stiff models it is as good as it is: their fits are costly.
    own
        Names of the law's parameters: they have no declared values, and zero is a bound that means something.
    journal
        Finished fits.
    """
    problem = fitted.problem
    theta, names = problem.filter_model.model.theta(), problem.filter_model.model.names("parameter")
    declared = np.array([one.target.kind == "parameter" and one.name not in own for one in problem.free])
    resting = np.flatnonzero(fitted.held & declared)
    if problem.filter_model.is_stiff or not resting.size:
        return fitted
    start = fitted.point.copy()
    for k in resting:
        one = problem.free[k]
        start[k] = one.coordinate(float(np.clip(theta[names.index(one.target.name)], one.lower, one.upper)))
    other = attempted(lambda: fit(problem, _ITERATIONS, _TOLERANCE, [start], journal=journal), lambda why: None)
    return fitted if other is None or other.nll > fitted.nll - INDIFFERENT else other
