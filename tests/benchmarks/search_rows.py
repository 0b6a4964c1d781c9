"""The thesis' search and the gradient search on the same 90 s of a drive: eight parameters of engine and CVT."""

from __future__ import annotations

import resource
import sys
import time
from dataclasses import replace

import numpy as np

from bondgraph.estimate.estimate import Settings, estimate
from bondgraph.estimate.exact import exact_derivatives
from bondgraph.estimate.objective import TraceRow
from bondgraph.estimate.particle_swarm import SwarmSettings, initial_swarm, step_swarm
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.filter.choice import choose_method
from tests.benchmarks.cases import DRIVELINE, Case

#: The thesis: 80 particles, their first places and 100 iterations.
MEMBERS, ITERATIONS = 80, 100


def search(case: Case, iterations: int = ITERATIONS) -> dict[str, float]:
    """Wall and processor time of both searches, their evaluations and likelihoods; starts a tenth off the truth."""
    started = time.perf_counter()
    filter_model = choose_method(replace(case.filter_model, method="auto", substeps=1), [case.log])
    planning = time.perf_counter() - started
    problem = pose(filter_model, [case.log], DRIVELINE)
    truth = problem.start.copy()
    away = np.clip(truth * np.where(np.arange(truth.size) % 2, 0.9, 1.1), problem.lower, problem.upper)
    found = {"wall_s: planning of the steps": planning, "nll: at the true parameters": _nll(problem, truth)}
    found |= _measured("gradient search", lambda: _gradient(problem, away))
    found |= _measured(f"swarm of {MEMBERS}", lambda: _swarm(problem, away, iterations))
    per_evaluation = found[f"cpu_s: swarm of {MEMBERS}"] / found[f"evaluations: swarm of {MEMBERS}"]
    found[f"cpu_s: {MEMBERS * (ITERATIONS + 1)} evaluations of the swarm at this rate"] = per_evaluation * (
        MEMBERS * (ITERATIONS + 1)
    )
    gap = found[f"nll: swarm of {MEMBERS}"] - found["nll: gradient search"]
    return {**found, "nats_of_the_swarm_above_the_gradient_search": gap}


def _nll(problem: EstimationProblem, point: np.ndarray) -> float:
    return float(problem.nll(point[:, np.newaxis])[0])


def _measured(name: str, action: object) -> dict[str, float]:
    wall, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF)
    nll, evaluations = action()  # type: ignore[operator]
    after = resource.getrusage(resource.RUSAGE_SELF)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {
        f"wall_s: {name}": time.perf_counter() - wall,
        f"cpu_s: {name}": cpu,
        f"evaluations: {name}": float(evaluations),
        f"nll: {name}": nll,
    }


def _gradient(problem: EstimationProblem, start: np.ndarray) -> tuple[float, int]:
    def say(row: TraceRow) -> None:
        print(f"\r  gradient search: iteration {row.iteration}, {row.nll:.3f}", end="", file=sys.stderr, flush=True)

    moved = replace(problem, free=tuple(replace(f, start=float(s)) for f, s in zip(problem.free, start, strict=True)))
    settings = Settings(method="gradient", starts=1, certify="none")
    result = estimate(moved, settings, progress=say, jacobian=exact_derivatives)
    print(file=sys.stderr)
    return float(result.nll), int(result.evaluations)


def _swarm(problem: EstimationProblem, start: np.ndarray, iterations: int) -> tuple[float, int]:
    settings = SwarmSettings(members=MEMBERS, iterations=iterations, patience=iterations + 1)
    state = initial_swarm(problem, start, settings, 0)
    for k in range(iterations):
        state = step_swarm(problem, state, settings, 0)
        print(f"\r  swarm: iteration {k + 1} of {iterations}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return float(np.min(state.personal_best_nll)), int(state.evaluations)
