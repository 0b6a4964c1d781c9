"""Scores with the process noise held low, and the second look that a candidate must stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.evidence import confirm
from bondgraph.correct.evidence.confirm import confirmed
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.fits.integrals import integrating
from bondgraph.correct.fits.whiteness import whiteness
from bondgraph.correct.loop import LoopSettings, close_loop
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.scores.quiet import annealed_fit, quiet_fit, quiet_scores
from bondgraph.correct.scores.scoring import linearisation, score_candidates
from bondgraph.correct.search.refit import refit_from
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import handle, with_values
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.local import fit
from bondgraph.estimate.noise_starts import noisy_starts
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.simulate.simulation import simulate
from tests.correct.carriage import rides
from tests.correct.sled import FUNCTIONS, added, built, fitted, pull, sled
from vehicle_graphs import emps
from vehicle_graphs.effect_study.cases import Case
from vehicle_graphs.effect_study.generate import draw
from vehicle_graphs.effect_study.machines import BENCH

DRAG = 0.6


@pytest.fixture(scope="module")
def log() -> MatchedLog:
    return pull(added(effects.quadratic_loss, "runner", DRAG), 5)


@pytest.fixture(scope="module")
def base(log: MatchedLog) -> Fit:
    return fitted([log])


def offered(base: Fit, log: MatchedLog):  # type: ignore[no-untyped-def]
    where = places(built(), [log], base.runs([log]), base.theta)
    return candidates(built(), [effects.quadratic_loss], [one for one in where if one.label == "runner"])[0]


def test_quiet_scores_find_the_size_that_process_noise_hides(base: Fit, log: MatchedLog) -> None:
    found = offered(base, log)
    quiet = quiet_scores(base, [log], found)
    assert quiet is not None
    loud = score_candidates(linearisation(base, [log]), found).scores
    assert quiet.scored.scores.gain[0] > 2.0 * loud.gain[0]
    assert quiet.scored.scores.step[0] == pytest.approx(DRAG, rel=0.15)


def test_no_process_noise_leaves_nothing_to_be_held_low(base: Fit, log: MatchedLog) -> None:
    free = [one for one in at_optimum(base) if one.target.kind != "process"]
    assert quiet_fit(fit(EstimationProblem(base.problem.filter_model, (log,), tuple(free))), [log]) is None


def test_what_the_data_need_stands_the_second_look(base: Fit, log: MatchedLog) -> None:
    context = Context(built(), base, (log,), 10, 0.01, 5.0)
    trial = refit_from(Trial(offered(base, log)[0], 0.0), [DRAG], context)
    sure = confirmed(trial, context)
    assert sure.evidence is not None and sure.evidence.accepted(0.01)


def test_under_coloured_noise_a_free_simulation_must_gain_over_the_quiet_fit_without_the_effect(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log = pull(added(effects.quadratic_loss, "runner", DRAG), 5, colour=0.9)
    base = fitted([log])
    without = quiet_fit(base, [log])
    assert without is not None
    context = Context(built(), base, (log,), 10, 0.01, 5.0, quiet=without)
    trial = refit_from(Trial(offered(base, log)[0], 0.0), [DRAG], context)
    sure = confirmed(trial, context)
    assert sure.evidence is not None and sure.evidence.accepted(0.01)
    assert trial.fit is not None
    alone = quiet_fit(trial.fit, [log])
    assert alone is not None
    monkeypatch.setattr(confirm, "is_clear", lambda *given: False)  # as if its white channels said too little
    as_good = replace(context, quiet=replace(without, nll=alone.nll))
    doubted = confirmed(trial, as_good)
    assert doubted.evidence is not None and doubted.evidence.p_robust == 1.0


@pytest.mark.slow
def test_a_sensor_far_better_than_any_free_simulation_does_not_spoil_the_second_look() -> None:
    """An encoder of nanometres: its noise may grow to the error of the model, by the range of its channel.

    Bounded within a factor of the nanometres, the quiet fit was wrong by many times wherever it ended.
    """
    time = 0.01 * np.arange(1200)
    voltage = 3.0 * np.sin(2.0 * np.pi * time / 6.0)[np.newaxis]
    true = build(emps.declared(("coulomb_loss",))).model
    run = simulate(true, time, voltage, {"mass": 95.0, "c_coulomb_loss_carriage": 20.0}, method="rk4", substeps=50)
    noise = 1e-8 * np.random.default_rng(1).standard_normal(run.y.shape)
    own = build(emps.start())
    log = MatchedLog("record", time, voltage, run.y + noise)
    setup = filter_setup(own.model, own.driven, [log])
    free = (*free_parameters(setup, ()), *setup.noise)
    base = fit(EstimationProblem(setup.filter_model, (log,), tuple(free)), starts=noisy_starts(free))
    for found in (quiet_fit(base, [log], walking=()), annealed_fit(base, [log], walking=())):
        assert found is not None
        row = found.problem.names.index("std(position)")
        assert not found.held[row] and found.values["std(position)"] > 1e-3
    for found in (quiet_fit(base, [log]), annealed_fit(base, [log])):  # the position walks, its sensor stays good
        assert found is not None and "process(x_carriage)" in found.problem.names
        (seen,) = whiteness(found, [log])
        assert seen.nis_mean == pytest.approx(1.0, rel=0.3)


@pytest.mark.parametrize("seed", range(4))
def test_a_colour_that_poses_as_motion_names_nothing(seed: int) -> None:
    logs = [pull(sled(), seed, colour=0.9)]
    closed = close_loop(sled(), logs, [], FUNCTIONS, LoopSettings(faults=False))
    assert not closed.added  # a disturbance may say how long-lived it is


@pytest.mark.slow  # half a minute of CPU each: whole loops on the bench
@pytest.mark.parametrize("seed", [23, 28], ids=["in half of the run", "beside a parameter that it drives to its bound"])
def test_a_colour_that_poses_as_creep_names_nothing(seed: int) -> None:
    drawn = draw(BENCH, Case("none", "coloured noise", 0.0, seed))
    closed = close_loop(BENCH.graph(), drawn.train, [], [effects.creep], LoopSettings(faults=False))
    assert any(trial.evidence is not None for trial in closed.rounds[0].trials)
    assert not closed.added  # a disturbance may say how long-lived it is


@pytest.mark.slow
def test_a_law_is_not_doubted_for_what_a_position_remembers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction that differs by direction moves a carriage away for ever: dry friction had p = 1, by its position."""
    log, own = rides(), build(emps.start())
    setup = filter_setup(own.model, own.driven, [log])
    free = (*free_parameters(setup, ()), *setup.noise)
    base = fit(EstimationProblem(setup.filter_model, (log,), tuple(free)), starts=noisy_starts(free))
    assert integrating(base) == ("x_carriage",)
    where = places(own, [log], base.runs([log]), base.theta_of(own.model))
    found, _ = candidates(own, [effects.coulomb_loss], [one for one in where if one.label == "carriage"])
    context = Context(own, base, (log,), 10, 0.01, 5.0)
    trial = refit_from(Trial(found[0], 0.0), [20.0], context)
    sure = confirmed(trial, context)
    assert sure.evidence is not None and sure.evidence.accepted(0.01)
    monkeypatch.setattr(confirm, "integrating", lambda fitted: ())
    doubted = confirmed(trial, context)
    assert doubted.evidence is not None and doubted.evidence.p_robust > 0.01


def test_a_state_that_only_an_effect_shows_may_walk() -> None:
    """A way that a second load drags on: at the declared coefficient of zero no sensor shows it, and a fit ended so."""
    g = sled()
    runner = handle(g, "runner")
    coefficient = g.parameter("c_way", 0.0, "N/m", "force per way", (-1.0, 1.0))
    way = g.integral("way", runner.flow, "m", "way of the sled")
    g.effort_source("pull_of_the_way", -coefficient * way, at=runner)
    log = pull(with_values(g, {"c_way": 0.05}), 5)
    own = build(g)
    setup = filter_setup(own.model, own.driven, [log])
    free = (*free_parameters(setup, ("c_way",)), *setup.noise)
    base = fit(EstimationProblem(setup.filter_model, (log,), tuple(free)), starts=noisy_starts(free))
    found = quiet_fit(base, [log], walking=("way",))
    assert found is not None and "process(way)" in found.problem.names
    assert found.values["c_way"] == pytest.approx(0.05, rel=0.1)
