"""Inputs over time: lines, steps, ends, and the stretches between break points."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.data.log import Log, LogChannel
from bondgraph.data.matching import match
from bondgraph.errors import ModelError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.samples import Samples
from bondgraph.simulate import inputs
from bondgraph.simulate.inputs import InputSignal, hold_flags
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from tests.module_text import STACK
from tests.simulate.samples import decay, sample


def table(hold: bool = False) -> InputSignal:
    return InputSignal(np.array([0.0, 1.0, 3.0]), np.array([[0.0, 2.0, -2.0]]), np.array([hold]))


def test_linear_inputs_run_between_points_and_hold_at_the_ends() -> None:
    assert table().at([-5.0, 0.0, 0.5, 1.0, 2.0, 3.0, 9.0])[0].tolist() == [0.0, 0.0, 1.0, 2.0, 0.0, -2.0, -2.0]


def test_held_inputs_keep_their_value_until_the_next_point() -> None:
    assert table(hold=True).at([-5.0, 0.0, 0.99, 1.0, 2.99, 3.0, 9.0])[0].tolist() == [0, 0, 0, 2, 2, -2, -2]


def test_a_time_given_twice_is_a_jump() -> None:
    signal = InputSignal(np.array([0.0, 1.0, 1.0, 2.0]), np.array([[0.0, 1.0, 5.0, 5.0]]), np.array([False]))
    assert signal.at([0.999999999, 1.0, 1.5])[0].round(6).tolist() == [1.0, 5.0, 5.0]
    assert signal.break_points(0.0, 2.0).tolist() == [1.0]
    assert signal.segment(0.0, 1.0).right.tolist() == [1.0]
    assert signal.segment(1.0, 2.0).left.tolist() == [5.0]


def test_break_points_are_bends_and_jumps_only() -> None:
    time = np.arange(6.0)
    straight = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    bent = np.array([0.0, 1.0, 2.0, 2.0, 2.0, 2.0])
    codes = np.array([1.0, 1.0, 1.0, 1.0, 7.0, 7.0])
    signal = InputSignal(time, np.array([straight, bent, codes]), np.array([False, False, True]))
    assert signal.break_points(0.0, 5.0).tolist() == [2.0, 4.0]
    assert signal.break_points(-1.0, 6.0).tolist() == [0.0, 2.0, 4.0, 5.0]


@settings(max_examples=50, deadline=None)
@given(
    values=st.lists(st.floats(-10, 10), min_size=2, max_size=8),
    hold=st.booleans(),
    start=st.floats(-1, 3),
    length=st.floats(0.01, 6),
)
def test_segments_between_break_points_equal_the_signal(
    values: list[float], hold: bool, start: float, length: float
) -> None:
    signal = InputSignal(np.arange(len(values)) * 0.7, np.array([values]), np.array([hold]))
    breaks = signal.break_points(start, start + length)
    edges = np.concatenate([[start], breaks, [start + length]])
    for left, right in itertools.pairwise(edges):
        segment = signal.segment(left, right)
        for share in (0.001, 0.3, 0.5, 0.999):
            t = left + share * (right - left)
            np.testing.assert_allclose(segment.at(t), signal.at(t), atol=1e-9)


def test_inputs_by_name_take_numbers_letters_and_vectors() -> None:
    model = sample("driveline")
    signal = InputSignal.of(model, [0.0, 1.0, 2.0], throttle=[0.0, 1.0, 1.0], gear=["L", "L", "H"])
    assert signal.at([0.5, 1.5, 2.0]).tolist() == [[0.5, 1.0, 1.0], [20.0, 20.0, 10.0], [0.0, 0.0, 0.0]]
    assert InputSignal.of(model, gear="N").at(3.0).tolist() == [0.5, 0.0, 0.0]
    assert hold_flags(model).tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: InputSignal(np.array([0.0, 1.0]), np.zeros((1, 3)), np.array([False])), "do not fit 1 inputs at 2"),
        (lambda: InputSignal(np.array([1.0, 0.0]), np.zeros((1, 2)), np.array([False])), "must not decrease"),
        (lambda: InputSignal(np.arange(2.0), np.array([[0.0, np.nan]]), np.array([False])), "no finite value at t = 1"),
        (lambda: InputSignal.of(decay(), [0.0, 1.0], drive=[1.0, 2.0, 3.0]), "input 'drive' has 3 values for 2 times"),
        (lambda: InputSignal.of(decay(), drivee=1.0), "no input 'drivee'; did you mean 'drive'"),
    ],
)  # fmt: skip
def test_bad_inputs_are_told(build, message: str) -> None:
    with pytest.raises(ModelError) as error:
        build()
    assert message in str(error.value)


SHAKER = (
    '''"""A mass that a shaker moves: its force is mass times the rate of an input."""
import numpy as np

NAME = "shaker"
FORMAT = "bondgraph-module/1"
STATES = (("way", "m", 0.0, "what the rate adds up to"),)
INPUTS = (("speed", "m/s", 0.0, "linear", None, ""), ("d_speed", "m/s^2", 0.0, "rate of speed", None, ""))
PARAMETERS = (("mass", "kg", 2.0, None, None, ""),)
OUTPUTS = (("force", "N", ""),)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    return _stack(x, (u[1],))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    return _stack(x, (theta[0] * u[1],))
'''
    + STACK
)


def test_the_rate_of_an_input_follows_from_it() -> None:
    shaker = Model.from_text(SHAKER)
    ramp = InputSignal.of(shaker, [0.0, 1.0, 3.0, 4.0], speed=[0.0, 2.0, 2.0, 1.0])
    assert ramp.at([-1.0, 0.0, 0.5, 1.0, 2.0, 3.5, 4.0, 5.0])[1].tolist() == [0.0, 2.0, 2.0, 1.0, 0.0, -1.0, -1.0, 0.0]
    left, right = ramp.intervals(np.array([0.0, 1.0, 3.0, 4.0, 6.0]))
    assert left[1].tolist() == right[1].tolist() == [2.0, 0.0, -1.0, 0.0]
    jump = InputSignal.of(shaker, [0.0, 1.0, 1.0, 2.0], speed=[0.0, 1.0, 5.0, 8.0])
    assert jump.at([0.5, 1.0, 1.5])[1].tolist() == [1.0, 3.0, 3.0]
    assert InputSignal.of(shaker, speed=3.0).at(2.0).tolist() == [3.0, 0.0]


def test_a_rate_that_is_named_is_taken() -> None:
    named = InputSignal.of(Model.from_text(SHAKER), [0.0, 1.0], speed=[0.0, 1.0], d_speed=[7.0, 7.0])
    assert named.at(0.5)[1] == 7.0


def test_what_follows_an_input_is_simulated_and_filtered_by_its_rate() -> None:
    """The force was zero wherever the rate was not named: silently wrong."""
    shaker = Model.from_text(SHAKER)
    time = np.linspace(0.0, 1.0, 201)
    found = simulate(shaker, time, {"speed": np.sin(6.0 * time)})
    np.testing.assert_allclose(found.output("force")[1:-1], 12.0 * np.cos(6.0 * time[1:-1]), rtol=0, atol=2e-3)
    np.testing.assert_allclose(found.state("way"), np.sin(6.0 * time), rtol=0, atol=1e-9)
    columns = {"speed": ("m/s", np.sin(6.0 * time)), "force": ("N", 12.0 * np.cos(6.0 * time))}
    log = match(Log("run", time, {n: LogChannel(n, unit, values) for n, (unit, values) in columns.items()}), shaker)
    assert "input 'd_speed' is taken from the slope of 'speed'" in log.notes
    columns["d_speed"] = ("m/s^2", np.full(201, np.nan))
    empty = match(Log("run", time, {n: LogChannel(n, unit, values) for n, (unit, values) in columns.items()}), shaker)
    np.testing.assert_array_equal(empty.u, log.u)
    samples = Samples.whole(FilterModel(shaker, {"way": 0.1}, {"force": 0.1}, {"way": 0.1}), log)
    np.testing.assert_allclose(samples.u[1, 1:-1], 6.0 * np.cos(6.0 * time[1:-1]), rtol=0, atol=1e-3)
    np.testing.assert_allclose(samples.u_left[1], np.diff(np.sin(6.0 * time)) / 0.005, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("rates", [(), (1,)])
def test_inputs_are_the_same_bits_in_parts(rates: tuple[int, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    chance = np.random.default_rng(3)
    time = np.cumsum(chance.uniform(0.0, 1.0, 200))
    signal = InputSignal(time, chance.standard_normal((2, 200)), np.array([False, True]), rates)
    grid = np.union1d(time, chance.uniform(-2.0, time[-1] + 2.0, 500))
    whole = (signal.at(grid), *signal.intervals(grid), signal.at(float(time[7])))
    monkeypatch.setattr(inputs, "_BLOCK", 7)
    for one, part in zip(whole, (signal.at(grid), *signal.intervals(grid), signal.at(float(time[7]))), strict=True):
        np.testing.assert_array_equal(one, part)
