"""The nearest explanation is told where nothing is believed, with the reason against it, and nowhere else."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from bondgraph.correct.evidence.trials import Alternative, Evidence
from bondgraph.report.closed_loop import _nearest


def closed(verdict: str, *gains: float, why: str = "its innovations stay coloured") -> Any:
    """A loop in whose last round trials gained so many nats, each less a penalty of five."""
    trials, others = [], []
    for k, gain in enumerate(gains):
        candidate = SimpleNamespace(
            effect=SimpleNamespace(described=f"law{k}"), place=SimpleNamespace(label="shaft"), label=f"law{k} at shaft"
        )
        trials.append(SimpleNamespace(candidate=candidate, gain=gain, evidence=Evidence(gain, 0.0, 0.0, gain - 5.0, 9)))
        others.append(Alternative(f"law{k}", "shaft", gain, False, why))
    unrefitted = SimpleNamespace(evidence=None, gain=1e9)
    turn = SimpleNamespace(trials=[*trials, unrefitted], alternatives=others)
    return SimpleNamespace(verdict=verdict, added=(), events=(), rounds=[turn])


def test_the_largest_gain_is_named_with_what_is_against_it() -> None:
    """Of a late thermometer 2911 nats were refused without a word, and its residual was called unknown."""
    (said,) = _nearest(closed("unexplained residual", 61.0, 2911.0))
    assert said == "Nearest comes law1 at shaft (2911 nats): its innovations stay coloured."


def test_nothing_is_named_where_something_is_believed_or_nothing_is_worth_its_penalty() -> None:
    assert _nearest(closed("no missing effect", 2911.0)) == []
    assert _nearest(closed("unexplained residual", 4.0)) == []
    assert _nearest(closed("unexplained residual", 40.0, why="")) == []
