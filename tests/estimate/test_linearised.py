"""The search along the linearised filter: it goes on from a state it was kept in; refits by derivatives at hand."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bondgraph.errors import FilterError
from bondgraph.estimate import estimation
from bondgraph.estimate.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.derivatives import exact
from bondgraph.estimate.derivatives.linearised import filter_runs, is_linearised, kicks_along, linear_expansion
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.journal import Journal, fit_key
from bondgraph.estimate.local import fit, refitted
from bondgraph.estimate.objective import SearchOutcome, TraceRow
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.result import Estimate
from bondgraph.estimate.solvers import linearised
from bondgraph.estimate.solvers.abstract import search_to_end
from bondgraph.estimate.solvers.linearised import LinearisedScoring, LinearisedState
from bondgraph.estimate.ties import read_ties
from bondgraph.filter.choice import choose_method
from bondgraph.filter.linear import intervals
from bondgraph.filter.robust import Robust
from bondgraph.filter.samples import Samples
from tests.correct.winch import drawn, setup_of


@functools.cache
def problem() -> EstimationProblem:
    log = drawn(0.0, samples=300)
    setup = setup_of(log)
    return EstimationProblem(setup.filter_model, (log,), (*free_parameters(setup, ("c", "grip")), *setup.noise))


@functools.cache
def fitted() -> Fit:
    return fit(problem())


def test_a_search_that_was_interrupted_is_the_same_in_every_bit(tmp_path: Path) -> None:
    whole, _ = search_to_end(LinearisedScoring(), problem(), problem().start)
    begun, _ = search_to_end(LinearisedScoring(iterations=3), problem(), problem().start)
    save_checkpoint(tmp_path, Checkpoint("winch", 1.0, {"search": begun}))
    kept = load_checkpoint(tmp_path, "winch")
    assert kept is not None
    state = kept.states["search"]
    assert isinstance(state, LinearisedState) and whole.iteration > state.iteration == 3
    again, _ = search_to_end(LinearisedScoring(), problem(), problem().start, state=state)
    assert np.array_equal(again.point, whole.point) and again.trace == whole.trace


def test_a_refit_with_shorter_steps_ends_where_a_whole_search_does() -> None:
    finer = replace(problem().filter_model, substeps=2 * problem().filter_model.substeps)
    quick = refitted(fitted(), finer)
    whole = fit(EstimationProblem(finer, problem().logs, problem().free), tolerance=1e-3)
    assert abs(quick.nll - whole.nll) < 0.5  # nats that exact derivatives may leave
    assert abs(quick.values["c"] - whole.values["c"]) < 0.2 * whole.std["c"]
    assert quick.problem.filter_model is finer
    assert np.isclose(quick.nll, quick.problem.nll(quick.point[:, np.newaxis])[0], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("tolerance", [1e-3, 2.0])  # finished by exact derivatives, and not
def test_a_fit_from_the_journal_is_the_same_in_every_bit(tolerance: float, tmp_path: Path) -> None:
    given = problem()
    first, again = (fit(given, tolerance=tolerance, journal=Journal(tmp_path)) for _ in "12")
    assert np.array_equal(first.point, again.point) and first.nll == again.nll
    for name in ("gradient", "information"):
        assert np.array_equal(getattr(first.expansion, name), getattr(again.expansion, name))


def test_a_refit_is_taken_from_the_journal(tmp_path: Path) -> None:
    finer = replace(problem().filter_model, substeps=2 * problem().filter_model.substeps)
    first, again = (refitted(fitted(), finer, Journal(tmp_path)) for _ in range(2))
    assert (tmp_path / "fits.json").is_file()
    assert np.array_equal(first.point, again.point) and first.nll == again.nll
    assert np.array_equal(first.expansion.information, again.expansion.information)


def test_terms_along_the_filter_are_those_of_the_likelihood_in_every_bit() -> None:
    """So that exact derivatives need not filter for them where a search along the linearised filter ended."""
    with_gaps = problem().logs[0].y.copy()
    with_gaps[0, 20:25] = np.nan
    for y in (problem().logs[0].y, with_gaps):
        own = replace(problem(), logs=(replace(problem().logs[0], y=y),))
        along, alone = linear_expansion(own, own.start).terms, own.terms(own.start[:, np.newaxis])
        assert along is not None
        np.testing.assert_array_equal(along.innovations[:, :1], alone.innovations)
        np.testing.assert_array_equal(along.log_scales[:, :1], alone.log_scales)


def test_a_fit_in_the_journal_is_known_by_every_number_of_its_filter() -> None:
    """Nodes of the process noise and correlations of sensors were no part of the key."""
    own = problem().filter_model
    others = [
        replace(own, noise_nodes=own.noise_nodes + 1), replace(own, noise_scheme="sampled"), replace(own, beta=1.0),
        own.with_halved_steps(), replace(own, robust=Robust("huber", 2.0)),
    ]  # fmt: skip
    keys = [fit_key(replace(problem(), filter_model=one), [0.1, [problem().start]]) for one in (own, *others)]
    assert len(set(keys)) == len(keys)
    assert fit_key(problem(), [0.1, [problem().start]]) == keys[0] != fit_key(problem(), [0.1, [problem().upper]])


def _estimated(monkeypatch: pytest.MonkeyPatch, repays: int, **asked: Any) -> Estimate:
    monkeypatch.setattr(exact, "_REPAYS", repays)
    free = (replace(one, start=0.9) if one.name == "c" else one for one in problem().free)
    away = replace(problem(), free=tuple(free))
    settings = Settings(method="gradient", starts=asked.pop("starts", 1), certify="none")
    return estimate(away, settings, jacobian=exact.derivatives, **asked)


def test_an_estimate_of_a_stiff_model_is_that_of_exact_derivatives_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    rows: list[TraceRow] = []
    near = _estimated(monkeypatch, 0, progress=rows.append)
    monkeypatch.setattr(estimation, "is_linearised", lambda problem: False)
    alone = _estimated(monkeypatch, 0)
    stages = [row.stage for row in near.trace]
    assert stages[0] == LinearisedScoring.stage and stages[-1] == "gauss-newton"
    assert near.outcome.succeeded and near.nll == pytest.approx(alone.nll, abs=1e-4)
    std = np.sqrt(np.diag(alone.coordinate_covariance))  # NaN where the data say nothing
    assert not np.any(np.abs(near.point - alone.point) > 0.01 * std)
    exact_steps = [row.iteration for row in near.trace if row.stage == "gauss-newton"]
    assert max(exact_steps) < max(row.iteration for row in alone.trace)
    assert near.trace == tuple(row for row in rows if row.stage in stages)
    assert [row.evaluations for row in rows] == sorted(row.evaluations for row in rows)


def test_short_searches_and_those_by_other_quantities_begin_with_exact_derivatives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert {row.stage for row in _estimated(monkeypatch, 10**9).trace} == {"gauss-newton"}
    tied = replace(problem(), free=problem().free[:1], ties=read_ties({"slip": "0.1*c/c"}))
    assert is_linearised(problem()) and not is_linearised(tied)
    assert not is_linearised(replace(problem(), filter_model=replace(problem().filter_model, robust=Robust("huber"))))


@pytest.mark.parametrize(("stage", "iteration"), [("linearised scoring from start 2", 1), ("gauss-newton", 1)])
def test_an_estimate_that_was_interrupted_along_the_linearised_filter_goes_on(
    stage: str, iteration: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(row: TraceRow) -> None:
        if row.stage == stage and row.iteration == iteration:
            raise KeyboardInterrupt

    whole = _estimated(monkeypatch, 0, starts=2)
    early = _estimated(monkeypatch, 0, starts=2, folder=tmp_path, progress=stop)
    assert early.outcome is SearchOutcome.INTERRUPTED and whole.nll <= early.nll < whole.trace[0].nll
    again = _estimated(monkeypatch, 0, starts=2, folder=tmp_path, resume=True)
    assert np.array_equal(again.point, whole.point) and again.trace == whole.trace
    assert again.evaluations == whole.evaluations


def test_a_filter_that_cannot_be_linearised_leaves_its_start_to_exact_derivatives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object) -> None:
        raise FilterError("singular")

    monkeypatch.setattr(linearised, "linear_expansion", refuse)
    fit = _estimated(monkeypatch, 0)
    assert fit.outcome.succeeded
    assert [row.stage for row in fit.trace].count(LinearisedScoring.stage) == 1


def test_steps_of_kicks_do_not_follow_a_plan() -> None:
    """A plan asks for one step here and thirty there; kicks need as many in each interval of one length."""
    (log,) = problem().logs
    planned = choose_method(replace(problem().filter_model, method="auto"), [log])
    assert planned.is_stiff and planned.plan is not None
    samples = Samples.whole(planned, log)
    assert len(set(samples.substeps.tolist())) > 1
    assert set(intervals._steps(planned, samples).tolist()) == {intervals._STEPS}
    runs = filter_runs(replace(problem(), filter_model=planned), problem().start)
    (known,) = kicks_along(replace(problem(), filter_model=planned), problem().start, runs)
    assert np.isfinite(known.moved).all()
