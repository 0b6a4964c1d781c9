"""Inputs over time: lines, steps, ends, and the stretches between break points."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph.errors import ModelError
from bondgraph.simulate.inputs import InputSignal, hold_flags
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
