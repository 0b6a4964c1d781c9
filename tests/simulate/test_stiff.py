"""Rosenbrock methods reach their order, stay bounded far beyond explicit steps, and are the same in lanes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bondgraph.compile.ir.evaluate import evaluate
from bondgraph.compile.ir.tape import Tape
from bondgraph.compile.lanes import math as lane_math
from bondgraph.compile.lanes.load import LaneModel, load_lanes
from bondgraph.compile.lanes.text import LANES
from bondgraph.compile.machine_code import load_compiled
from bondgraph.compile.passes.sparse_lu import elimination_order, factorise, substitute
from bondgraph.compile.rosenbrock import TABLEAUS
from bondgraph.errors import OptionError
from bondgraph.simulate.batch import simulate_batch
from bondgraph.simulate.inputs import InputSegment
from bondgraph.simulate.integrators import RK4, AbstractIntegrator, IntegratorState
from bondgraph.simulate.model import Model
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.simulation import simulate
from bondgraph.simulate.stiff import ModelEquations, Rosenbrock, step_lengths
from tests.simulate.points import model_of, points_of
from tests.simulate.samples import decay

ORDERS = {"ros2": 2, "ros3p": 3, "rodas4": 4}
LANE_MODELS = ("driveline", "orifices", "pendulum", "generated/driveline", "generated/baja_launch")
METHODS = pytest.mark.parametrize("method", sorted(TABLEAUS))

_CALLS = """
from numba import njit

@njit
def call_prepare(f, w, n):
    f(w, n)

@njit
def call_measure(f, clock, inputs, w, n):
    f(clock, inputs, w, n)

@njit
def call_advance(f, start, length, substeps, grading, tableau, u_left, u_right, clock, inputs, w, n):
    f(start, length, substeps, grading, tableau, u_left, u_right, clock, inputs, w, n)
"""


def at_end(method: AbstractIntegrator, rhs, x0: np.ndarray, segment: InputSegment) -> np.ndarray:
    x, state = method.step(rhs, segment, np.array([segment.end]), IntegratorState(segment.start, x0))
    assert state.outcome is Outcome.OK
    return x[:, 0]


def advanced(
    lanes: LaneModel, model: Model, method: str, substeps: int, grading: float, segment: InputSegment, x, theta
) -> tuple[np.ndarray, np.ndarray]:
    """States at the end of a segment and outputs there, (n, members), by the compiled functions."""
    calls = load_compiled(_CALLS)
    members = x.shape[1]
    w = lanes.buffer()
    rows = w.reshape(-1, LANES)
    segment = InputSegment(segment.start, segment.end, *map(np.ascontiguousarray, (segment.left, segment.right)))
    lane = np.arange(LANES) % members
    rows[lanes.theta : lanes.theta + theta.shape[0]] = theta[:, lane]
    rows[lanes.x : lanes.x + x.shape[0]] = x[:, lane]
    clock, inputs = np.array([segment.end, 0.0]), np.zeros(2 * segment.left.size)
    tableau = TABLEAUS[method].numbers if method in TABLEAUS else np.empty(0)
    calls.call_prepare(lanes.prepare, w, LANES)
    calls.call_advance(
        lanes.advance, segment.start, segment.end - segment.start, substeps, grading, tableau,
        segment.left, segment.right, clock, inputs, w, LANES,
    )  # fmt: skip
    inputs[: segment.left.size] = segment.right
    clock[0] = segment.end
    calls.call_measure(lanes.measure, clock, inputs, w, LANES)
    n_y = len(model.outputs)
    return rows[lanes.x : lanes.x + x.shape[0], :members].copy(), rows[lanes.y : lanes.y + n_y, :members].copy()


@METHODS
def test_the_order_is_reached_on_a_nonlinear_equation_with_time_and_ramping_input(method: str) -> None:
    def rhs(t: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.array([-x[0] * x[1] + u[0] + np.sin(3.0 * t), x[0] - 2.0 * x[1] ** 2 + u[0] * x[0]])

    segment = InputSegment(0.0, 1.0, np.array([0.5]), np.array([2.0]))
    x0 = np.array([1.0, 0.5])
    exact = solve_ivp(lambda t, x: rhs(t, x, segment.at(t)), (0, 1), x0, rtol=1e-12, atol=1e-13, method="DOP853")
    errors = [np.abs(at_end(Rosenbrock(method, n), rhs, x0, segment) - exact.y[:, -1]).max() for n in (16, 32, 64)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(np.abs(orders - ORDERS[method]) < 0.3), orders


@METHODS
def test_a_step_of_ten_thousand_time_constants_stays_bounded(method: str) -> None:
    """Prothero and Robinson's equation: the solution follows the input, whatever the rate."""
    model = decay(rate=1e4)
    equations = ModelEquations(model, model.theta())
    segment = InputSegment(0.0, 1.0, np.array([1e4, 0.0]), np.array([2e4, 0.0]))
    x = at_end(Rosenbrock(method, 1), equations, np.array([1.0]), segment)
    assert abs(x[0] - 2.0) < 1.5
    steps = at_end(Rosenbrock(method, 8, 1.5), equations, np.array([1.0]), segment)
    assert abs(steps[0] - 2.0) < 1e-2
    unstable, state = RK4(8).step(equations, segment, np.array([1.0]), IntegratorState(0.0, np.array([1.0])))
    assert not abs(unstable[0, 0]) < 1e10
    assert state.x.shape == (1,)


@METHODS
def test_differences_serve_where_derivatives_are_not_given(method: str) -> None:
    model = model_of("driveline")
    equations = ModelEquations(model, model.theta())
    segment = InputSegment(0.0, 0.02, model.u0(), model.u0() * 1.01)
    exact = at_end(Rosenbrock(method, 3, 1.5), equations, model.x0(), segment)
    plain = at_end(Rosenbrock(method, 3, 1.5), lambda t, x, u: model.rhs(t, x, u, model.theta()), model.x0(), segment)
    np.testing.assert_allclose(plain, exact, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("method", ["rk4", *sorted(TABLEAUS)])
@pytest.mark.parametrize("name", LANE_MODELS)
def test_lanes_advance_and_measure_as_numpy_does(name: str, method: str) -> None:
    model, (_, x, u, theta) = model_of(name), points_of(name, 5, seed=8)
    grading = 1.0 if method == "rk4" else 1.5
    segment = InputSegment(0.1, 0.1 + 1e-4, u[:, 0], u[:, 0] + 1e-3 * np.abs(u[:, 0]))
    integrator = RK4(3) if method == "rk4" else Rosenbrock(method, 3, grading)
    expected, _ = integrator.step(
        ModelEquations(model, theta), segment, np.array([segment.end]), IntegratorState(segment.start, x)
    )
    found, y = advanced(load_lanes(model, method != "rk4"), model, method, 3, grading, segment, x, theta)
    size = np.abs(expected[:, 0]).max(axis=1, keepdims=True)
    moved = np.abs(expected[:, 0] - x).max(axis=1, keepdims=True)
    assert np.all(np.abs(found - expected[:, 0]) <= 1e-9 * moved + 1e-12 * size + 1e-300)
    np.testing.assert_allclose(y, model.output(segment.end, found, segment.right, theta), rtol=1e-11, atol=1e-12)


def test_a_pivot_that_loses_its_digits_is_not_finite() -> None:
    """The matrix ((1, 1), (1, 1)): after the first step nothing is left of the second pivot."""
    tape = Tape()
    entries = {(k // 2, k % 2): tape.leaf("j", k) for k in range(4)}
    factors = factorise(tape, 2, entries, tape.leaf("g", 0))
    program = tape.program(substitute(tape, factors, [tape.leaf("b", 0), tape.leaf("b", 1)]))
    solved = evaluate(program, {"j": np.array([0.0, -1.0, -2.0, 0.0]), "g": [3.0], "b": np.array([5.0, 4.0])}, {})
    np.testing.assert_allclose(np.linalg.solve([[3.0, 1.0], [2.0, 3.0]], [5.0, 4.0]), solved)
    assert np.isnan(evaluate(program, {"j": np.array([0.0, -1.0, -1.0, 0.0]), "g": [1.0], "b": [1.0, 2.0]}, {})).all()


def test_elimination_fills_in_little() -> None:
    """An arrow matrix: its head last, so that nothing fills in."""
    places = [(0, k) for k in range(1, 6)] + [(k, 0) for k in range(1, 6)]
    order = elimination_order(6, places)
    assert order.index(0) >= 4


@pytest.mark.parametrize(
    ("name", "low", "high", "ulps"),
    [("tanh", -22.0, 22.0, 8), ("tanh", -1e-3, 1e-3, 8), ("exp", -700.0, 700.0, 2), ("exp", -2.0, 2.0, 2),
     ("log", 1e-300, 1e-290, 2), ("log", 0.0, 3.0, 2), ("log", 0.999, 1.001, 2), ("log", 1e-310, 1e-309, 2),
     ("arcsin", -1.0, 1.0, 3), ("arcsin", -1e-2, 1e-2, 3), ("arctan", -1e3, 1e3, 3), ("arctan", -3.0, 3.0, 3)],
)  # fmt: skip
def test_functions_of_lanes_have_the_stated_error(name: str, low: float, high: float, ulps: int) -> None:
    function = getattr(lane_math, f"_lane_{name}")
    for x in np.random.default_rng(1).uniform(low, high, 20_000):
        with np.errstate(all="ignore"):
            value, exact = float(function(float(x))), float(getattr(np, name)(x))
        assert abs(value - exact) <= ulps * np.spacing(abs(exact)), x


@pytest.mark.parametrize("name", ["sin", "cos"])
@pytest.mark.parametrize("high", [1e-3, 10.0, 1e5])
def test_sines_of_lanes_have_the_stated_error(name: str, high: float) -> None:
    function = getattr(lane_math, f"_lane_{name}")
    for x in np.random.default_rng(2).uniform(-high, high, 20_000):
        assert abs(float(function(float(x))) - getattr(math, name)(x)) <= 3e-16, x


def test_powers_of_lanes_have_the_stated_error() -> None:
    rng = np.random.default_rng(3)
    bases, exponents = np.exp(rng.uniform(-50.0, 50.0, 20_000)), rng.uniform(-9.0, 9.0, 20_000)
    for x, y in zip(bases.tolist(), exponents.tolist(), strict=True):
        exact = math.pow(x, y)
        assert abs(float(lane_math._lane_pow(x, y)) - exact) <= (3 + abs(y * math.log2(x))) * np.spacing(exact), (x, y)


@pytest.mark.parametrize(
    ("x", "y"),
    [(0.0, 2.0), (0.0, 0.0), (0.0, 0.3), (-2.0, 3.0), (-2.0, 2.0), (-2.0, -1.0), (math.inf, 2.0), (math.inf, -2.0),
     (1.0, math.nan), (math.nan, 0.0), (2.0, -1022.0), (2.0, 1023.0), (0.5, 1e6), (1.0, 1e300), (1e-300, -1.0)],
)  # fmt: skip
def test_powers_of_lanes_at_their_ends_are_those_of_c(x: float, y: float) -> None:
    with np.errstate(all="ignore"):
        assert float(lane_math._lane_pow(x, y)) == pytest.approx(math.pow(x, y), rel=1e-13, abs=0.0)


def test_functions_of_lanes_keep_what_is_not_finite() -> None:
    with np.errstate(all="ignore"):
        assert lane_math._lane_pow(0.0, -1.0) == lane_math._lane_pow(1.5, 1e9) == math.inf
        for x, y in ((-2.0, 0.5), (math.nan, 1.0), (2.0, math.nan)):
            assert math.isnan(lane_math._lane_pow(x, y))
        assert lane_math._lane_log(0.0) == -math.inf
        assert lane_math._lane_log(math.inf) == math.inf
        for x in (-1.0, math.nan):
            assert math.isnan(lane_math._lane_log(x))
        for name in ("tanh", "exp", "sin", "cos", "arctan"):
            assert math.isnan(getattr(lane_math, f"_lane_{name}")(math.nan))
        assert lane_math._lane_exp(1e4) == math.inf
        assert lane_math._lane_exp(-1e4) == 0.0
        assert lane_math._lane_tanh(math.inf) == 1.0


@METHODS
def test_a_stiff_method_is_chosen_by_its_name(method: str) -> None:
    model, time = model_of("driveline"), np.linspace(0.0, 0.4, 21)
    reference = simulate(model, time)
    for compiled in (False, True):
        found = simulate(model, time, method=method, substeps=24, compiled=compiled)
        assert found.outcome is Outcome.OK
        np.testing.assert_allclose(found.x, reference.x, rtol=2e-4, atol=2e-4)


def test_graded_steps_add_up() -> None:
    lengths = step_lengths(2.0, 5, 1.5)
    assert lengths.sum() == pytest.approx(2.0)
    np.testing.assert_allclose(lengths[1:] / lengths[:-1], 1.5)


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"method": "rodas"}, "stiff method 'rodas' is not known; did you mean 'rodas4'"), ({"substeps": 0}, "substeps=0"),
     ({"grading": 0.0}, "grading=0.0")],
)  # fmt: skip
def test_settings_out_of_range_are_told(settings: dict, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Rosenbrock(**settings)


@METHODS
def test_members_side_by_side_are_the_same_as_in_numpy_and_alone(method: str) -> None:
    model, time = model_of("driveline"), np.linspace(0.0, 0.2, 11)
    theta = model.theta()[:, None] * np.random.default_rng(3).uniform(0.9, 1.1, (len(model.parameters), 19))
    theta[:, 4] = np.nan
    integrator = Rosenbrock(method, 5, 1.4)
    compiled, plain = (simulate_batch(model, time, theta=theta, method=integrator, compiled=c) for c in (True, False))
    assert compiled.outcomes == plain.outcomes
    assert [m for m in range(19) if compiled.outcomes[m] is not Outcome.OK] == [4]
    np.testing.assert_allclose(compiled.x, plain.x, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(compiled.y, plain.y, rtol=1e-8, atol=1e-10)
    alone = simulate_batch(model, time, theta=theta[:, 17], method=integrator)
    np.testing.assert_array_equal(alone.x[..., 0], compiled.x[..., 17])
