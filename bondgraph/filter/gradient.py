"""Exact derivatives of the innovations of a filter, and so of its likelihood, in any directions.

A direction moves parameters, initial states, and standard deviations of noises together; central differences would
filter twice for each. The whitened innovations z and log scales of :func:`bondgraph.filter.likelihood.innovations`
with their derivatives give the gradient of the negative log-likelihood, sum(z dz + dlog s), and Fisher's information.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from bondgraph.arrays import FloatArray, aligned_zeros
from bondgraph.compile.lanes.load import TangentLanes, load_tangents
from bondgraph.compile.lanes.text import LANES
from bondgraph.compile.machine_code import has_numba, load_translated
from bondgraph.compile.rosenbrock import TABLEAUS
from bondgraph.errors import FilterError
from bondgraph.execute.threads import in_threads, thread_count
from bondgraph.filter import gradient_algebra, gradient_kernel, gradient_robust, kernel_channels, kernel_robust
from bondgraph.filter.compiled import log_rows
from bondgraph.filter.conditioning import depends_on_rounding
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.gradient_types import Found, Prior, Scratch, TangentEquations, TangentRules
from bondgraph.filter.samples import MeasuredLog, Samples
from bondgraph.filter.sigma_points import PIVOT_FLOOR
from bondgraph.filter.ukf import Member
from bondgraph.simulate.outcome import OUTCOMES, Outcome

#: So many directions are worth a thread of their own, which filters the log once more for them.
_WORTH_A_THREAD = 4


@dataclass(frozen=True)
class Directions:
    """How the numbers of a member move in each of D directions.

    theta (n_theta, D), x0 (n_x, D), initial_std and process_std (n_s, D), noise_std (n_y, D); correlations of initial
    states and process noise (n_s, n_s, D) and of the sensors (n_y, n_y, D), None where they stay.
    """

    theta: FloatArray
    x0: FloatArray
    initial_std: FloatArray
    process_std: FloatArray
    noise_std: FloatArray
    initial_correlation: FloatArray | None = None
    process_correlation: FloatArray | None = None
    noise_correlation: FloatArray | None = None


@dataclass(frozen=True)
class InnovationTangents:
    """Whitened innovations and log scales (n_y, n) of one log and their derivatives (n_y, n, D).

    Zero where nothing was measured; NaN throughout where the filter failed, or is ill-conditioned: derivatives tell.
    """

    log_name: str
    values: FloatArray
    log_scales: FloatArray
    d_values: FloatArray
    d_log_scales: FloatArray
    outcome: Outcome

    @property
    def gradient(self) -> FloatArray:
        """Derivatives of the negative log-likelihood, shape (D,)."""
        total: FloatArray = np.einsum("an,and->d", self.values, self.d_values) + self.d_log_scales.sum(axis=(0, 1))
        return total


def has_exact_gradient(filter_model: FilterModel) -> bool:
    """Whether there are exact derivatives: compiled, with a method that is decided, without appended parameters."""
    return filter_model.method != "auto" and not filter_model.appended and has_numba()


def innovation_tangents(
    filter_model: FilterModel,
    logs: Sequence[MeasuredLog],
    members: Sequence[Member],
    directions: Sequence[Directions],
    threads: int | None = None,
) -> tuple[InnovationTangents, ...]:
    """Innovations of logs with their derivatives.

    Parameters
    ----------
    filter_model
        With any method but ``"auto"``, and no appended parameters.
    logs, members, directions
        One member with its directions for each log. A parameter that a log knows does not move there.
    threads
        Threads over logs, and over directions where there are fewer logs; None: one per core. The result does not
        depend on it.

    Raises
    ------
    FilterError
        If the filter model has no exact gradient, or a log does not fit it.

    Examples
    --------
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.simulate.example import pendulum
    >>> model = pendulum()
    >>> swing = FilterModel(model, {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    >>> time = np.arange(40) * 0.05
    >>> log = MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> member = Member.of(swing)
    >>> length = Directions(np.eye(3)[:, :1], *(np.zeros((size, 1)) for size in (2, 2, 2, 1)))
    >>> (found,) = innovation_tangents(swing, [log], [member], [length])
    >>> found.d_values.shape, found.gradient.shape
    ((1, 40, 1), (1,))
    """
    if not has_exact_gradient(filter_model):
        raise FilterError(
            f"{filter_model.model.name}: method {filter_model.method!r} with {len(filter_model.appended)} appended"
            " parameters has no exact gradient - name the method, append no parameters, and install numba",
            where=(filter_model.model.name, "method"),
        )
    moving = np.flatnonzero(np.any([np.any(each.theta != 0.0, axis=1) for each in directions], axis=0))
    tangents = load_tangents(filter_model.model, tuple(int(position) for position in moving), filter_model.method)
    kernels = (gradient_kernel, gradient_algebra, gradient_robust, kernel_channels, kernel_robust)
    run = load_translated("filter_with_tangents", *kernels)
    samples = [Samples.of(filter_model, log) for log in logs]

    def one(part: tuple[int, slice]) -> InnovationTangents:
        index, own = part
        some = _some(directions[index], own)
        scratch = _scratch(filter_model, tangents, some.theta.shape[1])
        found = _found(filter_model, samples[index], scratch)
        prior = _prior(filter_model, samples[index], members[index], some, moving)
        equations = TangentEquations(tangents.prepare, tangents.advance, tangents.measure, tangents.push)
        code = run(equations, log_rows(samples[index]), _rules(filter_model, tangents), prior, found, scratch)
        if code != 0:
            for array in found:
                array[...] = np.nan
        values, scales, d_values, d_scales = (array[:, samples[index].sample] for array in found)
        return InnovationTangents(samples[index].name, values, scales, d_values, d_scales, OUTCOMES[code])

    workers = thread_count(threads)
    count = directions[0].theta.shape[1] if directions else 0
    groups = _groups(count, -(-workers // max(len(samples), 1)))
    parts = [(index, own) for index in range(len(samples)) for own in groups]
    every = in_threads(workers, one, parts)
    size = len(groups)
    whole = [_side_by_side(every[first : first + size]) for first in range(0, len(every), size)]
    return tuple(_conditioned(*each) for each in zip(whole, members, directions, strict=True))


def _groups(count: int, most: int) -> list[slice]:
    """So many directions in groups of equal size, at most ``most``; few are not worth filtering the log once more."""
    groups = max(1, min(most, count // _WORTH_A_THREAD))
    edges = np.linspace(0, count, groups + 1).astype(int)
    return [slice(int(first), int(end)) for first, end in itertools.pairwise(edges)]


def _some(directions: Directions, own: slice) -> Directions:
    moves: dict[str, Any] = {field.name: getattr(directions, field.name) for field in fields(directions)}
    chosen: dict[str, Any] = {name: None if move is None else move[..., own] for name, move in moves.items()}
    return Directions(**chosen)


def _side_by_side(parts: Sequence[InnovationTangents]) -> InnovationTangents:
    """What groups of directions found along the same log; failed, as all of them are, if one of them did."""
    first = next((part for part in parts if part.outcome is not Outcome.OK), parts[0])
    return replace(
        first,
        d_values=np.concatenate([part.d_values for part in parts], axis=2),
        d_log_scales=np.concatenate([part.d_log_scales for part in parts], axis=2),
    )


def _conditioned(found: InnovationTangents, member: Member, directions: Directions) -> InnovationTangents:
    """What was found, or NaN where its derivatives are those of rounding."""
    size = 0.5 * float(np.sum(found.values**2)) + float(np.sum(np.abs(found.log_scales)))
    with np.errstate(over="ignore", invalid="ignore"):
        gradient = found.gradient
    if found.outcome is not Outcome.OK or not depends_on_rounding(size, gradient, _reach(member, directions)):
        return found
    arrays = ("values", "log_scales", "d_values", "d_log_scales")
    lost: dict[str, Any] = {name: np.full_like(getattr(found, name), np.nan) for name in arrays}
    return replace(found, outcome=Outcome.ILL_CONDITIONED, **lost)


def _reach(member: Member, directions: Directions) -> FloatArray:
    """How far each direction must be followed to change one of its numbers by that number's size, (D,)."""
    names = ("theta", "x0", "initial_std", "process_std", "noise_std")
    numbers = np.concatenate([np.nan_to_num(getattr(member, name)) for name in names])
    moves = np.concatenate([np.nan_to_num(getattr(directions, name)) for name in names])
    there = (numbers != 0.0)[:, np.newaxis] & (moves != 0.0)
    shares = np.where(there, np.abs(moves) / np.where(numbers == 0.0, 1.0, np.abs(numbers))[:, np.newaxis], 0.0)
    fastest = np.max(shares, axis=0, initial=0.0)
    reach: FloatArray = np.divide(1.0, fastest, out=np.zeros_like(fastest), where=fastest > 0.0)
    return reach


def _rules(filter_model: FilterModel, tangents: TangentLanes) -> TangentRules:
    points, layout = filter_model.points, tangents.layout
    return TangentRules(
        spread=points.spread,
        weight=points.weight,
        correction=points.correction,
        pivot_floor=PIVOT_FLOOR,
        tableau=TABLEAUS[filter_model.method].numbers if filter_model.is_stiff else np.empty(0),
        lanes=LANES,
        theta=layout.theta,
        x=layout.x,
        y=layout.y,
        din=layout.din,
        dy=layout.dy,
        robust=filter_model.robustness,
    )


def _prior(
    filter_model: FilterModel, samples: Samples, member: Member, directions: Directions, moving: np.ndarray
) -> Prior:
    seeds = directions.theta.copy()
    for name in samples.theta_overrides:
        seeds[filter_model.model.index("parameter", name)] = 0.0
    vectors = (
        samples.theta(filter_model, member.theta), member.x0, member.initial_lower, member.process_cov,
        member.noise_cov, seeds[moving].T, directions.x0, _moved_lower(member, directions),
        _moved(member.process_correlation, member.process_std, directions.process_correlation, directions.process_std),
        _moved(member.noise_correlation, np.nan_to_num(member.noise_std), directions.noise_correlation,
               directions.noise_std),
    )  # fmt: skip
    return Prior(*(np.array(vector, dtype=np.float64, order="C") for vector in vectors))


def _moved(correlation: FloatArray, std: FloatArray, d_correlation: FloatArray | None, d_std: FloatArray) -> FloatArray:
    """Derivatives (k, k, D) of a covariance by those of its correlations (k, k, D) and standard deviations (k, D)."""
    product = std[:, np.newaxis, np.newaxis] * d_std[np.newaxis]
    moved: FloatArray = correlation[..., np.newaxis] * (product + np.swapaxes(product, 0, 1))
    if d_correlation is not None:
        moved += d_correlation * np.outer(std, std)[..., np.newaxis]
    return moved


def _moved_lower(member: Member, directions: Directions) -> FloatArray:
    """Derivatives (n_s, n_s, D) of the factor of the initial covariance.

    Reference: Sarkka (2013), Bayesian Filtering and Smoothing, appendix A.3, for that of a Cholesky factor.
    """
    factor = np.linalg.cholesky(member.initial_correlation)
    moved: FloatArray = factor[..., np.newaxis] * directions.initial_std[:, np.newaxis]
    if directions.initial_correlation is None:
        return moved
    inverse = np.linalg.inv(factor)
    inner = np.einsum("ij,jkd,lk->ild", inverse, directions.initial_correlation, inverse)
    half = np.tril(np.ones(factor.shape), -1) + 0.5 * np.eye(factor.shape[0])
    d_factor = np.einsum("ij,jkd->ikd", factor, half[..., np.newaxis] * inner)
    moved += member.initial_std[:, np.newaxis, np.newaxis] * d_factor
    return moved


def _found(filter_model: FilterModel, samples: Samples, scratch: Scratch) -> Found:
    shape = (len(filter_model.model.outputs), samples.time.size)
    wide = (*shape, scratch.d_pivot.size)
    return Found(np.empty(shape), np.empty(shape), np.empty(wide), np.empty(wide))


def _scratch(filter_model: FilterModel, tangents: TangentLanes, count: int) -> Scratch:
    model = filter_model.model
    n_s, n_y = len(model.states), len(model.outputs)
    shapes: dict[str, tuple[int, ...]] = {
        "mean": (n_s,),
        "lower": (n_s, n_s),
        "points": (2 * n_s + 1, n_s),
        "outputs": (2 * n_s + 1, n_y),
        "shift": (max(n_s, n_y),),
        "slopes": (n_s,),
        "output_mean": (n_y,),
        "output_cov": (n_y, n_y),
        "joint": (n_y + n_s, n_y + n_s),
        "known": (n_y,),
    }
    values = {name: np.zeros(shape) for name, shape in shapes.items()}
    derivatives = {f"d_{name}": np.zeros((*shape, count)) for name, shape in shapes.items()}
    return Scratch(
        **values,
        **derivatives,
        d_pivot=np.zeros(count),
        channels=np.zeros(n_y, dtype=np.int64),
        buffer=tangents.buffer(),
        directions=aligned_zeros(count, tangents.layout.vectors * n_s * LANES),
        clock=np.zeros(2),
        inputs=np.zeros(2 * len(model.inputs)),
    )
