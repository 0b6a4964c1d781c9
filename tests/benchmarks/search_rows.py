"""The thesis' search and the gradient search on the same 90 s of a drive: eight parameters of engine and CVT."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from bondgraph.estimate.derivatives.exact import exact_derivatives
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.objective import TraceRow
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.result import Estimate
from bondgraph.estimate.solvers.particle_swarm import SwarmSettings, SwarmState, particle_swarm
from bondgraph.filter.choice import choose_method
from tests.benchmarks.cases import DRIVELINE, Case

#: The thesis: 80 particles, their first places and 100 iterations.
MEMBERS, ITERATIONS = 80, 100

#: Iterations of the swarm that gives no evaluation up: all evaluations of that one cost the same.
_WHOLE = 4

_Result = TypeVar("_Result")


def search(case: Case, iterations: int = ITERATIONS) -> dict[str, float]:
    """Wall and processor time of both searches, their evaluations and likelihoods; starts a tenth off the truth."""
    started = time.perf_counter()
    filter_model = choose_method(replace(case.filter_model, method="auto", substeps=1), [case.log])
    planning = time.perf_counter() - started
    problem = pose(filter_model, [case.log], DRIVELINE)
    truth = problem.start.copy()
    away = np.clip(truth * np.where(np.arange(truth.size) % 2, 0.9, 1.1), problem.lower, problem.upper)
    found = {"wall_s: planning of the steps": planning, "nll: at the true parameters": _nll(problem, truth)}
    fit, times = _measured(lambda: _gradient(problem, away))
    found |= _named("gradient search", times, fit.evaluations, fit.nll)
    ended, times = _measured(lambda: _swarm(problem, away, iterations, abandon=True))
    found |= _named(f"swarm of {MEMBERS}", times, ended.evaluations, ended.swarm_best_nll)
    found["evaluations given up: swarm"] = float(ended.abandoned)
    found["share of the samples filtered: swarm"] = ended.whole / ended.evaluations
    whole, whole_times = _measured(lambda: _swarm(problem, away, min(iterations, _WHOLE), abandon=False))
    found["cpu_s: an evaluation of the swarm"] = times.cpu / ended.evaluations
    found["cpu_s: an evaluation of a swarm that gives none up"] = whole_times.cpu / whole.evaluations
    found["ratio_swarm_that_gives_none_up_vs_swarm"] = (
        found["cpu_s: an evaluation of a swarm that gives none up"] / found["cpu_s: an evaluation of the swarm"]
    )
    gap = found[f"nll: swarm of {MEMBERS}"] - found["nll: gradient search"]
    return {**found, "nats_of_the_swarm_above_the_gradient_search": gap}


def _nll(problem: EstimationProblem, point: np.ndarray) -> float:
    return float(problem.nll(point[:, np.newaxis])[0])


class _Times(NamedTuple):
    """Wall and processor time, s."""

    wall: float
    cpu: float


def _measured(action: Callable[[], _Result]) -> tuple[_Result, _Times]:
    wall, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF)
    result = action()
    after = resource.getrusage(resource.RUSAGE_SELF)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return result, _Times(time.perf_counter() - wall, cpu)


def _named(name: str, times: _Times, evaluations: int, nll: float) -> dict[str, float]:
    return {
        f"wall_s: {name}": times.wall,
        f"cpu_s: {name}": times.cpu,
        f"evaluations: {name}": float(evaluations),
        f"nll: {name}": nll,
    }


def _gradient(problem: EstimationProblem, start: np.ndarray) -> Estimate:
    def say(row: TraceRow) -> None:
        print(f"\r  gradient search: iteration {row.iteration}, {row.nll:.3f}", end="", file=sys.stderr, flush=True)

    moved = replace(problem, free=tuple(replace(f, start=float(s)) for f, s in zip(problem.free, start, strict=True)))
    settings = Settings(method="gradient", starts=1, certify="none")
    result = estimate(moved, settings, progress=say, jacobian=exact_derivatives)
    print(file=sys.stderr)
    return result


def _swarm(problem: EstimationProblem, start: np.ndarray, iterations: int, *, abandon: bool) -> SwarmState:
    settings = SwarmSettings(members=MEMBERS, iterations=iterations, patience=iterations + 1, abandon=abandon)

    def say(row: TraceRow) -> None:
        print(f"\r  swarm: iteration {row.iteration} of {iterations}", end="", file=sys.stderr, flush=True)

    state, _ = particle_swarm(problem, start, 0, settings, say)
    print(file=sys.stderr)
    return state
