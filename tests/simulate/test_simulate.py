"""Simulations against closed solutions, in every form: adaptive, fixed steps, batches, compiled and numpy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from bondgraph.errors import ModelError, OptionError
from bondgraph.simulate.batch import simulate_batch
from bondgraph.simulate.inputs import InputSignal
from bondgraph.simulate.integrators import RK4, Adaptive
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.simulation import simulate
from tests.simulate.samples import decay, sample

METHODS = ("adaptive", "Radau", "BDF", "RK45", "DOP853")


def step_response(t: np.ndarray, at: float) -> np.ndarray:
    """Current and voltage of the circuit after the source steps from 0 to 1 at ``at``."""
    theta = dict(zip(sample("rlc").names("parameter"), sample("rlc").theta(), strict=True))
    r, inductance, c = theta["R_wire"], theta["L_coil"], theta["C_store"]
    a = np.array([[-r / inductance, -1 / inductance], [1 / c, 0.0]])
    final = np.array([0.0, 1.0])
    return np.array([final - expm(a * (s - at)) @ final if s > at else np.zeros(2) for s in t]).T


def step_at(time: float) -> InputSignal:
    """A step of the source between samples."""
    return InputSignal(np.array([0.0, time, time]), np.array([[0.0, 0.0, 1.0]]), np.array([False]))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("compiled", [False, True])
def test_a_step_between_samples_is_met_exactly(method: str, compiled: bool) -> None:
    time = np.linspace(0.0, 2.0, 21)
    run = simulate(sample("rlc"), time, step_at(0.333), method=method, compiled=compiled).raise_if_failed()
    np.testing.assert_allclose(run.x, step_response(time, 0.333), atol=1e-6)
    np.testing.assert_allclose(run.output("voltage"), run.state("u_capacitor"), rtol=0)


@pytest.mark.parametrize("compiled", [False, True])
def test_fixed_steps_meet_the_step_too(compiled: bool) -> None:
    time = np.linspace(0.0, 2.0, 21)
    run = simulate(sample("rlc"), time, step_at(0.333), method="rk4", substeps=20, compiled=compiled)
    np.testing.assert_allclose(run.x, step_response(time, 0.333), atol=1e-6)


def test_a_short_pulse_is_not_stepped_over() -> None:
    time = np.array([0.0, 50.0, 100.0])
    pulse = InputSignal(
        np.array([0.0, 60.0, 60.0, 60.001, 60.001]),
        np.array([[0, 0, 1000.0, 1000.0, 0], [0] * 5]),
        np.array([False, True]),
    )
    run = simulate(decay(rate=0.01, initial=0.0), time, pulse)
    np.testing.assert_allclose(run.x[0], [0.0, 0.0, np.exp(-0.4)], rtol=1e-4)


def test_linear_and_held_inputs_between_samples() -> None:
    time = np.array([0.0, 1.0, 2.0])
    u = np.array([[0.0, 2.0, 2.0], [5.0, 0.0, 0.0]])
    for method in ("adaptive", "rk4"):
        run = simulate(decay(rate=0.0, initial=0.0), time, u, method=method)
        np.testing.assert_allclose(run.x[0], [0.0, 6.0, 8.0], rtol=1e-9)
        np.testing.assert_array_equal(run.u, u)


def test_inputs_may_be_given_by_name_and_letter() -> None:
    run = simulate(decay(rate=0.0, initial=0.0), [0.0, 1.0], {"held": "on"})
    np.testing.assert_allclose(run.x[0], [0.0, 1.0], rtol=1e-9)
    assert run.input("held").tolist() == [1.0, 1.0]


@pytest.mark.parametrize("name", ["driveline", "pendulum", "orifices", "rlc"])
def test_adaptive_and_fixed_steps_agree(name: str) -> None:
    time = np.linspace(0.0, 0.5, 6)
    inputs = {sample(name).inputs[0].name: np.linspace(0.0, 1.0, 6)}
    reference = simulate(sample(name), time, inputs).raise_if_failed()
    tight = simulate(sample(name), time, inputs, method=Adaptive("DOP853", rtol=1e-12, atol=1e-12))
    scale = np.max(np.abs(tight.x), axis=1, keepdims=True)
    assert np.max(np.abs(reference.x - tight.x) / scale) < 1e-6
    fixed = simulate(sample(name), time, inputs, method=RK4(400), compiled=True)
    assert np.max(np.abs(fixed.x - tight.x) / scale) < 1e-6


def test_states_of_very_different_size_are_all_resolved() -> None:
    model = sample("rlc")
    time = np.linspace(0.0, 1e-6, 11)
    tiny = simulate(model, time, {"u_source": 1e-9}, theta={"L_coil": 1e-9, "C_store": 1e-3, "R_wire": 1e-4})
    tight = simulate(
        model,
        time,
        {"u_source": 1e-9},
        {"L_coil": 1e-9, "C_store": 1e-3, "R_wire": 1e-4},
        method=Adaptive(rtol=1e-12, atol=1e-24),
    )
    scale = np.max(np.abs(tight.x), axis=1, keepdims=True)
    assert np.max(np.abs(tiny.x - tight.x) / scale) < 1e-6


@pytest.mark.parametrize("name", ["driveline", "pendulum", "orifices", "rlc"])
def test_batch_equals_singles_and_compiled_equals_numpy(name: str) -> None:
    model = sample(name)
    rng = np.random.default_rng(5)
    members = 4
    theta = model.theta()[:, None] * rng.uniform(0.8, 1.2, (len(model.parameters), members))
    x0 = model.x0()[:, None] + 0.1 * rng.normal(size=(len(model.states), members))
    time = np.linspace(0.0, 0.5, 26)
    u = model.u0()[:, None] + 0.1 * rng.normal(size=(len(model.inputs), time.size))
    compiled = simulate_batch(model, time, u, theta, x0, substeps=8)
    numpy = simulate_batch(model, time, u, theta, x0, substeps=8, compiled=False)
    np.testing.assert_allclose(compiled.x, numpy.x, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(compiled.y, numpy.y, rtol=1e-8, atol=1e-8)
    for m in range(members):
        one = simulate_batch(model, time, u, theta[:, m], x0[:, m], substeps=8)
        np.testing.assert_array_equal(one.x[..., 0], compiled.x[..., m])
        np.testing.assert_array_equal(one.y[..., 0], compiled.y[..., m])


@pytest.mark.parametrize("compiled", [False, True])
def test_a_member_that_diverges_does_not_disturb_the_others(compiled: bool) -> None:
    model = decay()
    time = np.linspace(0.0, 50.0, 51)
    rates = np.array([[1.0, 1e6, 0.5]])  # the second is far outside the stability of the step
    batch = simulate_batch(model, time, theta=rates, compiled=compiled, substeps=2)
    assert batch.outcomes == (Outcome.OK, Outcome.DIVERGED, Outcome.OK)
    np.testing.assert_allclose(batch.x[0, -1, [0, 2]], np.exp([-50.0, -25.0]), rtol=0.5, atol=1e-12)
    end = int(np.searchsorted(time, batch.ended_at[1]))
    assert np.isfinite(batch.x[0, : end + 1, 1]).all()
    assert np.isnan(batch.x[0, end + 1 :, 1]).all()
    assert np.isnan(batch.y[0, end + 1 :, 1]).all()


def test_a_failed_trajectory_tells_when_and_why() -> None:
    run = simulate(decay(rate=-1e3), np.linspace(0.0, 10.0, 11), method="rk4", substeps=50)
    assert run.outcome is Outcome.DIVERGED
    with pytest.raises(ModelError, match=r"decay: the state grew without bound or became non-finite, at t = \d"):
        run.raise_if_failed()


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"time": [0.0, 0.0]}, ModelError, "increasing"),
        ({"time": []}, ModelError, "increasing"),
        ({"theta": {"rat": 1.0}}, ModelError, "did you mean 'rate'"),
        ({"x0": [1.0, 2.0]}, ModelError, "1 rows are needed"),
        ({"x0": [[1.0, 2.0]]}, ModelError, "use simulate_batch"),
        ({"inputs": np.zeros((1, 2))}, ModelError, "do not fit 2 inputs at 2 times"),
        ({"inputs": step_at(0.5)}, ModelError, "1 inputs were given, the model has 2 (drive, held)"),
        ({"method": "rk5"}, OptionError, "integration method 'rk5' is not known"),
        ({"method": "rk4", "substeps": 0}, OptionError, "at least one step"),
    ],
)  # fmt: skip
def test_bad_arguments_are_told(arguments: dict[str, object], error: type[Exception], message: str) -> None:
    with pytest.raises(error) as caught:
        simulate(decay(), **{"time": [0.0, 1.0], **arguments})  # type: ignore[arg-type]
    assert message in str(caught.value)


def test_batches_of_different_width_are_refused() -> None:
    with pytest.raises(ModelError, match="ambiguous"):
        simulate_batch(decay(), [0.0, 1.0], theta=np.ones((1, 2)), x0=np.ones((1, 3)))
