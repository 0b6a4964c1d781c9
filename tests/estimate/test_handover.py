"""What a swarm searches before it hands over, and where the gradient searches start."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.estimate import handover
from bondgraph.estimate.derivatives.exact import filtering_work
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.handover import (
    explored,
    exploring_swarm,
    swarm_settings,
    swarm_starts,
    whole_points,
    without_noise_levels,
)
from bondgraph.estimate.noise_starts import noisiest_start
from bondgraph.estimate.objective import TraceRow
from bondgraph.estimate.problem import EstimationProblem, pose
from tests.estimate.linear import ExactLikelihood, lag, simulated

TRUTH = {"mass": 2.6, "drag": 2.2, "process": 0.15, "speed": 0.08}
LEVEL = FreeParameter("std(speed)", 1e-3, 1.0, 0.2, scale="log")
FREE = ["mass", LEVEL, "drag", "process(v)"]


def problem(free: list | None = None) -> EstimationProblem:
    logs = [simulated("run1", 0, TRUTH), simulated("run2", 100, TRUTH, x0=1.0, load=1.5)]
    return pose(lag(), logs, free or FREE, likelihood=ExactLikelihood())


def test_the_swarm_sees_the_likelihood_of_the_whole_at_the_starts_of_the_noises() -> None:
    whole = problem()
    part = without_noise_levels(whole)
    assert part.names == ("mass", "drag")
    points = np.array([[2.0, 3.0, 4.0], [1.0, 2.0, 5.0]])
    wide = whole_points(whole, part, points)
    np.testing.assert_array_equal(wide[[0, 2]], points)
    np.testing.assert_array_equal(wide[[1, 3]], np.repeat(whole.start[[1, 3], np.newaxis], 3, axis=1))
    np.testing.assert_allclose(part.nll(points), whole.nll(wide), rtol=1e-14)


def test_noises_alone_are_searched_themselves() -> None:
    only = problem([LEVEL, "process(v)"])
    assert without_noise_levels(only) is only
    none = problem(["mass", "drag"])
    assert without_noise_levels(none) is none


@pytest.mark.parametrize(("free", "members"), [(1, 16), (4, 32), (8, 48), (13, 64), (40, 64)])
def test_a_swarm_grows_with_its_coordinates(free: int, members: int) -> None:
    states = [FreeParameter(f"x0(v, run{k})", -9.0, 9.0, 0.0) for k in range(free)]
    logs = [simulated(f"run{k}", k, TRUTH) for k in range(free)]
    many = pose(lag(), logs, states, likelihood=ExactLikelihood())
    short, alone = swarm_settings(many, alone=False), swarm_settings(many, alone=True)
    assert short.members == alone.members == members
    assert short.iterations < alone.iterations


def test_the_declared_start_is_among_several() -> None:
    whole = problem()
    points = whole_points(whole, without_noise_levels(whole), np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]))
    starts = swarm_starts(whole, points, np.array([3.0, 1.0, 2.0]), 3)
    np.testing.assert_array_equal(starts, np.stack([points[:, 1], points[:, 2], whole.start], axis=1))
    np.testing.assert_array_equal(swarm_starts(whole, points, np.array([3.0, 1.0, 2.0]), 1), points[:, [1]])
    assert not swarm_starts(whole, points, np.full(3, np.inf), 3).size


def test_of_four_searches_one_begins_with_much_noise() -> None:
    whole = problem()
    points = whole_points(whole, without_noise_levels(whole), np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]))
    starts = swarm_starts(whole, points, np.array([3.0, 1.0, 2.0]), 4)
    noisy = noisiest_start(whole.free)
    np.testing.assert_array_equal(starts, np.stack([points[:, 1], points[:, 2], whole.start, noisy], axis=1))
    assert (noisy[[1, 3]] > whole.start[[1, 3]]).all() and (noisy <= whole.upper).all()
    np.testing.assert_array_equal(noisy[[0, 2]], whole.start[[0, 2]])
    quiet = problem(["mass", "drag"])  # no level is free
    assert swarm_starts(quiet, points[[0, 2]], np.array([3.0, 1.0, 2.0]), 4).shape[1] == 4


def test_a_swarm_over_long_logs_searches_how_they_begin_and_the_end_sees_all(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = problem(["mass", "drag", "std(speed)"])
    assert explored(whole, lambda part: exploring_swarm(part, 0), alone=False)[0].logs is whole.logs
    monkeypatch.setattr(handover, "_LEAST_SAMPLES", 20)
    monkeypatch.setattr(handover, "_WORK", 0.5 * filtering_work(whole) * 16 * 21)
    part, search = explored(whole, lambda part: exploring_swarm(part, 0), alone=False)
    assert search.most_evaluations == 16 * 21
    assert [len(log) for log in part.logs] == [30, 30]
    np.testing.assert_array_equal(part.logs[1].y, whole.logs[1].y[:, :30])
    rows: list[TraceRow] = []
    fit = estimate(whole, Settings(), progress=rows.append)
    assert rows[0].stage == "swarm on the beginnings of the logs"
    reference = estimate(whole, Settings(method="gradient", starts=1))
    assert fit.nll == pytest.approx(reference.nll, abs=1e-6)
    assert explored(whole, lambda part: exploring_swarm(part, 0), alone=True)[0] is whole

    def stop(row: TraceRow) -> None:
        if row.iteration == 2:
            raise KeyboardInterrupt

    early = estimate(whole, Settings(), progress=stop)
    assert early.nll == pytest.approx(float(whole.nll(early.point[:, np.newaxis])[0]), rel=1e-12)


def test_every_row_of_progress_has_all_coordinates_and_counts_on() -> None:
    rows: list[TraceRow] = []
    fit = estimate(problem(), Settings(), progress=rows.append)
    assert list(dict.fromkeys(row.stage for row in rows)) == ["swarm", "gauss-newton", "uncertainty", "certification"]
    assert {len(row.point) for row in rows} == {4}
    counts = [row.evaluations for row in rows]
    assert counts == sorted(counts) and fit.evaluations >= counts[-1]
    searched = [row for row in rows if row.stage in ("swarm", "gauss-newton")]
    assert fit.trace == tuple(searched)
    np.testing.assert_allclose(problem().nll(np.array(rows[0].point)[:, np.newaxis]), rows[0].nll, rtol=1e-12)
