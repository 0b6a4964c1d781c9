"""What wanders at random with a memory of its own is described as such: no law, and no rest without a word."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.fits.assess import Assessment
from bondgraph.correct.loop import ClosedLoop, LoopSettings, close_loop
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.progress import Progress
from bondgraph.correct.result import result_json
from bondgraph.correct.round import RoundSettings
from bondgraph.correct.search.disturbances import described, disturbances
from bondgraph.correct.search.refit import refit_from
from bondgraph.correct.wandering import explained_at_random, with_disturbance
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.effect import EffectFunction
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.local import fit
from bondgraph.estimate.objective import Terms
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.report.closed_loop import explanation
from bondgraph.report.standing import held_out

#: Mass, drag, standard deviation and correlation time of the wind of the cart below, and the noise of its sensor.
MASS, DRAG, GUST, LASTS, NOISE = 20.0, 8.0, 6.0, 3.0, 0.01
STEP = 0.05


def cart(unit: str = "m/s") -> BondGraph:
    """A cart that is pushed, its speed measured in a unit; nobody measures the wind."""
    g = BondGraph("cart")
    push = g.input("push", "N")
    body = g.one_junction("body", TRANSLATION)
    g.effort_source("hand", push, at=body)
    g.inertance("mass", g.parameter("m", MASS, "kg", "", (10.0, 40.0)), at=body, state="v")
    c = g.parameter("c", DRAG, "N s/m", "", (1.0, 30.0))
    g.resistance("drag", lambda v: c * v, at=body)
    g.measure_flow("speed", body, unit=unit)
    return g


def driven(seed: int, gust: float, samples: int = 1200) -> MatchedLog:
    """A log of the cart, its speed and the wind integrated exactly over a tenth of a sample each time.

    The wind is an Ornstein-Uhlenbeck process, of the standard deviation ``gust``.
    """
    rng, step = np.random.default_rng(seed), 0.1 * STEP
    a = np.array([[-DRAG / MASS, 1.0 / MASS, 1.0 / MASS], [0.0, -1.0 / LASTS, 0.0], [0.0, 0.0, 0.0]])
    noise = np.diag([0.0, 2.0 * gust**2 / LASTS, 0.0])
    loan = expm(step * np.block([[-a, noise], [np.zeros((3, 3)), a.T]]))  # Van Loan (1978), IEEE Trans. AC 23(3)
    move = loan[3:, 3:].T
    root = np.linalg.cholesky((move @ loan[:3, 3:])[:2, :2] + 1e-18 * np.eye(2)) if gust else np.zeros((2, 2))
    tones = [(rng.uniform(0.05, 0.6), rng.uniform(0.0, 6.0), rng.uniform(5.0, 20.0)) for _ in range(6)]

    def push(t: FloatArray) -> FloatArray:
        return sum((size * np.sin(rate * t + phase) for rate, phase, size in tones), np.zeros_like(t))

    x, speed = np.array([0.0, gust * rng.standard_normal(), 0.0]), np.empty(samples)
    pushed = push(step * (np.arange(10 * samples) + 0.5))
    for k in range(10 * samples):
        if k % 10 == 0:
            speed[k // 10] = x[0]
        x[2] = pushed[k]
        x = move @ x
        x[:2] += root @ rng.standard_normal(2)
    time = STEP * np.arange(samples)
    shown = speed + NOISE * rng.standard_normal(samples)
    return MatchedLog(f"run{seed}", time, push(time)[np.newaxis], shown[np.newaxis])


@functools.cache
def closed(gust: float) -> ClosedLoop:
    functions = (effects.quadratic_loss, effects.coulomb_loss, effects.constant_effort)
    return close_loop(cart(), [driven(1, gust), driven(2, gust)], [driven(3, gust)], functions, LoopSettings())


@pytest.mark.slow
def test_a_wind_that_lasts_is_described_with_its_size_and_its_correlation_time() -> None:
    found = closed(GUST)
    assert found.verdict == "disturbance"
    assert not found.added  # it is no law
    (told,) = found.disturbances
    assert told.trial.candidate.place.label == "body"
    assert told.size == pytest.approx(GUST, rel=0.3) and told.unit == "N"
    assert told.seconds == pytest.approx(LASTS, rel=0.5)
    said = explanation(found)
    assert "something that nothing measures wanders, as if at random" in said and "correlation time" in said
    assert "slow drift" not in said and "No law was found" in said
    problem, point = found.corrected.problem, found.corrected.point.copy()
    row = problem.names.index(told.trial.candidate.effect.shapes[0])
    point[row] = problem.upper[row]
    longest = described(told.trial, replace(found.corrected, point=point))
    assert "as long as the logs: it may be a slow drift" in str(longest)
    assert result_json(found)["disturbances"][0]["place"] == "body"
    assert any("disturbance" in one.name for one in found.corrected_graph.integrals)
    assert found.corrected.values["m"] == pytest.approx(MASS, rel=0.1)
    assert all(test.p_value > 0.01 for test in found.whiteness)


@pytest.mark.slow
def test_free_simulation_that_gets_worse_beside_a_confirmation_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report said "confirm" above a table in which free simulation grew by 28 %."""
    found = closed(GUST)
    told = found.confirmation
    assert told is not None
    sure = replace(told, gain=10.0, error=1.0, compared=())
    (log,) = found.nominal_holdout.logs
    errors = {name: replace(one, simulation_rmse=1.5 * one.simulation_rmse) for name, one in log.channels.items()}
    worse = replace(found, corrected_holdout=Assessment((replace(log, channels=errors),)))
    (name,) = errors
    assert f"Free simulation is worse there in {name} (+50 %): it does not follow" in held_out(worse, sure)
    assert held_out(worse, sure).startswith("The held-out logs confirm the disturbance one step ahead, but not in free")
    assert f"Free simulation of the held-out logs is worse with the disturbance: {name} (+50 %)." in explanation(worse)
    trained, *_ = found.nominal_train.logs
    grown = {name: replace(one, simulation_rmse=3.0 * one.simulation_rmse) for name, one in trained.channels.items()}
    before = Assessment((trained,))
    after = Assessment((replace(trained, channels=grown),))
    said = explanation(replace(found, nominal_train=before, corrected_train=after))
    assert f"Free simulation of the training logs is worse with the disturbance: {name} (+200 %)." in said
    same = replace(found, corrected_holdout=found.nominal_holdout, corrected_train=found.nominal_train)
    assert "Free simulation" not in explanation(same)
    assert "Free simulation is worse" not in held_out(same, sure) and "may hide a law" in held_out(same, sure)
    doubted = held_out(worse, replace(sure, gain=-10.0))
    assert doubted.startswith("The logs contradict") and "one-step errors tell more" not in doubted
    monkeypatch.setitem(worse.corrected.__dict__, "driven", 0.0)
    assert f"worse there in {name} (+50 %): it predicts the next sample better" in held_out(worse, sure)


def test_what_cannot_explain_enough_is_not_searched_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a vehicle a disturbance 700 nats behind a law took a quarter of the loop."""
    base, logs = closed(GUST).nominal, closed(GUST).nominal.problem.logs
    asked: list[int] = []
    terms = EstimationProblem.terms

    def counting(self: EstimationProblem, points: FloatArray) -> Terms:
        asked.append(points.shape[1])
        return terms(self, points)

    monkeypatch.setattr(EstimationProblem, "terms", counting)
    free = disturbances(closed(GUST).nominal_built, base, logs, 0.01)
    assert free is not None and free.gain > 100.0
    whole, gain = sum(asked), free.gain
    asked.clear()
    needed = disturbances(closed(GUST).nominal_built, base, logs, 0.01, worth=0.5 * gain)
    assert needed is not None and needed.gain == pytest.approx(gain, abs=0.5)
    asked.clear()
    assert disturbances(closed(GUST).nominal_built, base, logs, 0.01, worth=gain + 1000.0) is None
    assert sum(asked) < 0.7 * whole


def dragged(seed: int, gust: float, quadratic: float, samples: int = 1200) -> MatchedLog:
    """The cart with a drag that nobody declared beside its own, by Runge-Kutta steps of a tenth of a sample."""
    rng, step = np.random.default_rng(seed), 0.1 * STEP
    tones = [(rng.uniform(0.05, 0.6), rng.uniform(0.0, 6.0), rng.uniform(5.0, 20.0)) for _ in range(6)]
    time = step * np.arange(10 * samples)
    pushed = sum(size * np.sin(rate * (time + 0.5 * step) + phase) for rate, phase, size in tones)
    kept, wind, speed = float(np.exp(-step / LASTS)), gust * rng.standard_normal(), 0.0
    speeds = np.empty(time.size)
    for k in range(time.size):
        speeds[k], force = speed, pushed[k] + wind

        def slope(v: float, force: float = force) -> float:
            return float((force - DRAG * v - quadratic * v * abs(v)) / MASS)

        first = slope(speed)
        second = slope(speed + 0.5 * step * first)
        third = slope(speed + 0.5 * step * second)
        speed += step * (first + 2.0 * second + 2.0 * third + slope(speed + step * third)) / 6.0
        wind = kept * wind + gust * np.sqrt(1.0 - kept**2) * rng.standard_normal()
    shown = speeds[::10] + NOISE * rng.standard_normal(samples)
    push = sum(size * np.sin(rate * time[::10] + phase) for rate, phase, size in tones)
    return MatchedLog(f"run{seed}", time[::10], push[np.newaxis], shown[np.newaxis])


@pytest.mark.slow
def test_a_law_must_explain_more_than_a_disturbance_would() -> None:
    """A wind was named a constant load and a saturation of the flow, with certainty, and the drag not found."""
    functions = (effects.quadratic_loss, effects.coulomb_loss, effects.constant_effort)
    found = close_loop(cart(), [dragged(11, GUST, 3.0), dragged(12, GUST, 3.0)], [], functions, LoopSettings())
    (law,), (wind,) = found.added, found.disturbances
    assert law.trial.candidate.label == "quadratic_loss at body"
    assert found.corrected.values[law.coefficients[0]] == pytest.approx(3.0, rel=0.2)
    assert wind.size == pytest.approx(GUST, rel=0.3) and wind.seconds == pytest.approx(LASTS, rel=0.5)


@pytest.mark.slow
def test_what_shows_as_a_function_of_time_alone_is_a_disturbance() -> None:
    """A wind was "an unknown effort as a function of time"."""
    functions = (effects.quadratic_loss, effects.coulomb_loss, effects.constant_effort)
    found = close_loop(cart(), [dragged(11, GUST, 0.0), dragged(12, GUST, 0.0)], [], functions, LoopSettings())
    assert found.verdict == "disturbance" and not found.added and not found.unexplained


@pytest.mark.slow
def test_a_law_without_a_wind_has_no_disturbance_beside_it() -> None:
    functions = (effects.quadratic_loss, effects.coulomb_loss, effects.constant_effort)
    found = close_loop(cart(), [dragged(11, 0.0, 3.0), dragged(12, 0.0, 3.0)], [], functions, LoopSettings())
    assert [one.trial.candidate.label for one in found.added] == ["quadratic_loss at body"] and not found.disturbances


@pytest.mark.slow
@pytest.mark.parametrize("law", [effects.sprung_mass, effects.viscoelastic_drag, effects.hysteresis_loss])
def test_a_wind_is_no_law_with_a_memory(law: EffectFunction) -> None:
    """A load that wanders was a mass on a spring of ten times its platen: white noise drives both through a memory."""
    found = close_loop(cart(), [driven(1, GUST), driven(2, GUST)], [], (law,), LoopSettings())
    assert found.verdict == "disturbance" and not found.added


@pytest.mark.slow
def test_a_law_with_a_memory_must_explain_something_beside_the_wind() -> None:
    """A mass on a spring whose gain came first stayed, although it had nothing to say beside the wind."""
    logs, own = (driven(1, GUST), driven(2, GUST)), build(cart())
    setup = filter_setup(own.model, own.driven, logs)
    base = fit(EstimationProblem(setup.filter_model, logs, (*free_parameters(setup, ()), *setup.noise)))
    where = [one for one in places(own, logs, base.runs(logs), base.theta) if one.label == "body"]
    (made,), _ = candidates(own, [effects.sprung_mass], where)
    chosen = refit_from(Trial(made, 0.0), [19.0, 0.06, 1.0], Context(own, base, logs, 10, 0.01, 5.0))
    assert chosen.evidence is not None
    state = Progress(cart(), own, base, logs)
    wind = with_disturbance(state, RoundSettings()).added[0]
    assert wind.evidence is not None
    ahead = replace(chosen, evidence=replace(chosen.evidence, bic_gain=wind.evidence.bic_gain + 10.0))
    (taken,) = explained_at_random(state, ahead, RoundSettings()).added
    assert taken.candidate.label == "disturbance at body"
    far = replace(ahead, evidence=replace(chosen.evidence, bic_gain=3.0 * wind.evidence.bic_gain))
    assert explained_at_random(state, far, RoundSettings()) is state  # the wind explains less than half of it


def test_without_a_wind_there_is_none() -> None:
    assert closed(0.0).verdict == "no missing effect"
    assert not closed(0.0).added and not closed(0.0).disturbances


def test_noise_of_a_sensor_with_a_memory_is_no_wind() -> None:
    """An amplifier that hums: nothing moves the cart."""
    rng = np.random.default_rng(5)
    logs = []
    for seed in (1, 2):
        log = driven(seed, 0.0)
        hum = np.empty(log.time.size)
        hum[0] = 0.0
        kept = float(np.exp(-STEP / 0.2))
        for k in range(1, hum.size):
            hum[k] = kept * hum[k - 1] + 0.05 * np.sqrt(1.0 - kept**2) * rng.standard_normal()
        logs.append(replace(log, y=log.y + hum))
    found = close_loop(cart("km/h"), logs, [], (effects.quadratic_loss, effects.coulomb_loss), LoopSettings())
    assert found.verdict == "disturbance"
    (told,) = found.disturbances
    assert told.trial.candidate.place.label == "sensor speed"
    assert told.size == pytest.approx(0.05 * 3.6, rel=0.2) and told.unit == "km/h"
    assert told.seconds == pytest.approx(0.2, rel=0.4)
