"""Five machines that the laws were made with; each has, beside what is declared, one effect or none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

import bondgraph as bg
from bondgraph.data.log import FloatArray
from bondgraph.declare.expressions import signal
from tests.effects.machines.machine import Machine, Rates, steps

# ------------------------------------------------------------------ electrical: iron that saturates


def coil() -> bg.BondGraph:
    g = bg.BondGraph("coil", doc="A coil at an amplifier.")
    u = g.input("u", "V", "voltage")
    loop = g.one_junction("loop", bg.ELECTRICAL)
    g.effort_source("supply", u, at=loop)
    g.inertance("inductance", g.parameter("L", 0.08, "V s/A", "inductance", (0.02, 0.4)), at=loop, state="i")
    g.resistance("copper", g.parameter("R", 2.0, "V/A", "copper", (0.5, 8.0)), at=loop)
    g.measure_flow("current", loop, "current")
    return g


def coil_rates(effect: bool) -> Rates:
    """Flux linkage as state; its curve is that of a tanh."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        return [u[0] - 2.2 * coil_current(x[0], effect)]

    return rates


def coil_current(flux: FloatArray, effect: bool) -> FloatArray:
    return 3.0 * np.arctanh(np.clip(flux / 0.3, -0.999999, 0.999999)) if effect else flux / 0.1


COIL = Machine(
    coil, coil_rates, [0.0], lambda x, u, effect: coil_current(x, effect), [0.02],
    lambda time, chance: steps(time, chance, -9.0, 9.0, 0.15)[np.newaxis], 0.005, 800,
    frozenset({"magnetic_saturation at loop"}),
)  # fmt: skip

# ------------------------------------------------------------------ thermal: a plate that glows


def plate() -> bg.BondGraph:
    g = bg.BondGraph("plate", doc="A heated plate in a room.")
    power = g.input("power", "W", "heater")
    room = g.input("room", "K", "temperature of the room", default=293.0)
    body, path = g.zero_junction("body", bg.THERMAL), g.one_junction("path", bg.THERMAL)
    g.flow_source("heater", power, at=body)
    capacity = g.parameter("C", 450.0, "J/K", "heat capacity", (100.0, 2000.0))
    g.compliance("heat", 1 / capacity, at=body, state="Q", initial=450.0 * 293.0)
    g.bond(body, path)
    conductance = g.parameter("h", 2.0, "W/K", "to the room", (0.2, 20.0))
    g.resistance("air", 1 / conductance, at=path)
    g.bond(path, g.effort_source("hall", room))
    g.measure_effort("temperature", body, "temperature of the plate")
    return g


def plate_rates(effect: bool) -> Rates:
    """Temperature as state; what the plate radiates as a conductance that grows with both temperatures."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        hot, cold = x[0], u[1]
        glow = 0.03 * 5.670374e-8 * (hot + cold) * (hot**2 + cold**2) * (hot - cold) if effect else 0.0
        return [(u[0] - 1.5 * (x[0] - u[1]) - glow) / 500.0]

    return rates


PLATE = Machine(
    plate, plate_rates, [293.0], lambda x, u, effect: x, [1.0],
    lambda time, chance: np.array([steps(time, chance, 0.0, 1500.0, 300.0), 293.0 + 0.0 * time]), 10.0, 500,
    frozenset({"radiation at body"}),
)  # fmt: skip

# ------------------------------------------------------------------ hydraulic: two chambers and a piston


def cylinder() -> bg.BondGraph:
    g = bg.BondGraph("cylinder", doc="A cylinder with two chambers, each fed by a valve.")
    front, back = g.input("front_flow", "m^3/s"), g.input("back_flow", "m^3/s")
    piston = g.one_junction("piston", bg.TRANSLATION)
    area = g.parameter("area", 1e-3, "m^2", "area of the piston")
    stiff = g.parameter("k", 5e10, "Pa/m^3", "stiffness of the fluid", (1e10, 2e11))
    for name, flow, sign in (("front", front, 1), ("back", back, -1)):
        chamber = g.zero_junction(name, bg.HYDRAULIC)
        g.flow_source(f"valve_{name}", flow, at=chamber)
        g.compliance(f"fluid_{name}", stiff, at=chamber, state=f"V_{name}")
        g.transformer(f"side_{name}", 1 / (sign * area), chamber, piston)
        g.measure_effort(f"{name}_pressure", chamber, f"pressure of the {name} chamber")
    g.inertance("mass", g.parameter("m", 60.0, "kg", "load", (20.0, 200.0)), at=piston, state="v")
    g.resistance("guide", g.parameter("d", 2000.0, "N s/m", "guide", (200.0, 2e4)), at=piston)
    g.compliance("load_spring", g.parameter("k_load", 4e4, "N/m", "load's spring", (1e4, 2e5)), at=piston, state="x")
    g.measure_flow("speed", piston, "speed of the piston")
    return g


# ------------------------------------------------------------------ mechanical: a leaf that bends far


def leaf() -> bg.BondGraph:
    g = bg.BondGraph("leaf", doc="A mass on a leaf spring.")
    force = g.input("force", "N")
    mass = g.one_junction("mass", bg.TRANSLATION)
    g.effort_source("shaker", force, at=mass)
    g.inertance("inertia", g.parameter("m", 0.5, "kg", "mass", (0.1, 2.0)), at=mass, state="v")
    g.compliance("leaf", g.parameter("k", 200.0, "N/m", "stiffness", (50.0, 800.0)), at=mass, state="x")
    g.resistance("air", g.parameter("d", 0.6, "N s/m", "damping", (0.05, 5.0)), at=mass)
    g.measure("way", signal("displacement", "leaf"), "m")
    return g


def leaf_rates(effect: bool) -> Rates:
    """Position and speed; the spring is a sinh."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        spring = 220.0 * 0.05 * np.sinh(x[0] / 0.05) if effect else 220.0 * x[0]
        return [x[1], (u[0] - spring - 0.5 * x[1]) / 0.55]

    return rates


LEAF = Machine(
    leaf, leaf_rates, [0.0, 0.0], lambda x, u, effect: x[:1], [2e-4],
    lambda time, chance: steps(time, chance, -8.0, 8.0, 0.3)[np.newaxis], 0.01, 1000,
    frozenset({"hardening_spring at mass"}),
)  # fmt: skip

# ------------------------------------------------------------------ mechanical: a buffer


def buffer_rates(effect: bool) -> Rates:
    """Position and speed; beyond 30 mm a contact as Hertz has it."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        stop = 4e4 * max(x[0] - 0.03, 0.0) ** 1.5 if effect else 0.0
        return [x[1], (u[0] - 220.0 * x[0] - stop - 0.5 * x[1]) / 0.55]

    return rates


BUFFER = Machine(
    leaf, buffer_rates, [0.0, 0.0], lambda x, u, effect: x[:1], [2e-4],
    lambda time, chance: steps(time, chance, -8.0, 8.0, 0.3)[np.newaxis], 0.01, 1000,
    frozenset({"one_sided_stop at mass", "end_stop at mass"}),
)  # fmt: skip

# ------------------------------------------------------------------ mixed: a ratio that follows late


def winch() -> bg.BondGraph:
    g = bg.BondGraph("winch", doc="A motor that pulls a load through a gear whose ratio is commanded.")
    torque, ratio = g.input("torque", "N m"), g.input("ratio", "1", default=1.0)
    motor, drum = g.one_junction("motor", bg.ROTATION), g.one_junction("drum", bg.ROTATION)
    g.effort_source("drive", torque, at=motor)
    g.transformer("gear", 1 / ratio, motor, drum)
    g.inertance("inertia", g.parameter("J", 2.0, "kg m^2", "drum", (0.5, 10.0)), at=drum, state="omega")
    g.resistance("bearing", g.parameter("d", 1.0, "N m s", "bearing", (0.1, 10.0)), at=drum)
    g.measure_flow("speed", drum, "speed of the drum")
    return g


def winch_rates(effect: bool) -> Rates:
    """Speed, and the ratio through two lags of which one is short."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        given = x[2] if effect else u[1]
        return [(u[0] * given - 1.2 * x[0]) / 2.2, (u[1] - x[1]) / 0.03, (x[1] - x[2]) / 0.4]

    return rates


WINCH = Machine(
    winch, winch_rates, [0.0, 1.5, 1.5], lambda x, u, effect: x[:1], [0.02],
    lambda time, chance: np.array([
        8.0 + steps(time, chance, -3.0, 3.0, 2.1),
        np.where(time < 1.0, 1.5, steps(time, chance, 0.7, 3.0, 1.7)),
    ]), 0.05, 800,
    frozenset({"ratio_lag at motor"}),
)  # fmt: skip

MACHINES: Mapping[str, Machine] = {
    "coil": COIL, "plate": PLATE, "leaf": LEAF, "buffer": BUFFER, "winch": WINCH,
}  # fmt: skip
