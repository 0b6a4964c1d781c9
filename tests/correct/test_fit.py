"""Expansions by one-sided differences, fits that give up, bounds that hold, starts of noise levels."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.differences import central_differences, forward_differences
from bondgraph.estimate.derivatives.formed import Formed, Scheme
from bondgraph.estimate.fitted import restricted, standard_deviations
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.local import fit
from bondgraph.estimate.noise_starts import noisy_starts, quiet_start
from bondgraph.estimate.objective import Expansion, SearchOutcome, Terms, expansion_of
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers import exact_newton
from bondgraph.estimate.solvers.linearised import Reached
from bondgraph.estimate.solvers.steps import damped_step
from tests.correct.sled import fitted, pull, sled


def test_one_sided_differences_give_the_expansion_of_central_ones() -> None:
    base = fitted([pull(sled(), 1)])
    steps = 0.1 / np.sqrt(np.diag(base.expansion.information))[:, np.newaxis]
    (one_sided,) = forward_differences(base.problem, base.point[:, np.newaxis], steps)
    (central,) = central_differences(base.problem, base.point[:, np.newaxis], steps)
    assert one_sided.evaluations < 0.6 * central.evaluations
    coarse, exact = (restricted(expansion, ~base.held) for expansion in (one_sided, central))
    scale = np.sqrt(np.outer(np.diag(exact.information), np.diag(exact.information)))
    assert np.abs((coarse.information - exact.information) / scale).max() < 2e-3
    assert np.abs((coarse.gradient - exact.gradient) / np.sqrt(np.diag(exact.information))).max() < 2e-2


class Parabola:
    """z = c^2 - 1 in a box, without a value for c > 1.5."""

    lower, upper = np.array([-2.0]), np.array([2.0])

    def terms(self, points: np.ndarray) -> Terms:
        z = np.where(points > 1.5, np.nan, points**2 - 1.0)
        return Terms(z, np.zeros(z.shape))


@pytest.mark.parametrize("at", [0.7, 1.5, -2.0])
def test_differences_stay_inside_the_box_and_look_back_where_the_model_fails(at: float) -> None:
    (expansion,) = forward_differences(Parabola(), np.array([[at]]), np.array([[1e-4]]))
    assert expansion.gradient[0] == pytest.approx((at**2 - 1.0) * 2.0 * at, rel=1e-4)


class Valley:
    """Rosenbrock's with z = (4 (1 - a), 80 (b - a^2)), narrow and curved, with its lowest point at (1, 1)."""

    lower, upper = np.array([-2.0, -2.0]), np.array([2.0, 4.0])
    noise_levels = np.array([False, False])
    narrow = 20.0

    def terms(self, points: np.ndarray) -> Terms:
        a, b = points
        z = 4.0 * np.array([1.0 - a, self.narrow * (b - a**2)])
        return Terms(z, np.zeros(z.shape))

    def expansion(self, point: np.ndarray) -> Expansion:
        z = self.terms(point[:, np.newaxis]).innovations
        slopes = 4.0 * np.array([[-1.0, 0.0], [-2.0 * self.narrow * point[0], self.narrow]])
        return expansion_of(np.hstack([z, slopes]), np.zeros((2, 3)), 1)


def test_a_step_that_leaves_a_curved_valley_is_led_back_into_it() -> None:
    valley = Valley()
    start = np.array([-1.0, 1.0])
    known = valley.expansion(start)
    found = Reached(start, known.sum, known, 0, SearchOutcome.CONVERGED, Formed(Scheme.LINEARISED, start))
    problem = cast(EstimationProblem, valley)
    longest = damped_step(problem, start, known, 1e-5)
    assert valley.terms(longest[:, np.newaxis]).sums()[0] > 10.0 * known.sum  # though it promises all
    ended = exact_newton._along_ridge(problem, found)
    assert found.nll - ended.nll > 20.0
    assert ended.evaluations == len(exact_newton._LONGER) * (1 + exact_newton._BACK)


def test_a_search_follows_a_curved_valley_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    valley = Valley()
    valley.narrow = 10.0
    monkeypatch.setattr(exact_newton, "exact_expansion", lambda problem, point, known: valley.expansion(point))
    start = np.array([-1.0, 1.0])
    known = valley.expansion(start)
    found = Reached(start, known.sum, known, 0, SearchOutcome.ITERATION_LIMIT, Formed(Scheme.LINEARISED, start))
    ended = exact_newton.polished(cast(EstimationProblem, valley), found, 0.1)
    assert ended.outcome is SearchOutcome.CONVERGED
    assert ended.nll < 0.1 and ended.point == pytest.approx([1.0, 1.0], abs=0.05)


def test_a_fit_finds_the_truth_within_its_deviation() -> None:
    base = fitted([pull(sled(), 2, c_guide=15.0)])
    assert base.outcome.succeeded
    assert base.values["c_guide"] == pytest.approx(15.0, abs=4.0 * base.std["c_guide"])
    assert base.values["std(speed)"] == pytest.approx(0.02, rel=0.15)


def test_what_rests_on_a_bound_counts_as_known() -> None:
    base = fitted([pull(sled(), 3)])
    assert base.held[base.problem.names.index("process(v_sled)")]  # the simulation has no process noise
    free = ~base.held
    own = standard_deviations(restricted(base.expansion, free))
    assert [base.std[name] for name, kept in zip(base.problem.names, free, strict=True) if kept] == own.tolist()


def test_a_fit_that_cannot_win_is_given_up() -> None:
    log = pull(sled(), 4, c_guide=16.0)
    base = fitted([log])
    problem = base.problem
    lost = fit(EstimationProblem(problem.filter_model, (log,), problem.free), beat=base.nll - 1e4)
    assert lost.evaluations < base.evaluations and not lost.outcome.succeeded
    assert fit(EstimationProblem(problem.filter_model, (log,), problem.free), beat=base.nll).nll == pytest.approx(
        base.nll, abs=0.1
    )


def test_starts_differ_in_their_noise_alone() -> None:
    free = (
        FreeParameter("c_guide", 2.0, 60.0, 12.0),
        FreeParameter("std(speed)", 1e-3, 10.0, 0.1, scale="log"),
        FreeParameter("process(v_sled)", 1e-3, 10.0, 0.01, scale="log"),
    )
    starts = np.array(noisy_starts(free))
    assert (starts[:, 0] == 12.0).all()
    assert starts[0].tolist() == [12.0, np.log(0.1), np.log(0.01)]
    assert len({tuple(row) for row in starts}) == len(starts)


def test_a_model_that_diverges_everywhere_is_told() -> None:
    log = pull(sled(), 5)
    base = fitted([log])
    y = np.where(np.arange(log.time.size) % 399 == 0, log.y, np.nan)  # nothing holds the filter in between
    slow = MatchedLog(log.name, 1000.0 * log.time, log.u, y)  # far too few substeps for such intervals
    with pytest.raises(EstimationError, match=r"sled: the model diverges at its declared parameters on run with 1 sub"):
        fit(EstimationProblem(base.problem.filter_model, (slow,), base.problem.free))


def test_a_quiet_start_has_little_process_noise_and_loud_sensors() -> None:
    free = (
        FreeParameter("c_guide", 2.0, 60.0, 12.0),
        FreeParameter("std(speed)", 1e-3, 10.0, 0.1, scale="log"),
        FreeParameter("process(v_sled)", 1e-3, 10.0, 0.01, scale="log"),
    )
    start = quiet_start(free, np.array([7.0, 0.0, 0.0]))
    assert start[0] == 7.0
    assert 0.1 < np.exp(start[1]) < 1.0 and 1e-3 < np.exp(start[2]) < 0.01
