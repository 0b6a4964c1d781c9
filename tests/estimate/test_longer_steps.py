"""Searches by way of longer integration steps: the same optimum for less, the same bits again, no wrong way."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bondgraph.build import build
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.editing import with_values
from bondgraph.estimate import local, searches
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.derivatives.differences import forward_differences
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit, refitted
from bondgraph.estimate.longer_steps import doubled, ladder, longest_that_lead
from bondgraph.estimate.objective import SearchOutcome, Terms
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.searches import Wish, search
from bondgraph.estimate.setup import filter_setup
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.samples import Samples
from bondgraph.simulate.example import pendulum
from tests.correct.sled import fitted, pull, sled

#: The steps of the sled's filter are halved so often here, as a certificate of a fast model would.
HALVINGS = 4


@functools.cache
def problem() -> EstimationProblem:
    """A sled whose filter takes far more steps than it needs."""
    base = fitted([pull(sled(), 1)]).problem
    filter_model = base.filter_model
    for _ in range(HALVINGS):
        filter_model = filter_model.with_halved_steps()
    return replace(base, filter_model=filter_model)


def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Integration steps of every evaluation of a likelihood from now on."""
    steps: list[int] = []
    terms, nll = EstimationProblem.terms, EstimationProblem.nll

    def cost(one: EstimationProblem, points: FloatArray) -> None:
        taken = sum(int(Samples.of(one.filter_model, log).substeps.sum()) for log in one.logs)
        steps.append(taken * points.shape[1])

    def counting_terms(self: EstimationProblem, points: FloatArray) -> Terms:
        cost(self, points)
        return terms(self, points)

    def counting_nll(self: EstimationProblem, points: FloatArray) -> FloatArray:
        cost(self, points)
        return nll(self, points)

    monkeypatch.setattr(EstimationProblem, "terms", counting_terms)
    monkeypatch.setattr(EstimationProblem, "nll", counting_nll)
    return steps


def by_own_steps(one: EstimationProblem, monkeypatch: pytest.MonkeyPatch) -> Fit:
    """The fit without a ladder."""
    with monkeypatch.context() as patch:
        patch.setattr(searches, "ladder", lambda problem: [])
        return fit(one)


@given(
    substeps=st.integers(1, 64), grading=st.floats(0.4, 3.0), noise=st.integers(1, 6), reach=st.floats(0.0, 1e3),
)  # fmt: skip
def test_doubled_steps_are_those_that_halving_cuts(substeps: int, grading: float, noise: int, reach: float) -> None:
    swing = FilterModel(
        pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {}, substeps, "ros3p", grading, noise_nodes=noise,
        noise_reach=reach,
    )  # fmt: skip
    again = swing.with_halved_steps().with_doubled_steps()
    assert again is not None and (again.substeps, again.noise_nodes) == (substeps, noise)
    assert again.grading == pytest.approx(grading) and again.noise_reach == pytest.approx(reach)


def test_the_ladder_ends_with_one_step_and_before_steps_become_too_unequal() -> None:
    steps = [one.filter_model.substeps for one in ladder(problem())]
    assert steps == [problem().filter_model.substeps >> k for k in range(1, len(steps) + 1)] and steps[-1] == 1
    graded = replace(problem(), filter_model=replace(problem().filter_model, substeps=16, grading=2.0))
    assert [one.filter_model.grading for one in ladder(graded)] == [4.0]


def test_the_optimum_is_that_of_the_own_steps_for_a_fraction_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    own = by_own_steps(problem(), monkeypatch)
    steps = counted(monkeypatch)
    found = fit(problem())
    short = sum(steps)
    steps.clear()
    by_own_steps(problem(), monkeypatch)
    assert found.outcome.succeeded and found.nll == pytest.approx(own.nll, abs=2e-3)
    own_std = np.array([own.std[name] for name in problem().names])
    assert np.all(np.abs(found.point - own.point)[~own.held] < 0.05 * own_std[~own.held])
    assert short < 0.3 * sum(steps)


def test_a_fit_taken_from_the_journal_is_the_same_in_every_bit(tmp_path: Path) -> None:
    first = fit(problem(), journal=Journal(tmp_path))
    again = fit(problem(), journal=Journal(tmp_path))
    assert np.array_equal(first.point, again.point) and first.nll == again.nll
    assert first.expansion.terms is not None and again.expansion.terms is not None
    assert np.array_equal(first.expansion.information, again.expansion.information)
    assert np.array_equal(first.expansion.terms.innovations, again.expansion.terms.innovations)


@functools.cache
def fast() -> EstimationProblem:
    """A light sled whose guide brakes it within a fifth of a sample: long explicit steps are unstable."""
    light = with_values(sled(), {"m_sled": 1.0, "c_guide": 52.0})
    log, own = pull(light, 2), build(light)
    setup = filter_setup(own.model, own.driven, [log])
    filter_model = replace(setup.filter_model, substeps=16, grading=1.0, noise_scheme="sampled")
    return EstimationProblem(filter_model, (log,), (*free_parameters(setup, ()), *setup.noise))


def test_steps_that_are_unstable_lead_no_search() -> None:
    assert longest_that_lead(problem(), len(ladder(problem())), problem().start) == len(ladder(problem()))
    rungs = len(ladder(fast()))
    assert rungs == 4 and doubled(fast(), rungs).filter_model.substeps == 1
    assert longest_that_lead(fast(), rungs, fast().start) < rungs


def test_where_long_steps_tell_something_else_the_own_ones_decide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps that shift the likelihood may lead a search, but not end it."""
    own = by_own_steps(fast(), monkeypatch)
    found = fit(fast())
    assert found.nll == pytest.approx(own.nll, abs=2e-3)
    ends = [searches._approached(doubled(fast(), k), Wish(40, 1e-3)) for k in (1, 3)]
    assert [searches._tell_the_same(fast(), end, Wish(40, 1e-3).same) for end in ends] == [True, False]
    assert searches._tell_the_same(fast(), ends[1], np.inf)  # where nothing hangs on it they may end one


def test_a_search_ends_where_no_step_follows_its_derivatives(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the bottom of a shallow pit every direction seems to lead down behind its walls; none does."""
    base = fitted([pull(sled(), 1)])
    one = replace(base.problem, free=at_optimum(base))
    bottom, terms, nll, formed = one.start, EstimationProblem.terms, EstimationProblem.nll, []

    def depth(points: FloatArray) -> FloatArray:
        return np.where(np.all(points == bottom[:, np.newaxis], axis=0), 0.0, 0.05)

    def terms_in_pit(self: EstimationProblem, points: FloatArray) -> Terms:
        found = terms(self, points)
        return replace(found, log_scales=found.log_scales + depth(points) / len(found.log_scales))

    def counting(*args: object) -> object:
        formed.append(1)
        return forward_differences(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(EstimationProblem, "terms", terms_in_pit)
    monkeypatch.setattr(EstimationProblem, "nll", lambda self, points: nll(self, points) + depth(points))
    monkeypatch.setattr(searches, "forward_differences", counting)
    found = search(one, Wish(40, 1e-3, longer=False))
    assert found.outcome is SearchOutcome.NO_PROGRESS
    assert np.array_equal(found.point, bottom)
    assert len(formed) <= 2  # once with steps as wide as bounds allow, once with such as the derivatives ask for


def test_of_very_long_logs_a_search_begins_on_a_part(monkeypatch: pytest.MonkeyPatch) -> None:
    logs = [replace(pull(sled(), seed), name=f"run{seed}") for seed in (1, 2, 3)]
    one = fitted(logs).problem
    far = 0.3 * one.lower + 0.7 * one.upper
    steps = counted(monkeypatch)
    whole = search(one, Wish(60, 1e-6, [far], longer=False))
    cost = sum(steps)
    monkeypatch.setattr(searches, "ENOUGH", sum(map(len, one.logs)) // searches._PARTS)  # so long are these, then
    steps.clear()
    found = search(one, Wish(60, 1e-6, [far], longer=False))
    assert found.nll == pytest.approx(whole.nll, abs=2e-3)
    assert sum(steps) < 0.8 * cost


def test_a_fit_with_other_steps_goes_on_from_where_known_derivatives_led(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search with longer steps would only lead back to where the fit has come from."""
    rough = fit(EstimationProblem(*by_long_steps()))
    finer = rough.problem.filter_model.with_halved_steps()
    expected = fit(EstimationProblem(finer, rough.problem.logs, rough.problem.free), 60, 1e-6)
    monkeypatch.setattr(searches, "_by_longer_steps", None)  # not to be called
    monkeypatch.setattr(local, "carried_on", lambda problem, known, tolerance: (replace(known), False))
    again = refitted(rough, finer)
    assert again.nll == pytest.approx(expected.nll, abs=2e-3)


def by_long_steps() -> tuple[FilterModel, tuple[MatchedLog, ...], tuple[FreeParameter, ...]]:
    """The sled with one step between samples."""
    one = problem()
    for rung in ladder(one):
        one = rung
    return one.filter_model, one.logs, one.free
