"""Storages of lines and nodes declared without any: equations in closed form, and a culvert's water that is found."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph import effects
from bondgraph.correct.models.candidates import placed
from bondgraph.declare.editing import copy, handle
from bondgraph.declare.effect import EffectFunction, Place, Scale
from bondgraph.effects.benches import BENCHES

SIZES = st.floats(1e-3, 50.0)


def vessel(with_node: bool = False) -> bg.BondGraph:
    """A pipe from a pump into a vessel, declared as a turbulent resistance; it may pass a node with a leak."""
    g = bg.BondGraph("vessel")
    pipe, tank = g.one_junction("pipe", bg.HYDRAULIC), g.zero_junction("tank", bg.HYDRAULIC)
    g.effort_source("pump", g.input("p", "Pa"), at=pipe)
    k = g.parameter("k", 3.0, "m^3/s/Pa^0.5", "flow over the root of the pressure")
    g.resistance(
        "wall", lambda q: sp.sign(q) * (q / k) ** 2, flow=lambda e: k * sp.sign(e) * sp.sqrt(sp.Abs(e)), at=pipe
    )
    if with_node:
        node, rest = g.zero_junction("node", bg.HYDRAULIC), g.one_junction("rest", bg.HYDRAULIC)
        leak = g.parameter("G", 0.2, "m^3/s/Pa", "leak")
        g.resistance("leak", flow=lambda e: leak * e, at=node)
        g.bond(pipe, node)
        g.bond(node, rest)
        g.resistance("bend", g.parameter("R", 0.7, "Pa s/m^3"), at=rest)
        g.bond(rest, tank)
    else:
        g.bond(pipe, tank)
    g.compliance("water", 1 / g.parameter("C", 40.0, "m^3/Pa"), at=tank, state="V")
    g.measure_effort("pressure", tank)
    return g


def with_law(g: bg.BondGraph, function: EffectFunction, junction: str) -> bg.Model:
    assert function(g, Place(handle(g, junction), Scale(10.0, 8.0))) is not None
    return bg.build(g).model


PIPE = with_law(vessel(), effects.line_inertia, "pipe")
NODE = with_law(vessel(with_node=True), effects.node_capacity, "node")


@given(SIZES, st.floats(-60.0, 60.0), st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
def test_a_column_of_water_is_driven_by_what_the_wall_leaves(c: float, volume: float, q: float, p: float) -> None:
    theta = PIPE.theta(inertia_line_inertia_pipe=c)
    assert PIPE.names("state") == ("V", "Q_line_inertia_pipe")
    found = PIPE.rhs(0.0, np.array([volume, q]), np.array([p]), theta)
    driven = p - volume / 40.0 - np.sign(q) * (q / 3.0) ** 2
    np.testing.assert_allclose(found, [q, driven / c], rtol=1e-9, atol=1e-9)


@given(SIZES, st.floats(-60.0, 60.0), st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
def test_a_node_with_a_capacity_takes_what_flows_in_and_not_out(c: float, volume: float, e: float, p: float) -> None:
    theta = NODE.theta(capacity_node_volume_node=c)
    (kept,) = [k for k, name in enumerate(NODE.names("state")) if name != "V"]
    x = np.where(np.arange(2) == kept, c * e, volume)
    found = NODE.rhs(0.0, x, np.array([p]), theta)
    inflow = 3.0 * np.sign(p - e) * sqrt(abs(p - e))
    onward = (e - volume / 40.0) / 0.7
    np.testing.assert_allclose(found[kept], inflow - 0.2 * e - onward, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found[1 - kept], onward, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("domain", ["electrical", "hydraulic", "thermal"])
def test_only_lines_and_nodes_without_a_storage_of_their_own_are_offered_one(domain: str) -> None:
    offered = []
    bench = BENCHES[domain]()
    for place in bench.places:
        for function in (effects.line_inertia, effects.node_capacity):
            g = copy(bench.graph)
            if function(g, placed(g, place)) is not None:
                offered.append(place.label)
    assert offered == {
        "electrical": ["lead", "end"], "hydraulic": ["outlet", "drain", "weir"], "thermal": ["paint"],
    }[domain]  # fmt: skip


def lock() -> bg.BondGraph:
    """A chamber that is filled through a culvert with a paddle, whose water was declared without inertia."""
    g = bg.BondGraph("lock")
    h, s = g.input("h", "m", "level outside"), g.input("s", "1", "opening of the paddle")
    k = g.parameter("k", 15.0, "m^(5/2)/s", "flow over the root of the head", (5.0, 40.0))
    weight = g.parameter("weight", 9810.0, "N/m^3", "specific weight of water")
    area = g.parameter("A", 400.0, "m^2", "area of the chamber")
    culvert, chamber = g.one_junction("culvert", bg.HYDRAULIC), g.zero_junction("chamber", bg.HYDRAULIC)
    g.effort_source("pound", h * weight, at=culvert)
    g.resistance(
        "paddle", lambda q: weight * sp.sign(q) * (q / (k * s)) ** 2,
        flow=lambda e: k * s * sp.sign(e) * sp.sqrt(sp.Abs(e) / weight), at=culvert,
    )  # fmt: skip
    g.bond(culvert, chamber)
    g.compliance("water", lambda volume: weight * volume / area, at=chamber, state="V", initial=460.0)
    g.measure("level", chamber.effort / weight, "m")
    return g


def filled(inertia: float, seed: int) -> bg.Log:
    """A log of 500 s at 1 Hz that begins at rest, by scipy; the inertia [s^2/m^2] is over the specific weight."""
    chance = np.random.default_rng(seed)
    time = np.arange(500.0)
    h, s = np.where(np.sin(time / 25.0 + seed) > 0.0, 5.3, 0.1), np.repeat(chance.choice([0.3, 0.6, 1.0], 10), 50)

    def rates(t: float, x: np.ndarray) -> list[float]:
        outside, open_ = np.interp(t, time, h), np.interp(t, time, s)
        head = outside - x[0]
        if not inertia:
            return [18.0 * open_ * np.sign(head) * sqrt(abs(head)) / 400.0, 0.0]
        return [x[1] / 400.0, (head - x[1] * abs(x[1]) / (18.0 * open_) ** 2) / inertia]

    run = solve_ivp(rates, (0.0, 499.0), [1.0, 0.0], t_eval=time, max_step=1.0, rtol=1e-8, atol=1e-9)
    y = run.y[0] + 0.02 * chance.standard_normal(time.size)
    channels = {
        "h": bg.LogChannel("h", "m", h),
        "s": bg.LogChannel("s", "1", s),
        "level": bg.LogChannel("level", "m", y),
    }
    return bg.Log(f"lock_{seed}", time, channels)


@pytest.mark.slow
@pytest.mark.parametrize("inertia", [0.9, 0.0])
def test_the_water_of_a_culvert_is_found_where_it_has_inertia(inertia: float) -> None:
    """The start of its flow was ten times what it settles at, and a lag of the gauge explained what that left."""
    offered = [effects.line_inertia, effects.viscous_loss, effects.constant_effort, effects.actuator_rate_limit]
    closed = bg.close_loop(lock(), [filled(inertia, 1)], holdout=[filled(inertia, 2)], effects=offered)
    assert [one.trial.candidate.label for one in closed.added] == (["line_inertia at culvert"] if inertia else [])
    if inertia:
        value = closed.corrected.values["inertia_line_inertia_culvert"]
        assert value == pytest.approx(0.9 * 9810.0, rel=0.03)
        assert closed.corrected_holdout.channels["level"].simulation_rmse < 2.0 * 0.02


@pytest.mark.parametrize("power", [0.5, 0.65, 1.0])
@pytest.mark.parametrize("pressure", [-3.0, 0.4, 9.0])
def test_what_a_crack_lets_through_goes_with_its_power(power: float, pressure: float) -> None:
    """A gate that leaked with the power 0.6 was an opening with the root and a linear leak beside it."""
    g = vessel()
    effect = effects.orifice_leak(g, Place(handle(g, "tank"), Scale(10.0, 8.0)))
    assert effect is not None
    (n,), (c,) = effect.widths, effect.coefficients
    model, declared = bg.build(g).model, bg.build(vessel()).model
    x, u = np.array([40.0 * pressure]), np.zeros(1)
    lost = declared.rhs(0.0, x, u, declared.theta()) - model.rhs(0.0, x, u, model.theta(**{n: power, c: 2.0}))
    assert lost[0] == pytest.approx(2.0 * np.sign(pressure) * abs(pressure / 10.0) ** power, rel=1e-3)
