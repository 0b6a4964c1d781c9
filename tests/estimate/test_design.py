"""Expected information against closed forms and a published optimum; rates of samples."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from bondgraph.data.log import MatchedLog
from bondgraph.errors import OptionError
from bondgraph.estimate.analysis.rates import rate_table
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.design.information import expected_information, rank_manoeuvres
from bondgraph.estimate.design.manoeuvres import Manoeuvre
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.priors import Normal
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.example import pendulum
from bondgraph.simulate.model import Model
from tests.estimate.lag_covariance import STD, covariance, one_sensor, pushed, unit_course
from tests.module_text import STACK

GAIN = FreeParameter("gain", 0.2, 5.0, 1.0)

#: The consecutive reaction A -> B -> C, of which B is measured.
REACTION = (
    '''"""Two reactions after each other."""
import numpy as np

NAME = "reaction"
FORMAT = "bondgraph-module/1"
STATES = (
    ("a", "1", 1.0, "share of A"),
    ("b", "1", 0.0, "share of B"),
)
INPUTS = ()
PARAMETERS = (
    ("k1", "1/s", 0.7, 0.1, 1.5, "rate of the first"),
    ("k2", "1/s", 0.2, 0.05, 0.6, "rate of the second"),
)
OUTPUTS = (("B", "1", "share of B"),)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    return _stack(x, (-theta[0]*x[0], theta[0]*x[0] - theta[1]*x[1]))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    return _stack(x, (x[1],))
'''
    + STACK
)


def planned(log: MatchedLog) -> Manoeuvre:
    return Manoeuvre.of_log(log)


def test_expected_information_is_that_of_a_gaussian_vector_with_process_noise() -> None:
    log = pushed()
    course = unit_course(log)
    problem = pose(one_sensor(), log, [GAIN], initial="model")
    found = expected_information(problem, planned(log), problem.start, central_differences)
    assert found[0, 0] == pytest.approx(course @ np.linalg.solve(covariance(log), course), rel=1e-6)


def test_expected_information_of_a_noise_level_is_two_for_every_sample() -> None:
    """Of independent samples with deviation s, that of log s is 2 n: no process noise, a start that is known."""
    log = pushed()
    known = one_sensor(process_noise={}, initial_std={})
    problem = pose(known, log, [FreeParameter("std(speed)", 0.001, 1.0, STD, scale="log")], initial="model")
    found = expected_information(problem, planned(log), problem.start, central_differences)
    assert found[0, 0] == pytest.approx(2.0 * len(log), rel=1e-6)


def test_gain_and_shares_are_those_of_normal_laws() -> None:
    log = pushed()
    problem = pose(one_sensor(), log, [GAIN], initial="model")
    told = float(expected_information(problem, planned(log), problem.start, central_differences)[0, 0])
    prior = (5.0 - 0.2) ** 2 / 12.0
    (row,) = rank_manoeuvres(problem, [planned(log)], jacobian=central_differences).rows
    assert row.gain == pytest.approx(0.5 * np.log1p(prior * told), rel=1e-9)
    assert row.mean_left == pytest.approx(1.0 / (1.0 + prior * told), rel=1e-9)
    assert row.worst_left == pytest.approx(float(row.std_left[0]), rel=1e-9)
    (again,) = rank_manoeuvres(
        problem, [planned(log)], known=np.array([[3.0 * told]]), jacobian=central_differences
    ).rows
    before = 1.0 + 3.0 * prior * told
    assert again.gain == pytest.approx(0.5 * np.log((before + prior * told) / before), rel=1e-9)


def reaction() -> EstimationProblem:
    swing = FilterModel(Model.from_text(REACTION), {}, {"B": 0.01}, {}, substeps=60)
    blank = MatchedLog("any", np.array([0.0, 1.0]), np.zeros((0, 2)), np.zeros((1, 2)))
    numpy_filter = FilterLikelihood(compiled=False)
    return pose(swing, blank, ["k1", "k2"], initial="model", likelihood=numpy_filter)


@pytest.mark.slow
def test_the_best_two_samples_of_a_consecutive_reaction_are_those_of_box_and_lucas() -> None:
    """D-optimal times 1.23 and 6.86 at rates of 0.7 and 0.2 (Box and Lucas 1959, Biometrika 46, 77-90)."""
    problem = reaction()
    measured = np.array([[False, True, True]])

    def lost(times: np.ndarray) -> float:
        first, second = sorted(times)
        plan = Manoeuvre("two samples", np.array([0.0, first, second]), np.zeros((0, 3)), {}, measured)
        return -rank_manoeuvres(problem, [plan], jacobian=central_differences).rows[0].log_det

    best = minimize(lost, [1.0, 6.0], method="Nelder-Mead", options={"xatol": 5e-3, "fatol": 1e-7})
    assert sorted(best.x) == pytest.approx([1.23, 6.86], abs=0.01)


def test_standard_deviations_at_lower_rates_are_those_of_the_samples_left() -> None:
    """Without process noise the information of a gain is the sum of the squared course over the samples."""
    log = pushed()
    problem = pose(one_sensor(process_noise={}, initial_std={}), log, [GAIN], initial="model")
    table = rate_table(problem, [2.5, 10.0], jacobian=central_differences)
    course = unit_course(log)
    expected = [STD / np.sqrt((part**2).sum()) for part in (course, _held(log)[::4])]
    assert [row.rate for row in table.rows] == [10.0, 2.5]
    np.testing.assert_allclose([row.std[0] for row in table.rows], expected, rtol=1e-6)
    assert [row.samples for row in table.rows] == [40, 10]
    assert table.rows[0].work == pytest.approx(table.rows[1].work, rel=0.1)  # steps of the same length
    assert table.sufficient == 10.0 and "10 1/s is needed" in table.verdict
    json.dumps(table.to_dict(), allow_nan=False)
    assert list(table.to_dataframe().index) == [10.0, 2.5]
    unknown = replace(table, rows=(table.rows[0], replace(table.rows[1], std=np.array([np.nan]))))
    assert unknown.table()[1][1][-1] == "not told"


def _held(log: MatchedLog) -> np.ndarray:
    """The course where each fourth sample of the force is held until the next."""
    force = np.repeat(log.u[0, ::4], 4)
    return unit_course(MatchedLog(log.name, log.time, force[np.newaxis], log.y))


def test_rates_that_leave_nothing_are_refused() -> None:
    problem = pose(one_sensor(), pushed(), [GAIN], initial="model")
    with pytest.raises(OptionError, match=r"0\.1 samples per second leave 1 of log run"):
        rate_table(problem, [0.1])
    with pytest.raises(OptionError, match="none are given"):
        rate_table(problem, [])


def test_a_design_without_manoeuvres_is_refused() -> None:
    with pytest.raises(OptionError, match="no manoeuvre is planned"):
        rank_manoeuvres(pose(one_sensor(), pushed(), [GAIN], initial="model"), [])


def test_the_information_of_a_manoeuvre_holds_no_prior() -> None:
    """What is known before is counted once, beside the manoeuvre."""
    swing = FilterModel(pendulum(), {}, {"deflection": 0.05}, {"angle": 0.01, "rate": 0.01}, 2)
    time = 0.05 * np.arange(60)
    log = MatchedLog("any", time, np.zeros((1, 60)), np.zeros((1, 60)))
    plan = Manoeuvre("from one", time, np.zeros((1, 60)), {"angle": 1.0})
    free = ["length", "damping"]
    bare, known = (
        pose(swing, log, free, initial="model"),
        pose(swing, log, free, initial="model", priors=[Normal("length", 0.7, 0.01)]),
    )
    found = [expected_information(one, plan, one.start) for one in (bare, known)]
    assert found[1] == pytest.approx(found[0], rel=1e-6)
    assert 0.1 * found[0][0, 0] < 1.0 / 0.01**2  # which it would have been
