"""Inputs that a log shows as constant in pieces: held between samples, or straight lines, whichever is likelier."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import bondgraph as bg
from bondgraph import effects
from bondgraph.correct.declared_fit import fit_declared
from bondgraph.correct.loop import LoopSettings, close_loop, no_report
from bondgraph.data.log import MatchedLog

_MASS, _DRAG, _NOISE = 20.0, 8.0, 0.002


def _cart() -> bg.BondGraph:
    g = bg.BondGraph("cart")
    force = g.input("force", "N")
    body = g.one_junction("body", bg.TRANSLATION)
    g.effort_source("motor", force, at=body)
    g.inertance("mass", g.parameter("m", 25.0, "kg", "", (5.0, 100.0)), at=body, state="v")
    g.resistance("drag", g.parameter("d", 6.0, "N s/m", "", (0.5, 50.0)), at=body)
    g.measure_flow("speed", body)
    return g


def _log(held: bool, seed: int, samples: int = 8) -> MatchedLog:
    """A cart behind a force that is held, or straight, between samples 0.1 s apart.

    It has a new level after so many ``samples``.
    """
    chance = np.random.default_rng(seed)
    return _driven(held, np.repeat(chance.uniform(-30.0, 30.0, 800 // samples), samples), chance)


def _driven(held: bool, force: np.ndarray, chance: np.random.Generator) -> MatchedLog:
    """The cart behind a force (n,), by the exact discrete system."""
    system = tuple(np.array([[one]]) for one in (-_DRAG / _MASS, 1.0 / _MASS, 1.0, 0.0))
    a, b, c, d, _ = cont2discrete(system, 0.1, "zoh" if held else "foh")
    speed = lfilter([float(d[0, 0]), float((c @ b - a * d)[0, 0])], [1.0, -float(a[0, 0])], force)
    speed += _NOISE * chance.standard_normal(speed.size)
    return MatchedLog("run", 0.1 * np.arange(speed.size), force[np.newaxis], speed[np.newaxis])


@pytest.mark.parametrize("held", [True, False])
def test_the_likelier_way_between_samples_is_taken_and_no_lag_found(held: bool) -> None:
    closed = close_loop(_cart(), [_log(held, 3)], [], [effects.actuator_lag], LoopSettings())
    assert closed.verdict == "no missing effect"
    said = [text for text in closed.cautions if "held between samples" in text]
    assert bool(said) == held
    (info,) = closed.nominal_built.model.inputs
    assert info.interpolation == ("hold" if held else "linear")
    assert abs(closed.nominal.values["m"] - _MASS) < 4.0 * closed.nominal.std["m"]


def test_an_input_that_moves_at_every_sample_is_held_where_a_delay_does_no_more() -> None:
    """Half a sample of a torque that changed every 4 ms was an actuator's delay, and then a mass on a spring."""
    closed = close_loop(_cart(), [_log(True, 5, samples=1)], [], [effects.actuator_delay], LoopSettings())
    assert closed.verdict == "no missing effect"
    (said,) = [text for text in closed.cautions if "held between samples" in text]
    assert said.startswith("force is taken as held") and "pieces" not in said
    assert closed.held == ("force",)
    assert abs(closed.nominal.values["m"] - _MASS) < 4.0 * closed.nominal.std["m"]


def test_an_input_that_moves_at_every_sample_stays_straight_where_it_is() -> None:
    closed = close_loop(_cart(), [_log(False, 5, samples=1)], [], [effects.actuator_delay], LoopSettings())
    assert closed.verdict == "no missing effect" and not closed.held and not closed.limited


def _multisine(seed: int) -> MatchedLog:
    """The cart behind a force of sines up to a third of the sampling rate, of which each has its exact answer."""
    chance, time = np.random.default_rng(seed), 0.1 * np.arange(800)
    force, speed = np.zeros(800), _NOISE * chance.standard_normal(800)
    for hertz, phase in zip(np.linspace(0.2, 3.3, 24), chance.uniform(0.0, 2.0 * np.pi, 24), strict=True):
        wave = 8.0 * np.exp(1j * (2.0 * np.pi * hertz * time + phase))
        force += wave.real
        speed += (wave / (_DRAG + 2j * np.pi * hertz * _MASS)).real
    return MatchedLog("run", time, force[np.newaxis], speed[np.newaxis])


def test_a_quick_input_that_a_filter_has_passed_is_band_limited() -> None:
    """Silverbox, declared with a straight force, had a spring of 3.1 N/m^3 where 3.9 was right, and then two more laws.

    The pieces in which a band-limited input is integrated miss 0.3 % of a quick sine.
    """
    log = _multisine(7)
    closed = close_loop(_cart(), [log], [], [effects.actuator_lag, effects.actuator_delay], LoopSettings())
    assert closed.verdict == "no missing effect"
    assert (closed.held, closed.limited) == ((), ("force",))
    (said,) = [text for text in closed.cautions if "band limited between samples" in text]
    assert "between='band limited'" in said
    assert closed.nominal.values["m"] == pytest.approx(_MASS, rel=3e-3)
    straight = close_loop(_cart(), [log], [], [effects.actuator_lag], LoopSettings(inputs_as_declared=True))
    assert straight.nominal.nll > closed.nominal.nll + 100.0


@pytest.mark.slow
def test_a_quick_input_that_is_held_is_not_left_band_limited() -> None:
    """Of a drive whose torque a controller gave every 4 ms band limited was 8 nats likelier than straight, held 3614.

    That was asked no more: half a sample was a lag of the motor, and what it left a mass that friction drags along.
    """
    chance, time = np.random.default_rng(2), 0.1 * np.arange(800)
    phases = chance.uniform(0.0, 2.0 * np.pi, 24)
    force = 8.0 * np.cos(2.0 * np.pi * np.linspace(0.2, 1.0, 24)[:, np.newaxis] * time + phases[:, np.newaxis]).sum(
        axis=0
    )
    log = _driven(True, force, chance)
    begun = fit_declared(_cart(), [log], [], LoopSettings(), no_report)
    assert begun.running("band limited") == ("force",) and [one.way for one in begun.straight] == ["hold"]
    closed = close_loop(_cart(), [log], [], [effects.actuator_lag, effects.dragged_mass], LoopSettings())
    assert closed.verdict == "no missing effect" and (closed.held, closed.limited) == (("force",), ())
    assert any("likelier than band limited" in one for one in closed.cautions)


def test_inputs_stay_as_declared_where_that_is_asked_for() -> None:
    settings = LoopSettings(max_effects=0, inputs_as_declared=True)
    closed = close_loop(_cart(), [_log(True, 3)], [], [effects.actuator_lag], settings)
    assert closed.nominal_built.model.inputs[0].interpolation == "linear"


def test_an_input_that_always_moves_is_left_as_it_is() -> None:
    log = _log(True, 4)
    wave = 10.0 * np.sin(0.7 * log.time)[np.newaxis]
    settings = LoopSettings(max_effects=0)
    closed = close_loop(_cart(), [MatchedLog("run", log.time, wave, log.y)], [], [effects.actuator_lag], settings)
    assert closed.nominal_built.model.inputs[0].interpolation == "linear"


def test_lines_of_a_correction_hold_what_the_loop_took_as_held() -> None:
    declared = _cart()
    for log, way in ((_log(True, 3), "hold"), (_multisine(7), "band limited")):
        closed = bg.close_loop(declared, [log], [], [effects.actuator_lag], LoopSettings(max_effects=0))
        assert {"hold": closed.held, "band limited": closed.limited}[way] == ("force",)
        names = {"g": declared}
        exec(closed.python_lines(), names)
        assert names["g"] == closed.graph
        assert names["g"].inputs[0].interpolation == way
