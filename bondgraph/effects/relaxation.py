"""Parts with a time of their own: polarised cells, viscoelastic drag, eddy currents, slow storages, sprung masses.

An ordinary loss answers at once and an ordinary storage for ever; these do both one after the other. Each has a state
that follows by a first-order lag and vanishes with its coefficient. The time of the lag is a shape: it lies between the
time between samples and the length of the logs, outside of which the part is a mere loss or a mere storage. A mass on
a spring has a frequency instead.

References: Plett (2015), Battery Management Systems, volume 1, section 2.4, for a cell's polarisation; Ferry (1980),
Viscoelastic Properties of Polymers, for Maxwell's element; Madsen, Holst (1995), Energy and Buildings 22(1), for walls
with a temperature of their own; Pourmovahed, Otis (1990), ASME J. Dyn. Syst. Meas. Control 112(1), for gas
that gives the heat of compression to its walls; Zubieta, Bonert (2000), IEEE Trans. Industry Applications 36(1), for
double-layer capacitors whose pores fill late; Den Hartog (1956), Mechanical Vibrations, chapter 3, for masses on
springs or in oil; Vanderkooy (1989), J. Audio Eng. Soc. 37(3), for eddy currents beside a coil; Trikha (1975), ASME J.
Fluids Eng. 97(1), for friction in pipes that follows a change of the flow.
"""

from __future__ import annotations

from sympy import Expr, pi

from bondgraph.declare.domains import ELECTRICAL
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_integral
from bondgraph.derive.laws import affine_parts
from bondgraph.effects.places import (
    Words,
    coefficient,
    conductance,
    effort_unit,
    elements_at,
    flow_unit,
    has_effort,
    has_flow,
    is_motion,
    over,
)
from bondgraph.effects.storages import inertance_beside

#: Names of a slow storage beside a quick one in each domain, and where it is described.
_SLOW = Words("", "charge_redistribution", "gas_heat_exchange", "slow_heat_capacity")
_SLOWLY = {
    "charge_redistribution": "Zubieta, Bonert (2000), IEEE Trans. Industry Applications 36(1)",
    "gas_heat_exchange": "Pourmovahed, Otis (1990), ASME J. Dyn. Syst. Meas. Control 112(1)",
    "slow_heat_capacity": "Madsen, Holst (1995), Energy and Buildings 22(1)",
}
#: Names of an inertance behind a resistance, beside a declared one, and where it is described.
_DRAGGED = Words("dragged_mass", "eddy_currents", "unsteady_friction")
_DRAGGING = {
    "dragged_mass": "Den Hartog (1956), Mechanical Vibrations, chapter 3",
    "eddy_currents": "Vanderkooy (1989), J. Audio Eng. Soc. 37(3)",
    "unsteady_friction": "Trikha (1975), ASME J. Fluids Eng. 97(1)",
}
#: Frequencies at which a mass on a spring is tried, one every half octave or so where logs tell of two decades.
_FREQUENCIES = 12


def polarisation(g: BondGraph, at: Place) -> Effect | None:
    """A resistance with a condenser across it: ions that must diffuse, a double layer, a slow part of a cell."""
    if not (has_flow(at) and at.domain == ELECTRICAL and elements_at(g, at, "R")):
        return None
    return _relaxing(
        g, at, "polarisation", "Plett (2015), Battery Management Systems, volume 1, section 2.4",
        "a step of the current, then rest",
    )  # fmt: skip


def viscoelastic_drag(g: BondGraph, at: Place) -> Effect | None:
    """A spring and a damper in series: rubber and oil that hold a quick motion like a spring and a slow one hardly."""
    if not (is_motion(at) and elements_at(g, at, "R")):
        return None
    return _relaxing(
        g, at, "viscoelastic_drag", "Ferry (1980), Viscoelastic Properties of Polymers",
        "quick motions and slow ones",
    )  # fmt: skip


def slow_heat_capacity(g: BondGraph, at: Place) -> Effect | None:
    """A storage that fills slowly beside a quick one: a wall that takes up heat, pores that take up charge.

    Gas that warms as it is compressed is another. The slow part begins at the effort of the quick one, whatever that
    is, so that the lead of the quick one is its state.
    """
    word = _SLOW.at(at) if has_effort(at) else ""
    slope = rate_of_storage(g, at, "C", "effort", "displacement", "flow") if word else None
    if slope is None:
        return None
    unit = over(flow_unit(at), effort_unit(at))
    name, c = conductance(g, at, word, "conductance to the slow part", unit, 1)
    time = _time(g, at, name)
    lead = g.integral(
        f"lead_{name}", lambda y: slope - y / time, effort_unit(at), f"effort of {at.label} over that of the slow part"
    )  # fmt: skip
    g.flow_source(name, -c * lead, at=at.junction)
    return Effect(
        word, name, "flow = c*(effort - x), dx/dt = (effort - x)/T", (c.name,), shapes=(time.name,),
        reference=_SLOWLY[word], dissipative=True, manoeuvre="a step of the flow, then time to settle",
    )  # fmt: skip


def dragged_mass(g: BondGraph, at: Place) -> Effect | None:
    """An inertance that a resistance drags along: a ring in oil, eddy currents in iron, layers of a flow in a pipe.

    In steady flow it gives nothing. It rides along at first, so that its lag in flow is its state.
    """
    word = _DRAGGED.at(at) if has_flow(at) else ""
    slope = rate_of_storage(g, at, "I", "flow", "momentum", "effort") if word else None
    if slope is None:
        return None
    meaning = f"resistance to a quick change, {word.replace('_', ' ')}"
    name, c = coefficient(g, at, word, meaning, over(effort_unit(at), flow_unit(at)), power=1)
    time = _time(g, at, name)
    lead = g.integral(
        f"lead_{name}", lambda y: slope - y / time, flow_unit(at), f"flow of {at.label} over that of the dragged part"
    )  # fmt: skip
    g.effort_source(name, -c * lead, at=at.junction)
    return Effect(
        word, name, "effort = c*(flow - x), dx/dt = (flow - x)/T", (c.name,), shapes=(time.name,),
        reference=_DRAGGING[word], dissipative=True, manoeuvre="a step of the effort, then time to settle",
    )  # fmt: skip


def sprung_mass(g: BondGraph, at: Place) -> Effect | None:
    """A mass on a spring beside what moves: liquid that sloshes, a load that hangs, a cab on its mounts.

    It rides along at first, so that its lag in speed is its state.
    """
    declared = inertance_beside(g, at.junction) if is_motion(at) else None
    acceleration = None if declared is None else rate_of_storage(g, at, "I", "flow", "momentum", "effort")
    if declared is None or acceleration is None:
        return None
    name = f"sprung_mass_{at.name}"
    size, unit = declared
    c = g.parameter(f"c_{name}", 0.0, unit, f"mass on a spring at {at.label}", (0.0, size))
    shortest, longest = at.times
    slowest, fastest = 1.0 / longest, 0.25 / shortest
    grid = tuple(slowest * (fastest / slowest) ** ((k + 0.5) / _FREQUENCIES) for k in range(_FREQUENCIES))
    f = g.parameter(f"f_{name}", (slowest * fastest) ** 0.5, "Hz", "natural frequency of it", (slowest, fastest))
    z = g.parameter(f"z_{name}", 0.2, "1", "damping ratio of it", (0.002, 2.0))
    omega = 2 * pi * f
    behind = g.integral(f"behind_{name}", 0, flow_unit(at), f"flow at {at.label} over that of the mass")
    pull = g.integral(f"pull_{name}", omega**2 * behind, over(flow_unit(at), "s"), "force of the spring over the mass")
    drawn = pull + 2 * z * omega * behind
    revise_integral(g, f"behind_{name}", acceleration - drawn)
    g.effort_source(name, -c * drawn, at=at.junction)
    law = "effort = c*a, a = p + 4*pi*z*f*y, dy/dt = d(flow)/dt - a, dp/dt = (2*pi*f)^2*y"
    return Effect(
        "sprung_mass", name, law, (c.name,), shapes=(f.name, z.name), grids=((f.name, grid), (z.name, (0.2,))),
        reference="Den Hartog (1956), Mechanical Vibrations, chapter 3", manoeuvre="steps, then time to swing out",
    )  # fmt: skip


def rate_of_storage(g: BondGraph, at: Place, kind: str, gives: str, stored: str, driven: str) -> Expr | None:
    """The rate of change of what a straight storage there gives, by what drives it; None without one."""
    for node in elements_at(g, at, kind):
        law = node.law(gives)
        parts = None if law is None else affine_parts(law, symbol(stored))
        if parts is not None and symbol(stored) not in parts[0].free_symbols:
            return parts[0] * signal(driven, node.name)
    return None


def _relaxing(g: BondGraph, at: Place, effect: str, reference: str, manoeuvre: str) -> Effect:
    """An effort that follows the flow by a lag: a resistance across a capacity, or a spring in series with a damper."""
    meaning = f"{effect.replace('_', ' ')} in steady flow"
    name, c = coefficient(g, at, effect, meaning, over(effort_unit(at), flow_unit(at)), power=1)
    time = _time(g, at, name)
    flow = at.junction.flow
    follows = g.integral(
        f"follows_{name}", lambda x: (flow - x) / time, flow_unit(at), f"flow at {at.label} as it relaxes"
    )  # fmt: skip
    g.effort_source(name, -c * follows, at=at.junction)
    return Effect(
        effect, name, "effort = c*x, dx/dt = (flow - x)/T", (c.name,), shapes=(time.name,), reference=reference,
        dissipative=True, manoeuvre=manoeuvre,
    )  # fmt: skip


def _time(g: BondGraph, at: Place, name: str) -> Expr:
    """The time in which the part follows, which starts in the middle of what the logs can tell."""
    shortest, longest = at.times
    return g.parameter(
        f"T_{name}", (shortest * longest) ** 0.5, "s", f"time in which the part at {at.label} follows", at.times
    )
