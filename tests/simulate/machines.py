"""Machines with modes whose motion is known in closed form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sympy

from bondgraph.declare.domains import ELECTRICAL, ROTATION, TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.modal import clutch, friction, impact
from bondgraph.declare.quantities import symbol
from bondgraph.declare.switching import positive_part
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import check_closed, derive
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.generate.module import render
from bondgraph.simulate.model import Model

TIME = symbol("t")


def exact(graph: BondGraph, smooth: bool = False) -> Model:
    """The model of a graph with modes, or smooth."""
    equations = derive(assign_causality(graph), smooth=smooth)
    check_closed(equations)
    check_dimensions(equations)
    return Model.from_text(render(equations), graph.name)


def engagement() -> BondGraph:
    """Two rotors, the first spinning, joined by a clutch; the heat in it is counted."""
    g = BondGraph("engagement")
    torque, grip = g.input("torque", "N m"), g.input("grip", "1", default=1.0)
    width, capacity = g.parameter("width", 0.1, "rad/s"), g.parameter("capacity", 20.0, "N m")
    drive, load = g.one_junction("drive", ROTATION), g.one_junction("load", ROTATION)
    g.effort_source("engine", torque, at=drive)
    g.inertance("rotor_1", g.parameter("J1", 0.2, "kg m^2"), at=drive, initial=100.0)
    g.inertance("rotor_2", g.parameter("J2", 0.5, "kg m^2"), at=load)
    plates = clutch(g, "plates", capacity * grip, drive, load, width=width)
    g.integral("heat", plates.effort * plates.flow, "J")
    g.measure_effort("clutch_torque", "plates")
    return g


def belt() -> BondGraph:
    """A block on a moving belt, held by a spring: the stick-slip oscillator."""
    g = BondGraph("belt")
    width = g.parameter("width", 1e-3, "m/s")
    sliding, static = g.parameter("F_sliding", 2.0, "N"), g.parameter("F_static", 3.0, "N")
    belt, block = g.one_junction("belt", TRANSLATION), g.one_junction("block", TRANSLATION)
    g.flow_source("drive", g.parameter("v_belt", 0.1, "m/s"), at=belt)
    g.inertance("mass", g.parameter("m", 1.0, "kg"), at=block, state="v", initial=0.1)
    g.compliance("spring", g.parameter("k", 100.0, "N/m"), at=block, state="q")
    clutch(g, "grip", sliding, belt, block, width=width, static=static)
    return g


def train(masses: Sequence[float], capacities: Sequence[float], ground: Sequence[float] = ()) -> BondGraph:
    """Masses in a row, each pushed by its own force, with friction between neighbours and on the ground."""
    g = BondGraph("train")
    width = g.parameter("width", 1e-3, "m/s")
    junctions = []
    for i, mass in enumerate(masses):
        junctions.append(g.one_junction(f"v{i}", TRANSLATION))
        g.inertance(f"mass{i}", g.parameter(f"m{i}", mass, "kg"), at=junctions[i])
        g.effort_source(f"push{i}", g.input(f"F{i}", "N"), at=junctions[i])
    for i, level in enumerate(capacities):
        clutch(g, f"grip{i}", g.parameter(f"c{i}", level, "N"), junctions[i], junctions[i + 1], width=width)
    for i, level in enumerate(ground):
        friction(g, f"floor{i}", g.parameter(f"f{i}", level, "N"), width=width, at=junctions[i])
    return g


def geared() -> BondGraph:
    """A clutch that drives a rotor and, through a gear, another one that depends on it and is braked."""
    g = BondGraph("geared")
    width, ratio = g.parameter("width", 1e-3, "rad/s"), g.parameter("ratio", 3.0, "1")
    a, b, c = (g.one_junction(name, ROTATION) for name in ("a", "b", "c"))
    g.inertance("rotor_a", g.parameter("Ja", 1.0, "kg m^2"), at=a, initial=10.0)
    g.inertance("rotor_b", g.parameter("Jb", 2.0, "kg m^2"), at=b)
    g.transformer("gear", ratio, b, c)
    g.inertance("rotor_c", g.parameter("Jc", 3.0, "kg m^2"), at=c)
    clutch(g, "plates", g.parameter("capacity", 4.0, "N m"), a, b, width=width)
    friction(g, "brake", g.parameter("drag", 0.5, "N m"), width=width, at=c)
    return g


def ball(restitution: float = 0.8, floor: float = 0.0) -> BondGraph:
    """A ball dropped from one metre above a floor that it hits without being deformed."""
    g = BondGraph("ball")
    m, gravity = g.parameter("m", 2.0, "kg"), g.parameter("g", 9.81, "m/s^2")
    level, e = g.parameter("level", floor, "m"), g.parameter("e", restitution, "1")
    v = g.one_junction("v", TRANSLATION)
    g.inertance("body", m, at=v, state="v")
    g.effort_source("weight", -m * gravity, at=v)
    height = g.integral("height", v.flow, "m", initial=floor + 1.0)
    stiffness, width = g.parameter("k", 1e6, "N/m"), g.parameter("width", 1e-6, "m")
    impact(g, "floor", height - level, e, stiffness=stiffness, width=width, at=v)
    g.measure_effort("floor_force", "floor")
    return g


def cradle(balls: int = 3, restitution: float = 1.0) -> BondGraph:
    """Newton's cradle: equal balls in a row that touch, the first flying towards them."""
    g = BondGraph("cradle")
    e, width = g.parameter("e", restitution, "1"), g.parameter("width", 1e-6, "m")
    stiffness, mass = g.parameter("k", 1e6, "N/m"), g.parameter("m", 1.0, "kg")
    junctions = [g.one_junction(f"v{i}", TRANSLATION) for i in range(balls)]
    places = [g.integral(f"x{i}", j.flow, "m", initial=-1.0 if i == 0 else 0.0) for i, j in enumerate(junctions)]
    for i, junction in enumerate(junctions):
        g.inertance(f"ball{i}", mass, at=junction, initial=1.0 if i == 0 else 0.0)
    for i in range(balls - 1):
        between = g.zero_junction(f"between{i}", TRANSLATION)
        g.bond(junctions[i + 1], between)
        g.bond(between, junctions[i])
        impact(g, f"hit{i}", places[i + 1] - places[i], e, stiffness=stiffness, width=width, at=between)
    return g


def room(seed: int) -> BondGraph:
    """Three bodies that slide on a rough floor between two walls and hit each other, the middle one on a spring."""
    rng = np.random.default_rng(seed)
    g = BondGraph("room")
    width, size = g.parameter("width", 1e-3, "m/s"), g.parameter("size", 1.0, "m")
    e = g.parameter("e", float(rng.uniform(0.0, 1.0)), "1")
    stiffness, depth = g.parameter("k", 1e6, "N/m"), g.parameter("depth", 1e-6, "m")
    wall = g.one_junction("wall", TRANSLATION)
    g.flow_source("fixed", 0, at=wall)
    bodies = [g.one_junction(f"body{i}", TRANSLATION) for i in range(3)]
    places = [g.integral(f"x{i}", body.flow, "m", initial=float(i)) for i, body in enumerate(bodies)]
    for i, body in enumerate(bodies):
        mass, level = (g.parameter(n, float(rng.uniform(*r)), u) for n, r, u in (
            (f"m{i}", (0.5, 3.0), "kg"), (f"c{i}", (0.1, 1.0), "N")
        ))  # fmt: skip
        g.inertance(f"mass{i}", mass, at=body, state=f"v{i}", initial=float(rng.uniform(-3.0, 3.0)))
        friction(g, f"floor{i}", level, width=width, at=body)
    g.compliance("spring", g.parameter("k_spring", float(rng.uniform(1.0, 30.0)), "N/m"), at=bodies[1], initial=0.3)
    pairs = [(places[0] + size, bodies[0], wall), (3 * size - places[2], wall, bodies[2])]
    pairs += [(places[i + 1] - places[i], bodies[i + 1], bodies[i]) for i in range(2)]
    for i, (gap, front, behind) in enumerate(pairs):
        between = g.zero_junction(f"between{i}", TRANSLATION)
        g.bond(front, between)
        g.bond(between, behind)
        impact(g, f"hit{i}", gap, e, stiffness=stiffness, width=depth, at=between)
    return g


def shaker() -> BondGraph:
    """A body that rests on a table which moves up and down faster than gravity can follow."""
    g = BondGraph("shaker")
    m, gravity = g.parameter("m", 2.0, "kg"), g.parameter("g", 9.81, "m/s^2")
    amplitude, omega = g.parameter("amplitude", 0.01, "m"), g.parameter("omega", 50.0, "rad/s")
    body, table = g.one_junction("body", TRANSLATION), g.one_junction("table", TRANSLATION)
    lift = amplitude * sympy.sin(omega * TIME)
    g.flow_source("motor", sympy.diff(lift, TIME), at=table)
    g.inertance("mass", m, at=body, state="v", initial=0.5)
    g.effort_source("weight", -m * gravity, at=body)
    height = g.integral("height", body.flow, "m")
    between = g.zero_junction("between", TRANSLATION)
    g.bond(body, between)
    g.bond(between, table)
    stiffness, width = g.parameter("k", 1e7, "N/m"), g.parameter("width", 1e-7, "m")
    impact(g, "table_top", height - lift, g.parameter("e", 0.3, "1"), stiffness=stiffness, width=width, at=between)
    return g


def rectifier() -> BondGraph:
    """A sine voltage, an ideal diode with a conductance, a capacitor and a load."""
    g = BondGraph("rectifier")
    conductance, load = g.parameter("G", 10.0, "S"), g.parameter("R", 10.0, "ohm")
    capacity, width = g.parameter("C", 1e-3, "F"), g.parameter("width", 1e-3, "V")
    amplitude, omega = g.parameter("amplitude", 1.0, "V"), g.parameter("omega", 314.0, "rad/s")
    loop, node = g.one_junction("loop", ELECTRICAL), g.zero_junction("node", ELECTRICAL)
    g.effort_source("supply", amplitude * sympy.sin(omega * TIME), at=loop)
    g.resistance("diode", flow=lambda e: conductance * positive_part(e, width), at=loop)
    g.bond(loop, node)
    g.compliance("capacitor", 1 / capacity, at=node, state="q", initial=5e-4)
    g.resistance("load", load, at=node)
    g.measure_effort("u", node)
    return g
