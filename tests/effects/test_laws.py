"""Effects: each adds one element of the right sign and unit, vanishes with its coefficient, and makes sense there."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import BuiltModel, build
from bondgraph.correct.models.bonds import bond_model
from bondgraph.correct.models.candidates import Candidate, candidates
from bondgraph.declare.domains import ELECTRICAL, ROTATION, THERMAL, TRANSLATION
from bondgraph.declare.editing import copy, handle, with_values
from bondgraph.declare.effect import SMOOTHING, Effect, EffectFunction, Place, Scale, effect_functions
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.derive.causality import bond_labels
from bondgraph.effects.catalogue import catalogue, every_effect
from bondgraph.report.missing import law_curve
from bondgraph.simulate.simulation import simulate
from vehicle_graphs.driveline import driveline

LOSSES = (effects.viscous_loss, effects.coulomb_loss, effects.quadratic_loss, effects.torque_proportional_loss)
VANISHING = (effects.constant_effort, *LOSSES, effects.added_inertia)


def place(graph: BondGraph, name: str) -> Place:
    return Place(handle(graph, name), Scale(200.0, 20.0))


def extended(function: EffectFunction, junction: str, value: float) -> tuple[BuiltModel, Effect]:
    graph = driveline()
    effect = function(graph, place(graph, junction))
    assert isinstance(effect, Effect)
    return build(with_values(graph, {effect.coefficients[0]: value})), effect


def points(count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """States and inputs of the driveline all over its range, both directions."""
    rng = np.random.default_rng(3)
    reach = np.array([400.0, 60.0, 0.1, 20.0])[:, np.newaxis]
    return reach * rng.uniform(-1.0, 1.0, (4, count)), rng.uniform(-1.0, 1.0, (2, count)) * np.array([[50.0], [0.1]])


@pytest.mark.parametrize("function", VANISHING, ids=lambda function: function.__name__)
def test_with_a_coefficient_of_zero_the_machine_is_as_before(function: EffectFunction) -> None:
    built, effect = extended(function, "axle", 0.0)
    declared = build(driveline()).model
    x, u = points()
    np.testing.assert_allclose(
        built.model.rhs(0.0, x, u, built.model.theta()), declared.rhs(0.0, x, u, declared.theta()), rtol=1e-10
    )
    info = built.model.parameters[built.model.index("parameter", effect.coefficients[0])]
    assert info.value == 0.0 and info.lower is not None and info.upper is not None and info.upper > 0.0
    assert info.lower == (-info.upper if function is effects.constant_effort else 0.0)


@pytest.mark.parametrize("junction", ["primary", "axle", "body"])
@pytest.mark.parametrize("function", LOSSES, ids=lambda function: function.__name__)
def test_a_loss_takes_energy_whichever_way_the_machine_moves(function: EffectFunction, junction: str) -> None:
    built, effect = extended(function, junction, 0.3)
    labels, model = bond_labels(built.causal), bond_model(built.causal)
    (bond,) = [index for index, label in enumerate(labels) if label.endswith(f"->{effect.element}")]
    x, u = points()
    outputs = model.output(0.0, x, u, model.theta())[len(built.model.outputs) :]
    effort, flow = outputs[bond], outputs[len(labels) + bond]
    assert (effort * flow >= 0.0).all() and (effort * flow).max() > 0.0
    law = {
        effects.viscous_loss: 0.3 * flow,
        effects.coulomb_loss: 0.3 * np.tanh(flow / (SMOOTHING * 20.0)),
        effects.quadratic_loss: 0.3 * flow * np.abs(flow),
    }
    if function in law:
        np.testing.assert_allclose(effort, law[function], rtol=1e-12)
    else:
        assert (np.abs(effort) <= 0.3 * np.abs(outputs[: len(labels)]).max()).all()


def test_a_constant_load_slows_and_a_negative_one_drives() -> None:
    x, u = points()
    declared = build(driveline()).model
    own = declared.rhs(0.0, x, u, declared.theta())
    for load in (30.0, -30.0):
        model = extended(effects.constant_effort, "axle", load)[0].model
        changed = model.rhs(0.0, x, u, model.theta()) - own
        np.testing.assert_allclose(changed[1], -load / 2.5, rtol=1e-6)  # J_axle
        np.testing.assert_allclose(changed[[0, 2, 3]], 0.0, atol=1e-8)


def test_added_inertia_adds_to_the_declared_one() -> None:
    model = extended(effects.added_inertia, "body", 90.0)[0].model
    heavier = build(with_values(driveline(), {"m_vehicle": 690.0, "gravity": 9.81 * 600.0 / 690.0})).model
    x, u = points()
    np.testing.assert_allclose(
        model.rhs(0.0, x, u, model.theta()), heavier.rhs(0.0, x, u, heavier.theta()), rtol=1e-9, atol=1e-9
    )


def elastic(share: float) -> BuiltModel:
    """The driveline with a compliance between wheel and body of a share of the largest."""
    graph = driveline()
    bond = next(bond for bond in graph.bonds if (bond.source, bond.target) == ("wheel", "tyre"))
    effect = effects.added_compliance(graph, Place(handle(graph, "wheel"), Scale(200.0, 20.0), bond))
    assert isinstance(effect, Effect) and effect.adds_state
    (name,) = effect.coefficients
    bounds = next(parameter.bounds for parameter in graph.parameters if parameter.name == name)
    assert bounds is not None
    return build(with_values(graph, {name: share * bounds[1]}))


def test_a_compliance_approaches_the_rigid_machine_as_it_stiffens() -> None:
    time = np.linspace(0.0, 4.0, 81)
    u = np.array([np.where(time < 2.0, 20.0, 45.0), 0.0 * time])
    rigid = simulate(build(driveline()).model, time, u, rtol=1e-8).raise_if_failed().y[3]
    errors = []
    for share in (1e-1, 1e-2, 1e-3):
        built = elastic(share)
        assert len(built.model.states) == 5
        speed = simulate(built.model, time, u, rtol=1e-8).raise_if_failed().y[3]
        errors.append(float(np.abs(speed - rigid).max()))
    assert errors[2] < 0.2 * errors[1] < 0.2 * 0.5 * errors[0]
    assert errors[2] < 1e-2


def test_effects_are_refused_where_they_make_no_sense() -> None:
    graph = BondGraph("mixed")
    hot, wall = graph.one_junction("hot", THERMAL), graph.zero_junction("wall", THERMAL)
    shaft = graph.one_junction("shaft", ROTATION)
    before = copy(graph)
    for function in (effects.coulomb_loss, effects.stribeck_loss, effects.creep, effects.slip, effects.end_stop):
        assert [function(graph, Place(node, Scale(1.0, 1.0))) for node in (hot, wall)] == [None, None]
    assert effects.added_inertia(graph, Place(shaft, Scale(1.0, 1.0))) is None  # nothing is declared to add to
    assert effects.added_compliance(graph, Place(shaft, Scale(1.0, 1.0))) is None
    assert graph == before


@pytest.mark.parametrize(
    ("domain", "units"),
    [
        (TRANSLATION, ("N", "N/(m/s)", "N/(m/s)^2")),
        (ROTATION, ("N m", "N m/(rad/s)", "N m/(rad/s)^2")),
        (None, ("",) * 3),
    ],
)
def test_coefficients_have_the_units_of_their_domain(domain: object, units: tuple[str, ...]) -> None:
    graph = BondGraph("bare")
    at = Place(graph.one_junction("shaft", domain), Scale(8.0, 2.0))  # type: ignore[arg-type]
    found = [function(graph, at) for function in (effects.coulomb_loss, effects.viscous_loss, effects.quadratic_loss)]
    parameters = {parameter.name: parameter for parameter in graph.parameters}
    added = [parameters[effect.coefficients[0]] for effect in found if effect is not None]
    assert tuple(parameter.unit for parameter in added) == units
    assert [parameter.bounds for parameter in added] == [(0.0, 16.0), (0.0, 8.0), (0.0, 4.0)]


def test_the_package_lists_the_effects_of_its_modules() -> None:
    names = [function.__name__ for function in effect_functions(effects)]
    assert len(names) == len(set(names)) == 93
    assert set(names) <= set(every_effect())


EVERYWHERE = [(name, Scale(200.0, 20.0)) for name in ("primary", "belt", "axle", "shaft", "twist", "wheel", "body")]


def everywhere() -> list[Candidate]:
    """Every effect at every junction of the driveline that takes it."""
    graph = driveline()
    where = [Place(handle(graph, name), scale) for name, scale in EVERYWHERE]
    found, _ = candidates(build(graph), effect_functions(effects), where)
    return found


@pytest.fixture(scope="module")
def offered() -> list[Candidate]:
    return everywhere()


def test_every_mechanical_effect_of_junctions_has_one_in_the_driveline(offered: list[Candidate]) -> None:
    names = {candidate.effect.name for candidate in offered}
    mechanical = {row.name for row in catalogue() if row.default and "mechanical" in row.domains}
    # it has no commanded ratio or brake, no spring along a straight way, no motor and no magnet
    elsewhere = {"ratio_lag", "ratio_scale", "air_spring", "gap_dependence", "critical_speed"}
    elsewhere |= {"ratio_by_stroke", "inertia_by_position"}  # nor a spring beside a constant ratio, nor a position
    expected = {row.name for row in catalogue() if row.name in mechanical and row.place[1:] == "-junction"}
    assert names == expected - elsewhere


def test_every_effect_says_where_its_law_comes_from_and_how_large_it_may_be(offered: list[Candidate]) -> None:
    for candidate in offered:
        assert candidate.effect.law and (candidate.effect.reference or candidate.effect.name == "constant_effort")
        for name in candidate.effect.parameters:
            lower, upper = candidate.bounds(name)
            assert lower < upper
            info = candidate.model.parameters[candidate.model.index("parameter", name)]
            assert info.unit and info.meaning


def test_every_effect_vanishes_with_its_coefficients_and_is_felt_with_them(offered: list[Candidate]) -> None:
    declared = build(driveline()).model
    x, u = points()
    own = declared.rhs(0.0, x, u, declared.theta())
    for candidate in (one for one in offered if not one.effect.adds_state):
        model = candidate.model
        rows = [model.index("state", name) for name in declared.names("state")]
        states = np.full((len(model.states), x.shape[1]), 0.5)
        states[rows] = x
        for share in (0.0, 0.2):
            sizes = {name: share * candidate.bounds(name)[1] for name in candidate.effect.coefficients}
            rates = model.rhs(0.0, states, u, model.theta(**sizes))[rows]
            same = np.allclose(rates, own, rtol=1e-9, atol=1e-9)
            assert same == (share == 0.0), candidate.label


def test_friction_that_rises_towards_standstill_is_largest_there() -> None:
    built, effect = extended(effects.stribeck_loss, "axle", 40.0)
    rise, level = effect.coefficients
    (width,) = effect.shapes
    graph = with_values(built.graph, {level: 20.0, width: 4.0})
    law = law_curve(graph, effect.element, {p.name: p.value for p in graph.parameters}, np.array([1.0, 2.0, 8.0, 15.0]))
    assert law is not None and (np.diff(law) < 0.0).all()
    assert law[-1] == pytest.approx(20.0, rel=1e-3) and rise in effect.coefficients


def test_a_headwind_shifts_the_declared_drag() -> None:
    model = extended(effects.headwind, "body", 5.0)[0].model
    declared = build(driveline()).model
    x, u = points()
    shifted = x.copy()
    shifted[3] += 5.0
    drag = 0.6 * (shifted[3] * np.abs(shifted[3]) - x[3] * np.abs(x[3]))
    own = declared.rhs(0.0, x, u, declared.theta())
    np.testing.assert_allclose(model.rhs(0.0, x, u, model.theta())[3], own[3] - drag / 600.0, rtol=1e-9, atol=1e-9)


def test_play_is_taken_up_before_the_spring_carries() -> None:
    built, effect = extended(effects.backlash, "twist", 0.01)
    graph = built.graph
    spring = graph.nodes[effect.element].law("effort")
    assert spring is not None
    known = {symbol("k_shaft"): 4000.0, symbol("gap_backlash_twist"): 0.01}
    way = symbol("displacement")
    efforts = [float(spring.subs({**known, way: q})) for q in (-0.03, -0.005, 0.0, 0.005, 0.03)]
    assert efforts == pytest.approx([-80.0, 0.0, 0.0, 0.0, 80.0], abs=1e-9)


def test_a_lagging_actuator_follows_its_command() -> None:
    built, _ = extended(effects.actuator_lag, "primary", 0.5)
    model = built.model
    (given,) = [name for name in model.names("state") if name.startswith("given")]
    x = model.x0(**{given: 10.0})
    rates = model.rhs(0.0, x, np.array([30.0, 0.0]), model.theta())
    assert rates[model.index("state", given)] == pytest.approx((30.0 - 10.0) / 0.5)


def test_a_late_actuator_gives_what_was_commanded_before() -> None:
    """A machine with a delay of some intervals goes where the one without goes with its command shifted by as many."""
    built, effect = extended(effects.actuator_delay, "primary", 0.48)
    without = build(driveline()).model
    time = np.arange(200) * 0.04
    u = np.stack([30.0 + 8.0 * np.sin(3.0 * time) + np.where(time > 4.0, 9.0, 0.0), 0.02 * np.cos(time)])
    shifted = np.stack([np.concatenate([np.full(12, u[0, 0]), u[0, :-12]]), u[1]])
    late = simulate(built.model, time, u, {effect.coefficients[0]: 0.48}, method="rk4")
    assert effect.adds_state
    assert late.x == pytest.approx(simulate(without, time, shifted, method="rk4").x, rel=1e-12)


@pytest.mark.parametrize(("unit", "acts"), [("V", True), ("1", False)])
def test_a_held_voltage_is_a_command_and_a_held_switch_is_none(unit: str, acts: bool) -> None:
    """Where inputs were held between samples, no actuator's law was tried, and nothing said so."""
    g = BondGraph("amplifier")
    given = g.input("given", unit, hold=True)
    loop = g.one_junction("loop", ELECTRICAL)
    g.effort_source("amplifier", given * g.parameter("gain", 1.0, "V" if unit == "1" else "1"), at=loop)
    assert (effects.actuator_scale(g, Place(loop, Scale(10.0, 1.0))) is not None) is acts


def test_friction_with_hysteresis_settles_at_its_level() -> None:
    built, effect = extended(effects.hysteresis_loss, "primary", 30.0)
    model = built.model
    (bent,) = [name for name in model.names("state") if name.startswith("bent")]
    x = model.x0(**{bent: 1.0})
    rates = model.rhs(0.0, x, np.array([20.0, 0.0]), model.theta())
    assert rates[model.index("state", bent)] == pytest.approx(0.0, abs=1e-12)
    without = model.rhs(0.0, x, np.array([20.0, 0.0]), model.theta(**{effect.coefficients[0]: 0.0}))
    assert (rates - without)[model.index("state", "omega_primary")] == pytest.approx(-30.0 / 0.08)
