"""Detectors of changes: the evidence against Page's own recursion, the declared rate, names and refusals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from bondgraph.errors import FilterError, ModelError
from bondgraph.filter.detector import ChangeDetector
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.model import Model
from tests.filter.logs import PlainLog, pendulum_filter, simulated_log
from tests.module_text import STACK


def reading(noise: float = 1.0) -> FilterModel:
    """A level that stands still at zero, read with a bias and noise: independent Gaussian readings."""
    model = Model.from_text(
        """
import numpy as np
NAME = "gauge"
FORMAT = "bondgraph-module/1"
STATES = (("level", "1", 0.0, ""),)
INPUTS = ()
PARAMETERS = (("bias", "1", 0.0, None, None, ""), ("slope", "1", 1.0, None, None, ""))
OUTPUTS = (("reading", "1", ""),)
def rhs(t, x, u, theta):
    return _stack(x, (0.0*x[0],))
def output(t, x, u, theta):
    return _stack(x, (theta[1]*x[0] + theta[0],))
"""
        + STACK
    )
    return FilterModel(model, {}, {"reading": noise}, {})


def gauge_detector(false_alarm_every: float, bias: float) -> ChangeDetector:
    changes = {"up": {"bias": bias}}
    return ChangeDetector(reading(), changes, false_alarm_every=false_alarm_every, interval=1.0, compiled=False)


def readings(values: np.ndarray) -> PlainLog:
    return PlainLog("readings", np.arange(values.size) * 1.0, np.zeros((0, values.size)), values[np.newaxis])


def page(values: np.ndarray, shift: float, noise: float) -> np.ndarray:
    """Page's cumulative sum of the log-likelihood ratio of a mean ``shift`` against zero, (n,)."""
    sums, last = [], 0.0
    for value in values:
        last = max(0.0, last + shift * (value - 0.5 * shift) / noise**2)
        sums.append(last)
    return np.array(sums)


def test_the_evidence_is_pages_cumulative_sum() -> None:
    chance = np.random.default_rng(1)
    values = 0.5 * chance.standard_normal(150) + np.where(np.arange(150) > 100, 0.8, 0.0)
    changes = {"up": {"bias": 0.8}, "down": {"bias": -0.4}}
    detector = ChangeDetector(reading(0.5), changes, false_alarm_every=1e4, interval=1.0, compiled=False)
    found = detector.watch(readings(values))
    np.testing.assert_allclose(found.evidence["up"], page(values, 0.8, 0.5), atol=1e-9)
    np.testing.assert_allclose(found.evidence["down"], page(values, -0.4, 0.5), atol=1e-9)
    assert found.threshold == pytest.approx(math.log(2e4))
    first = int(np.argmax(page(values, 0.8, 0.5) >= found.threshold))
    assert (found.alarm, found.alarm_time) == ("up", float(first))
    assert "up at" in found.summary() and "no alarm" not in repr(found)


def test_false_alarms_are_rarer_than_declared() -> None:
    """Mean run length of Page's sum at the threshold that the detector sets, 300 streams drawn."""
    declared = 60.0
    threshold = gauge_detector(declared, 1.0).threshold
    chance, lengths = np.random.default_rng(2), []
    for _ in range(300):
        sums = page(chance.standard_normal(6000), 1.0, 1.0)
        assert sums.max() >= threshold
        lengths.append(1 + int(np.argmax(sums >= threshold)))
    mean, spread = np.mean(lengths), np.std(lengths) / math.sqrt(len(lengths))
    assert mean - 3.0 * spread > declared
    assert mean < 20.0 * declared  # nor is it blind: the bound costs the overshoot, exp(1.166) for unit steps, and more


def test_a_nonlinear_machine_names_its_change_soon_and_nothing_else() -> None:
    """Drawn from the filter's own model: the first log is of the nominal machine, the second of a longer one."""
    model = pendulum_filter(process_noise={"rate": 0.05}, initial_std={"angle": 0.02, "rate": 0.02})
    changes = {"longer": {"length": 1.3}, "damped": {"damping": 0.8}}
    time = np.arange(200) * 0.04
    quiet = simulated_log(model, time, seed=3)
    longer = Model.from_text(model.model.text.replace('("length", "m", 1.0', '("length", "m", 1.3'))
    assert longer.theta()[0] == 1.3
    other = simulated_log(replace(model, model=longer), time, seed=3)

    def watched(log: PlainLog) -> tuple[str, float]:
        detector = ChangeDetector(model, changes, false_alarm_every=1e6, interval=0.04)
        found = detector.watch(log)
        return found.alarm, found.alarm_time

    assert watched(quiet) == ("", pytest.approx(math.nan, nan_ok=True))
    name, when = watched(other)
    assert name == "longer" and when < 4.0


def test_late_and_missing_samples_say_nothing() -> None:
    detector = gauge_detector(1e3, 1.0)
    for t in range(4):
        found = detector.step(float(t), y=[1.2])
    late = detector.step(1.5, y=[9.0])
    silent = detector.step(4.0)
    assert not late.step.accepted
    assert found.evidence == late.evidence == silent.evidence
    assert found.evidence["up"] == pytest.approx(4 * 0.7)


def test_a_picture_and_a_table_show_the_evidence() -> None:
    found = gauge_detector(1e3, 2.0).watch(readings(np.r_[np.zeros(5), np.full(9, 2.0)]))
    axes = Figure().subplots()
    assert found.plot(axes) is axes
    assert [line.get_label() for line in axes.lines[:2]] == ["up", "threshold"]
    assert [text.get_text() for text in axes.texts] == ["up"]
    assert found.plot() is not axes
    pytest.importorskip("pandas")
    assert found.to_dataframe()["up [nat]"].iloc[-1] == found.evidence["up"][-1]


def test_bad_input_is_refused_with_what_to_do() -> None:
    model = reading()
    followed = replace(model, appended={"slope": 0.1})
    for used, changes, every, error, message in (
        (model, {}, 1e3, FilterError, "0 changes with false_alarm_every=1000.0 s - name at least one change"),
        (model, {"up": {"bias": 1.0}}, 0.5, FilterError, "longer than the interval between samples"),
        (model, {"up": {"bias": 0.0}}, 1e3, FilterError, "change 'up' changes no parameter"),
        (model, {"up": {"bais": 1.0}}, 1e3, ModelError, "no parameter 'bais'; did you mean 'bias'"),
        (followed, {"up": {"slope": 2.0}}, 1e3, FilterError, "'slope', which the filter follows as a state"),
    ):
        with pytest.raises(error, match=message):
            ChangeDetector(used, changes, false_alarm_every=every, interval=1.0, compiled=False)
