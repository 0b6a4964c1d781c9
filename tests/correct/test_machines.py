"""Machines that a loop once refused: without states, without free parameters, in domains that no effect is for."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.loop import LoopSettings, close_loop
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import ELECTRICAL, THERMAL, TRANSLATION
from bondgraph.declare.effect import Effect, Place
from bondgraph.declare.graph import BondGraph
from bondgraph.report.closed_loop import explanation, report_data, summary
from bondgraph.report.html import Provenance
from bondgraph.simulate.simulation import simulate

MADE = Provenance("close-loop", None, {}, (), (), 0.0)


def levels(seed: int, count: int, low: float, high: float) -> np.ndarray:
    """An input that keeps a new level for twenty samples."""
    return np.repeat(np.random.default_rng(seed).uniform(low, high, count // 20), 20)


def oven() -> BondGraph:
    """A heated body that cools by conduction alone."""
    g = BondGraph("oven")
    heat, room = g.input("heat", "W"), g.input("room", "K", default=293.0)
    body = g.zero_junction("body", THERMAL)
    wall = g.one_junction("wall", THERMAL)
    g.flow_source("heater", heat, at=body)
    g.compliance("mass", 1 / g.parameter("capacity", 500.0, "J/K", "", (100.0, 2000.0)), at=body, initial=146500.0)
    g.bond(body, wall)
    g.resistance("conduction", g.parameter("R", 2.0, "K/W", "", (0.5, 10.0)), at=wall)
    g.effort_source("surroundings", -room, at=wall)
    g.measure_effort("temperature", body)
    return g


def test_a_heated_body_ends_with_the_law_of_what_is_missing() -> None:
    """Radiation was missing: "no effect can be tried at any of 13 places", and nothing of the log was looked at."""
    time = 5.0 * np.arange(600)
    u = np.stack([levels(3, 600, 0.0, 600.0), np.full(600, 293.0)])
    x = [293.0]
    for k in range(599):
        for _ in range(10):
            radiated = 2e-9 * (x[-1] ** 4 - 293.0**4)
            x[-1] += 0.5 * (u[0, k] - (x[-1] - 293.0) / 2.0 - radiated) / 500.0
        x.append(x[-1])
    noise = 0.3 * np.random.default_rng(5).standard_normal(600)
    log = MatchedLog("run", time, u, (np.array(x) + noise)[np.newaxis])
    closed = close_loop(oven(), [log], [], [effects.quadratic_loss, effects.coulomb_loss], LoopSettings())
    assert closed.verdict == "effect found"
    (law,) = closed.added
    assert law.trial.candidate.place.label == "body" and "power_of_effort_of_body" in law.trial.candidate.effect.name
    assert abs(closed.corrected.values["capacity"] - 500.0) < 10.0
    warm, capacity = 330.0, closed.corrected.values["capacity"]
    model = build(closed.corrected_graph).model
    lost = [-float(model.rhs(0.0, [capacity * at], [0.0, 293.0], model.theta())[0]) for at in (293.0, warm)]
    true = (warm - 293.0) / 2.0 + 2e-9 * (warm**4 - 293.0**4)
    assert lost[1] - lost[0] == pytest.approx(true, rel=0.05)  # by conduction and by radiation together
    said = " ".join(closed.cautions)
    assert "no effect could be tried at any of" in said and "thermal" in said
    assert "quadratic_loss, coulomb_loss found nothing to act on at body" in said


def divider() -> BondGraph:
    """Two resistors across a source: no storage, so no state."""
    g = BondGraph("divider")
    u = g.input("u", "V")
    loop = g.one_junction("loop", ELECTRICAL)
    g.effort_source("supply", u, at=loop)
    g.resistance("upper", g.parameter("R_upper", 10.0, "ohm", "", (5.0, 50.0)), at=loop)
    g.resistance("lower", g.parameter("R_lower", 5.0, "ohm"), at=loop)
    g.measure_flow("current", loop)
    return g


def diode_drop(g: BondGraph, at: Place) -> Effect | None:
    """A voltage that drops whatever the current."""
    if at.bond is not None or at.junction.kind != "1":
        return None
    name = f"drop_{at.name}"
    drop = g.parameter(f"u_{name}", 0.0, "V", "", (0.0, 10.0))
    g.resistance(name, lambda i: drop * i / (i**2 + 1e-4) ** 0.5, at=at.junction)
    return Effect("diode_drop", name, "effort = u*sign(flow)", (drop.name,))


@pytest.mark.slow
def test_a_machine_without_states_is_closed() -> None:
    """Refused with "the model has no states, so there is nothing to filter"."""
    u = levels(1, 400, -20.0, 20.0)
    current = np.sign(u) * np.maximum(np.abs(u) - 2.0, 0.0) / 17.0
    noise = 0.01 * np.random.default_rng(2).standard_normal(400)
    log = MatchedLog("run", 0.01 * np.arange(400), u[np.newaxis], (current + noise)[np.newaxis])
    closed = close_loop(divider(), [log], [], [diode_drop], LoopSettings(faults=False))
    assert [one.trial.candidate.label for one in closed.added] == ["diode_drop at loop"]
    values = closed.corrected.values
    assert values["u_drop_loop"] == pytest.approx(2.0, abs=0.1) and values["R_upper"] == pytest.approx(12.0, abs=0.3)
    assert build(closed.corrected_graph).model.states == () and "rests_at_zero" not in closed.corrected_text


def rigid() -> BondGraph:
    g = BondGraph("rigid")
    runner = g.one_junction("runner", TRANSLATION)
    g.effort_source("motor", g.input("force", "N"), at=runner)
    g.inertance("mass", g.parameter("m", 40.0, "kg"), at=runner, initial=1.0)
    g.resistance("guide", g.parameter("c", 12.0, "N s/m"), at=runner)
    g.measure_flow("speed", runner)
    return g


def test_a_machine_whose_parameters_are_all_known_is_closed() -> None:
    """Refused with "no parameter declares bounds, so nothing is free"."""
    graph = rigid()
    drag = graph.parameter("drag", 5.0, "N s^2/m^2")
    graph.resistance("air", lambda v: drag * v * abs(v), at="runner")
    time, u = 0.05 * np.arange(400), levels(4, 400, 0.0, 300.0)[np.newaxis]
    run = simulate(build(graph).model, time, u)
    noise = 0.02 * np.random.default_rng(6).standard_normal(run.y.shape)
    closed = close_loop(
        rigid(), [MatchedLog("run", time, u, run.y + noise)], [], [effects.quadratic_loss, effects.constant_effort]
    )
    assert [one.trial.candidate.label for one in closed.added] == ["quadratic_loss at runner"]
    assert closed.corrected.values["c_quadratic_loss_runner"] == pytest.approx(5.0, abs=0.2)


def refused_law(g: BondGraph, at: Place) -> Effect | None:
    """Adds a speed to a force, which no graph takes."""
    if at.bond is not None:
        return None
    c = g.parameter("c_refused", 0.0, "N s/m", "", (0.0, 1.0))
    g.resistance("refused", lambda v: c * v + v, at=at.junction)
    return Effect("refused_law", "refused", "", (c.name,))


def test_an_effect_that_graphs_refuse_is_mentioned_once_with_its_reason() -> None:
    """It stood in result.json alone."""
    time, u = 0.05 * np.arange(200), levels(4, 200, 0.0, 300.0)[np.newaxis]
    run = simulate(build(rigid()).model, time, u)
    noise = 0.02 * np.random.default_rng(6).standard_normal(run.y.shape)
    log = MatchedLog("run", time, u, run.y + noise)
    closed = close_loop(rigid(), [log], [], [effects.quadratic_loss, refused_law], LoopSettings(faults=False))
    told = summary(report_data(closed, {}, MADE))
    assert told.count("refused_law could be tried nowhere: at runner: ") == 1
    assert "quadratic_loss could be tried nowhere" not in told
    assert explanation(closed).startswith("None of the")
