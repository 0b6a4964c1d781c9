"""Candidates: where effects are offered, which are refused and why, and the one model that holds them all."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from sympy import tanh

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.evidence.context import coefficients
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Effect, Place, Scale, effect_functions
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_law
from bondgraph.errors import DeclarationError, EstimationError, OptionError
from bondgraph.estimate.setup import filter_setup
from bondgraph.filter.runs import run
from tests.correct.sled import built, fitted, pull, sled
from vehicle_graphs.driveline import driveline


@pytest.fixture(scope="module")
def where() -> list[Place]:
    log = pull(sled(), 1)
    base = fitted([log])
    return places(built(), [log], base.runs([log]), base.theta)


def test_places_have_the_sizes_that_the_logs_show(where: list[Place]) -> None:
    scale = {place.label: place.scale for place in where}
    assert scale["drum"].flow == pytest.approx(scale["runner"].flow / 0.3, rel=1e-9)
    assert scale["drum"].effort == pytest.approx(45.0, rel=0.1)
    assert {"drum", "runner", "drum -> rope"} <= set(scale)


def test_a_place_without_motion_is_left_out() -> None:
    graph = sled()
    brake = graph.one_junction("brake", TRANSLATION)
    graph.flow_source("clamp", 0, at=brake)
    graph.resistance("lining", graph.parameter("c_lining", 5.0, "N s/m"), at=brake)
    own = build(graph)
    log = pull(sled(), 1)
    setup = filter_setup(own.model, own.driven, [log])
    found = places(own, [log], [run(setup.filter_model, log)], own.model.theta())
    assert "runner" in [place.label for place in found]
    assert "brake" not in [place.label for place in found]


def test_no_place_is_left_where_nothing_moves() -> None:
    log = pull(sled(), 1)
    still = MatchedLog("still", log.time, 0.0 * log.u, 0.0 * log.y)
    own = built()
    setup = filter_setup(own.model, own.driven, [log])
    filtered = run(setup.filter_model, still, x0=np.zeros(1))
    filtered = dataclasses.replace(filtered, filtered_mean=0.0 * filtered.filtered_mean)
    assert places(own, [still], [filtered], own.model.theta()) == []


def test_candidates_with_zero_coefficients_are_the_declared_model(where: list[Place]) -> None:
    found, _ = candidates(built(), effect_functions(effects), where)
    rng, own = np.random.default_rng(0), built().model
    x, u = rng.uniform(0.5, 4.0, (1, 50)), rng.uniform(0.0, 45.0, (1, 50))
    declared, shown = own.rhs(0.0, x, u, own.theta()), own.output(0.0, x, u, own.theta())
    for wide in (candidate.model for candidate in found if not candidate.effect.adds_state):
        assert set(own.names("parameter")) < set(wide.names("parameter"))
        row = wide.index("state", "v_sled")
        states = rng.uniform(-1.0, 1.0, (len(wide.states), 50))  # effects with a memory bring states of their own
        states[row] = x
        np.testing.assert_allclose(wide.rhs(0.0, states, u, wide.theta())[[row]], declared, rtol=1e-12)
        np.testing.assert_allclose(wide.output(0.0, states, u, wide.theta()), shown, rtol=1e-12)


def test_effects_of_the_demo_are_offered_where_they_make_sense() -> None:
    graph = driveline()
    own = build(graph)
    junctions = {name: node for name, node in graph.nodes.items() if node.is_junction}
    where = [Place(Handle(name, node.kind, node.domain), Scale(100.0, 10.0)) for name, node in junctions.items()]
    found, refused = candidates(own, effect_functions(effects), where)
    labels = {candidate.label for candidate in found}
    assert "added_inertia at body" in labels and "added_inertia at wheel" not in labels  # nothing to add to
    assert {"torque_proportional_loss at axle", "torque_proportional_loss at primary"} <= labels  # also where it leaves
    assert {label for label in labels if label.endswith(("at belt", "at shaft"))} == {  # no common flow there
        "creep at belt", "creep at shaft", "slip at belt", "slip at shaft", "centrifugal_tension at belt",
        "resistance_by_input at belt",
    }  # fmt: skip
    assert not refused
    first = next(candidate for candidate in found if candidate.label == "viscous_loss at body")
    assert first.passive and first.beside_storage
    other = next(candidate for candidate in found if candidate.label == "constant_effort at wheel")
    assert not other.passive and not other.beside_storage


def test_what_is_present_is_not_offered_again(where: list[Place]) -> None:
    found, _ = candidates(built(), [effects.viscous_loss], where, {("viscous_loss", "drum")})
    assert [candidate.label for candidate in found] == ["viscous_loss at runner"]


def growing(g: BondGraph, at: Place) -> Effect | None:
    """A loss that grows with the square of what the shaft carries, itself included."""
    share = g.parameter("share", 0.0, "1/(N m)", "growth of the loss", (0.0, 1.0))
    drag = g.parameter("drag", 1.0, "rad/s", "speed of full loss")
    carried = Handle("shaft", "0", at.domain).effort
    g.resistance("growing", lambda flow: share * carried**2 * tanh(flow / drag), at=at.junction)
    return Effect("growing", "growing", "", ("share",))


def yielding(g: BondGraph, at: Place) -> Effect | None:
    """A storage beside a loss that grows with what the shaft carries."""
    effect = growing(g, at)
    assert effect is not None
    size = g.parameter("size", 1.0, "s", "lag", (0.1, 10.0))
    g.integral("late", lambda x: (at.junction.flow - x) / size, "rad/s", "late flow")
    return dataclasses.replace(effect, coefficients=("size",), adds_state=True)


def test_an_effect_may_close_a_nonlinear_loop_unless_it_brings_a_storage() -> None:
    """Slip of a belt whose friction follows its slip closes one: the flow decides the effort that decides the flow."""
    own, place = build(driveline()), Place(handle(driveline(), "twist"), Scale(100.0, 10.0))
    (found,), refused = candidates(own, [growing, yielding], [place])
    assert [no.why for no in refused] == ["would close a nonlinear algebraic loop around a storage of unknown size"]
    x, u = np.array([120.0, 20.0, 0.02, 5.5]), np.array([40.0, 0.01])
    absent, present = (found.model.rhs(0.0, x, u, found.model.theta(share=share)) for share in (0.0, 1e-3))
    np.testing.assert_allclose(absent, own.model.rhs(0.0, x, u, own.model.theta()), rtol=1e-9)
    assert np.abs(present - absent).max() > 1e-3


def broken(g: BondGraph, at: Place) -> Effect | None:
    return Effect("broken", "x", "", (str(1 / 0),))


def misnamed(g: BondGraph, at: Place) -> Effect | None:
    g.effort_source(f"push_{at.name}", g.parameter(f"load_{at.name}", 0.0, ""), at=at.junction)
    return Effect("misnamed", f"push_{at.name}", "", (f"loads_{at.name}",))


def numeric(g: BondGraph, at: Place) -> Effect | None:
    g.resistance(f"drag_{at.name}", lambda v: g.parameter(f"load_{at.name}", 0.0, "") * np.tanh(v), at=at.junction)
    return Effect("numeric", f"drag_{at.name}", "", (f"load_{at.name}",))


def unbounded(g: BondGraph, at: Place) -> Effect | None:
    if at.bond is not None:
        return None
    g.effort_source(f"push_{at.name}", g.parameter(f"load_{at.name}", 0.0, ""), at=at.junction)
    return Effect("unbounded", f"push_{at.name}", "effort = load", (f"load_{at.name}",))


def lasting(g: BondGraph, at: Place) -> Effect | None:
    g.effort_source(f"push_{at.name}", g.parameter(f"load_{at.name}", 3.0, "", "", (1.0, 5.0)), at=at.junction)
    return Effect("lasting", f"push_{at.name}", "effort = load", (f"load_{at.name}",))


def crowded(g: BondGraph, at: Place) -> Effect | None:
    return Effect("crowded", "none", "", ())


def test_an_effect_function_that_fails_is_named(where: list[Place]) -> None:
    with pytest.raises(OptionError, match=r"effect function broken failed at drum: ZeroDivisionError: .* - mend it"):
        candidates(built(), [broken], where)
    with pytest.raises(OptionError, match=r"names the coefficient 'loads_drum' .*; did you mean 'load_drum'\?"):
        candidates(built(), [misnamed], where)
    with pytest.raises(OptionError, match=r"effect function numeric failed at drum: LawError: .* use sympy's tanh"):
        candidates(built(), [numeric], where)


def test_an_effect_that_cannot_be_tested_is_refused_with_the_reason(where: list[Place]) -> None:
    place = [one for one in where if one.label == "drum"]
    _, (first, second) = candidates(built(), [lasting, crowded], place)
    assert first.why == "does not vanish: its coefficient is 3 when it is added, not 0"
    assert second.why == "has no coefficient that could be tested"


def test_a_coefficient_without_bounds_is_an_error(where: list[Place]) -> None:
    (candidate, *_), _ = candidates(built(), [unbounded], where)
    setup = filter_setup(candidate.model, built().driven, [pull(sled(), 1)])
    with pytest.raises(EstimationError, match=r"unbounded at drum: its coefficient load_drum has no bounds"):
        coefficients(candidate, setup.filter_model)


def oscillator() -> BondGraph:
    g = BondGraph("oscillator")
    body = g.one_junction("body", TRANSLATION)
    g.effort_source("push", g.input("push_force", "N"), at=body)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body)
    g.compliance("spring", g.parameter("k", 50.0, "N/m", "", (10.0, 100.0)), at=body)
    g.resistance("damper", g.parameter("c", 1.0, "N s/m", "", (0.1, 5.0)), at=body)
    g.measure_flow("speed", body)
    return g


def hardening(g: BondGraph, at: Place) -> Effect | None:
    """A spring that grows stiffer: the law of the declared one is no line any more."""
    if at.junction.name != "body" or at.bond is not None:
        return None
    k3 = g.parameter("k3", 0.0, "N/m^3", "", (0.0, 1e4))
    revise_law(g, "spring", "effort", lambda old: old + k3 * symbol("displacement") ** 3)
    return Effect("hardening", "spring", "effort = k*q + k3*q^3", ("k3",))


def test_backlash_after_a_law_that_bends_its_spring_is_refused_in_words() -> None:
    """Applied there it returned None, and a refit ended with "no parameter 'gap_backlash_body'"."""
    graph = oscillator()
    own = build(graph)
    found, _ = candidates(own, [hardening, effects.backlash], [Place(handle(graph, "body"), Scale(9.0, 9.0))])
    assert [one.effect.name for one in found] == ["hardening", "backlash"]
    with pytest.raises(DeclarationError, match="backlash at body does not fit beside what was added before"):
        found[1].apply(found[0].apply(graph))
