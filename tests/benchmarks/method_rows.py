"""Integration methods on the vehicle's driveline estimation: speed at an accuracy that is certified by its effect.

The eight parameters of engine and CVT that the thesis estimates, sensors with the noise of the page of the vehicle, and
two filters: one in which the inclination of the road is the only process noise, and one in which other states have some
too. A method is judged by how far its gradient moves the estimate at the true parameters, in standard deviations of
the estimate (from Fisher's information of the same data), compared with Runge-Kutta steps four times as short as they
must be to be stable.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.estimate.objective import expansion_of
from bondgraph.filter.choice import choose_method
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import innovations, likelihood
from bondgraph.filter.planning import plan_steps
from tests.benchmarks.cases import DRIVELINE, Case
from tests.benchmarks.timing import side_by_side

#: The finest discretisation, which the others are compared with.
REFERENCE = {"method": "rk4", "substeps": 200}

#: Uniform Runge-Kutta steps from which the fewest are sought that pass.
EXPLICIT = (40, 45, 50, 55, 60, 80, 100)

#: A shift that does not matter, in standard deviations.
CERTIFIED = 0.1

MEMBERS = 16


class Judge:
    """Likelihood, gradient and shift of methods on one case, at its true parameters."""

    def __init__(self, case: Case) -> None:
        self._case = case
        theta = case.filter_model.model.theta()
        self._positions = [case.filter_model.model.index("parameter", name) for name in DRIVELINE]
        rough = replace(case.filter_model, method="rodas4", substeps=32, grading=1.0)
        _, _, information = self._expansion(rough, np.full(len(DRIVELINE), 1e-3))
        # differences over a tenth of a standard deviation look past the kinks that fixed steps leave
        self._steps = np.clip(0.1 * np.sqrt(np.diag(np.linalg.inv(information))), 1e-6, 0.05)
        self.nll, self._gradient, information = self._expansion(replace(case.filter_model, **REFERENCE), self._steps)
        self._covariance = np.linalg.inv(information)
        self.std = np.sqrt(np.diag(self._covariance)) * np.abs(theta[self._positions])

    def shift(self, model: FilterModel) -> tuple[float, float]:
        """Change of the likelihood in nats, and the largest shift of a parameter in standard deviations."""
        value, gradient, _ = self._expansion(model, self._steps)
        moved = np.abs(self._covariance @ (gradient - self._gradient)) / np.sqrt(np.diag(self._covariance))
        return value - self.nll, float(moved.max()) if np.isfinite(moved).all() else float("inf")

    def _expansion(self, model: FilterModel, steps: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Likelihood, gradient and Fisher information in relative changes of the parameters."""
        members = np.repeat(model.model.theta()[:, np.newaxis], 2 * len(DRIVELINE) + 1, axis=1)
        for k, position in enumerate(self._positions):
            members[position, 1 + 2 * k] *= 1.0 + steps[k]
            members[position, 2 + 2 * k] *= 1.0 - steps[k]
        (record,) = innovations(model, self._case.log, members, x0=self._case.x0)
        z, s = (array.reshape(-1, members.shape[1]) for array in (record.values, record.log_scales))

        def slopes(terms: np.ndarray) -> np.ndarray:
            return np.column_stack([terms[:, 0], (terms[:, 1::2] - terms[:, 2::2]) / (2.0 * steps)])

        expansion = expansion_of(slopes(z), slopes(s), 0)
        return expansion.sum, expansion.gradient, expansion.information


def methods(case: Case, rounds: int) -> tuple[list[dict[str, object]], dict[str, float]]:
    """How far each method moves the estimate, and the times of those that matter; the chosen one in numbers.

    Times are compared with that of the fewest Runge-Kutta steps that pass.
    """
    judge, model = Judge(case), case.filter_model
    found: dict[str, tuple[FilterModel, float, float]] = {}

    def look(name: str, candidate: FilterModel) -> float:
        nats, shift = judge.shift(candidate)
        found[name] = (candidate, nats, shift)
        return shift

    look("rk4 25", replace(model, method="rk4", substeps=25))
    passed = next(n for n in EXPLICIT if look(f"rk4 {n}", replace(model, method="rk4", substeps=n)) < CERTIFIED)
    base = replace(model, method="rodas4", substeps=32, grading=1.0)
    look("ros3p 16 even", replace(base, method="ros3p", substeps=16))
    look("automatic", choose_method(replace(model, method="auto", substeps=1), [case.log]))
    look("rodas4 planned", plan_steps(base, [case.log], methods=("rodas4",)))
    timed = ["rk4 25", f"rk4 {passed}", "ros3p 16 even", "automatic", "rodas4 planned"]
    theta = np.repeat(model.model.theta()[:, np.newaxis], MEMBERS, axis=1)
    units = case.log.time.size * MEMBERS
    seconds = side_by_side(
        {
            name: (lambda m=found[name][0]: likelihood(m, case.log, theta, x0=case.x0, threads=1), units)
            for name in timed
        },
        rounds,
    )
    rows: list[dict[str, object]] = []
    for name, (candidate, nats, shift) in found.items():
        used = seconds.get(name, float("nan"))
        plan = candidate.plan
        rows.append(
            {
                "method": f"{name} ({candidate.method})",
                "steps": plan.mean_substeps if plan is not None else float(candidate.substeps),
                "ms_per_sample": 1e3 * used,
                "ratio_vs_certified_rk4": seconds[f"rk4 {passed}"] / used,
                "ratio_vs_rk4_25": seconds["rk4 25"] / used,
                "nats": nats,
                "shift_sigma": shift,
            }
        )
    return rows, {
        "ms_per_sample: chosen": 1e3 * seconds["automatic"],
        "ms_per_sample: certified rk4": 1e3 * seconds[f"rk4 {passed}"],
        "ratio_stiff_vs_rk4": seconds[f"rk4 {passed}"] / seconds["automatic"],
        "shift_sigma: chosen": found["automatic"][2],
    }


def failures(case: Case, seconds: float) -> list[dict[str, object]]:
    """Members of the box of the parameters and its corners whose likelihood is not finite, for four spreads."""
    log = case.cut(max(2, round(seconds * 40)))
    model = case.filter_model.model
    rng = np.random.default_rng(4)
    positions = [model.index("parameter", name) for name in DRIVELINE]
    lower, upper = (np.array([getattr(model.parameters[p], side) for p in positions]) for side in ("lower", "upper"))
    inside = rng.uniform(lower[:, None], upper[:, None], (len(positions), 128))
    corners = np.where(rng.random((len(positions), 128)) < 0.5, lower[:, None], upper[:, None])
    theta = np.repeat(model.theta()[:, np.newaxis], 256, axis=1)
    theta[positions] = np.concatenate([inside, corners], axis=1)
    rows: list[dict[str, object]] = []
    for alpha in (1e-3, 0.1, 0.5, 1.0):
        used = choose_method(replace(case.filter_model, method="auto", substeps=1, alpha=alpha), [log])
        found = likelihood(used, log, theta, x0=case.x0)
        rows.append(
            {
                "alpha": alpha,
                "method": used.method,
                "members": 256,
                "not_finite": int(np.sum(~np.isfinite(found.nll))),
                "repeated_with_half_steps": int(found.refined.sum()),
            }
        )
    return rows
