"""How a swarm hands over to gradient searches: what it searches, how large it is, and where the searches start.

A swarm only has to find the right valleys, and every coordinate more makes them harder to find. Levels of noise are
left to the gradient search, which finds them in closed form (see :mod:`bondgraph.estimate.solvers.steps`): with the
levels that the data suggested at the start, the swarm ranks parameters as a weighted sum of squares would. Where the
logs are so long that a swarm over them would take many minutes, it searches how they begin; the gradient searches that
follow see everything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from bondgraph.estimate.derivatives.exact import filtering_work
from bondgraph.estimate.excerpt import excerpt
from bondgraph.estimate.joint import JointProblem, Problem
from bondgraph.estimate.noise_starts import noisiest_start
from bondgraph.estimate.objective import FloatArray
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers.abstract import AbstractSearch
from bondgraph.estimate.solvers.hypercube import latin_hypercube
from bondgraph.estimate.solvers.particle_swarm import ParticleSwarm, SwarmSettings

#: Points closer than this share of the bounds in every coordinate count as one start.
_DISTINCT = 0.02

#: Particles for each coordinate, and the least and most of them.
_PER_COORDINATE, _LEAST, _MOST = 5, 16, 64

#: Particles come in multiples of this: a batch is filtered in blocks of so many.
_BLOCK = 16

#: Work of all evaluations of a swarm that hands over, in integration steps times sigma points: two minutes of one core
#: on a vehicle of nine states. And the fewest samples of a log that such a swarm sees.
_WORK, _LEAST_SAMPLES = 6e8, 100

#: Iterations that find valleys, and those without a gain that end the search for them.
_ITERATIONS, _PATIENCE, _GAIN = 20, 6, 1.0

#: Kinds of free parameters that are levels of noise.
_LEVELS = ("std", "process")

#: Gradient searches from which on one begins with much noise, so that two are left to the swarm.
_WITH_NOISY = 4

#: Starts of noise levels scatter within this factor of the first.
_SCATTER = 100.0


def explored(
    problem: Problem, make: Callable[[Problem], AbstractSearch[Any]], alone: bool
) -> tuple[Problem, AbstractSearch[Any]]:
    """What a search explores, and the search: alone everything, else valleys in what is left to it."""
    part = problem if alone else without_noise_levels(problem)
    search = make(part)
    if not alone and not part.noise_levels.any() and search.most_evaluations is not None:
        samples = sum(len(log) for log in part.logs)
        enough = samples * _WORK / (filtering_work(part) * search.most_evaluations)
        part = excerpt(part, enough, _LEAST_SAMPLES, every_channel=False) or part
    return part, search


def exploring_swarm(problem: Problem, seed: int) -> ParticleSwarm:
    """A swarm that only has to find the right valleys."""
    return ParticleSwarm(swarm_settings(problem, alone=False), seed)


def without_noise_levels(problem: Problem) -> Problem:
    """The problem with its noise levels held at their starts; as it is where a part has nothing else free.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.estimate.problem import pose
    >>> from bondgraph.filter.filter_model import FilterModel
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1})
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> without_noise_levels(pose(swing, log, ["length", "std(deflection)", "damping"])).names
    ('length', 'damping')
    """
    if isinstance(problem, JointProblem):
        others = tuple(parameter for parameter in problem.free if parameter.target.kind not in _LEVELS)
        parts = tuple(map(_without_levels, problem.problems))
        if any(part.noise_levels.any() for part in parts):
            return problem
        return replace(problem, problems=parts, free=others) if len(others) < len(problem.free) else problem
    return _without_levels(problem)


def _without_levels(problem: EstimationProblem) -> EstimationProblem:
    others = tuple(parameter for parameter in problem.free if parameter.target.kind not in _LEVELS)
    told = {name for prior in problem.priors for name in prior.names}
    if not others or len(others) == len(problem.free) or not told <= {one.name for one in others}:
        return problem
    starts = {kind: {p.target.name: p.start for p in problem.free if p.target.kind == kind} for kind in _LEVELS}
    declared = problem.filter_model
    held = replace(declared, measurement_noise={**declared.measurement_noise, **starts["std"]})
    held = held.with_process(starts["process"])
    return replace(problem, filter_model=held, free=others)


def is_shortened(problem: Problem, part: Problem) -> bool:
    """Whether a swarm searched the beginnings of the logs instead of all of them."""
    return [len(log) for log in problem.logs] != [len(log) for log in part.logs]


def whole_points(problem: Problem, part: Problem, points: FloatArray) -> FloatArray:
    """Coordinates (n, members) of a problem from those of a part of it, with the start in place of the others."""
    wide = np.repeat(problem.start[:, np.newaxis], points.shape[1], axis=1)
    wide[[problem.names.index(name) for name in part.names]] = points
    return wide


def swarm_settings(problem: Problem, alone: bool) -> SwarmSettings:
    """A swarm for so many coordinates: five particles for each, as long as valleys need or, alone, an optimum."""
    wanted = min(max(_PER_COORDINATE * len(problem.free), _LEAST), _MOST)
    members = -(-wanted // _BLOCK) * _BLOCK
    if alone:
        return SwarmSettings(members=members)
    return SwarmSettings(members=members, iterations=_ITERATIONS, patience=_PATIENCE, tolerance=_GAIN)


def swarm_starts(problem: Problem, points: FloatArray, values: FloatArray, count: int) -> FloatArray:
    """The best distinct of points (n, members), and among several the declared start; shape (n, up to count).

    The declared start is what an engineer believes, and the levels of noise that the swarm ranked points by may have
    been wrong. Where levels are free and there are four starts or more, one of them is the declared start with much
    noise: from there a likelihood is smooth that has a valley for every period of what swings.
    """
    noisy = [noisiest_start(problem.free)] if count >= _WITH_NOISY and problem.noise_levels.any() else []
    found = distinct_starts(problem, points, values, max(count - 1 - len(noisy), 1))
    if count == 1 or not found.size:
        return found
    return np.column_stack([found, problem.start, *noisy])


def spread_starts(problem: Problem, count: int, seed: int) -> FloatArray:
    """The declared start and a Latin hypercube over the bounds, shape (n, count).

    Levels of noise scatter within a factor of 100: their bounds span all that a log can tell, and a search finds them
    from anywhere near.
    """
    rng = np.random.default_rng([seed, 1])
    others = max(count - 1, 1)
    shares = latin_hypercube(len(problem.free), others, rng)
    near = np.where(problem.noise_levels, np.log(_SCATTER), np.inf)
    lower, upper = np.maximum(problem.lower, problem.start - near), np.minimum(problem.upper, problem.start + near)
    spread = lower[:, np.newaxis] + (upper - lower)[:, np.newaxis] * shares
    return np.concatenate([problem.start[:, np.newaxis], spread], axis=1)[:, :count]


def distinct_starts(problem: Problem, points: FloatArray, values: FloatArray, count: int) -> FloatArray:
    """The best of points (n, members) with finite values (members,), none near a better one; shape (n, up to count)."""
    width = problem.upper - problem.lower
    chosen: list[FloatArray] = []
    for member in np.argsort(values, kind="stable"):
        point = points[:, member]
        near = (bool(np.all(np.abs(point - other) < _DISTINCT * width)) for other in chosen)
        if np.isfinite(values[member]) and not any(near):
            chosen.append(point)
        if len(chosen) == count:
            break
    return np.array(chosen).T
