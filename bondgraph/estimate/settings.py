"""Settings of an estimation."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, get_args

from bondgraph.errors import OptionError, suggest
from bondgraph.estimate.certify import Depth
from bondgraph.estimate.continuation import Continuation
from bondgraph.estimate.handover import explored
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.methods import METHODS
from bondgraph.estimate.solvers.abstract import AbstractSearch
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings
from bondgraph.estimate.solvers.particle_swarm import ParticleSwarm, SwarmSettings


@dataclass(frozen=True)
class Settings:
    """Settings of an estimation.

    Parameters
    ----------
    method
        A name of :mod:`bondgraph.estimate.methods`. ``"both"``: a short swarm over all but the levels of noise, whose
        best distinct particles and the declared start begin gradient searches, of four or more one with much noise
        (:func:`bondgraph.estimate.noise_starts.noisiest_start`); where these do not meet at one optimum and
        evaluations are cheap, L-SHADE looks for a deeper one (:mod:`bondgraph.estimate.deepening`);
        ``"pso+gradient"``: the same without L-SHADE; ``"gradient"``: gradient searches from the declared start and from
        points spread over the bounds; ``"pso"``, ``"shade"``, ``"de"``, ``"cma"``: a swarm, L-SHADE, differential
        evolution or CMA-ES alone, over everything; with ``"+gradient"`` searches follow as after the swarm. Gradient
        searches of a stiff model begin along its linearised filter, at a seventh of the cost of a
        step by exact derivatives, which then find the optimum (:mod:`bondgraph.estimate.solvers.linearised`).
    seed
        The same seed gives the same estimate, on any number of threads.
    starts
        Gradient searches at once. One that comes to where a better one has been, or falls behind by more than it can
        make up, is ended (:mod:`bondgraph.estimate.solvers.race`).
    certify
        How the result is looked at again with finer integration steps, see :mod:`bondgraph.estimate.certify`; where it
        would move by more than a tenth of a standard deviation, a gradient search goes on with the finer steps.
    continuation
        ``"process-noise"``: gradient searches first go through filters with more process noise, for starts so far away
        that the likelihood is rugged there, see :mod:`bondgraph.estimate.continuation`.
    swarm, gradient
        Settings of swarm and gradient search. None: a swarm as large as the coordinates it searches need, which with
        ``"both"`` only has to find the right valleys (:mod:`bondgraph.estimate.handover`).
    search
        A search of one's own in place of the one that the method explores with.
    """

    method: str = "both"
    seed: int = 0
    starts: int = 4
    certify: Depth = "step"
    continuation: Continuation = "none"
    swarm: SwarmSettings | None = None
    gradient: GaussNewtonSettings = field(
        default_factory=lambda: GaussNewtonSettings(tolerance=1e-6, patience=4, least_gain=1e-4)
    )
    search: AbstractSearch[Any] | None = None

    def __post_init__(self) -> None:
        known = {"method": tuple(METHODS), "certify": get_args(Depth), "continuation": get_args(Continuation)}
        for name, choices in known.items():
            value = getattr(self, name)
            if value not in choices:
                raise OptionError(
                    f"estimate: {name} {value!r} is not known{suggest(value, choices)} - choose {', '.join(choices)}",
                    where=(name, value),
                )
        if self.continuation != "none" and not METHODS[self.method].refine:
            raise OptionError(
                f"estimate: continuation {self.continuation!r} leads gradient searches, {self.method} alone has none"
                " - choose the method both or gradient",
                where=("continuation", self.continuation),
            )
        if self.starts < 1:
            raise OptionError(f"estimate: starts = {self.starts} must be at least 1", where=("starts",))

    @property
    def refines(self) -> bool:
        """Whether gradient searches follow."""
        return METHODS[self.method].refine

    @property
    def deepens(self) -> bool:
        """True where a second exploration follows gradient searches that do not agree."""
        return METHODS[self.method].deepen and self.search is None and self.swarm is None

    def exploring(self, problem: Problem) -> tuple[Problem, AbstractSearch[Any]] | None:
        """What is explored and how, None where nothing is."""
        make = METHODS[self.method].explore
        if make is None:
            return None
        given = self.search or (None if self.swarm is None else ParticleSwarm(self.swarm, self.seed))
        return explored(problem, lambda part: given or make(part, self.seed), alone=not self.refines)
