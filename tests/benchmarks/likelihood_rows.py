"""Likelihoods of the vehicle: lanes against filterpy, numpy and scalar numba."""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from bondgraph.compile.cache import CACHE_VARIABLE
from bondgraph.compile.lanes.load import load_lanes
from bondgraph.compile.lanes.text import LANES
from bondgraph.compile.machine_code import load_compiled
from bondgraph.data.log import MatchedLog
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filterpy_bridge import filterpy_run
from bondgraph.filter.likelihood import likelihood
from bondgraph.simulate.model import Model
from tests.benchmarks.c_kernel import c_steps, has_compiler
from tests.benchmarks.cases import RANGER, Case, masses
from tests.benchmarks.scalar_filter import scalar_filter
from tests.benchmarks.timing import Action, side_by_side

#: Samples that are enough to time the slow candidates, and over which values are compared.
_FEW, _SOME, _COMPARED = 4, 40, 16
#: A change of the start in its last digit.
_LAST_DIGIT = 1e-15

MEMBERS = 80

_Result = TypeVar("_Result")


def scattered(case: Case, members: int, share: float = 0.02) -> np.ndarray:
    """Parameters around the declared ones, (n_theta, members); the first are the declared ones."""
    theta = case.filter_model.model.theta()[:, np.newaxis]
    factors = np.random.default_rng(2).uniform(1.0 - share, 1.0 + share, (theta.size, members))
    factors[:, 0] = 1.0
    return theta * factors


def against_others(case: Case, rounds: int) -> dict[str, float]:
    """CPU seconds per sample and likelihood of each implementation, at equal settings, and the ratios."""
    # the others know noise at the samples only
    model, x0 = replace(case.filter_model, noise_scheme="sampled"), case.x0
    theta = scattered(case, MEMBERS)
    some, few = case.cut(_SOME), case.cut(_FEW)
    scalar = scalar_filter(model, some, model.model.theta(), x0)
    whole = case.log.time.size
    seconds = side_by_side(
        {
            "lanes, 80 members": (lambda: likelihood(model, case.log, theta, x0=x0, threads=1), whole * MEMBERS),
            "lanes, 1 member": (lambda: likelihood(model, case.log, x0=x0, threads=1), whole),
            "scalar numba": (scalar, _SOME),
            "numpy": (lambda: likelihood(model, few, x0=x0, compiled=False), _FEW),
            "filterpy 2.0.0": (lambda: filterpy_run(model, few, x0=x0), _FEW),
        },
        rounds,
    )
    fast = seconds["lanes, 80 members"]
    alphas = [replace(model, alpha=alpha) for alpha in (1e-3, 1e-2, 0.1, 1.0)]
    compared = case.cut(_COMPARED)
    equal = max(abs(likelihood(m, compared, x0=x0).nll[0] / filterpy_run(m, compared, x0=x0).nll - 1.0) for m in alphas)
    return {
        **{f"ms_per_sample: {name}": 1e3 * value for name, value in seconds.items()},
        "ratio_vs_filterpy": seconds["filterpy 2.0.0"] / fast,
        "ratio_vs_numpy": seconds["numpy"] / fast,
        "ratio_vs_scalar_numba": seconds["scalar numba"] / fast,
        "ratio_vs_filterpy_one_member": seconds["filterpy 2.0.0"] / seconds["lanes, 1 member"],
        "ratio_vs_scalar_numba_one_member": seconds["scalar numba"] / seconds["lanes, 1 member"],
        "relative_difference_from_filterpy_alpha_0.001_to_1": equal,
        "relative_change_by_the_last_digit_of_the_start": max(_by_rounding(m, compared, x0) for m in alphas),
        "relative_difference_from_scalar_numba": abs(likelihood(model, some, x0=x0).nll[0] / scalar() - 1.0),
    }


def _by_rounding(model: FilterModel, log: MatchedLog, x0: np.ndarray) -> float:
    """How much of a likelihood is rounding: close sigma points and a stiff model leave it few digits."""
    value = likelihood(model, log, x0=x0).nll[0]
    moves = (_LAST_DIGIT * np.random.default_rng(seed).standard_normal(x0.shape) for seed in range(6))
    return max(float(abs(likelihood(model, log, x0=x0 * (1.0 + move)).nll[0] / value - 1.0)) for move in moves)


def growth(counts: Sequence[int], rounds: int) -> list[dict[str, object]]:
    """Chains of masses: CPU time until the model is simulated, of its first stiff likelihood, and then of likelihoods.

    Explicit equations are compiled for the simulation, stiff ones for the first likelihood, with an empty cache but for
    the kernel of the filter. Likelihoods are told per sample and member of 16.
    """
    rows: list[dict[str, object]] = []
    small = masses(1, samples=3)
    likelihood(small.filter_model, small.log)
    for count in counts:
        with tempfile.TemporaryDirectory() as folder, _cache(folder):
            case, made = _timed(lambda n=count: masses(n))
            theta = scattered(case, 16)
            used = {"rk4": case.filter_model, "ros3p": replace(case.filter_model, method="ros3p", substeps=4)}
            _, stiff = _timed(lambda m=used["ros3p"], p=theta, c=case: likelihood(m, c.cut(3), p))
        seconds = side_by_side(
            {
                name: (lambda m=m, c=case, p=theta: likelihood(m, c.log, p, threads=1), 16 * case.log.time.size)
                for name, m in used.items()
            },
            rounds,
        )
        rows.append(
            {
                "masses": count,
                "states": len(case.filter_model.model.states),
                "cpu_s_until_simulated": made,
                "cpu_s_first_stiff": stiff,
                **{f"ms_per_sample_{name}": 1e3 * value for name, value in seconds.items()},
            }
        )
    return rows


def _timed(action: Callable[[], _Result]) -> tuple[_Result, float]:
    """What an action gives, and the CPU seconds it takes."""
    start = time.process_time()
    result = action()
    return result, time.process_time() - start


@contextlib.contextmanager
def _cache(folder: str) -> Iterator[None]:
    """Compiled models are kept in another folder."""
    before = os.environ.get(CACHE_VARIABLE)
    os.environ[CACHE_VARIABLE] = folder
    try:
        yield
    finally:
        del os.environ[CACHE_VARIABLE]
        if before is not None:
            os.environ[CACHE_VARIABLE] = before


def growth_of_work(case: Case, rounds: int) -> list[dict[str, object]]:
    """CPU time against samples and members, on the vehicle with 25 Runge-Kutta steps."""
    rows: list[dict[str, object]] = []
    model = replace(case.filter_model, method="rk4", substeps=25)
    whole = case.log.time.size
    sizes = [(whole // 8, 16), (whole // 4, 16), (whole // 2, 16), (whole, 16)]
    sizes += [(whole // 4, members) for members in (1, 5, 32, 80)]

    def action(samples: int, members: int) -> Action:
        log, theta = case.cut(samples), scattered(case, members)
        return lambda: likelihood(model, log, theta, x0=case.x0, threads=1)

    actions = {f"{n} x {members}": (action(n, members), n * members) for n, members in sizes}
    for (samples, members), value in zip(sizes, side_by_side(actions, rounds).values(), strict=True):
        rows.append({"samples": samples, "members": members, "ms_per_sample_and_member": 1e3 * value})
    return rows


def against_c(rounds: int) -> dict[str, float]:
    """Runge-Kutta steps of 16 compiled lanes and in C from the same printed equations; on the driveline."""
    if not has_compiler():
        return {}
    model = Model.from_file(RANGER.with_name("driveline.py"))
    lanes, steps = load_lanes(model, stiff=False), 2000
    in_c, calls = c_steps(model), load_compiled(CALLS)
    buffers = [lanes.buffer(), lanes.buffer()]
    inputs, clock = np.concatenate([model.u0(), model.u0()]), np.zeros(2)
    for w in buffers:
        rows = w.reshape(-1, LANES)
        rows[lanes.theta : lanes.theta + len(model.parameters)] = model.theta()[:, np.newaxis]
        rows[lanes.x : lanes.x + len(model.states)] = model.x0()[:, np.newaxis]
        calls.call_prepare(lanes.prepare, w, LANES)
    u, none = model.u0(), np.empty(0)
    length = 1e-5 * steps

    def in_lanes() -> None:
        calls.call_advance(lanes.advance, 0.0, length, steps, 1.0, none, u, u, clock, inputs, buffers[0], LANES)

    in_lanes()
    in_c(buffers[1], 1e-5, steps, np.concatenate([u, u]))
    x = [w.reshape(-1, LANES)[lanes.x : lanes.x + len(model.states)].copy() for w in buffers]
    seconds = side_by_side(
        {
            "lanes": (in_lanes, steps * LANES),
            "C": (lambda: in_c(buffers[1], 1e-5, steps, np.concatenate([u, u])), steps * LANES),
        },
        rounds,
    )
    return {
        **{f"ns_per_step_and_lane: {name}": 1e9 * value for name, value in seconds.items()},
        "ratio_c_vs_lanes": seconds["C"] / seconds["lanes"],
        "relative_difference": float(np.max(np.abs(x[0] - x[1]) / (np.abs(x[0]) + 1e-9))),
    }


#: Calls of compiled functions from Python.
CALLS = """
from numba import njit

@njit
def call_prepare(f, w, n):
    f(w, n)

@njit
def call_advance(f, start, length, substeps, grading, tableau, u_left, u_right, clock, inputs, w, n):
    f(start, length, substeps, grading, tableau, u_left, u_right, clock, inputs, w, n)
"""
