"""Fate of the effects that rounds chose, as the table of what was tried says it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.progress import Decision
from bondgraph.report.tried import tried

LABEL = "series_resistance at wire"


@pytest.mark.parametrize(("actions", "event", "words"), [
    (("event",), True, "an event: it acts from 4240 s of run1, and time is no law"),
    (("event", "dropped"), False, "taken for an event, taken out again later"),
    (("added", "withdrawn"), False, "added, taken out again later"),
    (("added", "simplified"), False, "a simpler law took its place"),
    ((), False, "it passes the tests, but a disturbance explains more"),
])  # fmt: skip
def test_what_was_chosen_and_is_not_declared_is_said_to_be_what_it_is(
    actions: tuple[str, ...], event: bool, words: str
) -> None:
    """An event that stood in the verdict was "added, taken out again later" in the table below."""
    effect = SimpleNamespace(described="series_resistance")
    candidate = SimpleNamespace(label=LABEL, effect=effect, place=SimpleNamespace(label="wire"))
    chosen = SimpleNamespace(candidate=candidate, gain=1823.0, gate="from 4240 s of run1")
    loop = SimpleNamespace(
        added=(), rounds=(SimpleNamespace(chosen=chosen, alternatives=()),),
        events=(SimpleNamespace(trial=chosen),) if event else (),
        history=tuple(Decision(1, action, LABEL, "") for action in actions),
    )  # fmt: skip
    (row,) = tried(cast(ClosedLoop, loop))
    assert words in row.why and not row.chosen
