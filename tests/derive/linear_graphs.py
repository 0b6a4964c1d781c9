"""Machines, and equations written by hand, that tests of linear models and of transfer functions share."""

from __future__ import annotations

from bondgraph.declare.domains import ELECTRICAL, ROTATION, TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Input, Parameter, symbol
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.derive.equations import Assignment, OutputEquation, State, StateEquations

X, Y, A, B, U = (symbol(name) for name in ("x_1", "x_2", "a", "b", "u"))


def derived(graph):
    return derive(assign_causality(graph))


def by_hand(*assignments, derivatives=(), outputs=(), states=(X, Y), tables=(), initial=0.0):
    return StateEquations(
        "by_hand", "", "", tuple(State(s, "", initial, "", "", "flow") for s in states), (Input("u", ""),),
        tuple(Parameter(p.name, 1.5, "") for p in (A, B)), tuple(tables), tuple(assignments), tuple(derivatives),
        tuple(OutputEquation(symbol(f"y_{i}"), value, "", "") for i, value in enumerate(outputs)),
    )  # fmt: skip


def assign(name, expression):
    return Assignment(symbol(name), expression, "", "")


def oscillator():
    """A driven mass on a spring and a damper."""
    g = BondGraph("oscillator")
    m, k, c = g.parameter("m", 2.0, "kg"), g.parameter("k", 8.0, "N/m"), g.parameter("c", 0.5, "N s/m")
    body = g.one_junction("body", TRANSLATION)
    g.effort_source("push", g.input("F", "N"), at=body)
    g.inertance("mass", m, at=body, state="v")
    g.compliance("spring", k, at=body, state="q")
    g.resistance("damper", c, at=body)
    g.measure("power", symbol("F") * body.flow, "W")
    g.measure_flow("speed", body)
    return g


def motor():
    """A motor with an armature and a rotor."""
    g = BondGraph("motor")
    u = g.input("u_a", "V")
    L, R, k = g.parameter("L", 0.01, "H"), g.parameter("R", 1.0, "ohm"), g.parameter("k_m", 0.1, "N m/A")
    J, b = g.parameter("J", 0.02, "kg m^2"), g.parameter("b", 0.1, "N m s")
    loop, shaft = g.one_junction("loop", ELECTRICAL), g.one_junction("shaft", ROTATION)
    g.effort_source("supply", u, at=loop)
    g.inertance("coil", L, at=loop, state="i")
    g.resistance("winding", R, at=loop)
    g.gyrator("machine", k, loop, shaft)
    g.inertance("rotor", J, at=shaft, state="omega")
    g.resistance("bearing", b, at=shaft)
    g.measure_flow("speed", shaft)
    return g
