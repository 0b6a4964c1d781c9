"""Resistances that follow a power: exact in their law, tried in the declared form, found with their exponent."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph import effects
from bondgraph.data.log import FloatArray
from bondgraph.declare.editing import copy, handle
from bondgraph.declare.effect import SMOOTHING, Place, Scale, members_of
from bondgraph.declare.revision import revise_law

CAPACITY, HOSE, EXPONENT = 2e-6, 1.5e5, 1.75


def drum(form: str = "flow") -> bg.BondGraph:
    """A vacuum drum behind a hose that is declared as a line."""
    g = bg.BondGraph("drum")
    suction = g.input("suction", "Pa")
    blower, vessel = g.one_junction("hose", bg.HYDRAULIC), g.zero_junction("vessel", bg.HYDRAULIC)
    resistance = g.parameter("R", 2.5e5, "Pa s/m^3", "", (3e4, 2e6))
    capacity = g.parameter("C", 1.5e-6, "m^3/Pa", "", (3e-7, 1e-5))
    g.effort_source("pump", suction, at=blower)
    laws = {"flow": lambda effort: effort / resistance, "effort": lambda flow: resistance * flow}
    if form == "both":
        g.resistance("wall", resistance, at=blower)
    else:
        g.resistance("wall", at=blower, **{form: laws[form]})
    g.bond(blower, vessel)
    g.compliance("air", lambda volume: volume / capacity, at=vessel, state="V")
    g.measure_effort("pressure", vessel)
    g.measure_flow("stream", blower)
    return g


PLACE = Place(handle(drum(), "hose"), Scale(5e3, 0.02))


def pumped(seed: int) -> bg.Log:
    """The drum by scipy: the drop along the hose grows with the power 1.75 of the flow."""
    chance, time = np.random.default_rng(seed), 0.02 * np.arange(900)
    steps = np.repeat(chance.uniform(0.0, 9e3, 18), 50)

    def flow(drop: FloatArray) -> FloatArray:
        return np.asarray(0.02 * np.sign(drop) * (np.abs(drop) / (HOSE * 0.02)) ** (1.0 / EXPONENT))

    def rate(t: float, x: FloatArray) -> FloatArray:
        return flow(np.interp(t, time, steps) - x) / CAPACITY

    x = solve_ivp(rate, (0.0, time[-1]), [0.0], t_eval=time, rtol=1e-7, atol=1e-3, max_step=0.02).y[0]
    table = {"time [s]": time, "suction [Pa]": steps, "pressure [Pa]": x + chance.normal(0.0, 30.0, time.size)}
    table |= {"stream [m^3/s]": flow(steps - x) + chance.normal(0.0, 3e-4, time.size)}
    return bg.Log.from_dataframe(pd.DataFrame(table), name=f"run{seed}")


@given(st.floats(-0.6, 2.9), st.floats(-1e4, 1e4))
def test_the_law_is_a_power_that_takes_energy(exponent: float, drop: float) -> None:
    g = drum()
    effect = effects.resistance_exponent(g, PLACE)
    assert effect is not None and effect.coefficients == ("b_resistance_exponent_hose",)
    known = {one.symbol: one.value for one in g.parameters} | {one.symbol: exponent for one in g.parameters[-2:-1]}
    (right,) = (one.value for one in g.parameters if one.name.startswith("r_"))
    assert right == pytest.approx(0.02 * 2.5e5)  # the drop at which the hose passes what passes there
    law = g.nodes["wall"].law("flow")
    got = float(law.xreplace({sympy.Symbol("effort", real=True): sympy.Float(drop)} | known))
    assert got == pytest.approx(drop / 2.5e5 * ((drop / right) ** 2 + SMOOTHING**4) ** (exponent / 2.0), rel=1e-9)
    assert got * drop >= 0.0


@pytest.mark.parametrize(("form", "given_"), [("flow", "flow"), ("effort", "effort"), ("both", "flow")])
def test_the_form_that_is_declared_or_asked_for_is_kept(form: str, given_: str) -> None:
    g = drum(form)
    assert effects.resistance_exponent(g, PLACE) is not None
    assert [name for name, _ in g.nodes["wall"].laws] == [given_]
    (right,) = (one for one in g.parameters if one.name.startswith("r_"))
    assert (right.value, right.unit) == ((0.02, "m^3/s") if given_ == "effort" else (5e3, "Pa"))


def test_a_law_that_is_no_line_has_no_exponent_of_its_own() -> None:
    g = drum()
    c = g.parameter("c", 1e-4, "m^3/(s Pa^(1/2))")
    revise_law(g, "wall", "flow", c * sympy.sqrt(sympy.Abs(sympy.Symbol("effort", real=True))))
    assert effects.resistance_exponent(g, PLACE) is None


def test_a_resistance_of_no_size_has_no_exponent() -> None:
    g = drum()
    c = g.parameter("c", 0.0, "m^3/(s Pa)")
    revise_law(g, "wall", "flow", c * sympy.Symbol("effort", real=True))
    assert effects.resistance_exponent(g, PLACE) is None


def test_each_of_several_resistances_is_tried() -> None:
    g = drum()
    g.resistance("filter", lambda flow: g.parameter("Rf", 1e5, "Pa s/m^3") * flow, at="hose")
    members = members_of(effects.resistance_exponent, g, {})
    names = [effect.name for one in members if (effect := one(copy(g), PLACE)) is not None]
    assert names == ["resistance_exponent_of_wall", "resistance_exponent_of_filter"]


@pytest.mark.slow
def test_a_hose_is_found_with_its_exponent() -> None:
    """Added beside the declared line, a power has one coefficient too many: a sauna took 375 s to name it."""
    functions = (effects.resistance_exponent, effects.orifice_between, effects.leak_between, effects.quadratic_loss)
    closed = bg.close_loop(drum(), [pumped(1), pumped(2)], effects=functions)
    assert [one.trial.candidate.label for one in closed.added] == ["resistance_exponent at hose"]
    name = closed.added[0].coefficients[0]
    exponent = 1.0 / (1.0 + closed.corrected.values[name])  # of the effort over the flow
    assert exponent == pytest.approx(EXPONENT, abs=4.0 * EXPONENT**2 * closed.corrected.std[name])


def brake(commanded: bool = True) -> bg.BondGraph:
    """A rotor with bearings and a brake, which follows a current."""
    g = bg.BondGraph("brake")
    current = g.input("current", "A")
    rotor = g.one_junction("rotor", bg.ROTATION)
    c, b = g.parameter("c", 0.03, "N m s/A^2"), g.parameter("b", 0.05, "N m s")
    g.inertance("inertia", g.parameter("J", 0.8, "kg m^2"), at=rotor, state="omega")
    g.resistance("bearing", b, at=rotor)
    if commanded:
        g.resistance("brake", lambda w: c * current**2 * w, at=rotor)
    return g


def test_a_brake_falls_beyond_its_critical_speed() -> None:
    """The declared brake, its command with it, over one and the square of speed over critical speed."""
    g = brake()
    place = Place(handle(g, "rotor"), Scale(40.0, 100.0))
    members = [one for one in members_of(effects.critical_speed, g, {}) if one(copy(g), place) is not None]
    assert len(members) == 1  # the bearing follows nothing: eddy_current_drag lies beside it
    effect = members[0](g, place)
    assert effect is not None and effect.element == "brake"
    law = g.nodes["brake"].law("effort")
    assert law is not None
    share = 0.7
    values = {one.symbol: one.value for one in g.parameters} | {sympy.Symbol("current"): 3.0}
    values = {str(key): value for key, value in values.items()} | {effect.coefficients[0]: share}
    for speed in (-150.0, 20.0, 100.0 / np.sqrt(share)):
        own = float(law.subs({one: {**values, "flow": speed}[str(one)] for one in law.free_symbols}))
        assert own == pytest.approx(0.03 * 9.0 * speed / (1.0 + share * (speed / 100.0) ** 2))
    # at the critical speed the brake is at its largest
    peak = 100.0 / np.sqrt(share)
    slope = sympy.diff(law, sympy.Symbol("flow"))
    at_peak = {one: {**values, "flow": peak}[str(one)] for one in slope.free_symbols}
    assert abs(float(slope.subs(at_peak))) < 1e-9
    assert all(one(brake(False), place) is None for one in members_of(effects.critical_speed, brake(False), {}))
