"""Where the searches of fits begin: with how much noise of the process and of the sensors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from bondgraph.data.log import FloatArray
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.filter.likelihood import innovations

#: Factors on declared noise levels at which a first fit looks for its start.
_NOISIER = (1.0, 5.0, 25.0, 125.0)
#: Factors on declared levels with which a quiet search begins: of process noise, and of the sensors' noise.
_QUIET = {"process": 0.25, "std": 6.0}
#: Turns in which levels are matched to innovations: a filter that believes its sensors less is surprised by more.
_TURNS = 4


def quiet_start(free: Sequence[FreeParameter], point: FloatArray) -> FloatArray:
    """A point (n,) with little process noise and much of the sensors: its errors are then those of the outputs.

    Much process noise lets a filter follow any log whatever its parameters, and likelihoods have an optimum there too.
    A search that begins without finds parameters first, as one of free simulations would.
    """
    start = point.copy()
    for k, parameter in enumerate(free):
        if parameter.target.kind in _QUIET:
            level = parameter.start * _QUIET[parameter.target.kind]
            start[k] = parameter.coordinate(float(np.clip(level, parameter.lower, parameter.upper)))
    return start


def noisy_starts(free: Sequence[FreeParameter]) -> list[FloatArray]:
    """The starts of free parameters with process and measurement noise as declared and several times larger.

    Far from the optimum a model is surprised by all it sees. A search that begins with noise of the right size for that
    surprise moves the parameters first; one that begins with far too little throws every noise level up at once.
    """
    start = np.array([parameter.coordinate(parameter.start) for parameter in free])
    kinds = np.array([parameter.target.kind for parameter in free])
    found = []
    for process, measurement in itertools.product(_NOISIER, _NOISIER[:3]):
        point = start.copy()
        point[kinds == "process"] += np.log(process)
        point[kinds == "std"] += np.log(measurement)
        found.append(point)
    return found


def noisiest_start(free: Sequence[FreeParameter]) -> FloatArray:
    """The start (n,) with the most noise of process and sensors, inside the bounds: from there a likelihood is smooth.

    With little noise the likelihood of what swings has an optimum at every period that fits in between: of a lift on a
    rope declared 15 % too stiff, searches ended 1100 nats behind the best. A search that begins with much noise takes
    it away as it comes near. Graduated optimisation: Blake and Zisserman (1987), Visual Reconstruction.

    Examples
    --------
    >>> from bondgraph.estimate.free import FreeParameter
    >>> level = FreeParameter("std(speed)", 1e-4, 10.0, 0.02, scale="log")
    >>> start = noisiest_start([level])
    >>> round(float(level.values(start)[0]), 3)
    0.5
    """
    limits = np.array([[one.coordinate(bound) for bound in (one.lower, one.upper)] for one in free])
    start: FloatArray = np.clip(noisy_starts(free)[-1], *limits.T)
    return start


def matched_levels(problem: EstimationProblem, point: FloatArray) -> FloatArray:
    """The point (n,) with its sensors as noisy as the filter is surprised by what they show, within their bounds.

    Given everything else this is the likeliest level of a sensor whose noise makes up the innovations, as where the
    process is quiet. No step of a search leads there from a level that is far too low: innovations of hundreds of
    their standard deviations tell how the gain should change, and hide that they all are too large. A level stays where
    the model diverges.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.estimate.problem import pose
    >>> from bondgraph.filter.filter_model import FilterModel
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 1e-9}, {"deflection": 1e-6}, {"angle": 1e-6, "rate": 1e-6})
    >>> log = MatchedLog("rest", np.arange(40) * 0.05, np.zeros((1, 40)), 10.0 * np.sin(np.arange(40.0))[np.newaxis])
    >>> problem = pose(swing, log, ["std(deflection)"])
    >>> float(problem.values(matched_levels(problem, problem.start))[0].round(1))
    7.1
    """
    outputs = problem.filter_model.model.names("output")
    levels = [(k, outputs.index(one.target.name)) for k, one in enumerate(problem.free) if one.target.kind == "std"]
    found = point.copy()
    for _ in range(_TURNS if levels else 0):
        batch = problem.batch(found[:, np.newaxis])
        records = innovations(problem.filter_model, problem.logs, batch.theta, **batch.values())
        for k, row in levels:
            with np.errstate(over="ignore", invalid="ignore"):  # of a filter that fails nothing is a number
                seen = [(one.values * np.exp(one.log_scales))[row, one.measured[row], 0] for one in records]
                squares = np.concatenate(seen) ** 2
            level = math.sqrt(float(squares.sum()) / max(squares.size, 1))  # zero of a channel that nobody measured
            if np.isfinite(level) and level > 0.0:
                one = problem.free[k]
                found[k] = one.coordinate(float(np.clip(level, one.lower, one.upper)))
    return found
