"""Declared elements that a law takes the place of: a cake of coffee is an orifice, and no laminar flow beside one."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph import effects
from bondgraph.arrays import FloatArray
from bondgraph.correct.evidence.replaced import parameters_beside
from bondgraph.correct.loop import ClosedLoop, close_loop
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale

CAPACITY, ORIFICE, LAMINAR, NOISE = 4e-12, 1e-8, 1.0 / 5e11, 3e3


def boiler() -> bg.BondGraph:
    """A pump presses water through a cake that is declared as a laminar resistance."""
    g = bg.BondGraph("boiler")
    pumped = g.input("pumped", "m^3/s", "pump", hold=True)
    resistance = g.parameter("Rp", 6e10, "Pa s/m^3", "cake", (1e10, 5e11))
    line = g.zero_junction("line", bg.HYDRAULIC)
    g.flow_source("pump", pumped, at=line)
    g.compliance("air", 1.0 / g.parameter("C", CAPACITY, "m^3/Pa", "air"), at=line, state="V")
    g.resistance("cake", flow=lambda p: p / resistance, at=line)
    g.measure_effort("pressure", line, "gauge")
    return g


def pressed(seed: int, laminar: float) -> MatchedLog:
    """An orifice, by scipy, and beside it a laminar flow of so many m^3/s per Pa."""
    rng = np.random.default_rng(seed)
    time = 0.5 * np.arange(300)
    flow = np.repeat(rng.uniform(1e-6, 1.2e-5, 30), 10)

    def rate(t: float, p: FloatArray) -> FloatArray:
        given = flow[min(int(t / 0.5 + 1e-9), flow.size - 1)]
        return (given - ORIFICE * np.sign(p) * np.sqrt(np.abs(p)) - laminar * p) / CAPACITY

    whole = [np.array([2e5])]
    for first, last in itertools.pairwise(time):
        whole.append(solve_ivp(rate, (first, last - 1e-9), whole[-1], rtol=1e-8, atol=1.0).y[:, -1])
    return MatchedLog(
        f"run{seed}", time, flow[np.newaxis], np.array(whole).T + NOISE * rng.standard_normal((1, time.size))
    )


@functools.cache
def closed_on(laminar: float) -> ClosedLoop:
    logs = [pressed(1, laminar), pressed(2, laminar)]
    return close_loop(boiler(), logs, [pressed(3, laminar)], (effects.orifice_leak,))


@pytest.mark.slow
def test_a_law_takes_the_place_of_an_element_that_keeps_its_bounds() -> None:
    """Beside the element on its bound the orifice was bent, and something was left to explain."""
    closed = closed_on(0.0)
    (law,) = closed.added
    assert law.trial.candidate.label in ("orifice_leak at line", "formula_power_of_effort_of_line at line")
    (exponent,) = law.trial.candidate.effect.shapes
    assert closed.corrected.values[exponent] == pytest.approx(0.5, abs=0.005)
    assert closed.corrected.values["Rp"] > 5e12  # a tenth of what the bound left of it
    (said,) = [one for one in closed.cautions if "beyond its declared bounds" in one]
    label = law.trial.candidate.label
    assert said.startswith("Rp = ") and f"{label} takes the place of its element, which may be left out" in said
    assert not any("rests on its bound in the corrected model" in one for one in closed.cautions)
    (held_out,) = closed.corrected_holdout.logs
    assert held_out.channels["pressure"].simulation_rmse < 1.1 * NOISE and not closed.unexplained
    (kept,) = [one for one in closed.corrected_graph.parameters if one.name == "Rp"]
    assert kept.bounds is not None and kept.bounds[0] <= kept.value <= kept.bounds[1]


@pytest.mark.slow
def test_an_element_that_the_machine_has_keeps_its_bounds() -> None:
    closed = closed_on(LAMINAR * 4.0)
    assert [one.trial.candidate.place.label for one in closed.added] == ["line"]
    assert not any("bounds" in one for one in closed.cautions)
    assert closed.corrected.values["Rp"] == pytest.approx(1.25e11, rel=0.2)


def test_parameters_beside_a_place_are_those_of_its_elements() -> None:
    g = boiler()
    pipe, tank = g.one_junction("pipe", bg.HYDRAULIC), g.zero_junction("tank", bg.HYDRAULIC)
    far = g.one_junction("far", bg.HYDRAULIC)
    for first, second in (("line", pipe), (pipe, tank), (tank, far)):
        g.bond(handle(g, first) if isinstance(first, str) else first, second)
    g.resistance("wall", g.parameter("R_wall", 1e9, "Pa s/m^3"), at=pipe)
    g.resistance("end", g.parameter("R_end", 1e9, "Pa s/m^3"), at=far)
    scale = Scale(1e5, 1e-5)
    assert parameters_beside(Place(handle(g, "line"), scale), g) == {"Rp", "R_wall"}
    between = Place.between(handle(g, "line"), tank, scale)
    assert parameters_beside(between, g) == {"Rp", "R_wall", "R_end"}
