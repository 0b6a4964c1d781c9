"""Places that sensors can tell apart: they depend on the machine, and neither on its units nor on how slow it is."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.correct.places.probes import probed_model
from bondgraph.correct.places.structure import Structure, structure
from bondgraph.correct.places.sums import summed_outputs
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


def suspension(*outputs: str) -> bg.BondGraph:
    """A body on a spring and a damper; ``outputs`` are expressions of their forces."""
    g = bg.BondGraph("suspension")
    road = g.input("road", "m/s")
    mount, gap = g.zero_junction("mount", bg.TRANSLATION), g.one_junction("gap", bg.TRANSLATION)
    body = g.one_junction("body", bg.TRANSLATION)
    g.flow_source("ground", road, at=mount)
    g.bond(mount, gap)
    g.bond(mount, body)
    g.inertance("mass", 300.0, at=body, state="v")
    spring = g.compliance("spring", 2e4, at=gap, state="x")
    damper = g.resistance("damper", 1e3, at=gap)
    known = {"spring": spring.effort, "damper": damper.effort, "two": g.signal("two", 2 * damper.effort, "N")}
    g.measure_effort("load", mount)
    for k, text in enumerate(outputs):
        g.measure(f"force{k}", eval(text, known), "N")
    return g


def test_a_sum_of_element_efforts_lacks_what_is_added_where_they_act() -> None:
    """The sum and the load are one number as declared; only the load has an effect at the junction, at once."""
    g = suspension("spring + damper")
    where = Place(handle(g, "gap"), Scale(1.0, 1.0))
    model, names = probed_model(g, [where])
    x, u = np.array([3.0, 0.01])[: len(model.states)], np.array([0.5])
    before, after = (model.output(0.0, x, u, model.theta(**{names["gap"]: size})) for size in (0.0, 7.0))
    assert before[0] == pytest.approx(before[1]) and abs(before[0]) > 1.0
    assert after[1] == pytest.approx(before[1]) and abs(after[0] - before[0]) == pytest.approx(7.0)
    (said,) = told(g, ["gap", "body"], [1.0, 0.1], 2).sums
    assert said.startswith("force0 is declared as the sum of the efforts of spring and damper, which lacks an effect")
    assert said.endswith("declare the output as the effort of mount, which has all that acts at gap")


def test_only_sums_over_elements_of_one_junction_are_told() -> None:
    sums = ["-0.5*(damper + spring)", "2*spring + two"]
    others = ["spring", "spring - damper", "spring + 2*damper", "spring*damper", "two"]
    g = suspension(*sums, *others)
    names = [one.name for one in g.outputs]
    assert [one.split()[0] for one in summed_outputs(g, names)] == ["force0", "force1"]
    assert summed_outputs(g, ["force2", "load"]) == ()
    outer = bg.BondGraph("car")
    outer.include("front", suspension("spring + damper"))
    (said,) = summed_outputs(outer, [one.name for one in outer.flatten().outputs])
    assert "of front.spring and front.damper, which lacks an effect that is added at front.gap:" in said


def test_flows_into_one_vessel_are_told_as_efforts_are() -> None:
    g = bg.BondGraph("tank")
    tank = g.zero_junction("tank", bg.HYDRAULIC)
    pump = g.flow_source("pump", g.input("given", "m^3/s"), at=tank)
    g.compliance("water", 1e6, at=tank)
    drain = g.resistance("drain", flow=lambda effort: 3e-8 * effort, at=tank)
    leak = g.resistance("leak", flow=lambda effort: 1e-8 * effort, at=tank)
    g.measure("out", drain.flow + leak.flow, "m^3/s")
    g.measure("net", drain.flow - pump.flow, "m^3/s")  # what the pump gives flows in
    g.measure("both", drain.flow + pump.flow, "m^3/s")
    said = summed_outputs(g, ["out", "net", "both"])
    assert [one.split(",")[0] for one in said] == [
        "out is declared as the sum of the flows of drain and leak",
        "net is declared as the sum of the flows of pump and drain",
    ]
    assert all(
        one.endswith("a 0-junction of their own behind a 1-junction, and measure the flow of that") for one in said
    )
