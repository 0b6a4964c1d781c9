"""Relatives of a law: what draws its curve is found without a run of a filter, and the right one takes its place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.arrays import FloatArray
from bondgraph.build import build
from bondgraph.correct.evidence.context import coefficients
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.loop import LoopSettings, close_loop
from bondgraph.correct.models.candidates import Candidate, candidates
from bondgraph.correct.places.probes import Signal
from bondgraph.correct.shapes.curves import Curve, departure, drawn_law
from bondgraph.correct.shapes.relatives import _SAME, _fitted
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import HYDRAULIC
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale
from bondgraph.effects import eddy_current_drag, hardening_spring, overflow, quadratic_loss, relief, viscous_loss
from bondgraph.filter.filter_model import FilterModel
from bondgraph.report.formulas import twins

PRESSURE = Signal("effort of basin", "Pa", (np.linspace(500.0, 7000.0, 300),))


def basin() -> bg.BondGraph:
    """A basin with a leak that is in proportion to its pressure."""
    g = bg.BondGraph("basin")
    inflow = g.input("inflow", "m^3/s")
    leak = g.parameter("leak", 1e-6, "m^3/s/Pa", "", (1e-7, 1e-5))
    junction = g.zero_junction("basin", HYDRAULIC)
    g.flow_source("pump", inflow, at=junction)
    g.compliance("water", lambda q: 12000.0 * q, at=junction, initial=0.2)
    g.resistance("leakage", flow=lambda p: leak * p, at=junction)
    g.measure_effort("pressure", junction)
    return g


BUILT = build(basin())
PLACE = Place(handle(basin(), "basin"), Scale(7000.0, 0.01))
FOUND: dict[str, Candidate] = {
    one.effect.name: one for one in candidates(BUILT, [overflow, relief], [PLACE])[0]
}  # fmt: skip


def drawn(name: str, curve: Curve) -> tuple[float, dict[str, float]]:
    """The share of a curve that a law of the dictionary leaves, and its numbers."""
    candidate = FOUND[name]
    graph = candidate.apply(basin())
    law = drawn_law(Trial(candidate, 0.0), graph, PRESSURE, None, {})
    assert law is not None
    own = coefficients(candidate, FilterModel(candidate.model, {}, {"pressure": 1.0}, {}))
    share, values = _fitted(law, own, candidate, curve)
    return share, dict(zip(law.names, map(float, values), strict=True))


@settings(max_examples=25, deadline=None)
@given(edge=st.floats(2000.0, 5500.0), size=st.floats(1e-4, 0.05), line=st.floats(-1e-6, 1e-6))
def test_a_law_is_found_again_by_its_curve_whatever_line_is_beside_it(edge: float, size: float, line: float) -> None:
    x = PRESSURE.values[0]
    y = size * (np.maximum(x - edge, 0.0) / 7000.0) ** 1.5 + line * x
    share, values = drawn("overflow", Curve(PRESSURE, x, y))
    assert share < 1e-6
    assert values["e_overflow_basin"] == pytest.approx(edge, rel=1e-3)
    assert values["c_overflow_basin"] == pytest.approx(size, rel=1e-2)


def test_a_law_of_another_form_leaves_more() -> None:
    x = PRESSURE.values[0]
    curve = Curve(PRESSURE, x, 0.02 * (np.maximum(x - 4000.0, 0.0) / 7000.0) ** 1.5)
    assert drawn("overflow", curve)[0] < 1e-6 < 1e-3 < drawn("relief_valve", curve)[0] < 0.1


def test_what_a_line_leaves_has_no_line_in_it() -> None:
    x, y = np.linspace(-1.0, 3.0, 50), np.random.default_rng(2).normal(size=50)
    curve = Curve(PRESSURE, x, y)
    left = curve.rest(y)
    assert left @ x == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(curve.rest(y + 7.0 * x), left, atol=1e-12)
    np.testing.assert_array_equal(Curve(PRESSURE, np.zeros(50), y).rest(y), y)
    np.testing.assert_array_equal(Curve(PRESSURE, x, y, is_bent=False).rest(y), y)


@given(power=st.floats(2.9, 3.1), line=st.floats(-5.0, 5.0))
def test_a_power_near_a_cube_draws_the_curve_of_a_cube(power: float, line: float) -> None:
    x = np.linspace(-2.0, 2.0, 101)
    cube, other = Curve(PRESSURE, x, 0.3 * x**3), Curve(PRESSURE, x, np.sign(x) * np.abs(x) ** power + line * x)
    assert departure(cube, other) < _SAME
    assert departure(cube, Curve(PRESSURE, x, np.sign(x) * np.abs(x) ** 2.5 + line * x)) > _SAME


@given(constant=st.floats(-5.0, 5.0))
def test_a_factor_of_another_signal_is_told_beside_whatever_constant(constant: float) -> None:
    """Of a resistance that grows as a battery empties what is declared may take a constant, and no line."""
    x = np.linspace(0.0, 3.0, 101)
    current = Signal("flow of series", "A", (np.ones(300),))
    factor = np.exp(-x)
    own = Curve(PRESSURE, x, factor, by=current)
    assert own.signals == {PRESSURE.name, current.name}
    assert departure(own, Curve(PRESSURE, x, constant - 2.0 * factor, by=current)) < 1e-12
    assert departure(own, Curve(PRESSURE, x, x, by=current)) > _SAME


def disc() -> bg.BondGraph:
    """A disc with bearings; the brake that acts on it is not declared."""
    g = bg.BondGraph("disc")
    torque = g.input("torque", "N m", hold=True)
    inertia = g.parameter("J", 0.05, "kg m^2", "", (0.01, 0.2))
    b = g.parameter("b", 0.01, "N m s/rad", "", (0.001, 0.3))
    rotor = g.one_junction("rotor", bg.ROTATION)
    g.effort_source("motor", torque, at=rotor)
    g.inertance("mass", inertia, at=rotor, state="w", initial="speed")
    g.resistance("bearings", lambda w: b * w, at=rotor)
    g.measure_flow("speed", rotor)
    return g


def braked(seed: int, samples: int = 700) -> MatchedLog:
    """An eddy-current brake by scipy: 4.2 N m at 62 rad/s, less below and above."""
    rng, step = np.random.default_rng(seed), 0.05
    time = step * np.arange(samples)
    torque = np.repeat(rng.uniform(0.0, 7.0, samples // 50 + 1), 50)[:samples]

    def rate(t: float, w: FloatArray) -> FloatArray:
        slip = w / 62.0
        return (torque[min(int(t / step + 1e-9), samples - 1)] - 0.02 * w - 8.4 * slip / (1.0 + slip**2)) / 0.06

    run = solve_ivp(rate, (0.0, time[-1]), [20.0], t_eval=time, rtol=1e-8, atol=1e-8, max_step=step)
    return MatchedLog(f"run{seed}", time, torque[np.newaxis], run.y + 0.1 * rng.standard_normal(samples))


@pytest.mark.slow
def test_a_brake_that_fades_at_speed_is_one_term_and_no_sum_of_others() -> None:
    """Before: four terms, a square and a fifth power among them, that drew the curve together."""
    found = close_loop(
        disc(),
        [braked(1), braked(2)],
        [braked(9)],
        (viscous_loss, quadratic_loss, hardening_spring),
        LoopSettings(faults=False),
    )
    assert [one.trial.candidate.label for one in found.added] == ["formula_hump_of_flow_of_rotor at rotor"]
    values = found.corrected.values
    assert (values["reach_hump_rotor"], values["c_hump_rotor"], values["J"]) == pytest.approx(
        (62.0, 4.2, 0.06), rel=2e-3
    )


@pytest.mark.slow
def test_a_formula_that_says_a_law_in_other_words_is_no_rival_of_it() -> None:
    """A brake was "eddy_current_drag or formula (hump), which these data do not tell apart"."""
    functions = (viscous_loss, quadratic_loss, eddy_current_drag)
    found = close_loop(disc(), [braked(1), braked(2)], [braked(9)], functions, LoopSettings(faults=False))
    (law,) = found.added
    assert law.trial.candidate.label == "eddy_current_drag at rotor"
    assert twins(found, law) == []
