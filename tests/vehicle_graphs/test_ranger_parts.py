"""The Ranger's parts: what causality finds in them, and exchanging them one by one."""

from __future__ import annotations

import numpy as np
import pytest
import sympy

from bondgraph.build import BuiltModel, build
from bondgraph.declare.editing import with_values
from bondgraph.declare.files import graph_from_json, graph_to_json
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import Derivation
from bondgraph.derive.equations import ImplicitLoop
from bondgraph.derive.explicit import equations_json, explicit
from bondgraph.errors import DeclarationError
from bondgraph.report.evaluate import evaluate
from bondgraph.simulate.model import Model
from bondgraph.simulate.scenario import Scenario
from bondgraph.simulate.simulation import simulate
from bondgraph.simulate.trajectory import Trajectory
from vehicle_graphs import tyres
from vehicle_graphs.clutches import primary_clutch
from vehicle_graphs.engine import mapped_engine
from vehicle_graphs.ranger import SCENARIOS, coast_down, coast_down_quasi_static, full, full_awd
from vehicle_graphs.tyres import Tyre

LAWS = (tyres.slip_velocity_tyre, tyres.brush_tyre, tyres.pacejka_tyre, tyres.relaxation_tyre)

STATES = {
    "engine_speed", "sheave_displacement", "rear_axle_speed", "front_axle_speed", "forward_velocity", "heave",
    "heave_rate", "pitch", "pitch_rate", "height", "inclination",
}  # fmt: skip


DRIVING = {
    "engine_speed": 480.0, "sheave_displacement": 0.012, "rear_axle_speed": 26.0, "front_axle_speed": 25.0,
    "forward_velocity": 7.9, "heave": -0.01, "heave_rate": 0.1, "pitch": 0.01, "pitch_rate": -0.2, "inclination": 0.1,
}  # fmt: skip
OVERRUN = {**DRIVING, "engine_speed": 300.0}


def drive(model: Model, scenario: Scenario, duration: float) -> Trajectory:
    times = np.arange(0.0, duration, 0.05)
    run = simulate(model, times, scenario.signal(model), x0=scenario.start(model), rtol=1e-6)
    return run.raise_if_failed()


# ---------------------------------------------------------------------- what causality finds


def test_states_have_the_names_that_scripts_use() -> None:
    assert set(build(full()).model.names("state")) == STATES
    assert set(build(coast_down()).model.names("state")) == STATES - {"engine_speed", "sheave_displacement"}
    bare = {"rear_axle_speed", "front_axle_speed", "forward_velocity", "height", "inclination"}
    assert set(build(coast_down_quasi_static()).model.names("state")) == bare


def test_geared_inertias_are_dependent_storages() -> None:
    assert assign_causality(full()).derivative == (("gearbox.secondary", 1),)
    assert assign_causality(full_awd()).derivative == (("front_axle.inertia", 1), ("gearbox.secondary", 1))


def test_belt_and_helix_are_an_algebraic_loop_that_is_solved_in_closed_form() -> None:
    derivation = Derivation(assign_causality(full()))
    equations = derivation.equations()
    loops = [loop.torn for loop in derivation.loops if not loop.of_rates and len(loop.torn) == 1]
    assert ("F_belt.belt",) in loops
    iterated = [step.unknowns for step in equations.assignments if isinstance(step, ImplicitLoop)]
    assert [str(unknown) for (unknown,) in iterated] == ["r_s"]


def test_explicit_equations_name_the_loop_and_stay_short() -> None:
    derivation = Derivation(assign_causality(full()))
    answer = equations_json(derivation, derivation.equations())
    assert answer["causality"]["loops"] == [["belt.traction"]]
    assert max(map(len, answer["derivatives"].values())) < 10_000


@pytest.mark.slow
def test_explicit_equations_give_the_derivatives() -> None:
    derivation = Derivation(assign_causality(full()))
    equations = derivation.equations()
    values: dict[sympy.Expr, float] = {symbol(p.name): p.value for p in equations.parameters}
    values |= {symbol(i.name): {"throttle": 0.4, "gear": 10.0}.get(i.name, 0.0) for i in equations.inputs}
    values |= {symbol(state.symbol.name): DRIVING.get(state.symbol.name, 0.0) for state in equations.states}
    answer = evaluate(full(), [{"states": DRIVING, "inputs": {"throttle": 0.4}}])[0]
    values[symbol("r_s")] = answer["signals"]["r_s"]

    def number(value: sympy.Expr) -> float:
        modules = [{"minimum": min, "maximum": max}, "math"]
        return float(sympy.lambdify(list(values), value, modules, dummify=True)(*values.values()))

    written = explicit(equations)
    for loop in written.implicit:
        for unknown, residual in zip(loop.unknowns, loop.residuals, strict=True):
            if unknown not in values:
                values[unknown] = number(unknown - residual)
    for state, value in written.derivatives:
        assert number(value) == pytest.approx(answer["derivatives"][state.name], rel=1e-9, abs=1e-9), state.name


def test_loads_of_the_quasi_static_suspension_and_tyre_forces_are_a_loop_in_closed_form() -> None:
    derivation = Derivation(assign_causality(coast_down_quasi_static()))
    equations = derivation.equations()
    assert [loop.linear for loop in derivation.loops] == [True]
    assert not any(isinstance(step, ImplicitLoop) for step in equations.assignments)


def test_the_declared_vehicle_survives_its_file() -> None:
    assert graph_from_json(graph_to_json(full())) == full()


def test_a_state_and_an_output_of_the_same_name_are_kept_apart() -> None:
    point = {"states": {"pitch": 0.02, "inclination": 0.05}, "parameters": {"th_off": 0.001}}
    answer = evaluate(full(), [point])[0]
    assert answer["outputs"]["pitch"] == pytest.approx(0.071)
    assert answer["derivatives"]["pitch"] == 0.0  # the pitch rate, not that of the measured pitch


# ---------------------------------------------------------------------- neutral, all-wheel drive


def test_in_neutral_the_secondary_stands_and_revving_only_slips_the_belt() -> None:
    states = {"engine_speed": 400.0, "rear_axle_speed": 20.0, "forward_velocity": 6.3, "front_axle_speed": 20.0}
    rolling = {**states, "sheave_displacement": 0.001}
    idle, revved = evaluate(
        full(), [{"states": {**rolling, "engine_speed": w}, "inputs": {"gear": "N"}} for w in (130.0, 400.0)]
    )
    assert revved["signals"]["F_b"] > 100 > idle["signals"]["F_b"]
    assert revved["signals"]["flow(gearbox.shaft)"] == 0
    assert revved["derivatives"]["rear_axle_speed"] == idle["derivatives"]["rear_axle_speed"]


def test_all_wheel_drive_has_the_inertia_of_both_axles_and_drives_both() -> None:
    states = {"engine_speed": 500.0, "rear_axle_speed": 12.0, "forward_velocity": 3.6, "sheave_displacement": 0.002}
    answer = evaluate(full_awd(), [{"states": states}])[0]
    signals = answer["signals"]
    torque = 0.95 * 10 * signals["F_b"] * signals["r_s"] - 0.315 * (signals["F_xf"] + signals["F_xr"])
    rolling = 0.035 * 0.315 * (signals["N_f"] + signals["N_r"])
    assert answer["derivatives"]["rear_axle_speed"] == pytest.approx((torque - rolling) / (4.0 + 100 * 0.03), rel=1e-9)
    assert signals["F_xf"] > 0 and signals["flow(front_axle.hub)"] == 12.0


# ---------------------------------------------------------------------- power


@pytest.mark.parametrize("states", [DRIVING, OVERRUN])
def test_what_the_sources_supply_is_stored_or_dissipated(states: dict[str, float]) -> None:
    flat = full().flatten()
    bonds = evaluate(full(), [{"states": states, "inputs": {"throttle": 0.4, "brake": 0.1}}])[0]["bonds"]
    into: dict[str, float] = {"Se": 0.0, "I": 0.0, "C": 0.0, "R": 0.0}
    for label, values in bonds.items():
        ends = label.partition("#")[0].split("->")
        for end, sign in zip(ends, (-1, 1), strict=True):
            kind = flat.nodes[end].kind
            into[kind] = into.get(kind, 0.0) + sign * values["effort"] * values["flow"]
    assert -into["Se"] == pytest.approx(into["I"] + into["C"] + into["R"], rel=1e-12)
    assert into["R"] > 0


def test_mesh_loss_takes_power_in_drive_and_feeds_the_vehicle_in_overrun() -> None:
    drive, overrun = evaluate(full(), [{"states": states} for states in (DRIVING, OVERRUN)])
    for answer, sign in ((drive, -1), (overrun, 1)):
        bond, signals = answer["bonds"]["gearbox.mesh_loss->gearbox.output"], answer["signals"]
        power = bond["effort"] * bond["flow"]
        assert power == pytest.approx(
            -0.05 * signals["F_b"] * signals["r_s"] * signals["flow(gearbox.shaft)"], rel=1e-12
        )
        assert np.sign(power) == sign


# ---------------------------------------------------------------------- exchanging parts


def test_a_dynamometer_map_replaces_the_formula() -> None:
    throttles, speeds = (0.0, 0.15, 0.55, 1.0), (130.0, 260.0, 480.0, 690.0, 716.0)
    points = [{"states": {"engine_speed": w}, "inputs": {"throttle": u}} for u in throttles for w in speeds]
    formula, mapped = (evaluate(graph, points) for graph in (full(), full(engine=mapped_engine)))
    for a, b in zip(formula, mapped, strict=True):
        assert b["signals"]["T_e"] == pytest.approx(a["signals"]["T_e"], abs=0.4)


def test_a_part_is_exchanged_in_a_declared_graph() -> None:
    g = full()
    g.exchange("engine", mapped_engine())
    assert g == full(engine=mapped_engine)


@pytest.mark.parametrize("tyre", LAWS)
def test_tyre_laws_agree_for_small_slip(tyre: Tyre) -> None:
    v, slip = 10.0, 1e-4
    speeds = {"forward_velocity": v, "rear_axle_speed": v * (1 + slip) / 0.315, "front_axle_speed": v / 0.315}
    if tyre is tyres.relaxation_tyre:
        speeds["tyre_slip_r"] = slip
    parameters = {"K": 10.0 * 1200 * 9.81 * 1.26 / 2.05 / v} if tyre is tyres.slip_velocity_tyre else {}
    force = evaluate(coast_down(tyre), [{"states": speeds, "parameters": parameters}])[0]["signals"]["F_xr"]
    assert force == pytest.approx(10.0 * slip * 1200 * 9.81 * 1.26 / 2.05, rel=1e-2)


@pytest.mark.parametrize("tyre", LAWS)
def test_tyre_laws_saturate_at_the_friction(tyre: Tyre) -> None:
    spinning = {"forward_velocity": 2.0, "rear_axle_speed": 60.0, "front_axle_speed": 2.0 / 0.315}
    if tyre is tyres.relaxation_tyre:
        spinning["tyre_slip_r"] = 0.9
    answer = evaluate(coast_down(tyre), [{"states": spinning}])[0]["signals"]
    share = 0.6 if tyre is tyres.pacejka_tyre else 0.9  # of the peak, beyond which the magic formula falls
    assert share * 0.65 * answer["N_r"] < answer["F_xr"] <= 0.65 * answer["N_r"]


def test_slip_builds_up_over_the_relaxation_length() -> None:
    model = build(coast_down(tyres.relaxation_tyre)).model
    start = Scenario("", 1.0, {"brake": 0.3}, {**SCENARIOS["neutral_coast_down"].initial})
    run = drive(model, start, 1.0)
    assert run.state("tyre_slip_r")[0] == 0.0
    assert -0.2 < run.state("tyre_slip_r")[-1] < -0.005


def test_quasi_static_suspension_pitches_at_once_and_by_the_stiffness_of_its_springs() -> None:
    rolling = {"forward_velocity": 10.0, "rear_axle_speed": 31.0, "front_axle_speed": 31.0}
    point = {"states": rolling, "inputs": {"brake": 0.4}}
    answer = evaluate(coast_down_quasi_static(), [point])[0]["signals"]
    thrust = answer["F_xf"] + answer["F_xr"]
    assert answer["pitch"] == pytest.approx(thrust * 0.6 / (1.26**2 * 41e3 + 0.79**2 * 75e3), rel=1e-12)
    assert answer["S_f"] + answer["S_r"] == pytest.approx(1200 * 9.81, rel=1e-12)
    assert 1.26 * answer["S_f"] - 0.79 * answer["S_r"] + 0.6 * thrust == pytest.approx(0.0, abs=1e-6)


def coasting(graph: BondGraph) -> tuple[BuiltModel, Trajectory]:
    built = build(graph)
    return built, drive(built.model, SCENARIOS["neutral_coast_down"], 20.0)


def test_reduced_coast_down_models_coast_as_the_whole_vehicle_does() -> None:
    whole = coasting(full())[1].state("forward_velocity")[-1]
    assert coasting(coast_down())[1].state("forward_velocity")[-1] == pytest.approx(whole, abs=1e-4)
    assert coasting(coast_down_quasi_static())[1].state("forward_velocity")[-1] == pytest.approx(whole, abs=0.02)


# ---------------------------------------------------------------------- impossible vehicles


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"m": -1200.0}, "a body without positive mass does not obey a force: m = -1200 kg"),
        ({"J_e": 0.0}, "an engine without positive inertia does not obey a torque"),
        ({"k_f": -41e3}, "a spring without positive rate does not carry the body"),
        ({"a": -0.1}, "the centre of mass lies between the axles"),
        ({"r_s0": 0.25}, "the belt is longer than the geometry allows: its pulleys would overlap"),
        ({"r_s0": 0.05}, "the whole travel of the sheave would pull it off the secondary"),
        ({"x_max": 0.15}, "the sheave closes beyond its pulley"),
        ({"x_max": -0.01}, "the upper stop of the sheave lies above the lower one"),
        ({"T_pk": 500.0}, "outside its bounds"),
    ],
)
def test_an_impossible_vehicle_is_refused_with_the_reason(values: dict[str, float], reason: str) -> None:
    with pytest.raises(DeclarationError, match=reason):
        with_values(full(), values)


def test_a_sheave_cannot_start_beyond_its_stops() -> None:
    with pytest.raises(DeclarationError, match=r"starts at 50 mm, beyond its stops at 0 and 29\.6 mm"):
        primary_clutch(0.05)
