"""Morris and Sobol on responses whose indices are known in closed form."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bondgraph.errors import EstimationError, OptionError
from bondgraph.estimate.analysis.screening import (
    global_sensitivity,
    likelihood_response,
    output_response,
    problem_bounds,
)
from bondgraph.estimate.problem import pose
from tests.estimate.linear import ExactLikelihood, lag, simulated

pytest.importorskip("SALib")

ISHIGAMI = {"x1": (-np.pi, np.pi), "x2": (-np.pi, np.pi), "x3": (-np.pi, np.pi)}


def ishigami(points: np.ndarray) -> np.ndarray:
    return np.sin(points[0]) + 7.0 * np.sin(points[1]) ** 2 + 0.1 * points[2] ** 4 * np.sin(points[0])


def test_sobol_of_the_ishigami_function_is_that_of_ishigami_and_homma() -> None:
    """First order 0.3139, 0.4424, 0 and total 0.5576, 0.4424, 0.2437 in closed form (Ishigami and Homma 1990)."""
    found = global_sensitivity(ishigami, ISHIGAMI, samples=1024, seed=1)
    first, total = found.indices["first"], found.indices["total"]
    assert (np.abs(first - [0.3139, 0.4424, 0.0]) < found.confidence["first"]).all()
    assert (np.abs(total - [0.5576, 0.4424, 0.2437]) < found.confidence["total"]).all()
    assert found.evaluations == 1024 * 5
    assert found.order == (0, 1, 2)


def test_the_table_is_said_in_words() -> None:
    """Of Ishigami's function the third acts with the first only: 0.2437 of the variance, none of it alone."""
    found = global_sensitivity(ishigami, ISHIGAMI, samples=1024, seed=1)
    first, together = found.advice()
    assert first == "follows x1, x2, x3" and together.startswith("not by each alone, but together: x1")
    assert together.endswith("x3") and "x2" not in together
    assert found.summary().endswith(together)
    (few,) = global_sensitivity(ishigami, ISHIGAMI, samples=4, seed=1).advice()[-1:]
    assert few.startswith("4 samples do not tell whether x") and "more samples" in few
    slopes = {"a": (0.0, 1.0), "b": (0.0, 1.0)}
    steep = global_sensitivity(lambda x: 3.0 * x[0] + 0.01 * x[1], slopes, "morris", samples=4)
    assert steep.advice() == ("follows a", "hardly follows b: less than 5 % of the largest effect")


def test_the_numbers_are_those_of_salib() -> None:
    from SALib.analyze import sobol as analysis
    from SALib.sample import sobol as sampling
    from SALib.test_functions import Ishigami

    space = {"num_vars": 3, "names": list(ISHIGAMI), "bounds": [list(pair) for pair in ISHIGAMI.values()]}
    points = sampling.sample(space, 256, calc_second_order=False, seed=3)
    expected = analysis.analyze(space, Ishigami.evaluate(points), calc_second_order=False, seed=3)
    found = global_sensitivity(ishigami, ISHIGAMI, samples=256, seed=3)
    np.testing.assert_allclose(found.indices["first"], expected["S1"], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.indices["total"], expected["ST"], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("method", ["sobol", "morris"])
def test_the_same_seed_gives_the_same_intervals_also_a_seed_of_zero(method: str) -> None:
    one, other = (global_sensitivity(ishigami, ISHIGAMI, method, samples=16) for _ in range(2))
    for column, widths in one.confidence.items():
        np.testing.assert_array_equal(widths, other.confidence[column])


def test_elementary_effects_of_a_straight_line_are_its_slopes_over_the_bounds() -> None:
    bounds = {"a": (0.0, 2.0), "b": (-1.0, 1.0), "c": (0.0, 1.0)}
    found = global_sensitivity(lambda x: 3.0 * x[0] - 2.0 * x[1], bounds, "morris", samples=10)
    np.testing.assert_allclose(found.indices["mu_star"], [6.0, 4.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.indices["mu"], [6.0, -4.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.indices["sigma"], 0.0, atol=1e-12)


def test_likelihoods_and_outputs_answer_and_what_acts_on_nothing_moves_neither() -> None:
    log = simulated("run", 1, {}, 20)
    problem = pose(lag(), log, ["mass", "drag", "colour"], likelihood=ExactLikelihood())
    for response in (likelihood_response(problem), output_response(problem, "speed", "last")):
        found = global_sensitivity(response, problem_bounds(problem), "morris", samples=8)
        assert found.names[found.order[-1]] == "colour"
        assert found.indices["mu_star"][2] == 0.0 and found.indices["mu_star"][1] > 0.0
        json.dumps(found.to_dict(), allow_nan=False)
    assert len(found.plot().texts) == 3


def test_members_that_fail_count_as_the_worst_and_too_many_end_it() -> None:
    def sometimes(points: np.ndarray) -> np.ndarray:
        return np.where(points[0] > 0.9, np.inf, points[0])

    found = global_sensitivity(sometimes, {"a": (0.0, 1.0), "b": (0.0, 1.0)}, samples=64)
    assert found.failed > 0 and f"{found.failed} failed" in found.summary()
    with pytest.raises(EstimationError, match="members fail inside the bounds"):
        global_sensitivity(lambda x: np.where(x[0] > 0.1, np.nan, x[0]), {"a": (0.0, 1.0), "b": (0.0, 1.0)}, samples=64)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"method": "sobel"}, "did you mean 'sobol'"),
        ({"samples": 100}, "a power of two"),
        ({"method": "morris", "samples": 1}, "at least two trajectories"),
    ],
)
def test_impossible_wishes_are_refused(options: dict[str, object], said: str) -> None:
    with pytest.raises(OptionError, match=said):
        global_sensitivity(ishigami, ISHIGAMI, **options)


def test_a_response_that_nothing_moves_is_refused() -> None:
    with pytest.raises(EstimationError, match="it is 2 everywhere"):
        global_sensitivity(lambda x: np.full(x.shape[1], 2.0), {"a": (0.0, 1.0)}, samples=8)


def test_an_output_that_is_none_is_refused() -> None:
    problem = pose(lag(), simulated("run", 1, {}, 20), ["mass"])
    with pytest.raises(OptionError, match="did you mean 'speed'"):
        output_response(problem, "sped")
    with pytest.raises(OptionError, match="choose rms, mean, largest, last"):
        output_response(problem, "speed", "first")  # type: ignore[arg-type]
