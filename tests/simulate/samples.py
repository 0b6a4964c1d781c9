"""Models in the form of generated modules: a linear circuit, a driveline with a table, a vessel with solved loops."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bondgraph.simulate.example import pendulum
from bondgraph.simulate.model import Model
from tests.module_text import STACK

NAMES = ("driveline", "orifices", "pendulum", "rlc", "vocabulary")

_FOLDER = Path(__file__).parent / "modules"


def text_of(name: str) -> str:
    return (_FOLDER / f"{name}.txt").read_text(encoding="utf-8")


@functools.cache
def sample(name: str) -> Model:
    return pendulum() if name == "pendulum" else Model.from_text(text_of(name), source=name)


def decay(rate: float = 1.0, initial: float = 1.0) -> Model:
    """dx/dt = -rate x + drive, y = x."""
    return Model.from_text(
        f"""
import numpy as np
NAME = "decay"
FORMAT = "bondgraph-module/1"
STATES = (("level", "1", {initial!r}, ""),)
INPUTS = (("drive", "1/s", 0.0, "linear", None, ""), ("held", "1/s", 0.0, "hold", {{"on": 1.0, "off": 0.0}}, ""))
PARAMETERS = (("rate", "1/s", {rate!r}, 0.0, 1e6, ""),)
OUTPUTS = (("reading", "1", ""),)
def rhs(t, x, u, theta):
    return _stack(x, (u[0] + u[1] - theta[0]*x[0],))
def output(t, x, u, theta):
    return _stack(x, (x[0],))
"""
        + STACK
    )


def random_point(model: Model, rng: np.random.Generator, *batch: int) -> tuple[npt.NDArray[np.float64], ...]:
    """States, inputs and parameters scattered around the declared values, each with the batch shape."""

    def scattered(values: npt.NDArray[np.float64], positive: bool) -> npt.NDArray[np.float64]:
        shape = (values.size, *batch)
        centre = values.reshape(-1, *(1,) * len(batch))
        if positive:
            return centre * rng.uniform(0.5, 1.5, shape)
        return centre + (np.abs(centre) + 1.0) * rng.normal(0.0, 1.0, shape)

    return scattered(model.x0(), False), scattered(model.u0(), False), scattered(model.theta(), True)
