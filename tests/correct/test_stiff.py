"""Stiff models in the loop: responses, noise levels, fits and the picture of what is missing, without differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.correct.fits import setup as filter_setups
from bondgraph.correct.fits.fit import Fit, fit, no_report
from bondgraph.correct.fits.linear_steps import Reached, filter_runs, is_linearised, linear_expansion
from bondgraph.correct.fits.polish import polished
from bondgraph.correct.fits.setup import unknown_drives
from bondgraph.correct.fits.whiteness import is_white
from bondgraph.correct.loop import free_parameters
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.places.missing import missing_effort
from bondgraph.correct.refits import confirm
from bondgraph.correct.refits.confirm import confirmed
from bondgraph.correct.refits.decide import alternatives, choose
from bondgraph.correct.refits.exchange import exchanges
from bondgraph.correct.refits.gated_refits import also_throughout
from bondgraph.correct.refits.refit import Ground, alike, refit_alone
from bondgraph.correct.refits.stiff_picks import picked_quiet, simpler_law, varied
from bondgraph.correct.refits.stiff_refits import refit_quiet, refit_stiff
from bondgraph.correct.refits.storages import search_storage
from bondgraph.correct.refits.trials import Trial
from bondgraph.correct.responses.intervals import kicks
from bondgraph.correct.responses.response import kicked_along
from bondgraph.correct.round import one_round
from bondgraph.correct.scores.gates import Gate
from bondgraph.correct.scores.quiet import is_driven, quiet_scores
from bondgraph.correct.scores.score import Scores
from bondgraph.correct.scores.scoring import Scored, linearisation, score_candidates
from bondgraph.declare.effect import Effect, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.sensors import sensor_delay
from bondgraph.errors import FilterError
from bondgraph.estimate.objective import SearchOutcome, central_differences
from bondgraph.filter.samples import Samples
from tests.correct.winch import built, drawn, fitted, setup_of


def test_the_method_and_what_walks_are_found_from_model_and_logs() -> None:
    setup = setup_of(drawn(0.0))
    assert setup.filter_model.is_stiff
    assert unknown_drives(built().model, [drawn(0.0)]) == ("slope",)
    assert "process(slope)" in {one.name for one in setup.noise}
    assert setup.filter_model.initial_std["slope"] < 0.2  # where the inclinometer shows it


def test_a_grip_that_few_samples_miss_is_seen_along_the_course_of_the_filter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(filter_setups, "looks_stiff", lambda model, logs: False)
    assert setup_of(drawn(0.0)).filter_model.is_stiff


def test_kicks_from_the_point_before_give_the_expansion_of_this_one() -> None:
    base = fitted(0.0)
    problem, log = base.problem, base.problem.logs[0]
    theta = problem.batch(base.point[:, np.newaxis]).theta[:, 0]
    kicked = [kicked_along(run, log, theta) for run in filter_runs(problem, base.point)]
    names = np.array(problem.names)
    moved = base.point + np.where(names == "c", 0.005 * (problem.upper - problem.lower), 0.0)
    near, fresh = linear_expansion(problem, moved, kicked=kicked), linear_expansion(problem, moved)
    std = 1.0 / np.sqrt(np.diag(fresh.information))
    assert not np.array_equal(near.gradient, fresh.gradient)
    kept = ~base.held & (names != "grip")  # which is faster than the quadrature sees
    assert np.abs((near.gradient - fresh.gradient) * std)[kept].max() < 0.1


def test_kicks_followed_from_node_to_node_leave_what_they_leave_when_followed_to_the_end() -> None:
    base = fitted(0.0)
    (log,), (run,) = base.problem.logs, base.own_runs
    samples, start = Samples.of(run.filter_model, log), run.filtered_mean[:, :-1]
    theta, nodes = samples.theta(run.filter_model, base.theta), (0.0, 0.25, 0.75)
    several = kicks(run.filter_model, samples, start, theta, nodes)
    for k, node in enumerate(nodes):
        alone = kicks(run.filter_model, samples, start, theta, (node,))
        assert np.abs(several.moved[:, k] - alone.moved[:, 0]).max() < 1e-5 * np.abs(alone.moved).max()
        assert np.abs(several.reached[:, k] - alone.reached[:, 0]).max() < 1e-5 * np.abs(start).max()


def test_a_simpler_law_at_the_place_of_the_best_is_refitted_beside_it() -> None:
    log, base = drawn(0.05), fitted(0.05)
    linear = linearisation(base, [log])
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label in ("motor", "drum")]
    found, _ = candidates(built(), [effects.quadratic_loss, effects.coulomb_loss, effects.stribeck_loss], where)
    scored = score_candidates(linear, found)
    trials = [Trial(one, float(gain)) for one, gain in zip(found, scored.scores.gain, strict=True)]
    ground = Ground(built(), base, (log,), len(found), 0.01, 2.0)
    labels = [one.label for one in found]
    leader, expected = labels.index("stribeck_loss at drum"), labels.index("quadratic_loss at drum")
    assert simpler_law(leader, trials, scored.scores, ground) == expected
    assert simpler_law(expected, trials, scored.scores, ground) is None


def test_expansions_are_those_of_the_filter() -> None:
    base = fitted(0.0)
    assert is_linearised(base.problem)
    # the grip of a coupling that does not slip shows in its slip alone, which is faster than the quadrature sees
    kept = ~base.held & (np.array(base.problem.names) != "grip")
    expansion = linear_expansion(base.problem, base.point)
    steps = 1e-4 * (base.problem.upper - base.problem.lower)
    inside = np.clip(base.point, base.problem.lower + 3 * steps, base.problem.upper - 3 * steps)
    (exact,) = central_differences(base.problem, inside[:, np.newaxis], steps[:, np.newaxis])
    assert expansion.terms is not None and exact.terms is not None
    for k in np.flatnonzero(kept):
        own, truth = expansion.terms.innovations[:, 1 + k], exact.terms.innovations[:, 1 + k]
        assert np.linalg.norm(own - truth) < 0.1 * np.linalg.norm(truth), base.problem.names[k]
        own, truth = expansion.terms.log_scales[:, 1 + k], exact.terms.log_scales[:, 1 + k]
        if base.problem.free[k].target.kind != "parameter":
            assert np.linalg.norm(own - truth) < 0.1 * np.linalg.norm(truth), base.problem.names[k]


def test_a_fit_finds_what_the_log_was_made_with() -> None:
    base = fitted(0.0)
    assert base.outcome.succeeded
    assert base.values["c"] == pytest.approx(0.3, abs=4.0 * base.std["c"])
    assert base.evaluations < 60  # one run of the filter per step, where differences would take one per parameter


def test_scores_name_what_is_missing_and_the_picture_shows_it() -> None:
    log, base = drawn(0.05), fitted(0.05)
    linear = linearisation(base, [log])
    where = places(built(), [log], base.runs([log]), base.theta)
    drums = [place for place in where if place.label in ("motor", "drum")]
    found, _ = candidates(built(), [effects.quadratic_loss, effects.constant_effort], drums)
    scored = score_candidates(linear, found)
    best = int(np.argmax(scored.scores.gain))
    assert found[best].effect.name == "quadratic_loss" and found[best].place.label == "drum"
    assert scored.scores.gain[best] > 20.0
    drum = next(place for place in drums if place.label == "drum")
    seen = missing_effort(built(), base, [log], drum)
    clean = missing_effort(built(), fitted(0.0), [drawn(0.0)], drum)
    assert seen.flow.shape == log.time.shape and np.all(seen.std > 0.0)
    assert np.std(seen.effort) > 3.0 * np.std(clean.effort)


def test_stiff_methods_bear_friction_that_turns_round_at_once() -> None:
    log, base = drawn(0.0), fitted(0.0)
    (drum,) = (one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "drum")
    (friction,), _ = candidates(built(), [effects.coulomb_loss], [drum])
    (width,) = (one.value for one in friction.model.parameters if one.name.startswith("w_coulomb_loss"))
    assert width == pytest.approx(0.002 * drum.scale.flow)


def test_few_stiff_candidates_are_refitted_each_on_a_model_of_its_own() -> None:
    log, base = drawn(0.05), fitted(0.05)
    turn = one_round(built(), base, [log], [effects.quadratic_loss, effects.coulomb_loss])
    refitted = [trial for trial in turn.trials if trial.fit is not None]
    assert 1 <= len(refitted) <= 3
    assert turn.chosen is not None
    # a coupling that does not slip makes one place of both
    assert "quadratic_loss at drum" in (turn.chosen.candidate.label, *turn.chosen.stands_for)
    for trial in refitted:
        assert trial.fit is not None and trial.built is not None
        own = set(trial.fit.problem.filter_model.model.names("parameter")) - set(built().model.names("parameter"))
        assert own == set(trial.candidate.effect.parameters)
        assert trial.fit.problem.filter_model.model.text == trial.built.text


def test_a_sensor_that_comes_late_is_searched_from_little_process_noise() -> None:
    seen = drawn(0.0)
    y = seen.y.copy()
    y[0] = np.interp(seen.time - 0.15, seen.time, y[0])
    log = replace(seen, y=y)
    setup = setup_of(log)
    base = fit(setup.filter_model, [log], (*free_parameters(setup, ()), *setup.noise))
    (late,), _ = candidates(built(), [sensor_delay], [Place.sensor("motor_speed", Scale(20.0, 20.0))])
    quiet = quiet_scores(base, [log], [late])
    assert quiet is not None
    found = search_storage(Trial(late, 0.0), Ground(built(), base, (log,), 4, 0.01, 10.0), quiet, 0)
    assert found.fit is not None and found.evidence is not None and found.evidence.accepted(0.01)
    assert found.fit.values["delay_motor_speed"] == pytest.approx(0.15, rel=0.1)


def test_what_does_best_in_part_of_the_data_is_refitted_throughout_too() -> None:
    trials, _, ground = rivals()
    drag = refit_alone(trials[0], trials[0].step, ground)
    part = replace(drag, gate=Gate("from", "run", 5.0))
    unseen = replace(trials[0], score_gain=0.0)
    found = also_throughout([unseen, trials[1], part], ground)
    assert found[1:] == [trials[1], part]
    assert found[0].gate is None and found[0].gain > drag.gain - 2.0  # or where a better optimum is
    assert also_throughout([drag, part], ground) == [drag, part]  # done already
    assert also_throughout([unseen, part], replace(ground, need=1e9)) == [unseen, part]  # too little to begin with


NAMES = ("motor_speed", "drum_speed", "slope_seen")


def test_what_is_found_has_to_hold_in_free_simulation_where_what_tells_of_it_stays_coloured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The winch hangs on a slope that turns in steps, which no walk is: what the inclinometer shows stays coloured."""
    log, base = drawn(0.05), fitted(0.05)
    turn = one_round(built(), base, [log], [effects.quadratic_loss])
    assert turn.chosen is not None and turn.chosen.evidence is not None
    ground = Ground(built(), base, (log,), turn.tried, 0.01, 10.0)
    assert not is_white(turn.chosen.fit or base, 0.01)
    assert confirmed(turn.chosen, ground) is turn.chosen  # for the speeds tell of it, whose innovations are white
    monkeypatch.setattr(confirm, "channel_shares", lambda *given: dict.fromkeys(NAMES, 1.0))  # all by what is coloured
    doubted = confirmed(turn.chosen, ground)
    assert doubted.evidence is not None and doubted.evidence.p_robust > turn.chosen.evidence.p_robust


def four_laws(gain: np.ndarray) -> tuple[list[Trial], Scores, Ground]:
    """Laws at the drum of the winch of which the first and the last could not be smoothed, with scores as given."""
    log, base = drawn(0.3), fitted(0.3)
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "drum"]
    laws = [effects.stribeck_loss, effects.quadratic_loss, effects.viscous_loss, effects.coulomb_loss]
    found, _ = candidates(built(), laws, where)
    names = [law.__name__ for law in laws]
    found = sorted(found, key=lambda one: names.index(one.effect.name))
    for k in (0, 3):  # as if these could not be smoothed
        found[k] = replace(found[k], effect=replace(found[k].effect, amplitudes=(0.1,)))
    alike = np.full((4, 4), 0.95) + 0.05 * np.eye(4)
    scored = Scores(np.ones(4), tuple(np.ones((4, 1))), gain, alike, np.zeros((1, 4)), np.full(4, 1e-6))
    trials = [Trial(one, float(g), (1.0,)) for one, g in zip(found, gain, strict=True)]
    return trials, scored, Ground(built(), base, (log,), 4, 0.01, 10.0)


def test_a_search_begins_from_one_smooth_and_one_switching_law_of_those_much_alike() -> None:
    trials, scored, ground = four_laws(np.array([120.0, 110.0, 100.0, 20.0]))
    assert varied(trials, scored, ground) == [[1], [3]]  # one of one coefficient each, the best first
    apart = replace(scored, correlation=np.eye(4))
    assert varied(trials, apart, ground) == [[0], [1], [2], [3]]  # what switches is underrated, and goes along
    far = [replace(trials[3], score_gain=2.0)]
    assert [3] not in varied([*trials[:3], *far], replace(apart, gain=np.array([120.0, 110.0, 100.0, 6.0])), ground)


def test_with_little_process_noise_the_best_law_that_switches_is_searched_beside_the_best() -> None:
    trials, scored, ground = four_laws(np.array([30.0, 195.0, 190.0, 120.0]))
    assert picked_quiet(trials, scored, ground) == [[1], [2], [3]]
    assert picked_quiet(trials, replace(scored, gain=np.array([30.0, 195.0, 120.0, 120.0])), ground) == [[1], [3]]
    assert picked_quiet(trials, replace(scored, gain=np.array([30.0, 195.0, 120.0, 60.0])), ground) == [[1]]  # too far
    assert picked_quiet(trials, replace(scored, gain=np.array([195.0, 30.0, 30.0, 120.0])), ground) == [[0]]
    done = [trials[0], replace(trials[1], fit=ground.base), *trials[2:]]
    assert picked_quiet(done, scored, ground) == [[2], [3]]  # what was refitted is not searched again


def test_of_those_that_promise_much_the_ones_ahead_in_their_heats_go_on() -> None:
    """Friction that does not grow with speed falls behind drag that does, on the beginning of the log already."""
    log, base = drawn(0.3), fitted(0.3)
    linear = linearisation(base, [log])
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "drum"]
    found, _ = candidates(built(), [effects.quadratic_loss, effects.coulomb_loss], where)
    scored = score_candidates(linear, found)
    trials = [
        Trial(one, float(gain), tuple(step))
        for one, gain, step in zip(found, scored.scores.gain, scored.scores.steps, strict=True)
    ]
    drag, friction = ([one.effect.name for one in found].index(name) for name in ("quadratic_loss", "coulomb_loss"))
    far = Ground(built(), base, (log,), len(found), 0.01, 0.02 * min(trial.score_gain for trial in trials))
    done = refit_stiff(trials, scored, far, 6, no_report)
    assert done[drag].fit is not None and done[drag].fit.values[found[drag].effect.coefficients[0]] > 0.25
    assert done[friction].fit is None or done[friction].fit.nll > done[drag].fit.nll
    assert refit_stiff(trials, scored, replace(far, need=1e9), 6, no_report) == trials  # nothing promises enough
    assert refit_stiff(trials, scored, far, 6, no_report, ahead=1e9) == trials  # nor can reach what another gained


def cubic_loss(g: BondGraph, at: Place) -> Effect | None:
    """Drag with the third power of the speed, which comes near that with the second."""
    c = g.parameter("c_cubic", 0.0, "N m s^3", "cubic drag", (0.0, 0.01))
    g.resistance("cubic", lambda w: c * w**3, at=at.junction)
    return Effect("cubic_loss", "cubic", "effort = c*flow^3", ("c_cubic",))


def rivals() -> tuple[list[Trial], Scored, Ground]:
    """Two drags of the drum, of which it lacks the first, as scored."""
    log, base = drawn(0.005), fitted(0.005)
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "drum"]
    found, _ = candidates(built(), [effects.quadratic_loss, cubic_loss], where)
    scored = score_candidates(linearisation(base, [log]), found)
    trials = [
        Trial(one, float(gain), tuple(step))
        for one, gain, step in zip(found, scored.scores.gain, scored.scores.steps, strict=True)
    ]
    return trials, scored, Ground(built(), base, (log,), len(found), 0.01, 3.0)


def test_a_fit_with_one_effect_tells_what_another_would_gain_in_its_place() -> None:
    trials, scored, ground = rivals()
    drag, cubic = (refit_alone(trial, trial.step, ground) for trial in trials)
    assert drag.fit is not None and cubic.fit is not None
    for there, other, variant in ((cubic, drag, scored.variants[0]), (drag, cubic, scored.variants[1])):
        assert there.fit is not None and other.fit is not None
        (told,) = exchanges(there, [other.candidate], [variant], ground.train, ground.base.point.size)
        assert told is not None
        assert 0.5 < told.loss / (other.fit.nll - there.fit.nll) < 3.0  # of both signs, 50 of 500 nats
        if other is drag:  # its search begins with most of what it gains
            reached = float(drag.fit.problem.nll(np.array(told.starts).T).min())
            assert reached < drag.fit.nll + 0.5 * (ground.base.nll - drag.fit.nll)
    assert exchanges(trials[0], [cubic.candidate], [scored.variants[1]], ground.train, 1) == [None]  # not refitted


def test_nothing_is_told_of_what_has_no_place_for_a_state_that_is_there() -> None:
    trials, scored, ground = rivals()
    (sticking,), _ = candidates(built(), [effects.hysteresis_loss], [trials[0].candidate.place])
    assert set(sticking.model.names("state")) > set(built().model.names("state"))
    there = refit_alone(Trial(sticking, 1.0, (0.1,)), (0.1,), ground)
    shared = ground.base.point.size
    assert there.fit is not None
    moved = np.append(there.fit.point[:shared], np.full(there.fit.point.size - shared, 0.5))  # off its bound
    there = replace(there, fit=replace(there.fit, point=moved))
    assert there.fit is not None and not there.fit.held[shared:].any()
    assert exchanges(there, [trials[0].candidate], scored.variants[:1], ground.train, shared) == [None]


def test_what_process_noise_hides_shows_with_little_of_it() -> None:
    """Drag that noise of the drum stands in for: no score of the fit names it, so that nothing else is refitted."""
    log, base = drawn(0.3), fitted(0.3)
    process = np.array([one.target.kind == "process" for one in base.problem.free])
    silent = np.where(process, base.problem.lower, base.point)
    assert is_driven(base, 10.0) and not is_driven(base, np.inf)  # the noise is worth more than ten nats
    assert not is_driven(replace(base, point=silent), 10.0)
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "drum"]
    found, _ = candidates(built(), [effects.quadratic_loss, effects.coulomb_loss], where)
    drag = [one.effect.name for one in found].index("quadratic_loss")
    scored = score_candidates(linearisation(base, [log]), found)
    unseen = [Trial(one, 0.0, tuple(step)) for one, step in zip(found, scored.scores.steps, strict=True)]
    quiet = quiet_scores(base, [log], found)
    assert quiet is not None and int(np.argmax(quiet.scored.scores.gain)) == drag
    ground = Ground(built(), base, (log,), len(found), 0.01, 10.0)
    done = refit_quiet(unseen, scored, quiet, ground, no_report)
    chosen = choose(done, 0.01)
    assert chosen is done[drag] and chosen.fit is not None
    assert chosen.fit.values[found[drag].effect.coefficients[0]] == pytest.approx(0.3, rel=0.1)


def test_what_would_do_better_in_the_place_of_the_best_is_refitted_though_its_score_was_low() -> None:
    trials, scored, ground = rivals()
    misled = replace(scored, scores=replace(scored.scores, gain=scored.scores.gain[::-1].copy()))
    done = refit_stiff(trials, misled, ground, 1, no_report)
    drag, cubic = done[0].fit, done[1].fit
    assert drag is not None and cubic is not None and drag.nll < cubic.nll - 3.0
    assert done[0].instead is not None and done[0].instead[0] == done[1].candidate.label
    for loss, close in ((1.0, True), (9.0, False)):  # one that was not refitted
        rival = replace(done[1], fit=None, evidence=None, instead=(done[0].candidate.label, loss))
        (other,) = alternatives(done[0], [done[0], rival], scored.scores, 0.01)
        assert other.indistinguishable is close


def test_a_law_of_more_coefficients_is_no_twin_of_one_of_fewer() -> None:
    trials, scored, _ = rivals()
    same = replace(scored.scores, correlation=np.ones((2, 2)))
    assert list(map(sorted, alike(trials, same, 1.0))) == [[0, 1]]
    longer = replace(same, steps=(same.steps[0], np.append(same.steps[1], 0.0)))
    assert sorted(alike(trials, longer, 1.0)) == [[0], [1]]


def test_a_candidate_whose_filter_diverges_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    log, base = drawn(0.3), fitted(0.3)
    linear = linearisation(base, [log])
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "drum"]
    scored = score_candidates(linear, candidates(built(), [effects.quadratic_loss], where)[0])
    trials = [Trial(one, float(gain), (1.0,)) for one, gain in zip(scored.candidates, scored.scores.gain, strict=True)]

    def diverging(*given: object, **named: object) -> Fit:
        raise FilterError("the state grew without bound")

    monkeypatch.setattr("bondgraph.correct.refits.stiff_refits.fit", diverging)
    ground = Ground(built(), base, (log,), 1, 0.01, 1.0)
    assert trials[0].score_gain > ground.need
    assert [trial.fit for trial in refit_stiff(trials, scored, ground, 6, no_report)] == [None]
    monkeypatch.setattr("bondgraph.correct.scores.quiet.fit", diverging)
    assert quiet_scores(base, [log], scored.candidates) is None  # nor is there a quiet fit then


def test_a_fit_goes_on_where_the_linearised_filter_sees_nothing_more() -> None:
    base = fitted(0.0)
    problem = base.problem
    aside = base.point + np.where(np.array(problem.names) == "c", 0.0005 * (problem.upper - problem.lower), 0.0)
    value = float(problem.nll(aside[:, np.newaxis])[0])
    stuck = Reached(aside, value, linear_expansion(problem, aside), 1, SearchOutcome.CONVERGED)
    better = polished(problem, stuck, 0.1)
    assert value > base.nll + 1.0 and better.nll < base.nll + 0.2
    assert better.outcome.succeeded and better.evaluations > stuck.evaluations
    steps = 1e-4 * (problem.upper - problem.lower)
    (exact,) = central_differences(problem, better.point[:, np.newaxis], steps[:, np.newaxis])
    moving = [problem.names.index(name) for name in ("c", "std(motor_speed)", "std(drum_speed)")]
    own, truth = (one.information[np.ix_(moving, moving)] for one in (better.expansion, exact))
    assert own == pytest.approx(truth, rel=0.1, abs=0.1 * np.abs(truth).max())
