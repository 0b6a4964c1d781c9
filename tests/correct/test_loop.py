"""Closing the loop on the sled: what is found, what is not claimed, what held-out logs may do, what bad use is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.evidence.context import coefficients
from bondgraph.correct.loop import ClosedLoop, close_loop
from bondgraph.correct.places.missing import missing_effort
from bondgraph.correct.round import one_round
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale, effect_functions
from bondgraph.declare.files import read_graph, write_graph
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.sensors import SENSOR_FAULTS
from bondgraph.errors import DataError, OptionError
from bondgraph.estimate.certify import NEGLIGIBLE_SHIFT
from bondgraph.estimate.fitted import at_optimum
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from tests.correct.sled import FUNCTIONS, added, built, fitted, pull, sled

QUADRATIC = 1.2


def logs(graph: BondGraph, seed: int, **values: float) -> list[MatchedLog]:
    return [pull(graph, seed, name="first", **values), pull(graph, seed + 100, name="second", **values)]


@pytest.fixture(scope="module")
def found() -> ClosedLoop:
    """The loop closed on a sled with air drag that its declaration lacks."""
    true = added(effects.quadratic_loss, "runner", QUADRATIC)
    return close_loop(sled(), logs(true, 1, c_guide=10.0), [pull(true, 50, name="held", c_guide=10.0)], FUNCTIONS)


@pytest.fixture(scope="module")
def nothing() -> ClosedLoop:
    """The loop closed on a sled that lacks nothing but has another friction than declared."""
    return close_loop(sled(), logs(sled(), 3, c_guide=16.0), [pull(sled(), 51, name="held", c_guide=16.0)], FUNCTIONS)


def test_the_missing_effect_is_found_with_its_size_and_nothing_else_is_added(found: ClosedLoop) -> None:
    assert found.verdict == "effect found"
    (effect,) = found.added
    assert effect.trial.candidate.label == "quadratic_loss at runner"
    (name,) = effect.coefficients
    reach = 4.0 * found.corrected.std[name]
    assert found.corrected.values[name] == pytest.approx(QUADRATIC, abs=reach) and reach < 0.2 * QUADRATIC
    assert found.corrected.values["c_guide"] == pytest.approx(10.0, abs=4.0 * 10.0 * found.corrected.std["c_guide"])
    assert found.reason == "no further candidate passes the tests"
    assert max(found.nominal_check.shift, found.corrected_check.shift) <= NEGLIGIBLE_SHIFT


def test_the_same_effect_beyond_a_rigid_tie_is_named_as_an_alternative(found: ClosedLoop) -> None:
    first = found.rounds[0].alternatives[0]
    assert (first.name, first.junction, first.indistinguishable) == ("quadratic_loss", "drum", True)
    assert found.rounds[0].chosen is not None
    assert found.rounds[0].chosen.stands_for == ("quadratic_loss at drum",)
    assert first.delta_nll == found.rounds[0].chosen.gain


def test_errors_fall_to_the_noise_on_training_and_held_out_logs(found: ClosedLoop) -> None:
    for before, after in (
        (found.nominal_train, found.corrected_train),
        (found.nominal_holdout, found.corrected_holdout),
    ):
        assert after.nll < before.nll - 50.0
        assert after.channels["speed"].simulation_rmse < 0.5 * before.channels["speed"].simulation_rmse
        assert after.channels["speed"].simulation_rmse == pytest.approx(0.02, rel=0.25)
        assert after.channels["speed"].innovation_rmse == pytest.approx(0.02, rel=0.15)


def test_with_nothing_missing_nothing_is_claimed_and_the_power_is_said(nothing: ClosedLoop) -> None:
    assert (nothing.verdict, nothing.added) == ("no missing effect", ())
    assert nothing.corrected is nothing.nominal
    assert all(one.indistinguishable is False for one in nothing.rounds[0].alternatives)
    sizes = {(one.effect, one.junction): one for one in nothing.detectable}
    drag = sizes["quadratic_loss", "runner"]
    assert (drag.coefficient, drag.unit) == ("c_quadratic_loss_runner", "N/(m/s)^2")
    assert 0.0 < drag.size < QUADRATIC
    at_drum = sizes["quadratic_loss", "drum"].size  # the same drag seen through the rope: torque = r^3 c w^2
    assert at_drum == pytest.approx(0.3**3 * drag.size, rel=1e-3)


@pytest.mark.slow
def test_an_effect_of_detectable_size_is_found_about_nine_times_in_ten(nothing: ClosedLoop) -> None:
    sizes = {(one.effect, one.junction): one.size for one in nothing.detectable}
    true = added(effects.quadratic_loss, "runner", sizes["quadratic_loss", "runner"])
    found = 0
    for seed in range(20):
        train = [
            pull(true, 300 + seed, name="first", driven=3, c_guide=16.0),
            pull(true, 400 + seed, name="second", driven=103, c_guide=16.0),
        ]
        turn = one_round(built(), fitted(train), train, FUNCTIONS)
        found += turn.chosen is not None
    assert found >= 14  # noise levels that are estimated take a little of the gain: 16 to 18 are expected


@pytest.mark.slow
def test_held_out_logs_decide_nothing(found: ClosedLoop) -> None:
    true = added(effects.quadratic_loss, "runner", QUADRATIC)
    rng = np.random.default_rng(0)
    other = pull(sled(), 52, name="other")
    other = MatchedLog("other", other.time, other.u, other.y + rng.normal(0.0, 5.0, other.y.shape))
    again = close_loop(sled(), logs(true, 1, c_guide=10.0), [other], FUNCTIONS)
    assert again.nominal.values == found.nominal.values and again.corrected.values == found.corrected.values
    assert [turn.alternatives for turn in again.rounds] == [turn.alternatives for turn in found.rounds]
    assert again.corrected_built.text == found.corrected_built.text
    assert again.corrected_holdout.nll != found.corrected_holdout.nll


def test_a_loop_without_held_out_logs_is_closed_the_same(nothing: ClosedLoop) -> None:
    again = close_loop(sled(), logs(sled(), 3, c_guide=16.0), [], FUNCTIONS)
    assert again.nominal.values == nothing.nominal.values
    assert again.corrected_holdout.logs == () and again.corrected_holdout.nll == 0.0


def test_the_corrected_graph_read_back_gives_the_same_model(found: ClosedLoop, tmp_path: Path) -> None:
    path = tmp_path / "corrected.json"
    write_graph(found.corrected_graph, path)
    again = build(read_graph(path))
    assert again.graph == found.corrected_graph
    assert again.text.splitlines()[3:] == found.corrected_built.text.splitlines()[3:]  # but for where it was declared
    assert again.text.splitlines()[2] == found.corrected_built.text.splitlines()[2]  # the digest of the equations
    values = {info.name: info.value for info in again.model.parameters}
    assert values["c_guide"] == found.corrected.values["c_guide"]
    assert "quadratic_loss_runner" in found.corrected_graph.nodes and "quadratic_loss_runner" not in sled().nodes


def test_scores_predict_what_refits_gain_for_small_effects() -> None:
    train = logs(added(effects.quadratic_loss, "runner", 0.005), 3)
    base = fitted(train)
    turn = one_round(built(), base, train, FUNCTIONS)
    for trial in turn.trials:
        if trial.candidate.place.label != "runner":
            continue
        own = replace(base.problem.filter_model, model=build(trial.candidate.apply(sled())).model)
        free = (*at_optimum(base), *coefficients(trial.candidate, own))
        gain = base.nll - fit(EstimationProblem(own, tuple(train), tuple(free))).nll
        assert gain == pytest.approx(trial.score_gain, rel=0.1, abs=1.0), trial.candidate.label
    gains = {trial.candidate.label: trial.score_gain for trial in turn.trials}
    assert 10.0 < gains["quadratic_loss at runner"] < 30.0


def test_places_are_ranked_by_what_they_explain(found: ClosedLoop, nothing: ClosedLoop) -> None:
    first, second, *others = found.rounds[0].located
    assert {first.junction, second.junction} == {"runner", "drum"}
    assert first.variable == second.variable == "effort"
    assert first.share == pytest.approx(1.0, abs=1e-6) and second.share == pytest.approx(1.0, abs=1e-6)
    assert max(first.p_value, second.p_value) < 1e-6
    assert [(place.junction, place.variable) for place in others] == [("force", "sensor"), ("speed", "sensor")]
    assert min(place.p_value for place in nothing.rounds[0].located) > 0.01


def test_the_missing_effort_follows_the_law(found: ClosedLoop) -> None:
    train = logs(added(effects.quadratic_loss, "runner", QUADRATIC), 1, c_guide=10.0)
    place = found.added[0].trial.candidate.place
    picture = missing_effort(found.nominal_built, found.corrected, train, place)
    assert (picture.junction, picture.effort_unit, picture.flow_unit) == ("runner", "N", "m/s")
    assert picture.flow.shape == picture.effort.shape == picture.std.shape == (800,)
    law = QUADRATIC * picture.flow * np.abs(picture.flow)
    assert np.corrcoef(picture.effort, law)[0, 1] > 0.97
    error = picture.effort - law
    assert np.sqrt(np.mean(error**2)) < 0.2 * np.std(law)
    assert 0.5 < np.sqrt(np.mean((error / picture.std) ** 2)) < 2.0


def test_a_missing_effort_is_drawn_at_a_junction_of_common_flow(found: ClosedLoop) -> None:
    train = logs(sled(), 1)
    graph = sled()
    bond = Place(handle(graph, "drum"), Scale(1.0, 1.0), graph.bonds[1])
    with pytest.raises(OptionError, match="a missing effort acts at a 1-junction, a missing flow at a 0-junction"):
        missing_effort(found.nominal_built, found.corrected, train, bond)


def test_coloured_noise_gives_no_false_effect() -> None:
    train = [pull(sled(), seed, name=f"run{seed}", colour=0.9) for seed in (5, 6)]
    closed = close_loop(sled(), train, [], FUNCTIONS)
    assert closed.added == ()
    assert closed.verdict == "disturbance"  # noise of a sensor that has a memory
    assert {one.trial.candidate.place.label for one in closed.disturbances} == {"sensor force"}


@pytest.mark.slow
@pytest.mark.parametrize(("colour", "tails"), [(0.0, None), (0.9, None), (0.0, 3.0)])
def test_false_alarms_are_rare_whatever_the_parameters_and_the_noise(colour: float, tails: float | None) -> None:
    alarms = 0
    for seed in range(25):
        friction = 12.0 * float(np.random.default_rng(seed).uniform(0.7, 1.4))
        train = [
            pull(sled(), 1000 + 2 * seed + run, name=f"run{run}", colour=colour, tails=tails, c_guide=friction)
            for run in (0, 1)
        ]
        turn = one_round(built(), fitted(train), train, (*effect_functions(effects), *SENSOR_FAULTS))
        # a lag colours noise as a memory of its own does: the loop weighs both, a round does not
        alarms += turn.chosen is not None and bool(close_loop(sled(), train, [], effect_functions(effects)).added)
    assert alarms <= 1  # at a level of 1 % two or more happen once in 40 times


def test_bad_use_is_told() -> None:
    train = logs(sled(), 1)
    with pytest.raises(DataError, match=r"sled: no training log - give at least one with --data"):
        close_loop(sled(), [], train, FUNCTIONS)
    with pytest.raises(OptionError, match=r"sled: no effect to try - give a module with effect functions"):
        close_loop(sled(), train, [], [])
    few = MatchedLog("few", train[0].time[:20], train[0].u[:, :20], train[0].y[:, :20])
    with pytest.raises(DataError, match=r"sled: 40 measurements in few are too few for \d free parameters"):
        close_loop(sled(), [few], [], FUNCTIONS)
