"""A driveline on a test bench: engine torque through a slipping belt and an elastic half-shaft to a vehicle.

The demonstration's machine, small enough to be read in one go: four states, four sensors. Its numbers are those of a
small utility vehicle in low gear, referred to the axle (a plausible machine, not a measured one).
"""

from __future__ import annotations

from sympy import tanh

from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.graph import BondGraph


def driveline() -> BondGraph:
    """The declared driveline: what the drawing shows, no effect beyond it."""
    g = BondGraph("driveline", doc=__doc__, source="vehicle_graphs/driveline.py")
    torque = g.input("engine_torque", "N m", "torque of the engine, from its map")
    grade = g.input("grade", "1", "sine of the road's inclination, uphill positive", default=0.0)

    J_primary = g.parameter("J_primary", 0.08, "kg m^2", "engine and primary sheave, from drawings")
    c_engine = g.parameter("c_engine", 0.02, "N m s", "drag of the engine", (0.002, 0.2))
    ratio = g.parameter("ratio", 6.0, "1", "engine speed over axle speed, belt gripping")
    tau_grip = g.parameter("tau_grip", 70.0, "N m", "torque that the belt can carry", (30.0, 150.0))
    w_slip = g.parameter("w_slip", 12.0, "rad/s", "slip speed at which the belt pulls 76 % of that")
    J_axle = g.parameter("J_axle", 2.5, "kg m^2", "secondary sheave, gears and brake discs")
    k_shaft = g.parameter("k_shaft", 4000.0, "N m/rad", "stiffness of the half-shaft", (1000.0, 12000.0))
    d_shaft = g.parameter("d_shaft", 40.0, "N m s/rad", "damping of the half-shaft")
    r_tyre = g.parameter("r_tyre", 0.3, "m", "dynamic tyre radius, measured")
    m_vehicle = g.parameter("m_vehicle", 600.0, "kg", "vehicle with driver, weighed")
    F_roll = g.parameter("F_roll", 120.0, "N", "rolling resistance", (20.0, 400.0))
    v_roll = g.parameter("v_roll", 0.2, "m/s", "speed at which rolling resistance reaches 76 %")
    c_aero = g.parameter("c_aero", 0.6, "kg/m", "air drag over speed squared, from a wind tunnel")
    gravity = g.parameter("gravity", 9.81, "m/s^2", "gravity")

    primary = g.one_junction("primary", ROTATION)
    belt = g.zero_junction("belt", ROTATION)
    axle = g.one_junction("axle", ROTATION)
    shaft = g.zero_junction("shaft", ROTATION)
    twist = g.one_junction("twist", ROTATION)
    wheel = g.one_junction("wheel", ROTATION)
    body = g.one_junction("body", TRANSLATION)

    g.effort_source("combustion", torque, at=primary)
    g.inertance("crankshaft", J_primary, at=primary, initial=120.0, state="omega_primary")
    g.resistance("engine_drag", lambda omega: c_engine * omega, at=primary)
    g.bond(primary, belt)
    g.resistance("belt_slip", lambda omega: tau_grip * tanh(omega / w_slip), at=belt)
    g.transformer("variator", 1 / ratio, belt, axle)
    g.inertance("axle_inertia", J_axle, at=axle, initial=20.0, state="omega_axle")
    g.bond(axle, shaft)
    g.bond(shaft, twist)
    g.compliance("half_shaft", k_shaft, at=twist, state="twist_shaft")
    g.resistance("shaft_damping", d_shaft, at=twist)
    g.bond(shaft, wheel)
    g.transformer("tyre", r_tyre, wheel, body)
    g.inertance("vehicle", m_vehicle, at=body, initial=6.0, state="v_body")
    g.resistance("rolling", lambda v: F_roll * tanh(v / v_roll), at=body)
    g.resistance("air", lambda v: c_aero * v * abs(v), at=body)
    g.effort_source("weight", -m_vehicle * gravity * grade, at=body)

    g.measure_flow("engine_speed", primary, "crankshaft speed")
    g.measure_flow("axle_speed", axle, "axle speed")
    g.measure_effort("shaft_torque", shaft, "torque in the half-shaft (strain gauge)")
    g.measure_flow("speed", body, "vehicle speed")
    return g
