"""Loops that are granted a time: they end where they stand, with what was found by then."""

from __future__ import annotations

import pytest

from bondgraph import effects
from bondgraph.correct import granted
from bondgraph.correct.granted import Clock, strictly
from bondgraph.correct.loop import LoopSettings, close_loop
from bondgraph.declare.effect import effect_functions
from bondgraph.errors import EstimationError
from bondgraph.estimate.local import no_report
from tests.correct import partly


class _Time:
    """A clock that stands still until it is told to jump."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        """The time that it shows [s]."""
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> _Time:
    shown = _Time()
    monkeypatch.setattr(granted, "time", shown)
    return shown


def test_a_clock_stops_strict_work_only_when_its_time_is_over(clock: _Time) -> None:
    told: list[tuple[str, int, int]] = []
    own = Clock(lambda *stage: told.append(stage), 2.0, clock.now)
    strictly(own)("refit", 1, 3)
    clock.now = 119.0
    strictly(own)("refit", 2, 3)
    clock.now = 120.0
    own("assess", 0, 1)
    with pytest.raises(EstimationError, match="the 2 minutes that were granted are spent - grant more"):
        strictly(own)("refit", 3, 3)
    assert told == [("refit", 1, 3), ("refit", 2, 3), ("assess", 0, 1)]
    assert strictly(no_report) is no_report


def test_a_loop_without_time_for_a_round_says_so() -> None:
    logs = [partly.driven(seed) for seed in (1, 9)]
    with pytest.raises(EstimationError, match="the 0 minutes that were granted are spent - grant more"):
        close_loop(partly.drive(), logs[:1], logs[1:], effect_functions(effects), LoopSettings(minutes=0.0))


@pytest.mark.slow
def test_a_loop_ends_with_what_was_found_when_its_time_is_over(clock: _Time) -> None:
    """It was killed after nine minutes without an answer, with the right law at hand."""

    def jump(stage: str, done: int, total: int) -> None:
        if stage.endswith("add the effect and estimate again") and done == total:
            clock.now = 301.0

    logs = [partly.driven(seed) for seed in (1, 9)]
    settings = LoopSettings(minutes=5.0)
    closed = close_loop(partly.drive(), logs[:1], logs[1:], effect_functions(effects), settings, jump)
    assert [one.trial.candidate.effect.name for one in closed.added] == ["viscous_loss"]
    assert "the 5 minutes that were granted are spent" in closed.reason
    assert closed.verdict == "effect found" and len(closed.rounds) == 1
