"""Torques that repeat with an angle: of a spring, of an integral, or of a rotor whose angle nobody declared."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import Effect, Place, Scale
from bondgraph.effects import coulomb_loss, hardening_spring, quadratic_loss, ripple
from bondgraph.simulate.simulation import simulate

Angle = Literal["spring", "integral", "none"]


def axis(angle: Angle) -> bg.BondGraph:
    """A turning body at a motor, with the angle known in one way or not at all."""
    g = bg.BondGraph("axis")
    at = g.one_junction("axis", bg.ROTATION)
    g.effort_source("motor", g.input("torque", "N m", "torque"), at=at)
    g.inertance("body", g.parameter("J", 0.01, "kg m^2", "body", (0.003, 0.03)), at=at, state="omega")
    g.resistance("bearing", g.parameter("b", 0.004, "N m s/rad", "bearing", (0.0005, 0.04)), at=at)
    if angle == "spring":
        cable = g.compliance("cable", g.parameter("k", 0.4, "N m/rad", "cable", (0.1, 1.5)), at=at, state="twist")
        g.measure_displacement("pan", cable, "encoder")
    if angle == "integral":
        g.integral("turned", at.flow, "rad", "angle")
    g.measure_flow("rate", at, "gyroscope")
    return g


def offered(g: bg.BondGraph, flow: float = 2.0, step: float = 0.05) -> Effect | None:
    return ripple(g, Place(handle(g, "axis"), Scale(0.2, flow), times=(step, 20.0)))


@pytest.mark.parametrize(("angle", "state"), [("spring", "twist"), ("integral", "turned"), ("none", "")])
def test_the_torque_repeats_with_the_angle_that_there_is(angle: Angle, state: str) -> None:
    g = axis(angle)
    states = set(bg.build(g).model.names("state"))
    effect = offered(g)
    assert effect is not None
    sine, cosine = effect.coefficients
    model = bg.build(with_values(g, {sine: 0.03, cosine: 0.01, effect.shapes[0]: 7.0})).model
    added = set(model.names("state")) - states
    assert added == ({"angle_ripple_axis"} if angle == "none" else set())
    turned = np.array([0.0, 0.1, 0.1 + 2 * np.pi / 7, 1.3])
    x = np.zeros((len(model.states), turned.size))
    x[model.index("state", state or "angle_ripple_axis")] = turned
    rates = model.rhs(0.0, x, np.zeros((1, turned.size)), model.theta())[model.index("state", "omega")]
    spring = 0.4 * turned if angle == "spring" else 0.0
    assert 0.01 * rates + spring == pytest.approx(-0.03 * np.sin(7 * turned) - 0.01 * np.cos(7 * turned))


def test_periods_are_tried_that_samples_can_show() -> None:
    """Orders ended at twelve whatever the logs were; a motor that cogs fourteen times in a turn was not looked for."""
    effect = offered(axis("spring"))
    assert effect is not None
    # at half the speed, 1 rad/s, 62 periods in a turn show two samples a period
    assert effect.grids[0][1] == tuple(float(n) for n in range(1, 63))
    slow = offered(axis("spring"), flow=0.1)
    # those of direct drives, and the detents of stepping motors, four for each tooth of up to fifty
    assert slow is not None and slow.grids[0][1] == tuple(map(float, (*range(1, 85), *range(88, 201, 4))))
    fast = axis("none")
    states = [one.name for one in fast.integrals]
    assert offered(fast, flow=200.0) is None and [one.name for one in fast.integrals] == states


@pytest.mark.slow
def test_cogging_is_found_at_the_angle_of_a_spring() -> None:
    """Offered at declared integrals alone, it ended as "no missing effect" beside process noise of the speed."""
    chance = np.random.default_rng(4)
    time = 0.05 * np.arange(400.0)
    truth = axis("spring")
    effect = offered(truth)
    assert effect is not None
    sine, cosine = effect.coefficients
    model = bg.build(with_values(truth, {sine: 0.009, cosine: 0.006, effect.shapes[0]: 14.0})).model
    logs = []
    for name in ("first", "second"):
        torque = np.repeat(chance.normal(0.0, 0.05, 50), 8)[np.newaxis]
        noise = np.array([[0.009], [0.05]]) * chance.normal(size=(2, 400))
        logs.append(bg.MatchedLog(name, time, torque, simulate(model, time, torque).raise_if_failed().y + noise))
    closed = bg.close_loop(axis("spring"), logs, effects=[coulomb_loss, quadratic_loss, hardening_spring, ripple])
    assert [one.trial.candidate.label for one in closed.added] == ["ripple at axis"]
    assert closed.corrected.values["order_ripple_axis"] == pytest.approx(14.0, abs=0.2)
