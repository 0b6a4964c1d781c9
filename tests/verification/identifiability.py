"""Published truths about what a measurement can tell, and sensitivities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from bondgraph.build import build
from bondgraph.data.log import MatchedLog
from bondgraph.estimate.analysis.screening import global_sensitivity
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.problem import pose
from bondgraph.estimate.sensitivities import sensitivity
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from tests.verification.claims import Answer, Claim, Published, within
from tests.verification.machines import Rates, rates_graph

#: Share of its value by which a free quantity may move either way; a noise this far below what is measured.
_REACH, _NOISE = 0.5, 1e-6
#: Base samples at which the case states its tolerance.
_BASE_SAMPLES = 1024


@dataclass(frozen=True)
class Question:
    """A published model at numbers of no meaning, and the names by which the published ones are asked.

    Structural identifiability is that of almost all numbers. ``names`` maps a published name to a parameter, or to
    ``x0(state)`` for an initial state; the model may be written in combinations, so that these can be asked.
    """

    states: Mapping[str, float]
    parameters: Mapping[str, float]
    rates: Rates
    outputs: Rates
    names: Mapping[str, str]
    inputs: Sequence[str] = ()
    duration: float = 4.0

    def model(self) -> Model:
        return build(
            rates_graph("identifiable", self.states, self.parameters, self.rates, self.outputs, self.inputs)
        ).model

    def not_told(self) -> set[str]:
        """Names that a log without noise to speak of does not tell, by the toolkit's groups."""
        model = self.model()
        time = np.linspace(0.0, self.duration, 60)
        courses = {name: 1.0 + 0.5 * np.sin((2.0 + k) * time) for k, name in enumerate(self.inputs)}
        held = np.array(list(courses.values())).reshape(len(courses), time.size)
        seen = simulate(model, time, courses, method="rk4", substeps=20)
        log = MatchedLog("exact", time, held, seen.y)
        noise = {
            name: _NOISE * float(np.abs(row).max()) for name, row in zip(model.names("output"), seen.y, strict=True)
        }
        given = self.parameters | {f"x0({name})": value for name, value in self.states.items()}
        free = [
            FreeParameter(name, *sorted((value * (1 - _REACH), value * (1 + _REACH))), value)
            for name, value in given.items()
        ]
        exact = FilterModel(model, {}, noise, {}, substeps=20)
        known = sensitivity(pose(exact, log, free, initial="model"))
        return {name for group in known.not_identifiable for name in group}


def _compartments(p: Any, s: Any, a12: Any, x0: Any, x1: Any) -> tuple[Any, ...]:
    a01 = p / a12
    a21 = s - a01 - a12
    return a12 * x1 - (a01 + a21) * x0, a21 * x0 - a12 * x1


def _compartments_plain(a01: Any, a21: Any, a12: Any, x0: Any, x1: Any) -> tuple[Any, ...]:
    return a12 * x1 - (a01 + a21) * x0, a21 * x0 - a12 * x1


def _goodwin(b: Any, c: Any, alpha: Any, beta: Any, gama: Any, delta: Any, sigma: Any, **x: Any) -> tuple[Any, ...]:
    push = gama * x["x2"] - delta * x["x3"]
    return 1 / (c + x["x4"]) - b * x["x1"], alpha * x["x1"] - beta * x["x2"], push, sigma * x["x4"] * push / x["x3"]


def _siwr(S: Any, W: Any, R: Any, **q: Any) -> tuple[Any, ...]:
    ill = q["I"]
    caught = q["bi"] * S * ill + q["bw"] * S * W
    born, lost = q["mu"] - q["mu"] * S, q["a"] * R
    return (
        born - caught + lost,
        caught - (q["gam"] + q["mu"]) * ill,
        q["xi"] * (ill - W),
        q["gam"] * ill - q["mu"] * R - lost,
    )


def _tanks(
    h1: Any, h2: Any, h3: Any, h4: Any, u1: Any, u2: Any, gam: Any, k1: Any, k2: Any, **p: Any
) -> tuple[Any, ...]:
    return (
        (p["a3"] * h3 - p["a1"] * h1 + gam * k1 * u1) / p["A1"],
        (p["a4"] * h4 - p["a2"] * h2 + gam * k2 * u2) / p["A2"],
        ((1 - gam) * k2 * u2 - p["a3"] * h3) / p["A3"],
        ((1 - gam) * k1 * u1 - p["a4"] * h4) / p["A4"],
    )


QUESTIONS = {
    "2-compartment": Question(
        {"x0": 1.3, "x1": 0.7}, {"a01": 0.4, "a21": 0.9, "a12": 0.6},
        _compartments_plain, lambda x0, **_: (x0,),
        {"a01": "a01", "a21": "a21", "a12": "a12", "x0": "x0(x0)", "x1": "x0(x1)"},
    ),
    "2-compartment in combinations": Question(
        {"x0": 1.3, "x1": 0.7}, {"p": 0.24, "s": 1.9, "a12": 0.6},
        _compartments, lambda x0, **_: (x0,), {"a01*a12": "p", "a01+a12+a21": "s"},
    ),
    "lotka-volterra with input": Question(
        {"x0": 1.2, "x1": 0.8}, {"a": 0.7, "b": 0.9, "c": -0.5, "d": 0.6},
        lambda a, b, c, d, x0, x1, u: (a * x0 - b * x0 * x1 + u, c * x1 + d * x0 * x1), lambda x0, **_: (x0,),
        {"a": "a", "b": "b", "c": "c", "d": "d", "x0": "x0(x0)", "x1": "x0(x1)"}, ("u",),
    ),
    "lotka-volterra with input in combinations": Question(
        {"x0": 1.2, "z": 0.72}, {"a": 0.7, "c": -0.5, "d": 0.6},
        lambda a, c, d, x0, z, u: (a * x0 - x0 * z + u, c * z + d * x0 * z), lambda x0, **_: (x0,),
        {"b*x1": "x0(z)"}, ("u",),
    ),
    "goodwin": Question(
        {"x1": 1.1, "x2": 0.8, "x3": 1.4, "x4": 0.6},
        {"b": 0.7, "c": 0.9, "alpha": 1.1, "beta": 0.5, "gama": 0.8, "delta": 1.3, "sigma": 0.4},
        _goodwin, lambda x1, **_: (x1,),
        {name: name for name in ("b", "c", "alpha", "beta", "gama", "delta")}, duration=10.0,
    ),
    "SIWR": Question(
        {"S": 0.9, "I": 0.2, "W": 0.5, "R": 0.3},
        {"mu": 0.15, "bi": 0.8, "bw": 0.6, "a": 0.35, "gam": 0.5, "xi": 0.9, "k": 1.4},
        _siwr, lambda k, **q: (k * q["I"],),
        {name: name for name in ("mu", "bi", "bw", "a", "xi", "gam", "k")}, duration=20.0,
    ),
    "quadtank sqrt(h)->h": Question(
        {"h1": 1.2, "h2": 0.9, "h3": 0.7, "h4": 0.5},
        {
            "a1": 0.6, "a2": 0.8, "a3": 0.7, "a4": 0.5, "A1": 1.1, "A2": 0.9, "A3": 1.3, "A4": 0.8,
            "k1": 0.7, "k2": 0.9, "gam": 0.35,
        },
        _tanks, lambda h1, h2, **_: (h1, h2),
        {
            **{name: name for name in ("a1", "a2", "a3", "a4", "A1", "A2", "A3", "A4", "k1", "k2", "gam")},
            **{name: f"x0({name})" for name in ("h1", "h2", "h3", "h4")},
        },
        ("u1", "u2"), 8.0,
    ),
}  # fmt: skip


def told(name: str, case: Published) -> Answer:
    """Which quantities the data tell, 1 or 0."""
    question, truths = QUESTIONS[name], case["expected"][published_name(name)]
    missing = question.not_told()
    expected = [truths[asked] != "no" for asked in question.names]
    return Answer(expected, [own not in missing for own in question.names.values()])


def published_name(name: str) -> str:
    return name.removesuffix(" in combinations")


def ishigami(x: np.ndarray) -> np.ndarray:
    """The function of the case, of points (3, members)."""
    return np.sin(x[0]) + 7.0 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])


def _shares(column: str) -> np.ndarray:
    bounds = dict.fromkeys(("x1", "x2", "x3"), (-np.pi, np.pi))
    return global_sensitivity(ishigami, bounds, "sobol", samples=_BASE_SAMPLES).indices[column]


def first_order(case: Published) -> Answer:
    return Answer(case["expected"]["S1"], _shares("first"))


def total_order(case: Published) -> Answer:
    return Answer(case["expected"]["ST"], _shares("total"))


_IDENTIFIABILITY = "structural_identifiability_truths"

CLAIMS = (
    *(
        Claim(
            _IDENTIFIABILITY, f"{name}, told or not", (sensitivity,), partial(told, name),
            covers=(published_name(name),),
        )
        for name in QUESTIONS
    ),
    Claim(
        _IDENTIFIABILITY, "global or local",
        reason="the toolkit asks the information at a point, which does not tell one solution from several",
    ),
    Claim(
        _IDENTIFIABILITY, "beta+delta and beta*delta of goodwin",
        reason="the toolkit names parameters, not functions of them; both are told, and so is every function of them",
    ),
    Claim("ishigami_sobol", "first order", (global_sensitivity,), first_order, within("abs"), ("S1",)),
    Claim("ishigami_sobol", "total", (global_sensitivity,), total_order, within("abs"), ("ST",)),
    Claim(
        "ishigami_sobol", "pairs and variance", covers=("S2", "variance"),
        reason="the toolkit gives shares of single parameters, alone and with all others; no variance, and no pairs",
    ),
)  # fmt: skip
