"""Laws of storages: the same whichever way the storage was declared, with a pretension or without."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.data.log import FloatArray
from bondgraph.declare.domains import Domain
from bondgraph.declare.editing import copy, handle, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.declare.quantities import symbol
from bondgraph.effects.gaps import backlash
from bondgraph.effects.storages import (
    added_capacity,
    end_stop,
    hardening_spring,
    one_sided_stop,
    progressive_spring,
    softening_spring,
)
from bondgraph.effects.vessels import entrained_air, gas_storage, stepped_tank
from bondgraph.simulate.simulation import simulate

PRESSURE = 3e6


def vessel(by_capacity: bool, domain: Domain = bg.HYDRAULIC) -> bg.BondGraph:
    g = bg.BondGraph("vessel")
    line = g.zero_junction("line", domain)
    capacity = g.parameter("C", 1e-11, f"{domain.displacement_unit}/({domain.effort_unit})")
    g.flow_source("pump", g.input("pump", domain.flow_unit), at=line)
    if by_capacity:
        g.compliance("oil", displacement=capacity, at=line, state="V")
    else:
        g.compliance("oil", lambda q: q / capacity, at=line, state="V")
    g.resistance("bleed", flow=lambda effort: 2e-11 * effort, at=line)
    g.measure_effort("shown", line)
    return g


def at_line(g: bg.BondGraph, function: EffectFunction) -> Effect | None:
    return function(g, Place(handle(g, "line"), Scale(PRESSURE, 6e-5)))


def shown(g: bg.BondGraph, u: FloatArray, step: float) -> FloatArray:
    time = step * np.arange(u.size)
    run = simulate(bg.build(g).model, time, u[np.newaxis], rtol=1e-10, atol=1e-14).raise_if_failed()
    return np.asarray(run.y[0], dtype=float)


@pytest.mark.parametrize("function", [hardening_spring, progressive_spring, gas_storage, end_stop])
def test_a_capacity_has_the_laws_of_the_same_stiffness(function: EffectFunction) -> None:
    """README declares a capacitor or an accumulator by its capacity; none of these laws was tried at one."""
    u = 6e-5 * np.repeat([1.0, 0.2, 0.8, 0.0], 25)
    found = []
    for by_capacity in (True, False):
        g = vessel(by_capacity)
        effect = at_line(g, function)
        assert effect is not None
        largest = next(one.bounds for one in g.parameters if one.name == effect.coefficients[0])
        assert largest is not None
        found.append(shown(with_values(g, {effect.coefficients[0]: 0.2 * largest[1]}), u, 0.05))
    assert np.ptp(found[0]) > 0.1 * PRESSURE
    np.testing.assert_allclose(found[0], found[1], rtol=1e-7, atol=1e-6 * PRESSURE)
    without = shown(vessel(True), u, 0.05)
    assert np.abs(found[0] - without).max() > 1e-3 * PRESSURE


@pytest.mark.parametrize(
    "function", [backlash, hardening_spring, progressive_spring, softening_spring, end_stop, one_sided_stop]
)
def test_a_spring_with_a_pretension_has_the_laws_of_a_spring(function: EffectFunction) -> None:
    """The stop of a door was a ramp and a step in a formula: its closer was declared with the pretension it has."""
    g = bg.BondGraph("door")
    leaf = g.one_junction("leaf", bg.ROTATION)
    k, pretension = g.parameter("k", 15.0, "N m/rad"), g.parameter("M_0", 12.0, "N m")
    g.compliance("closer", lambda a: pretension + k * a, at=leaf, state="a")
    g.inertance("mass", g.parameter("J", 30.0, "kg m^2"), at=leaf, state="omega")
    assert function(g, Place(handle(g, "leaf"), Scale(40.0, 2.0))) is not None


def test_a_storage_with_a_law_of_its_own_has_no_other() -> None:
    g = bg.BondGraph("tank")
    line = g.zero_junction("line", bg.HYDRAULIC)
    g.compliance("cone", lambda q: q**3, at=line)
    assert at_line(g, hardening_spring) is None
    assert at_line(g, entrained_air) is None


@given(
    air=st.floats(1e-6, 1e-4), absolute=st.floats(2e4, 5e5), pressure=st.floats(0.0, 5e6),
)  # fmt: skip
def test_entrained_air_takes_the_volume_of_an_ideal_gas(air: float, absolute: float, pressure: float) -> None:
    """Boyle: of a volume V at the absolute pressure P a share P/(P + p) is left at the pressure p above that."""
    g = vessel(by_capacity=True)
    effect = at_line(g, entrained_air)
    assert effect is not None
    names = dict(zip((*effect.coefficients, *effect.shapes), (air, absolute), strict=True))
    law = g.nodes[effect.element].law("displacement")
    assert law is not None
    values = {one.symbol: names[one.name] for one in g.parameters if one.name in names}
    own = float(law.subs({**values, symbol("effort"): pressure}))
    assert own == pytest.approx(air - air * absolute / (absolute + pressure), rel=1e-9, abs=1e-18)


def test_entrained_air_softens_a_line_at_low_pressure_only() -> None:
    air, absolute, capacity = 1e-5, 1e5, 1e-11
    soft = vessel(by_capacity=True)
    effect = at_line(soft, entrained_air)
    assert effect is not None
    soft = with_values(soft, {effect.coefficients[0]: air, effect.shapes[0]: absolute})
    u = np.repeat([0.0, 2e-5, 6e-5], [5, 200, 200])
    pressure = shown(soft, u, 1e-3)
    for k, flow in ((10, 2e-5), (400, 6e-5)):
        softness = capacity + air * absolute / (absolute + pressure[k]) ** 2
        expected = (flow - 2e-11 * pressure[k]) / softness
        assert (pressure[k + 1] - pressure[k - 1]) / 2e-3 == pytest.approx(expected, rel=0.01)
    assert pressure[400] > 10.0 * pressure[10]
    assert at_line(copy(vessel(False, bg.ELECTRICAL)), entrained_air) is None
    assert at_line(copy(vessel(False)), added_capacity) is not None


@pytest.mark.parametrize(("level", "share"), [(0.4, -0.3), (0.4, 2.0), (-0.2, -0.5), (-0.2, 1.0)])
def test_a_tank_with_a_step_fills_as_two_tanks(level: float, share: float) -> None:
    """Up to its level a tank is as declared; beyond, its section is smaller by one over one plus the share."""
    g = vessel(by_capacity=False)
    effect = at_line(g, stepped_tank)
    assert effect is not None
    law = g.nodes[effect.element].law("effort")
    declared = vessel(by_capacity=False).nodes[effect.element].law("effort")
    assert law is not None and declared is not None
    known = {one.symbol: one.value for one in g.parameters}
    values = {**known, symbol(effect.coefficients[0]): share, symbol(effect.shapes[0]): level}
    own, before = (
        [float(one.subs(values).subs({symbol("displacement"): v})) for v in (level / 2, level, 2 * level)]
        for one in (law, declared)
    )
    assert own[:2] == pytest.approx(before[:2])
    assert own[2] - own[1] == pytest.approx((1.0 + share) * (before[2] - before[1]))


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
def test_a_stop_is_a_ramp_to_a_power(exponent: float) -> None:
    g = bg.BondGraph("leg")
    leg = g.one_junction("leg", bg.TRANSLATION)
    g.compliance("spring", g.parameter("k", 100.0, "N/m"), at=leg, state="x")
    effect = one_sided_stop(g, Place(handle(g, "leg"), Scale(100.0, 1.0)))
    assert effect is not None and [name.split("_")[0] for name in effect.widths] == ["n"]
    values = {effect.coefficients[0]: 400.0, effect.shapes[0]: 0.6, effect.widths[0]: exponent}
    numbers = {one.symbol: values.get(one.name, one.value) for one in g.parameters}
    depth = next(one.value for one in g.parameters if one.name.startswith("r_"))
    law = g.nodes["spring"].law("effort")
    assert law is not None
    for x in (0.2, 0.7, 0.95):
        into = max(x - 0.6, 0.0)
        expected = 100.0 * x + 400.0 * depth * (into / depth) ** exponent
        own = float(law.subs({**numbers, symbol("displacement"): x}))
        assert own == pytest.approx(expected, rel=1e-5)


def _pumped(seed: int, air: float) -> bg.MatchedLog:
    """Oil that leaks through a bleed, with so much air in it by Boyle's law, m^3 at 1 bar; by scipy."""
    chance, time = np.random.default_rng(seed), 0.005 * np.arange(400)
    flow = np.repeat(chance.choice([0.0, 1e-5, 3e-5, 6e-5], 20), 20)

    def rises(t: float, p: FloatArray) -> list[float]:
        softness = 1.1e-11 + air * 1e5 / (1e5 + max(p[0], 0.0)) ** 2
        return [(flow[min(int(t / 0.005 + 1e-9), 399)] - 2.4e-11 * p[0]) / softness]

    shown = [0.0]
    for k in range(399):  # each interval by itself: the flow jumps between them
        ends = solve_ivp(rises, (time[k], time[k + 1] - 1e-9), [shown[-1]], rtol=1e-8, atol=1.0)
        shown.append(float(ends.y[0, -1]))
    pressure = np.array(shown) + 2e4 * chance.standard_normal(400)
    return bg.MatchedLog(f"run{seed}", time, flow[np.newaxis], pressure[np.newaxis])


@pytest.mark.slow
@pytest.mark.parametrize("air", [1e-5, 0.0])
def test_air_in_oil_is_found_beside_a_capacity_and_not_where_there_is_none(air: float) -> None:
    """A press whose line held air was told a loss of its pump's flow, times a ramp of its own travel."""
    g = bg.BondGraph("line")
    line = g.zero_junction("line", bg.HYDRAULIC)
    g.flow_source("pump", g.input("pump", "m^3/s", hold=True), at=line)
    g.compliance("oil", displacement=g.parameter("C", 0.9e-11, "m^3/Pa", "", (0.4e-11, 2.5e-11)), at=line)
    bleed = g.parameter("G", 2e-11, "m^3/(s Pa)", "", (0.8e-11, 5e-11))
    g.resistance("bleed", flow=lambda effort: bleed * effort, at=line)
    g.measure_effort("pressure", line)
    closed = bg.close_loop(g, [_pumped(1, air), _pumped(2, air)], [_pumped(9, air)])
    if not air:
        assert (closed.verdict, closed.added) == ("no missing effect", ())
        return
    (found,) = closed.added
    assert closed.verdict == "effect found" and found.trial.candidate.label == "entrained_air at line"
    assert closed.corrected.values["c_entrained_air_line"] == pytest.approx(air, rel=0.15)
