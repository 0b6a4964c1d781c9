"""Laws that are products of two signals: windings that a speed couples, a battery behind a bridge; truths by scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.arrays import FloatArray
from bondgraph.correct.places.probes import Signal
from bondgraph.correct.shapes.formula import Formula
from bondgraph.correct.shapes.library import products, two_signals
from bondgraph.declare.effect import Place, Scale
from bondgraph.declare.graph import Handle
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
    assert law.trial.candidate.label == "formula_square_product_of_flow_of_armature_and_duty at armature"
    (inner,) = law.trial.candidate.effect.coefficients
    assert closed.corrected.values[inner] == pytest.approx(0.35, rel=0.05)


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
    assert {one.kind.name for one in two_signals(duty, stream)} == {"product"}  # what two inputs do is no form of one
    follows = Signal("follows", "A", (way**2,), stored=True)  # a state that an effect brought is no input
    scaled = [one for one in products([current, follows], current.name) if one.kind.name == "power_product"]
    assert scaled and all(one.kind.bends for one in scaled)
    clutch = Signal("clutch", "1", (np.where(way > 0.0, 1.0, 0.0),))
    assert products([current, clutch]) == []  # a fan that its clutch engages is no product


def battery() -> bg.BondGraph:
    """A battery on a cycler; that its acid is thin when it is empty is not declared."""
    g = bg.BondGraph("battery")
    current = g.input("current", "A", hold=True)
    resistance = g.parameter("R", 0.016, "ohm", "grids and acid", (0.002, 0.1))
    capacity = g.parameter("C", 1.3e5, "F", "charge for a volt of the open circuit", (4e4, 5e5))
    terminal = g.zero_junction("terminal", bg.ELECTRICAL)
    series = g.one_junction("series", bg.ELECTRICAL)
    g.flow_source("cycler", current, at=terminal)
    g.bond(terminal, series)
    g.resistance("ohmic", lambda i: resistance * i, at=series)
    g.compliance("charge", lambda q: 11.3 + q / capacity, at=series, state="q", initial=1.5e5)
    g.measure_effort("voltage", terminal)
    return g


def battery_log(seed: int, samples: int = 1200) -> bg.MatchedLog:
    """Cycles between full and empty; the resistance is 12 mohm when full, and 43 mohm when empty."""
    chance, step = np.random.default_rng(seed), 10.0
    time: FloatArray = step * np.arange(samples, dtype=np.float64)
    goal = np.interp(time / time[-1], [0.0, 0.35, 0.45, 0.7, 0.9, 1.0], [1.5e5, 1.2e4, 1e4, 1e5, 1.2e4, 2e4])
    current, charge, held = np.zeros(samples), np.full(samples, 1.5e5), 0.0
    for k in range(samples - 1):
        if k % 12 == 0:
            held = float(np.clip((goal[k] - charge[k]) / 300.0 + chance.uniform(-30.0, 30.0), -45.0, 45.0))
            held = abs(held) if charge[k] < 8e3 else held
        current[k], charge[k + 1] = held, charge[k] + step * held
    current[-1] = held
    shown = 11.3 + charge / 1.6e5 + 0.012 * (1.0 + 2.6 * np.exp(-charge / 3.1e4)) * current
    return bg.MatchedLog(
        f"run{seed}", time, current[np.newaxis], shown[np.newaxis] + 0.02 * chance.normal(size=samples)
    )


@pytest.mark.slow
def test_a_resistance_that_falls_with_the_charge_is_a_product_with_its_form() -> None:
    """Before: products of the charge with the current and with the voltage, after minutes."""
    closed = bg.close_loop(battery(), [battery_log(seed) for seed in (1, 2)], [battery_log(3)])
    (law,) = closed.added
    label = "formula_falling_exponential_product_of_flow_of_series_and_displacement_of_charge at series"
    assert law.trial.candidate.label == label
    values = closed.corrected.values
    reach, size = (
        values[name] for name in (*law.trial.candidate.effect.shapes, *law.trial.candidate.effect.coefficients)
    )
    assert (reach, -size, values["R"]) == pytest.approx((3.1e4, 0.0312, 0.0432), rel=0.05)


def test_coefficients_of_products_have_the_unit_of_both_signals() -> None:
    current, charge = (
        Signal("flow of series", "A", (np.linspace(-9.0, 9.0, 60),)),
        Signal("displacement of charge", "C", (np.linspace(1.0, 50.0, 60) ** 1.3,)),
    )
    place = Place(Handle("series", "1", bg.ELECTRICAL), Scale(12.0, 9.0))
    units = {}
    for term in products([current, charge], current.name):
        formula = Formula(place, "effort", "V", (term,), (1.0,))
        if term.signals == (current.name, charge.name):
            units[term.kind.name] = [formula.coefficients()[0].unit, *(one.unit for one in formula.inner())]
    assert units["falling_exponential_product"] == ["V/A", "C"]
    assert units["ramp_above_product"] == ["V/A/C", "C"]
    assert units["square_product"] == ["V/A/C^2"]
    assert units["power_product"] == ["V/A", "1"]
