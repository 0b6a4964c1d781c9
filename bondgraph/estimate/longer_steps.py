"""Longer integration steps on the way to an optimum, as long as they tell the innovations that the model's own do.

A fit needs a few hundred values of the likelihood, and most of them only lead to the optimum. Steps that a certificate
asks for resolve the model so well that no effect could gain a tenth of a nat by making up for them; a search needs less
than that. So it is done on a ladder: with long steps first; where that ends, with the model's own, if both tell the
same innovations there to what a rough search may leave; else with shorter ones. What is returned is the optimum of the
model's own steps, and longer ones decide nothing but how soon it is found.

Reference for the idea: Peherstorfer, Willcox and Gunzburger (2018), Survey of multifidelity methods in uncertainty
propagation, inference, and optimization, SIAM Review 60(3).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.data.log import FloatArray
from bondgraph.estimate.objective import Terms
from bondgraph.estimate.problem import EstimationProblem

#: Steps may lead a search that move innovations by less than a tenth of their variance: where it ends is looked at
#: again, and this decides only what is tried first.
_SHARE = 0.1


def step_gain(seen: Terms, again: Terms) -> float:
    """Nats that effects may gain at most by what moves the terms (n_terms, 1) of a likelihood from one to another.

    Let a filter move the whitened innovations by d. Any effect explains at most the part of the innovations that its
    responses span, so that the root of twice its gain moves by ``|d|`` at most: ``|d|**2 / 2`` is all it may gain.

    Examples
    --------
    >>> before, after = (Terms(np.array([[z], [0.0]]), np.zeros((2, 1))) for z in (1.0, 1.2))
    >>> round(step_gain(before, after), 6)
    0.02
    """
    with np.errstate(invalid="ignore", over="ignore"):  # of a filter that fails nothing is a number
        scales = again.log_scales - seen.log_scales
        moved = again.innovations - seen.innovations + seen.innovations * scales
        return float(0.5 * np.sum(moved**2) + np.sum(scales**2))


def doubled(problem: EstimationProblem, times: int) -> EstimationProblem:
    """The problem with the steps of its filter doubled so many times, which must be possible."""
    for _ in range(times):
        filter_model = problem.filter_model.with_doubled_steps()
        assert filter_model is not None  # ladder() has gone this way
        problem = replace(problem, filter_model=filter_model)
    return problem


def ladder(problem: EstimationProblem) -> list[EstimationProblem]:
    """The problem with longer and longer steps; the k-th has them doubled k + 1 times.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.estimate.problem import pose
    >>> from bondgraph.filter.filter_model import FilterModel
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1}, substeps=8)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> [rung.filter_model.substeps for rung in ladder(pose(swing, log, ["length"]))]
    [4, 2, 1]
    """
    rungs: list[EstimationProblem] = []
    longer = problem.filter_model.with_doubled_steps()
    while longer is not None:
        rungs.append(replace(problem, filter_model=longer))
        longer = longer.with_doubled_steps()
    return rungs


def longest_that_lead(problem: EstimationProblem, rungs: int, point: FloatArray) -> int:
    """How many rungs up the ladder the longest steps are by which a search may begin at a point (n,).

    They move the whitened innovations by less than :data:`_SHARE` of their own sum of squares, and not beyond what is
    a number. ``rungs`` is how far up it may look; 0: only the model's own steps do.
    """
    seen = problem.terms(point[:, np.newaxis])
    negligible = _SHARE * 0.5 * float(np.sum(seen.innovations**2))
    for times in range(rungs, 0, -1):
        if step_gain(seen, doubled(problem, times).terms(point[:, np.newaxis])) <= negligible:
            return times
    return 0
