"""Mechanical machines: a slide with dry friction, a fan, a strut with bump stops, a rubber mount."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

import bondgraph as bg
from bondgraph.data.log import FloatArray
from bondgraph.declare.expressions import signal
from tests.effects.machines.machine import Machine, Rates, steps, waves

# ------------------------------------------------------------------ friction that turns round by an arc tangent


def slide() -> bg.BondGraph:
    g = bg.BondGraph("slide", doc="A carriage on its guide.")
    force = g.input("force", "N")
    carriage = g.one_junction("carriage", bg.TRANSLATION)
    g.effort_source("drive", force, at=carriage)
    g.inertance("mass", g.parameter("m", 7.0, "kg", "carriage", (2.0, 30.0)), at=carriage, state="v")
    g.resistance("oil", g.parameter("d", 22.0, "N s/m", "guide", (4.0, 100.0)), at=carriage)
    g.measure_flow("speed", carriage, "speed")
    return g


def slide_rates(effect: bool) -> Rates:
    """Speed."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        rubbed = 9.0 * 2.0 / np.pi * np.arctan(x[0] / 0.003) if effect else 0.0
        return [(u[0] - 25.0 * x[0] - rubbed) / 8.0]

    return rates


SLIDE = Machine(
    slide, slide_rates, [0.0], lambda x, u, effect: x, [3e-3],
    lambda time, chance: steps(time, chance, -40.0, 40.0, 0.4)[np.newaxis], 0.01, 700,
    frozenset({"coulomb_loss at carriage"}), frozenset({"flow of carriage"}), "9 N, turning round by atan(v/0.003)",
)  # fmt: skip

# ------------------------------------------------------------------ a fan behind an elastic shaft


def fan() -> bg.BondGraph:
    g = bg.BondGraph("fan", doc="A fan behind an elastic shaft.")
    torque = g.input("torque", "N m")
    rotor, hub = g.one_junction("rotor", bg.ROTATION), g.one_junction("hub", bg.ROTATION)
    shaft, twist = g.zero_junction("shaft", bg.ROTATION), g.one_junction("twist", bg.ROTATION)
    g.effort_source("motor", torque, at=rotor)
    g.inertance("armature", g.parameter("J_rotor", 0.06, "kg m^2", "rotor", (0.01, 0.2)), at=rotor, state="omega")
    g.resistance("bearing", g.parameter("d_rotor", 0.025, "N m s", "bearing", (2e-3, 0.2)), at=rotor)
    g.bond(rotor, shaft)
    g.bond(shaft, twist)
    g.compliance("steel", g.parameter("k", 180.0, "N m", "stiffness", (50.0, 800.0)), at=twist, state="wound")
    g.resistance("rubber", g.parameter("d_k", 0.6, "N m s", "damping", (0.05, 5.0)), at=twist)
    g.bond(shaft, hub)
    g.inertance("wheel", g.parameter("J_hub", 0.27, "kg m^2", "fan", (0.05, 1.0)), at=hub, state="omega_hub")
    g.resistance("hub_bearing", g.parameter("d_hub", 0.025, "N m s", "bearing", (2e-3, 0.2)), at=hub)
    g.measure_flow("rotor_speed", rotor, "speed of the rotor")
    g.measure_flow("fan_speed", hub, "speed of the fan")
    return g


def fan_rates(effect: bool) -> Rates:
    """Speeds of rotor and fan, and how far the shaft is wound."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        passed = 200.0 * x[2] + 0.5 * (x[0] - x[1])
        air = 3e-3 * np.sign(x[1]) * abs(x[1]) ** 1.85 if effect else 0.0
        return [(u[0] - passed - 0.02 * x[0]) / 0.05, (passed - 0.02 * x[1] - air) / 0.3, x[0] - x[1]]

    return rates


FAN = Machine(
    fan, fan_rates, [0.0, 0.0, 0.0], lambda x, u, effect: x[:2], [0.05, 0.05],
    lambda time, chance: steps(time, chance, -2.0, 10.0, 1.0)[np.newaxis], 0.01, 800,
    frozenset({"quadratic_loss at hub", "resistance_exponent at hub"}),
    frozenset({"flow of hub"}), "drag 0.003*omega^1.85 at the fan",
)  # fmt: skip

# ------------------------------------------------------------------ bump stops whose force is an exponential


def strut() -> bg.BondGraph:
    g = bg.BondGraph("strut", doc="A body on a strut whose foot is moved.")
    foot = g.input("foot", "m/s", "speed of the foot")
    link, mass = g.zero_junction("link", bg.TRANSLATION), g.one_junction("mass", bg.TRANSLATION)
    leg = g.one_junction("leg", bg.TRANSLATION)
    g.flow_source("shaker", foot, at=link)
    g.bond(link, leg)
    g.compliance("coil", g.parameter("k", 1.5e4, "N/m", "spring", (4e3, 6e4)), at=leg, state="stroke")
    g.resistance("damper", g.parameter("d", 1100.0, "N s/m", "damper", (200.0, 5000.0)), at=leg)
    g.bond(link, mass)
    g.inertance("body", g.parameter("m", 230.0, "kg", "body", (80.0, 700.0)), at=mass, state="v")
    g.measure("travel", signal("displacement", "coil"), "m")
    g.measure_flow("speed", mass, "speed of the body")
    return g


def strut_rates(effect: bool) -> Rates:
    """Stroke and speed of the body."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        beyond = max(abs(x[0]) - 0.025, 0.0)
        bump = 250.0 * np.sign(x[0]) * np.expm1(beyond / 0.006) if effect else 0.0
        closing = u[0] - x[1]
        return [closing, (1.6e4 * x[0] + 1200.0 * closing + bump) / 250.0]

    return rates


STRUT = Machine(
    strut, strut_rates, [0.0, 0.0], lambda x, u, effect: x, [2e-4, 2e-3],
    lambda time, chance: waves(time, chance, 0.2, 0.5, 3.0)[np.newaxis], 0.01, 800,
    frozenset({"end_stop at leg"}), frozenset({"displacement of coil"}), "stops 250*(exp((|x| - 0.025)/0.006) - 1)",
)  # fmt: skip

# ------------------------------------------------------------------ rubber, as Bouc and Wen have it


def mount() -> bg.BondGraph:
    g = bg.BondGraph("mount", doc="A mass on a rubber mount.")
    force = g.input("force", "N")
    mass = g.one_junction("mass", bg.TRANSLATION)
    g.effort_source("shaker", force, at=mass)
    g.inertance("block", g.parameter("m", 9.0, "kg", "mass", (3.0, 30.0)), at=mass, state="v")
    g.compliance("rubber", g.parameter("k", 3600.0, "N/m", "stiffness", (1e3, 2e4)), at=mass, state="x")
    g.resistance("loss", g.parameter("d", 25.0, "N s/m", "damping", (3.0, 200.0)), at=mass)
    g.measure("way", signal("displacement", "rubber"), "m")
    return g


def mount_rates(effect: bool) -> Rates:
    """Position, speed, and the hysteretic share."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        bent = abs(x[2]) ** 1.6 * (0.7 + 0.3 * np.sign(x[1] * x[2]))
        held = 14.0 * x[2] if effect else 0.0
        return [x[1], (u[0] - 4000.0 * x[0] - 20.0 * x[1] - held) / 10.0, x[1] * (1.0 - bent) / 2e-3]

    return rates


MOUNT = Machine(
    mount, mount_rates, [0.0, 0.0, 0.0], lambda x, u, effect: x[:1], [3e-5],
    lambda time, chance: waves(time, chance, 40.0, 0.5, 6.0)[np.newaxis], 0.01, 800,
    frozenset({"hysteresis_loss at mass", "bouc_wen_loss at mass"}), frozenset(),
    "14 N of hysteresis, Bouc-Wen with the power 1.6",
)  # fmt: skip

MECHANICAL: Mapping[str, Machine] = {"slide": SLIDE, "fan": FAN, "strut": STRUT, "mount": MOUNT}
