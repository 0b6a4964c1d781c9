"""Inputs before a log that begins with a step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.correct.cautions import begun_with
from bondgraph.data.log import MatchedLog
from bondgraph.declare.functions import delay
from bondgraph.estimate.inputs_before import with_inputs_before
from bondgraph.simulate.late import inputs_of

_ROOM, _LATE, _NOISE = 295.0, 0.24, 0.05


def dryer(late: float = 0.0) -> bg.BondGraph:
    """A heater in an air stream; its power acts late, or at once as it is declared."""
    g = bg.BondGraph("dryer")
    power = g.input("power", "W", hold=True)
    wire, air = g.zero_junction("wire", bg.THERMAL), g.zero_junction("air", bg.THERMAL)
    film, away = g.one_junction("film", bg.THERMAL), g.one_junction("away", bg.THERMAL)
    C1, C2 = g.parameter("C1", 1.8, "J/K", "", (0.6, 4.0)), g.parameter("C2", 0.8, "J/K")
    g.flow_source("heater", delay(power, late) if late else power, at=wire)
    g.compliance("coil", displacement=C1, at=wire, initial=C1 * _ROOM)
    g.bond(wire, film)
    g.bond(film, air)
    g.resistance("surface", flow=lambda d: g.parameter("G1", 5.0, "W/K", "", (1.0, 20.0)) * d, at=film)
    g.compliance("tube", displacement=C2, at=air, initial=C2 * _ROOM)
    g.bond(air, away)
    g.resistance("stream", flow=lambda d: g.parameter("Gf", 2.2, "W/K", "", (0.8, 4.0)) * d, at=away)
    g.bond(away, g.effort_source("room", _ROOM))
    g.measure_effort("T", air, unit="K")
    return g


def heated(seed: int, count: int = 400, interval: float = 0.08) -> MatchedLog:
    """A run by scipy from the cold, with the power on from the first sample."""
    chance, time = np.random.default_rng(seed), interval * np.arange(count)
    power = np.repeat(chance.choice([20.0, 60.0], count // 5), 5)
    late = round(_LATE / interval)
    states = [np.array([_ROOM, _ROOM])]
    for k in range(count - 1):
        given = power[k - late] if k >= late else 0.0

        def rate(t: float, x: np.ndarray, given: float = given) -> list[float]:
            over = 6.0 * (x[0] - x[1])
            return [(given - over) / 1.5, (over - 1.9 * (x[1] - _ROOM)) / 0.8]

        states.append(solve_ivp(rate, (0.0, interval), states[-1], rtol=1e-9, atol=1e-9).y[:, -1])
    y = np.array(states)[:, 1] + _NOISE * chance.standard_normal(count)
    return MatchedLog(f"run{seed}", time, power[np.newaxis], y[np.newaxis])


def test_an_input_that_begins_with_a_log_was_nothing_before() -> None:
    model = bg.build(dryer(_LATE)).model
    (log,) = with_inputs_before(model, [heated(1)], model.theta(), "measured")
    assert dict(log.before) == {"power": 0.0}
    own, later = inputs_of(model, log)[:, :6]
    assert later[:3].tolist() == [0.0, 0.0, 0.0] and later[3:6].tolist() == own[:3].tolist()
    assert dict(log.rows(log.time > 1.0).before) == {}  # a part of a log begins in the middle of a run
    (same,) = with_inputs_before(model, [log], model.theta(), "measured")
    assert same is log


def test_a_correction_says_what_it_takes_an_input_for_before_its_logs() -> None:
    model = bg.build(dryer(_LATE)).model
    logs = with_inputs_before(model, [heated(1), heated(2)], model.theta(), "measured")
    (said,) = begun_with(model, logs)
    assert said.startswith("power begins with the logs: before them it is taken as 0, ")
    assert begun_with(bg.build(dryer()).model, logs) == []  # nothing follows it late


def test_a_machine_that_has_run_had_its_first_input_before() -> None:
    model, log = bg.build(dryer(_LATE)).model, heated(1)
    hot = _ROOM + log.u[0, 0] / 2.2
    x0 = {"q_coil": 1.8 * (hot + log.u[0, 0] / 5.0), "q_tube": 0.8 * hot}
    for begun in (({**x0},), ({"q_coil": 1.8 * 310.0, "q_tube": 0.8 * 300.0},)):
        (kept,) = with_inputs_before(model, [log], model.theta(), begun)
        assert kept is log


def test_inputs_that_nothing_follows_late_are_not_asked_for() -> None:
    model, log = bg.build(dryer()).model, heated(1)
    assert with_inputs_before(model, [log], model.theta(), "measured") == (log,)
    (asked,) = with_inputs_before(model, [log], model.theta(), "measured", whatever_follows=True)
    assert dict(asked.before) == {"power": 0.0}


def test_estimates_comparisons_and_filters_know_it() -> None:
    model, log = bg.build(dryer(_LATE)).model, heated(1)
    found = bg.estimate(model, log, process_noise="none")
    for name, true in (("C1", 1.5), ("G1", 6.0), ("Gf", 1.9)):
        assert abs(found.values[name] - true) < 4.0 * found.std[name]
    assert found.values["std(T)"] == pytest.approx(_NOISE, rel=0.1)
    run = bg.filter_log(found.filter_model, log, theta=found.theta)
    assert run.nll == pytest.approx(float(found.problem.nll(found.point[:, np.newaxis])[0]), rel=0.05)


@pytest.mark.slow
def test_a_late_heater_is_told_from_logs_that_begin_with_it() -> None:
    """Of such a delay 490 nats of 1930 were lost, and a product of temperature and heat flow made up for them."""
    closed = bg.close_loop(dryer(), [heated(1), heated(2)], [heated(3)])
    (law,) = closed.added
    assert law.trial.candidate.effect.name in ("actuator_delay", "sensor_delay")
    assert closed.corrected.values["std(T)"] == pytest.approx(_NOISE, rel=0.05)
    assert closed.corrected.values[law.coefficients[0]] == pytest.approx(_LATE, abs=0.02)
