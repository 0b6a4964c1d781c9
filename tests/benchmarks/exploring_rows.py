"""Which search explores for the gradient searches after it: the default's swarm against L-SHADE, evaluations alike.

On drives of the vehicle (eight parameters of engine and CVT, as the thesis estimates them) that begin at random values
inside the bounds, and on the usual functions in ten dimensions with L-BFGS-B from the best distinct points.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from scipy.optimize import minimize

from bondgraph.estimate.derivatives.exact import exact_derivatives
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.handover import distinct_starts, swarm_settings
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.solvers.abstract import AbstractSearch, search_to_end
from bondgraph.estimate.solvers.differential_evolution import Shade
from bondgraph.estimate.solvers.particle_swarm import ParticleSwarm, SwarmSettings
from bondgraph.filter.draw import draw_logs
from tests.benchmarks.optimiser_rows import FUNCTIONS, Function
from vehicle_graphs import thesis

#: A search ends as the default's swarm does: after 20 iterations, or 6 that gain less than a nat.
_MEMBERS, _ITERATIONS, _PATIENCE, _GAIN = 64, 20, 6, 1.0
#: Starts of the gradient searches: the best distinct points and the declared one.
_STARTS = 4


def _swarm(seed: int) -> ParticleSwarm:
    return ParticleSwarm(SwarmSettings(_MEMBERS, iterations=_ITERATIONS, patience=_PATIENCE, tolerance=_GAIN), seed)


def _shade(seed: int) -> Shade:
    return Shade(_MEMBERS * (_ITERATIONS + 1), patience=_PATIENCE, tolerance=_GAIN, seed=seed)


EXPLORERS: dict[str, Callable[[int], AbstractSearch]] = {"swarm": _swarm, "L-SHADE": _shade}


def exploring_functions(seeds: int) -> list[dict[str, object]]:
    """A row per search: the median over seeds of what the gradient searches after it ended at."""
    return [
        {
            "explored by": name,
            **{
                title: float(np.median([_refined(function, make(seed), seed) for seed in range(seeds)]))
                for title, function in FUNCTIONS.items()
            },
        }
        for name, make in EXPLORERS.items()
    ]


def _refined(function: Function, search: AbstractSearch, seed: int) -> float:
    start = np.random.default_rng([7, seed]).uniform(function.lower, function.upper)
    state, _ = search_to_end(search, function, start)  # type: ignore[arg-type]
    found = search.result(state)
    box = SimpleNamespace(lower=function.lower, upper=function.upper)
    best = distinct_starts(box, found.points, found.values, _STARTS - 1)  # type: ignore[arg-type]
    bounds = list(zip(function.lower, function.upper, strict=True))
    ends = [
        minimize(lambda x: float(function.nll(x[:, np.newaxis])[0]), point, method="L-BFGS-B", bounds=bounds).fun
        for point in (*best.T, start)
    ]
    return min(found.best_nll, *ends)


def exploring_drives(seeds: int) -> list[dict[str, object]]:
    """A row per drive and search: nats above the better end, evaluations, and seconds of CPU."""
    rows: list[dict[str, object]] = []
    for seed in range(seeds):
        problem = _drive(seed)
        found = {name: _estimated(problem, make(problem, seed)) for name, make in _SIZED.items()}
        best = min(nll for nll, _, _ in found.values())
        rows += [
            {"drive": seed, "explored by": name, "nats_behind": nll - best, "evaluations": count, "cpu_s": cpu}
            for name, (nll, count, cpu) in found.items()
        ]
    return rows


def _sized_swarm(problem: Problem, seed: int) -> ParticleSwarm:
    return ParticleSwarm(swarm_settings(problem, alone=False), seed)


def _sized_shade(problem: Problem, seed: int) -> Shade:
    swarm = swarm_settings(problem, alone=False)
    evaluations = swarm.members * (swarm.iterations + 1)
    return Shade(evaluations, patience=swarm.patience, tolerance=swarm.tolerance, seed=seed)


_SIZED: dict[str, Callable[[Problem, int], AbstractSearch]] = {"swarm": _sized_swarm, "L-SHADE": _sized_shade}


def _estimated(problem: EstimationProblem, search: AbstractSearch) -> tuple[float, int, float]:
    settings = Settings(search=search, starts=_STARTS, certify="none", gradient=thesis.DRIVING_SEARCH)
    began = time.process_time()
    found = estimate(problem, settings, jacobian=exact_derivatives)
    return found.nll, found.evaluations, time.process_time() - began


def _drive(seed: int) -> EstimationProblem:
    """Six seconds of a drive with drawn parameters, from random values inside the bounds."""
    variant = thesis.VARIANTS[2]
    rng = np.random.default_rng([200, 1, seed])
    maker = thesis._filter_model(variant.graph)
    truth = thesis.draw_truth(maker.model, variant.free, rng)
    (pattern,) = thesis.drives(maker.model, rng, short=True)
    drawn = draw_logs(
        maker, pattern, 1, int(rng.integers(2**31)), theta=maker.model.theta(**truth), x0=maker.model.x0(),
        substeps=thesis.TRUE_STEPS[variant.stage],
    )  # fmt: skip
    problem = pose(maker, drawn.logs, variant.free, initial=({},))
    away = np.random.default_rng([300, seed]).uniform(problem.lower, problem.upper)
    starts = problem.values(away)
    free = tuple(replace(one, start=float(start)) for one, start in zip(problem.free, starts, strict=True))
    return replace(problem, free=free)
