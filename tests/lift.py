"""A lift on an elastic rope that is declared 15 % too stiff: its likelihood has a valley for every period."""

from __future__ import annotations

import numpy as np

import bondgraph as bg
from bondgraph.simulate.simulation import simulate

#: Parameters of the true lift.
TRUE = {"J": 60.0, "m": 1250.0, "k": 4e5, "b": 70.0}


def lift() -> bg.BondGraph:
    """A sheave and a cabin on an elastic rope, which is declared 15 % too stiff."""
    g = bg.BondGraph("lift")
    torque = g.input("torque", "N m", "motor", hold=True)
    sheave, rope = g.one_junction("sheave", bg.ROTATION), g.zero_junction("rope", bg.TRANSLATION)
    cabin = g.one_junction("cabin", bg.TRANSLATION)
    g.effort_source("motor", torque, at=sheave)
    g.inertance("drum", g.parameter("J", 45.0, "kg m^2", "", (18.0, 120.0)), at=sheave, state="omega")
    g.transformer("radius", 0.3, sheave, rope)
    g.compliance("ropes", g.parameter("k", 4.6e5, "N/m", "", (1.8e5, 1.2e6)), at=rope, state="stretch")
    g.bond(rope, cabin)
    g.inertance("mass", g.parameter("m", 1000.0, "kg", "", (400.0, 2500.0)), at=cabin, state="v")
    g.resistance("shoes", g.parameter("b", 50.0, "N s/m", "", (20.0, 200.0)), at=cabin)
    g.measure_flow("sheave_speed", sheave)
    g.measure_flow("cabin_speed", cabin)
    return g


def lift_logs(seed: int) -> list[bg.MatchedLog]:
    """Two logs of 14 s from the true lift."""
    model, logs = bg.build(lift()).model, []
    for number in (seed, seed + 1):
        chance, time = np.random.default_rng(number), 0.05 * np.arange(280)
        torque = np.repeat(chance.uniform(-150.0, 150.0, 14), 20)[np.newaxis]
        shown = simulate(model, time, torque, TRUE, rtol=1e-9).y
        noise = np.array([[0.02], [0.006]]) * chance.standard_normal(shown.shape)
        logs.append(bg.MatchedLog(f"run{number}", time, torque, shown + noise))
    return logs
