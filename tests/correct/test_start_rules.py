"""``--start`` of a loop: every fit of it begins by the rule that was asked for, and finds what there is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph as bg
from bondgraph import effects
from bondgraph.cli import main
from bondgraph.correct.loop import ClosedLoop, LoopSettings, close_loop
from bondgraph.estimate import problem as problems
from bondgraph.estimate.initial import InitialRule, initial_states
from tests.correct.windy_cart import cart, log, write


def closed(rule: InitialRule, first: float = 0.0) -> ClosedLoop:
    offered = (effects.quadratic_loss, effects.actuator_lag)
    return close_loop(
        cart(), [log(first)], [log(0.0)], offered, LoopSettings(max_effects=1, faults=False, initial=rule)
    )


@pytest.mark.parametrize("rule", ["model", "settled"])
def test_every_fit_of_a_loop_begins_by_the_rule(rule: InitialRule, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fits on the way of a loop took the measured start whatever the fit before them had."""
    rules = set()

    def noted(model: bg.Model, logs: Any, theta: Any, asked: Any, *more: Any) -> list[np.ndarray]:
        rules.add(asked)
        return initial_states(model, logs, theta, asked, *more)

    monkeypatch.setattr(problems, "initial_states", noted)
    found = closed(rule)
    assert rules == {rule} and found.corrected.problem.initial == rule
    assert found.verdict == "effect found" and [one.trial.candidate.effect.name for one in found.added] == [
        "quadratic_loss"
    ]
    assert not found.corrected_built.model.starts  # the rule says where it starts, and no signal of a log


@pytest.mark.slow
def test_declared_starts_do_not_move_with_the_first_reading() -> None:
    declared, measured = (closed(rule, first=0.5) for rule in ("model", "measured"))
    assert declared.corrected.problem.initial_states[0][0] == 3.0
    assert measured.corrected.problem.initial_states[0][0] == pytest.approx(3.5, abs=0.1)


def test_the_command_takes_the_rule(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    graph, data = write(tmp_path)
    command = ["close-loop", str(graph), "--data", str(data), "--effects", "quadratic_loss", "--no-faults"]
    assert main([*command, "--start", "model", "--max-effects", "1", "--out", str(tmp_path / "loop")]) == 0
    assert "effect found" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main([*command, "--start", "v=3"])
    assert "invalid choice: 'v=3'" in capsys.readouterr().err
