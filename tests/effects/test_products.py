"""Laws that are products of two signals: windings that a speed couples, a battery behind a bridge; truths by scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.arrays import FloatArray
from bondgraph.correct.places.probes import Signal
from bondgraph.correct.shapes.library import products
from tests.effects.machines.machine import steps

STEP, SAMPLES, NOISE = 0.002, 900, 0.1
INDUCTANCE, RESISTANCE, PAIRS = 2e-3, 0.4, 4.0


def windings() -> bg.BondGraph:
    """Two axes of a motor on a dynamometer, each a winding of its own."""
    g = bg.BondGraph("windings")
    speed = g.input("speed", "rad/s")
    resistance = g.parameter("R", 0.35, "ohm", "winding", (0.1, 1.5))
    flux = g.parameter("psi", 0.07, "V s/rad", "flux of the magnets", (0.02, 0.2))
    for axis in ("d", "q"):
        at = g.one_junction(f"{axis}_axis", bg.ELECTRICAL)
        g.effort_source(f"inverter_{axis}", g.input(f"v_{axis}", "V"), at=at)
        g.resistance(f"copper_{axis}", lambda i: resistance * i, at=at)
        g.inertance(f"coil_{axis}", g.parameter(f"L_{axis}", INDUCTANCE, "H"), at=at, state=f"i_{axis}")
        g.measure_flow(f"current_{axis}", at, unit="A")
        if axis == "q":
            g.effort_source("induced", -PAIRS * flux * speed, at=at)
    return g


def windings_log(seed: int, coupled: bool) -> bg.MatchedLog:
    """The axes turn into each other with the speed: d takes pairs*w*L*i_q, q gives pairs*w*L*i_d."""
    chance = np.random.default_rng(seed)
    time: FloatArray = STEP * np.arange(SAMPLES, dtype=np.float64)
    u = np.array([steps(time, chance, -35.0, 35.0, 0.3), *(steps(time, chance, -5.0, 5.0, 0.1) for _ in "dq")])

    def rates(t: float, x: FloatArray) -> list[float]:
        speed, v_d, v_q = (float(np.interp(t, time, row)) for row in u)
        turn = PAIRS * speed * INDUCTANCE * coupled
        v_d, v_q = v_d - RESISTANCE * x[0] + turn * x[1], v_q - RESISTANCE * x[1] - turn * x[0]
        return [v_d / INDUCTANCE, (v_q - PAIRS * 0.08 * speed) / INDUCTANCE]

    run = solve_ivp(rates, (0.0, time[-1]), [0.0, 0.0], t_eval=time, rtol=1e-7, atol=1e-8, max_step=STEP)
    return bg.MatchedLog(f"run{seed}", time, u, run.y + NOISE * chance.standard_normal(run.y.shape))


@pytest.mark.slow
def test_windings_that_their_speed_couples() -> None:
    """Each of two products is right only beside the other, and neither is a function of one signal.

    The first made the other axis 2 % worse by predictions left out, and was refused for it; with one declared and one
    missing no formula was tried at all.
    """
    closed = bg.close_loop(windings(), [windings_log(seed, True) for seed in (1, 2)], [windings_log(3, True)])
    assert closed.verdict == "effect found" and not closed.disturbances
    laws = {one.trial.candidate.label: one for one in closed.added}
    expected = PAIRS * INDUCTANCE
    for own, other, sign in (("d", "q", -1.0), ("q", "d", 1.0)):
        name = f"formula_product_of_flow_of_{other}_axis_and_speed"
        assert f"{name} at {own}_axis" in laws
        value = closed.corrected.values[f"c_{name.removeprefix('formula_')}_{own}_axis"]
        assert value == pytest.approx(sign * expected, rel=0.01)
    assert len(laws) == 2


@pytest.mark.slow
def test_windings_that_nothing_couples() -> None:
    closed = bg.close_loop(windings(), [windings_log(seed, False) for seed in (4, 5)], [])
    assert closed.verdict == "no missing effect" and not closed.added


def bridge() -> bg.BondGraph:
    """A motor behind a bridge that chops a stiff supply."""
    g = bg.BondGraph("bridge")
    duty = g.input("duty", "1")
    armature, shaft = g.one_junction("armature", bg.ELECTRICAL), g.one_junction("shaft", bg.ROTATION)
    g.effort_source("bridge", g.parameter("supply", 24.0, "V") * duty, at=armature)
    g.resistance("copper", g.parameter("R", 0.6, "ohm", "winding", (0.2, 2.0)), at=armature)
    g.inertance("coil", g.parameter("L", 0.01, "H"), at=armature, state="i")
    g.gyrator("motor", g.parameter("K", 0.06, "V s/rad", "constant", (0.03, 0.12)), armature, shaft)
    g.inertance("rotor", g.parameter("J", 4e-4, "kg m^2"), at=shaft, state="w")
    g.resistance("paddle", g.parameter("b", 2e-3, "N m s/rad", "paddle", (5e-4, 8e-3)), at=shaft)
    g.measure_flow("current", armature, unit="A")
    g.measure_flow("speed", shaft, unit="rad/s")
    return g


def bridge_log(seed: int, inner: float) -> bg.MatchedLog:
    """The supply has an inner resistance, through which it gives the chopped current: duty*(24 - inner*duty*i)."""
    chance = np.random.default_rng(seed)
    time: FloatArray = 0.01 * np.arange(700, dtype=np.float64)
    u = steps(time, chance, -0.95, 0.95, 0.25)

    def rates(t: float, x: FloatArray) -> list[float]:
        duty = float(np.interp(t, time, u))
        given = duty * (24.0 - inner * duty * x[0])
        return [(given - 0.7 * x[0] - 0.055 * x[1]) / 0.01, (0.055 * x[0] - 2.2e-3 * x[1]) / 4e-4]

    run = solve_ivp(rates, (0.0, time[-1]), [0.0, 0.0], t_eval=time, rtol=1e-7, atol=1e-8, max_step=0.01)
    return bg.MatchedLog(
        f"run{seed}", time, u[np.newaxis], run.y + np.array([[0.08], [0.6]]) * chance.standard_normal(run.y.shape)
    )


@pytest.mark.slow
def test_a_supply_that_sags_behind_a_bridge() -> None:
    """Its resistance counts with the square of the duty, which was a ceiling and a resistance that heats."""
    closed = bg.close_loop(bridge(), [bridge_log(seed, 0.35) for seed in (1, 2)], [bridge_log(3, 0.35)])
    (law,) = closed.added
    assert law.trial.candidate.label == "formula_power_product_of_flow_of_armature_and_duty at armature"
    formula = law.trial.candidate.function.__dict__["formula"]
    exponent = closed.corrected.values[formula.inner()[0].name]
    assert exponent == pytest.approx(2.0, abs=0.1)
    inner = closed.corrected.values[formula.coefficients()[0].name] / formula.terms[0].size ** exponent
    assert inner == pytest.approx(0.35, rel=0.05)


def test_powers_fall_only_where_an_input_keeps_away_from_zero() -> None:
    way = np.linspace(-1.0, 1.0, 50)
    current, duty = Signal("flow of armature", "A", (way,)), Signal("duty", "1", (way[::-1],))
    stream, hot = Signal("stream", "m^3/s", (2.0 + way,)), Signal("effort of oil", "K", (300.0 + way,))
    found = {(one.kind.name, one.signals, one.inner) for one in products([current, duty, stream, hot], current.name)}
    assert ("product", ("duty", "flow of armature"), 0.0) in found
    assert ("power_product", ("flow of armature", "duty"), 2.0) in found
    assert ("power_product", ("flow of armature", "duty"), -1.0) not in found
    assert ("power_product", ("flow of armature", "stream"), -1.0) in found
    own = {current.name in signals for name, signals, _ in found if name != "product" and hot.name not in signals}
    assert own == {True}
    assert {signals[0] for name, signals, _ in found if signals[1] == hot.name} == {current.name, "duty", "stream"}
    clutch = Signal("clutch", "1", (np.where(way > 0.0, 1.0, 0.0),))
    assert products([current, clutch]) == []  # a fan that its clutch engages is no product
