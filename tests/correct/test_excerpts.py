"""Searches that begin on the beginnings of long logs: what is cut, what is not, and that they end on the whole."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.search.refit import refit_from
from bondgraph.estimate import searches as fitting
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.excerpt import excerpt
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.local import fit
from bondgraph.estimate.noise_starts import quiet_start
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers.linearised import LinearisedScoring, linear_search
from tests.correct import sled
from tests.correct.winch import drawn, setup_of


@functools.cache
def problem() -> EstimationProblem:
    logs = (drawn(0.0), replace(drawn(0.0, seed=2, samples=300), name="second"))
    setup = setup_of(logs[0])
    return EstimationProblem(setup.filter_model, logs, (*free_parameters(setup, ("c",)), *setup.noise))


def test_every_log_is_cut_to_the_same_share_from_its_start() -> None:
    short = excerpt(problem(), 200)
    assert short is not None
    assert [len(log) for log in short.logs] == [125, 75]
    assert all(np.array_equal(a.y, b.y[:, : len(a)]) for a, b in zip(short.logs, problem().logs, strict=True))
    assert short.names == problem().names


def test_what_is_hardly_longer_or_shows_less_is_taken_whole() -> None:
    assert excerpt(problem(), 600) is None
    silent = replace(problem().logs[0], y=problem().logs[0].y.copy())
    silent.y[0, :300] = np.nan  # the sensor of the motor is switched on later
    assert excerpt(replace(problem(), logs=(silent,)), 200) is None


def test_a_fit_that_begins_on_an_excerpt_ends_where_one_on_the_whole_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fitting, "excerpt", lambda given: excerpt(given, 250))
    begun = _fitted()
    monkeypatch.setattr(fitting, "excerpt", lambda given: None)
    whole = _fitted()
    # each may end where the last exact derivatives still promise about a nat
    assert begun.nll == pytest.approx(whole.nll, abs=2.0)
    assert begun.values["c"] == pytest.approx(whole.values["c"], abs=0.5 * whole.std["c"])


def _fitted() -> Fit:
    given = problem()
    return fit(given, first=quiet_start(given.free, given.start))


def test_a_level_of_which_the_data_say_nothing_is_not_thrown_far() -> None:
    given = problem()
    reached = linear_search(LinearisedScoring(1), given, given.start)
    levels = [one.target.kind in ("std", "process") for one in given.free]
    assert np.abs(reached.point - given.start)[levels].max() <= 1.5


def test_a_candidate_that_cannot_pass_is_given_up() -> None:
    """Nothing is missing, so that a refit gains next to nothing; one that would have to gain a lot is not finished."""
    log = sled.pull(sled.sled(), 3)
    base, own = sled.fitted([log]), sled.built()
    where = [one for one in places(own, [log], base.runs([log]), base.theta) if one.label == "runner"]
    (constant,), _ = candidates(own, [effects.constant_effort], where)

    def refitted(required: float) -> Fit:
        found = refit_from(Trial(constant, 0.0), [1.0], Context(own, base, (log,), 20, 0.01, required)).fit
        assert found is not None
        return found

    near, far = refitted(10.0), refitted(1000.0)
    assert far.evaluations < near.evaluations
    assert base.nll - far.nll < base.nll - near.nll < 10.0
