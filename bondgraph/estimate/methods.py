"""Which searches an estimation takes under which name: one that explores, one that refines, or both.

Names are looked up here once; everything else goes by the searches themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from bondgraph.estimate.handover import exploring_swarm, swarm_settings
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.solvers.abstract import AbstractSearch
from bondgraph.estimate.solvers.covariance_adaptation import CovarianceAdaptation
from bondgraph.estimate.solvers.differential_evolution import Shade
from bondgraph.estimate.solvers.particle_swarm import ParticleSwarm
from bondgraph.estimate.solvers.scipy_evolution import ScipyEvolution

#: A search for a problem of some size, with a seed.
Make = Callable[[Problem, int], AbstractSearch[Any]]

#: Evaluations of a search that stands alone, for each coordinate: those over which it is compared with others
#: (``python -m tests.benchmarks --only optimisers``).
_PER_COORDINATE = 2000


@dataclass(frozen=True)
class Method:
    """What is searched how.

    Parameters
    ----------
    explore
        The search over the whole box; None: starts are spread over it instead.
    refine
        Gradient searches follow, from the best distinct points and the declared start.
    deepen
        Where these do not agree a second exploration follows, see :mod:`bondgraph.estimate.deepening`.
    """

    explore: Make | None
    refine: bool
    deepen: bool = False


def _swarm(problem: Problem, seed: int) -> ParticleSwarm:
    return ParticleSwarm(swarm_settings(problem, alone=True), seed)


def _shade(problem: Problem, seed: int) -> Shade:
    return Shade(evaluations=_PER_COORDINATE * len(problem.free), seed=seed)


def _evolution(problem: Problem, seed: int) -> ScipyEvolution:
    return ScipyEvolution(members=swarm_settings(problem, alone=True).members, seed=seed)


def _adaptation(problem: Problem, seed: int) -> CovarianceAdaptation:
    return CovarianceAdaptation(evaluations=_PER_COORDINATE * len(problem.free), seed=seed)


#: Methods by name. ``both`` is the default: a short swarm only has to find the right valleys.
METHODS: Mapping[str, Method] = {
    "both": Method(exploring_swarm, refine=True, deepen=True),
    "gradient": Method(None, refine=True),
    "pso": Method(_swarm, refine=False),
    "shade": Method(_shade, refine=False),
    "de": Method(_evolution, refine=False),
    "cma": Method(_adaptation, refine=False),
    "pso+gradient": Method(exploring_swarm, refine=True),
    "shade+gradient": Method(_shade, refine=True),
    "de+gradient": Method(_evolution, refine=True),
    "cma+gradient": Method(_adaptation, refine=True),
}
