"""Stiff models in the loop: responses, noise levels, fits and the picture of what is missing, without differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.correct.evidence import confirm
from bondgraph.correct.evidence.confirm import confirmed
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.fits.whiteness import is_white
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.places.missing import missing_effort
from bondgraph.correct.round import one_round
from bondgraph.correct.scores.scoring import Scored, linearisation, score_candidates
from bondgraph.correct.search.groups import alike
from bondgraph.correct.search.refit import refit_from
from bondgraph.correct.search.swap import swaps
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate import otherwise
from bondgraph.estimate import setup as filter_setups
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.derivatives.formed import Formed, Scheme
from bondgraph.estimate.derivatives.linearised import filter_runs, is_linearised, linear_expansion
from bondgraph.estimate.excerpt import excerpt
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import unknown_drives
from bondgraph.estimate.solvers.exact_newton import polished
from bondgraph.estimate.solvers.linearised import Reached
from bondgraph.filter.linear.intervals import kicks
from bondgraph.filter.linear.response import kicked_along
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
        # each part has steps of its own
        assert np.abs(several.moved[:, k] - alone.moved[:, 0]).max() < 1e-3 * np.abs(alone.moved).max()
        assert np.abs(several.reached[:, k] - alone.reached[:, 0]).max() < 1e-3 * np.abs(start).max()


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
    assert base.evaluations < 90  # one run of the filter per step, where differences would take one per parameter


def test_scores_name_what_is_missing_and_the_picture_shows_it() -> None:
    log, base = drawn(0.05), fitted(0.05)
    linear = linearisation(base, [log])
    where = places(built(), [log], base.runs([log]), base.theta)
    drums = [place for place in where if place.label in ("motor", "drum")]
    found, _ = candidates(built(), [effects.quadratic_loss, effects.constant_effort], drums)
    scored = score_candidates(linear, found)
    gains = {one.label: float(gain) for one, gain in zip(found, scored.scores.gain, strict=True)}
    assert gains["quadratic_loss at drum"] > max(20.0, max(gains.values()) - 1.0)  # the motor turns as fast
    assert gains["quadratic_loss at drum"] > gains["constant_effort at drum"] + 10.0
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


NAMES = ("motor_speed", "drum_speed", "slope_seen")


def test_what_is_found_has_to_hold_in_free_simulation_where_what_tells_of_it_stays_coloured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The winch hangs on a slope that turns in steps, which no walk is: what the inclinometer shows stays coloured."""
    log, base = drawn(0.05), fitted(0.05)
    turn = one_round(built(), base, [log], [effects.quadratic_loss])
    assert turn.chosen is not None and turn.chosen.evidence is not None
    context = Context(built(), base, (log,), turn.tried, 0.01, 10.0)
    assert not is_white(turn.chosen.fit or base, 0.01)
    assert confirmed(turn.chosen, context) is turn.chosen  # for the speeds tell of it, whose innovations are white
    monkeypatch.setattr(confirm, "channel_shares", lambda *given: dict.fromkeys(NAMES, 1.0))  # all by what is coloured
    doubted = confirmed(turn.chosen, context)
    assert doubted.evidence is not None and doubted.evidence.p_robust > turn.chosen.evidence.p_robust


def cubic_loss(g: BondGraph, at: Place) -> Effect | None:
    """Drag with the third power of the speed, which comes near that with the second."""
    c = g.parameter("c_cubic", 0.0, "N m s^3", "cubic drag", (0.0, 0.01))
    g.resistance("cubic", lambda w: c * w**3, at=at.junction)
    return Effect("cubic_loss", "cubic", "effort = c*flow^3", ("c_cubic",))


def rivals() -> tuple[list[Trial], Scored, Context]:
    """Two drags of the drum, of which it lacks the first, as scored."""
    log, base = drawn(0.005), fitted(0.005)
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "drum"]
    found, _ = candidates(built(), [effects.quadratic_loss, cubic_loss], where)
    scored = score_candidates(linearisation(base, [log]), found)
    trials = [
        Trial(one, float(gain), tuple(step))
        for one, gain, step in zip(found, scored.scores.gain, scored.scores.steps, strict=True)
    ]
    return trials, scored, Context(built(), base, (log,), len(found), 0.01, 3.0)


def test_a_fit_with_one_effect_tells_what_another_would_gain_in_its_place() -> None:
    trials, scored, context = rivals()
    drag, cubic = (refit_from(trial, trial.step, context) for trial in trials)
    assert drag.fit is not None and cubic.fit is not None
    for there, other, variant in ((cubic, drag, scored.variants[0]), (drag, cubic, scored.variants[1])):
        assert there.fit is not None and other.fit is not None
        (told,) = swaps(there, [other.candidate], [variant], context.train, context.base.point.size)
        assert told is not None
        assert 0.5 < told.loss / (other.fit.nll - there.fit.nll) < 3.0  # of both signs, 50 of 500 nats
        if other is drag:  # its search begins with a part of what it gains; rounding says whether with most
            reached = float(drag.fit.problem.nll(np.array(told.starts).T).min())
            assert reached < drag.fit.nll + 0.9 * (context.base.nll - drag.fit.nll)
    assert swaps(trials[0], [cubic.candidate], [scored.variants[1]], context.train, 1) == [None]  # not refitted


def test_nothing_is_told_of_what_has_no_place_for_a_state_that_is_there() -> None:
    trials, scored, context = rivals()
    (sticking,), _ = candidates(built(), [effects.hysteresis_loss], [trials[0].candidate.place])
    assert set(sticking.model.names("state")) > set(built().model.names("state"))
    there = refit_from(Trial(sticking, 1.0, (0.1,)), (0.1,), context)
    shared = context.base.point.size
    assert there.fit is not None
    moved = np.append(there.fit.point[:shared], np.full(there.fit.point.size - shared, 0.5))  # off its bound
    there = replace(there, fit=replace(there.fit, point=moved))
    assert there.fit is not None and not there.fit.held[shared:].any()
    assert swaps(there, [trials[0].candidate], scored.variants[:1], context.train, shared) == [None]


def test_a_law_of_more_coefficients_is_no_twin_of_one_of_fewer() -> None:
    trials, scored, _ = rivals()
    same = replace(scored.scores, correlation=np.ones((2, 2)))
    assert list(map(sorted, alike(trials, same, 1.0))) == [[0, 1]]
    longer = replace(same, steps=(same.steps[0], np.append(same.steps[1], 0.0)))
    assert sorted(alike(trials, longer, 1.0)) == [[0], [1]]


def test_a_fit_goes_on_where_the_linearised_filter_sees_nothing_more() -> None:
    base = fitted(0.0)
    problem = base.problem
    aside = base.point + np.where(np.array(problem.names) == "c", 0.0005 * (problem.upper - problem.lower), 0.0)
    value = float(problem.nll(aside[:, np.newaxis])[0])
    stuck = Reached(
        aside, value, linear_expansion(problem, aside), 1, SearchOutcome.CONVERGED, Formed(Scheme.LINEARISED, aside)
    )
    better = polished(problem, stuck, 0.1)
    assert value > base.nll + 1.0 and better.nll < base.nll + 0.2
    assert better.outcome.succeeded and better.evaluations > stuck.evaluations
    steps = 1e-4 * (problem.upper - problem.lower)
    (exact,) = central_differences(problem, better.point[:, np.newaxis], steps[:, np.newaxis])
    moving = [problem.names.index(name) for name in ("c", "std(motor_speed)", "std(drum_speed)")]
    own, truth = (one.information[np.ix_(moving, moving)] for one in (better.expansion, exact))
    assert own == pytest.approx(truth, rel=0.1, abs=0.1 * np.abs(truth).max())


@pytest.mark.parametrize(
    ("worse", "least", "looked_at"), [(100.0, 0.0, [200]), (1.0, 0.0, [200, None]), (1.0, 1e9, [])]
)
def test_inputs_that_run_another_way_are_searched_as_far_as_they_may_gain(
    worse: float, least: float, looked_at: list[int | None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 300 s of driving the searches of other ways took 550 s of CPU, and 105 with a look at the beginnings."""
    base = fitted(0.0)
    whole, seen = base.problem.logs[0].time.size, list[int | None]()
    own = -7.0  # on the beginnings

    def stub(problem: EstimationProblem, *given: object, **named: object) -> Fit:
        size = problem.logs[0].time.size
        seen.append(size if size < whole else None)
        return replace(base, nll=(own if size < whole else base.nll) + worse)

    def part(problem: EstimationProblem) -> EstimationProblem | None:
        return excerpt(problem, 200)

    monkeypatch.setattr(otherwise, "fit", stub)
    monkeypatch.setattr(otherwise, "excerpt", part)
    monkeypatch.setattr(otherwise, "on_beginnings", lambda problem, point: own)
    monkeypatch.setattr(otherwise, "newton_decrement", lambda *given: 1e6)  # what a score promises is within reach
    lost = otherwise.lost_otherwise(base, base.problem.filter_model.model, least=least)
    assert seen == looked_at
    assert lost == pytest.approx(worse) if seen else lost > -least
