"""Answers of held-out logs in sentences: what they confirm, and what stays unexplained beside it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bondgraph.correct.confirmation import Confirmation
from bondgraph.report.standing import held_out


def answer(simulated: float, *, disturbed: bool = False, before: float = 9.0) -> str:
    """The sentences on a correction with such an error of free simulation, for a sensor with a noise of one."""

    def channels(error: float) -> Any:
        return SimpleNamespace(channels={"level": SimpleNamespace(simulation_rmse=error, noise_std=1.0)})

    closed: Any = SimpleNamespace(
        added=("law",), disturbances=("wind",) if disturbed else (), verdict="effect found",
        nominal_holdout=channels(before), corrected_holdout=channels(simulated),
        corrected=SimpleNamespace(driven=0.0),
    )  # fmt: skip
    return held_out(closed, Confirmation(200.0, 10.0, 5.0, (), 1.0))


@pytest.mark.parametrize(("simulated", "told"), [(1.1, False), (1.9, False), (6.2, True), (float("inf"), False)])
def test_a_confirmed_correction_is_said_to_leave_what_it_leaves(simulated: float, told: bool) -> None:
    """A lag was confirmed in place of a play; free simulation stayed at six times the noise, and nothing said so."""
    said = answer(simulated)
    assert said.startswith("The held-out logs confirm the correction")
    assert ("above the noise of level (6.20 times) there: not everything is explained." in said) == told


def test_a_confirmed_disturbance_is_said_to_leave_room_for_a_law() -> None:
    """Melting plates were a confirmed disturbance at fifteen times the noise, without a word of doubt."""
    said = answer(6.2, disturbed=True)
    assert "Free simulation stays far from level there: what drives the machine at random may hide a law." in said
    assert "may hide" not in answer(1.9, disturbed=True)


def test_a_simulation_that_gets_worse_is_said_first() -> None:
    assert "above the noise" not in answer(6.2, before=5.0) and "worse there in level (+24 %)" in answer(
        6.2, before=5.0
    )
