"""Initial states of logs: as declared, or from the first measurements of states that are measured directly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.objective import FloatArray
from bondgraph.simulate.model import Model

#: ``"measured"``: measured states start at their first measurement; ``"model"``: all start as declared.
InitialRule = Literal["measured", "model"]


def initial_states(model: Model, logs: Sequence[MatchedLog], theta: FloatArray, rule: InitialRule) -> list[FloatArray]:
    """Initial state of each log, shape (n_x,).

    Parameters
    ----------
    model
        The model; an output that is a straight line in one state and in nothing else measures that state.
    logs
        Matched logs; a parameter known for a log counts.
    theta
        Parameters, shape (n_theta,).
    rule
        Where initial states come from. States that are not measured, or only later than a twentieth of the log, start
        as declared.

    Raises
    ------
    EstimationError
        If the rule is not one of the two.
    """
    if rule not in ("measured", "model"):
        raise EstimationError(f"initial states: rule {rule!r} is neither 'measured' nor 'model'", where=(rule,))
    if rule == "model":
        return [model.x0() for _ in logs]
    return [_from_measurements(model, log, theta) for log in logs]


def _from_measurements(model: Model, log: MatchedLog, theta: FloatArray) -> FloatArray:
    known = theta.copy()
    for name, value in log.theta_overrides.items():
        known[model.index("parameter", name)] = value
    x0 = model.x0()
    early = log.time <= log.time[0] + 0.05 * (log.time[-1] - log.time[0])
    for output, (state, slope, offset) in directly_measured(model, log.u[:, 0], known).items():
        first = np.flatnonzero(~np.isnan(log.y[output]) & early)
        if first.size:
            x0[state] = (log.y[output, first[0]] - offset) / slope
    return x0


def directly_measured(model: Model, u: FloatArray, theta: FloatArray) -> dict[int, tuple[int, float, float]]:
    """Outputs that are slope * state + offset for one state only: output -> (state, slope, offset).

    Found by probing the output equations at states drawn around the declared ones; where two outputs measure the same
    state the first counts.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> directly_measured(pendulum(), np.zeros(1), pendulum().theta())
    {}
    """
    size = len(model.states)
    middle = model.x0()
    reach = np.maximum(np.abs(middle), 1.0)
    rng = np.random.default_rng(0)
    probes = middle[:, np.newaxis] + reach[:, np.newaxis] * rng.uniform(-1.0, 1.0, (size, 4 * size + 8))
    with np.errstate(all="ignore"):
        outputs = model.output(0.0, probes, u, theta)
    found: dict[int, tuple[int, float, float]] = {}
    for index, row in enumerate(outputs):
        if not np.isfinite(row).all():
            continue
        columns = np.vstack([probes, np.ones(probes.shape[1])])
        coefficients = np.linalg.lstsq(columns.T, row)[0]
        straight = np.allclose(columns.T @ coefficients, row, rtol=1e-9, atol=1e-9 * np.ptp(row))
        acting = np.flatnonzero(np.abs(coefficients[:-1]) * reach > 1e-9 * max(float(np.ptp(row)), 1e-300))
        if (
            straight
            and np.ptp(row) > 0.0
            and acting.size == 1
            and acting[0] not in {state for state, _, _ in found.values()}
        ):
            found[index] = (int(acting[0]), float(coefficients[acting[0]]), float(coefficients[-1]))
    return found
