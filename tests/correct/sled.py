"""A motor that pulls a sled: one state, linear but for what is missing; quick enough to close many loops."""

from __future__ import annotations

import functools

import numpy as np

from bondgraph import effects
from bondgraph.build import BuiltModel, build
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.simulate.simulation import simulate

NOISE = {"speed": 0.02, "force": 1.5}
#: Quick to try, and each of another shape.
FUNCTIONS: tuple[EffectFunction, ...] = (effects.constant_effort, effects.quadratic_loss, effects.added_inertia)


def sled(tolerance: float | None = None) -> BondGraph:
    """The declared sled: viscous friction of unknown size, no air drag, a mass known to a tolerance."""
    g = BondGraph("sled", doc="a motor pulls a sled over a drum")
    torque = g.input("torque", "N m", "torque of the motor")
    r_drum = g.parameter("r_drum", 0.3, "m", "radius of the drum")
    m_sled = g.parameter("m_sled", 40.0, "kg", "sled, weighed", tolerance=tolerance)
    c_guide = g.parameter("c_guide", 12.0, "N s/m", "friction of the guide", (2.0, 60.0))
    drum = g.one_junction("drum", ROTATION)
    runner = g.one_junction("runner", TRANSLATION)
    g.effort_source("motor", torque, at=drum)
    g.transformer("rope", r_drum, drum, runner)
    g.inertance("sled_mass", m_sled, at=runner, initial=1.0, state="v_sled")
    guide = g.resistance("guide", lambda v: c_guide * v, at=runner)
    g.measure_flow("speed", runner, "speed of the sled")
    g.measure_effort("force", guide, "load cell in the guide")
    return g


@functools.cache
def built() -> BuiltModel:
    return build(sled())


def added(function: EffectFunction, junction: str, value: float, graph: BondGraph | None = None) -> BondGraph:
    """The sled with one effect of a given size."""
    graph = graph or sled()
    effect = function(graph, Place(handle(graph, junction), Scale(150.0, 4.0)))
    assert isinstance(effect, Effect)
    return with_values(graph, {effect.coefficients[0]: value})


def pull(
    graph: BondGraph,
    seed: int,
    samples: int = 400,
    name: str = "run",
    colour: float = 0.0,
    driven: int | None = None,
    tails: float | None = None,
    **values: float,
) -> MatchedLog:
    """A log of a true sled with sensor noise.

    ``colour`` is the noise's correlation from sample to sample; ``driven`` a seed for the torque alone; ``tails`` the
    degrees of freedom of Student's distribution, of the same variance, instead of a Gaussian.
    """
    rng = np.random.default_rng([seed, 7])
    time = 0.1 * np.arange(samples)
    drive = rng if driven is None else np.random.default_rng([driven, 7])
    levels = np.repeat(drive.uniform(0.0, 45.0, samples // 25 + 1), 25)[:samples]
    model = build(with_values(graph, values)).model
    run = simulate(model, time, levels[np.newaxis], rtol=1e-8).raise_if_failed()
    noise = np.empty(run.y.shape)
    white = rng.standard_normal(run.y.shape)
    if tails is not None:
        white = rng.standard_t(tails, run.y.shape) * np.sqrt((tails - 2.0) / tails)
    noise[:, 0] = white[:, 0]
    for k in range(1, samples):
        noise[:, k] = colour * noise[:, k - 1] + np.sqrt(1.0 - colour**2) * white[:, k]
    std = np.array([NOISE[output] for output in model.names("output")])
    return MatchedLog(name, time, levels[np.newaxis], run.y + std[:, np.newaxis] * noise)


def fitted(logs: list[MatchedLog], graph: BondGraph | None = None) -> Fit:
    """The declared sled, fitted, or another one."""
    own = built() if graph is None else build(graph)
    setup = filter_setup(own.model, own.driven, logs)
    return fit(EstimationProblem(setup.filter_model, tuple(logs), (*free_parameters(setup, ()), *setup.noise)))
