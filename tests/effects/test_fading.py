"""Sources that fall or grow as a body warms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.data.log import FloatArray
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.effects.catalogue import named
from bondgraph.effects.curves import curve_of
from bondgraph.effects.fading import source_temperature_dependence, source_temperature_rise

ROOM = 295.0


def iron() -> bg.BondGraph:
    """A heater at a voltage, its resistance measured cold, and a tip."""
    g = bg.BondGraph("iron")
    heater, stem = g.zero_junction("heater", bg.THERMAL), g.one_junction("stem", bg.THERMAL)
    tip, air = g.zero_junction("tip", bg.THERMAL), g.one_junction("air", bg.THERMAL)
    resistance = g.parameter("R", 9.0, "ohm", "heater, cold", tolerance=0.02)
    C_h, C_t = g.parameter("C_h", 8.0, "J/K", "", (2.0, 25.0)), g.parameter("C_t", 13.0, "J/K", "", (4.0, 40.0))
    G, G_a = g.parameter("G", 0.36, "W/K", "", (0.1, 1.0)), g.parameter("G_a", 0.09, "W/K", "", (0.02, 0.3))
    room = g.parameter("T_room", ROOM, "K", tolerance=0.0)
    g.flow_source("power", g.input("voltage", "V", hold=True) ** 2 / resistance, at=heater)
    g.compliance("heater_heat", displacement=C_h, at=heater, initial=C_h * room)
    g.bond(heater, stem)
    g.resistance("contact", flow=lambda rise: G * rise, at=stem)
    g.bond(stem, tip)
    g.compliance("tip_heat", displacement=C_t, at=tip, initial=C_t * room)
    g.bond(tip, air)
    g.resistance("cooling", flow=lambda rise: G_a * rise, at=air)
    g.effort_source("room", -room, at=air)
    g.measure_effort("heater_temperature", heater)
    g.measure_effort("tip_temperature", tip)
    return g


def heated(voltage: FloatArray, a: float, grows: bool = False) -> FloatArray:
    """Temperatures of heater and tip every 2 s, by scipy; the resistance rises by a share per kelvin from 293.15 K.

    At a voltage the power falls by it; what ``grows`` is the power of a current.
    """
    shown = np.full((2, voltage.size), ROOM)
    for k, volts in enumerate(voltage[:-1]):

        def rates(t: float, y: FloatArray, volts: float = float(volts)) -> list[float]:
            risen, across = 1.0 + a * (y[0] - 293.15), 0.33 * (y[0] - y[1])
            power = volts**2 / 9.0 * (risen if grows else 1.0 / risen)
            return [(power - across) / 8.6, (across - 0.098 * (y[1] - ROOM)) / 11.5]

        shown[:, k + 1] = solve_ivp(rates, (0.0, 2.0), shown[:, k], rtol=1e-9, atol=1e-6).y[:, -1]
    return shown


@pytest.mark.parametrize("function", [source_temperature_dependence, source_temperature_rise])
def test_a_heater_whose_resistance_rises_takes_less_power_or_more(function: EffectFunction) -> None:
    voltage = np.repeat([10.0, 24.0, 0.0, 18.0], 40)
    g = iron()
    effect = function(g, Place(handle(g, "heater"), Scale(600.0, 60.0)))
    assert isinstance(effect, Effect)
    values = {effect.coefficients[0]: 1e-3, "C_h": 8.6, "C_t": 11.5, "G": 0.33, "G_a": 0.098}
    run = bg.simulate(bg.build(with_values(g, values)), 2.0 * np.arange(voltage.size), {"voltage": voltage}, rtol=1e-9)
    np.testing.assert_allclose(run.y, heated(voltage, 1e-3, function is source_temperature_rise), atol=1e-3)
    assert np.ptp(run.y[0]) > 100.0


def test_a_machine_without_a_body_has_no_such_source() -> None:
    g = bg.BondGraph("cart")
    body = g.one_junction("body", bg.TRANSLATION)
    g.effort_source("motor", g.input("force", "N"), at=body)
    g.inertance("mass", 2.0, at=body)
    for function in (source_temperature_dependence, source_temperature_rise):
        assert function(g, Place(handle(g, "body"), Scale(10.0, 1.0))) is None


@pytest.mark.slow
@pytest.mark.parametrize(("a", "grows"), [(8e-4, False), (8e-4, True), (0.0, False)])
def test_it_is_found_and_no_ceiling_of_the_thermometer(a: float, grows: bool) -> None:
    """Of a soldering iron the answer was a ceiling of its only sensor, with a parameter on its bound.

    Of a transformer at a current it was a fall with a negative coefficient, and an event that made up for the form.
    """
    logs = []
    for seed in (1, 2, 9):
        chance = np.random.default_rng(seed)
        voltage = np.repeat(chance.choice([8.0, 12.0, 18.0, 24.0], 10), 30)
        shown = heated(voltage, a, grows) + 0.6 * chance.standard_normal((2, voltage.size))
        logs.append(bg.MatchedLog(f"run{seed}", 2.0 * np.arange(voltage.size), voltage[np.newaxis], shown))
    loop = bg.close_loop(iron(), logs[:2], logs[2:])
    if not a:
        assert (loop.verdict, loop.added) == ("no missing effect", ())
        return
    name = "source_temperature_rise" if grows else "source_temperature_dependence"
    assert [one.trial.candidate.label for one in loop.added] == [f"{name} at heater"]
    assert loop.events == () and loop.corrected.values[f"a_{name}_heater"] == pytest.approx(a, rel=0.1)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("source_temperature_dependence", 0.2, 1.0),
        ("source_temperature_rise", 1.0, 5.0),
        ("temperature_dependence", 1.0, 5.0),
    ],
)
def test_its_picture_shows_a_warm_body(name: str, least: float, most: float) -> None:
    """The body was drawn at 20 K, where a source turned round."""
    curve = curve_of(named(name)[0])
    assert curve is not None and curve.declared is not None
    acting = curve.declared != 0.0
    shares = curve.law[acting] / curve.declared[acting]
    assert least < shares.min() <= shares.max() < most
