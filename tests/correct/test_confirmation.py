"""What logs say of a correction: held-out logs decide nothing of what is chosen and everything of what is said."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bondgraph import effects
from bondgraph.correct.confirmation import Confirmation, confirmation
from bondgraph.correct.fits.assess import ScaledGain, assess, gain_interval, scaled_gain
from bondgraph.correct.fits.horizon import horizon, predicted, windows
from bondgraph.correct.loop import ClosedLoop, close_loop
from bondgraph.correct.result import result_json
from bondgraph.data.log import MatchedLog
from bondgraph.estimate.fitted import Fit
from bondgraph.report.closed_loop import explanation
from bondgraph.report.closed_loop import report_data as data_of
from bondgraph.report.html import Provenance
from tests.correct.sled import FUNCTIONS, added, built, fitted, pull, sled

DRAG = 1.2


def train(graph: object) -> list[MatchedLog]:
    return [pull(graph, seed, name=name, c_guide=10.0) for seed, name in ((1, "first"), (101, "second"))]  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def contradicted() -> ClosedLoop:
    """Training logs of a sled with air drag, a held-out log of one without: 800 nats and more against the correction.

    Before, the verdict was "effect found", its explanation "The declared model lacks quadratic_loss at runner".
    """
    true = added(effects.quadratic_loss, "runner", DRAG)
    return close_loop(sled(), train(true), [pull(sled(), 50, name="held", c_guide=10.0)], FUNCTIONS)


def test_held_out_logs_that_contradict_a_correction_make_the_verdict(contradicted: ClosedLoop) -> None:
    told = contradicted.confirmation
    assert contradicted.verdict == "effect not confirmed" and told is not None and told.standing == "contradicted"
    assert [one.trial.candidate.label for one in contradicted.added] == ["quadratic_loss at runner"]
    assert told.gain < -5.0 * told.error < -100.0
    grown = {(one.data, one.kind) for one in told.compared if one.clearly and one.channel == "speed"}
    assert grown == {("held-out", "prediction"), ("held-out", "free simulation")}


def test_what_is_said_of_a_contradicted_correction_names_the_numbers(contradicted: ClosedLoop) -> None:
    said = explanation(contradicted)
    assert "lacks" not in said and "held-out logs falls by" in said and "speed on held-out logs" in said
    found = result_json(contradicted)["confirmation"]
    assert found["standing"] == "contradicted" and found["contradictions"] and found["holdout_gain"] < 0.0
    notes = data_of(contradicted, {}, Provenance("", None, (), (), (), 0.0)).notes
    assert any("contradict the correction" in note for note in notes)
    assert not any("confirm the correction" in note for note in notes)


def test_a_true_effect_is_confirmed_by_held_out_logs() -> None:
    true = added(effects.quadratic_loss, "runner", DRAG)
    found = close_loop(sled(), train(true), [pull(true, 50, name="held", c_guide=10.0)], FUNCTIONS)
    assert found.verdict == "effect found" and found.confirmation is not None
    assert found.confirmation.standing == "confirmed" and not found.confirmation.contradictions
    ahead = next(one for one in found.confirmation.compared if one.data == "held-out" and one.channel == "speed")
    assert ahead.kind == "prediction" and ahead.after == pytest.approx(0.02, rel=0.3) and ahead.before > 0.1


def test_pulses_that_only_a_held_out_log_has_contradict_no_law() -> None:
    """As on a tank into which buckets were poured: the errors fell, and the verdict was "effect not confirmed"."""
    true = added(effects.quadratic_loss, "runner", DRAG)
    held = pull(true, 50, name="held", c_guide=10.0)
    row = built().model.names("output").index("speed")
    y = held.y.copy()
    for first in (60, 180, 290):
        y[row, first : first + 3] += 4.0
    logs = [replace(held, y=y)]
    found = close_loop(sled(), train(true), logs, FUNCTIONS)
    runs = [one.runs(logs) for one in (found.nominal, found.corrected)]
    likelier, _ = gain_interval(*runs)
    assert likelier < -100.0  # with the noise of the training logs
    assert found.verdict == "effect found" and found.confirmation is not None
    assert found.confirmation.standing == "confirmed" and found.confirmation.noise > 2.0


def _moved(base: Fit, **values: float) -> Fit:
    """The fit at other values of some free parameters."""
    point = base.point.copy()
    for name, value in values.items():
        k = [one.name for one in base.problem.free].index(name)
        point[k] = base.problem.free[k].coordinate(value)
    return replace(base, point=point, nll=float(base.problem.nll(point[:, np.newaxis])[0]))


def test_a_gain_of_likelihood_beside_a_far_worse_simulation_confirms_nothing() -> None:
    """As on launches of a Baja car: +8048 nats held out, "confirmed", beside a simulation of 0.8 -> 6.3 rad/s."""
    logs = [pull(sled(), seed, name=f"run{seed}") for seed in (1, 2)]
    base = fitted(logs)
    loud = {name: 1e-2 for name in base.problem.names if name.startswith("process")}
    (state,) = loud
    before = _moved(base, **{"std(speed)": 4e-3, state: base.problem.free[base.problem.names.index(state)].lower})
    after = _moved(base, **{"c_guide": 30.0, state: 0.5, "std(force)": 60.0})
    both = _both(before, after, logs)
    likelier, error = gain_interval(*([log.filtered for log in found[1].logs] for found in both[2:]))
    assert likelier > 2.0 * error > 0.0  # the likelihood alone would confirm it
    told = confirmation(*both)
    assert told.gain < 0.0 and told.standing == "contradicted"  # its noise alone made it likelier
    worse = {(one.kind, one.data) for one in told.compared if one.clearly and one.channel == "speed"}
    assert ("free simulation", "held-out") in worse and ("prediction", "training") in worse


@given(st.floats(0.1, 10.0), st.floats(0.1, 10.0))
@settings(max_examples=10, deadline=None)
def test_a_gain_on_logs_does_not_depend_on_noise_levels_from_elsewhere(first: float, second: float) -> None:
    """Pulses that the training logs do not have: 4600 nats against friction that a third of the errors was left with.

    A common factor on all noises, the uncertainty of the start among them, leaves every gain of a filter as it is.
    """
    logs = [pull(sled(), 9, name="held")]
    base = fitted([pull(sled(), 1)])
    runs = [_louder(one, factor).runs(logs) for one, factor in ((_moved(base, c_guide=30.0), first), (base, second))]
    told, plain = scaled_gain(*runs), scaled_gain(_moved(base, c_guide=30.0).runs(logs), base.runs(logs))
    assert told.gain == pytest.approx(plain.gain, rel=1e-6) and told.error == pytest.approx(plain.error, rel=1e-6)
    assert told.noise == pytest.approx(plain.noise / second, rel=1e-6)


def _louder(fitted: Fit, factor: float) -> Fit:
    """The fit with all its noises, and the uncertainty of its start, larger by a factor."""
    own = fitted.problem.filter_model
    starts = {name: factor * value for name, value in own.initial_std.items()}
    levels = np.array([one.target.kind in ("process", "std") for one in fitted.problem.free])
    problem = replace(fitted.problem, filter_model=replace(own, initial_std=starts))
    return replace(fitted, problem=problem, point=fitted.point + np.where(levels, np.log(factor), 0.0))


def _both(before: Fit, after: Fit, logs: list[MatchedLog]) -> tuple:  # type: ignore[type-arg]
    held = [pull(sled(), 9, name="held")]
    return before, after, *([assess(one, part) for part in (logs, held)] for one in (before, after))


def test_a_prediction_that_is_no_worse_than_chance_contradicts_nothing() -> None:
    logs = [pull(sled(), seed, name=f"run{seed}") for seed in (1, 2)]
    base = fitted(logs)
    near = _moved(base, c_guide=base.values["c_guide"] * (1.0 + base.std["c_guide"]))
    told = confirmation(*_both(base, near, logs))
    assert told.standing == "open" and not told.contradictions


def test_one_that_cannot_be_told_says_nothing() -> None:
    assert Confirmation(math.nan, math.nan, 1.0, ()).standing == "open"
    assert Confirmation(-0.5, math.nan, 1.0, ()).standing == "open"  # too few samples for a standard error
    beside = ScaledGain(3.0, 2.0, 1.0)  # a disturbance gained the rest
    assert Confirmation(90.0, 9.0, 1.0, (), 1.0, beside).standing == "open"
    assert Confirmation(90.0, 9.0, 1.0, (), 1.0, replace(beside, gain=30.0)).standing == "confirmed"
    lost = Confirmation(90.0, 9.0, 1.0, (), 1.0, replace(beside, gain=-30.0))
    assert lost.contradictions == ("beside the disturbance the laws lose 30 ± 2 nats on the held-out logs",)
    assert Confirmation(-math.inf, math.nan, 1.0, ()).standing == "contradicted"  # the filter fails there


def test_predictions_run_over_the_slowest_time_constant_from_the_filtered_state() -> None:
    logs = [pull(sled(), 1)]
    base = fitted(logs)
    assert horizon(base, logs) == pytest.approx(min(40.0 / base.values["c_guide"], 39.9 / 20), rel=1e-6)
    (run,) = base.runs(logs)
    parts = windows(logs[0], 2.0)
    y = predicted(base, logs[0], run, parts)
    row = built().model.names("output").index("speed")
    assert np.isnan(y[row, 0]) and np.isfinite(y[row, 1:]).all()
    mass, guide, drum = 40.0, base.values["c_guide"], 0.3
    first, last = parts[3]
    v = float(run.filtered_mean[0, first])
    for k in range(first, last):  # the torque is held for 25 samples: exact where it does not change
        if logs[0].u[0, k] != logs[0].u[0, k + 1]:
            break
        pull_force = logs[0].u[0, k] / drum
        v = pull_force / guide + (v - pull_force / guide) * math.exp(-guide / mass * 0.1)
        assert y[row, k + 1] == pytest.approx(v, rel=1e-5)
