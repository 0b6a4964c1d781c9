"""Couplings that slip, motors whose constant falls with the current, gas that is compressed: by hand, and found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.build import BuiltModel, build
from bondgraph.correct.models.bonds import bond_model
from bondgraph.data.log import FloatArray
from bondgraph.declare.editing import handle, with_bounds, with_values
from bondgraph.declare.effect import Effect, Place, Scale
from bondgraph.derive.causality import bond_labels
from bondgraph.effects.actuators import armature_reaction, modulus_fading
from bondgraph.effects.between import coupling_slip
from bondgraph.effects.vessels import COMPRESSED, gas_storage
from bondgraph.simulate.simulation import simulate
from tests.effects.machines.machine import Machine, Rates, steps

# ---------------------------------------------------------------------- a coupling


def shafts() -> bg.BondGraph:
    """A motor that turns a mixer through a coupling."""
    g = bg.BondGraph("shafts")
    torque = g.input("torque", "N m", "motor")
    load = g.input("load", "N m", "brake")
    motor, mixer = g.one_junction("motor", bg.ROTATION), g.one_junction("mixer", bg.ROTATION)
    g.effort_source("drive", torque, at=motor)
    g.inertance("rotor", g.parameter("J", 0.2, "kg m^2"), at=motor, state="omega")
    g.bond(motor, mixer)
    g.inertance("drum", g.parameter("J_2", 1.1, "kg m^2", "drum", (0.3, 3.0)), at=mixer)
    g.resistance("oil", g.parameter("d", 0.25, "N m s/rad", "bearings", (0.05, 1.0)), at=mixer)
    g.effort_source("brake", -load, at=mixer)
    g.measure_flow("motor_speed", motor, "speed of the motor")
    g.measure_flow("mixer_speed", mixer, "speed of the mixer")
    return g


def slipping(c: float, most: float) -> tuple[BuiltModel, Effect]:
    g = shafts()
    (bond,) = [one for one in g.bonds if (one.source, one.target) == ("motor", "mixer")]
    effect = coupling_slip(g, Place(handle(g, "motor"), Scale(20.0, 60.0), bond))
    assert effect is not None and effect.adds_state
    wide = with_bounds(g, {effect.coefficients[0]: (1e-6, 10.0)})
    return build(with_values(wide, {effect.coefficients[0]: c, effect.shapes[0]: most})), effect


def second_speed(built: BuiltModel) -> str:
    (name,) = set(built.model.names("state")) - {"omega"}
    return name


@pytest.mark.parametrize("slip", [-9.0, -0.02, 0.4, 30.0])
def test_a_coupling_transmits_in_proportion_to_little_slip_and_no_more_than_its_most(slip: float) -> None:
    built, _ = slipping(0.1, 14.0)
    model = built.model
    x = model.x0(**{"omega": 50.0 + slip, second_speed(built): 50.0})
    rates = model.rhs(0.0, x, np.zeros(2), model.theta())
    transmitted = -0.2 * rates[model.index("state", "omega")]
    assert transmitted == pytest.approx(10.0 * slip / np.hypot(1.0, 10.0 * slip / 14.0), rel=1e-12)
    drum = 1.1 * rates[model.index("state", second_speed(built))]
    assert drum == pytest.approx(transmitted - 0.25 * 50.0, rel=1e-12)
    assert abs(transmitted) < 14.0 and transmitted * slip > 0.0


def test_a_coupling_without_slip_is_the_rigid_machine() -> None:
    time = np.linspace(0.0, 4.0, 81)
    u = np.array([np.where(time < 2.0, 12.0, 4.0), 1.0 + time])
    rigid = simulate(build(shafts()).model, time, u, rtol=1e-8).raise_if_failed().y[1]
    away = []
    for c in (1e-2, 1e-3, 1e-4):
        shown = simulate(slipping(c, 200.0)[0].model, time, u, rtol=1e-8).raise_if_failed().y[1]
        away.append(float(np.abs(shown - rigid).max()))
    assert away[2] < 0.2 * away[1] < 0.2 * 0.2 * away[0]
    assert away[2] < 1e-3


def test_a_coupling_only_dissipates() -> None:
    built, effect = slipping(0.3, 11.0)
    labels, model = bond_labels(built.causal), bond_model(built.causal)
    (bond,) = [k for k, label in enumerate(labels) if label.endswith(f"->{effect.element}")]
    chance = np.random.default_rng(4)
    x, u = chance.uniform(-80.0, 80.0, (2, 100)), chance.uniform(-20.0, 20.0, (2, 100))
    outputs = model.output(0.0, x, u, model.theta())[len(built.model.outputs) :]
    assert np.all(outputs[bond] * outputs[len(labels) + bond] > 0.0)


def test_a_coupling_is_between_two_speeds_alone() -> None:
    g = shafts()
    assert coupling_slip(g, Place(handle(g, "motor"), Scale(20.0, 60.0))) is None
    (bond,) = [one for one in g.bonds if one.target == "oil"]
    assert coupling_slip(g, Place(handle(g, "mixer"), Scale(20.0, 60.0), bond)) is None


def coupling_rates(effect: bool) -> Rates:
    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        if not effect:
            return [(u[0] - u[1] - 0.3 * x[1]) / 1.1, (u[0] - u[1] - 0.3 * x[1]) / 1.1]
        passed = 18.0 * np.tanh((x[0] - x[1]) / 5.0)
        return [(u[0] - passed) / 0.2, (passed - u[1] - 0.3 * x[1]) / 0.9]

    return rates


def coupling_inputs(time: FloatArray, chance: np.random.Generator) -> FloatArray:
    return np.array([steps(time, chance, 6.0, 15.0, 1.0), steps(time, chance, 0.0, 4.0, 1.4)])


COUPLING = Machine(
    shafts, coupling_rates, (0.0, 0.0), lambda x, u, effect: x, (0.1, 0.1), coupling_inputs, 0.02, 800,
    frozenset({"coupling_slip at motor -> mixer"}), effect="slip under a torque of 18*tanh(slip/5)",
)  # fmt: skip

# ---------------------------------------------------------------------- a motor


def servo(turned: bool = False) -> bg.BondGraph:
    """A direct-current motor that turns a wheel; ``turned``: its gyrator is declared from the wheel."""
    g = bg.BondGraph("servo")
    voltage, load = g.input("voltage", "V", "amplifier"), g.input("load", "N m", "brake")
    k = g.parameter("k", 0.05, "N m/A", "constant of the motor")
    loop, wheel = g.one_junction("loop", bg.ELECTRICAL), g.one_junction("wheel", bg.ROTATION)
    g.effort_source("amplifier", voltage, at=loop)
    g.resistance("wire", g.parameter("R", 0.7, "ohm", "wire", (0.3, 2.0)), at=loop)
    g.inertance("coil", g.parameter("L", 2e-3, "H"), at=loop, state="i")
    ends = (wheel, loop) if turned else (loop, wheel)
    g.gyrator("motor", -k if turned else k, *ends)
    g.inertance("rotor", g.parameter("J", 2e-4, "kg m^2", "rotor", (5e-5, 1e-3)), at=wheel, state="omega")
    g.resistance("bearing", g.parameter("d", 2e-4, "N m s", "bearing", (2e-5, 2e-3)), at=wheel)
    g.effort_source("brake", -load, at=wheel)
    g.measure_flow("current", loop, "current")
    g.measure_flow("speed", wheel, "speed of the wheel")
    return g


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("current", [-12.0, 3.0, 25.0])
@pytest.mark.parametrize("power", [1.0, 2.0])
def test_torque_and_voltage_of_a_motor_fall_alike(turned: bool, current: float, power: float) -> None:
    g = servo(turned)
    effect = modulus_fading(g, Place(handle(g, "loop"), Scale(12.0, 10.0)))
    assert effect is not None
    weak = build(with_values(g, {effect.coefficients[0]: (10.0 / 22.0) ** power, effect.widths[0]: power}))
    model, declared = weak.model, build(servo(turned)).model
    x, u = model.x0(i=current, omega=90.0), np.array([5.0, 0.1])
    smooth = np.hypot(current / 10.0, Place(handle(g, "loop"), Scale(12.0, 10.0)).smoothing)
    fallen = 0.05 / (1.0 + (10.0 / 22.0 * smooth) ** power) - 0.05
    i, omega = model.rhs(0.0, x, u, model.theta()) - declared.rhs(0.0, x, u, declared.theta())
    assert 2e-4 * omega == pytest.approx(fallen * current, rel=1e-9)
    assert 2e-3 * i == pytest.approx(-fallen * 90.0, rel=1e-9)


@pytest.mark.parametrize("current", [-12.0, 3.0, 25.0])
@pytest.mark.parametrize("power", [1.0, 0.6])
def test_an_armature_weakens_the_field_by_a_power_of_its_current(current: float, power: float) -> None:
    g = servo()
    effect = armature_reaction(g, Place(handle(g, "loop"), Scale(12.0, 10.0)))
    assert effect is not None
    weak = build(with_values(g, {effect.coefficients[0]: 1.0 / 70.0, effect.widths[0]: power}))
    model, declared = weak.model, build(servo()).model
    x, u = model.x0(i=current, omega=90.0), np.array([5.0, 0.1])
    smooth = np.hypot(current / 10.0, Place(handle(g, "loop"), Scale(12.0, 10.0)).smoothing)
    fallen = -0.05 * 10.0 / 70.0 * smooth**power
    i, omega = model.rhs(0.0, x, u, model.theta()) - declared.rhs(0.0, x, u, declared.theta())
    assert 2e-4 * omega == pytest.approx(fallen * current, rel=1e-9)
    assert 2e-3 * i == pytest.approx(-fallen * 90.0, rel=1e-9)


@pytest.mark.parametrize("c", [0.0, 0.2, 2.0])
def test_a_motor_passes_all_power_at_any_current(c: float) -> None:
    g = servo()
    effect = modulus_fading(g, Place(handle(g, "loop"), Scale(12.0, 10.0)))
    assert effect is not None
    built = build(with_values(g, {effect.coefficients[0]: c}))
    labels, model = bond_labels(built.causal), bond_model(built.causal)
    ends = [k for k, label in enumerate(labels) if "motor" in label.split("->")]
    chance = np.random.default_rng(2)
    x, u = chance.uniform(-40.0, 40.0, (2, 50)), chance.uniform(-10.0, 10.0, (2, 50))
    outputs = model.output(0.0, x, u, model.theta())[len(built.model.outputs) :]
    taken, given = (outputs[k] * outputs[len(labels) + k] for k in ends)
    np.testing.assert_allclose(taken, given, rtol=1e-12)
    if c == 0.0:
        declared = build(servo()).model
        np.testing.assert_allclose(
            model.rhs(0.0, x, u, model.theta()), declared.rhs(0.0, x, u, declared.theta()), rtol=1e-9
        )


def test_a_constant_that_follows_something_does_not_fade() -> None:
    g = bg.BondGraph("excited")
    field = g.input("field", "A", "excitation")
    k = g.parameter("k", 0.05, "N m/A^2")
    loop, wheel = g.one_junction("loop", bg.ELECTRICAL), g.one_junction("wheel", bg.ROTATION)
    g.gyrator("motor", k * field, loop, wheel)
    for at in (loop, wheel):
        assert modulus_fading(g, Place(at, Scale(1.0, 1.0))) is None
        assert armature_reaction(g, Place(at, Scale(1.0, 1.0))) is None
    assert modulus_fading(servo(), Place(handle(servo(), "wheel"), Scale(1.0, 1.0))) is None


def servo_rates(effect: bool) -> Rates:
    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        k = 0.05 / (1.0 + (x[0] / 18.0) ** 2) if effect else 0.05
        return [(u[0] - 0.8 * x[0] - k * x[1]) / 2e-3, (k * x[0] - 3e-4 * x[1] - u[1]) / 2.4e-4]

    return rates


def servo_inputs(time: FloatArray, chance: np.random.Generator) -> FloatArray:
    return np.array([steps(time, chance, -12.0, 12.0, 0.1), steps(time, chance, -0.3, 0.3, 0.27)])


MOTOR = Machine(
    servo, servo_rates, (0.0, 0.0), lambda x, u, effect: x, (0.05, 0.3), servo_inputs, 0.002, 700,
    frozenset({"modulus_fading at loop"}), effect="a constant of k/(1 + (i/18)^2)",
)  # fmt: skip

# ---------------------------------------------------------------------- gas


def strut() -> bg.BondGraph:
    """A mass on a spring that is straight, or, with another law, is not."""
    g = bg.BondGraph("strut")
    force = g.input("force", "N", "push")
    leg = g.one_junction("leg", bg.TRANSLATION)
    g.effort_source("push", force, at=leg)
    g.inertance("mass", g.parameter("m", 20.0, "kg"), at=leg, state="v")
    g.resistance("oil", g.parameter("d", 200.0, "N s/m"), at=leg)
    g.compliance("spring", g.parameter("k", 4000.0, "N/m"), at=leg, state="q")
    g.measure_flow("speed", leg, "speed")
    return g


def line() -> bg.BondGraph:
    """A pump that feeds a line with an accumulator, from which a throttle leads to the tank."""
    g = bg.BondGraph("line")
    pump = g.input("pump", "m^3/s", "pump")
    start = g.parameter("p_0", 50e5, "Pa", "pressure where a run starts")
    capacity = g.parameter("C", 9e-11, "m^3/Pa", "accumulator", (3e-11, 3e-10))
    throttle = g.parameter("K", 1.0e-7, "m^3/(s Pa^0.5)", "throttle", (5e-8, 2.5e-7))
    pipe = g.zero_junction("pipe", bg.HYDRAULIC)
    g.flow_source("feed", pump, at=pipe)
    g.compliance("accumulator", lambda q: start + q / capacity, at=pipe, state="q")
    g.resistance("outlet", flow=lambda p: throttle * p / (p**2 + 1e8) ** 0.25, at=pipe)
    g.measure_effort("pressure", pipe, "pressure of the line", "bar")
    return g


def squeezed(c: float) -> BuiltModel:
    g = strut()
    effect = gas_storage(g, Place(handle(g, "leg"), Scale(400.0, 1.0)))
    assert effect is not None and effect.name == "air_spring"
    (c_name,) = effect.coefficients
    bounds = next(one.bounds for one in g.parameters if one.name == c_name)
    assert bounds == (-30.0, 30.0)  # both ways of a spring, up to three over its way of 0.1 m
    return build(with_values(g, {c_name: c}))


def push(built: BuiltModel, q: FloatArray) -> FloatArray:
    """The effort of the spring at displacements (samples,)."""
    model = built.model
    x = np.zeros((2, q.size))
    x[model.index("state", "q")] = q
    force: FloatArray = -20.0 * model.rhs(0.0, x, np.zeros((1, q.size)), model.theta())[model.index("state", "v")]
    return force


@pytest.mark.parametrize("c", [-9.0, 1e-3, 2.0, 9.0])
def test_gas_pushes_by_the_power_of_its_volume(c: float) -> None:
    q = np.linspace(-0.09, 0.09, 19)
    polytropic = 3000.0 / c * ((1.0 - c * q) ** (-4.0 / 3.0) - 1.0)
    np.testing.assert_allclose(push(squeezed(c), q), polytropic, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("c", [0.0, 1e-16, 1e-12])
def test_gas_of_a_large_volume_is_the_declared_spring(c: float) -> None:
    q = np.random.default_rng(1).uniform(-0.5, 0.5, 40)
    np.testing.assert_allclose(push(squeezed(c), q), 4000.0 * q, rtol=1e-9)


def test_gas_has_its_derivative_where_its_coefficient_vanishes() -> None:
    """Effort that a score needs: k*q*(1 + 7/6*c*q + ...) of an exponent of 4/3."""
    q, c = np.array([-0.08, 0.03, 0.1]), 1e-6
    rise = (push(squeezed(c), q) - push(squeezed(-c), q)) / (2.0 * c)
    np.testing.assert_allclose(rise, 4000.0 * 7.0 / 6.0 * q**2, rtol=1e-6)


def test_gas_of_no_volume_has_a_finite_effort_that_goes_on_growing() -> None:
    force = push(squeezed(20.0), np.array([0.98, 1.0, 1.02, 3.0]) * COMPRESSED / 20.0)
    assert np.all(np.isfinite(force)) and np.all(np.diff(force) > 0.0)
    assert force[2] == pytest.approx(1.02 * force[1])


def test_gas_is_no_wall_nor_any_place_without_one_storage() -> None:
    g = bg.BondGraph("bare")
    for place in (g.zero_junction("plate", bg.THERMAL), g.zero_junction("node", bg.ELECTRICAL)):
        g.compliance(f"at_{place.name}", 2.0, at=place)
        assert gas_storage(g, Place(place, Scale(1.0, 1.0))) is None
    assert gas_storage(g, Place(g.one_junction("body", bg.TRANSLATION), Scale(1.0, 1.0))) is None
    shaft = g.one_junction("shaft", bg.ROTATION)
    g.compliance("twist", 2.0, at=shaft)
    assert gas_storage(g, Place(shaft, Scale(1.0, 1.0))) is None
    duct = g.one_junction("duct", bg.HYDRAULIC)
    g.compliance("valve", 2.0, at=duct)
    assert gas_storage(g, Place(duct, Scale(1.0, 1.0))) is None


def accumulator_pressure(q: FloatArray, effect: bool) -> FloatArray:
    volume = 7.5e-11 * 1.3 * 50e5
    if not effect:
        return 50e5 + q / 7.5e-11
    power: FloatArray = 50e5 * (volume / (volume - q)) ** 1.3
    return power


def line_rates(effect: bool) -> Rates:
    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        return [float(u[0] - 1.15e-7 * np.sqrt(accumulator_pressure(x, effect)[0]))]

    return rates


def line_inputs(time: FloatArray, chance: np.random.Generator) -> FloatArray:
    return steps(time, chance, 1.5e-4, 4.2e-4, 1.0)[np.newaxis]


GAS = Machine(
    line, line_rates, (0.0,), lambda x, u, effect: accumulator_pressure(x, effect), (1e4,), line_inputs, 0.02, 900,
    frozenset({"gas_accumulator at pipe"}), effect="p_0*(V/(V - q))^1.3",
)  # fmt: skip

# ---------------------------------------------------------------------- found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "name", "value"),
    [
        (COUPLING, "c_coupling_slip_motor_mixer", 5.0 / 18.0),
        (MOTOR, "c_modulus_fading_loop", 1.0),  # at 18 A
        (GAS, "c_gas_accumulator_pipe", 1.0 / (7.5e-11 * 1.3 * 50e5)),
    ],
    ids=["coupling", "motor", "gas"],
)  # fmt: skip
def test_each_is_found_at_its_place_with_its_coefficient(machine: Machine, name: str, value: float) -> None:
    closed = bg.close_loop(machine.graph(), [machine.log(seed) for seed in (1, 2)], [machine.log(9)])
    assert closed.verdict == "effect found"
    assert [one.trial.candidate.label for one in closed.added] == list(machine.laws)
    most = {one.name: one.value for one in closed.corrected_graph.parameters}.get("r_modulus_fading_loop", 18.0)
    assert closed.corrected.values[name] * (18.0 / most) ** 2 == pytest.approx(value, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("machine", [COUPLING, MOTOR, GAS], ids=["coupling", "motor", "gas"])
def test_none_is_found_where_nothing_is_missing(machine: Machine) -> None:
    closed = bg.close_loop(machine.graph(), [machine.log(seed, effect=False) for seed in (1, 2)], [])
    assert (closed.verdict, closed.added) == ("no missing effect", ())
