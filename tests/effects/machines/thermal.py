"""Thermal machines: a wire that glows, a body in still air, a block whose capacity changes, a furnace with a gap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

import bondgraph as bg
from bondgraph.data.log import FloatArray
from bondgraph.declare.graph import Handle
from tests.effects.machines.machine import Machine, Rates, steps

_STEFAN = 5.670374e-8


def body(g: bg.BondGraph, name: str, capacity: float, start: float) -> Handle:
    """A body that starts at a temperature."""
    junction = g.zero_junction(name, bg.THERMAL)
    bounds = (0.2 * capacity, 5.0 * capacity)
    size = g.parameter(f"C_{name}", capacity, "J/K", "heat capacity", bounds)
    g.compliance(f"heat_{name}", 1 / size, at=junction, state=f"Q_{name}", initial=capacity * start)
    return junction


def wall(g: bg.BondGraph, name: str, resistance: float, first: Handle, second: Handle) -> None:
    """What conducts from a body to another or to what is around."""
    path = g.one_junction(name, bg.THERMAL)
    g.bond(first, path)
    bounds = (0.1 * resistance, 10.0 * resistance)
    g.resistance(f"wall_{name}", g.parameter(f"R_{name}", resistance, "K/W", "conduction", bounds), at=path)
    g.bond(path, second)


# ------------------------------------------------------------------ a wire whose emissivity rises as it glows


def glower() -> bg.BondGraph:
    g = bg.BondGraph("glower", doc="A heated wire on its holder, in a vacuum.")
    power, around = g.input("power", "W", "heater"), g.input("around", "K", "vessel", default=300.0)
    wire = body(g, "wire", 1.8, 300.0)
    g.flow_source("heater", power, at=wire)
    wall(g, "holder", 60.0, wire, g.effort_source("vessel", around))
    g.measure_effort("temperature", wire, "temperature of the wire")
    return g


def glower_rates(effect: bool) -> Rates:
    """Temperature."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        glow = 3e-4 * (x[0] / 800.0) ** 0.4 * _STEFAN * (x[0] ** 4 - u[1] ** 4) if effect else 0.0
        return [(u[0] - (x[0] - u[1]) / 50.0 - glow) / 2.0]

    return rates


GLOWER = Machine(
    glower, glower_rates, [300.0], lambda x, u, effect: x, [1.0],
    lambda time, chance: np.array([steps(time, chance, 0.0, 20.0, 40.0), 300.0 + 0.0 * time]), 2.0, 600,
    frozenset({"radiation at wire"}), frozenset({"effort of wire"}), "radiation with the power 4.4",
)  # fmt: skip

# ------------------------------------------------------------------ a body in air that it makes turbulent


def sink() -> bg.BondGraph:
    g = bg.BondGraph("sink", doc="A heat sink on a bench, as rise above the room.")
    power = g.input("power", "W", "heater")
    fins = body(g, "fins", 550.0, 0.0)
    g.flow_source("heater", power, at=fins)
    g.resistance("bench", g.parameter("R_bench", 2.3, "K/W", "to the bench", (0.2, 20.0)), at=fins)
    g.measure_effort("rise", fins, "temperature above the room")
    return g


def sink_rates(effect: bool) -> Rates:
    """Rise of the temperature."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        air = 0.12 * max(x[0], 0.0) ** 1.33 if effect else 0.0
        return [(u[0] - x[0] / 2.0 - air) / 600.0]

    return rates


SINK = Machine(
    sink, sink_rates, [0.0], lambda x, u, effect: x, [0.1],
    lambda time, chance: steps(time, chance, 0.0, 120.0, 600.0)[np.newaxis], 20.0, 700,
    frozenset({"convection at fins", "resistance_exponent at fins"}),
    frozenset({"effort of fins"}), "convection 0.12*dT^1.33",
)  # fmt: skip

# ------------------------------------------------------------------ a block whose capacity saturates


def block() -> bg.BondGraph:
    g = bg.BondGraph("block", doc="A heated block in a room.")
    power, room = g.input("power", "W", "heater"), g.input("room", "K", "room", default=293.0)
    core = body(g, "core", 360.0, 293.0)
    g.flow_source("heater", power, at=core)
    wall(g, "wool", 0.9, core, g.effort_source("hall", room))
    g.measure_effort("temperature", core, "temperature of the block")
    return g


def block_rates(effect: bool) -> Rates:
    """Temperature."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        rise = 0.6 * (1.0 - np.exp(-(x[0] - 293.0) / 150.0)) if effect else 0.0
        return [(u[0] - (x[0] - u[1]) / 0.8) / (400.0 * (1.0 + rise))]

    return rates


BLOCK = Machine(
    block, block_rates, [293.0], lambda x, u, effect: x, [0.3],
    lambda time, chance: np.array([steps(time, chance, 0.0, 450.0, 400.0), 293.0 + 0.0 * time]), 10.0, 700,
    frozenset({"varying_heat_capacity at core"}), frozenset(), "capacity rises by 0.6*(1 - exp(-dT/150))",
)  # fmt: skip

# ------------------------------------------------------------------ a furnace that radiates over a gap


def furnace() -> bg.BondGraph:
    g = bg.BondGraph("furnace", doc="A hearth in a shell, in a room.")
    power, room = g.input("power", "W", "heater"), g.input("room", "K", "room", default=293.0)
    hearth, shell = body(g, "hearth", 700.0, 293.0), body(g, "shell", 1800.0, 293.0)
    g.flow_source("heater", power, at=hearth)
    wall(g, "lining", 1.2, hearth, shell)
    wall(g, "air", 0.13, shell, g.effort_source("hall", room))
    g.measure_effort("inner", hearth, "temperature of the hearth")
    g.measure_effort("outer", shell, "temperature of the shell")
    return g


def furnace_rates(effect: bool) -> Rates:
    """Temperatures of hearth and shell."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        over = 1e-2 * (x[0] / 700.0) ** 0.3 * _STEFAN * (x[0] ** 4 - x[1] ** 4) if effect else 0.0
        passed = (x[0] - x[1]) / 1.0 + over
        return [(u[0] - passed) / 800.0, (passed - (x[1] - u[1]) / 0.15) / 2000.0]

    return rates


FURNACE = Machine(
    furnace, furnace_rates, [293.0, 293.0], lambda x, u, effect: x, [0.5, 0.3],
    lambda time, chance: np.array([steps(time, chance, 0.0, 900.0, 400.0), 293.0 + 0.0 * time]), 10.0, 700,
    frozenset({"radiation_between at hearth and shell"}), frozenset(), "radiation over the gap with the power 4.3",
)  # fmt: skip

THERMAL: Mapping[str, Machine] = {"glower": GLOWER, "sink": SINK, "block": BLOCK, "furnace": FURNACE}
