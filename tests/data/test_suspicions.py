"""Numbers of another unit, times in milliseconds, gaps and coarse samples are pointed out, and nothing else is."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from bondgraph.data.log import FloatArray, Log, LogChannel
from bondgraph.data.matching import match
from bondgraph.data.select import split_at_gaps
from bondgraph.data.suspicions import (
    FACTORS,
    agreement,
    looks_like_milliseconds,
    sampling_notes,
    scale_suspicion,
    time_gaps,
    time_suspicion,
)
from tests.data.test_match import Car

TIME = 0.1 * np.arange(200)
TRUTH = 20.0 + 8.0 * np.sin(0.7 * TIME) + 5.0 * np.exp(-TIME / 3.0)


def _answer(factor: float) -> FloatArray:
    """A machine driven as it was, started from the measured value over the factor: the start is forgotten in 3 s."""
    return TRUTH


@pytest.mark.parametrize(("factor", "dimensions", "suggestion"), FACTORS)
def test_every_ratio_is_recognised_with_noise_and_a_parameter_a_little_off(
    factor: float, dimensions: tuple[str, ...], suggestion: str
) -> None:
    rng = np.random.default_rng(1)
    measured = factor * 1.05 * (TRUTH + 0.5 * rng.standard_normal(TRUTH.size))
    found = scale_suspicion("w", dimensions[-1] if dimensions else "N", measured, _answer)
    assert found is not None and suggestion in found
    ratio = re.search(r"measured values are (\S+) \+- \S+ times", found)
    assert ratio is not None and float(ratio[1]) == pytest.approx(1.05 * factor, rel=0.01)


@given(st.floats(0.55, 1.8), st.floats(0.0, 0.3), st.integers(0, 10))
def test_a_model_that_is_off_by_less_than_a_unit_is_not_suspected(ratio: float, noise: float, seed: int) -> None:
    measured = TRUTH * (ratio + noise * np.random.default_rng(seed).standard_normal(TRUTH.size))
    assert scale_suspicion("w", "rad/s", measured, _answer) is None


@given(st.integers(0, 50), st.sampled_from(["rad/s", "m/s", "N"]))
def test_a_model_that_says_something_else_is_not_suspected_of_a_unit(seed: int, unit: str) -> None:
    """Measured values of the right sizes of a unit that do not follow the model."""
    rng = np.random.default_rng(seed)
    measured = 9.549 * np.cumsum(rng.standard_normal(TRUTH.size))
    assert scale_suspicion("w", unit, measured, lambda factor: TRUTH - np.mean(TRUTH)) is None


@pytest.mark.parametrize(("colour", "least"), [(0.0, 60), (0.9, 45)])
def test_a_ratio_is_seen_through_noise_of_a_third_of_the_signal(colour: float, least: int) -> None:
    # a rest above 0.3 of the measured values silenced all of these
    found = [scale_suspicion("v", "m/s", 3.6 * _disturbed(0.35, colour, seed), _answer) for seed in range(60)]
    told = [one for one in found if one is not None]
    assert len(told) >= least and all("km/h read as m/s" in one for one in told)


def test_noise_of_any_colour_and_size_makes_no_ratio() -> None:
    cases = ((size, colour, seed) for size in (0.3, 1.0, 3.0) for colour in (0.0, 0.9, 0.99) for seed in range(100))
    found = [scale_suspicion("w", "rad/s", _disturbed(*case), _answer) for case in cases]
    assert sum(one is not None for one in found) <= 2  # of 900


def _disturbed(size: float, colour: float, seed: int) -> FloatArray:
    """The truth with noise of a share of its rms, white or of a correlation from sample to sample."""
    white = np.random.default_rng(seed).standard_normal(TRUTH.size)
    noise = lfilter([math.sqrt(1.0 - colour**2)], [1.0, -colour], white)
    return np.asarray(TRUTH + size * math.sqrt(np.mean(TRUTH**2)) * noise)


def test_a_ratio_that_noise_leaves_open_names_both_units() -> None:
    found = scale_suspicion("v", "m/s", 2.9 * _disturbed(0.35, 0.9, 0), _answer)
    assert found is not None and "km/h read as m/s" in found and "mph read as m/s" in found


def test_a_ratio_between_those_of_units_is_not_suspected() -> None:
    for ratio in (4.9, 7.9, 15.0, 300.0):
        assert scale_suspicion("w", "rad/s", ratio * TRUTH, _answer) is None
    assert scale_suspicion("w", "N", 3.6 * TRUTH, _answer) is None  # a force is not read in km/h


def test_a_simulation_that_fails_or_a_channel_at_rest_says_nothing() -> None:
    assert scale_suspicion("w", "rad/s", 9.549 * TRUTH, lambda factor: None) is None
    assert agreement(np.zeros(50), np.ones(50)) is None and agreement(np.ones(10), np.ones(10)) is None
    assert agreement(np.full(50, np.nan), np.ones(50)) is None


def test_times_are_milliseconds_where_the_model_then_follows() -> None:
    time = 100.0 * np.arange(200)
    assert looks_like_milliseconds(time) and not looks_like_milliseconds(TIME)
    far, near = agreement(TRUTH, 0.2 * TRUTH), agreement(TRUTH, 1.02 * TRUTH)
    assert far is not None and near is not None
    found = time_suspicion(time, [far], [near])
    assert found is not None and "times are 100 s apart" in found and "'time [ms]'" in found
    assert time_suspicion(time, [near], [near]) is None and time_suspicion(time, [far], [far]) is None
    assert time_suspicion(time, [far], []) is None


def test_a_gap_in_time_is_noted_with_its_rows() -> None:
    time = np.r_[0.1 * np.arange(50), 20.0 + 0.1 * np.arange(50)]
    (note,) = time_gaps(time)
    assert note.startswith("time jumps from 4.9 s to 20 s (row 51 to 52)")
    assert time_gaps(TIME) == [] and time_gaps(np.cumsum(0.1 + 0.05 * np.random.default_rng(0).random(200))) == []
    (note,) = time_gaps(np.r_[0.0, 0.1, 5.0, 5.1, 10.0, 10.1, 15.0, 15.1, 20.0, np.arange(20.1, 25.0, 0.1)])
    assert "and 1 more" in note


def test_a_matched_log_carries_the_note_of_its_gap() -> None:
    time = np.r_[0.0, 0.1, 0.2, 9.0, 9.1]
    channels = {n: LogChannel(n, u, np.ones(5)) for n, u in (("torque", "N m"), ("speed", "m/s"))}
    assert any("time jumps from 0.2 s to 9 s" in note for note in match(Log("run", time, channels), Car()).notes)


@given(st.lists(st.integers(2, 30), min_size=1, max_size=5), st.floats(5.0, 500.0))
def test_parts_between_gaps_hold_every_sample_once(sizes: list[int], jump: float) -> None:
    steps = np.full(sum(sizes), 0.1)
    steps[np.cumsum(sizes)[:-1]] = jump
    time = np.cumsum(steps)
    log = Log("run", time, {"speed": LogChannel("speed", "m/s", np.arange(time.size, dtype=float))})
    parts = split_at_gaps(log)
    if len(sizes) > 1 and np.median(np.diff(time)) < jump / 10.0:
        assert [len(one) for one in parts] == sizes and parts[0].name == "run.1"
        assert not any(time_gaps(one.time) for one in parts)
    np.testing.assert_array_equal(np.concatenate([one.time for one in parts]), time)
    np.testing.assert_array_equal(np.concatenate([one.channel("speed").numbers for one in parts]), np.arange(time.size))


def test_a_single_sample_between_gaps_is_no_log() -> None:
    time = np.r_[0.1 * np.arange(20), 30.0, 60.0 + 0.1 * np.arange(20)]
    assert [len(one) for one in split_at_gaps(Log("run", time, {}))] == [20, 20]
    (same,) = split_at_gaps(Log("run", TIME, {}))
    assert same.name == "run"


@pytest.mark.parametrize(
    ("modes", "texts"),
    [
        ([-40.0, -1e4], ["the slowest mode of the machine decays in 0.025 s"]),
        ([-0.5, -1e4], []),  # a stiff parasitic mode beside a slow one
        ([0.0, -1e4], []),  # a position is never settled
        ([2.0], []),  # nor is what grows
        ([-0.2 + 40.0j, -0.2 - 40.0j], ["oscillates at 6.37 Hz, above half the sampling rate of 10 Hz"]),
        ([-0.1, -0.2 + 40.0j, -0.2 - 40.0j], ["oscillates at 6.37 Hz"]),
        ([-60.0 + 40.0j, -60.0 - 40.0j], ["the slowest mode of the machine decays in 0.0167 s"]),
        ([-0.1, -50.0 + 40.0j, -50.0 - 40.0j], []),  # settled between two samples
        ([], []),
    ],
)
def test_modes_that_samples_cannot_show(modes: list[complex], texts: list[str]) -> None:
    notes = sampling_notes(TIME, np.array(modes, dtype=np.complex128))
    assert len(notes) == len(texts) and all(text in note for text, note in zip(texts, notes, strict=True))


def test_the_ratios_stay_apart() -> None:
    """No two ratios of one dimension lie within the agreement that is asked for."""
    for k, (one, units, _) in enumerate(FACTORS):
        for other, others, _ in FACTORS[k + 1 :]:
            if not units or not others or set(units) & set(others):
                assert abs(math.log(one / other)) > math.log(1.15)
