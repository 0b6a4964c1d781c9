"""Hydraulic machines: a tank that leaks, a valve that opens, a rough pipe, a cylinder whose piston leaks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

import bondgraph as bg
from bondgraph.data.log import FloatArray
from tests.effects.machines.machine import Machine, Rates, steps, waves

# ------------------------------------------------------------------ a leak with a power near a half


def tank() -> bg.BondGraph:
    g = bg.BondGraph("tank", doc="A tank that is filled, with an outlet.")
    inflow = g.input("inflow", "m^3/s", "what the pump gives")
    level = g.zero_junction("level", bg.HYDRAULIC)
    g.flow_source("pump", inflow, at=level)
    g.compliance("water", g.parameter("k", 1.8e4, "Pa/m^3", "pressure per volume", (5e3, 8e4)), at=level, state="V")
    g.resistance("outlet", g.parameter("R", 2.2e7, "Pa s/m^3", "outlet", (5e6, 1e8)), at=level)
    g.measure_effort("pressure", level, "pressure at the bottom")
    return g


def tank_rates(effect: bool) -> Rates:
    """Volume."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        p = 2e4 * x[0]
        leak = 3e-4 * (max(p, 0.0) / 1e4) ** 0.58 if effect else 0.0
        return [u[0] - p / 2e7 - leak]

    return rates


TANK = Machine(
    tank, tank_rates, [0.0], lambda x, u, effect: 2e4 * x, [15.0],
    lambda time, chance: steps(time, chance, 0.0, 1e-3, 600.0)[np.newaxis], 20.0, 700,
    frozenset({"orifice_leak at level", "resistance_exponent at level"}),
    frozenset({"effort of level"}), "leak 3e-4*(p/1e4)^0.58",
)  # fmt: skip

# ------------------------------------------------------------------ a valve that opens ever wider


def press() -> bg.BondGraph:
    g = bg.BondGraph("press", doc="An accumulator at a pump, drained through a gap.")
    inflow = g.input("inflow", "m^3/s", "what the pump gives")
    chamber = g.zero_junction("chamber", bg.HYDRAULIC)
    g.flow_source("pump", inflow, at=chamber)
    stiffness = g.parameter("k", 2.3e10, "Pa/m^3", "stiffness of the accumulator", (5e9, 1e11))
    g.compliance("accumulator", stiffness, at=chamber, state="V")
    g.resistance("gap", g.parameter("R", 9e10, "Pa s/m^3", "gap", (2e10, 5e11)), at=chamber)
    g.measure_effort("pressure", chamber, "pressure of the accumulator")
    return g


def press_rates(effect: bool) -> Rates:
    """Volume."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        p = 2e10 * x[0]
        drained = 1.5e-4 * (max(p - 1e7, 0.0) / 4e6) ** 1.4 if effect else 0.0
        return [u[0] - p / 1e11 - drained]

    return rates


PRESS = Machine(
    press, press_rates, [0.0], lambda x, u, effect: 2e10 * x, [4e4],
    lambda time, chance: steps(time, chance, 0.0, 2e-4, 6.0)[np.newaxis], 0.2, 700,
    # the second law was written after the first count: of what begins at a threshold it has the nearer power
    frozenset({"relief_valve at chamber", "overflow at chamber"}), frozenset({"effort of chamber"}),
    "drain 1.5e-4*((p - 1e7)/4e6)^1.4",
)  # fmt: skip

# ------------------------------------------------------------------ a rough pipe, as Blasius has it


def pipe() -> bg.BondGraph:
    g = bg.BondGraph("pipe", doc="A long pipe at a pump.")
    given = g.input("given", "Pa", "pressure of the pump")
    column = g.one_junction("column", bg.HYDRAULIC)
    g.effort_source("pump", given, at=column)
    g.inertance("water", g.parameter("I", 9e6, "Pa s^2/m^3", "water in the pipe", (2e6, 4e7)), at=column, state="Q")
    g.resistance("wall", g.parameter("R", 5e6, "Pa s/m^3", "laminar loss", (1e6, 5e7)), at=column)
    g.measure_flow("flow", column, "flow")
    return g


def pipe_rates(effect: bool) -> Rates:
    """Flow."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        rough = 9e4 * np.sign(x[0]) * abs(x[0] / 1e-2) ** 1.75 if effect else 0.0
        return [(u[0] - 4e6 * x[0] - rough) / 1e7]

    return rates


PIPE = Machine(
    pipe, pipe_rates, [0.0], lambda x, u, effect: x, [5e-5],
    lambda time, chance: steps(time, chance, -5e4, 2e5, 3.0)[np.newaxis], 0.1, 700,
    frozenset({"orifice_loss at column", "resistance_exponent at column", "turbulent_loss at column"}),
    frozenset({"flow of column"}), "loss 9e4*(Q/0.01)^1.75",
)  # fmt: skip

# ------------------------------------------------------------------ a piston whose seal leaks


def ram() -> bg.BondGraph:
    g = bg.BondGraph("ram", doc="A cylinder with two chambers, each fed by a valve, that moves a mass on a spring.")
    front, back = g.input("front_flow", "m^3/s"), g.input("back_flow", "m^3/s")
    piston = g.one_junction("piston", bg.TRANSLATION)
    stiff = g.parameter("k", 4.4e10, "Pa/m^3", "stiffness of the fluid", (1e10, 2e11))
    area = g.parameter("area", 1e-3, "m^2", "area of the piston")
    for name, flow, face in (("front", front, area), ("back", back, -area)):
        chamber = g.zero_junction(name, bg.HYDRAULIC)
        g.flow_source(f"valve_{name}", flow, at=chamber)
        g.compliance(f"fluid_{name}", stiff, at=chamber, state=f"V_{name}")
        g.transformer(f"side_{name}", 1 / face, chamber, piston)
        g.measure_effort(f"{name}_pressure", chamber, f"pressure of the {name} chamber")
    g.inertance("mass", g.parameter("m", 66.0, "kg", "load", (20.0, 200.0)), at=piston, state="v")
    g.resistance("guide", g.parameter("d", 1700.0, "N s/m", "guide", (200.0, 2e4)), at=piston)
    g.compliance("spring", g.parameter("k_load", 4.4e4, "N/m", "spring", (1e4, 2e5)), at=piston, state="x")
    g.measure_flow("speed", piston, "speed of the piston")
    return g


def ram_rates(effect: bool) -> Rates:
    """Volumes squeezed in front and behind, speed and way of the piston."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        front, back = 5e10 * x[0], 5e10 * x[1]
        apart = front - back
        leak = 6e-12 * apart * (1.0 + abs(apart) / 1e6) ** -0.2 if effect else 0.0
        force = 1e-3 * apart - 2000.0 * x[2] - 4e4 * x[3]
        return [u[0] - 1e-3 * x[2] - leak, u[1] + 1e-3 * x[2] + leak, force / 60.0, x[2]]

    return rates


def ram_inputs(time: FloatArray, chance: np.random.Generator) -> FloatArray:
    """Both valves of one spool, and what each gives beside the other."""
    both = waves(time, chance, 2e-5, 0.15, 2.0)
    return np.array([both + waves(time, chance, 1e-6, 0.2, 2.0), -both])


RAM = Machine(
    ram, ram_rates, [0.0, 0.0, 0.0, 0.0], lambda x, u, effect: np.array([5e10 * x[0], 5e10 * x[1], x[2]]),
    [1e4, 1e4, 5e-4], ram_inputs, 0.02, 700,
    frozenset({"leakage_between at front and back", "orifice_between at front and back"}), frozenset(),
    "leak between the chambers 6e-12*p/(1 + |p|/1e6)^0.2",
)  # fmt: skip


def worn_rates(effect: bool) -> Rates:
    """The same with a seal whose gap is an orifice: turbulent, as Darcy and Weisbach have it for a rough one."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        front, back = 5e10 * x[0], 5e10 * x[1]
        apart = front - back
        leak = 1.5e-6 * np.sign(apart) * (abs(apart) / 1e5) ** 0.54 if effect else 0.0
        force = 1e-3 * apart - 2000.0 * x[2] - 4e4 * x[3]
        return [u[0] - 1e-3 * x[2] - leak, u[1] + 1e-3 * x[2] + leak, force / 60.0, x[2]]

    return rates


#: The ram with a worn seal; it is none of the twenty.
WORN_RAM = replace(RAM, rates=worn_rates, effect="turbulent leak between the chambers, 1.5e-6*(p/1e5)^0.54")

HYDRAULIC: Mapping[str, Machine] = {"tank": TANK, "press": PRESS, "pipe": PIPE, "ram": RAM}
