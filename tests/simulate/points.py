"""Models and points for tests of programs: generated vehicles, samples, random graphs."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bondgraph.simulate.model import Model
from tests.simulate.samples import NAMES, random_point, sample

ROOT = Path(__file__).resolve().parents[2]
GENERATED = tuple(
    sorted(f"generated/{path.stem}" for path in (ROOT / "generated").glob("*.py") if path.stem != "__init__")
)
ALL = (*NAMES, *GENERATED)

#: Typical sizes of states of generated vehicles that start from rest.
SIZES = {
    "omega_engine": 200.0, "engine_speed": 250.0, "x_sheave": 0.008, "sheave_displacement": 0.01, "omega_wheel": 30.0,
    "rear_axle_speed": 25.0, "front_axle_speed": 25.0, "forward_velocity": 7.0, "omega_secondary": 200.0,
}  # fmt: skip

Array = npt.NDArray[np.float64]


@functools.cache
def model_of(name: str) -> Model:
    return sample(name) if name in NAMES else Model.from_file(ROOT / f"{name}.py")


#: Parameters that were declared after values were kept at these points: they stay as declared, the others as drawn.
LATER = ("radius_gain_f", "radius_gain_r")


def points_of(name: str, members: int, seed: int = 0) -> tuple[float, Array, Array, Array]:
    """Time, states, inputs and parameters of some members; near the declared ones for generated models."""
    model, rng = model_of(name), np.random.default_rng(seed)
    if name in NAMES:
        return (0.3, *random_point(model, rng, members))
    size = np.array([SIZES.get(info.name, max(abs(info.initial), 0.02)) for info in model.states])

    def near(values: Array, share: float) -> Array:
        return values[:, np.newaxis] * rng.uniform(1.0 - share, 1.0 + share, (values.size, members))

    x = size[:, np.newaxis] * rng.uniform(0.5, 1.0, (size.size, members))
    u = near(model.u0(), 0.3) if not any(info.letters for info in model.inputs) else near(model.u0(), 0.0)
    names, theta = model.names("parameter"), np.repeat(model.theta()[:, np.newaxis], members, axis=1)
    drawn = [k for k, one in enumerate(names) if one not in LATER]
    theta[drawn] = near(model.theta()[drawn], 0.03)
    return 0.3, x, u, theta
