"""Small rests: no name for what moves no sensor by a fifth of its noise, however long the logs."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.constants import FAINT, NOTICED
from bondgraph.correct.evidence.moves import moves, smallness
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.loop import ClosedLoop, close_loop
from bondgraph.correct.scores.gates import Gate, When
from bondgraph.correct.small_rests import least_beside, small_rest
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import with_values
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.filter.filter_model import FilterModel
from bondgraph.report.closed_loop import explanation
from bondgraph.simulate.simulation import simulate
from tests.correct.sled import FUNCTIONS, NOISE, added, built, pull, sled

#: Samples with which a push of a tenth of the noise gains dozens of nats.
LONG = 8000
FAINT_DRAG = 2.4e-3


def held_at(log: MatchedLog, c_guide: float) -> Fit:
    """The sled with a guide that is known, and no process noise."""
    model = build(with_values(sled(), {"c_guide": c_guide})).model
    quiet = FilterModel(model, {}, NOISE, {"v_sled": 1e-6})
    return fit(EstimationProblem(quiet, (log,), (FreeParameter("c_guide", c_guide, c_guide * 1.0000001, c_guide),)))


def test_moves_are_differences_of_free_simulations_over_the_noise() -> None:
    log = pull(sled(), 4)
    first, second = held_at(log, 12.0), held_at(log, 14.0)
    paths = [
        simulate(one.problem.filter_model.model, log.time, log.u, rtol=1e-10).raise_if_failed().y
        for one in (first, second)
    ]
    found = moves(first, second, math.inf)
    for row, name in enumerate(built().model.names("output")):
        apart = np.sqrt(np.mean((paths[1] - paths[0])[row, 1:] ** 2)) / NOISE[name]
        assert found[name] == pytest.approx(apart, rel=1e-2) and apart > 1.0
    assert moves(first, first, math.inf) == dict.fromkeys(found, 0.0)
    assert smallness(first, second, FAINT) == ""
    assert smallness(first, first, FAINT).startswith("over whole logs it moves no sensor by more than 0 of its noise")


@pytest.mark.parametrize(("when", "share"), [("from", 0.25), ("until", 0.25)])
def test_an_event_moves_what_it_moves_where_it_acts(when: When, share: float) -> None:
    log = pull(sled(), 4)
    first, second = held_at(log, 12.0), held_at(log, 14.0)
    gate = Gate(when, log.name, float(log.time[int(share * log.time.size)]) + 1e-6)
    acts = gate.acts(log.time, log.name, [log]) > 0.0
    assert acts.mean() == pytest.approx(share if when == "until" else 1.0 - share, abs=0.01)
    paths = [
        simulate(one.problem.filter_model.model, log.time, log.u, rtol=1e-10).raise_if_failed().y
        for one in (first, second)
    ]
    found = moves(first, second, math.inf, gate)
    for row, name in enumerate(built().model.names("output")):
        apart = np.sqrt(np.mean((paths[1] - paths[0])[row, 1:][acts[1:]] ** 2)) / NOISE[name]
        assert found[name] == pytest.approx(apart, rel=1e-2)
    told = smallness(first, second, 2.0 * max(found.values()), gate)
    assert told.startswith("where it acts it moves no sensor by more than")


@functools.cache
def closed_on(drag: float) -> ClosedLoop:
    true = added(effects.quadratic_loss, "runner", drag)
    return close_loop(sled(), [pull(true, 8, samples=LONG)], [], FUNCTIONS)


@pytest.mark.slow
def test_an_effect_of_a_tenth_of_the_noise_is_told_without_a_name() -> None:
    closed = closed_on(FAINT_DRAG)
    assert closed.verdict == "no missing effect" and not closed.added
    assert "passes the tests and moves a sensor enough to be told" in explanation(closed)
    best = max((one for one in closed.rounds[-1].trials if one.small), key=lambda one: one.gain)
    assert best.candidate.effect.name == "quadratic_loss" and best.evidence is not None
    assert best.evidence.accepted(0.01) and best.gain > 15.0  # every other test passes
    (said,) = [one for one in closed.cautions if one.startswith("what is left is too small for a name")]
    assert "quadratic_loss at runner" in said and "moves no sensor by more than 0.09 of its noise" in said
    where = (best.candidate.effect.name, best.candidate.place.label)
    told = next(one for one in closed.rounds[-1].alternatives if (one.name, one.junction) == where)
    assert told.why.endswith("too little for a name")


@pytest.mark.slow
def test_three_times_as_much_has_its_name() -> None:
    closed = closed_on(3.0 * FAINT_DRAG)
    assert [one.trial.candidate.label for one in closed.added] == ["quadratic_loss at runner"]
    assert not any("too small" in one for one in closed.cautions)


@pytest.mark.slow
def test_beside_a_larger_law_more_is_asked_for() -> None:
    large = closed_on(3.0 * FAINT_DRAG).added[0].trial
    assert least_beside([], 20.0) == least_beside([large], large.gain + 1.0) == FAINT
    assert least_beside([large], large.gain - 1.0) == NOTICED > FAINT


@pytest.mark.slow
def test_a_round_without_small_rests_says_nothing() -> None:
    assert small_rest([]) == small_rest([Trial(closed_on(FAINT_DRAG).rounds[0].trials[0].candidate, 9.0)]) == ""
