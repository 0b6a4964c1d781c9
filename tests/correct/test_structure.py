"""Places that sensors can tell apart: they depend on the machine, and neither on its units nor on how slow it is."""

from __future__ import annotations

import numpy as np

import bondgraph as bg
from bondgraph.correct.places.structure import Structure, structure
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale


def told(g: bg.BondGraph, junctions: list[str], sizes: list[float], outputs: int) -> Structure:
    """The structure of a machine with one input, seen by all of its sensors."""
    time = np.arange(40.0)
    log = MatchedLog("run", time, np.ones((1, time.size)), np.zeros((outputs, time.size)))
    where = [Place(handle(g, name), Scale(1.0, 1.0)) for name in junctions]
    return structure(bg.build(g), where, [log], np.array(sizes))


def test_a_pressure_drop_is_seen_beside_flows_of_litres() -> None:
    g = bg.BondGraph("tanks", doc="Two tanks with a pipe between.")
    given = g.input("given", "m^3/s")
    first, second = g.zero_junction("first", bg.HYDRAULIC), g.zero_junction("second", bg.HYDRAULIC)
    pipe = g.one_junction("pipe", bg.HYDRAULIC)
    g.flow_source("pump", given, at=first)
    for name, tank in (("first", first), ("second", second)):
        g.compliance(f"water_{name}", g.parameter(f"k_{name}", 6.4e5, "Pa/m^3"), at=tank, state=f"V_{name}")
        g.measure_effort(f"p_{name}", tank)
    g.bond(first, pipe)
    g.bond(pipe, second)
    g.resistance("wall", flow=lambda effort: 3e-8 * effort, at=pipe)
    g.resistance("outlet", flow=lambda effort: 3e-8 * effort, at=second)
    assert told(g, ["first", "second", "pipe"], [0.01, 0.003], 2) == Structure((), (), ("p_first", "p_second"))


def test_a_slow_oven_tells_heat_from_a_fault_of_its_thermometer() -> None:
    g = bg.BondGraph("oven", doc="Air and load of an oven; time constants of an hour.")
    power = g.input("power", "W")
    air, load, film = g.zero_junction("air", bg.THERMAL), g.zero_junction("load", bg.THERMAL), g.one_junction("film")
    g.flow_source("heater", power, at=air)
    g.compliance("heat_air", 1 / g.parameter("C_air", 4e3, "J/K"), at=air)
    g.compliance("heat_load", 1 / g.parameter("C_load", 2e3, "J/K"), at=load)
    g.bond(air, film)
    g.resistance("contact", g.parameter("R", 0.5, "K/W"), at=film)
    g.bond(film, load)
    g.measure_effort("T_air", air)
    g.measure_effort("T_load", load)
    assert told(g, ["air", "load", "film"], [1e6, 6e5], 2).classes == ()


def test_what_no_sensor_sees_is_invisible() -> None:
    g = bg.BondGraph("lost", doc="A pump that fills one tank; another one stands alone.")
    given = g.input("given", "m^3/s")
    full, alone = g.zero_junction("full", bg.HYDRAULIC), g.zero_junction("alone", bg.HYDRAULIC)
    g.flow_source("pump", given, at=full)
    for name, tank in (("full", full), ("alone", alone)):
        g.compliance(f"water_{name}", g.parameter(f"k_{name}", 6.4e5, "Pa/m^3"), at=tank)
        g.resistance(f"outlet_{name}", flow=lambda effort: 3e-8 * effort, at=tank)
    g.measure_effort("p", full)
    seen = told(g, ["full", "alone"], [0.01, 0.01], 1)
    assert seen.invisible == ("alone",)
    assert seen.classes == (("full", "sensor p"),)  # one sensor: everything shows in the same way
