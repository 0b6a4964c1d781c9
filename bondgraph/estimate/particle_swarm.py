"""Particle swarm: a global search that needs no gradient, all particles evaluated as one batch.

    v <- inertia_weight v + cognitive r1 (personal_best - x) + social r2 (swarm_best - x),   x <- x + v

with r1, r2 uniform in [0, 1] per particle and coordinate. The default weights are the constriction of Clerc and
Kennedy (2002), The particle swarm - explosion, stability, and convergence, IEEE Trans. Evolutionary Computation 6(1);
the method is Kennedy and Eberhart (1995), Particle swarm optimization, IEEE Int. Conf. Neural Networks.

All that the method asks of a value is whether it is below the particle's own best, so an evaluation may end as soon as
it is certain not to be: the search is the same in every number and takes less time. The one exception is a particle
that would have diverged after it was given up, and that finer integration steps would then have made an improvement.

Random numbers depend on the seed and the iteration only, so a search is the same on any number of threads and when it
is interrupted and continued.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bondgraph.errors import EstimationError
from bondgraph.estimate.objective import (
    Below,
    FloatArray,
    Objective,
    Progress,
    SearchOutcome,
    TraceRow,
    nll_below,
    silent,
)


@dataclass(frozen=True)
class SwarmSettings:
    """Settings of a particle swarm.

    Parameters
    ----------
    members
        Particles.
    iterations
        Most iterations after the first placement.
    inertia_weight, cognitive, social
        Weights of the old velocity, the particle's own best and the swarm's best.
    patience, tolerance
        The search stops when the best value fell by less than ``tolerance`` in ``patience`` iterations.
    abandon
        End an evaluation when it is certain that the particle does not come below its own best.

    Raises
    ------
    EstimationError
        If a number is out of its range.
    """

    members: int = 40
    iterations: int = 100
    inertia_weight: float = 0.7298
    cognitive: float = 1.49618
    social: float = 1.49618
    patience: int = 25
    tolerance: float = 1e-3
    abandon: bool = True

    def __post_init__(self) -> None:
        for name, least in (("members", 2), ("iterations", 0), ("patience", 1), ("tolerance", 0.0)):
            if not getattr(self, name) >= least:
                raise EstimationError(f"swarm: {name} = {getattr(self, name)} must be at least {least}", where=(name,))
        spread = self.cognitive + self.social
        # Poli (2009), IEEE Trans. Evolutionary Computation 13(4): the variance of the particles stays finite.
        bound = 24.0 * (1.0 - self.inertia_weight**2) / (7.0 - 5.0 * self.inertia_weight)
        if not (abs(self.inertia_weight) < 1.0 and 0.0 < spread < bound):
            raise EstimationError(
                f"swarm: inertia_weight {self.inertia_weight:g} with cognitive + social = {spread:g} makes the swarm "
                f"explode - keep |inertia_weight| < 1 and the sum below {bound:.3g}",
                where=("inertia_weight", "cognitive", "social"),
            )


@dataclass(frozen=True)
class SwarmState:
    """A swarm after an iteration; arrays are (n, members) or (members,).

    Of the ``evaluations``, ``abandoned`` were ended when it was certain that they were no improvement; together they
    took as much time as ``whole`` evaluations that are not cut short.
    """

    iteration: int
    positions: FloatArray
    velocities: FloatArray
    personal_best: FloatArray
    personal_best_nll: FloatArray
    evaluations: int
    trace: tuple[TraceRow, ...]
    abandoned: int = 0
    whole: float = 0.0

    @property
    def swarm_best(self) -> FloatArray:
        """Best point so far, shape (n,)."""
        return self.personal_best[:, int(np.argmin(self.personal_best_nll))]

    @property
    def swarm_best_nll(self) -> float:
        """Value at the best point so far; infinite if none could be evaluated."""
        return float(self.personal_best_nll.min())


def initial_swarm(objective: Objective, start: FloatArray, settings: SwarmSettings, seed: int) -> SwarmState:
    """Place the particles: the first at ``start``, the others as a Latin hypercube over the box."""
    rng = np.random.default_rng([seed, 0])
    size, members = objective.lower.size, settings.members
    width = (objective.upper - objective.lower)[:, np.newaxis]
    strata = np.array([rng.permutation(members) for _ in range(size)]).reshape(size, members)
    positions = objective.lower[:, np.newaxis] + width * (strata + rng.random((size, members))) / members
    positions[:, 0] = start
    # Half of the way to another random point: as far as particles usually fly, and never far outside.
    targets = objective.lower[:, np.newaxis] + width * rng.random((size, members))
    values = _finite_or_inf(objective.nll(positions))
    state = SwarmState(
        0, positions, 0.5 * (targets - positions), positions.copy(), values, members, (), whole=float(members)
    )
    return _traced(state)


def step_swarm(objective: Objective, state: SwarmState, settings: SwarmSettings, seed: int) -> SwarmState:
    """One iteration: move every particle, evaluate all, keep the bests."""
    rng = np.random.default_rng([seed, state.iteration + 1])
    own, swarm = rng.random((2, *state.positions.shape))
    velocities = (
        settings.inertia_weight * state.velocities
        + settings.cognitive * own * (state.personal_best - state.positions)
        + settings.social * swarm * (state.swarm_best[:, np.newaxis] - state.positions)
    )
    positions, velocities = reflect(state.positions + velocities, velocities, objective.lower, objective.upper)
    found = _evaluate(objective, positions, state.personal_best_nll, settings)
    values = _finite_or_inf(found.nll)
    better = values < state.personal_best_nll
    moved = replace(
        state,
        iteration=state.iteration + 1,
        positions=positions,
        velocities=velocities,
        personal_best=np.where(better, positions, state.personal_best),
        personal_best_nll=np.where(better, values, state.personal_best_nll),
        evaluations=state.evaluations + positions.shape[1],
        abandoned=state.abandoned + int(found.abandoned.sum()),
        whole=state.whole + float(found.share.sum()),
    )
    return _traced(moved)


def _evaluate(objective: Objective, positions: FloatArray, ceilings: FloatArray, settings: SwarmSettings) -> Below:
    return nll_below(objective, positions, ceilings) if settings.abandon else Below.whole(objective.nll(positions))


def swarm_ended(state: SwarmState, settings: SwarmSettings) -> SearchOutcome | None:
    """Why the search ends here, or None if it goes on."""
    if not np.isfinite(state.swarm_best_nll):
        return SearchOutcome.NO_FINITE_POINT if state.iteration >= min(settings.patience, settings.iterations) else None
    if len(state.trace) > settings.patience:
        before = state.trace[-1 - settings.patience].nll
        if before - state.swarm_best_nll < settings.tolerance:
            return SearchOutcome.STALLED
    return SearchOutcome.ITERATION_LIMIT if state.iteration >= settings.iterations else None


def particle_swarm(
    objective: Objective,
    start: FloatArray,
    seed: int,
    settings: SwarmSettings | None = None,
    progress: Progress = silent,
) -> tuple[SwarmState, SearchOutcome]:
    """Search the box of an objective with a particle swarm.

    Parameters
    ----------
    objective
        What to minimise, with its box.
    start
        Where the first particle starts, shape (n,).
    seed
        The same seed gives the same search.
    settings
        Size, weights and stop rules.
    progress
        Called after every iteration.

    Returns
    -------
    tuple[SwarmState, SearchOutcome]
        Final swarm with its trace, and why it stopped.

    Examples
    --------
    >>> class Bowl:
    ...     lower, upper = np.full(2, -5.0), np.full(2, 5.0)
    ...     def nll(self, points):
    ...         return ((points - 1.0) ** 2).sum(axis=0)
    >>> state, outcome = particle_swarm(Bowl(), np.zeros(2), seed=1)
    >>> state.swarm_best.round(1).tolist(), outcome.name
    ([1.0, 1.0], 'STALLED')
    """
    settings = settings or SwarmSettings()
    state = initial_swarm(objective, start, settings, seed)
    progress(state.trace[-1])
    while (outcome := swarm_ended(state, settings)) is None:
        state = step_swarm(objective, state, settings, seed)
        progress(state.trace[-1])
    return state, outcome


def reflect(
    positions: FloatArray, velocities: FloatArray, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Throw particles that left the box back from its walls, shape (n, members); bounds (n,).

    Examples
    --------
    >>> reflect(np.array([[1.25, -3.0]]), np.array([[0.5, -4.0]]), np.array([0.0]), np.array([1.0]))
    (array([[0.75, 1.  ]]), array([[-0.5,  4. ]]))
    """
    low, high = lower[:, np.newaxis], upper[:, np.newaxis]
    outside = (positions < low) | (positions > high)
    mirrored = np.where(
        positions < low, 2.0 * low - positions, np.where(positions > high, 2.0 * high - positions, positions)
    )
    # One that flew further than the box is wide stays at the wall it would be thrown to.
    return np.clip(mirrored, low, high), np.where(outside, -velocities, velocities)


def _finite_or_inf(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.inf)


def _traced(state: SwarmState) -> SwarmState:
    row = TraceRow(
        "swarm", state.iteration, state.evaluations, state.swarm_best_nll, tuple(float(v) for v in state.swarm_best)
    )
    return replace(state, trace=(*state.trace, row))
