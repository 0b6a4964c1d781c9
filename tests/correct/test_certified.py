"""Fits of a loop looked at with halved integration steps: what is resolved is certified, what is not is said."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.evidence import certified
from bondgraph.correct.evidence.certified import certify, doubts, refined, resolving
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.resolved import resolved
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.loop import LoopSettings, close_loop
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.progress import Progress
from bondgraph.correct.progress import certified as in_certified_steps
from bondgraph.correct.round import RoundSettings
from bondgraph.correct.search.refit import refit_from
from bondgraph.declare.editing import with_values
from bondgraph.estimate.certify import NEGLIGIBLE_SHIFT, check
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.local import fit
from bondgraph.estimate.longer_steps import step_gain
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.searches import expand
from bondgraph.estimate.setup import filter_setup
from bondgraph.filter.discretisation import NEGLIGIBLE
from tests.correct import fan
from tests.correct.sled import fitted, pull, sled
from tests.correct.test_stiff import drawn, setup_of


def test_a_resolved_fit_is_certified() -> None:
    found = certify(fitted([pull(sled(), 2)]))
    assert found.shift <= NEGLIGIBLE_SHIFT
    assert doubts("declared", found) == []


def test_steps_that_are_too_long_are_told() -> None:
    log = drawn(0.0)
    setup = setup_of(log)
    fine = fit(EstimationProblem(setup.filter_model, (log,), (*free_parameters(setup, ()), *setup.noise)))
    coarse = replace(setup.filter_model, method="ros2", substeps=1, grading=1.0, noise_scheme="sampled")
    problem = replace(fine.problem, filter_model=coarse)
    expansion = expand(problem, fine.point, np.full(fine.point.size, 1e-5))
    found = certify(replace(fine, problem=problem, expansion=expansion))
    assert found.shift > 10.0 * NEGLIGIBLE_SHIFT
    (said,) = doubts("declared", found)
    assert said.startswith(
        f"the declared model is not certified: with every integration step halved, {found.parameter}"
    )


def test_the_time_in_which_noise_forgets_is_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer said that T_disturbance_sensor_drum_vacuum would move by 5.7 standard deviations."""
    log = drawn(0.0)
    setup = setup_of(log)
    problem = EstimationProblem(setup.filter_model, (log,), (*free_parameters(setup, ()), *setup.noise))
    fine = fit(problem)
    coarse = replace(fine.problem, filter_model=replace(setup.filter_model, method="ros2", substeps=1, grading=1.0))
    rough = replace(fine, problem=coarse, expansion=expand(coarse, fine.point, np.full(fine.point.size, 1e-5)))
    first = certify(rough)
    monkeypatch.setattr(certified, "is_memory", lambda name: name == first.parameter)
    second = certify(rough)
    assert second.parameter != first.parameter and second.shift < first.shift


def test_innovations_alone_are_believed_only_where_they_say_little(monkeypatch: pytest.MonkeyPatch) -> None:
    resolved = fitted([pull(sled(), 2)])
    by_innovations = certify(resolved)
    asked: list[int] = []

    def counting(*args: object, **settings: object) -> object:
        asked.append(1)
        return check(*args, **settings)  # type: ignore[arg-type]

    monkeypatch.setattr(certified, "check", counting)
    certify(resolved)
    assert not asked
    monkeypatch.setattr(certified, "_SURE", 0.0)
    by_derivatives = certify(resolved)
    assert asked
    assert by_derivatives.shift <= NEGLIGIBLE_SHIFT
    assert by_innovations.nats == pytest.approx(by_derivatives.nats, abs=1e-6)


def test_a_fit_goes_on_with_shorter_steps_where_its_steps_move_it() -> None:
    # samples 1.3 time constants apart: one step between two of them is stable, and off
    light = with_values(sled(), {"m_sled": 4.0, "c_guide": 52.0})
    log, own = pull(light, 2), build(light)
    setup = filter_setup(own.model, own.driven, [log])
    free = (*free_parameters(setup, ()), *setup.noise)
    coarse = fit(
        EstimationProblem(replace(setup.filter_model, substeps=1, noise_scheme="sampled"), (log,), tuple(free))
    )
    assert certify(coarse).shift > NEGLIGIBLE_SHIFT
    fine, found = refined(coarse)
    assert found.shift <= NEGLIGIBLE_SHIFT and fine.problem.filter_model.substeps > 1
    assert abs(fine.values["c_guide"] - 52.0) < 3.0 * fine.std["c_guide"] * fine.values["c_guide"]
    again, _ = refined(fine)
    assert again is fine


def test_steps_are_not_halved_for_what_nodes_of_process_noise_would_change() -> None:
    """Noise that enters at samples alone moves the guide's friction; no step between them does, however short."""
    light = with_values(sled(), {"m_sled": 4.0, "c_guide": 52.0})
    log, own = pull(light, 2), build(light)
    by_speed = replace(log, y=np.array([log.y[0], np.full(log.time.size, np.nan)]))
    setup = filter_setup(own.model, own.driven, [by_speed])
    used = replace(
        setup.filter_model, substeps=4, noise_nodes=0, noise_reach=0.0, process_noise={"v_sled": 1.0}
    )  # fmt: skip
    level = next(one for one in setup.noise if one.name == "std(speed)")
    given = fit(EstimationProblem(used, (by_speed,), (*free_parameters(setup, ()), level)))
    assert certify(given).shift > NEGLIGIBLE_SHIFT
    found, check_of_it = refined(given)
    resolved_steps = resolving(given).substeps  # effects could make up for the nodes, too
    assert found.problem.filter_model.substeps == resolved_steps < used.substeps << certified._MOST_HALVINGS
    assert check_of_it.shift > NEGLIGIBLE_SHIFT  # which is said all the same
    assert doubts("declared", check_of_it)


def test_a_stiff_fit_that_its_steps_do_not_disturb_is_left_alone() -> None:
    log = drawn(0.0)
    setup = setup_of(log)
    stiff = fit(EstimationProblem(setup.filter_model, (log,), (*free_parameters(setup, ()), *setup.noise)))
    again, found = refined(stiff)
    assert again is stiff and found == certify(stiff)
    assert not found.parameter.startswith(("std", "process"))


def test_a_stiff_fit_with_too_few_steps_is_refined_too() -> None:
    log = drawn(0.0)
    setup = setup_of(log)
    coarse = replace(setup.filter_model, method="ros2", substeps=1, grading=1.0, noise_scheme="sampled")
    rough = fit(EstimationProblem(coarse, (log,), (*free_parameters(setup, ()), *setup.noise)))
    fine, found = refined(rough)
    used = fine.problem.filter_model
    assert used.method == "ros2" and used.substeps == 4  # halved as often as stiff models are
    assert found.shift < certify(rough).shift


@functools.cache
def coarse_fan() -> Fit:
    """The exactly declared fan with the steps that stability alone asks for."""
    log = fan.drawn(2, samples=400, interval=0.01, scale=0.3)
    setup = filter_setup(fan.built().model, fan.built().driven, [log])
    # no node of the noise cuts these steps shorter
    sampled = replace(setup.filter_model, substeps=2, noise_scheme="sampled")
    return fit(EstimationProblem(sampled, (log,), (*free_parameters(setup, ()), *setup.noise)))


@pytest.mark.slow
def test_effects_could_make_up_for_steps_that_are_stable_but_no_more() -> None:
    rough = coarse_fan()
    assert rough.problem.filter_model.substeps == 2
    finer = replace(rough.problem, filter_model=rough.problem.filter_model.with_halved_steps())
    point = rough.point[:, np.newaxis]
    assert step_gain(rough.problem.terms(point), finer.terms(point)) > 100.0
    fine, _ = refined(rough)
    steps = fine.problem.filter_model
    again = replace(fine.problem, filter_model=steps.with_halved_steps()).terms(fine.point[:, np.newaxis])
    assert step_gain(fine.problem.terms(fine.point[:, np.newaxis]), again) < NEGLIGIBLE
    assert resolving(fine) is steps and refined(fine)[0] is fine


@pytest.mark.slow
def test_explicit_steps_that_a_law_made_short_are_not_halved_again() -> None:
    """The width of a law asks for steps of its own: they are none of another method, from which halvings begin anew."""
    rough = coarse_fan()
    finer = replace(rough.problem, filter_model=replace(rough.problem.filter_model, substeps=64))
    short = replace(rough, problem=finer, expansion=expand(finer, rough.point, np.full(rough.point.size, 1e-5)))
    assert resolving(short, 2) is finer.filter_model  # 32 are all that halving 2 leads to
    assert refined(short, least=2)[0] is short


@pytest.mark.slow
def test_a_candidate_that_gained_by_making_up_for_steps_loses_it() -> None:
    rough, own = coarse_fan(), fan.built()
    log = rough.problem.logs[0]
    where = [one for one in places(own, [log], rough.runs([log]), rough.theta) if one.label == "motor"]
    (loss,), _ = candidates(own, [effects.quadratic_loss], where)
    context = Context(own, rough, (log,), 24, 0.01, 10.0)
    found = refit_from(Trial(loss, 0.0), [1e-6], context)
    sure = resolved(found, context)
    assert found.gain > 5.0 and found.fit is not None and sure.fit is not None
    assert abs(sure.gain) < 3.0 and sure.evidence is not None and not sure.evidence.accepted(0.01)
    assert f"instead of {found.gain:.1f}" in sure.remark
    assert resolved(sure, replace(context, base=refined(rough)[0])) is sure


def test_a_decision_that_refinement_would_change_is_withdrawn() -> None:
    rough, own = coarse_fan(), fan.built()
    log = rough.problem.logs[0]
    where = [one for one in places(own, [log], rough.runs([log]), rough.theta) if one.label == "motor"]
    (loss,), _ = candidates(own, [effects.quadratic_loss], where)
    chosen = refit_from(Trial(loss, 0.0), [1e-6], Context(own, rough, (log,), 24, 0.01, 10.0))
    assert chosen.fit is not None and chosen.built is not None and chosen.gain > 5.0
    before = Progress(fan.fan(), chosen.built, chosen.fit, (log,), (chosen,))
    after = in_certified_steps(before, 1, RoundSettings())
    assert after.added == () and after.fit.problem.filter_model.substeps > 2
    (said,) = after.history
    assert said.action == "withdrawn" and said.what == "quadratic_loss at motor"
    assert said.why.startswith(f"with {after.fit.problem.filter_model.substeps} integration steps between samples it")
    assert after.check is not None and after.check.shift <= NEGLIGIBLE_SHIFT


@pytest.mark.slow
@pytest.mark.parametrize(("interval", "seed"), [(0.01, 2), (0.02, 1)])
def test_an_exactly_declared_machine_lacks_nothing_whatever_the_first_steps(interval: float, seed: int) -> None:
    # with the first steps: quadratic_loss at motor, 18.0 nats and p = 2.5e-07, of which refinement left none;
    # at 0.02 s "unexplained residual"
    log = fan.drawn(seed, interval=interval, scale=0.3)
    tried = [effects.actuator_scale, effects.viscous_loss, effects.constant_effort, effects.quadratic_loss]
    closed = close_loop(fan.fan(), [log], [], tried, LoopSettings(max_effects=1, faults=False))
    assert closed.verdict == "no missing effect"
    assert closed.rounds[0].base is closed.nominal and closed.nominal is closed.corrected
    assert closed.nominal_check.shift <= NEGLIGIBLE_SHIFT
