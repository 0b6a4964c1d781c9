"""A winch whose coupling grips: a stiff model with a walk that nobody measures, its logs and its fits."""

from __future__ import annotations

import functools

import numpy as np
from sympy import tanh

from bondgraph.build import BuiltModel, build
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import ROTATION
from bondgraph.declare.editing import with_values
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import FilterSetup, filter_setup
from bondgraph.simulate.simulation import simulate

NOISE = np.array([[0.02], [0.02], [0.01]])


def winch(loss: float = 0.0) -> BondGraph:
    """A motor drives a drum through a coupling that grips; the drum hangs on a slope that nobody measures."""
    g = BondGraph("winch", doc="motor, gripping coupling, drum")
    torque = g.input("torque", "N m", "torque of the motor")
    bend = g.input("bend", "rad/s", "rate of the slope, which no log has")
    slope = g.integral("slope", bend, "rad", "slope of the ground")
    J_motor = g.parameter("J_motor", 0.05, "kg m^2", "motor")
    J_drum = g.parameter("J_drum", 0.4, "kg m^2", "drum")
    grip = g.parameter("grip", 30.0, "N m", "torque that the coupling carries", (10.0, 60.0))
    slip = g.parameter("slip", 0.1, "rad/s", "slip at which it carries 76 % of that")
    c = g.parameter("c", 0.2, "N m s", "drag of the drum", (0.05, 1.0))
    weight = g.parameter("weight", 4.0, "N m", "torque of the load per slope")
    motor, drum = g.one_junction("motor", ROTATION), g.one_junction("drum", ROTATION)
    coupling = g.zero_junction("coupling", ROTATION)
    g.effort_source("drive", torque, at=motor)
    g.inertance("rotor", J_motor, at=motor, state="w_motor")
    g.bond(motor, coupling)
    g.resistance("clutch", lambda w: grip * tanh(w / slip), at=coupling)
    g.bond(coupling, drum)
    g.inertance("barrel", J_drum, at=drum, state="w_drum")
    g.resistance("drag", lambda w: c * w, at=drum)
    g.effort_source("load", -weight * slope, at=drum)
    if loss:
        level = g.parameter("loss", loss, "N m s^2", "what nobody declared")
        g.resistance("undeclared", lambda w: level * w * abs(w), at=drum)
    g.measure_flow("motor_speed", motor, "speed of the motor")
    g.measure_flow("drum_speed", drum, "speed of the drum")
    g.measure("slope_seen", slope, "rad", "inclinometer")
    return g


@functools.cache
def built() -> BuiltModel:
    return build(winch())


def drawn(loss: float, seed: int = 1, samples: int = 500) -> MatchedLog:
    rng = np.random.default_rng(seed)
    time = 0.05 * np.arange(samples)
    torque = np.repeat(rng.uniform(0.0, 9.0, samples // 20 + 1), 20)[:samples]
    bend = np.repeat(rng.normal(0.0, 0.15, samples // 10 + 1), 10)[:samples]
    model = build(with_values(winch(loss), {"c": 0.3})).model
    run = simulate(model, time, np.array([torque, bend]), rtol=1e-8).raise_if_failed()
    y = run.y + NOISE * rng.standard_normal(run.y.shape)
    return MatchedLog("run", time, np.array([torque, np.zeros(samples)]), y)


def setup_of(log: MatchedLog) -> FilterSetup:
    return filter_setup(built().model, built().driven, [log])


def fitted_to(log: MatchedLog) -> Fit:
    setup = setup_of(log)
    return fit(EstimationProblem(setup.filter_model, (log,), (*free_parameters(setup, ()), *setup.noise)))


@functools.cache
def fitted(loss: float) -> Fit:
    return fitted_to(drawn(loss))
