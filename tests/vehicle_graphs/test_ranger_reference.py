"""The Ranger against values of an independent program: derivatives and efforts at 300 points, six trajectories."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from bondgraph.data.log import Log
from bondgraph.data.matching import match_inputs
from bondgraph.data.read import read_log
from bondgraph.report.evaluate import evaluate
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from vehicle_graphs.ranger import SCENARIOS, full

FloatArray = npt.NDArray[np.float64]

#: Stated with the reference: relative to value and scale; of efforts relative.
TOLERANCE = 1e-9
STATE_SCALES = np.array([100, 0.01, 10, 10, 5, 0.01, 0.1, 0.02, 0.1, 1, 0.1])
MANOEUVRES = ("full_throttle_launch", "part_throttle_steps", "neutral_coast_down", "brake", "hill", "lift_off")


@pytest.fixture(scope="module")
def reference(shared_data: Path) -> dict[str, Any]:
    values: dict[str, Any] = json.loads((shared_data / "reference" / "derivatives.json").read_text())
    return values


@pytest.fixture(scope="module")
def derived(reference: dict[str, Any]) -> list[dict[str, Any]]:
    states = reference["states"]
    points = [{"states": dict(zip(states, p["x"], strict=True)), "inputs": p["u"]} for p in reference["points"]]
    return evaluate(full(), points)


def errors(reference: dict[str, Any], rates: list[FloatArray]) -> FloatArray:
    """In the measure of the reference, shape (points, states)."""
    wanted = np.array([point["dx"] for point in reference["points"]])
    return np.abs(np.array(rates) - wanted) / (np.abs(wanted) + np.array(reference["rate_scale"]))


def worst(found: FloatArray, reference: dict[str, Any]) -> str:
    point, column = np.unravel_index(np.argmax(np.where(np.isnan(found), np.inf, found)), found.shape)
    regime = reference["points"][int(point)]["regime"]
    return f"{regime}: {reference['states'][int(column)]} is off by {found[point, column]:.3g}"


def test_parameters_are_those_of_the_reference(reference: dict[str, Any]) -> None:
    declared = {parameter.name: parameter.value for parameter in full().flatten().parameters}
    assert {name: declared[name] for name in reference["parameters"]} == reference["parameters"]


def test_derived_model_gives_the_derivatives(reference: dict[str, Any], derived: list[dict[str, Any]]) -> None:
    rates = [np.array([answer["derivatives"][name] for name in reference["states"]]) for answer in derived]
    found = errors(reference, rates)
    assert found.shape == (300, 11) and np.all(found <= TOLERANCE), worst(found, reference)


def test_derived_model_gives_efforts_and_radii(reference: dict[str, Any], derived: list[dict[str, Any]]) -> None:
    for point, answer in zip(reference["points"], derived, strict=True):
        wanted = {**point["efforts"], "r_p": point["r_p"], "r_s": point["r_s"]}
        for name, value in wanted.items():
            difference = abs(answer["signals"][name] - value)
            assert difference <= TOLERANCE * abs(value), f"{point['regime']}: {name} {answer['signals'][name]} {value}"


def numpy_rates(model: Model) -> Callable[[FloatArray, FloatArray], FloatArray]:
    return lambda x, u: model.rhs(0.0, x, u, model.theta())


def compiled_rates(model: Model) -> Callable[[FloatArray, FloatArray], FloatArray]:
    rhs_into, theta = model.compiled.rhs_into, model.theta()

    def rates(x: FloatArray, u: FloatArray) -> FloatArray:
        dx = np.empty_like(x)
        rhs_into(0.0, x, u, theta, dx)
        return dx

    return rates


@pytest.mark.parametrize("made", [numpy_rates, compiled_rates])
def test_generated_model_gives_the_derivatives(
    ranger: Model, reference: dict[str, Any], made: Callable[[Model], Callable[[FloatArray, FloatArray], FloatArray]]
) -> None:
    rates, index = made(ranger), [ranger.index("state", name) for name in reference["states"]]
    given = []
    for point in reference["points"]:
        x = np.zeros(len(index))
        x[index] = point["x"]
        u = {name: ranger.input_value(name, v) if isinstance(v, str) else v for name, v in point["u"].items()}
        given.append(rates(x, ranger.u0(**u))[index])
    found = errors(reference, given)
    assert np.all(found <= TOLERANCE), worst(found, reference)


def test_a_batch_gives_what_single_points_give(ranger: Model, reference: dict[str, Any]) -> None:
    x = np.array([point["x"] for point in reference["points"]]).T
    order = [reference["states"].index(name) for name in ranger.names("state")]
    codes = [ranger.input_value("gear", point["u"]["gear"]) for point in reference["points"]]
    u = np.repeat(ranger.u0()[:, np.newaxis], x.shape[1], axis=1)
    u[ranger.index("input", "gear")] = codes
    batch = ranger.rhs(0.0, x[order], u, ranger.theta())
    single = [ranger.rhs(0.0, x[order, k], u[:, k], ranger.theta()) for k in range(0, 300, 15)]
    np.testing.assert_allclose(batch[:, ::15].T, single, rtol=1e-12, atol=1e-12)


def trajectory(shared_data: Path, name: str, model: Model, states: list[str]) -> tuple[Log, FloatArray]:
    log = read_log(shared_data / "reference" / "trajectories" / f"{name}.csv")
    inputs = Log(log.name, log.time, {key: c for key, c in log.channels.items() if key in model.names("input")})
    return inputs, np.array([log.channels[state].values for state in states])


@pytest.mark.parametrize("name", MANOEUVRES)
def test_trajectory(shared_data: Path, ranger: Model, reference: dict[str, Any], name: str) -> None:
    states = reference["states"]
    inputs, wanted = trajectory(shared_data, name, ranger, states)
    start = dict(zip(states, wanted[:, 0], strict=True))
    run = simulate(ranger, inputs.time, match_inputs(inputs, ranger), x0=start, rtol=1e-9, compiled=True)
    found = np.array([run.raise_if_failed().state(state) for state in states])
    error = np.max(np.abs(found - wanted) / STATE_SCALES[:, np.newaxis], axis=1)
    assert np.all(error <= 2e-6), dict(zip(states, error, strict=True))


@pytest.mark.parametrize("name", MANOEUVRES)
def test_declared_scenario_is_that_of_the_trajectory(shared_data: Path, ranger: Model, name: str) -> None:
    inputs, _ = trajectory(shared_data, name, ranger, [])
    scenario = SCENARIOS[name]
    np.testing.assert_allclose(scenario.times(), inputs.time, atol=1e-9)
    np.testing.assert_allclose(scenario.signal(ranger).at(inputs.time), match_inputs(inputs, ranger), atol=1e-9)
