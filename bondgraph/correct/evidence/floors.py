"""Floors of process noise: lower bounds that stand in the way of the quietest process that logs ask for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.correct.evidence.certified import unnoticed
from bondgraph.errors import EstimationError
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit

#: Lower bounds go down by this factor at a time, and so many times at most.
_DOWN, _MOST_TIMES = 10.0, 3
_MOST_ITERATIONS, _TOLERANCE = 60, 0.05


def without_floors(found: Fit, journal: Journal) -> Fit:
    """The fit with process noise free to be so little that its lower bound matters to nothing.

    A bound is an absolute number: noise in a heat at its bound moves a temperature the less, the larger the heat
    capacity. Of a hot plate it was worth 12 nats to count every heat 2.3 times, which was called a wrong power meter.
    """
    for _ in range(_MOST_TIMES):
        free = found.problem.free
        resting = found.held & np.array([one.target.kind == "process" for one in free])
        resting &= found.point <= found.problem.lower
        if not resting.any():
            break
        deeper = tuple(
            replace(one, lower=one.lower / _DOWN, start=one.lower / _DOWN) if rests else one
            for one, rests in zip(at_optimum(found), resting, strict=True)
        )
        problem = replace(found.problem, free=deeper)
        if not float(problem.nll(problem.start[:, np.newaxis])[0]) < found.nll - unnoticed(problem):
            break
        try:
            found = fit(problem, _MOST_ITERATIONS, _TOLERANCE, journal=journal)
        except EstimationError:  # too little noise for a search
            break
    return found
