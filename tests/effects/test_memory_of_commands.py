"""Play of a command, hysteresis of a cell, an eccentric encoder, ratios that move: closed forms and scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.arrays import FloatArray
from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC, ROTATION, TRANSLATION
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import EffectFunction, Place, Scale
from bondgraph.effects.actuators import actuator_play
from bondgraph.effects.hysteresis import voltage_hysteresis
from bondgraph.effects.ratios import crank_ratio, ratio_by_angle, ratio_by_stroke
from bondgraph.effects.sensors import sensor_eccentricity
from tests.effects.machines.machine import steps


def vessel() -> bg.BondGraph:
    """A tank that a valve fills and a filter empties."""
    g = bg.BondGraph("vessel")
    command = g.input("command", "%")
    tank = g.zero_junction("tank", HYDRAULIC)
    g.flow_source("valve", g.parameter("Kq", 2.5e-4, "m^3/s", "open valve", (8e-5, 1e-3)) * command, at=tank)
    size = g.parameter("C", 2e-6, "m^3/Pa")
    g.compliance("water", lambda q: q / size, at=tank)
    g.resistance("filter", flow=lambda p: p / g.parameter("R", 3e7, "Pa s/m^3", "filter", (1e7, 1e8)), at=tank)
    g.measure_effort("pressure", tank)
    return g


def cell() -> bg.BondGraph:
    g = bg.BondGraph("cell")
    current = g.input("current", "A")
    terminal, inside = g.zero_junction("terminal", ELECTRICAL), g.one_junction("inside", ELECTRICAL)
    g.flow_source("cycler", current, at=terminal)
    g.bond(terminal, inside)
    size = g.parameter("C", 1e5, "F")
    g.compliance("charge", lambda q: q / size, at=inside)
    g.resistance("leads", g.parameter("R", 0.02, "ohm", "leads", (0.005, 0.1)), at=inside)
    g.measure_effort("voltage", terminal)
    return g


def with_effect(g: bg.BondGraph, function: EffectFunction, place: Place, *values: float) -> bg.BuiltModel:
    effect = function(g, place)
    assert effect is not None
    return bg.build(with_values(g, dict(zip(effect.parameters, values, strict=False))))


def test_a_play_is_that_of_a_play_operator() -> None:
    """The operator of Prandtl: what is given stays until the command has turned by the play."""
    g = vessel()
    place = Place(handle(g, "tank"), Scale(1e4, 1e-4), times=(0.05, 100.0))
    built = with_effect(g, actuator_play, place, 1e-5)
    time: FloatArray = 0.05 * np.arange(2000, dtype=np.float64)
    u = 0.3 + 0.2 * np.sin(0.2 * time) + 0.05 * np.sin(0.9 * time)
    run = bg.simulate(built.model, time, {"command": u})
    moved, given = [0.0], run.state("moved_actuator_play_tank")
    for wanted in 2.5e-4 * u[1:]:
        moved.append(float(np.clip(moved[-1], wanted - 1e-5, wanted + 1e-5)))
    fastest = 2.5e-4 * float(np.max(np.abs(np.gradient(u, time))))
    assert np.max(np.abs(given - np.array(moved))[20:]) < 2.0 * 0.05 * fastest


def test_a_cell_rests_higher_after_charging() -> None:
    g = cell()
    place = Place(handle(g, "inside"), Scale(1.0, 2.0), times=(10.0, 12000.0))
    built = with_effect(g, voltage_hysteresis, place, 0.014, 150.0)
    time: FloatArray = np.arange(0.0, 6000.0, 10.0)
    current = np.select([time < 1500, time < 2500, time < 4000], [1.0, 0.0, -1.0], 0.0)
    bare = bg.build(cell())
    shown = bg.simulate(built.model, time, {"current": current}).output("voltage")
    lead = shown - bg.simulate(bare.model, time, {"current": current}).output("voltage")
    assert lead[200] == pytest.approx(0.014, rel=1e-3) and lead[-1] == pytest.approx(-0.014, rel=1e-3)
    after = lead[150:250]
    assert np.ptp(after) < 1e-6  # it keeps while nothing flows
    charged = np.interp(500.0, time, lead)
    assert charged == pytest.approx(0.014 * (1.0 - np.exp(-500.0 / 150.0)), rel=0.02)


def table() -> bg.BondGraph:
    g = bg.BondGraph("table")
    at = g.one_junction("table", ROTATION)
    g.effort_source("motor", g.input("torque", "N m"), at=at)
    g.inertance("plate", g.parameter("J", 0.05, "kg m^2"), at=at, state="omega")
    angle = g.integral("a", at.flow, "rad")
    g.measure("angle", angle, "mrad")
    return g


def test_an_eccentric_disc_errs_once_per_turn() -> None:
    g = table()
    effect = sensor_eccentricity(g, Place.sensor("angle", Scale(6.0, 5.0)))
    assert effect is not None and effect.kind == "eccentricity"
    model = bg.build(with_values(g, {"sine_angle": 0.025, "cosine_angle": -0.010})).model
    for turned in (0.0, 1.0, 4.0, 1.0 + 2.0 * np.pi):
        shown = model.output(0.0, model.x0(a=turned), model.u0(), model.theta())[0]
        assert shown == pytest.approx(turned + 0.025 * np.sin(turned) - 0.010 * (np.cos(turned) - 1.0), abs=1e-12)
    assert sensor_eccentricity(table(), Place.sensor("angle", Scale(1.0, 0.5))) is None  # it does not turn round


def yoke(slider: str = "travel") -> bg.BondGraph:
    """A crank at right angles to a slide on a spring."""
    g = bg.BondGraph("yoke")
    motor, slide = g.one_junction("motor", ROTATION), g.one_junction("slide", TRANSLATION)
    g.effort_source("drive", g.input("torque", "N m"), at=motor)
    g.inertance("rotor", g.parameter("J", 0.02, "kg m^2"), at=motor, state="omega")
    g.resistance("bearing", g.parameter("b", 0.12, "N m s/rad", "bearing", (0.02, 0.6)), at=motor)
    g.transformer("crank", g.parameter("r", 0.05, "m"), motor, slide)
    k = g.parameter("k", 4500.0, "N/m", "spring", (1500.0, 12000.0))
    g.compliance("spring", lambda x: k * x, at=slide, state="x")
    g.resistance("damper", g.parameter("d", 20.0, "N s/m"), at=slide)
    angle = g.integral("a", motor.flow, "rad")
    g.measure("angle", angle, "rad")
    g.measure_displacement(slider, "spring", unit="m")
    return g


@pytest.mark.parametrize(("function", "at", "values"), [
    (ratio_by_angle, "motor", (0.2, 0.6, 1.5)), (crank_ratio, "motor", (0.1, 0.9, 1.0)),
    (ratio_by_stroke, "slide", (4.0, -60.0)),
])  # fmt: skip
def test_a_ratio_that_moves_loses_no_power(function: EffectFunction, at: str, values: tuple[float, ...]) -> None:
    """The slide takes up by spring and damper all that the motor gives beyond its bearing and rotor."""
    g = yoke()
    built = with_effect(g, function, Place(handle(g, at), Scale(3.0, 2.0)), *values)
    model = built.model
    time = np.linspace(0.0, 2.0, 2001)
    run = bg.simulate(model, time, {"torque": 2.0 * np.sin(3.0 * time)})
    x, omega = run.state("x"), run.state("omega")
    theta = dict(zip(model.names("parameter"), model.theta(), strict=True))
    given = np.trapezoid(2.0 * np.sin(3.0 * time) * omega - theta["b"] * omega**2, time)
    rates = np.array([model.rhs(t, run.x[:, k], run.u[:, k], model.theta()) for k, t in enumerate(time)])
    speed = rates[:, model.index("state", "x")]
    taken = 0.5 * theta["J"] * omega[-1] ** 2 + 0.5 * theta["k"] * x[-1] ** 2 + np.trapezoid(20.0 * speed**2, time)
    assert given == pytest.approx(taken, rel=1e-4)


def yoke_log(seed: int) -> bg.MatchedLog:
    """The truth by scipy: the slide moves by r*cos(a) of the speed, and its force counts as much."""
    chance = np.random.default_rng(seed)
    time: FloatArray = 0.01 * np.arange(700, dtype=np.float64)
    u = steps(time, chance, -6.0, 6.0, 0.3)

    def rates(t: float, state: FloatArray) -> list[float]:
        x, omega, a = state
        ratio = 0.05 * np.cos(a)
        force = 5000.0 * x + 20.0 * ratio * omega
        return [ratio * omega, (np.interp(t, time, u) - 0.1 * omega - ratio * force) / 0.02, omega]

    run = solve_ivp(rates, (0.0, time[-1]), np.zeros(3), t_eval=time, rtol=1e-8, atol=1e-10, max_step=0.01).y
    y = np.array([run[2], run[0]]) + np.array([[4e-3], [3e-4]]) * chance.standard_normal((2, time.size))
    return bg.MatchedLog(f"run{seed}", time, u[np.newaxis], y)


@pytest.mark.slow
def test_a_crank_is_a_ratio_that_moves() -> None:
    """It was a ceiling of a sensor and a softening spring, with certainty."""
    closed = bg.close_loop(yoke(), [yoke_log(seed) for seed in (1, 2)], [yoke_log(3)])
    (law,) = closed.added
    assert law.trial.candidate.label in ("crank_ratio at motor", "ratio_by_stroke at slide")
    assert closed.verdict == "effect found" and closed.corrected.values["k"] == pytest.approx(5000.0, rel=0.05)
