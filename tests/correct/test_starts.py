"""Initial states that no sensor shows: estimated where a law is not smooth, else left to the filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.fits import starts
from bondgraph.correct.fits.starts import with_starts
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import copy, handle, with_values
from bondgraph.declare.effect import Place
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.local import fit
from bondgraph.estimate.noise_starts import noisy_starts
from bondgraph.estimate.objective import Expansion, SearchOutcome
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from vehicle_graphs.effect_study.cases import Case
from vehicle_graphs.effect_study.generate import Drawn, draw, settled
from vehicle_graphs.effect_study.machines import BENCH

PLAY = Case("effect", "backlash at twist", 3.0, 3)
STATE, START = "twist_shaft", "x0(twist_shaft, train_1)"


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    return draw(BENCH, PLAY)


def fitted(graph: BondGraph, log: MatchedLog) -> Fit:
    built = build(graph)
    setup = filter_setup(built.model, built.driven, [log])
    free = (*free_parameters(setup, ()), *setup.noise)
    return fit(EstimationProblem(setup.filter_model, (log,), tuple(free)), starts=noisy_starts(free))


@pytest.fixture(scope="module")
def with_play(drawn: Drawn) -> Fit:
    """The declared driveline with the true play in its half-shaft, everything else fitted."""
    graph = copy(BENCH.graph())
    effect = effects.backlash(graph, Place(handle(graph, "twist"), BENCH.scale))
    assert effect is not None
    (gap,) = effect.coefficients
    return fitted(with_values(graph, {gap: drawn.truth.values[PLAY.subject][gap]}), drawn.train[0])


def test_a_start_behind_play_is_found(with_play: Fit, drawn: Drawn) -> None:
    found, truth = with_starts(with_play), drawn.truth
    start = settled(BENCH, truth.model, drawn.train[0].u[:, 0], truth.on)[truth.model.index("state", STATE), 0]
    assert found.nll < with_play.nll - 30.0
    assert found.values[START] == pytest.approx(start, rel=0.05)
    stiffness = float(truth.on[truth.model.index("parameter", "k_shaft")])
    assert abs(found.values["k_shaft"] - stiffness) < 0.7 * abs(with_play.values["k_shaft"] - stiffness)


def test_logs_of_which_no_start_was_estimated_are_filtered_as_before(with_play: Fit, drawn: Drawn) -> None:
    found = with_starts(with_play)
    assert found.elsewhere.initial_std == with_play.problem.filter_model.initial_std
    (own,) = found.runs(drawn.train)
    assert own.nll < with_play.runs(drawn.train)[0].nll - 30.0
    (other,) = found.runs(drawn.holdout)
    assert other.predicted_cov[2, 2, 0] == pytest.approx(with_play.runs(drawn.holdout)[0].predicted_cov[2, 2, 0])


def test_other_logs_begin_where_the_fitted_ones_did(with_play: Fit) -> None:
    """Of a cell both runs began full, 4130 C below the declared charge: a third one was thought to be empty."""
    first = with_play.problem.logs[0]
    second, third = (replace(first, name=name) for name in ("again", "later"))
    own = [one for one in with_play.problem.free if one.target.kind == "parameter"]
    middle, std = 0.01, 0.05
    freed = [FreeParameter(f"x0({STATE}, {log.name})", -1.0, 1.0, middle, 0.0, std) for log in (first, second)]
    problem = EstimationProblem(with_play.problem.filter_model, (first, second), (*own, *freed))
    point = np.concatenate([with_play.point[: len(own)], [0.012, 0.008]])
    expansion = Expansion(np.zeros(point.size), np.diag(np.full(point.size, 1e12)), 0)
    found = Fit(problem, point, 0.0, expansion, 0, SearchOutcome.CONVERGED)
    mean, spread = found.begun[STATE]
    assert (mean, spread) == pytest.approx((0.01, np.std([0.012, 0.008], ddof=1) * np.sqrt(1.5)))
    (run,) = found.runs([third])
    row = run.filter_model.model.index("state", STATE)
    assert run.filter_model.initial_std[STATE] == pytest.approx(spread)
    assert run.predicted_mean[row, 0] == pytest.approx(0.01)


@pytest.mark.parametrize("doubted", [1e-3, 2.0], ids=["as it is", "doubted"])
def test_where_an_update_is_exact_the_filter_keeps_the_start(doubted: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(starts, "_DOUBTED", doubted)
    plain = fitted(BENCH.graph(), draw(BENCH, Case("none", "other parameters", 0.0, 1)).train[0])
    assert with_starts(plain) is plain
