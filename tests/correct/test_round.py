"""Settings of rounds."""

from __future__ import annotations

import pytest

from bondgraph.correct.round import RoundSettings


def test_the_levels_of_all_rounds_together_stay_bounded() -> None:
    settings = RoundSettings(level=0.01)
    levels = [settings.beside(laws).level for laws in range(1000)]
    assert levels[0] == 0.01
    assert levels == sorted(levels, reverse=True)
    assert sum(levels) < 0.0165


def test_a_round_beside_laws_keeps_everything_but_its_level() -> None:
    settings = RoundSettings(level=0.02, refits=7, substeps=3)
    beside = settings.beside(1)
    assert beside.level == pytest.approx(0.005)
    assert (beside.refits, beside.substeps, beside.journal) == (7, 3, settings.journal)
