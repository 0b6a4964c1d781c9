"""Steps of the gradient search: from an expansion of the likelihood at a point to trial points inside the box."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.estimate.objective import BoolArray, Expansion, FloatArray, Objective, Terms, over_terms
from bondgraph.estimate.symmetric import informed, scaled_eigen

#: Share of the box's width within which a coordinate is at its wall: the draws of a swarm end beside walls, not at
#: them. A gradient of a thousand nats over the whole width gains a millionth of one nat on that way.
_AT_WALL = 1e-9


def newton_decrement(objective: Objective, point: FloatArray, expansion: Expansion) -> float:
    """Nats by which the likelihood would improve if it were quadratic and the box had no further walls."""
    held = held_at_walls(objective, point, expansion.gradient)
    free = ~held
    gradient = expansion.gradient[free]
    # A coordinate that does nothing has a gradient of rounding errors; against its bounds that counts as nothing.
    information = expansion.information[np.ix_(free, free)] + np.diag(_floor(objective)[free])
    found = scaled_eigen(information)
    shares = found.vectors.T @ (found.scale * np.where(found.scale > 0.0, gradient, 0.0))
    # Directions of which the data say nothing but rounding promise nothing.
    told = found.values > 1e-14 * max(found.largest, 1e-300)
    return 0.5 * float(np.sum(shares[told] ** 2 / found.values[told]))


def damped_step(objective: Objective, point: FloatArray, expansion: Expansion, damping: float) -> FloatArray:
    """The trial point for one damping: a step in the free coordinates, the others stopped at their walls.

    Returns
    -------
    FloatArray
        Shape (n,), inside the box.
    """
    held = held_at_walls(objective, point, expansion.gradient)
    scale = np.diag(expansion.information) + _floor(objective)
    rates = np.where(known_noise_levels(objective), 1.0, noise_level_rates(expansion))
    trial = point.copy()
    while not held.all():
        free = ~held
        matrix = expansion.information[np.ix_(free, free)] + damping * np.diag(scale[free])
        # The step that coordinates already at a wall take pulls on the others.
        push = expansion.gradient[free] + expansion.information[np.ix_(free, held)] @ (trial - point)[held]
        trial[free] = point[free] + _noise_level_steps(-_solve(matrix, push, scale[free]), rates[free])
        outside = free & ((trial < objective.lower) | (trial > objective.upper))
        if not outside.any():
            break
        trial = np.clip(trial, objective.lower, objective.upper)
        held = held | outside
    return trial


def _floor(objective: Objective) -> FloatArray:
    """Information that would leave a coordinate a thousand times wider than its bounds, shape (n,)."""
    width = np.where(objective.upper > objective.lower, objective.upper - objective.lower, 1.0)
    floor: FloatArray = 1e-6 / width**2
    return floor


def noise_level_rates(expansion: Expansion) -> FloatArray:
    """Of coordinates that set noise levels, how fast log s follows them; zero for all others. Shape (n,)."""
    size = expansion.gradient.size
    if expansion.terms is None:
        return np.zeros(size)
    slopes = expansion.terms.log_scales[:, 1:]
    squares = np.sum(slopes**2, axis=0)
    is_level = 2.0 * squares > 0.5 * np.diag(expansion.information)
    mean = squares / np.maximum(np.abs(slopes).sum(axis=0), 1e-300)
    return np.where(is_level, np.sign(slopes.sum(axis=0)) * mean, 0.0)


def known_noise_levels(objective: Objective) -> BoolArray:
    """Coordinates that an objective names, by ``noise_levels`` (n,), as logarithms of standard deviations of noises."""
    named = getattr(objective, "noise_levels", None)
    return np.zeros(objective.lower.size, dtype=np.bool_) if named is None else np.asarray(named)


def _noise_level_steps(steps: FloatArray, rates: FloatArray) -> FloatArray:
    """Steps of noise levels in closed form.

    With S = sum of z^2 / n, a scoring step moves log s by (S - 1) / 2: never below -1/2 and far too far up, while the
    optimum is (log S) / 2 away. At rate 1 this is a scoring step in the variance, to which the variance of every
    innovation is linear however little of it the noise makes up; from a level next to nothing a step in its logarithm
    would lead out of every bound, and a damped one would creep.
    """
    ratio = np.maximum(1.0 + 2.0 * rates * steps, 1e-3)
    return np.where(rates == 0.0, steps, 0.5 * np.log(ratio) / np.where(rates == 0.0, 1.0, rates))


def _solve(matrix: FloatArray, right: FloatArray, scale: FloatArray) -> FloatArray:
    """The step in scaled coordinates; those without finite derivatives stay."""
    told = informed(matrix) & np.isfinite(right)
    solution = np.zeros(right.size)
    root = np.sqrt(scale[told])
    within = matrix[np.ix_(told, told)] / np.outer(root, root)
    solution[told] = np.linalg.lstsq(within, right[told] / root, rcond=1e-15)[0] / root
    return solution


def held_at_walls(objective: Objective, point: FloatArray, gradient: FloatArray) -> BoolArray:
    """Coordinates at a wall through which the likelihood would still rise, and those that are fixed."""
    near = _AT_WALL * (objective.upper - objective.lower)
    at_lower = (point <= objective.lower + near) & (gradient > 0.0)
    at_upper = (point >= objective.upper - near) & (gradient < 0.0)
    return at_lower | at_upper | (objective.upper <= objective.lower)


def promised_gain(expansion: Expansion, move: FloatArray) -> float:
    """Nats that a move (n,) would gain if the likelihood were quadratic."""
    return -float(expansion.gradient @ move + 0.5 * move @ expansion.information @ move)


def bent_steps(
    objective: Objective,
    point: FloatArray,
    expansion: Expansion,
    trials: FloatArray,
    dampings: FloatArray,
    seen: Terms,
) -> FloatArray:
    """Trials corrected to second order: terms seen at a trial minus their linear prediction tell the curvature.

    Where good parameters lie along a curved valley, straight steps must be short; bent ones follow it. Reference:
    Transtrum and Sethna (2012), Improvements to the Levenberg-Marquardt algorithm for nonlinear least-squares
    minimization, arXiv:1201.5885; here the trial itself serves as the point at which curvature is measured.

    Parameters
    ----------
    objective
        For its box.
    point, expansion
        Where the search stands, shape (n,), and what is known there, with its terms.
    trials, dampings
        Straight trials, shape (n, trials), and the damping of each.
    seen
        Terms at the trials.

    Returns
    -------
    FloatArray
        Shape (n, trials), inside the box.
    """
    if expansion.terms is None:
        return trials
    known_z, known_s = expansion.terms.innovations, expansion.terms.log_scales
    moves = trials - point[:, np.newaxis]
    with np.errstate(invalid="ignore", over="ignore"):
        miss_z = seen.innovations - (known_z[:, :1] + np.einsum("ia,ab->ib", known_z[:, 1:], moves))
        miss_s = seen.log_scales - (known_s[:, :1] + np.einsum("ia,ab->ib", known_s[:, 1:], moves))
        slopes_e = known_z[:, 1:] + known_z[:, :1] * known_s[:, 1:]
        pulls = over_terms(slopes_e, miss_z + known_z[:, :1] * miss_s) + 2.0 * over_terms(known_s[:, 1:], miss_s)
    pulls = np.where(np.isfinite(pulls), pulls, 0.0)
    bent = [
        damped_step(objective, point, replace(expansion, gradient=expansion.gradient + pull), float(damping))
        for pull, damping in zip(pulls.T, dampings, strict=True)
    ]
    return np.array(bent).T
