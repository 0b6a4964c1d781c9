"""Machines of two domains: a motor that cogs, an amplifier at its limit, a wire that warms, a valve with overlap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

import bondgraph as bg
from bondgraph.data.log import FloatArray
from bondgraph.declare.expressions import signal
from tests.effects.machines.machine import Machine, Rates, steps, waves

# ------------------------------------------------------------------ cogging that is no sine


def motor() -> bg.BondGraph:
    g = bg.BondGraph("motor", doc="A small motor at an amplifier.")
    u = g.input("u", "V", "voltage")
    loop, rotor = g.one_junction("loop", bg.ELECTRICAL), g.one_junction("rotor", bg.ROTATION)
    g.effort_source("supply", u, at=loop)
    g.resistance("copper", g.parameter("R", 1.1, "V/A", "copper", (0.3, 4.0)), at=loop)
    g.gyrator("field", g.parameter("k", 0.095, "V s", "torque per current", (0.02, 0.4)), loop, rotor)
    g.inertance("armature", g.parameter("J", 2.2e-3, "kg m^2", "rotor", (5e-4, 1e-2)), at=rotor, state="omega")
    g.resistance("bearing", g.parameter("d", 1.2e-3, "N m s", "bearing", (1e-4, 1e-2)), at=rotor)
    g.measure("turned", g.integral("angle", rotor.flow, "rad", "angle of the rotor"), "rad")
    g.measure_flow("current", loop, "current")
    return g


def motor_rates(effect: bool) -> Rates:
    """Angle and speed."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        poles = 6.0 * x[0]
        cogs = 0.03 * np.sin(poles) / (1.25 - 0.4 * np.cos(poles)) if effect else 0.0
        return [x[1], (0.1 * (u[0] - 0.1 * x[1]) - 1e-3 * x[1] - cogs) / 2e-3]

    return rates


MOTOR = Machine(
    motor, motor_rates, [0.0, 0.0], lambda x, u, effect: np.array([x[0], u[0] - 0.1 * x[1]]), [5e-3, 0.01],
    lambda time, chance: steps(time, chance, -1.5, 2.5, 0.5)[np.newaxis], 0.005, 1000,
    frozenset({"ripple at rotor"}), frozenset({"angle"}), "cogging sin/(1.25 - 0.4 cos) of 6*angle",
)  # fmt: skip

# ------------------------------------------------------------------ an amplifier whose voltage saturates


def servo() -> bg.BondGraph:
    g = bg.BondGraph("servo", doc="A motor with a flywheel at an amplifier.")
    u = g.input("u", "V", "what the amplifier is told")
    loop, rotor = g.one_junction("loop", bg.ELECTRICAL), g.one_junction("rotor", bg.ROTATION)
    g.effort_source("amplifier", u, at=loop)
    g.resistance("copper", g.parameter("R", 2.3, "V/A", "copper", (0.5, 10.0)), at=loop)
    g.gyrator("field", g.parameter("k", 0.2, "V s", "torque per current"), loop, rotor)
    g.inertance("flywheel", g.parameter("J", 9e-3, "kg m^2", "rotor", (2e-3, 0.05)), at=rotor, state="omega")
    g.resistance("bearing", g.parameter("d", 6e-3, "N m s", "bearing", (1e-3, 0.05)), at=rotor)
    g.measure_flow("speed", rotor, "speed")
    return g


def servo_rates(effect: bool) -> Rates:
    """Speed."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        given = 15.0 * np.tanh(u[0] / 15.0) if effect else u[0]
        return [(0.2 * (given - 0.2 * x[0]) / 2.0 - 5e-3 * x[0]) / 0.01]

    return rates


SERVO = Machine(
    servo, servo_rates, [0.0], lambda x, u, effect: x, [0.2],
    lambda time, chance: steps(time, chance, -24.0, 24.0, 0.6)[np.newaxis], 0.02, 700,
    frozenset({"actuator_ceiling at loop"}), frozenset({"u"}), "voltage 15*tanh(u/15)",
)  # fmt: skip

# ------------------------------------------------------------------ copper that warms


def winding() -> bg.BondGraph:
    g = bg.BondGraph("winding", doc="A winding that heats the body it is wound on.")
    u = g.input("u", "V", "voltage")
    loop, iron = g.one_junction("loop", bg.ELECTRICAL), g.zero_junction("iron", bg.THERMAL)
    g.effort_source("supply", u, at=loop)
    g.resistance("copper", g.parameter("R", 2.2, "V/A", "copper", (0.5, 10.0)), at=loop)
    g.flow_source("heat", signal("effort", "copper") * loop.flow, at=iron)
    g.compliance("body", 1 / g.parameter("C", 22.0, "J/K", "heat capacity", (5.0, 100.0)), at=iron, state="Q")
    g.resistance("air", g.parameter("R_air", 3.0, "K/W", "to the room", (0.5, 20.0)), at=iron)
    g.measure_flow("current", loop, "current")
    g.measure_effort("rise", iron, "temperature above the room")
    return g


def winding_current(rise: FloatArray, u: FloatArray, effect: bool) -> FloatArray:
    return u / (2.0 * np.exp(0.0033 * rise) if effect else 2.0)


def winding_rates(effect: bool) -> Rates:
    """Temperature above the room."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        return [(u[0] * winding_current(x[0], u[0], effect) - x[0] / 3.3) / 20.0]

    return rates


WINDING = Machine(
    winding, winding_rates, [0.0],
    lambda x, u, effect: np.array([winding_current(x[0], u[0], effect), x[0]]), [0.01, 0.1],
    lambda time, chance: steps(time, chance, 1.0, 10.0, 20.0)[np.newaxis], 0.5, 700,
    frozenset({"temperature_dependence at loop"}), frozenset({"flow of loop", "effort of iron"}),
    "resistance 2*exp(0.0033*dT)",
)  # fmt: skip


# ------------------------------------------------------------------ a valve with overlap, its edges rounded


def lifter() -> bg.BondGraph:
    g = bg.BondGraph("lifter", doc="A valve that feeds a plunger, which moves a mass on a spring.")
    u = g.input("u", "1", "command of the valve")
    chamber, plunger = g.zero_junction("chamber", bg.HYDRAULIC), g.one_junction("plunger", bg.TRANSLATION)
    gain = g.parameter("gain", 4.5e-5, "m^3/s", "flow of the open valve", (1e-5, 2e-4))
    g.flow_source("valve", gain * u, at=chamber)
    g.compliance("oil", g.parameter("k", 1e10, "Pa/m^3", "stiffness of the oil", (2e9, 5e10)), at=chamber, state="V")
    g.resistance("gap", g.parameter("R", 5.5e10, "Pa s/m^3", "gap", (1e10, 3e11)), at=chamber)
    g.transformer("face", 1 / g.parameter("area", 1e-3, "m^2", "face of the plunger"), chamber, plunger)
    g.inertance("mass", g.parameter("m", 55.0, "kg", "load", (15.0, 200.0)), at=plunger, state="v")
    g.resistance("guide", g.parameter("d", 500.0, "N s/m", "guide", (50.0, 5000.0)), at=plunger)
    g.compliance("spring", g.parameter("k_load", 2.2e4, "N/m", "spring", (5e3, 1e5)), at=plunger, state="x")
    g.measure_effort("pressure", chamber, "pressure")
    g.measure("way", signal("displacement", "spring"), "m")
    return g


def lifter_rates(effect: bool) -> Rates:
    """Squeezed volume, speed and way."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        opened = u[0] - 0.2 * np.tanh(u[0] / 0.2) if effect else u[0]
        p = 1.2e10 * x[0]
        return [5e-5 * opened - 1e-3 * x[1] - p / 5e10, (1e-3 * p - 600.0 * x[1] - 2e4 * x[2]) / 50.0, x[1]]

    return rates


LIFTER = Machine(
    lifter, lifter_rates, [0.0, 0.0, 0.0], lambda x, u, effect: np.array([1.2e10 * x[0], x[2]]), [3e3, 5e-5],
    lambda time, chance: waves(time, chance, 0.5, 0.1, 1.5)[np.newaxis], 0.02, 800,
    frozenset({"actuator_dead_zone at chamber"}), frozenset({"u"}), "overlap u - 0.2*tanh(u/0.2)",
)  # fmt: skip

MIXED: Mapping[str, Machine] = {"motor": MOTOR, "servo": SERVO, "winding": WINDING, "lifter": LIFTER}
