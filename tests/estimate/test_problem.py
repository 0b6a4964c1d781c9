"""Posing a problem: names, bounds, numbers of members, what each log knows, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import FreeParameter, declared_free, parse_target
from bondgraph.estimate.initial import directly_measured, initial_states
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.problem import pose
from bondgraph.estimate.transforms import Scale
from bondgraph.simulate.example import pendulum
from bondgraph.simulate.model import Model
from tests.estimate.linear import ExactLikelihood, lag, simulated
from tests.filter.logs import circuit_filter, simulated_log
from tests.module_text import STACK

LOGS = (simulated("run1", 1, {}), simulated("run2", 2, {}, x0=1.0, load=0.5))


def test_names_choose_rows_of_the_batch() -> None:
    free = ["mass", "std(speed)", "process(v)", "x0(v, run2)"]
    problem = pose(lag(), LOGS, free, initial="model", likelihood=ExactLikelihood())
    points = np.array([[1.0, 2.0], np.log([0.01, 0.02]), np.log([0.3, 0.4]), [0.5, 0.6]])
    batch = problem.batch(points)
    np.testing.assert_allclose(batch.theta[:, 0], [1.0, 3.0, 1.0, 0.0, 1.0])
    np.testing.assert_allclose(batch.noise_std, [[0.01, 0.02], [3.0, 3.0]])
    np.testing.assert_allclose(batch.process_std, [[0.3, 0.4]])
    np.testing.assert_allclose(batch.x0[0], [[0.0, 0.0]])
    np.testing.assert_allclose(batch.x0[1], [[0.5, 0.6]])
    assert problem.names == tuple(free)


def test_a_shared_initial_state_gives_way_to_that_of_one_log() -> None:
    for free in (["x0(v)", "x0(v, run2)"], ["x0(v, run2)", "x0(v)"]):
        problem = pose(lag(), LOGS, free, likelihood=ExactLikelihood())
        values = {"x0(v)": 0.25, "x0(v, run2)": 0.75}
        batch = problem.batch(np.array([[values[name]] for name in free]))
        assert [float(x0[0, 0]) for x0 in batch.x0] == [0.25, 0.75]


def test_declared_bounds_scales_and_starts() -> None:
    model = lag()
    assert declared_free("mass", model) == FreeParameter("mass", 0.5, 8.0, 2.0)
    assert declared_free("drag", model).scale == "log"  # its bounds span a factor of 300
    level = declared_free("std(speed_rpm)", model)
    assert (level.lower, level.upper, level.start, level.scale) == pytest.approx((0.03, 300.0, 3.0, "log"))
    assert declared_free("process(v)", model).start == 0.1
    assert declared_free("x0( v , run1 )", model).target == parse_target("x0(v,run1)")


def test_initial_states_that_are_free_start_where_their_log_does() -> None:
    problem = pose(lag(), LOGS, ["x0(v, run2)", "x0(v)"], likelihood=ExactLikelihood())
    first, second = (log.y[0, 0] for log in LOGS)
    assert problem.free[0].start == pytest.approx(second)
    assert problem.free[1].start == pytest.approx((first + second) / 2.0)


def test_measured_states_start_at_their_first_measurement() -> None:
    model = lag().model
    assert directly_measured(model, np.zeros(1), model.theta()) == {0: (0, pytest.approx(1.0), pytest.approx(0.0))}
    late = replace(LOGS[1], y=LOGS[1].y.copy())
    late.y[0, :2] = np.nan
    measured = initial_states(model, [LOGS[1], late], model.theta(), "measured")
    assert [float(x0[0]) for x0 in measured] == pytest.approx([LOGS[1].y[0, 0], LOGS[1].y[0, 2]])
    assert [float(x0[0]) for x0 in initial_states(model, LOGS, model.theta(), "model")] == [0.0, 0.0]
    late.y[0, :30] = np.nan
    assert initial_states(model, [late], model.theta(), "measured")[0] == pytest.approx([late.y[1, 0] / 30.0])
    late.y[1, :30] = np.nan  # what one sensor does not show in time another may
    assert initial_states(model, [late], model.theta(), "measured")[0] == [0.0]
    assert initial_states(model, LOGS, model.theta(), ({"v": 1.5}, {}))[0] == [1.5]
    with pytest.raises(EstimationError, match="given for 1 logs of 2"):
        initial_states(model, LOGS, model.theta(), ({"v": 1.5},))
    with pytest.raises(EstimationError, match="rule 'guess' is not known - choose measured, settled, model"):
        initial_states(model, LOGS, model.theta(), "guess")  # type: ignore[arg-type]


def test_a_nonlinear_output_measures_no_state() -> None:
    model = pendulum()
    assert directly_measured(model, model.u0(), model.theta()) == {}


def test_what_a_log_knows_stays_as_it_is() -> None:
    problem = pose(lag(), LOGS, [FreeParameter("load", 0.0, 5.0, 0.0)], initial="model", likelihood=ExactLikelihood())
    alone = pose(lag(), LOGS[1], ["mass"], initial="model", likelihood=ExactLikelihood())
    values = problem.nll(np.array([[0.0, 1.0]]))
    # Only run1 depends on the free load; run2 contributes the same to both members.
    first = pose(lag(), LOGS[0], [problem.free[0]], initial="model", likelihood=ExactLikelihood())
    np.testing.assert_allclose(values - first.nll(np.array([[0.0, 1.0]])), float(alone.nll(np.array([[2.0]]))[0]))


def test_priors_add_their_own_terms() -> None:
    known = FreeParameter("mass", 0.5, 8.0, 2.0, prior_mean=3.0, prior_std=0.5)
    plain = pose(lag(), LOGS, ["mass"], likelihood=ExactLikelihood())
    problem = pose(lag(), LOGS, [known], likelihood=ExactLikelihood())
    points = np.array([[2.0, 3.0, 4.5]])
    np.testing.assert_allclose(problem.nll(points) - plain.nll(points), [2.0, 0.0, 4.5])
    np.testing.assert_allclose(problem.terms(points).innovations[-1], [-2.0, 0.0, 3.0])
    np.testing.assert_allclose(problem.terms(points).sums() - plain.terms(points).sums(), [2.0, 0.0, 4.5])


def test_the_filter_gives_the_exact_likelihood_of_a_linear_model() -> None:
    logs = [replace(log.rows(log.time < 1.5), theta_overrides=log.theta_overrides) for log in LOGS]
    free = ["mass", "drag", "std(speed)", "process(v)", "x0(v, run1)"]
    points = pose(lag(), logs, free).start[:, None] * np.array([1.0, 1.1, 0.9])
    exact = pose(lag(), logs, free, likelihood=ExactLikelihood())
    filtered = pose(lag(substeps=20, noise_nodes=8), logs, free, likelihood=FilterLikelihood(compiled=False))
    np.testing.assert_allclose(filtered.nll(points), exact.nll(points), rtol=1e-7)
    np.testing.assert_allclose(filtered.terms(points).sums(), exact.terms(points).sums(), rtol=1e-7)


REFUSED = {
    "unknown": ("masss", r"lag has no parameter 'masss'; did you mean 'mass'\?"),
    "unknown output": ("std(sped)", "lag has no output 'sped'; did you mean 'speed"),
    "unknown state": ("x0(w)", "lag has no state 'w'"),
    "measured parameter": (
        "load",
        r"declares no bounds for it, so it counts as measured .* --free load=LOWER:UPPER, .* one of mass, drag, gain",
    ),
    "no such log": ("x0(v, run7)", r"no log is called 'run7'; did you mean"),
    "bounds": (FreeParameter, ("mass", 3.0, 1.0, 2.0), "bounds 3 to 1 must be two finite numbers"),
    "start outside": (FreeParameter, ("mass", 1.0, 3.0, 4.0), "start 4 lies outside its bounds 1 to 3"),
    "log of zero": (FreeParameter, ("mass", 0.0, 3.0, 1.0, None, None, "log"), "needs bounds above zero, not 0 to 3"),
    "half a prior": (FreeParameter, ("mass", 0.0, 3.0, 1.0, 2.0), "a prior needs both"),
    "prior without width": (FreeParameter, ("mass", 0.0, 3.0, 1.0, 2.0, 0.0), "prior_std 0.0 must be above zero"),
}


@pytest.mark.parametrize("case", REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_estimated_is_refused(case: tuple) -> None:
    with pytest.raises(EstimationError, match=case[-1]):
        pose(lag(), LOGS, [case[0] if len(case) == 2 else case[0](*case[1])])


def test_problems_that_say_nothing_are_refused() -> None:
    silent = [replace(log, y=np.where(np.arange(2)[:, None] == 1, np.nan, log.y)) for log in LOGS]
    knowing = [replace(log, theta_overrides={"mass": 2.0}) for log in LOGS]
    for model, logs, free, message in (
        (lag(), LOGS, ["mass", "mass"], "'mass' is named twice"),
        (lag(), LOGS, [], "needs at least one free parameter"),
        (lag(), [], ["mass"], "needs at least one log"),
        (lag(), [LOGS[0], LOGS[0]], ["mass"], "two logs are called 'run1'"),
        (lag(), silent, ["std(speed_rpm)"], "no log measures 'speed_rpm'"),
        (lag(), knowing, ["mass"], "every log states its value"),
        (
            lag(appended={"mass": 0.0}, initial_std={"v": 0.1, "mass": 0.1}),
            LOGS,
            ["mass"],
            "already follows it as a state",
        ),
        (lag(initial_std={}), LOGS, ["x0(v)"], "gives this state no initial uncertainty"),
        (lag(), LOGS, ["corr(speed, speed)"], "names 'speed' twice"),
    ):
        with pytest.raises(EstimationError, match=message):
            pose(model, logs, free)


def test_states_that_are_not_measured_settle_while_the_others_are_held() -> None:
    """A vehicle that rolls: its other axle turns, its springs carry the thrust, its distance is left alone."""
    model = Model.from_text(VEHICLE)
    time = np.array([0.0, 1.0])
    log = MatchedLog("rolling", time, np.zeros((0, 2)), np.array([[10.0, 9.9]]))
    (x0,) = initial_states(model, [log], model.theta(), "settled")
    assert dict(zip(model.names("state"), x0.tolist(), strict=True)) == pytest.approx(
        {"v": 10.0, "wheel": 10.0 / 0.3, "sag": 0.01, "sag_rate": 0.0, "distance": 5.0}, abs=1e-6
    )


def test_the_coordinate_of_a_bound_gives_that_bound() -> None:
    """The exponential of a logarithm may miss by a digit, and a value outside its bounds is refused later."""
    for lower, upper in np.exp(np.random.default_rng(0).uniform(-9.0, 9.0, (200, 1))) * np.array([1.0, 7.3]):
        parameter = FreeParameter("scale", float(lower), float(upper), float(lower), scale="log")
        bounds = np.array([parameter.coordinate(parameter.lower), parameter.coordinate(parameter.upper)])
        ends = parameter.values(bounds)
        assert ends.tolist() == [parameter.lower, parameter.upper]


@pytest.mark.parametrize("scale", ["linear", "log", "logit"])
def test_transforms_are_their_own_inverse_and_have_the_slope_of_differences(scale: Scale) -> None:
    parameter = FreeParameter("eta", 0.2, 0.95, 0.5, scale=scale)
    for value in (0.2, 0.2001, 0.5, 0.94, 0.95):
        assert float(parameter.values(np.array(parameter.coordinate(value)))) == pytest.approx(value, rel=1e-14)
        around = parameter.coordinate(min(max(value, 0.201), 0.949)) + np.array([1e-4, -1e-4])
        moved = np.diff(parameter.values(around))[0] / -2e-4
        assert parameter.slope(float(parameter.values(around.mean()))) == pytest.approx(moved, rel=1e-6)
    ends = np.array([parameter.coordinate(0.2), parameter.coordinate(0.95)])
    assert parameter.values(ends).tolist() == [0.2, 0.95]


def test_states_that_never_come_to_rest_start_as_declared() -> None:
    model = Model.from_text(VEHICLE)
    log = MatchedLog("rolling", np.array([0.0, 1.0]), np.zeros((0, 2)), np.array([[10.0, 9.9]]))
    (x0,) = initial_states(model, [log], model.theta(damping=0.0), "settled")
    assert x0[model.index("state", "sag")] == 0.0 and x0[model.index("state", "wheel")] == pytest.approx(10.0 / 0.3)


VEHICLE = (
    '''"""A vehicle that rolls without drive."""
import numpy as np

NAME = "rolling"
FORMAT = "bondgraph-module/1"
STATES = (
    ("v", "m/s", 0.0, "speed"),
    ("wheel", "rad/s", 0.0, "wheel"),
    ("sag", "m", 0.0, "deflection of the suspension"),
    ("sag_rate", "m/s", 0.0, "its rate"),
    ("distance", "m", 5.0, "distance"),
)
INPUTS = ()
PARAMETERS = (("damping", "1/s", 6.0, 0.0, 20.0, "of the suspension"),)
OUTPUTS = (("speed", "m/s", "speed"),)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    lift = 400.0*(0.001*x[0] - x[2])
    return _stack(x, (-0.1*x[0], 50.0*(x[0] - 0.3*x[1]), x[3], lift - theta[0]*x[3], x[0]))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    return _stack(x, (x[0],))
'''
    + STACK
)


def test_the_drift_of_a_followed_parameter_is_estimated() -> None:
    """A wire whose resistance wanders, as the filter believes it does; its drift is found within its interval."""
    drift = 0.08
    followed = circuit_filter(
        appended={"R_wire": drift}, initial_std={"i_coil": 0.1, "u_capacitor": 0.1, "R_wire": 0.05},
        process_noise={"i_coil": 0.02}, measurement_noise={"current": 0.02, "voltage": 0.02},
    )  # fmt: skip
    log = simulated_log(followed, np.arange(300) * 0.05, seed=12)
    unknown = replace(followed, appended={"R_wire": 0.01})
    free = declared_free("process(R_wire)", unknown)
    assert (free.lower, free.start, free.upper, free.scale) == (1e-4, 0.01, 1.0, "log")
    matched = MatchedLog("wire", log.time, log.u, log.y)
    found = estimate(
        pose(unknown, [matched], ["process(R_wire)"], "model"), Settings("gradient", starts=1, certify="none")
    )
    ratio = found.values["process(R_wire)"] / drift
    assert 0.6 < ratio < 1.6
    assert found.filter_model.appended["R_wire"] == found.values["process(R_wire)"]
    assert "(ohm)/s^0.5" in found.summary()
    with pytest.raises(EstimationError, match="has no state 'R_wires'; did you mean 'R_wire'"):
        pose(unknown, [matched], ["process(R_wires)"])
