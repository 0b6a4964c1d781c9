"""Faults of sensors are told from missing physics, and named with channel and kind."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.loop import LoopSettings, close_loop
from bondgraph.correct.result import result_json
from bondgraph.correct.round import one_round
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.editing import handle
from bondgraph.effects.sensors import SENSOR_FAULTS, sensor_bias
from bondgraph.errors import EstimationError
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from tests.correct.sled import FUNCTIONS, NOISE, pull, sled

FAULTS = {
    "bias": (lambda y, t: y + 0.15, 0.15),
    "scale": (lambda y, t: 1.15 * y, 0.15),  # beyond what a given mass may be off
    "drift": (lambda y, t: y + 0.004 * t, 0.004),
    "delay": (lambda y, t: np.interp(t - 0.2, t, y), 0.2),  # whole samples: half of one would average noise
}


def faulty(kind: str) -> list[MatchedLog]:
    """Logs of the declared sled whose speed sensor has a fault."""
    return [_with(pull(sled(), seed, name=f"run{seed}"), kind) for seed in (7, 107)]


def _with(log: MatchedLog, kind: str) -> MatchedLog:
    y: FloatArray = log.y.copy()
    y[0] = FAULTS[kind][0](y[0], log.time)
    return replace(log, y=y)


@pytest.mark.parametrize(
    "kind",
    ["bias", pytest.param("scale", marks=pytest.mark.slow), "drift", pytest.param("delay", marks=pytest.mark.slow)],
)
def test_a_fault_is_named_with_channel_kind_and_size(kind: str) -> None:
    closed = close_loop(sled(), faulty(kind), [], FUNCTIONS)
    assert closed.verdict == "sensor fault suspected"
    (effect,) = result_json(closed)["effects"]
    assert (effect["channel"], effect["kind"]) == ("speed", kind)
    ((name, found),) = effect["coefficients"].items()
    assert name.startswith(kind) and found["value"] == pytest.approx(FAULTS[kind][1], rel=0.15)


@pytest.mark.slow
def test_faults_alone_may_be_asked_for() -> None:
    """A command with --effects sensor_ceiling said that it finds no place, and that no effect could be tried."""
    closed = close_loop(sled(), faulty("scale"), [], SENSOR_FAULTS[:2])
    (found,) = closed.added
    assert found.trial.candidate.effect.name == "sensor_scale" and closed.rounds[0].untried == ""


def test_an_outlier_at_the_start_of_a_position_is_no_bias(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the position is from where it is counted; a filter too sure of its first value took 20 samples to leave it.

    A heavy-tailed height sensor of a vehicle was called biased: 49 nats, p = 1e-21.
    """
    monkeypatch.setitem(NOISE, "position", 0.05)
    graph = sled()
    graph.measure(
        "position", graph.integral("x_sled", handle(graph, "runner").flow, "m", "way of the sled"), "m", "way"
    )
    own = build(graph)
    log = pull(graph, 11)
    log.y[own.model.index("output", "position"), 0] += 7.4 * 0.05
    setup = filter_setup(own.model, own.driven, [log])
    base = fit(EstimationProblem(setup.filter_model, (log,), (*free_parameters(setup, ()), *setup.noise)))
    turn = one_round(own, base, [log], [sensor_bias, effects.quadratic_loss])
    gains = {trial.candidate.place.output: trial.score_gain for trial in turn.trials}
    assert gains["position"] < 3.0
    assert turn.chosen is None


@pytest.mark.slow
def test_a_loop_that_is_run_again_takes_its_finished_fits_and_ends_the_same(tmp_path: Path) -> None:
    logs, journal = faulty("bias"), Journal(tmp_path)
    first = close_loop(sled(), logs, [], FUNCTIONS, LoopSettings(journal=journal))
    (tmp_path / "fits.json").replace(tmp_path / "kept")
    (tmp_path / "kept").rename(tmp_path / "fits.json")
    stages: list[str] = []
    again = close_loop(sled(), logs, [], FUNCTIONS, LoopSettings(journal=journal), lambda s, d, t: stages.append(s))
    assert result_json(again) == result_json(first) and stages
    (tmp_path / "fits.json").write_text("{")
    with pytest.raises(EstimationError, match="the journal of fits cannot be read"):
        journal.start(resume=True)
    journal.start(resume=False)
    assert not journal.exists


@pytest.mark.slow
def test_faults_are_left_out_where_they_are_not_wanted() -> None:
    closed = close_loop(sled(), faulty("bias"), [], FUNCTIONS, LoopSettings(faults=False))
    assert not any(added.trial.candidate.effect.channel for added in closed.added)
    assert closed.verdict in ("effect found", "unexplained residual", "disturbance")
