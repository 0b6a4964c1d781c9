"""Rhythms: a load that repeats is described with its period, and where nothing repeats none is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm, solve_continuous_lyapunov

from bondgraph import effects
from bondgraph.correct.loop import LoopSettings, close_loop
from bondgraph.correct.models.shaping_filters import state_under
from bondgraph.correct.result import result_json
from bondgraph.correct.search.rhythms import _noise, line
from bondgraph.data.log import FloatArray, MatchedLog
from tests.correct.test_disturbances import DRAG, MASS, NOISE, STEP, cart


def innovations(rows: list[FloatArray], steps: tuple[float, ...] = (STEP, STEP)) -> SimpleNamespace:
    """A fit whose innovations are given, one channel in each of several logs; each log is its own run."""
    runs = [
        SimpleNamespace(time=step * np.arange(y.size), y=y[np.newaxis], whitened=y[np.newaxis])
        for y, step in zip(rows, steps, strict=False)
    ]
    model = SimpleNamespace(outputs=["speed"])
    problem = SimpleNamespace(logs=runs, filter_model=SimpleNamespace(model=model))
    return SimpleNamespace(problem=problem, runs=lambda logs: logs)


@settings(max_examples=20, deadline=None)
@given(period=st.floats(4.0 * STEP, 8.0), seed=st.integers(0, 999))
def test_a_line_is_found_at_its_period(period: float, seed: int) -> None:
    rng, time = np.random.default_rng(seed), STEP * np.arange(1200)
    rows = [rng.normal(size=1200) + 0.5 * np.sin(2 * np.pi * time / period + rng.uniform(0.0, 6.0)) for _ in range(2)]
    found = line(innovations(rows), 1e-3)  # type: ignore[arg-type]
    assert found is not None and 1.0 / found == pytest.approx(1.0 / period, abs=1.0 / time[-1])


def test_white_and_evenly_coloured_innovations_have_no_line() -> None:
    """A slope of the spectrum is no line: it stands out nowhere."""
    alarms = 0
    for seed in range(100):
        white = np.random.default_rng(seed).normal(size=(2, 1201))
        rows = list(white[:, 1:] + (0.6 * white[:, :-1] if seed % 2 else 0.0))
        alarms += line(innovations(rows), 0.01) is not None  # type: ignore[arg-type]
    assert alarms <= 5  # of 1 in a hundred more than five come up 5 times in 10 000


def test_logs_with_gaps_tell_of_lines_and_short_ones_of_none() -> None:
    rng, time = np.random.default_rng(3), STEP * np.arange(1200)
    row = rng.normal(size=1200) + np.sin(2 * np.pi * time / 0.8)
    row[200:300] = np.nan
    found = line(innovations([row]), 1e-3)  # type: ignore[arg-type]
    assert found == pytest.approx(0.8, rel=0.02)
    assert line(innovations([row[:90]]), 1e-3) is None  # type: ignore[arg-type]


def test_logs_of_another_rate_are_left_out_of_a_sum_of_spectra() -> None:
    rng = np.random.default_rng(4)
    quick, slow = (
        rng.normal(size=1200) + np.sin(2 * np.pi * step * np.arange(1200) / 0.8) for step in (STEP, 4.0 * STEP)
    )
    found = line(innovations([quick, slow], (STEP, 4.0 * STEP)), 1e-3)  # type: ignore[arg-type]
    assert found == pytest.approx(0.8, rel=0.02)


@given(period=st.floats(0.1, 10.0), kept=st.floats(5.0, 50.0), size=st.floats(0.1, 10.0))
def test_the_noise_of_a_rhythm_gives_its_size_and_its_covariance_is_a_cosine(
    period: float, kept: float, size: float
) -> None:
    time, rate = kept * period, 2.0 * np.pi / period
    a = np.array([[-1.0 / time, -rate], [rate, -1.0 / time]])
    noise = np.diag([_noise(size, time) ** 2, 0.0])
    stationary = solve_continuous_lyapunov(a, -noise)
    assert np.sqrt(stationary[0, 0]) == pytest.approx(size, rel=0.01)
    later = expm(a * 0.4 * period) @ stationary
    assert later[0, 0] == pytest.approx(size**2 * np.exp(-0.4 / kept) * np.cos(0.8 * np.pi), rel=0.1)


def test_the_state_under_a_disturbance_is_found_in_a_part_too() -> None:
    """Read from the name of the disturbance, the state of a part was none of the model's."""

    def moved(element: str) -> str | None:
        candidate = SimpleNamespace(effect=SimpleNamespace(element=element))
        return state_under(candidate, ["v", "axle.v"])  # type: ignore[arg-type]

    assert [moved(f"disturbance_{name}") for name in ("v", "axle_v", "sensor_speed")] == ["v", "axle.v", None]


def beaten(seed: int, period: float, samples: int = 1200) -> MatchedLog:
    """A log of the cart, against which somebody pushes for a third of each period."""
    rng, fine = np.random.default_rng(seed), 0.1 * STEP
    time = fine * np.arange(10 * samples)
    push = np.repeat(rng.uniform(0.0, 40.0, samples // 40 + 1), 400)[: time.size]
    load = 12.0 * ((time / period + rng.uniform()) % 1.0 < 1.0 / 3.0)
    speed, x = np.empty(time.size), 0.0
    kept = np.exp(-DRAG / MASS * fine)
    for k in range(time.size):
        speed[k] = x
        x = kept * x + (1.0 - kept) * (push[k] - load[k]) / DRAG
    shown = speed[::10] + NOISE * rng.normal(size=samples)
    return MatchedLog(f"run{seed}", time[::10], push[np.newaxis, ::10], shown[np.newaxis])


@pytest.mark.slow
def test_a_load_that_repeats_is_described_with_its_period() -> None:
    """A pulsed load was "something that wanders at random", and the sun by day an unknown function of temperature."""
    functions = (effects.quadratic_loss, effects.constant_effort)
    found = close_loop(cart(), [beaten(1, 2.0), beaten(2, 2.0)], [], functions, LoopSettings())
    told = next(one for one in found.disturbances if one.period)
    assert told.period == pytest.approx(2.0, rel=0.02)
    assert "body: something that nothing measures repeats every" in str(told) and "keeps its rhythm" in str(told)
    assert {one.trial.candidate.label for one in found.added} <= {"constant_effort at body"}  # the mean of the load
    assert result_json(found)["disturbances"][-1]["period_s"] == pytest.approx(told.period)
