"""Inputs that follow others later, against shifted samples, closed forms and scipy."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.arrays import FloatArray
from bondgraph.declare.expressions import signal
from bondgraph.declare.functions import delay
from bondgraph.errors import DerivationError, FilterError
from bondgraph.simulate.inputs import InputSignal
from bondgraph.simulate.late import complete
from bondgraph.simulate.model import Model

DT = 0.05
likelihood = importlib.import_module("bondgraph.filter.likelihood").likelihood


def sled(seconds: float, between: str = "linear") -> bg.BuiltModel:
    """A mass that is pulled, late, against viscous friction."""
    g = bg.BondGraph("sled")
    pull = g.input("pull", "N", between=None if between == "linear" else between)  # type: ignore[arg-type]
    body = g.one_junction("body", bg.TRANSLATION)
    g.effort_source("rope", delay(pull, seconds), at=body)
    g.inertance("mass", g.parameter("m", 2.0, "kg", bounds=(0.5, 8.0)), at=body, state="v")
    g.resistance("snow", g.parameter("c", 3.0, "N s/m"), at=body)
    g.measure_flow("speed", body)
    return bg.build(g)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 30), st.sampled_from(["linear", "hold"]), st.integers(0, 2**32 - 1))
def test_a_delay_of_whole_intervals_shifts_samples(intervals: int, between: str, seed: int) -> None:
    """Times of samples have rounding, which must not move a step by a sample."""
    u = np.random.default_rng(seed).normal(size=(1, 40))
    time: FloatArray = 17.3 + DT * np.arange(40, dtype=np.float64)
    late = complete(sled(intervals * DT, between).model, time, u)[1]
    assert late == pytest.approx(np.concatenate([np.full(intervals, u[0, 0]), u[0, : 40 - intervals]]), abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.01, 0.6), st.integers(0, 2**32 - 1))
def test_a_held_input_gives_as_much_late_as_at_once(seconds: float, seed: int) -> None:
    """An uneven log, and a delay of no whole number of intervals: the impulse of a pull stays what it is."""
    rng = np.random.default_rng(seed)
    time: FloatArray = np.cumsum(rng.uniform(0.02, 0.08, 80))
    u = np.where((time > time[10]) & (time < time[40]), rng.normal(size=80), 0.0)[np.newaxis]
    late = complete(sled(seconds, "hold").model, time, u)
    whole, same = (float(np.sum(row[:-1] * np.diff(time))) for row in late)
    assert same == pytest.approx(whole, abs=1e-12)


def test_a_filter_reads_a_delay_as_a_shifted_column() -> None:
    rng = np.random.default_rng(5)
    time: FloatArray = DT * np.arange(120, dtype=np.float64)
    u = rng.normal(size=(1, 120)).cumsum(axis=1)
    y = rng.normal(size=(1, 120))
    shifted = np.concatenate([np.full((1, 4), u[0, 0]), u[:, :-4]], axis=1)
    plain = bg.build(_undelayed())
    values = [
        likelihood(bg.FilterModel(model, {"v": 0.1}, {"speed": 0.2}, {"v": 1.0}, 2), bg.MatchedLog("run", time, own, y))
        for model, own in ((sled(4 * DT).model, u), (plain.model, shifted))
    ]
    assert values[0].nll == pytest.approx(values[1].nll, rel=1e-12)


def _undelayed() -> bg.BondGraph:
    g = bg.BondGraph("sled")
    body = g.one_junction("body", bg.TRANSLATION)
    g.effort_source("rope", g.input("pull", "N"), at=body)
    g.inertance("mass", g.parameter("m", 2.0, "kg", bounds=(0.5, 8.0)), at=body, state="v")
    g.resistance("snow", g.parameter("c", 3.0, "N s/m"), at=body)
    g.measure_flow("speed", body)
    return g


def test_a_table_bends_and_jumps_late_where_it_does() -> None:
    """A coarse table: the steps of the pull come between its points, as scipy sees them."""
    model = sled(0.37).model
    table = InputSignal.of(model, [0.0, 1.0, 1.0, 2.0], pull=[0.0, 1.0, 3.0, 3.0])
    assert table.at(np.array([0.5, 1.36, 1.38]))[1] == pytest.approx([0.13, 0.99, 3.0])

    def rate(t: float, v: np.ndarray) -> np.ndarray:
        at = t - 0.37
        pull = 0.0 if at <= 0.0 else at if at < 1.0 else 3.0
        return np.asarray((pull - 3.0 * v) / 2.0)

    at = np.linspace(0.0, 3.0, 61)
    first = solve_ivp(rate, (0.0, 1.37), [0.0], rtol=1e-10, atol=1e-12)
    then = solve_ivp(rate, (1.37, 3.0), first.y[:, -1], rtol=1e-10, atol=1e-12)
    run = bg.simulate(model, at, table)
    assert run.y[0, -1] == pytest.approx(then.y[0, -1], rel=1e-6)


def test_delays_add_and_go_through_laws_of_inputs() -> None:
    g = bg.BondGraph("two")
    a, b = g.input("a", "N"), g.input("b", "N", hold=True)
    gain = g.parameter("gain", 2.0, "1")
    body = g.one_junction("body", bg.TRANSLATION)
    g.effort_source("rope", delay(gain * delay(a, 0.1) + b, 0.2) + delay(b, 0.2), at=body)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body, state="v")
    model = bg.build(g).model
    late = {one.late_of: one for one in model.inputs if one.late_of}
    assert {name: one.interpolation for name, one in late.items()} == {"a": "linear", "b": "hold"}
    assert late["a"].late_by == pytest.approx(0.3) and late["b"].late_by == 0.2 and len(model.inputs) == 4
    assert Model.from_text(model.text).inputs == model.inputs


def test_what_is_no_input_cannot_be_delayed() -> None:
    g = bg.BondGraph("sled")
    body = g.one_junction("body", bg.TRANSLATION)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body, state="v")
    g.effort_source("rope", g.parameter("k", 1.0, "N s/m") * delay(signal("flow", "body"), 0.1), at=body)
    with pytest.raises(
        DerivationError, match=r"rope: delay\(flow\(body\), 0.1\) delays flow\(body\), which is no input"
    ):
        bg.build(g)
    with pytest.raises(DerivationError, match=r"rope: pull is delayed by -0\.1 - give a number of seconds above zero"):
        sled(-0.1)


def test_a_filter_on_line_asks_for_what_an_input_was() -> None:
    swing = bg.FilterModel(sled(0.1).model, {"v": 0.1}, {"speed": 0.2}, {"v": 1.0}, 2)
    online = bg.OnlineFilter(swing, interval=DT, compiled=False)
    with pytest.raises(FilterError, match=r"'late_pull_1' is 'pull' of 0\.1 s before"):
        online.step(0.0, {"pull": 1.0}, {"speed": 0.1})
    time: FloatArray = DT * np.arange(30, dtype=np.float64)
    log = bg.MatchedLog("run", time, np.sin(time)[np.newaxis], np.zeros((1, 30)))
    followed = bg.OnlineFilter(swing, interval=DT, compiled=False).follow(log)
    assert followed.filtered_mean == pytest.approx(bg.filter_log(swing, log, compiled=False).filtered_mean, abs=1e-12)
