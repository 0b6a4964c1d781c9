"""The search along the linearised filter: it goes on from a state it was kept in; refits by derivatives at hand."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.correct.loop import free_parameters
from bondgraph.estimate.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit, refitted
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.solvers.abstract import search_to_end
from bondgraph.estimate.solvers.linearised import LinearisedScoring, LinearisedState
from tests.correct.winch import drawn, setup_of


@functools.cache
def problem() -> EstimationProblem:
    log = drawn(0.0, samples=300)
    setup = setup_of(log)
    return EstimationProblem(setup.filter_model, (log,), (*free_parameters(setup, ("c", "grip")), *setup.noise))


@functools.cache
def fitted() -> Fit:
    return fit(problem().filter_model, problem().logs, problem().free)


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
    whole = fit(finer, problem().logs, problem().free, tolerance=1e-3)
    assert abs(quick.nll - whole.nll) < 0.5  # nats that exact derivatives may leave
    assert abs(quick.values["c"] - whole.values["c"]) < 0.2 * whole.std["c"]
    assert quick.problem.filter_model is finer
    assert np.isclose(quick.nll, quick.problem.nll(quick.point[:, np.newaxis])[0], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("tolerance", [1e-3, 2.0])  # finished by exact derivatives, and not
def test_a_fit_from_the_journal_is_the_same_in_every_bit(tolerance: float, tmp_path: Path) -> None:
    given = problem()
    first, again = (
        fit(given.filter_model, given.logs, given.free, tolerance=tolerance, journal=Journal(tmp_path)) for _ in "12"
    )
    assert np.array_equal(first.point, again.point) and first.nll == again.nll
    for name in ("gradient", "information"):
        assert np.array_equal(getattr(first.expansion, name), getattr(again.expansion, name))


def test_a_refit_is_taken_from_the_journal(tmp_path: Path) -> None:
    finer = replace(problem().filter_model, substeps=2 * problem().filter_model.substeps)
    first, again = (refitted(fitted(), finer, Journal(tmp_path)) for _ in range(2))
    assert (tmp_path / "fits.json").is_file()
    assert np.array_equal(first.point, again.point) and first.nll == again.nll
    assert np.array_equal(first.expansion.information, again.expansion.information)
