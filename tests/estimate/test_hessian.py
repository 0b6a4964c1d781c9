"""Second derivatives against a closed form, against differences of values, and where there are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.analysis.hessian import hessian
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.problem import pose
from tests.estimate.lag_covariance import covariance, one_sensor, pushed, unit_course
from tests.estimate.linear import simulated


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
