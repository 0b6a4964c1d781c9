"""What neither scores nor an exchange know of: the best law elsewhere, simpler ones at its place, and a close end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from sympy import tanh

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.fits.fit import no_report
from bondgraph.correct.models.candidates import Candidate, candidates, places
from bondgraph.correct.refits import beneath
from bondgraph.correct.refits.beneath import also_elsewhere
from bondgraph.correct.refits.decide import choose, judge
from bondgraph.correct.refits.refit import Ground, refit_alone
from bondgraph.correct.refits.runoff import runoff
from bondgraph.correct.refits.simpler import also_simpler
from bondgraph.correct.refits.stiff_refits import refit_stiff
from bondgraph.correct.refits.trials import Trial
from bondgraph.correct.scores.quiet import quiet_fit
from bondgraph.correct.scores.scoring import linearisation, score_candidates
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import handle
from bondgraph.simulate.simulation import simulate
from tests.correct.test_stiff import rivals
from tests.correct.winch import NOISE, built, drawn, fitted, fitted_to, winch


def test_the_law_that_does_best_is_searched_at_other_places_though_an_exchange_says_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def silent(found: Trial, others: Sequence[Candidate], *given: object) -> list[None]:
        return [None] * len(others)

    monkeypatch.setattr("bondgraph.correct.refits.stiff_refits.exchanges", silent)
    log, base = drawn(0.3), fitted(0.3)
    where = places(built(), [log], base.runs([log]), base.theta)
    found, _ = candidates(built(), [effects.quadratic_loss, effects.viscous_loss], where)
    scored = score_candidates(linearisation(base, [log]), found)
    apart = 0.95 * scored.scores.correlation + 0.05 * np.eye(len(found))  # else motor and drum were taken for one
    scored = replace(scored, scores=replace(scored.scores, correlation=apart))
    trials = [
        Trial(one, float(gain), tuple(step))
        for one, gain, step in zip(found, scored.scores.gain, scored.scores.steps, strict=True)
    ]
    done = refit_stiff(trials, scored, Ground(built(), base, (log,), len(found), 0.01, 10.0), 1, no_report)
    gains = {one.candidate.label: one.gain for one in done if one.fit is not None}
    assert gains.keys() >= {"quadratic_loss at motor", "quadratic_loss at drum"}
    assert gains["quadratic_loss at drum"] > max(gains["quadratic_loss at motor"], 400.0)


def test_the_best_law_is_searched_where_it_shows_with_little_process_noise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log, base = drawn(0.3), fitted(0.3)
    where = places(built(), [log], base.runs([log]), base.theta)
    linear = linearisation(base, [log])
    found, _ = candidates(built(), [effects.quadratic_loss], where)
    loud = Ground(built(), base, (log,), len(found), 0.01, 10.0)
    ground = replace(loud, quiet=quiet_fit(base, [log]))
    motor, drum = (Trial(next(one for one in found if one.place.label == at), 0.0) for at in ("motor", "drum"))
    best = refit_alone(motor, [0.2], ground)
    done = also_elsewhere([best, drum], linear, ground, no_report)
    assert done[0] is best and done[1].gain > best.gain > 100.0
    told = replace(best, score_gain=best.gain)  # a score that tells all of the gain may mislead about the place
    assert also_elsewhere([told, drum], linear, ground, no_report)[1].gain == done[1].gain
    unasked = also_elsewhere([best, drum], linear, loud, no_report)  # nothing was looked for beneath the noise
    assert unasked[1].gain == done[1].gain
    assert also_elsewhere([best], linear, ground, no_report) == [best]  # it has no other place
    assert also_elsewhere([motor, drum], linear, ground, no_report) == [motor, drum]  # nothing was found
    monkeypatch.setattr(beneath, "_RIVALS", 100.0)
    assert also_elsewhere([best, drum], linear, ground, no_report) == [best, drum]  # it scores too little there


def test_of_two_that_end_close_to_each_other_each_is_searched_once_more() -> None:
    trials, _, ground = rivals()
    drag, cubic = (refit_alone(trial, trial.step, ground) for trial in trials)
    assert drag.fit is not None and cubic.fit is not None and drag.fit.nll < cubic.fit.nll - 10.0
    unlucky = replace(drag.fit, point=cubic.fit.point, nll=cubic.fit.nll + 5.0)
    short = replace(drag, fit=unlucky, evidence=judge(ground.base, unlucky, drag.candidate.effect, ground.tried))
    assert choose([short, cubic], 0.01) is cubic
    found = runoff([short, cubic], ground, 2)
    assert choose(found, 0.01) is found[0] and found[0].gain > drag.gain - 2.0
    far = replace(unlucky, nll=cubic.fit.nll + 50.0)  # no bad luck explains that
    behind = replace(short, fit=far, evidence=judge(ground.base, far, drag.candidate.effect, ground.tried))
    assert runoff([behind, cubic], ground, 2) == [behind, cubic]
    assert runoff([trials[0]], ground, 2) == [trials[0]]  # nothing was refitted


def sticky(level: float) -> MatchedLog:
    """The winch with dry friction of its drum."""
    calm = drawn(0.0)
    g = winch()
    g.resistance("stick", lambda w: level * tanh(w / 0.05), at=handle(g, "drum"))
    run = simulate(build(g).model, calm.time, calm.u, rtol=1e-8).raise_if_failed()
    return MatchedLog("run", calm.time, calm.u, run.y + NOISE * np.random.default_rng(2).standard_normal(run.y.shape))


@pytest.mark.parametrize(("soft", "start"), [("hysteresis_loss", [1.0]), ("stribeck_loss", [1.0, 0.5])])
def test_simpler_laws_are_searched_from_where_the_best_ended(soft: str, start: list[float]) -> None:
    log = sticky(1.5)
    base = fitted_to(log)
    assert base.problem.filter_model.is_stiff
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "drum"]
    laws = [effects.hysteresis_loss, effects.stribeck_loss, effects.coulomb_loss, effects.viscous_loss]
    by_name = {one.effect.name: one for one in candidates(built(), laws, where)[0]}
    ground = Ground(built(), base, (log,), 3, 0.01, 10.0)
    bent = refit_alone(Trial(by_name[soft], 0.0), start, ground)
    dry, viscous = Trial(by_name["coulomb_loss"], 0.0), Trial(by_name["viscous_loss"], 0.0)
    found = also_simpler([dry, viscous, bent], ground)
    assert found[1:] == [viscous, bent]  # a coefficient in another unit
    assert found[0].fit is not None and found[0].gain > bent.gain - 3.0
    assert found[0].fit.values["c_coulomb_loss_drum"] == pytest.approx(1.5, rel=0.2)
    assert also_simpler([dry, bent], replace(ground, need=1e9)) == [dry, bent]  # too little to begin with
    assert also_simpler([found[0], viscous], ground) == [found[0], viscous]  # none is simpler


@pytest.mark.parametrize(("gain", "worth"), [(700.0, 350.0), (80.0, 20.0)])
def test_a_simpler_law_that_the_linearised_filter_leaves_half_way_is_finished(
    gain: float, worth: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = sticky(1.5)
    base = fitted_to(log)
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "drum"]
    found, _ = candidates(built(), [effects.stribeck_loss, effects.coulomb_loss], where)
    by_name = {one.effect.name: Trial(one, 0.0) for one in found}
    bent, dry = by_name["stribeck_loss"], by_name["coulomb_loss"]
    ground = Ground(built(), base, (log,), 3, 0.01, 10.0)
    bent = refit_alone(bent, [1.0, 0.5], ground)
    assert bent.evidence is not None
    asked: list[float | None] = []

    def refitted(trial: Trial, *given: object, worth: float | None = None, **named: object) -> Trial:
        asked.append(worth)
        return trial

    monkeypatch.setattr("bondgraph.correct.refits.simpler.refit_alone", refitted)
    also_simpler([replace(bent, evidence=replace(bent.evidence, delta_nll=gain)), dry], ground)
    assert asked[0] == worth


def test_a_law_that_switches_is_searched_at_the_place_of_the_best_from_the_amplitudes_it_is_tried_at() -> None:
    log = sticky(1.5)
    base = fitted_to(log)
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label in ("drum", "motor")]
    found, _ = candidates(built(), [effects.quadratic_loss, effects.coulomb_loss], where)
    by_label = {one.label: one for one in found}
    ground = Ground(built(), base, (log,), 3, 0.01, 0.0)
    bent = refit_alone(Trial(by_label["quadratic_loss at drum"], 0.0), [0.1], ground)
    ground = replace(ground, need=0.5 * bent.gain)
    smooth = Trial(by_label["coulomb_loss at drum"], 0.0)
    assert also_simpler([smooth, bent], ground) == [smooth, bent]  # as many coefficients, in another unit
    switching = replace(smooth.candidate, effect=replace(smooth.candidate.effect, amplitudes=(0.01, 0.1, 0.3)))
    elsewhere = Trial(replace(switching, place=by_label["coulomb_loss at motor"].place), 0.0)
    done = also_simpler([Trial(switching, 0.0), elsewhere, bent], ground)
    assert done[1:] == [elsewhere, bent]
    assert done[0].fit is not None and done[0].gain > bent.gain + 10.0
    assert done[0].fit.values["c_coulomb_loss_drum"] == pytest.approx(1.5, rel=0.2)
    assert also_simpler(done, ground)[0] is done[0]  # it has been refitted
    assert done[0].evidence is not None and bent.evidence is not None
    stuck = replace(done[0], evidence=replace(done[0].evidence, delta_nll=140.0))
    ahead = replace(bent, evidence=replace(bent.evidence, delta_nll=700.0))
    assert also_simpler([stuck, ahead], ground)[0].gain == pytest.approx(done[0].gain)  # but ended far behind
