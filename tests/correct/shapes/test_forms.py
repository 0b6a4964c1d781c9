"""Laws in a form of their own: their sum as one law, its text and curve, how far it is from its name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import candidates
from bondgraph.correct.places.probes import Signal
from bondgraph.correct.shapes.forms import as_one, curve, departure, joined, own_form, revises, whole_text
from bondgraph.correct.shapes.formula import Formula
from bondgraph.correct.shapes.library import library
from bondgraph.declare.domains import ROTATION
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import SMOOTHING, EffectFunction, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.exponents import resistance_exponent
from bondgraph.effects.friction import coulomb_loss, quadratic_loss
from bondgraph.effects.loads import constant_effort
from bondgraph.effects.storages import hardening_spring

SPEED = Signal("flow of rotor", "rad/s", (np.linspace(-6.0, 6.0, 301),))


def machine() -> BondGraph:
    """A rotor with a bearing, on a spring."""
    g = bg.BondGraph("machine")
    torque = g.input("torque", "N m")
    rotor = g.one_junction("rotor", ROTATION)
    g.effort_source("drive", torque, at=rotor)
    g.inertance("wheel", g.parameter("J", 0.4, "kg m^2", "", (0.1, 2.0)), at=rotor, state="omega")
    g.compliance("spring", g.parameter("k", 30.0, "N m/rad"), at=rotor, state="angle")
    g.resistance("bearing", g.parameter("d", 0.2, "N m s"), at=rotor)
    g.measure_flow("speed", rotor)
    return g


def beside(graph: BondGraph, *functions: EffectFunction) -> list[Trial]:
    """Trials of effects at the rotor, each in a graph with those before it."""
    found = []
    for function in functions:
        (made,), _ = candidates(bg.build(graph), [function], [Place(handle(graph, "rotor"), Scale(10.0, 6.0))])
        found.append(Trial(made, 1.0))
        graph = made.apply(graph)
    return found


def saturation(graph: BondGraph) -> EffectFunction:
    term = next(one for one in library([SPEED], SPEED) if one.kind.name == "saturation")
    return Formula(Place(handle(graph, "rotor"), Scale(10.0, 6.0)), "effort", "N m", (term,), (1.0,)).effect()


def test_laws_of_one_signal_at_one_place_are_one_law() -> None:
    g = machine()
    drag, other, spring = beside(g, quadratic_loss, saturation(g), hardening_spring)
    graph = spring.candidate.apply(other.candidate.apply(drag.candidate.apply(g)))
    assert own_form(drag, other, graph)
    assert not own_form(drag, spring, graph)  # it is one of the angle


def test_a_constant_completes_a_law_but_a_law_no_constant() -> None:
    drag, load = beside(machine(), quadratic_loss, constant_effort)
    graph = load.candidate.apply(drag.candidate.apply(machine()))
    assert own_form(drag, load, graph) and not own_form(load, drag, graph)


def test_a_law_with_its_parts_is_the_same_machine_as_these_one_after_the_other() -> None:
    g = machine()
    first, second = beside(g, quadratic_loss, saturation(g))
    whole = joined(first, second)
    assert whole.candidate.label == "quadratic_loss at rotor" and whole.forms == (first, second)
    assert whole.candidate.effect.parameters == (
        *first.candidate.effect.coefficients, *second.candidate.effect.coefficients, *second.candidate.effect.shapes,
    )  # fmt: skip
    values = {name: 0.3 + 0.1 * k for k, name in enumerate(whole.candidate.effect.parameters)}
    apart = bg.build(second.candidate.apply(first.candidate.apply(g))).model
    together = bg.build(whole.candidate.apply(g)).model
    x, u = np.array([2.0, 0.1]), np.array([1.0])
    np.testing.assert_array_equal(
        together.rhs(0.0, x, u, together.theta(**values)), apart.rhs(0.0, x, u, apart.theta(**values))
    )
    assert not whole.candidate.effect.dissipative  # a part may be negative where the whole is a loss


def test_a_law_of_which_one_part_is_left_is_that_part() -> None:
    g = machine()
    first, second = beside(g, quadratic_loss, saturation(g))
    assert as_one((second,), second.candidate.model) is second
    third = beside(second.candidate.apply(first.candidate.apply(g)), coulomb_loss)[0]
    assert joined(joined(first, second), third).forms == (first, second, third)


def test_its_text_and_its_curve_are_those_of_the_sum() -> None:
    g = machine()
    first, second = beside(g, quadratic_loss, saturation(g))
    whole = joined(first, second)
    graph = whole.candidate.apply(g)
    names = whole.candidate.effect.parameters
    graph = with_values(graph, dict(zip(names, (0.05555555555555555, -0.31234, 1.2345678), strict=True)))
    values = {one.name: one.value for one in graph.flatten().parameters}
    text = whole_text(whole, graph, values, {names[1]: (-0.35, -0.27)})
    assert text == "effort = 0.0556*x*|x| - 0.312*tanh(x/1.23)  [N m], x the speed of rotor"
    at = SPEED.values[0]
    expected = values[names[0]] * at * np.abs(at) + values[names[1]] * np.tanh(at / values[names[2]])
    drawn = curve(whole, graph, values, SPEED, at)
    assert drawn is not None
    np.testing.assert_allclose(drawn, expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("share", [0.0, 0.3, -0.3])
def test_how_far_a_form_is_from_its_name_is_the_sine_of_their_angle(share: float) -> None:
    g = machine()
    first, second = beside(g, quadratic_loss, saturation(g))
    whole = joined(first, second)
    names = whole.candidate.effect.parameters
    graph = with_values(whole.candidate.apply(g), dict(zip(names, (0.2, 2.0 * share, 1.0), strict=True)))
    values = {one.name: one.value for one in graph.flatten().parameters}
    away = departure(whole, graph, values, [SPEED])
    at = SPEED.values[0]
    law, named = 0.2 * at * np.abs(at) + 2.0 * share * np.tanh(at), at * np.abs(at)
    left = law - named * (law @ named) / (named @ named)
    assert away == pytest.approx(np.linalg.norm(left) / np.linalg.norm(law), abs=1e-7)
    assert departure(replace(whole, forms=()), graph, values, [SPEED]) is None


def test_a_form_that_revises_an_element_departs_by_what_it_adds() -> None:
    """A potter's dry bearings with a bent line were "40 % from it", since the declared line counted as added."""
    g = machine()
    first, second = beside(g, coulomb_loss, resistance_exponent)
    whole = joined(first, second)
    (size, bent), (width,) = whole.candidate.effect.coefficients, first.candidate.effect.widths
    for exponent, far in ((0.0, 0.0), (0.5, 0.02)):
        graph = with_values(whole.candidate.apply(g), {size: 2.0, bent: exponent})
        values = {one.name: one.value for one in graph.flatten().parameters}
        away = departure(whole, graph, values, [SPEED])
        assert away is not None and (away == pytest.approx(0.0, abs=1e-7) if far == 0.0 else away > far)
        assert revises(whole, graph, values) and not revises(first, first.candidate.apply(g), values)
    at = SPEED.values[0]
    right = next(value for name, value in values.items() if name.startswith("r_"))
    line = 0.2 * at * (((at / right) ** 2 + SMOOTHING**4) ** 0.25 - 1.0)
    named = np.tanh(at / values[width])
    law = 2.0 * named + line
    left = law - named * (law @ named) / (named @ named)
    assert away == pytest.approx(np.linalg.norm(left) / np.linalg.norm(law), rel=1e-6)


def test_what_acts_in_a_regime_and_what_acts_everywhere_stay_two() -> None:
    g = machine()
    drag, other = beside(g, quadratic_loss, saturation(g))
    graph = other.candidate.apply(drag.candidate.apply(g))
    effect = replace(drag.candidate.effect, regime="speed of rotor is above a level")
    gated = replace(drag, candidate=replace(drag.candidate, effect=effect))
    assert own_form(drag, other, graph) and not own_form(gated, other, graph)
