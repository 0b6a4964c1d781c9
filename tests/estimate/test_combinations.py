"""What acts only together, said as the product or the sum that the law holds."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.analysis.combinations import Combination, combinations
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.objective import fitted_expansion
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from tests.module_text import STACK

TEXT = '''"""A lag whose rate is a law of three parameters."""
import numpy as np

NAME = "lag"
FORMAT = "bondgraph-module/1"
STATES = (("v", "m/s", 0.0, "speed"),)
INPUTS = (("force", "N", 0.0, "hold", None, "driving force"),)
PARAMETERS = (
    ("a", "1", 2.0, 0.5, 8.0, "one"),
    ("b", "1", 1.5, 0.1, 6.0, "two"),
    ("c", "1", 0.7, 0.1, 3.0, "three"),
)
OUTPUTS = (("speed", "m/s", "speed"),)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    a, b, c = theta[0], theta[1], theta[2]
    return _stack(x, (u[0] - (LAW)*x[0],))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    return _stack(x, (x[0],))
'''


def posed(law: str, free: list[str]) -> EstimationProblem:
    model = Model.from_text(TEXT.replace("LAW", law) + STACK)
    swing = FilterModel(model, {}, {"speed": 0.01}, {"v": 0.1})
    time = np.arange(30) * 0.2
    force = np.sign(np.sin(time))[np.newaxis]
    log = MatchedLog("run", time, force, simulate(model, time, force).y)
    return pose(swing, log, free, likelihood=FilterLikelihood(compiled=False))


def together(law: str, free: str) -> tuple[Combination, ...]:
    problem = posed(law, list(free))
    information = fitted_expansion(problem, problem.start, central_differences).information
    return combinations(problem, problem.start, information)


@pytest.mark.parametrize(
    ("law", "free", "said"),
    [
        ("a*b", "ab", "a and b act only together, as a*b"),
        ("a/b", "ab", "a and b act only together, as a/b"),
        ("a*b**2", "ab", "a and b act only together, as a*b^2"),
        ("a/b**0.5", "ab", "a and b act only together, as a/b^(1/2)"),
        ("a + b", "ab", "a and b act only together, as a + b"),
        ("a + 2*b", "ab", "a and b act only together, as a + 2*b"),
        ("a*b*c", "abc", "a, b and c act only together, as a*b*c"),
        ("a + b + c", "abc", "a, b and c act only together, as a + b + c"),
    ],
)
def test_a_law_that_holds_everywhere_is_read_from_one_point(law: str, free: str, said: str) -> None:
    assert [str(one) for one in together(law, free)] == [said]


def test_a_member_of_which_the_logs_tell_little_belongs_to_the_group() -> None:
    """Of a turntable mass and stiffness were told to share a scale, and nothing of its dampings, which share it too."""
    (found,) = together("(a + 0.01*c*np.abs(x[0]))/b", "abc")
    assert str(found) == "a, b and c act only together, as a/c and b/c"


def test_a_law_is_told_near_a_bound_too() -> None:
    """Of a collector whose scale ended near a bound the common scale was told "near this point"."""
    problem = posed("a*b", ["a", "b"])
    point = problem.start.copy()
    point[0] = problem.lower[0] + 0.02 * (problem.upper[0] - problem.lower[0])
    information = fitted_expansion(problem, point, central_differences).information
    assert [str(one) for one in combinations(problem, point, information)] == ["a and b act only together, as a*b"]


def test_what_is_neither_product_nor_sum_is_said_for_this_point_only() -> None:
    (found,) = together("a*np.exp(b)", "ab")
    assert found.law == "locally" and "near this point as" in str(found)


def test_what_the_logs_tell_apart_is_in_no_group() -> None:
    assert together("a + b*np.abs(x[0])", "ab") == ()
