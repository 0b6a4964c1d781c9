"""Transfer: an effect enters only if it predicts data that it was not estimated from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.evidence.decide import choose
from bondgraph.correct.evidence.reasons import alternatives
from bondgraph.correct.evidence.transfer import Transfer, folds, left_out, transfer
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.fits.compared import Compared, Errors, judged
from bondgraph.correct.loop import ClosedLoop, close_loop
from bondgraph.correct.result import result_json
from bondgraph.correct.round import one_round
from bondgraph.data.log import MatchedLog
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.local import fit
from bondgraph.estimate.objective import Terms
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.simulate.quantities import OutputInfo
from bondgraph.simulate.simulation import simulate
from tests.correct.sled import FUNCTIONS, NOISE, added, fitted, pull, sled
from tests.correct.sled import built as sled_built

DRAG = 0.05


def logs(count: int, size: float = DRAG) -> list[MatchedLog]:
    true = added(effects.quadratic_loss, "runner", size)
    return [pull(true, 40 + k, name=f"run{k}") for k in range(count)]


@pytest.fixture(scope="module")
def closed() -> ClosedLoop:
    """Three logs of a sled with a little drag."""
    return close_loop(sled(), logs(3), [], FUNCTIONS)


def _trial(closed: ClosedLoop) -> Trial:
    (one,) = closed.added
    return one.trial


def _blanked(log: MatchedLog, first: int, last: int) -> MatchedLog:
    y = log.y.copy()
    y[:, first : last + 1] = np.nan
    return replace(log, y=y)


def _nll_of(fitted: Fit, log: MatchedLog, first: int, last: int) -> float:
    (run,) = fitted.runs([log])
    return -float(run.log_likelihood[first : last + 1].sum())


@pytest.mark.parametrize("count", [3, 2])
def test_a_newton_step_leaves_a_fold_out_as_a_refit_does(closed: ClosedLoop, count: int) -> None:
    """The gain in every fold against that of fits to everything else: within 3 % of the largest."""
    trial = _trial(closed)
    assert trial.fit is not None
    train = logs(count)
    with_it = fit(EstimationProblem(trial.fit.problem.filter_model, tuple(train), tuple(at_optimum(trial.fit))))
    base = fitted(train)
    told = transfer(base, with_it, trial.candidate.effect)
    really = []
    for fold in folds(train):
        rest = [_blanked(log, fold.first, fold.last) if k == fold.log else log for k, log in enumerate(train)]
        rest = [log for log in rest if np.isfinite(log.y).any()]
        again = [
            fit(EstimationProblem(one.problem.filter_model, tuple(rest), tuple(at_optimum(one))))
            for one in (base, with_it)
        ]
        values = [_nll_of(one, train[fold.log], fold.first, fold.last) for one in again]
        really.append(values[0] - values[1])
    assert len(told.gains) == (3 if count == 3 else 6)
    assert told.gains == pytest.approx(really, abs=0.03 * max(really))
    assert told.passes and told.gain == pytest.approx(base.nll - with_it.nll, rel=0.1)


def test_transfer_is_told_by_fold_in_the_result(closed: ClosedLoop) -> None:
    trial = _trial(closed)
    assert trial.transfer is not None and trial.transfer.folds == ("run0", "run1", "run2")
    told = result_json(closed)["effects"][0]["evidence"]["transfer"]
    assert [one["fold"] for one in told["folds"]] == ["run0", "run1", "run2"] and told["worse"] == []
    assert told["gain"] == pytest.approx(sum(one["delta_nll"] for one in told["folds"]))


@pytest.fixture(scope="module")
def once() -> ClosedLoop:
    """Three launches, one of them with drag: a drag of the whole of that log, and of no other."""
    graphs: list[BondGraph] = [sled(), added(effects.quadratic_loss, "runner", 0.1), sled()]
    train = [pull(graph, 60 + k, name=f"run{k}", c_guide=10.0) for k, graph in enumerate(graphs)]
    return close_loop(sled(), train, [], (effects.quadratic_loss, effects.constant_effort))


def test_an_effect_of_one_log_of_three_does_not_transfer(once: ClosedLoop) -> None:
    (fitted_throughout,) = [
        one for one in once.rounds[0].trials if one.candidate.label == "quadratic_loss at runner" and one.gate is None
    ]
    assert fitted_throughout.fit is not None and fitted_throughout.gain > 15.0
    told = transfer(once.nominal, fitted_throughout.fit, fitted_throughout.candidate.effect)
    assert told.gain < -5.0 and max(told.gains) < 0.0 and not told.passes
    assert "left out, the folds gain" in told.why_not


def test_an_effect_of_one_log_of_three_is_an_event_and_no_law(once: ClosedLoop) -> None:
    """What the event gained was noted as the gain of the law throughout, at the place that it stands for."""
    assert once.added == () and once.verdict == "unexplained residual"
    (event,) = once.events
    assert event.trial.gate is not None and event.trial.gate.log == "run1"
    throughout = [one for one in once.rounds[0].trials if one.gate is None]
    assert all(one.gain < 0.2 * event.trial.gain for one in throughout)


def _told(gains: tuple[float, ...], p_value: float, fold_error: float, *compared: Compared) -> Transfer:
    return Transfer(tuple(f"run{k}" for k in range(len(gains))), gains, 1.0, fold_error, p_value, compared)


def test_what_speaks_against_a_transfer_is_said() -> None:
    worse = Compared("left-out", "prediction", "speed", 0.1, 0.4, 1e-9, True)
    assert _told((5.0, 6.0, 7.0), 1e-4, 1.0).passes
    assert "p = 0.3" in _told((5.0, -4.0, 1.0), 0.3, 4.0).why_not
    assert "all of it in run1" in _told((-0.1, 30.0, -0.1), 0.01, 30.1).why_not
    assert "speed" in _told((5.0, 6.0, 7.0), 1e-4, 1.0, worse).why_not
    assert not _told((float("nan"), 6.0), float("nan"), 1.0).passes


def test_one_that_does_not_transfer_is_not_chosen(closed: ClosedLoop) -> None:
    trial, turn = _trial(closed), closed.rounds[0]
    doubtful = replace(trial, transfer=_told((5.0, -4.0, 1.0), 0.3, 4.0))
    assert choose([trial], 0.01) is trial and choose([doubtful], 0.01) is None
    (said,) = [one.why for one in alternatives(None, [doubtful], turn.scored.scores, 0.01)]
    assert "does not transfer" in said


def test_a_coefficient_that_only_a_fold_shows_is_nothing_without_it(closed: ClosedLoop) -> None:
    trial = _trial(closed)
    assert trial.fit is not None
    (name,) = trial.candidate.effect.coefficients
    k = trial.fit.problem.names.index(name)
    terms = trial.fit.expansion.terms
    assert terms is not None
    cut = folds(trial.fit.problem.logs)
    size = cut[0].last + 1
    moving, scales = terms.innovations.copy(), terms.log_scales.copy()
    moving[2 * size :, 1 + k] = scales[2 * size :, 1 + k] = 0.0  # two channels of the first log
    expansion = replace(trial.fit.expansion, terms=Terms(moving, scales))
    points = left_out(replace(trial.fit, expansion=expansion), cut, [name]).points
    assert points[k, 0] == 0.0 and points[k, 1] == pytest.approx(trial.fit.point[k], rel=0.3)


def test_the_only_fold_with_large_speeds_is_no_test_of_a_drag() -> None:
    """A pull that is ten times as hard as all others tells most of the drag, and cannot be predicted without it.

    Of a choke whose largest current came once the right law was refused: six folds gained 118 nats, one lost 101.
    """
    true = added(effects.quadratic_loss, "runner", DRAG)
    log = pull(true, 44)
    torque = np.where((log.time >= 14.0) & (log.time < 18.0), 60.0, 0.1 * log.u[0])
    run = simulate(build(true).model, log.time, torque[np.newaxis], rtol=1e-8).raise_if_failed()
    std = np.array([NOISE[name] for name in run.model.names("output")])
    y = run.y + std[:, np.newaxis] * np.random.default_rng(5).standard_normal(run.y.shape)
    driven = replace(log, u=torque[np.newaxis], y=y)
    base = fitted([driven])
    turn = one_round(sled_built(), base, [driven], (effects.quadratic_loss,))
    trial = next(one for one in turn.trials if one.candidate.label == "quadratic_loss at runner")
    assert trial.fit is not None
    told = transfer(base, trial.fit, trial.candidate.effect)
    cut = folds([driven])
    assert told.untested == (cut[2].name,) and len(told.folds) == len(told.gains) == len(cut) - 1
    assert cut[2].first <= 140 <= cut[2].last
    evenly = transfer(fitted(logs(1)), _fitted_with_drag(), trial.candidate.effect)
    assert evenly.untested == ()


def _fitted_with_drag() -> Fit:
    base = fitted(logs(1))
    turn = one_round(sled_built(), base, logs(1), (effects.quadratic_loss,))
    found = next(one.fit for one in turn.trials if one.candidate.label == "quadratic_loss at runner")
    assert found is not None
    return found


def test_errors_in_sentences_have_the_declared_unit() -> None:
    """A sentence said 1.91 -> 3.47 of a speed that the table beside it showed in rpm."""
    bare = Compared("held-out", "free simulation", "speed", 2.0, 4.0, 1e-9, True)
    assert str(bare) == "free simulation of speed on held-out logs 2 -> 4 (+100%)"
    told = replace(bare, info=OutputInfo("speed", "rad/s", "", "rpm"))
    assert str(told) == "free simulation of speed on held-out logs 19.1 -> 38.2 rpm (+100%)"
    flat = np.full(4, 4.0)
    errors = Errors("held-out", "prediction", "speed", flat, flat, np.ones(4), 0.1, told.info)
    assert judged(errors, False, 1).info is told.info
