"""Logs as a filter model believes they come about: the truth for tests of filters and estimators.

Process noise drives the model between samples, at four times as many nodes as the filter has (of the sampled scheme: at
each sample, for the interval that it ends); at each sample the outputs are measured with their noise. An estimator that
is right about its model must recover the parameters of such logs, and a filter must be consistent on them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.data.log import MatchedLog
from bondgraph.errors import FilterError
from bondgraph.filter.decay_rule import MOST_INSIDE
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.samples import filter_nodes, inputs_between
from bondgraph.filter.ukf import Member
from bondgraph.simulate.batch import simulate_batch


@dataclass(frozen=True)
class DrawnLogs:
    """Logs drawn from one filter model, and the states (n, samples, logs) behind them."""

    logs: tuple[MatchedLog, ...]
    states: FloatArray


def draw_logs(
    filter_model: FilterModel,
    pattern: MatchedLog,
    count: int,
    seed: int,
    *,
    theta: FloatArray | None = None,
    x0: FloatArray | None = None,
    substeps: int | None = None,
    compiled: bool = True,
) -> DrawnLogs:
    """Draw logs with the times, inputs and gaps of a pattern.

    Parameters
    ----------
    filter_model
        Model and noises. Initial states are drawn too, with ``initial_std`` around ``x0``.
    pattern
        Its times and inputs; what it did not measure (NaN) is not measured in the drawn logs either.
    count
        How many logs.
    seed
        The same seed gives the same logs.
    theta, x0
        Parameters (n_theta,) and mean initial state (n_x,); None: declared values, those of the pattern first.
    substeps
        Runge-Kutta steps between samples; None: four times as many as the filter has, so that the truth does not share
        its discretisation error (give them where the filter has a stiff method, which needs fewer).
    compiled
        Integrate with the compiled model.

    Raises
    ------
    FilterError
        If the model diverges on the way.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1}, substeps=2)
    >>> pattern = MatchedLog("swing", np.arange(20) * 0.05, np.zeros((1, 20)), np.zeros((1, 20)))
    >>> drawn = draw_logs(swing, pattern, 3, seed=1, compiled=False)
    >>> [log.name for log in drawn.logs], drawn.states.shape
    (['swing_1', 'swing_2', 'swing_3'], (2, 20, 3))
    """
    rng = np.random.default_rng(seed)
    model = filter_model.model
    known = model.theta(**dict(pattern.theta_overrides)) if theta is None else np.asarray(theta, dtype=np.float64)
    start = filter_model.start_mean(known, model.x0(known) if x0 is None else np.asarray(x0, dtype=np.float64))
    steps = substeps or 4 * filter_model.substeps
    size, samples, n_x = start.size, len(pattern), len(model.states)
    states = np.empty((size, samples, count))
    states[:, 0] = start[:, np.newaxis] + Member.of(filter_model).initial_lower @ rng.standard_normal((size, count))
    members = np.repeat(known[:, np.newaxis], count, axis=1)
    root = filter_model.process_std[:, np.newaxis] * np.linalg.cholesky(filter_model.process_correlations)
    scheme, inside, reach = filter_model.noise_rule
    nodes = filter_nodes(model, (scheme, min(4 * max(inside, 1), MOST_INSIDE), reach), pattern.time)
    left, right = inputs_between(model, nodes, pattern.time, pattern.u)
    now = states[:, 0]
    for k, (start, end, share) in enumerate(zip(nodes.start, nodes.end, nodes.share, strict=True)):
        if start > 0.0:
            now = now + np.sqrt(start) * (root @ rng.standard_normal((size, count)))
        members[filter_model.appended_index] = now[n_x:]
        times = nodes.time[k : k + 2]
        step = simulate_batch(
            model, times, np.stack([left[:, k], right[:, k]], axis=1), members, now[:n_x],
            substeps=max(1, math.ceil(steps * min(share, 1.0))), compiled=compiled,
        )  # fmt: skip
        _check(step.x[:, 1], pattern, times)
        now = np.vstack([step.x[:, 1], now[n_x:]])
        now = now + np.sqrt(end) * (root @ rng.standard_normal((size, count)))
        states[:, nodes.sample == k + 1] = now[:, np.newaxis]
    y = _measured(filter_model, pattern, members, states, rng)
    logs = tuple(
        MatchedLog(f"{pattern.name}_{i + 1}", pattern.time, pattern.u, y[:, :, i], dict(pattern.theta_overrides))
        for i in range(count)
    )
    return DrawnLogs(logs, states)


def _measured(
    filter_model: FilterModel, pattern: MatchedLog, theta: FloatArray, states: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Outputs with their noise, (n_y, samples, logs); NaN where the pattern measured nothing or nobody listens."""
    n_x, appended = len(filter_model.model.states), filter_model.appended_index
    columns = []
    for i in range(states.shape[2]):
        member = np.repeat(theta[:, i : i + 1], states.shape[1], axis=1)
        member[appended] = states[n_x:, :, i]
        columns.append(filter_model.model.output(pattern.time, states[:n_x, :, i], pattern.u, member))
    clean = np.stack(columns, axis=-1)
    drawn = rng.standard_normal(clean.shape)
    sensors = np.einsum("ab,bkl->akl", np.linalg.cholesky(filter_model.noise_correlations), drawn)
    noise = filter_model.noise_std[:, np.newaxis, np.newaxis] * sensors
    measured: FloatArray = np.where(np.isnan(pattern.y)[:, :, np.newaxis], np.nan, clean + noise)
    return measured


def _check(x: FloatArray, pattern: MatchedLog, times: FloatArray) -> None:
    if not np.isfinite(x).all():
        raise FilterError(
            f"{pattern.name}: the model diverges between {times[0]:.6g} s and {times[1]:.6g} s"
            " - use more substeps, or check parameters, start and inputs",
            where=(pattern.name,),
        )
