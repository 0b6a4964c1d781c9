"""A thermometer of radiation that sees what is around: a fault of it, and no heat."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.result import intervals
from bondgraph.data.log import FloatArray

pytestmark = pytest.mark.slow


def furnace() -> bg.BondGraph:
    """A heated rod in a tube; a pyrometer sees the rod, a thermocouple is in the tube."""
    g = bg.BondGraph("furnace")
    rod, tube = g.zero_junction("rod", bg.THERMAL), g.zero_junction("tube", bg.THERMAL)
    gap, skin = g.one_junction("gap", bg.THERMAL), g.one_junction("skin", bg.THERMAL)
    g.flow_source("heater", g.input("power", "W"), at=rod)
    c_rod, c_tube = (
        g.parameter("C_rod", 60.0, "J/K", "", (20.0, 150.0)),
        g.parameter("C_tube", 300.0, "J/K", "", (100.0, 900.0)),
    )
    g.compliance("rod_heat", displacement=c_rod, at=rod, initial=c_rod * 420.0)
    g.bond(rod, gap)
    g.resistance("conduction", g.parameter("R", 0.9, "K/W", "", (0.3, 3.0)), at=gap)
    g.bond(gap, tube)
    g.compliance("tube_heat", displacement=c_tube, at=tube, initial=c_tube * 320.0)
    g.bond(tube, skin)
    g.resistance("convection", g.parameter("R_air", 0.4, "K/W", "", (0.1, 1.5)), at=skin)
    g.bond(skin, g.effort_source("room", g.parameter("T_room", 295.0, "K", "room", tolerance=0.0)))
    g.measure_effort("seen", rod, "pyrometer")
    g.measure_effort("touched", tube, "thermocouple")
    return g


def fired(seed: int, around: float) -> bg.MatchedLog:
    """A run by scipy; the pyrometer adds the radiation of what is around, by the fifth power in its band."""
    chance, time = np.random.default_rng(seed), 4.0 * np.arange(240)
    power = np.repeat(chance.uniform(20.0, 420.0, 12), 20)

    def rate(t: float, x: FloatArray) -> list[float]:
        passed = (x[0] - x[1]) / 0.8
        return [(np.interp(t, time, power) - passed) / 50.0, (passed - (x[1] - 295.0) / 0.45) / 340.0]

    run = solve_ivp(rate, (0.0, time[-1]), [420.0, 320.0], t_eval=time, max_step=4.0, rtol=1e-8)
    shown = np.array([(run.y[0] ** 5 + around**5) ** 0.2, run.y[1]])
    noise = np.array([2.0, 0.5])[:, np.newaxis] * chance.standard_normal(shown.shape)
    return bg.MatchedLog(f"run{seed}", time, power[np.newaxis], shown + noise)


@functools.cache
def closed(around: float) -> ClosedLoop:
    """The loop with default options on three logs."""
    return bg.close_loop(furnace(), [fired(1, around), fired(2, around)], holdout=[fired(3, around)])


def test_the_floor_is_found_at_its_sensor() -> None:
    """It was told as three flows of heat, one of them for a minute, as long as no sensor could have a floor."""
    loop = closed(400.0)
    (found,) = loop.added
    assert found.trial.candidate.label == "sensor_floor at sensor seen"
    lower, upper = intervals(loop.corrected)["c_floor_seen"]
    assert lower < 400.0 < upper and upper - lower < 40.0
    assert "sensor fault" in loop.verdict


def test_nothing_is_missing_where_it_sees_the_rod_alone() -> None:
    loop = closed(0.0)
    assert loop.verdict == "no missing effect"
