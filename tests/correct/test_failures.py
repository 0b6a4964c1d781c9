"""One candidate of many that fails is an outcome with its reason: it ends no loop, and nothing found is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.correct import rest
from bondgraph.correct.loop import ClosedLoop, LoopSettings, close_loop
from bondgraph.correct.result import result_json
from bondgraph.correct.scores import scoring
from bondgraph.correct.scores.score import scores, solve
from bondgraph.correct.search import search, storages
from bondgraph.errors import EstimationError
from bondgraph.estimate.fitted import standard_deviations
from bondgraph.estimate.objective import Expansion
from bondgraph.estimate.solvers.steps import damped_step, newton_decrement
from bondgraph.estimate.symmetric import informed, scaled_eigen
from tests.correct.sled import FUNCTIONS, added, pull, sled


class Box:
    lower, upper = np.full(3, -5.0), np.full(3, 5.0)


#: A coordinate of which the data say nothing but rounding, one whose derivatives overflowed, and both.
SPOILT = [
    np.array([[1e-320, 1e-17, 0.0], [1e-17, 2.0, 0.5], [0.0, 0.5, 1.0]]),
    np.array([[0.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]]),
    np.array([[np.inf, np.nan, np.nan], [np.nan, 2.0, 0.5], [np.nan, 0.5, 1.0]]),
    np.array([[3.0, np.nan, np.inf], [np.nan, 2.0, 0.5], [np.inf, 0.5, 1.0]]),
]


@pytest.mark.parametrize("matrix", SPOILT)
def test_information_without_meaning_is_left_out_and_spoils_nothing_else(matrix: np.ndarray) -> None:
    # numpy.linalg.LinAlgError: Eigenvalues did not converge
    assert informed(matrix).tolist() == [False, True, True]
    inner, gradient = matrix[1:, 1:], np.array([np.nan, 1.0, -2.0])
    expected = np.linalg.solve(inner, gradient[1:])
    assert solve(matrix, gradient[:, np.newaxis])[:, 0] == pytest.approx([0.0, *expected], rel=1e-9)
    assert scaled_eigen(matrix).values.size == 2
    expansion = Expansion(gradient, matrix, 1)
    std = standard_deviations(expansion)
    assert std[0] == np.inf and std[1:] == pytest.approx(np.sqrt(np.diag(np.linalg.inv(inner))))
    assert not expansion.is_finite


def test_steps_with_derivatives_that_are_not_finite_stay_in_the_box() -> None:
    expansion = Expansion(np.array([np.inf, 1.0, -2.0]), SPOILT[2], 1)
    promise = newton_decrement(Box(), np.zeros(3), expansion)  # type: ignore[arg-type]
    known = np.array([1.0, -2.0])
    assert promise == pytest.approx(0.5 * known @ np.linalg.solve(SPOILT[2][1:, 1:], known), rel=1e-6)
    step = damped_step(Box(), np.zeros(3), expansion, 1e-6)  # type: ignore[arg-type]
    assert step[0] == 0.0 and np.isfinite(step).all()


def test_scores_beside_a_coordinate_without_information_are_what_they_are_without_it() -> None:
    rng = np.random.default_rng(3)
    x, z = rng.standard_normal((50, 3)), rng.standard_normal(50)
    x[:, 0] = 0.0  # its diagonal is zero, and entries beside it are rounding
    information = x.T @ x
    information[0, 1] = information[1, 0] = 1e-17
    alone = scores(Expansion(-x[:, 1:].T @ z, (x.T @ x)[1:, 1:], 1), 1, np.zeros(1, dtype=bool))
    beside = scores(Expansion(-x.T @ z, information, 1), 2, np.zeros(1, dtype=bool))
    assert beside.gain == pytest.approx(alone.gain) and beside.step == pytest.approx(alone.step)


def closed(functions: tuple[object, ...] = FUNCTIONS, **named: object) -> ClosedLoop:
    logs = [pull(added(effects.quadratic_loss, "runner", 2.0), 1)]
    return close_loop(sled(), logs, [], functions, LoopSettings(max_effects=1, faults=False, **named))  # type: ignore[arg-type]


def test_a_candidate_whose_refit_fails_is_listed_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    known = search.refit

    def failing(trial: object, *given: object) -> object:
        if trial.candidate.effect.name == "added_inertia":  # type: ignore[attr-defined]
            raise np.linalg.LinAlgError("Eigenvalues did not converge")
        return known(trial, *given)  # type: ignore[arg-type]

    monkeypatch.setattr(search, "refit", failing)
    monkeypatch.setattr(search.Search, "optimism", lambda self, kind: 1e3)  # so that all of them are refitted
    monkeypatch.setattr(rest, "_look", lambda *given: (None, None, ()))
    found = closed()
    named = [one for one in found.rounds[0].alternatives if "Eigenvalues did not converge" in one.why]
    assert {one.name for one in named} == {"added_inertia"} and found.verdict == "effect found"
    assert all("could not be tried to the end" in one.why for one in named)
    assert "Eigenvalues did not converge" in str(result_json(found))


def test_a_response_beyond_all_numbers_is_listed_and_leaves_the_other_scores_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    usual = closed()
    known = scoring.candidate_change

    def wild(path: object, candidate: object, variant: object) -> object:
        change = known(path, candidate, variant)  # type: ignore[arg-type]
        if candidate.effect.name == "constant_effort":  # type: ignore[attr-defined]
            return replace(change, start=np.full(change.start.shape, np.inf))
        return change

    monkeypatch.setattr(scoring, "candidate_change", wild)
    found = closed()
    assert found.verdict == usual.verdict == "effect found"
    gains = [{one.candidate.label: one.score_gain for one in loop.rounds[0].trials} for loop in (usual, found)]
    for label, gain in gains[0].items():
        assert gains[1][label] == (0.0 if label.startswith("constant_effort") else pytest.approx(gain))
    told = [one for one in found.rounds[0].trials if one.failed]
    assert told and all("grows beyond all numbers" in one.failed for one in told)


def test_a_storage_without_derivatives_is_listed_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    # numpy.linalg.LinAlgError out of a closed loop: the information matrix of a storage candidate was not finite
    def spoilt(problem: object, point: np.ndarray, *given: object) -> Expansion:
        size = point.size
        return Expansion(np.zeros(size), np.full((size, size), np.nan), 1)

    monkeypatch.setattr(storages, "expand", spoilt)
    found = closed((*FUNCTIONS, effects.added_compliance))
    assert found.verdict == "effect found"
    springs = [one for one in found.rounds[0].trials if one.candidate.effect.adds_state]
    assert springs and all(one.fit is None for one in springs)
    assert any(one.failed == storages._NO_DERIVATIVES for one in springs)


@pytest.mark.parametrize("error", [np.linalg.LinAlgError("Singular"), EstimationError("no"), ZeroDivisionError()])
def test_the_shape_of_the_rest_never_ends_a_run(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*given: object) -> None:
        raise error

    monkeypatch.setattr(rest, "splines", failing)
    found = closed()
    assert found.verdict == "effect found" and found.unexplained == ()
    assert any(one.startswith("what stays unexplained could not be looked for") for one in found.cautions)


def test_noise_levels_may_be_named_among_what_is_free() -> None:
    # "free parameter 'std(speed)' is named twice", though it was named once
    found = closed(free=("c_guide", "std(speed)", "std( force )"))
    assert found.verdict == "effect found"
    assert found.nominal.problem.names.count("std(speed)") == 1
