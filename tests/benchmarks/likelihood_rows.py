"""Likelihoods of the vehicle: lanes against filterpy, numpy and scalar numba; stiff methods against Runge-Kutta."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.estimate.objective import expansion_of
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filterpy_bridge import filterpy_run
from bondgraph.filter.likelihood import innovations, likelihood
from bondgraph.simulate.compile import load_compiled
from bondgraph.simulate.model import Model
from bondgraph.simulate.program.lane_text import LANES
from bondgraph.simulate.program.lanes import load_lanes
from tests.benchmarks.c_kernel import c_steps, has_compiler
from tests.benchmarks.cases import FREE, RANGER, Case
from tests.benchmarks.scalar_filter import scalar_filter
from tests.benchmarks.timing import side_by_side

#: Samples that are enough to time the slow candidates.
_FEW, _SOME = 4, 40

MEMBERS = 80

#: The finest discretisation, which the others are compared with.
REFERENCE = {"method": "rk4", "substeps": 200}

METHODS = (
    {"method": "rk4", "substeps": 50},
    {"method": "ros3p", "substeps": 6, "grading": 2.0},
    {"method": "ros3p", "substeps": 16, "grading": 1.35},
    {"method": "ros3p", "substeps": 24, "grading": 1.15},
    {"method": "rodas4", "substeps": 12, "grading": 1.5},
)


def scattered(case: Case, members: int, share: float = 0.02) -> np.ndarray:
    """Parameters around the declared ones, (n_theta, members); the first are the declared ones."""
    theta = case.filter_model.model.theta()[:, np.newaxis]
    factors = np.random.default_rng(2).uniform(1.0 - share, 1.0 + share, (theta.size, members))
    factors[:, 0] = 1.0
    return theta * factors


def against_others(case: Case, rounds: int) -> dict[str, float]:
    """CPU seconds per sample and likelihood of each implementation, at equal settings, and the ratios."""
    model, x0 = case.filter_model, case.x0
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
    equal = abs(likelihood(model, few, x0=x0).nll[0] / filterpy_run(model, few, x0=x0).nll - 1.0)
    return {
        **{f"ms_per_sample: {name}": 1e3 * value for name, value in seconds.items()},
        "ratio_vs_filterpy": seconds["filterpy 2.0.0"] / fast,
        "ratio_vs_numpy": seconds["numpy"] / fast,
        "ratio_vs_scalar_numba": seconds["scalar numba"] / fast,
        "ratio_vs_filterpy_one_member": seconds["filterpy 2.0.0"] / seconds["lanes, 1 member"],
        "ratio_vs_scalar_numba_one_member": seconds["scalar numba"] / seconds["lanes, 1 member"],
        "relative_difference_from_filterpy": equal,
        "relative_difference_from_scalar_numba": abs(likelihood(model, some, x0=x0).nll[0] / scalar() - 1.0),
    }


def methods(case: Case, rounds: int) -> list[dict[str, object]]:
    """Speed of each method against Runge-Kutta, and how far it moves the likelihood and the estimate."""
    used = [replace(case.filter_model, **settings) for settings in METHODS]
    theta = scattered(case, 16)
    names = [f"{m.method} {m.substeps} x{m.grading:g}" for m in used]
    seconds = side_by_side(
        {
            name: (lambda m=m: likelihood(m, case.log, theta, x0=case.x0, threads=1), case.log.time.size * 16)
            for name, m in zip(names, used, strict=True)
        },
        rounds,
    )
    reference = replace(case.filter_model, **REFERENCE)
    _, _, rough = _expansion(case, reference, np.full(len(FREE), 1e-3))
    steps = np.clip(0.1 * np.sqrt(np.diag(np.linalg.inv(rough))), 1e-5, 0.1)
    nll, gradient, information = _expansion(case, reference, steps)
    rows: list[dict[str, object]] = []
    for name, model in zip(names, used, strict=True):
        value, slope, _ = _expansion(case, model, steps)
        covariance = np.linalg.inv(information)
        shift = np.abs(covariance @ (slope - gradient)) / np.sqrt(np.diag(covariance))
        wide = likelihood(model, case.log, scattered(case, 64, share=0.3), x0=case.x0)
        rows.append(
            {
                "method": name,
                "ms_per_sample": 1e3 * seconds[name],
                "ratio_stiff_vs_rk4": seconds[names[0]] / seconds[name],
                "nats": value - nll,
                "shift_sigma": float(shift.max()),
                "failed_of_64": sum(not np.isfinite(v) for v in wide.nll),
            }
        )
    return rows


def _expansion(case: Case, model: FilterModel, steps: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Likelihood at the true parameters, its gradient and Fisher information in relative changes of FREE.

    Differences over a tenth of a standard deviation look past the kinks that fixed steps leave in a likelihood.
    """
    theta = model.model.theta()
    positions = [model.model.index("parameter", name) for name in FREE]
    members = np.repeat(theta[:, np.newaxis], 2 * len(FREE) + 1, axis=1)
    for k, position in enumerate(positions):
        members[position, 1 + 2 * k] *= 1.0 + steps[k]
        members[position, 2 + 2 * k] *= 1.0 - steps[k]
    (record,) = innovations(model, case.log, members, x0=case.x0)
    z, s = (array.reshape(-1, members.shape[1]) for array in (record.values, record.log_scales))

    def slopes(terms: np.ndarray) -> np.ndarray:
        return np.column_stack([terms[:, 0], (terms[:, 1::2] - terms[:, 2::2]) / (2.0 * steps)])

    expansion = expansion_of(slopes(z), slopes(s), 0)
    return expansion.sum, expansion.gradient, expansion.information


def growth(cases: dict[int, Case], rounds: int) -> list[dict[str, object]]:
    """CPU time per sample against states, samples and members."""
    rows: list[dict[str, object]] = []
    for count, case in cases.items():
        theta = scattered(case, 16)
        stiff = replace(case.filter_model, method="ros3p", substeps=4)
        seconds = side_by_side(
            {
                "rk4": (
                    lambda c=case, p=theta: likelihood(c.filter_model, c.log, p, threads=1),
                    16 * case.log.time.size,
                ),
                "ros3p": (lambda m=stiff, c=case, p=theta: likelihood(m, c.log, p, threads=1), 16 * case.log.time.size),
            },
            rounds,
        )
        states = len(case.filter_model.model.states)
        rows.append({"masses": count, "states": states, **{f"ms_per_sample_{k}": 1e3 * v for k, v in seconds.items()}})
    return rows


def against_c(rounds: int) -> dict[str, float]:
    """Runge-Kutta steps of 16 lanes in numba and in C from the same printed equations; on the driveline."""
    if not has_compiler():
        return {}
    model = Model.from_file(RANGER.with_name("driveline.py"))
    lanes, steps = load_lanes(model, stiff=False), 2000
    in_c, calls = c_steps(model), load_compiled(_CALLS)
    buffers = [lanes.buffer(), lanes.buffer()]
    inputs, clock = np.concatenate([model.u0(), model.u0()]), np.zeros(2)
    for w in buffers:
        rows = w.reshape(-1, LANES)
        rows[lanes.theta : lanes.theta + len(model.parameters)] = model.theta()[:, np.newaxis]
        rows[lanes.x : lanes.x + len(model.states)] = model.x0()[:, np.newaxis]
        calls.call_prepare(lanes.prepare, w, LANES)
    u, none = model.u0(), np.empty(0)
    length = 1e-5 * steps

    def in_numba() -> None:
        calls.call_advance(lanes.advance, 0.0, length, steps, 1.0, none, u, u, clock, inputs, buffers[0], LANES)

    in_numba()
    in_c(buffers[1], 1e-5, steps, np.concatenate([u, u]))
    x = [w.reshape(-1, LANES)[lanes.x : lanes.x + len(model.states)].copy() for w in buffers]
    seconds = side_by_side(
        {
            "numba": (in_numba, steps * LANES),
            "C": (lambda: in_c(buffers[1], 1e-5, steps, np.concatenate([u, u])), steps * LANES),
        },
        rounds,
    )
    return {
        **{f"ns_per_step_and_lane: {name}": 1e9 * value for name, value in seconds.items()},
        "ratio_c_vs_numba": seconds["C"] / seconds["numba"],
        "relative_difference": float(np.max(np.abs(x[0] - x[1]) / (np.abs(x[0]) + 1e-9))),
    }


_CALLS = """
from numba import njit

@njit
def call_prepare(f, w, n):
    f(w, n)

@njit
def call_advance(f, start, length, substeps, grading, tableau, u_left, u_right, clock, inputs, w, n):
    f(start, length, substeps, grading, tableau, u_left, u_right, clock, inputs, w, n)
"""
