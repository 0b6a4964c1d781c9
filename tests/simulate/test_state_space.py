"""State equations without a graph: against scipy, filterpy and closed forms, and what of a function is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.cli import main
from bondgraph.errors import BondGraphError, ModelError
from bondgraph.simulate.model import Model

GROWTH = {"growth": (1.0, 0.1, 3.0), "hunger": (0.1, 0.01, 1.0), "loss": (0.8, 0.1, 3.0), "share": 0.5}


def lotka_volterra(t: Any, x: Any, u: Any, theta: Any) -> Any:
    """Written for numbers and arrays, so that scipy integrates the same function."""
    prey, predator = x
    growth, hunger, loss, share = theta
    eaten = hunger * prey * predator
    return growth * prey - eaten + u[0], share * eaten - loss * predator


def preys(**changes: Any) -> Model:
    return bg.state_space(
        "lotka_volterra",
        **{
            "states": {"prey": 10.0, "predator": 5.0},
            "inputs": {"released": 0.0},
            "parameters": GROWTH,
            "rates": lotka_volterra,
            "outputs": {"seen": "prey", "both": "prey + predator"},
            **changes,
        },
    )


def measured(model: Model, noise: float, seed: int = 0) -> bg.MatchedLog:
    """Prey, counted with noise, from scipy's solution."""
    time = np.arange(150) * 0.1
    theta = model.theta()
    true = solve_ivp(
        lambda t, x: lotka_volterra(t, x, [0.0], theta), (0.0, 15.0), model.x0(), t_eval=time, rtol=1e-10, atol=1e-10
    ).y
    y = np.vstack(
        [true[0] + noise * np.random.default_rng(seed).standard_normal(time.size), np.full(time.size, np.nan)]
    )
    return bg.MatchedLog("count", time, np.zeros((1, time.size)), y)


def test_a_simulation_is_that_of_scipy() -> None:
    model = preys()
    time = np.linspace(0.0, 15.0, 60)
    run = bg.simulate(model, time, {"released": 0.3})
    found = solve_ivp(
        lambda t, x: lotka_volterra(t, x, [0.3], model.theta()), (0.0, 15.0), model.x0(), t_eval=time, rtol=1e-11,
        atol=1e-11,
    )  # fmt: skip
    np.testing.assert_allclose(run.x, found.y, rtol=1e-6)
    np.testing.assert_allclose(run.y, [found.y[0], found.y.sum(axis=0)], rtol=1e-6)


def test_van_der_pol_by_expressions_has_the_derivatives_of_the_textbook() -> None:
    model = bg.state_space(
        "van_der_pol", states={"x": 2.0, "v": 0.0}, parameters={"mu": 1.5},
        rates={"x": "v", "v": "mu*(1 - x**2)*v - x"}, outputs={"position": "x"},
    )  # fmt: skip
    x, v, mu = 0.7, -1.1, 2.5
    point = (0.0, np.array([x, v]), np.zeros(0), np.array([mu]))
    np.testing.assert_allclose(model.rhs(*point), [v, mu * (1 - x**2) * v - x], rtol=1e-15)
    np.testing.assert_allclose(model.jacobian_x(*point), [[0.0, 1.0], [-2 * mu * x * v - 1, mu * (1 - x**2)]])
    np.testing.assert_allclose(model.jacobian_theta(*point), [[0.0], [(1 - x**2) * v]])


def test_the_likelihood_is_that_of_filterpy_with_a_transition_of_its_own() -> None:
    model = preys()
    log = measured(model, 0.3)
    own = bg.FilterModel(
        model, {"prey": 0.2, "predator": 0.1}, {"seen": 0.3}, {"prey": 0.5, "predator": 0.5}, substeps=4,
        noise_scheme="sampled", alpha=0.5,
    )  # fmt: skip
    theta = model.theta()

    def move(x: np.ndarray, dt: float) -> np.ndarray:
        end: np.ndarray = solve_ivp(
            lambda t, x: lotka_volterra(t, x, [0.0], theta), (0.0, dt), x, rtol=1e-10, atol=1e-10
        ).y[:, -1]
        return end

    points = MerweScaledSigmaPoints(2, 0.5, 2.0, 0.0)
    ukf = UnscentedKalmanFilter(2, 1, 0.1, hx=lambda x: x[:1], fx=move, points=points)
    ukf.x, ukf.P, ukf.R = model.x0(), 0.25 * np.eye(2), np.array([[0.09]])
    ukf.Q = 0.1 * np.diag([0.04, 0.01])
    ukf.sigmas_f = points.sigma_points(ukf.x, ukf.P)
    nll = 0.0
    for k in range(40):
        if k > 0:
            ukf.predict()
        ukf.update(log.y[:1, k])
        nll -= ukf.log_likelihood
    found = bg.filter_log(own, log.rows(np.arange(150) < 40), x0={})
    np.testing.assert_allclose(found.filtered_mean[:, -1], ukf.x, rtol=1e-6)
    assert found.nll == pytest.approx(nll, rel=1e-7)


def test_an_estimate_finds_what_made_the_log() -> None:
    model = preys()
    fit = bg.estimate(
        bg.FilterModel(model, {}, {"seen": 0.3}, {}, substeps=4),
        measured(model, 0.3),
        ["growth", "loss", "std(seen)"],
        bg.Settings(method="gradient", starts=1),
    )
    assert fit.outcome.succeeded
    for name, value in (("growth", 1.0), ("loss", 0.8), ("std(seen)", 0.3)):
        assert abs(fit.values[name] - value) < 3.5 * fit.std[name]
        assert fit.std[name] < 0.1 * value


def test_its_text_is_a_module_that_commands_take(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = preys(units={"growth": "1/s", "loss": "1/s"})
    path = tmp_path / "preys.py"
    path.write_text(model.text, encoding="utf-8")
    assert bg.load(path) == model
    assert model.parameters[0].unit == "1/s" and model.parameters[3].lower is None
    log = bg.Log.from_dataframe(bg.simulate(model, np.arange(40) * 0.1).to_dataframe()[["seen [1]"]])
    bg.write_log(tmp_path / "run.csv", log)
    command = [
        "filter",
        str(path),
        "--data",
        str(tmp_path / "run.csv"),
        "--out",
        str(tmp_path / "out"),
        "--start",
        "model",
    ]
    assert main(command) == 0, capsys.readouterr().err


def _gains(t: Any, x: Any, u: Any, theta: Any) -> Any:
    matrix = np.array([[0.0, 1.0], [-theta.stiffness, -theta.damping]], dtype=object)
    rates = matrix @ np.array(x, dtype=object)
    for k in range(3):  # a loop that is the same in every simulation
        rates = rates + np.array([0.0, 0.1**k * np.cos(k * t) * u["force"]], dtype=object)
    smooth = np.tanh(x[1] / 0.1) * np.where(abs(x[1]) > 0.5, 2.0, 1.0)
    inside = (x[0] > -1.0) & ~(x[0] >= 1.0)
    return {"v": rates[1] - smooth + np.clip(x.q, -0.5, 0.5) % 0.3, "q": rates[0] + inside * 0.01}


def test_matrices_loops_conditions_and_functions_are_followed() -> None:
    model = bg.state_space(
        "mixed", states={"q": 0.2, "v": -0.3}, inputs={"force": None}, rates=_gains,
        outputs=lambda t, x, u, theta: {"power": x.v * u.force, "one": 1},
        parameters={"stiffness": 3.0, "damping": 0.2},
    )  # fmt: skip
    assert not model.inputs[0].has_default
    for q, v, force, t in ((0.2, -0.3, 1.5, 0.7), (1.4, 0.9, -2.0, 0.1), (-1.2, 0.1, 0.0, 2.0)):
        pushed = sum(0.1**k * math.cos(k * t) for k in range(3)) * force
        friction = math.tanh(v / 0.1) * (2.0 if abs(v) > 0.5 else 1.0)
        limited = min(max(q, -0.5), 0.5)
        expected = [
            v + (0.01 if -1.0 < q < 1.0 else 0.0),
            -3.0 * q - 0.2 * v + pushed - friction + limited - 0.3 * math.floor(limited / 0.3),
        ]
        theta = model.theta()
        np.testing.assert_allclose(model.rhs(t, [q, v], [force], theta), expected, rtol=1e-13, atol=1e-15)
        np.testing.assert_allclose(model.output(t, [q, v], [force], theta), [v * force, 1.0])
        compiled = np.empty(2)
        model.compiled.rhs_into(t, np.array([q, v]), np.array([force]), theta, compiled)
        np.testing.assert_allclose(compiled, expected, rtol=1e-13, atol=1e-15)


_FORMULAS = st.recursive(
    st.one_of(st.sampled_from(["a", "b", "t"]), st.floats(0.1, 3.0).map(repr)),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*"]), inner).map(lambda p: f"({p[0]} {p[1]} {p[2]})"),
        st.tuples(st.sampled_from(["sin", "tanh", "abs", "-"]), inner).map(lambda p: f"{p[0]}({p[1]})"),
        inner.map(lambda p: f"({p})**2"),
        st.tuples(inner, inner).map(lambda p: f"({p[0]})/(1 + ({p[1]})**2)"),
    ),
    max_leaves=12,
)


@settings(max_examples=60, deadline=None)
@given(_FORMULAS, st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_an_expression_is_what_python_makes_of_it(text: str, a: float, b: float) -> None:
    model = bg.state_space("formula", states={"a": 0.0, "b": 0.0}, rates={"a": text, "b": "0"}, outputs={"y": "a"})
    names = {"a": a, "b": b, "t": 0.5, "sin": math.sin, "tanh": math.tanh, "abs": abs}
    with np.errstate(over="ignore"):
        found = float(model.rhs(0.5, [a, b], [], [])[0])
    expected = eval(text, {"__builtins__": {}}, names)  # the text was made here
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-12)


def _branches(t: Any, x: Any, u: Any, theta: Any) -> Any:
    if x[0] > 1.0:
        return 0.0, 0.0
    return x[1], x[0]


def _waits(t: Any, x: Any, u: Any, theta: Any) -> Any:
    while x[0] < 1.0:
        pass
    return 0.0, 0.0


def _known(t: Any, x: Any, u: Any, theta: Any) -> Any:
    return math.sin(x[0]), x[1]


def _other(t: Any, x: Any, u: Any, theta: Any) -> Any:
    return np.heaviside(x[0], 0.5), x[1]


def _misspelt(t: Any, x: Any, u: Any, theta: Any) -> Any:
    return theta.grwoth * x[0], x[1]


def _fails(t: Any, x: Any, u: Any, theta: Any) -> Any:
    return 1 / 0, x[1]


@pytest.mark.parametrize(
    ("rates", "line", "said"),
    [
        (_branches, "if x[0] > 1.0:", "use numpy.where"),
        (_waits, "while x[0] < 1.0:", "a branch or loop depends on a quantity"),
        (_known, "return math.sin(x[0]), x[1]", "not those of math"),
        (_other, "return np.heaviside(x[0], 0.5), x[1]", "numpy.heaviside cannot be followed - there are abs,"),
        (_misspelt, "return theta.grwoth * x[0], x[1]", "did you mean 'growth'"),
        (_fails, "return 1 / 0, x[1]", "division by zero"),
        (lambda t, x, u, theta: (x[0] == 1.0, x[1]), "x[0] == 1.0", "a branch or loop depends"),
        (lambda t, x, u, theta: (max(x[0], 1.0), x[1]), "max(x[0], 1.0)", "numpy.maximum"),
    ],
)
def test_what_cannot_be_followed_is_refused_with_its_line(rates: Callable[..., Any], line: str, said: str) -> None:
    with pytest.raises(ModelError) as refused:
        preys(rates=rates)
    assert line in refused.value.message and said in refused.value.message
    assert "lotka_volterra: rates: line " in refused.value.message


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"rates": {"prey": "0"}}, "rates has nothing for 'predator' - give one for each of prey, predator"),
        ({"rates": {"prey": "0", "predatr": "0"}}, "of 'predatr', which is none; did you mean 'predator'"),
        ({"rates": lambda t, x, u, theta: x[0]}, "gives 1 numbers for 2 states"),
        ({"rates": lambda t, x, u, theta: ("a", x[0])}, "gives 'a' - give arithmetic"),
        ({"rates": lambda t, x, u, theta: (math.nan, x[0])}, "gives nan"),
        ({"rates": lambda t, x: x}, "function of (t, x) - let it take (t, x, u, theta)"),
        ({"rates": {"prey": "prey +", "predator": "0"}}, "rates of prey: 'prey +' cannot be read"),
        ({"rates": {"prey": "(prey", "predator": "0"}}, "cannot be read ('(' was never closed) - write it"),
        ({"rates": lambda t, x, u, theta: None}, "rates gives None - let it return its numbers"),
        ({"parameters": {"growth": (4.0, 0.1, 3.0)}}, "'growth' is (4.0, 0.1, 3.0) - give a finite number, or (value"),
        ({"parameters": {"growth": (1.0, 3.0)}}, "'growth' is (1.0, 3.0) - give a finite number"),
        ({"parameters": {"growth": math.nan}}, "'growth' is nan - give a finite number"),
        ({"rates": {"prey": "open('x')", "predator": "0"}}, "cannot be read"),
        ({"rates": {"prey": "sin(prey, 2)", "predator": "0"}}, "sin takes 1, not 2 numbers"),
        ({"rates": {"prey": "where(prey, 1, 2)", "predator": "0"}}, "a number stands where a condition is needed"),
        ({"rates": {"prey": "hungr", "predator": "0"}}, "there is no 'hungr'; did you mean 'hunger'"),
        ({"outputs": lambda t, x, u, theta: x}, "let it return a dict"),
        ({"states": {"my prey": 1.0, "predator": 1.0}}, "'my prey' cannot name a quantity"),
        ({"states": {"growth": 1.0, "predator": 1.0}}, "'growth' names two quantities"),
        ({"states": {}}, "there are no states"),
        ({"units": {"loss": "1/min"}}, "loss is in [1/min]"),
        ({"units": {"losses": "1/s"}}, "units names 'losses'; did you mean 'loss'"),
        ({"parameters": {**GROWTH, "growth": (1.0, 3.0, 0.1)}}, "(value, lower, upper) with the value between"),
    ],
)
def test_what_is_declared_wrongly_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(BondGraphError) as refused:
        preys(**changes)
    assert said in refused.value.message
