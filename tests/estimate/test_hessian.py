"""Second derivatives against a closed form, against differences of values, and where there are none."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError, FilterError, OptionError
from bondgraph.estimate.analysis.hessian import exact_hessian, hessian
from bondgraph.estimate.derivatives.exact import exact_derivatives
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.joint import JointProblem, Problem, pose_joint
from bondgraph.estimate.priors import LogNormal, MultivariateNormal, Normal
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.filter.curvature import MovingMember, curvature
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.planning import plan_steps
from bondgraph.filter.robust import Robust
from bondgraph.filter.second_order import Jet
from bondgraph.simulate.example import pendulum
from bondgraph.simulate.model import Model
from tests.estimate.lag_covariance import covariance, one_sensor, pushed, unit_course
from tests.estimate.linear import ExactLikelihood, lag, simulated


def measured(samples: int) -> MatchedLog:
    """A log of the lag with its noises, of the first sensor alone."""
    log = simulated("run", 3, {}, samples)
    return replace(log, y=np.where([[True], [False]], log.y, np.nan))


def test_the_hessian_by_a_gain_is_that_of_a_gaussian_vector() -> None:
    """Measurements are N(gain h, V), so the negative log-likelihood has the curvature h' V^-1 h everywhere."""
    log = pushed()
    course = unit_course(log)
    expected = course @ np.linalg.solve(covariance(log), course)
    gain = FreeParameter("gain", 0.2, 5.0, 1.7)
    found = hessian(pose(one_sensor(), log, [gain], initial="model"))
    assert found.matrix[0, 0] == pytest.approx(expected, rel=1e-8)
    assert found.information[0, 0] == pytest.approx(expected, rel=1e-8)
    assert found.relative_error < 1e-8


def test_the_hessian_is_that_of_differences_of_values_within_its_own_error() -> None:
    problem = pose(one_sensor(), measured(60), ["mass", "drag", "std(speed)"])
    point = problem.start * 1.02
    found = hessian(problem, point)
    steps = 0.1 / np.sqrt(np.diag(found.information))
    for i in range(3):
        for j in range(i + 1):
            expected = _second_difference(problem, point, i, j, steps)
            scale = np.sqrt(found.information[i, i] * found.information[j, j])
            assert abs(found.matrix[i, j] - expected) < 1e-5 * scale
    assert found.relative_error < 1e-5
    assert (found.matrix == found.matrix.T).all()


def _second_difference(problem: object, point: np.ndarray, i: int, j: int, steps: np.ndarray) -> float:
    """Of fourth order: two step lengths along both coordinates, extrapolated."""
    found = []
    for length in (1.0, 2.0):
        moves = np.array([[a, b] for a in (1, -1) for b in (1, -1)]) * length
        members = np.repeat(point[:, np.newaxis], 4, axis=1)
        members[i] += moves[:, 0] * steps[i]
        members[j] += moves[:, 1] * steps[j]
        values = problem.nll(members)  # type: ignore[attr-defined]
        mixed = (values[0] - values[1] - values[2] + values[3]) / (4.0 * length**2 * steps[i] * steps[j])
        found.append(mixed)
    return (4.0 * found[0] - found[1]) / 3.0


def test_a_coordinate_at_its_bound_has_no_second_derivatives() -> None:
    mass = FreeParameter("mass", 2.0, 8.0, 2.0)
    found = hessian(pose(one_sensor(), measured(40), [mass, "drag"]))
    assert np.isnan(found.matrix[0]).all() and np.isnan(found.matrix[:, 0]).all()
    assert found.matrix[1, 1] > 0.0


def test_a_parameter_of_which_the_data_say_nothing_is_refused() -> None:
    log = replace(pushed(), name="still")
    with pytest.raises(EstimationError, match="the data say nothing about colour"):
        hessian(pose(one_sensor(), log, ["gain", "colour"], initial="model"))


def test_the_exact_hessian_by_a_gain_is_that_of_a_gaussian_vector() -> None:
    log = pushed()
    course = unit_course(log)
    expected = course @ np.linalg.solve(covariance(log), course)
    for method, substeps in (("rk4", 8), ("rodas4", 12)):
        lagging = one_sensor(method=method, substeps=substeps)
        found = exact_hessian(pose(lagging, log, [FreeParameter("gain", 0.2, 5.0, 1.7)], initial="model"))
        assert found.matrix[0, 0] == pytest.approx(expected, rel=1e-8)  # the closed form of the course is as exact


SWING = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
SHARE = FreeParameter("damping", 0.05, 2.0, 0.4, scale="logit")


def swings(samples: int = 50) -> MatchedLog:
    """A swing of some amplitude, so that its laws bend, driven, with values missing and uneven times."""
    chance = np.random.default_rng(5)
    time = np.cumsum(chance.uniform(0.03, 0.07, samples))
    y = 0.9 * np.cos(3.0 * time) + 0.05 * chance.standard_normal(samples)
    y[10:13] = np.nan
    return MatchedLog("swing", time, 0.3 * np.sin(time)[np.newaxis], y[np.newaxis])


def struck() -> MatchedLog:
    """The swings, three of whose readings are something else."""
    log = swings()
    y = log.y.copy()
    y[0, [5, 20, 33]] += 1.0
    return replace(log, name="struck", y=y)


def stiff(method: str, **changes: Any) -> EstimationProblem:
    """The swing by a stiff method whose steps grow along each interval."""
    return pose(replace(SWING, method=method, substeps=3, grading=1.5, **changes), swings(), ["length", "damping"])


def judged(kind: str, value: float = math.nan) -> EstimationProblem:
    """Two channels of the lag, some of whose readings are something else, with a loss."""
    log = simulated("run", 3, {}, 30)
    y = log.y.copy()
    y[0, [5, 20]] += 1.0
    y[1, [9, 20]] -= 1.0
    return pose(replace(lag(), robust=Robust(kind, value)), replace(log, y=y), ["mass", "drag", "process(v)"])


def together() -> JointProblem:
    """Two filters of one swing, one of them stiff and robust, whose coordinates stand in another order."""
    other = replace(SWING, method="ros3p", robust=Robust("student"))
    return pose_joint(
        [pose(SWING, swings(), ["length", "damping"]), pose(other, struck(), ["std(deflection)", "damping", "length"])],
        priors=[LogNormal("length", 1.1, 0.1)],
    )


def vessel() -> EstimationProblem:
    """A vessel that empties through two orifices in series, whose flow follows from an algebraic loop."""
    model = Model.from_file(Path(__file__).parents[1] / "simulate" / "modules" / "orifices.txt")
    assert model.program.solvers
    time = 0.05 * np.arange(40)
    y = np.array([0.6 * np.exp(-0.8 * time), np.full(40, np.nan)])
    y[0] += 0.02 * np.random.default_rng(2).standard_normal(40)
    slow = FilterModel(model, {"pressure": 0.05}, {"q_line": 0.02}, {"pressure": 0.3}, substeps=2)
    return pose(slow, MatchedLog("vessel", time, np.zeros((1, 40)), y), ["a_turbulent", "c_exponent"])


TWO = MultivariateNormal(("length", "damping"), (0.1, 0.3), ((0.01, 0.005), (0.005, 0.02)), ("log", "linear"))

PROBLEMS: dict[str, Callable[[], Problem]] = {
    "parameters": lambda: pose(SWING, swings(), ["length", "damping", FreeParameter("gravity", 5.0, 15.0, 9.81)]),
    "levels and starts": lambda: pose(
        SWING, swings(), ["length", "std(deflection)", "process(rate)", "x0_std(angle)",
                          FreeParameter("x0(angle, swing)", -2.0, 2.0, 0.8)],
    ),
    "logit and a prior": lambda: pose(SWING, swings(), [SHARE, "length"], priors=[Normal("damping", 0.3, 0.1)]),
    "noise between samples": lambda: pose(
        replace(SWING, noise_nodes=3, noise_reach=30.0), swings(), ["length", "process(rate)"]
    ),
    "correlated starts": lambda: pose(
        replace(SWING, initial_correlation={("angle", "rate"): 0.6}), swings(), ["length", "x0_std(rate)"]
    ),
    "several logs, one of which knows a parameter": lambda: pose(
        SWING, [swings(), replace(swings(30), name="other", theta_overrides={"length": 1.1})], ["length", "damping"]
    ),
    "an algebraic loop": vessel,
    "steps of ros2": lambda: stiff("ros2"),
    "steps of ros3p": lambda: stiff("ros3p"),
    "steps of rodas4": lambda: stiff("rodas4"),
    "planned steps": lambda: pose(
        plan_steps(replace(SWING, method="ros3p", substeps=4), [swings()], compiled=False), swings(), ["length"]
    ),
    "a parameter that is followed": lambda: pose(
        replace(SWING, appended={"damping": 0.05}, initial_std={**SWING.initial_std, "damping": 0.1}), swings(),
        ["length", FreeParameter("process(damping)", 0.001, 1.0, 0.05)],
    ),
    "a parameter that is followed in stiff steps": lambda: stiff(
        "ros3p", appended={"gravity": 0.0}, initial_std={**SWING.initial_std, "gravity": 0.3}
    ),
    "Student's loss": lambda: judged("student"),
    "Huber's loss": lambda: judged("huber", 5.0),
    "a gate": lambda: judged("gate", 0.99),
    "Student's loss and stiff steps": lambda: pose(
        replace(SWING, method="ros3p", robust=Robust("student", 2.0)), struck(), ["length", "std(deflection)"]
    ),
    "ties": lambda: pose(SWING, swings(), ["length"], ties={"damping": "0.2*length**2"}),
    "a tied level": lambda: pose(SWING, swings(), ["length"], ties={"std(deflection)": "0.05*length**2"}),
    "a lognormal prior": lambda: pose(SWING, swings(), ["length"], priors=[LogNormal("length", 1.1, 0.1)]),
    "a prior of two": lambda: pose(SWING, swings(), ["length", "damping"], priors=[TWO]),
    "a prior of what is tied": lambda: pose(
        SWING, swings(), ["length"], ties={"damping": "0.2*length**2"}, priors=[Normal("damping", 0.3, 0.1)]
    ),
    "two filters": together,
    "two sensors of a linear machine": lambda: pose(lag(), simulated("run", 3, {}, 30), ["mass", "drag", "process(v)"]),
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if "loop" in name else name for name in PROBLEMS]
)
def test_the_exact_hessian_is_that_of_differences_within_their_error(name: str) -> None:
    problem = PROBLEMS[name]()
    point = problem.start + 0.01 * (problem.upper - problem.lower)
    exact, differenced = exact_hessian(problem, point), hessian(problem, point)
    scale = 1.0 / np.sqrt(np.diag(differenced.information))
    gap = np.abs(exact.matrix - differenced.matrix) * np.outer(scale, scale)
    error = np.maximum(differenced.error, differenced.error.T)  # two estimates of the same
    assert np.all(gap <= 2.0 * error * np.outer(scale, scale) + 1e-7)
    assert exact.relative_error < 1e-9
    np.testing.assert_allclose(exact.information, differenced.information, rtol=1e-5, atol=1e-5 / scale.max() ** 2)


def test_the_curvature_has_the_value_and_the_gradient_of_the_filter() -> None:
    problem = replace(PROBLEMS["parameters"](), initial="model")  # the start of a member stays where it is
    model, point = problem.filter_model.model, problem.start
    numbers = (problem.initial_states[0], SWING.start_std, SWING.process_std, SWING.noise_std)
    theta = Jet(model.theta(), problem.batch_slopes(point).theta, np.zeros((3, 3, 3)))
    found = curvature(SWING, problem.logs[0], MovingMember(theta, *(Jet.still(one, 3) for one in numbers)))
    (expansion,) = exact_derivatives(problem, point[:, np.newaxis], np.full((3, 1), 1e-4))
    assert found.nll == pytest.approx(float(problem.nll(point[:, np.newaxis])[0]), rel=1e-12)
    np.testing.assert_allclose(found.gradient, expansion.gradient, rtol=1e-9)


def test_the_exact_hessian_of_a_followed_parameter_is_that_of_values() -> None:
    problem = PROBLEMS["a parameter that is followed"]()
    found = exact_hessian(problem)
    steps = 0.005 / np.sqrt(np.diag(found.information))
    scale = np.outer(steps, steps) / 0.005**2
    for i, j in ((0, 0), (0, 1), (1, 1)):
        expected = _second_difference(problem, problem.start, i, j, steps)
        assert abs(found.matrix[i, j] - expected) * scale[i, j] < 1e-5


def test_at_a_bound_there_are_exact_second_derivatives() -> None:
    mass = FreeParameter("mass", 2.0, 8.0, 2.0)
    assert np.isfinite(exact_hessian(pose(one_sensor(), measured(40), [mass, "drag"])).matrix).all()


@pytest.mark.parametrize(("problem", "why"), [
    (lambda: pose(SWING, swings(), [FreeParameter("x0_corr(angle, rate)", -0.9, 0.9, 0.1)]), "free correlations"),
    (lambda: pose(lag(), measured(20), ["mass"], likelihood=ExactLikelihood()), "another likelihood"),
])  # fmt: skip
def test_what_has_no_exact_second_derivatives_is_refused(problem: Callable[[], EstimationProblem], why: str) -> None:
    with pytest.raises(EstimationError, match=why):
        exact_hessian(problem())


def test_a_filter_that_fails_has_no_exact_second_derivatives() -> None:
    gone = swings()
    gone.u[0, 30:] = 1e200
    with pytest.raises(EstimationError, match="no second derivatives at this point, where the filter fails"):
        exact_hessian(pose(SWING, gone, ["length"]))
    with pytest.raises(FilterError, match="choose one before"):
        curvature(replace(SWING, method="auto"), gone, None)  # type: ignore[arg-type]


def test_a_point_of_another_problem_is_refused() -> None:
    with pytest.raises(EstimationError, match=r"at a point of shape \(3,\) - give a coordinate for each of length"):
        exact_hessian(pose(SWING, swings(), ["length"]), np.zeros(3))
    with pytest.raises(OptionError, match="FilterModel was given where a posed problem is expected"):
        hessian(SWING)  # type: ignore[arg-type]
