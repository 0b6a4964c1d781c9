"""Storages that are tried at several sizes: how many steps they get, and what those leave remark."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.evidence import confirm
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.reasons import alternatives
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.fits.assess import gain_interval, gain_p_value
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.round import one_round
from bondgraph.correct.scores.scoring import linearisation, score_candidates
from bondgraph.correct.search import storages
from bondgraph.correct.search.refit import refit
from bondgraph.correct.search.storages import trial_size
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.domains import ROTATION
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import Place, Scale
from bondgraph.declare.elements import Bond
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.local import fit
from bondgraph.estimate.noise_starts import noisy_starts
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import FilterSetup, filter_setup
from bondgraph.simulate.simulation import simulate
from tests.correct.winch import NOISE, winch
from vehicle_graphs.effect_study.cases import Case
from vehicle_graphs.effect_study.generate import draw
from vehicle_graphs.effect_study.machines import BENCH


def test_a_storage_gets_a_multiple_of_the_steps_at_most_and_says_what_they_do_not_resolve(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    logs = draw(BENCH, Case("none", "as declared", 0.0, 1)).train
    built = build(BENCH.graph())
    setup = filter_setup(built.model, built.driven, logs)
    free = (*free_parameters(setup, ()), *setup.noise)
    base = fit(EstimationProblem(setup.filter_model, tuple(logs), tuple(free)), starts=noisy_starts(free))
    where = [one for one in places(built, logs, base.runs(logs), base.theta) if one.label == "wheel -> tyre"]
    (candidate,), _ = candidates(built, [effects.added_compliance], where)
    context = Context(built, base, logs, 10, 0.01, 5.0)

    def endless(*given: Any, **named: Any) -> FilterSetup:
        own = filter_setup(*given, **named)
        return replace(own, filter_model=replace(own.filter_model, substeps=400))

    monkeypatch.setattr(storages, "filter_setup", endless)
    monkeypatch.setattr(storages, "_MOST_STEPS", 1)
    monkeypatch.setattr(storages, "SIZES", (0.01, 0.5))  # the first far stiffer than these steps resolve
    tried = trial_size(Trial(candidate, 0.0), context).trial
    steps = base.problem.filter_model.substeps
    assert f"was not tried, for which {steps} steps from sample to sample are too few" in tried.remark
    (said,) = alternatives(None, [tried], score_candidates(linearisation(base, logs), []).scores, 0.01)
    assert tried.remark in said.why


def hoist(loss: float = 0.0) -> BondGraph:
    """The stiff winch with a platform on its drum, the connection of both declared as rigid."""
    graph = winch(loss)
    platform = graph.one_junction("platform", ROTATION)
    graph.inertance("deck", graph.parameter("J_platform", 0.6, "kg m^2", "platform"), at=platform)
    graph.bond(handle(graph, "drum"), platform)
    return graph


def elastic(compliance: float, damping: float, loss: float) -> BondGraph:
    """The same with a spring in that connection, and a loss at the drum."""
    graph = hoist(loss)
    between = Place(handle(graph, "drum"), Scale(10.0, 20.0), Bond("drum", "platform"))
    effect = effects.added_compliance(graph, between)
    assert effect is not None
    return with_values(graph, {"c": 0.3, **dict(zip(effect.parameters, (compliance, damping), strict=True))})


def swinging(graph: BondGraph, samples: int = 500) -> MatchedLog:
    """A log of it: torque and slope in steps, the slope unknown."""
    rng = np.random.default_rng(1)
    time = 0.05 * np.arange(samples)
    torque = np.repeat(rng.uniform(0.0, 9.0, samples // 20 + 1), 20)[:samples]
    bend = np.repeat(rng.normal(0.0, 0.15, samples // 10 + 1), 10)[:samples]
    run = simulate(build(graph).model, time, np.array([torque, bend]), rtol=1e-8).raise_if_failed()
    y = run.y + NOISE * rng.standard_normal(run.y.shape)
    return MatchedLog("run", time, np.array([torque, np.zeros(samples)]), y)


def fitted(log: MatchedLog) -> Context:
    """The rigid machine fitted to a log."""
    built = build(hoist())
    setup = filter_setup(built.model, built.driven, [log])
    assert setup.filter_model.is_stiff
    free = (*free_parameters(setup, ()), *setup.noise)
    base = fit(EstimationProblem(setup.filter_model, (log,), tuple(free)), starts=noisy_starts(free))
    return Context(built, base, (log,), 10, 0.01, 10.0)


def test_a_gain_counts_by_its_scatter_along_the_log() -> None:
    (run,) = fitted(swinging(hoist())).base.own_runs
    throughout = replace(run, whitened=np.sqrt(0.95) * run.whitened)
    few = run.whitened.copy()
    few[:, :50] *= np.sqrt(1.0 - 0.05 * np.sum(run.whitened**2) / np.sum(few[:, :50] ** 2))  # as much, in a tenth
    at_once = replace(run, whitened=few)
    gains = [gain_interval([run], [one])[0] for one in (throughout, at_once)]
    assert gains[0] == pytest.approx(gains[1]) and gains[0] > 30.0
    assert gain_p_value([run], [throughout]) < 1e-9 < 0.01 < gain_p_value([run], [at_once])
    assert gain_p_value([run], [run]) == 1.0


@pytest.mark.slow
def test_a_storage_must_gain_all_along_the_log_where_innovations_stay_coloured(monkeypatch: pytest.MonkeyPatch) -> None:
    context = fitted(swinging(elastic(0.02, 0.1, loss=0.05)))
    assert one_round(context.built, context.base, context.train, [effects.added_compliance]).chosen is not None
    monkeypatch.setattr(confirm, "is_clear", lambda *given: False)  # as if its white channels said too little
    monkeypatch.setattr(confirm, "gain_p_value", lambda before, after: 0.2)
    assert one_round(context.built, context.base, context.train, [effects.added_compliance]).chosen is None


@pytest.mark.slow
def test_a_compliance_of_a_stiff_model_is_tried_though_a_loss_passes() -> None:
    context = fitted(swinging(elastic(0.02, 0.1, loss=0.05)))
    turn = one_round(context.built, context.base, context.train, [effects.quadratic_loss, effects.added_compliance])
    assert turn.chosen is not None and turn.chosen.candidate.label == "added_compliance at drum -> platform"
    assert turn.chosen.fit is not None
    (size,) = (turn.chosen.fit.values[name] for name in turn.chosen.candidate.effect.coefficients)
    assert size == pytest.approx(0.02, rel=0.03)
    others = [trial for trial in turn.trials if trial is not turn.chosen]
    assert max(trial.score_gain for trial in others) > 10.0  # which passes, alone
    assert all(trial.gain < turn.chosen.gain for trial in others)


def test_the_damping_of_a_compliance_is_estimated_and_a_rigid_machine_is_worth_no_refit() -> None:
    log, rigid = swinging(elastic(0.02, 0.1, loss=0.0)), fitted(swinging(hoist()))
    context = fitted(log)
    where = places(context.built, [log], context.base.runs([log]), context.base.theta)
    bond = [one for one in where if one.label == "drum -> platform"]
    (candidate,), _ = candidates(context.built, [effects.added_compliance], bond)
    seen = trial_size(Trial(candidate, 0.0), context)
    assert seen.start is not None
    tried = refit(seen.trial, [seen.start], context)
    assert tried.fit is not None
    truth = dict(zip(candidate.effect.parameters, (0.02, 0.1), strict=True))
    assert {name: tried.fit.values[name] for name in truth} == pytest.approx(truth, rel=0.1)
    assert 100.0 < seen.trial.score_gain < tried.gain
    assert trial_size(Trial(candidate, 0.0), rigid).trial.score_gain < 5.0


def fountain() -> bg.BondGraph:
    """A pump behind a drive, water in a pipe, a standpipe with a nozzle; the drive is said to follow at once."""
    g = bg.BondGraph("fountain")
    command = g.input("c", "1", hold=True)
    head = g.parameter("P", 9e4, "Pa", "", (4e4, 3e5))
    water = g.parameter("I", 1.2e7, "kg/m^4", "", (2e6, 1e8))
    strainer = g.parameter("R", 1.5e7, "Pa s/m^3", "", (2e6, 1e8))
    nozzle = g.parameter("Rn", 3e7, "Pa s/m^3", "", (5e6, 2e8))
    pipe, stand = g.one_junction("pipe", bg.HYDRAULIC), g.zero_junction("stand", bg.HYDRAULIC)
    g.effort_source("pump", head * command, at=pipe)
    g.inertance("column", water, at=pipe, state="Q")
    g.resistance("strainer", lambda flow: strainer * flow, at=pipe)
    g.bond(pipe, stand)
    g.compliance("standpipe", lambda volume: volume / g.parameter("C", 2e-8, "m^3/Pa"), at=stand, state="V")
    g.resistance("nozzle", flow=lambda effort: effort / nozzle, at=stand)
    g.measure_flow("flow", pipe, unit="L/s")
    g.measure_effort("head", stand, unit="mbar")
    return g


def song(seed: int) -> bg.Log:
    """The fountain by scipy: its drive turns up no faster than by 0.42 of its range a second."""
    chance, time = np.random.default_rng(seed), 0.1 * np.arange(900)
    steps = np.round(np.repeat(chance.uniform(0.0, 1.0, 30), 30), 2)

    def rate(t: float, x: FloatArray) -> FloatArray:
        wanted = steps[min(int(t / 0.1 + 1e-9), time.size - 1)]
        flow, level, given = x
        return np.array([
            (1.3e5 * given - 2.2e7 * flow - level) / 1.9e7, (flow - level / 4.2e7) / 2e-8,
            0.42 * np.tanh((wanted - given) / 0.02),
        ])  # fmt: skip

    x = solve_ivp(rate, (0.0, time[-1]), np.zeros(3), t_eval=time, rtol=1e-7, atol=1e-9, max_step=0.05).y
    table = {"time [s]": time, "c [1]": steps, "flow [L/s]": 1e3 * x[0] + chance.normal(0.0, 0.06, time.size)}
    table |= {"head [mbar]": 0.01 * x[1] + chance.normal(0.0, 15.0, time.size)}
    return bg.Log.from_dataframe(pd.DataFrame(table), name=f"song{seed}")


@pytest.mark.slow
def test_a_storage_is_refitted_where_another_one_at_its_place_leads() -> None:
    """The pipe ends on its bound where a command is late. A lag leads there, and a limit of the rate promises 3 nats.

    From the declared values it gains twice as much as the lag.
    """
    functions = (effects.actuator_lag, effects.actuator_rate_limit, effects.actuator_scale, effects.quadratic_loss)
    closed = bg.close_loop(fountain(), [song(1), song(2)], effects=functions)
    assert [one.trial.candidate.label for one in closed.added] == ["actuator_rate_limit at pipe"]
    time = closed.corrected.values[closed.added[0].coefficients[0]]
    model = closed.corrected.problem.filter_model.model
    (largest,) = (one.value for one in model.parameters if one.name.startswith("range_"))
    assert largest / time / closed.corrected.values["P"] == pytest.approx(0.42, rel=0.05)
