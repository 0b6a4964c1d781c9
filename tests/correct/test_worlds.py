"""Machines whose truth is integrated by scipy with laws that no dictionary has, and with what real logs have besides.

Sensors are filtered and quantised, something that nothing measures wanders, inputs are held.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lfilter
from sympy import tanh

import bondgraph as bg
from bondgraph.data.log import MatchedLog
from bondgraph.declare.expressions import signal

#: Steps in which worlds are integrated, and steps between samples.
_FINE = 5


def wandering(chance: np.random.Generator, count: int, step: float, std: float, seconds: float) -> np.ndarray:
    """An Ornstein-Uhlenbeck process: (count,) values, a step apart."""
    kept = np.exp(-step / seconds)
    noise = std * np.sqrt(1.0 - kept**2) * chance.standard_normal(count)
    return np.asarray(lfilter([1.0], [1.0, -kept], noise))


def late(values: np.ndarray, step: float, seconds: float) -> np.ndarray:
    """Values behind a sensor of first order."""
    kept = np.exp(-step / seconds)
    return np.asarray(lfilter([1.0 - kept], [1.0, -kept], values, zi=[kept * values[0]])[0])


def levels(chance: np.random.Generator, count: int, each: int, low: float, high: float) -> np.ndarray:
    """A new level every ``each`` samples."""
    return np.repeat(chance.uniform(low, high, count // each + 1), each)[:count]


def course(rate: Callable[[int, np.ndarray], list[float]], x0: list[float], count: int, step: float) -> np.ndarray:
    """States (n, count) of a world whose inputs are told by the number of the fine step."""

    def along(t: float, x: np.ndarray) -> list[float]:
        return rate(min(int(t / step + 1e-9), count - 1), x)

    time = step * np.arange(count)
    run = solve_ivp(along, (0.0, time[-1]), x0, method="LSODA", t_eval=time, rtol=1e-7, atol=1e-9, max_step=step)
    assert run.success
    return np.asarray(run.y)


def conveyor() -> bg.BondGraph:
    """A belt conveyor whose friction does not know its payload."""
    g = bg.BondGraph("conveyor")
    force = g.input("force", "N", hold=True)
    g.input("payload", "kg")
    belt = g.one_junction("belt", bg.TRANSLATION)
    g.effort_source("drum", force, at=belt)
    g.inertance("moved", g.parameter("m", 7000.0, "kg", "", (2000.0, 20000.0)), at=belt, state="v")
    g.resistance("oil", g.parameter("d", 300.0, "N s/m", "", (30.0, 2000.0)), at=belt)
    dry, width = g.parameter("dry", 500.0, "N", "", (50.0, 3000.0)), g.parameter("width", 0.05, "m/s")
    g.resistance("idlers", lambda v: dry * tanh(v / width), at=belt)
    g.measure_flow("speed", belt)
    return g


def conveyed(seed: int) -> MatchedLog:
    """Friction of 0.294 N per kg of payload, lumps that nobody sees, a speed that is filtered over 0.1 s."""
    chance, count, step = np.random.default_rng(seed), 4000, 0.05
    force = np.repeat(levels(chance, count // _FINE, 48, 900.0, 2600.0), _FINE)
    payload = late(np.maximum(levels(chance, count, 360, -200.0, 2200.0), 0.0), step, 3.0)
    lumps = wandering(chance, count, step, 25.0, 2.0)

    def rate(k: int, x: np.ndarray) -> list[float]:
        sign = x[0] / np.sqrt(x[0] ** 2 + 0.0025)
        return [(force[k] + lumps[k] - 250.0 * x[0] - (400.0 + 0.2943 * payload[k]) * sign) / 6000.0]

    (speed,) = course(rate, [1.0 + 0.3 * seed], count, step)
    every = slice(None, None, _FINE)
    shown = late(speed, step, 0.1)[every] + 0.004 * chance.standard_normal(count // _FINE)
    u = np.array([force[every], 5.0 * np.round(payload[every] / 5.0)])
    time = _FINE * step * np.arange(count // _FINE)
    return MatchedLog(f"run{seed}", time, u, 0.005 * np.round(shown / 0.005)[np.newaxis])


@pytest.mark.slow
def test_a_late_sensor_beside_friction_of_the_payload_leaves_a_model_that_simulates() -> None:
    """The state behind the sensor began at zero: the same law left free simulation a quarter worse."""
    closed = bg.close_loop(conveyor(), [conveyed(1), conveyed(2)], [conveyed(3)])
    laws = [one.trial.candidate.label for one in closed.added]
    assert "formula_line_of_payload at belt" in laws
    coefficient = closed.corrected.values["c_line_of_payload_belt"]
    assert coefficient == pytest.approx(0.2943, rel=0.1)
    before, after = (
        one.channels["speed"].simulation_rmse for one in (closed.nominal_holdout, closed.corrected_holdout)
    )  # fmt: skip
    assert after < 0.2 * before


def cell() -> bg.BondGraph:
    """A cell with one relaxation where diffusion has many."""
    g = bg.BondGraph("cell")
    current = g.input("i", "A", hold=True)
    loop, surface = g.one_junction("loop", bg.ELECTRICAL), g.zero_junction("surface", bg.ELECTRICAL)
    g.flow_source("load", current, at=loop)
    g.effort_source("emf", g.parameter("full", 4.1, "V"), at=loop)
    slope = g.parameter("C_b", 1.0e4, "F", "", (3e3, 5e4))
    g.compliance("charge", 1 / slope, at=loop, state="q", initial=1000.0)
    g.resistance("ohmic", g.parameter("R_0", 0.055, "ohm", "", (0.01, 0.2)), at=loop)
    g.bond(loop, surface)
    g.compliance("layer", 1 / g.parameter("C_1", 900.0, "F", "", (50.0, 2e4)), at=surface, state="q_1")
    g.resistance("transfer", g.parameter("R_1", 0.03, "ohm", "", (0.003, 0.3)), at=surface)
    g.measure("voltage", -signal("effort", "load"), "V")
    return g


def discharged(seed: int) -> MatchedLog:
    """A ladder of five time constants from 1 to 600 s."""
    chance, count = np.random.default_rng(seed), 1200
    current = levels(chance, count, 40, -1.5, 5.0)
    seconds, resistance = np.array([1.0, 5.0, 25.0, 125.0, 600.0]), 0.008

    def rate(k: int, x: np.ndarray) -> list[float]:
        return [current[k], *(-x[1:] / seconds + current[k] * resistance / seconds)]

    x = course(rate, [800.0 * seed, *(0.003 * seed,) * 5], count, 1.0)
    voltage = 4.1 - x[0] / 1.3e4 - 0.045 * current - x[1:].sum(axis=0) + wandering(chance, count, 1.0, 1e-3, 8.0)
    shown = 1e-3 * np.round((voltage + 7e-4 * chance.standard_normal(count)) / 1e-3)
    return MatchedLog(f"run{seed}", np.arange(float(count)), current[np.newaxis], shown[np.newaxis])


@pytest.mark.slow
def test_a_relaxation_of_many_time_constants_is_no_drift_of_the_only_sensor() -> None:
    """A drift of 0.45 V in a run was "suspected", and confirmed by the held-out log; later one of 0.18 V was added."""
    closed = bg.close_loop(cell(), [discharged(1), discharged(2)], [discharged(3)])
    assert closed.verdict == "effect found"
    relaxations = {"polarisation at loop", "charge_redistribution at surface"}  # of five, one of which is declared
    assert {one.trial.candidate.label for one in closed.added} <= relaxations
    (before,), (after,) = (one.logs for one in (closed.nominal_holdout, closed.corrected_holdout))
    assert after.channels["voltage"].simulation_rmse < 0.2 * before.channels["voltage"].simulation_rmse
    (said,) = [one for one in closed.cautions if one.startswith("the declared model simulates")]
    assert "better than the corrected model does" in said  # its charge walks with the noise
