"""Electrical machines: a choke whose iron saturates, a varistor, a slip ring, a ceramic condenser."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

import bondgraph as bg
from bondgraph.data.log import FloatArray
from tests.effects.machines.machine import Machine, Rates, steps

# ------------------------------------------------------------------ iron that saturates, as Froehlich has it

_L, _KNEE = 0.1, 6.0


def choke() -> bg.BondGraph:
    g = bg.BondGraph("choke", doc="A choke in front of a condenser with a load.")
    u = g.input("u", "V", "voltage")
    loop, node = g.one_junction("loop", bg.ELECTRICAL), g.zero_junction("node", bg.ELECTRICAL)
    g.effort_source("supply", u, at=loop)
    g.inertance("winding", g.parameter("L", 0.09, "V s/A", "inductance", (0.02, 0.4)), at=loop, state="i")
    g.resistance("copper", g.parameter("R", 1.0, "V/A", "copper", (0.2, 5.0)), at=loop)
    g.bond(loop, node)
    g.compliance("condenser", 1 / g.parameter("C", 1.1e-3, "A s/V", "capacitance", (3e-4, 4e-3)), at=node, state="q")
    g.resistance("load", g.parameter("R_load", 4.5, "V/A", "load", (1.0, 20.0)), at=node)
    g.measure_flow("current", loop, "current of the choke")
    g.measure_effort("voltage", node, "voltage of the load")
    return g


def choke_current(flux: FloatArray, effect: bool) -> FloatArray:
    share = np.clip(np.abs(flux) / (_L * _KNEE), 0.0, 0.99)
    return flux / _L / (1.0 - share) if effect else flux / _L


def choke_rates(effect: bool) -> Rates:
    """Flux and charge."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        current, voltage = choke_current(x[0], effect), x[1] / 1e-3
        return [u[0] - 1.2 * current - voltage, current - voltage / 4.0]

    return rates


CHOKE = Machine(
    choke, choke_rates, [0.0, 0.0], lambda x, u, effect: np.array([choke_current(x[0], effect), x[1] / 1e-3]),
    [0.01, 0.04], lambda time, chance: steps(time, chance, -14.0, 14.0, 0.06)[np.newaxis], 0.002, 700,
    frozenset({"magnetic_saturation at loop"}), frozenset({"flow of loop", "momentum of winding"}),
    "flux i*L/(1 + |i|/6)",
)  # fmt: skip

# ------------------------------------------------------------------ a varistor, whose current is a ninth power


def clamp() -> bg.BondGraph:
    g = bg.BondGraph("clamp", doc="A line that feeds a load with a condenser.")
    u = g.input("u", "V", "voltage")
    line, node = g.one_junction("line", bg.ELECTRICAL), g.zero_junction("node", bg.ELECTRICAL)
    g.effort_source("supply", u, at=line)
    g.resistance("wire", g.parameter("R", 9.0, "V/A", "line", (2.0, 40.0)), at=line)
    g.bond(line, node)
    g.compliance("condenser", 1 / g.parameter("C", 9e-4, "A s/V", "capacitance", (2e-4, 4e-3)), at=node, state="q")
    g.resistance("load", g.parameter("R_load", 45.0, "V/A", "load", (10.0, 200.0)), at=node)
    g.measure_effort("voltage", node, "voltage of the load")
    return g


def clamp_rates(effect: bool) -> Rates:
    """Charge."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        v = x[0] / 1e-3
        clamped = 0.2 * (v / 12.0) ** 9 if effect else 0.0
        return [(u[0] - v) / 10.0 - v / 40.0 - clamped]

    return rates


CLAMP = Machine(
    clamp, clamp_rates, [0.0], lambda x, u, effect: x / 1e-3, [0.03],
    lambda time, chance: steps(time, chance, 0.0, 20.0, 0.03)[np.newaxis], 0.002, 700,
    frozenset({"breakdown at node"}), frozenset({"effort of node"}), "current 0.2*(v/12)^9",
)  # fmt: skip

# ------------------------------------------------------------------ a slip ring, whose drop is a fraction


def ring() -> bg.BondGraph:
    g = bg.BondGraph("ring", doc="A winding fed over a slip ring.")
    u = g.input("u", "V", "voltage")
    loop = g.one_junction("loop", bg.ELECTRICAL)
    g.effort_source("supply", u, at=loop)
    g.inertance("winding", g.parameter("L", 0.06, "V s/A", "inductance", (0.01, 0.3)), at=loop, state="i")
    g.resistance("copper", g.parameter("R", 2.7, "V/A", "copper", (0.5, 10.0)), at=loop)
    g.measure_flow("current", loop, "current")
    return g


def ring_rates(effect: bool) -> Rates:
    """Current."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        drop = 1.6 * x[0] / (abs(x[0]) + 0.04) if effect else 0.0
        return [(u[0] - 3.0 * x[0] - drop) / 0.05]

    return rates


RING = Machine(
    ring, ring_rates, [0.0], lambda x, u, effect: x, [0.01],
    lambda time, chance: steps(time, chance, -10.0, 10.0, 0.05)[np.newaxis], 0.002, 700,
    frozenset({"contact_drop at loop"}), frozenset({"flow of loop"}), "drop 1.6*i/(|i| + 0.04)",
)  # fmt: skip

# ------------------------------------------------------------------ a ceramic condenser, whose voltage is a tangent


def filtered() -> bg.BondGraph:
    g = bg.BondGraph("filtered", doc="A resistor and a condenser with a load.")
    u = g.input("u", "V", "voltage")
    line, node = g.one_junction("line", bg.ELECTRICAL), g.zero_junction("node", bg.ELECTRICAL)
    g.effort_source("supply", u, at=line)
    g.resistance("resistor", g.parameter("R", 100.0, "V/A", "resistor"), at=line)
    g.bond(line, node)
    g.compliance("ceramic", 1 / g.parameter("C", 8e-5, "A s/V", "capacitance", (2e-5, 4e-4)), at=node, state="q")
    g.resistance("load", g.parameter("R_load", 900.0, "V/A", "load", (200.0, 5000.0)), at=node)
    g.measure_effort("voltage", node, "voltage of the condenser")
    return g


def ceramic_voltage(charge: FloatArray, effect: bool) -> FloatArray:
    straight = charge / 1e-4
    return 12.0 * np.tan(np.clip(straight / 12.0, -1.5, 1.5)) if effect else straight


def filtered_rates(effect: bool) -> Rates:
    """Charge."""

    def rates(x: FloatArray, u: FloatArray) -> Sequence[float]:
        v = ceramic_voltage(x[0], effect)
        return [(u[0] - v) / 100.0 - v / 1000.0]

    return rates


CERAMIC = Machine(
    filtered, filtered_rates, [0.0], lambda x, u, effect: ceramic_voltage(x, effect), [0.03],
    lambda time, chance: steps(time, chance, -14.0, 14.0, 0.03)[np.newaxis], 0.002, 700,
    frozenset({"voltage_dependent_capacitance at node"}), frozenset({"displacement of ceramic"}),
    "voltage 12*tan(q/(12*C))",
)  # fmt: skip

ELECTRICAL: Mapping[str, Machine] = {"choke": CHOKE, "clamp": CLAMP, "ring": RING, "ceramic": CERAMIC}
