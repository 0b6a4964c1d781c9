"""Which manoeuvre tells rivals apart: a published T-optimal design, and divergences of Gaussian vectors."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.errors import OptionError
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.design.discrimination import Rival, discriminate
from bondgraph.estimate.design.manoeuvres import Manoeuvre
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.problem import pose
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.model import Model
from tests.estimate.lag_covariance import covariance, one_sensor, pushed, unit_course
from tests.module_text import STACK

#: Standard deviation of what is measured of them.
NOISE = 0.1
#: Functions of one input as machines that never move: what is measured depends on the input alone.
STATIC = '''"""A response to an input."""
import numpy as np

NAME = "response"
FORMAT = "bondgraph-module/1"
STATES = (("rest", "1", 0.0, "never moves"),)
INPUTS = (("level", "1", 0.0, "hold", None, "what is set"),)
PARAMETERS = (
    ("p0", "1", P0, -50.0, 50.0, "constant"),
    ("p1", "1", P1, -50.0, 50.0, "first"),
    ("p2", "1", P2, -50.0, 50.0, "second"),
)
OUTPUTS = (("y", "1", "response"),)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    return _stack(x, (0.0*x[0],))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    return _stack(x, (LAW + 0.0*x[0],))
'''


def static(law: str, values: tuple[float, float, float], free: list[str]) -> Rival:
    text = STATIC.replace("LAW", law)
    for name, value in zip(("P0", "P1", "P2"), values, strict=True):
        text = text.replace(name, repr(value))
    swing = FilterModel(Model.from_text(text + STACK), {}, {"y": NOISE}, {})
    blank = MatchedLog("any", np.array([0.0, 1.0]), np.zeros((1, 2)), np.zeros((1, 2)))
    problem = pose(swing, blank, free, initial="model", likelihood=FilterLikelihood(compiled=False))
    return Rival(law, problem, problem.start)


EXPONENTIAL = "theta[0] + theta[1]*np.exp(u[0]) + theta[2]*np.exp(-u[0])"
PARABOLA = "theta[0] + theta[1]*u[0] + theta[2]*u[0]**2"


def levels(points: list[float], counts: list[int]) -> Manoeuvre:
    u = np.repeat(points, counts)[np.newaxis]
    return Manoeuvre(f"at {points}", np.arange(u.size, dtype=np.float64), u)


def test_the_design_of_atkinson_and_fedorov_has_their_criterion_and_beats_others() -> None:
    """4.5 - 1.5 exp(x) - 2 exp(-x) against a parabola on [-1, 1]: Biometrika 62 (1975), example 1.

    Their design has the points -1, -0.669, 0.144, 0.957 with weights 0.253, 0.428, 0.247, 0.072, and the sum of squares
    left to the parabola is 1.087e-3 for each observation.
    """
    true = static(EXPONENTIAL, (4.5, -1.5, -2.0), ["p0"])
    rival = static(PARABOLA, (1.0, 0.5, -1.5), ["p0", "p1", "p2"])
    plans = [
        levels([-1.0, -0.669, 0.144, 0.957], [25, 43, 25, 7]),
        levels([-1.0, -0.5, 0.0, 0.5, 1.0], [20] * 5),
    ]
    table = discriminate([true, rival], plans, jacobian=central_differences)
    nats = {row.name: float(row.nats[0, 1]) for row in table.rows}
    for plan in plans:
        x = plan.u[0]
        eta = 4.5 - 1.5 * np.exp(x) - 2.0 * np.exp(-x)
        left = np.linalg.lstsq(np.stack([x**0, x, x**2], axis=1), eta)[1]
        assert nats[plan.name] == pytest.approx(0.5 * float(left[0]) / NOISE**2, rel=1e-3)
    assert nats[plans[0].name] == pytest.approx(0.5 * 100 * 1.087e-3 / NOISE**2, rel=1e-2)
    assert nats[plans[0].name] > 1.1 * max(nats[plan.name] for plan in plans[1:])


def lagging(gain: float, name: str) -> Rival:
    """The lag with a gain; what is free acts on nothing."""
    swing = one_sensor()
    free = [FreeParameter("gain", gain - 1e-9, gain + 1e-9, gain)]
    problem = pose(swing, pushed(), free, initial="model", likelihood=FilterLikelihood(compiled=False))
    return Rival(name, problem, np.array([gain]))


def test_the_expected_ratio_is_the_divergence_of_gaussian_vectors() -> None:
    """Both models have one covariance V, and means that are h apart: the divergence is h' V^-1 h / 2 both ways."""
    log = pushed()
    rivals = [lagging(1.0, "weak"), lagging(1.3, "strong")]
    table = discriminate(rivals, [Manoeuvre.of_log(log)], jacobian=central_differences)
    apart = 0.3 * unit_course(log)
    expected = 0.5 * apart @ np.linalg.solve(covariance(log), apart)
    (row,) = table.rows
    assert row.nats[0, 1] == pytest.approx(expected, rel=1e-5)
    assert row.nats[1, 0] == pytest.approx(expected, rel=1e-5)
    # decided when the divergence of the samples up to there reaches the margin
    courses = [0.5 * apart[:k] @ np.linalg.solve(covariance(log)[:k, :k], apart[:k]) for k in range(1, len(log) + 1)]
    first = int(np.flatnonzero(np.array(courses) >= np.log(99.0))[0])
    assert row.soonest == pytest.approx(log.time[first])
    assert f"decided after {log.time[first]:.4g} s" in table.advice


def test_what_logs_at_hand_know_keeps_a_rival_from_imitating() -> None:
    true = static(EXPONENTIAL, (4.5, -1.5, -2.0), ["p0"])
    rival = static(PARABOLA, (1.0, 0.5, -1.5), ["p0", "p1", "p2"])
    held = Rival(rival.name, rival.problem, rival.point, 1e8 * np.eye(3))
    plan = [levels([-1.0, 0.0, 1.0], [10, 10, 10])]
    loose, tight = (
        discriminate([true, one], plan, jacobian=central_differences).rows[0].nats[0, 1] for one in (rival, held)
    )
    u = np.array([-1.0, 0.0, 1.0])
    apart = (4.5 - 1.5 * np.exp(u) - 2.0 * np.exp(-u)) - (1.0 + 0.5 * u - 1.5 * u**2)
    assert loose == pytest.approx(0.0, abs=1e-6)  # a parabola goes through three points
    assert tight == pytest.approx(5.0 * float(apart @ apart) / NOISE**2, rel=1e-3)


def test_a_rival_that_contains_the_other_is_asked_one_way_only() -> None:
    line = static("theta[0] + theta[1]*u[0]", (1.0, 2.0, 0.0), ["p0", "p1"])
    parabola = static(PARABOLA, (1.0, 2.0, 0.5), ["p0", "p1", "p2"])
    table = discriminate([line, parabola], [levels([-1.0, 0.0, 1.0], [10, 10, 10])], jacobian=central_differences)
    (row,) = table.rows
    assert row.worst == (1, 0) and not row.asked[0, 1]
    # of 0.5 u^2 a line leaves the residuals 1/6, -1/3, 1/6
    assert row.nats[1, 0] == pytest.approx(0.5 * 10 * (1 / 36 + 1 / 9 + 1 / 36) / NOISE**2, rel=1e-5)


def test_impossible_wishes_are_refused() -> None:
    one = lagging(1.0, "alone")
    with pytest.raises(OptionError, match="needs a second rival"):
        discriminate([one], [Manoeuvre.of_log(pushed())])
    with pytest.raises(OptionError, match="needs a manoeuvre"):
        discriminate([one, one], [])
    with pytest.raises(OptionError, match="between 0 and 0"):
        discriminate([one, one], [Manoeuvre.of_log(pushed())], error=0.7)
    with pytest.raises(OptionError, match="measure no output of the same name"):
        discriminate([one, static(PARABOLA, (1.0, 2.0, 0.5), ["p0"])], [Manoeuvre.of_log(pushed())])
