"""The gradient of the vehicle's likelihood by ten parameters against its value."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.gradient import Directions, innovation_tangents
from bondgraph.filter.likelihood import likelihood
from bondgraph.filter.ukf import Member
from tests.benchmarks.cases import FREE, Case
from tests.benchmarks.timing import side_by_side

PARAMETERS = (*FREE, "F_p0", "mu_b")

#: Explicit and stiff.
METHODS = ({"method": "rk4", "substeps": 50}, {"method": "ros3p", "substeps": 16})

#: Relative steps of central differences. Long ones reach over kinks, which fixed integration steps leave in the
#: likelihood; short ones lose digits. What counts is the step with which they agree best.
STEPS = (1e-5, 1e-6, 1e-7, 1e-8)


def gradient(case: Case, rounds: int) -> dict[str, float]:
    """CPU time of the gradient over that of values, and its difference from central differences."""
    found: dict[str, float] = {}
    for settings in METHODS:
        numbers = _gradient(replace(case.filter_model, **settings), case, rounds)
        found |= {f"{name} ({settings['method']})": value for name, value in numbers.items()}
    return found


def _gradient(model: FilterModel, case: Case, rounds: int) -> dict[str, float]:
    theta = model.model.theta()
    positions = [model.model.index("parameter", name) for name in PARAMETERS]
    seeds = np.zeros((theta.size, len(positions)))
    seeds[positions, range(len(positions))] = theta[positions]
    still = {
        "x0": theta,
        "initial_std": model.start_std,
        "process_std": model.process_std,
        "noise_std": model.noise_std,
    }
    sizes = {**{name: array.size for name, array in still.items()}, "x0": len(model.model.states)}
    directions = Directions(seeds, **{name: np.zeros((size, len(positions))) for name, size in sizes.items()})
    member = Member.of(model, theta, case.x0)
    moved = _moved(theta, seeds, STEPS[0])
    sixteen = np.repeat(theta[:, None], 16, axis=1)
    samples = case.log.time.size
    seconds = side_by_side(
        {
            "gradient": (lambda: innovation_tangents(model, [case.log], [member], [directions], 1), samples),
            "value": (lambda: likelihood(model, case.log, x0=case.x0, threads=1), samples),
            "value of 16": (lambda: likelihood(model, case.log, sixteen, x0=case.x0, threads=1), 16 * samples),
            "differences": (lambda: likelihood(model, case.log, moved, x0=case.x0, threads=1), samples),
        },
        rounds,
    )
    (found,) = innovation_tangents(model, [case.log], [member], [directions], 1)
    rough = [_differences(model, case, theta, seeds, step) for step in STEPS]
    return {
        **{f"ms_per_sample: {name}": 1e3 * value for name, value in seconds.items()},
        "ratio_gradient_vs_value": seconds["gradient"] / seconds["value"],
        "ratio_gradient_vs_value_of_16": seconds["gradient"] / seconds["value of 16"],
        "ratio_differences_vs_gradient": seconds["differences"] / seconds["gradient"],
        "relative_difference": min(float(np.max(np.abs(found.gradient - r)) / np.max(np.abs(r))) for r in rough),
    }


def _moved(theta: np.ndarray, seeds: np.ndarray, step: float) -> np.ndarray:
    """Members on both sides of a point, (n_theta, 2 directions)."""
    return np.concatenate([theta[:, None] + step * seeds, theta[:, None] - step * seeds], axis=1)


def _differences(model: FilterModel, case: Case, theta: np.ndarray, seeds: np.ndarray, step: float) -> np.ndarray:
    """Central differences of the likelihood, (directions,)."""
    nll = likelihood(model, case.log, _moved(theta, seeds, step), x0=case.x0).nll
    return (nll[: seeds.shape[1]] - nll[seeds.shape[1] :]) / (2.0 * step)
