"""Gaps: a spring with play, and a coupling that loses contact."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph import effects
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale

_GAP, _NOISE = 0.02, 0.02


def drive() -> bg.BondGraph:
    """A motor that drives a wheel by a coupling with a spring and a damper."""
    g = bg.BondGraph("drive")
    torque = g.input("torque", "N m", hold=True)
    motor, load = (g.one_junction(name, bg.ROTATION) for name in ("motor", "load"))
    shaft, twist = g.zero_junction("shaft", bg.ROTATION), g.one_junction("twist", bg.ROTATION)
    g.effort_source("drive", torque, at=motor)
    g.inertance("rotor", g.parameter("Jm", 4.6e-3, "kg m^2", "", (2e-3, 8e-3)), at=motor, state="w_m")
    g.resistance("bearing", g.parameter("bm", 0.013, "N m s", "", (0.0, 0.1)), at=motor)
    g.bond(motor, shaft)
    g.bond(shaft, twist)
    g.bond(shaft, load)
    g.compliance("spring", g.parameter("k", 40.0, "N m/rad", "", (10.0, 120.0)), at=twist, state="angle")
    g.resistance("damper", g.parameter("c", 0.06, "N m s", "", (0.005, 0.5)), at=twist)
    g.inertance("wheel", g.parameter("Jl", 0.9e-2, "kg m^2", "", (5e-3, 2e-2)), at=load, state="w_l")
    g.measure_flow("omega_m", motor)
    g.measure_flow("omega_l", load)
    return g


def turned(seed: int, gap: float, count: int = 800, interval: float = 0.004) -> MatchedLog:
    """A run by scipy, with torque in the coupling as long as it is in contact only."""
    chance, time = np.random.default_rng(seed), interval * np.arange(count)
    torque = np.repeat(chance.uniform(-2.0, 2.0, count // 20), 20)

    def rate(t: float, x: np.ndarray, given: float) -> list[float]:
        closed = abs(x[2]) > gap
        carried = (50.0 * (x[2] - np.sign(x[2]) * gap) + 0.05 * (x[0] - x[1])) if closed else 0.0
        return [(given - 0.01 * x[0] - carried) / 4e-3, carried / 1e-2, x[0] - x[1]]

    states = [np.zeros(3)]
    for given in torque[:-1]:
        run = solve_ivp(rate, (0.0, interval), states[-1], args=(given,), rtol=1e-8, atol=1e-10, max_step=interval / 4)
        states.append(run.y[:, -1])
    y = np.array(states)[:, :2].T + _NOISE * chance.standard_normal((2, count))
    return MatchedLog(f"run{seed}", time, torque[np.newaxis], y)


def _given(effect: str, angle: float, speed: float, gap: float) -> float:
    """Torque on the wheel at a twist and a difference of speeds."""
    graph = drive()
    place = Place(handle(graph, "twist"), Scale(2.0, 10.0))
    found = getattr(effects, effect)(graph, place)
    assert found is not None
    model = bg.build(graph).model
    theta = model.theta(**{found.coefficients[0]: gap})
    rates = model.rhs(0.0, model.x0(w_m=speed, w_l=0.0, angle=angle), np.zeros(1), theta)
    return float(rates[model.index("state", "w_l")]) * model.parameters[model.index("parameter", "Jl")].value


def test_a_clearance_carries_nothing_inside_and_all_outside() -> None:
    for angle, speed in ((0.01, 3.0), (-0.01, 3.0), (0.0, -2.0)):
        assert _given("clearance", angle, speed, _GAP) == pytest.approx(0.0, abs=1e-12)
        assert _given("backlash", angle, speed, _GAP) == pytest.approx(0.06 * speed, rel=1e-9)
    for effect in ("clearance", "backlash"):
        assert _given(effect, 0.05, 3.0, _GAP) == pytest.approx(40.0 * 0.03 + 0.06 * 3.0, rel=1e-9)
        assert _given(effect, 0.01, 3.0, 0.0) == pytest.approx(40.0 * 0.01 + 0.06 * 3.0, rel=1e-9)  # as declared


def test_a_spring_without_a_damper_has_backlash_alone() -> None:
    g = bg.BondGraph("mass")
    body = g.one_junction("body", bg.TRANSLATION)
    g.inertance("mass", 1.0, at=body)
    g.compliance("spring", 100.0, at=body)
    place = Place(handle(g, "body"), Scale(1.0, 1.0))
    assert effects.clearance(g, place) is None and effects.backlash(g, place) is not None


@pytest.mark.slow
def test_a_coupling_that_loses_contact_is_told_with_its_gap() -> None:
    """A dead zone of the spring alone was 3900 nats behind, and a formula was named after a quarter of an hour."""
    closed = bg.close_loop(drive(), [turned(1, _GAP), turned(2, _GAP)], [turned(3, _GAP)])
    assert [one.trial.candidate.label for one in closed.added] == ["clearance at twist"]
    values = closed.corrected.values
    assert values["gap_clearance_twist"] == pytest.approx(_GAP, rel=0.02)
    assert values["k"] == pytest.approx(50.0, rel=0.03) and values["c"] == pytest.approx(0.05, rel=0.1)
