"""The demonstration: drives of the bench driveline with one effect that its declaration lacks, written as logs.

The effect is picked by the seed. Whoever closes the loop sees the declared graph and the log files, nothing of this
module.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bondgraph import effects
from bondgraph.build import build
from bondgraph.data.log import Log, LogChannel
from bondgraph.data.write import write_log
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import Effect, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.errors import OptionError
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from vehicle_graphs.driveline import driveline

#: The declaration that the loop is closed on.
GRAPH = "vehicle_graphs.driveline:driveline"

FloatArray = npt.NDArray[np.float64]

#: Standard deviations of the sensors, in the order of the outputs.
SENSOR_NOISE = {"engine_speed": 0.5, "axle_speed": 0.05, "shaft_torque": 2.0, "speed": 0.02}
RATE = 20.0
#: How far the true parameters lie from the declared ones, as a share.
PARAMETER_SPREAD = 0.15


@dataclass(frozen=True)
class Missing:
    """One effect that the demonstration may leave undeclared: where it acts and how large it is."""

    function: Callable[[BondGraph, Place], Effect | None]
    junction: str
    coefficient: float


#: Sizes such that an engineer would miss them: a few per cent of the efforts at the place. A constant force on the body
#: is not among them: as long as the vehicle rolls forwards the free rolling resistance takes its place exactly. A
#: constant torque on the engine has the sign of a drive, which no friction can have.
MISSING = (
    Missing(effects.viscous_loss, "axle", 1.6),
    Missing(effects.coulomb_loss, "axle", 25.0),
    Missing(effects.quadratic_loss, "body", 0.5),
    Missing(effects.viscous_loss, "body", 12.0),
    Missing(effects.constant_effort, "primary", -3.0),
    Missing(effects.torque_proportional_loss, "axle", 0.08),
    Missing(effects.added_inertia, "body", 90.0),
    Missing(effects.coulomb_loss, "primary", 4.0),
)


@dataclass(frozen=True)
class Truth:
    """What the simulated machine has and the declared one lacks; None: nothing."""

    effect: str
    junction: str
    coefficients: dict[str, float]


def pick(seed: int) -> Missing:
    """The missing effect of a seed."""
    return MISSING[int(np.random.default_rng(seed).integers(len(MISSING)))]


def write_drives(seed: int, folder: Path, missing: Missing | None) -> tuple[list[Path], list[Path], Truth]:
    """Simulate training and held-out drives of the true machine and write them as logs.

    Returns
    -------
    tuple
        Paths of the training logs, paths of the held-out logs, and the truth.
    """
    rng = np.random.default_rng([seed, 1])
    graph, truth = _true_graph(rng, missing)
    model = build(graph).model
    train = [_write_drive(model, rng, folder / f"train_{i}.csv", 40.0) for i in (1, 2)]
    return train, [_write_drive(model, rng, folder / "holdout_1.csv", 40.0)], truth


def _true_graph(rng: np.random.Generator, missing: Missing | None) -> tuple[BondGraph, Truth]:
    graph = driveline()
    free = [parameter for parameter in graph.parameters if parameter.bounds is not None]
    values = {p.name: p.value * float(1.0 + PARAMETER_SPREAD * rng.uniform(-1.0, 1.0)) for p in free}
    graph = with_values(graph, values)
    if missing is None:
        return graph, Truth("none", "", {})
    junction = handle(graph, missing.junction)
    effect = missing.function(graph, Place(junction, Scale(400.0, 20.0)))
    if effect is None:
        raise OptionError(f"{missing.function.__name__} makes no sense at {missing.junction} - take another place")
    coefficients = {effect.coefficients[0]: missing.coefficient}
    return with_values(graph, coefficients), Truth(effect.name, missing.junction, coefficients)


def _write_drive(model: Model, rng: np.random.Generator, path: Path, duration: float) -> Path:
    time = np.arange(0.0, duration, 1.0 / RATE)
    torque, grade = _driver(time, rng), _road(time, rng)
    settle = np.linspace(-20.0, 0.0, 200)
    start = simulate(
        model, settle, np.array([np.full(200, torque[0]), np.full(200, grade[0])]), rtol=1e-8, compiled=True
    )
    run = simulate(
        model, time, np.array([torque, grade]), x0=start.raise_if_failed().x[:, -1], rtol=1e-8, compiled=True
    )
    channels = {
        "engine_torque": LogChannel("engine_torque", "N m", torque),
        "grade": LogChannel("grade", "1", grade),
    }
    for name, clean in zip(model.names("output"), run.raise_if_failed().y, strict=True):
        noisy = clean + SENSOR_NOISE[name] * rng.standard_normal(time.size)
        channels[name] = LogChannel(name, model.outputs[model.index("output", name)].unit, noisy)
    return write_log(path, Log(path.stem, time, channels))


def _driver(time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Pedal work: levels held for some seconds, ramps between, now and then overrun."""
    knots = np.arange(0.0, time[-1] + 6.0, 3.0)
    levels = rng.uniform(12.0, 55.0, knots.size)
    overrun = rng.uniform(size=knots.size) < 0.2
    overrun[0] = False  # drives begin settled at their first level
    levels[overrun] = -8.0
    corners = np.sort(np.concatenate([knots, knots[1:] - 0.8]))
    return np.interp(time, corners, np.repeat(levels, 2)[: corners.size])


def _road(time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A rolling road of known profile."""
    phases, periods = rng.uniform(0.0, 2.0 * np.pi, 3), np.array([37.0, 19.0, 11.0])
    waves = np.sin(2.0 * np.pi * time / periods[:, np.newaxis] + phases[:, np.newaxis])
    profile: FloatArray = np.array([0.02, 0.012, 0.006]) @ waves
    return profile
