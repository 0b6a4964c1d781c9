"""The search for what is missing: what is refitted, in which order, and that the right law comes out of it."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy import tanh

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct import selection
from bondgraph.correct.constants import INDIFFERENT, OPTIMISM
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import choose
from bondgraph.correct.evidence.reasons import alternatives
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.round import Round, one_round, unsearched
from bondgraph.correct.scores.gates import Gate, _peers, best_gated, gate_samples, gated
from bondgraph.correct.scores.scoring import Scored, linearisation, score_candidates
from bondgraph.correct.search import search as search_module
from bondgraph.correct.search.incumbents import Prediction, predicted_by_scores, scaled
from bondgraph.correct.search.refit import Prepared
from bondgraph.correct.search.search import Entry, Search, _raced, left_out, searched
from bondgraph.correct.search.swap import _inside
from bondgraph.correct.selection import Selection
from bondgraph.correct.shapes.offered import Residual
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import EffectFunction, Place, Scale
from bondgraph.effects.sensors import sensor_delay
from bondgraph.errors import FilterError
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.local import fit, no_report
from bondgraph.estimate.objective import Expansion
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers.steps import promised_gain
from bondgraph.simulate.simulation import simulate
from tests.correct.test_stiff import cubic_loss
from tests.correct.test_stiff import rivals as drags
from tests.correct.winch import NOISE, built, drawn, fitted_to, setup_of, winch

SWITCH = 11.0


def turn(log: MatchedLog, functions: list[EffectFunction]) -> Round:
    """One round on the winch, fitted to a log."""
    return one_round(built(), fitted_to(log), [log], functions)


def named(found: Round) -> set[str]:
    """The chosen candidate and those that the data do not tell from it."""
    assert found.chosen is not None
    others = {f"{one.name} at {one.junction}" for one in found.alternatives if one.indistinguishable}
    return {found.chosen.candidate.label, *found.chosen.stands_for} | others


@functools.cache
def opened() -> Search:
    """A search among two drags of the winch's drum before any refit, each with what its score predicts."""
    trials, scored, context = drags()
    told = predicted_by_scores(context.base, linearisation(context.base, context.train), scored, context)
    entries = [Entry(one, [own] if own else []) for one, own in zip(trials, told, strict=True)]
    return Search(entries, scored, context)


def fresh(**changed: object) -> Search:
    known = opened()
    return replace(
        known, entries=[replace(one, pending=list(one.pending)) for one in known.entries],
        ratios={kind: [value] for kind, value in OPTIMISM.items()}, spent=0, **changed,
    )  # type: ignore[arg-type]  # fmt: skip


def test_bounds_are_predictions_times_optimism_and_what_cannot_be_the_best_is_not_due() -> None:
    search = fresh()
    for one in search.entries:
        assert search.bound(one) == pytest.approx(2.5 * one.predicted)
    assert left_out(search) == ["quadratic_loss at drum", "cubic_loss at drum"]  # the better one first
    small = search.entries[1]
    small.pending = [replace(small.pending[0], gain=0.3 * search.context.required)]
    assert left_out(search) == ["quadratic_loss at drum"]
    nothing = fresh(context=replace(opened().context, required=1e9))
    assert all(one.fit is None for one in searched(nothing, 12, no_report)) and nothing.spent == 0


def test_what_is_left_when_the_refits_are_spent_is_named() -> None:
    search = fresh()
    done = searched(search, 1, no_report)
    assert search.spent == 1 and sum(one.fit is not None for one in done) == 1
    assert set(left_out(search)) <= {"cubic_loss at drum"}


@pytest.mark.parametrize(("ends", "due"), [((100.0, 90.0), [1]), ((90.0, 91.0), [0, 1]), ((90.0, None), [0, 1])])
def test_what_is_behind_on_the_beginnings_waits_for_what_leads_there(
    ends: tuple[float, float | None], due: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A wrong law of a vehicle was searched to the end of its ridge beside the right one, 150 s beside 17 s."""
    opening = fresh()
    search = replace(opening, entries=[replace(one) for one in opening.entries])
    nll = dict(zip((one.trial.candidate.label for one in search.entries), ends, strict=True))

    def told(ready: Prepared, trial: Trial, starts: object, context: Context) -> Prepared:
        end = nll[trial.candidate.label]
        return ready if end is None else replace(ready, begun=replace(context.base, nll=end))

    monkeypatch.setattr(search_module, "begun", told)
    assert search.context.required == 3.0
    assert _raced(search, [0, 1]) == due
    assert all(isinstance(one.ready, Prepared) for one in search.entries)
    better = search.entries[0]
    better.predict(replace(better.pending[0], gain=0.5 * better.predicted))
    assert better.ready is not None
    better.predict(replace(better.pending[0], gain=2.0 * better.predicted))
    assert better.ready is None  # where that begins nobody has looked


def test_bounds_follow_what_fits_achieve() -> None:
    search = fresh()
    search.ratios["smooth"] += [1.0] * 9
    assert search.optimism("smooth") == pytest.approx(1.15)  # the upper decile of nine ones and 2.5
    assert search.optimism("switching") == OPTIMISM["switching"]


def test_a_fit_that_leads_says_what_others_would_gain_and_they_are_searched_again_where_they_gain_more() -> None:
    search = fresh()
    done = searched(search, 12, no_report)
    best = choose(done, 0.01)
    assert best is not None and best.candidate.label == "quadratic_loss at drum"
    other = done[1]
    assert other.instead is not None and other.instead[0] == best.candidate.label
    assert other.instead[1] > INDIFFERENT  # the true law is told from its neighbour
    assert other.gain < best.gain - INDIFFERENT
    again = fresh()
    again.entries[1].trial = replace(other, evidence=replace(other.evidence, delta_nll=1.0))  # type: ignore[type-var]
    again.entries[1].pending = [Prediction(other.gain, ((other.fit or best.fit).point,))]  # type: ignore[union-attr]
    assert again.bound(again.entries[1]) == pytest.approx(other.gain)
    again.entries[1].pending = [replace(again.entries[1].pending[0], gain=1.0 + 0.5 * INDIFFERENT)]
    assert again.bound(again.entries[1]) == 0.0  # nothing that counts is expected


def test_predictions_of_a_fit_without_noise_are_scaled_to_those_of_the_other() -> None:
    point = (np.zeros(2),)
    told = scaled([Prediction(500.0, point), None, Prediction(100.0, point)], 40.0)
    assert [None if one is None else one.gain for one in told] == [40.0, None, 8.0]
    assert scaled([None], 40.0) == [None]


def test_a_candidate_that_diverges_wherever_it_starts_is_an_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    def diverging(*given: object, **named: object) -> Trial:
        raise FilterError("the state grew without bound")

    monkeypatch.setattr("bondgraph.correct.search.search.refit", diverging)
    search = fresh()
    done = searched(search, 6, no_report)
    assert all(one.fit is None and one.failed == "the state grew without bound" for one in done)
    assert choose(done, 0.01) is None and not left_out(search)


def test_a_fit_outlives_a_model_that_cannot_be_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    search = fresh()
    before = searched(search, 1, no_report)[0]
    assert before.fit is not None

    def refused(*given: object) -> None:
        raise FilterError("no model")

    monkeypatch.setattr("bondgraph.correct.search.search.prepared", refused)
    point = search.entries[0].trial.fit.point  # type: ignore[union-attr]
    search.entries[0].pending = [Prediction(before.gain + 10.0, (point,))]
    after = searched(search, 2, no_report)[0]
    assert after.fit is before.fit and not after.failed


@pytest.mark.slow
def test_a_round_whose_refits_were_spent_says_so() -> None:
    found = turn(drawn(0.05), [effects.quadratic_loss])
    assert unsearched([found], 12) == []
    nothing = replace(found, chosen=None, left_out=("cubic_loss at drum",))
    assert unsearched([nothing], 12, white=True) == [] and len(unsearched([nothing], 12)) == 1
    (said,) = unsearched([found, replace(found, left_out=("cubic_loss at drum",))], 12)
    assert said.startswith("round 2 ended with its 12 refits spent: cubic_loss at drum might have done better")
    assert "--refits 24" in said and "LoopSettings(refits=24)" in said


def test_candidates_are_compared_against_the_same_fit_without_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """A look at the best found a fit without it 163 nats better; the next one kept its gain and was chosen instead."""
    search = fresh()
    drag, cubic = searched(search, 12, no_report)[:2]
    assert drag.evidence is not None and cubic.evidence is not None and drag.gain > cubic.gain > 20.0

    def better_without(trial: Trial, context: Context) -> Trial:
        assert trial.evidence is not None
        gain = trial.gain - (drag.gain - cubic.gain) - 5.0 if trial.candidate is drag.candidate else trial.gain
        return replace(trial, evidence=replace(trial.evidence, delta_nll=gain, bic_gain=gain - 9.0))

    monkeypatch.setattr(selection, "resolved", lambda trial, context: trial)
    monkeypatch.setattr(selection, "transferred", lambda trial, context: trial)
    monkeypatch.setattr(selection, "confirmed", better_without)
    selected = Selection(search, [drag, cubic], nothing_left(search), no_report)
    best, done = selected.looked_at(), selected.trials
    assert best is done[0] and best.candidate is drag.candidate
    assert done[0].gain - done[1].gain == pytest.approx(drag.gain - cubic.gain)


def nothing_left(search: Search) -> Residual:
    """The residual of a search in which nothing was located."""
    return Residual(search.context.built, linearisation(search.context.base, search.context.train), (), (), ())


def test_the_search_goes_on_behind_what_a_second_look_has_struck_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """An eccentric sensor led with 1137 nats, was struck out, and a crank worth 10400 had not been refitted."""
    search = fresh()
    drag, cubic = searched(search, 1, no_report)
    assert drag.evidence is not None and cubic.fit is None

    def struck(trial: Trial, context: Context) -> Trial:
        assert trial.evidence is not None
        if trial.candidate is not drag.candidate:
            return trial
        return replace(trial, evidence=replace(trial.evidence, p_robust=1.0))

    monkeypatch.setattr(selection, "with_relatives", lambda trials, left, context, report: list(trials))
    for name in ("resolved", "transferred", "beyond_bounds", "beside_given"):
        monkeypatch.setattr(selection, name, lambda trial, context: trial)
    monkeypatch.setattr(selection, "confirmed", struck)
    selected = Selection(search, [drag, cubic], nothing_left(search), no_report)
    best = selected.chosen(12)
    assert best is not None and best.candidate is cubic.candidate and best.fit is not None
    assert selected.trials[0].p_value == 1.0 and search.spent == 2 and not left_out(search)
    spent = fresh()
    spent.spent = 1
    assert Selection(spent, [drag, cubic], nothing_left(search), no_report).chosen(1) is None
    assert left_out(spent) == ["cubic_loss at drum"]  # what might be the best is named


def test_responses_that_one_fit_tells_apart_are_no_equals() -> None:
    search = fresh()
    search.groups = [{0: 0, 1: 0}]
    assert search.are_equal(0, 1)
    search.groups.append({0: 0, 1: 1})
    assert not search.are_equal(0, 1)


@pytest.mark.slow
def test_drag_that_process_noise_stands_in_for_is_found() -> None:
    found = turn(drawn(0.3), [effects.quadratic_loss, effects.viscous_loss, effects.coulomb_loss])
    assert "quadratic_loss at drum" in named(found)
    assert found.chosen is not None and found.chosen.fit is not None
    (name,) = found.chosen.candidate.effect.coefficients
    assert found.chosen.fit.values[name] == pytest.approx(0.3, rel=0.1)


def test_a_neighbour_of_the_true_law_is_told_from_it() -> None:
    found = turn(drawn(0.05), [effects.quadratic_loss, cubic_loss])
    assert "quadratic_loss at drum" in named(found) and "cubic_loss at drum" not in named(found)
    (other,) = (one for one in found.alternatives if one.name == "cubic_loss" and one.junction == "drum")
    assert "nats less than" in other.why


def sticky(level: float) -> MatchedLog:
    """The winch with dry friction of its drum."""
    calm = drawn(0.0)
    g = winch()
    g.resistance("stick", lambda w: level * tanh(w / 0.05), at=handle(g, "drum"))
    run = simulate(build(g).model, calm.time, calm.u, rtol=1e-8).raise_if_failed()
    return MatchedLog("run", calm.time, calm.u, run.y + NOISE * np.random.default_rng(2).standard_normal(run.y.shape))


def test_dry_friction_is_found_beside_laws_that_are_softer_or_have_more_coefficients() -> None:
    """Its score is far too small; hysteresis and Stribeck friction, which are soft, score more."""
    laws = [effects.hysteresis_loss, effects.stribeck_loss, effects.coulomb_loss, effects.viscous_loss]
    found = turn(sticky(1.5), laws)
    assert "coulomb_loss at drum" in named(found)
    assert found.chosen is not None and found.chosen.fit is not None
    assert found.chosen.candidate.effect.name == "coulomb_loss"  # at the motor or the drum, which the coupling ties
    (name,) = found.chosen.candidate.effect.coefficients
    assert found.chosen.fit.values[name] == pytest.approx(1.5, rel=0.2)


def test_a_sensor_that_comes_late_is_found_from_little_process_noise() -> None:
    seen = drawn(0.0)
    y = seen.y.copy()
    y[0] = np.interp(seen.time - 0.15, seen.time, y[0])
    log = replace(seen, y=y)
    setup = setup_of(log)
    base = fit(EstimationProblem(setup.filter_model, (log,), (*free_parameters(setup, ()), *setup.noise)))
    found = one_round(built(), base, [log], [effects.quadratic_loss, sensor_delay])
    assert found.chosen is not None and found.chosen.candidate.label.startswith("sensor_delay at sensor motor_speed")
    assert found.chosen.fit is not None
    assert found.chosen.fit.values["delay_motor_speed"] == pytest.approx(0.15, rel=0.1)


def late(function: EffectFunction, size: float) -> MatchedLog:
    """The winch with a loss of its drum from a time on."""
    calm = drawn(0.0)
    graph = winch()
    place = Place(handle(graph, "drum"), Scale(5.0, 20.0))
    effect = gated(function, Gate("from", "run", SWITCH), [calm])(graph, place)
    assert effect is not None
    graph = with_values(graph, {effect.coefficients[0]: size, "c": 0.3})
    run = simulate(build(graph).model, calm.time, calm.u, rtol=1e-8).raise_if_failed()
    return MatchedLog("run", calm.time, calm.u, run.y + NOISE * np.random.default_rng(4).standard_normal(run.y.shape))


@pytest.fixture(scope="module")
def part() -> tuple[Context, Scored]:
    """Drag from a time on, scored throughout."""
    log = late(effects.quadratic_loss, 0.005)
    base = fitted_to(log)
    where = places(built(), [log], base.runs([log]), base.theta)
    found, _ = candidates(built(), [effects.quadratic_loss, cubic_loss, effects.viscous_loss], where[:2])
    scored = score_candidates(linearisation(base, [log]), found, gate_samples([log]))
    return Context(built(), base, (log,), len(found), 0.01, 10.0), scored


@pytest.mark.slow
def test_what_acts_from_a_time_on_is_an_event_and_the_same_law_throughout_does_worse() -> None:
    found = turn(late(effects.quadratic_loss, 0.02), [effects.quadratic_loss, effects.viscous_loss])
    best = found.chosen
    assert best is not None and best.gate is not None and best.gate.when == "from"
    assert best.gate.time == pytest.approx(SWITCH, abs=0.5)
    throughout = [one for one in found.trials if one.gate is None and one.fit is not None]
    assert throughout and all(one.gain < best.gain - INDIFFERENT for one in throughout)
    others = alternatives(best, found.trials, found.scored.scores, 0.01)
    assert all(one.why for one in others)


def test_each_place_has_one_that_acts_in_part_before_another_has_two(part: tuple[Context, Scored]) -> None:
    context, scored = part
    linear = linearisation(context.base, context.train)
    best = best_gated(linear, scored)
    assert best is not None and best.peers[0][0][0] == best.index
    order = [one.label for one in scored.candidates]
    gains = {"quadratic_loss at drum": 500.0, "cubic_loss at drum": 499.0, "quadratic_loss at motor": 490.0}
    near = np.array([gains.get(label, 0.0) for label in order])
    projected = linear.projected(np.concatenate(scored.columns, axis=1))
    projected = replace(projected, information=np.diag(np.diag(projected.information)))  # the coupling ties both places
    found = _peers(projected, near, int(near.argmax()), range(len(order)), scored.candidates)
    assert [order[peer[0][0]] for peer in found] == [
        "quadratic_loss at drum", "quadratic_loss at motor", "cubic_loss at drum",
    ]  # fmt: skip


def test_a_gate_acts_in_its_own_log_only() -> None:
    """Independent logs are not taken one after the other: what began in one is not there in the next."""
    first = drawn(0.0)
    logs = [first, replace(first, name="later")]
    time = np.array([0.0, 11.0, 11.05, 20.0])
    assert list(Gate("from", "run", 11.0).acts(time, "run", logs)) == [0.0, 0.0, 1.0, 1.0]
    assert list(Gate("until", "run", 11.0).acts(time, "run", logs)) == [1.0, 1.0, 0.0, 0.0]
    for when in ("from", "until"):
        assert list(Gate(when, "run", 11.0).acts(time, "later", logs)) == [0.0] * 4  # type: ignore[arg-type]
        assert list(Gate(when, "later", 11.0).acts(time, "run", logs)) == [0.0] * 4  # type: ignore[arg-type]


@given(st.integers(0, 10_000), st.integers(2, 6))
@settings(max_examples=40, deadline=None)
def test_a_move_between_bounds_is_that_of_a_bounded_least_squares(seed: int, size: int) -> None:
    """An added mass beside a free mass, and the drive's scale, took every law's place: all went to nothing together."""
    chance = np.random.default_rng(seed)
    slopes, errors = chance.standard_normal((20, size)), chance.standard_normal(20)
    low, high = -chance.uniform(0.0, 0.2, size), chance.uniform(0.0, 0.2, size)
    expansion = Expansion(slopes.T @ errors, slopes.T @ slopes, 1)
    move = _inside(expansion, low, high)
    assert np.all((move >= low) & (move <= high))
    for other in (np.zeros(size), *(chance.uniform(low, high) for _ in range(50))):
        assert promised_gain(expansion, move) >= promised_gain(expansion, other) - 1e-9
    wide = _inside(expansion, np.full(size, -np.inf), np.full(size, np.inf))
    assert wide == pytest.approx(-np.linalg.solve(expansion.information, expansion.gradient))
