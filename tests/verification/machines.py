"""The published models, declared as the toolkit takes them: as bond graphs.

Units are those of the cases: numbers are carried as they were published, so a time in minutes stands as one in seconds.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from sympy import Symbol, cos, sin

from bondgraph.build import build
from bondgraph.declare.domains import ELECTRICAL, ROTATION, TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.handles import Handle
from bondgraph.simulate.model import Model

Rates = Callable[..., Sequence[Any]]


def built(declare: Callable[..., BondGraph]) -> Callable[..., Model]:
    """The model of a declared graph, built once in a process."""

    @functools.cache
    def model(*arguments: Any) -> Model:
        return build(declare(*arguments)).model

    return model


def _mass(g: BondGraph, name: str, initial: float = 0.0) -> Handle:
    """A mass of 1 kg; its speed is the state ``v_NAME``."""
    body = g.one_junction(f"{name}_motion", TRANSLATION)
    g.inertance(name, g.parameter(f"m_{name}", 1.0, "kg"), at=body, initial=initial)
    return body


@built
def free_mass() -> BondGraph:
    """A mass that nothing pushes: its speed moves by process noise alone, a random walk."""
    g = BondGraph("free_mass")
    g.measure_flow("speed", _mass(g, "cart"))
    return g


@built
def cart() -> BondGraph:
    """A mass that nothing pushes, of which the place is measured: the constant-velocity model."""
    g = BondGraph("cart")
    g.measure("place", g.integral("x", _mass(g, "cart", initial=-0.5).flow, "m"), "m")
    return g


@built
def cannonball(gravity: float) -> BondGraph:
    """A mass in flight, along and up."""
    g = BondGraph("cannonball")
    along, up = _mass(g, "along"), _mass(g, "up")
    g.effort_source("weight", -g.parameter("gravity", gravity, "m/s^2") * g.parameter("m", 1.0, "kg"), at=up)
    g.measure("seen_x", g.integral("x", along.flow, "m"), "m")
    g.measure("seen_y", g.integral("y", up.flow, "m"), "m")
    return g


@built
def pendulum(gravity: float) -> BondGraph:
    """A pendulum of unit inertia, hanging; the sine of its angle is measured."""
    g = BondGraph("sine_pendulum")
    swing = g.one_junction("swing", ROTATION)
    weight = g.parameter("weight", gravity, "N m")
    g.inertance("bob", g.parameter("J", 1.0, "kg m^2"), at=swing)
    angle = g.compliance("gravity", lambda q: weight * sin(q), at=swing, state="angle").displacement
    g.measure("deflection", sin(angle), "1")
    return g


@built
def ornstein_uhlenbeck(held: bool) -> BondGraph:
    """A capacitor charged through a resistor, and one that follows it behind a buffer.

    dx1 = theta (mu + u - x1) dt + noise, dx2 = alpha (x1 - x2) dt + noise; u is ``held`` between samples, or a ramp.
    """
    g = BondGraph("ornstein_uhlenbeck")
    theta, alpha = g.parameter("theta", 5.0, "S"), g.parameter("alpha", 2.0, "S")
    supply = g.parameter("mu", 3.0, "V") + g.input("u", "V", hold=held)
    first = _charged(g, "x1", supply, theta)
    _charged(g, "x2", first.effort, alpha)
    return g


def _charged(g: BondGraph, name: str, supply: Any, conductance: Symbol) -> Handle:
    """A capacitor of 1 F behind a resistor; its voltage is measured as ``y_NAME``."""
    wire, node = g.one_junction(f"{name}_wire", ELECTRICAL), g.zero_junction(f"{name}_node", ELECTRICAL)
    g.effort_source(f"{name}_supply", supply, at=wire)
    g.resistance(f"{name}_resistor", flow=conductance, at=wire)
    g.bond(wire, node)
    g.compliance(name, g.parameter(f"elastance_{name}", 1.0, "V/C"), at=node, initial=3.0, state=name)
    g.measure_effort(f"y_{name}", node)
    return node


@built
def polar() -> BondGraph:
    """A point that stays, in polar coordinates; its rectangular ones are measured."""
    states = {"r": 1.0, "angle": 0.0}
    return rates_graph("polar", states, {}, lambda r, angle: (0, 0), lambda r, angle: (r * cos(angle), r * sin(angle)))


def rates_graph(
    name: str,
    states: Mapping[str, float],
    parameters: Mapping[str, float],
    rates: Rates,
    outputs: Rates,
    inputs: Sequence[str] = (),
) -> BondGraph:
    """A graph of given rates: each state the content of a store of unit capacity, filled by a source.

    ``rates`` and ``outputs`` take states, parameters and inputs by name, all pure numbers; outputs are y1, y2, ...
    """
    g = BondGraph(name)
    known = {key: g.input(key, "1", hold=True) for key in inputs}
    known |= {key: g.parameter(key, value, "1") for key, value in parameters.items()}
    stores = {key: g.zero_junction(f"{key}_node") for key in states}
    per_second = g.parameter("per_second", 1.0, "1/s")
    for key, store in stores.items():
        g.compliance(f"{key}_store", per_second, at=store, initial=states[key], state=key)
    known |= {key: store.effort for key, store in stores.items()}
    for (key, store), rate in zip(stores.items(), rates(**known), strict=True):
        g.flow_source(f"{key}_source", rate, at=store)
    for number, output in enumerate(outputs(**known), start=1):
        g.measure(f"y{number}", output, "1")
    return g
