"""Particle swarm: a global search that needs no gradient, all particles evaluated as one batch.

    v <- inertia_weight v + cognitive r1 (personal_best - x) + social r2 (swarm_best - x),   x <- x + v

with r1, r2 uniform in [0, 1] per particle and coordinate. The default weights are the constriction of Clerc and
Kennedy (2002), The particle swarm - explosion, stability, and convergence, IEEE Trans. Evolutionary Computation 6(1);
the method is Kennedy and Eberhart (1995), Particle swarm optimization, IEEE Int. Conf. Neural Networks.

Neighbourhoods, schedules of the weights and walls are in :mod:`bondgraph.estimate.solvers.swarm_rules`. A swarm that
stalls may be placed anew; what it had found is kept.

All that the method asks of a value is whether it is below the particle's own best, so an evaluation may end as soon as
it is certain not to be: the search is the same in every number and takes less time. The one exception is a particle
that would have diverged after it was given up, and that finer integration steps would then have made an improvement.

Random numbers depend on the seed and the iteration only, so a search is the same on any number of threads and when it
is interrupted and continued.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar

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
from bondgraph.estimate.solvers.abstract import AbstractSearch, SearchResult, search_to_end
from bondgraph.estimate.solvers.hypercube import latin_hypercube
from bondgraph.estimate.solvers.swarm_rules import Global, Neighbourhood, Reflecting, Schedule, Walls


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
    neighbourhood, walls
        Whom a particle listens to, and what happens where it leaves the box.
    schedule
        Weights in place of the three above, as iterations go on.
    restarts
        How often a swarm that has stalled is placed anew.

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
    neighbourhood: Neighbourhood = field(default_factory=Global)
    walls: Walls = field(default_factory=Reflecting)
    schedule: Schedule | None = None
    restarts: int = 0

    def __post_init__(self) -> None:
        least_of = {"members": 2, "iterations": 0, "patience": 1, "tolerance": 0.0, "restarts": 0}
        for name, least in least_of.items():
            if not getattr(self, name) >= least:
                raise EstimationError(f"swarm: {name} = {getattr(self, name)} must be at least {least}", where=(name,))
        if self.schedule is not None:
            return
        spread = self.cognitive + self.social
        # Poli (2009), IEEE Trans. Evolutionary Computation 13(4): the variance of the particles stays finite.
        bound = 24.0 * (1.0 - self.inertia_weight**2) / (7.0 - 5.0 * self.inertia_weight)
        if not (abs(self.inertia_weight) < 1.0 and 0.0 < spread < bound):
            raise EstimationError(
                f"swarm: inertia_weight {self.inertia_weight:g} with cognitive + social = {spread:g} makes the swarm "
                f"explode - keep |inertia_weight| < 1 and the sum below {bound:.3g}",
                where=("inertia_weight", "cognitive", "social"),
            )

    def weights(self, iteration: int) -> tuple[float, float, float]:
        """Inertia, cognitive and social weight in an iteration."""
        if self.schedule is None:
            return self.inertia_weight, self.cognitive, self.social
        return self.schedule.weights(iteration / max(self.iterations, 1))


@dataclass(frozen=True)
class SwarmState:
    """A swarm after an iteration; arrays are (n, members) or (members,).

    Of the ``evaluations``, ``abandoned`` were ended when it was certain that they were no improvement; together they
    took as much time as ``whole`` evaluations that are not cut short. ``record`` (n,) is the best point of the swarms
    before the last of ``restarts``, which was at iteration ``placed``.
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
    record: FloatArray | None = None
    record_nll: float = math.inf
    restarts: int = 0
    placed: int = 0

    @property
    def swarm_best(self) -> FloatArray:
        """Best point so far, shape (n,)."""
        if self.record is not None and self.record_nll < float(self.personal_best_nll.min()):
            return self.record
        return self.personal_best[:, int(np.argmin(self.personal_best_nll))]

    @property
    def swarm_best_nll(self) -> float:
        """Value at the best point so far; infinite if none could be evaluated."""
        return min(float(self.personal_best_nll.min()), self.record_nll)


def _places(
    objective: Objective, start: FloatArray | None, members: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities (n, members) of particles that begin."""
    lower, width = objective.lower[:, np.newaxis], (objective.upper - objective.lower)[:, np.newaxis]
    positions = lower + width * latin_hypercube(objective.lower.size, members, rng)
    if start is not None:
        positions[:, 0] = start
    # Half of the way to another random point: as far as particles usually fly, and never far outside.
    targets = lower + width * rng.random(positions.shape)
    return positions, 0.5 * (targets - positions)


def _moved(
    objective: Objective, state: SwarmState, settings: SwarmSettings, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities (n, members) after every particle has flown on, inside the box."""
    own, swarm = rng.random((2, *state.positions.shape))
    inertia, cognitive, social = settings.weights(state.iteration)
    informants = settings.neighbourhood.informants(state.personal_best_nll)
    velocities = (
        inertia * state.velocities
        + cognitive * own * (state.personal_best - state.positions)
        + social * swarm * (state.personal_best[:, informants] - state.positions)
    )
    return settings.walls.keep(state.positions + velocities, velocities, objective.lower, objective.upper)


def _placed_anew(objective: Objective, state: SwarmState, rng: np.random.Generator) -> SwarmState:
    members = state.positions.shape[1]
    positions, velocities = _places(objective, None, members, rng)
    return _traced(
        replace(
            state,
            iteration=state.iteration + 1,
            positions=positions,
            velocities=velocities,
            personal_best=positions.copy(),
            personal_best_nll=_finite_or_inf(objective.nll(positions)),
            evaluations=state.evaluations + members,
            whole=state.whole + float(members),
            record=state.swarm_best,
            record_nll=state.swarm_best_nll,
            restarts=state.restarts + 1,
            placed=state.iteration + 1,
        )
    )


def _has_stalled(state: SwarmState, settings: SwarmSettings) -> bool:
    """Whether the particles, since they were placed, gained too little for too long."""
    if state.iteration - state.placed < settings.patience or not np.isfinite(state.swarm_best_nll):
        return False
    before = state.trace[-1 - settings.patience].nll
    return before - state.swarm_best_nll < settings.tolerance


@dataclass(frozen=True)
class ParticleSwarm(AbstractSearch[SwarmState]):
    """The swarm as a search: its settings, and the seed of its random numbers."""

    settings: SwarmSettings = field(default_factory=SwarmSettings)
    seed: int = 0

    stage: ClassVar[str] = "swarm"

    @property
    def most_evaluations(self) -> int:
        """Every particle in every iteration."""
        return self.settings.members * (1 + self.settings.iterations)

    def init(self, objective: Objective, starts: FloatArray) -> SwarmState:
        """Particles as a Latin hypercube over the box, the first at the first start."""
        count = self.settings.members
        positions, velocities = _places(objective, starts[:, 0], count, np.random.default_rng([self.seed, 0]))
        values = _finite_or_inf(objective.nll(positions))
        return _traced(SwarmState(0, positions, velocities, positions.copy(), values, count, (), whole=float(count)))

    def step(self, objective: Objective, state: SwarmState) -> SwarmState:
        """One iteration: move every particle, evaluate all, keep the bests; a stalled swarm is placed anew."""
        settings, rng = self.settings, np.random.default_rng([self.seed, state.iteration + 1])
        if _has_stalled(state, settings) and state.restarts < settings.restarts:
            return _placed_anew(objective, state, rng)
        positions, velocities = _moved(objective, state, settings, rng)
        abandons, limits = settings.abandon, state.personal_best_nll
        found = nll_below(objective, positions, limits) if abandons else Below.whole(objective.nll(positions))
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

    def ended(self, state: SwarmState) -> SearchOutcome | None:
        """Why the search ends here, or None if it goes on."""
        settings = self.settings
        if not np.isfinite(state.swarm_best_nll):
            hopeless = state.iteration >= min(settings.patience, settings.iterations)
            return SearchOutcome.NO_FINITE_POINT if hopeless else None
        if _has_stalled(state, settings) and state.restarts >= settings.restarts:
            return SearchOutcome.STALLED
        return SearchOutcome.ITERATION_LIMIT if state.iteration >= settings.iterations else None

    def result(self, state: SwarmState) -> SearchResult:
        """The particles' bests, and that of the swarms before."""
        if state.record is None:
            return SearchResult(state.personal_best, state.personal_best_nll, state.abandoned)
        points = np.concatenate([state.record[:, np.newaxis], state.personal_best], axis=1)
        return SearchResult(points, np.append(state.record_nll, state.personal_best_nll), state.abandoned)


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
    return search_to_end(ParticleSwarm(settings or SwarmSettings(), seed), objective, start, progress)


def _finite_or_inf(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.inf)


def _traced(state: SwarmState) -> SwarmState:
    row = TraceRow(
        "swarm", state.iteration, state.evaluations, state.swarm_best_nll, tuple(float(v) for v in state.swarm_best)
    )
    return replace(state, trace=(*state.trace, row))
