"""A carriage whose friction differs by direction, told by its position: what an unseen push leaves stays in it."""

from __future__ import annotations

import numpy as np

from bondgraph.build import build
from bondgraph.data.log import MatchedLog
from bondgraph.simulate.simulation import simulate
from vehicle_graphs import emps


def rides() -> MatchedLog:
    """A carriage that goes there and back, with dry friction and with viscous friction that differs by direction."""
    time = 0.01 * np.arange(1800)
    top = np.array([0.1, 0.1, 0.03, 0.03, 0.06, 0.06, 0.12, 0.12, 0.02])[(time // 2.0).astype(int)]
    way = np.where(time // 2.0 % 2 == 0, top, -top) * np.interp(time % 2.0, [0.0, 0.3, 1.6, 1.9], [0.2, 1.0, 1.0, 0.0])
    voltage = (20.2 * np.sign(way) + 206.0 * way - 39.0 * np.abs(way) + 95.0 * np.gradient(way, 0.01)) / 35.15065
    true = build(emps.declared(("coulomb_loss", "direction_dependent_drag"))).model
    truth = {
        "mass": 95.0, "viscous_friction": 206.0, "c_coulomb_loss_carriage": 20.2,
        "c_direction_dependent_drag_carriage": -39.0,
    }  # fmt: skip
    run = simulate(true, time, voltage[np.newaxis], truth, method="rk4", substeps=50)
    noise = 1e-7 * np.random.default_rng(1).standard_normal(run.y.shape)
    return MatchedLog("rides", time, voltage[np.newaxis], run.y + noise)
