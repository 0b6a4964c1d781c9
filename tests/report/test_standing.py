"""Answers of held-out logs in sentences: what they confirm, and what stays unexplained beside it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bondgraph.correct.confirmation import Confirmation
from bondgraph.correct.fits.assess import ScaledGain
from bondgraph.report.standing import driven_at_random, held_out


def disturbance(channel: str, size: float) -> Any:
    """A disturbance of the machine, or of a sensor, which is declared in bar."""
    return SimpleNamespace(size=size, trial=SimpleNamespace(candidate=SimpleNamespace(
        effect=SimpleNamespace(channel=channel)
    )))  # fmt: skip


def corrected() -> Any:
    info = SimpleNamespace(shown=lambda value: 1e-5 * value)
    model = SimpleNamespace(outputs=[info], index=lambda kind, name: 0)
    return SimpleNamespace(driven=0.0, problem=SimpleNamespace(filter_model=SimpleNamespace(model=model)))


def answer(simulated: float, *, disturbed: Any = None, before: float = 9.0, laws: ScaledGain | None = None) -> str:
    """The sentences on a correction with such an error of free simulation, for a sensor with a noise of one."""

    def channels(error: float) -> Any:
        return SimpleNamespace(channels={"level": SimpleNamespace(simulation_rmse=error, noise_std=1.0)})

    closed: Any = SimpleNamespace(
        added=("law",), disturbances=() if disturbed is None else (disturbed,), verdict="effect found",
        nominal_holdout=channels(before), corrected_holdout=channels(simulated),
        corrected=corrected(),
    )  # fmt: skip
    return held_out(closed, Confirmation(200.0, 10.0, 5.0, (), 1.0, laws))


@pytest.mark.parametrize(("simulated", "told"), [(1.1, False), (1.9, False), (6.2, True), (float("inf"), False)])
def test_a_confirmed_correction_is_said_to_leave_what_it_leaves(simulated: float, told: bool) -> None:
    """A lag was confirmed in place of a play; free simulation stayed at six times the noise, and nothing said so."""
    said = answer(simulated)
    assert said.startswith("The held-out logs confirm the correction")
    assert ("above the noise of level (6.20 times) there: not everything is explained." in said) == told


def test_a_confirmed_disturbance_is_said_to_leave_room_for_a_law() -> None:
    """Melting plates were a confirmed disturbance at fifteen times the noise, without a word of doubt."""
    wind = disturbance("", 3.0)
    said = answer(6.2, disturbed=wind)
    assert "Free simulation stays far from level there: what drives the machine at random may hide a law." in said
    assert "may hide" not in answer(1.9, disturbed=wind)


@pytest.mark.parametrize(("simulated", "driven", "told"), [(4.0, 60.0, True), (1.9, 60.0, False), (4.0, 0.0, False)])
def test_noise_that_bridges_what_simulation_leaves_is_told_where_nothing_was_found(
    simulated: float, driven: float, told: bool
) -> None:
    """A motor that cogs ended with "no missing effect", and its simulation at four times the noise without a word."""
    channels = {"pan": SimpleNamespace(simulation_rmse=simulated, noise_std=1.0)}
    fitted = SimpleNamespace(driven=driven)
    closed: Any = SimpleNamespace(
        added=(), disturbances=(), constants=(), corrected=fitted, corrected_train=SimpleNamespace(channels=channels)
    )
    said = " ".join(driven_at_random(closed))
    assert ("stays above the noise of pan (4.00 times), and process noise makes good for that" in said) == told
    closed.added = ("law",)
    assert driven_at_random(closed) == []


def test_a_simulation_that_gets_worse_is_said_first() -> None:
    assert "above the noise" not in answer(6.2, before=5.0) and "worse there in level (+24 %)" in answer(
        6.2, before=5.0
    )


@pytest.mark.parametrize(("simulated", "far"), [(6.2, False), (12.0, True)])
def test_noise_of_a_sensor_that_has_a_memory_is_noise(simulated: float, far: bool) -> None:
    """A pressure whose noise has a memory, as the same answer said, was "far" from its simulation."""
    said = answer(simulated, disturbed=disturbance("level", 5e-5), before=20.0)  # 5 in the coherent unit
    assert ("stays far from level" in said) == far


def test_what_laws_gain_beside_a_disturbance_comes_first() -> None:
    """Two thousand nats stood first, of which the laws gained 32 beside noise with a memory."""
    said = answer(1.1, disturbed=disturbance("level", 5e-5), laws=ScaledGain(31.6, 33.2, 1.0))
    assert said.startswith(
        "The held-out logs neither confirm nor contradict the correction: the laws change the log-likelihood of the "
        "held-out logs by 31.6 ± 33.2 nats beside the disturbance, which is in both models then; together with it they "
        "change it by 200 ± 10.0 nats"
    )


def test_laws_beside_a_disturbance_that_gains_nothing_are_told_once() -> None:
    """ "... by 1522 ± 46.9 nats beside the disturbance; together with it they change it by 1522 ± 46.9 nats"."""
    said = answer(1.1, disturbed=disturbance("level", 5e-5), laws=ScaledGain(200.0, 10.0, 1.0))
    assert said.count("200 ± 10.0 nats") == 1 and "the disturbance adds nothing" in said
