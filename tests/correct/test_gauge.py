"""Scales that no log shows, which all parameters of a machine share: one of these stays as declared."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.correct.declared_fit import DeclaredFit, fit_declared
from bondgraph.correct.loop import LoopSettings
from bondgraph.correct.result import intervals
from bondgraph.estimate.local import no_report

TIME = 0.05 * np.arange(400)
#: Of the shaft that was measured: its inertia is not the declared one.
INERTIA, COUPLING, BEARING, FRICTION = 0.026, 0.06, 0.008, 0.05


def shaft(inertia: float = 0.034, weight: float = 0.0) -> bg.BondGraph:
    """A shaft that a given speed takes along through a coupling: its speed is measured, no torque is."""
    g = bg.BondGraph("shaft")
    J = g.parameter("J", inertia, "kg m^2", "", (0.015, 0.07))
    c = g.parameter("c", 0.09, "N m s/rad", "", (0.01, 0.9))
    given, taken = g.zero_junction("given", bg.ROTATION), g.one_junction("taken", bg.ROTATION)
    slip = g.one_junction("slip", bg.ROTATION)
    g.flow_source("motor", g.input("speed", "rad/s"), at=given)
    g.bond(given, slip)
    g.resistance("coupling", lambda w: c * w, at=slip)
    g.bond(given, taken)
    g.inertance("inertia", J, at=taken, state="w")
    b = g.parameter("b", 0.01, "N m s/rad", "", (0.0005, 0.05))
    g.resistance("bearing", lambda w: b * w, at=taken)
    if weight:
        g.effort_source("weight", weight, at=taken)
    g.measure_flow("omega", taken)
    return g


@functools.cache
def log(seed: int, friction: float = FRICTION) -> bg.MatchedLog:
    """A run of the shaft with dry friction, by other code."""
    chance = np.random.default_rng(seed)
    levels = chance.uniform(-12.0, 12.0, 20)
    speed = np.convolve(np.repeat(levels, 20), np.ones(10) / 10, "same")

    def rate(t: float, w: np.ndarray) -> np.ndarray:
        loss = BEARING * w + friction * np.tanh(w / 0.05)
        return np.asarray((COUPLING * (np.interp(t, TIME, speed) - w) - loss) / INERTIA)

    run = solve_ivp(rate, (0.0, TIME[-1]), [0.0], t_eval=TIME, max_step=0.01, rtol=1e-8, atol=1e-10)
    return bg.MatchedLog(f"run{seed}", TIME, speed[np.newaxis], run.y + 0.05 * chance.standard_normal((1, TIME.size)))


@functools.cache
def fitted(inertia: float = 0.034, free: tuple[str, ...] = ()) -> DeclaredFit:
    """The fit of the declared shaft to a run without friction."""
    return fit_declared(shaft(inertia), [log(1, 0.0)], [], LoopSettings(free=free), no_report)


def test_the_narrowest_of_what_shares_a_scale_stays_as_declared() -> None:
    """Of a turntable the fit left the scale anywhere, with intervals of 600 parts of the values."""
    found = fitted()
    assert set(found.fit.values) == {"c", "b", "std(omega)", "process(w)"}
    (said,) = [one for one in found.cautions if "J is taken as declared" in one]
    assert "J, c and b act only together, as " in said and "0.034 kg m^2" in said
    for name, true in (("c", COUPLING / INERTIA), ("b", BEARING / INERTIA)):
        value, std = found.fit.values[name] / 0.034, found.fit.std[name]
        # coordinates of both are logarithms
        assert abs(np.log(value / true)) < 4.0 * std < 0.5


def test_the_declared_value_moves_the_scale_alone() -> None:
    """Another declared inertia gives the same likelihood and the same simulation, all values in proportion."""
    one, other = fitted(), fitted(0.051)
    assert other.fit.nll == pytest.approx(one.fit.nll, abs=0.05)
    for name in ("c", "b"):
        assert other.fit.values[name] / one.fit.values[name] == pytest.approx(1.5, rel=0.01)


def test_nothing_is_held_where_a_parameter_is_known() -> None:
    """With the inertia given, or the coupling, the logs tell the others."""
    for free in (("c", "b"), ("J", "b")):
        found = fitted(free=free)
        assert set(free) <= set(found.fit.values)
        assert not any("as declared" in one for one in found.cautions)


def test_a_scale_that_the_declared_value_does_not_fit_is_estimated() -> None:
    """A scale that a force shows is told by the logs, however far the declared value is off."""
    model, u = bg.build(shaft(weight=-0.3)).model, log(1, 0.0).u
    noise = 0.02 * np.random.default_rng(3).standard_normal((1, TIME.size))
    y = bg.simulate(model, TIME, u, model.theta(J=0.03)).y + noise
    found = fit_declared(shaft(0.065, -0.3), [bg.MatchedLog("run", TIME, u, y)], [], LoopSettings(), no_report)
    assert found.fit.values["J"] == pytest.approx(0.03, rel=0.1)


@pytest.mark.slow
def test_a_law_beside_a_common_scale_has_an_interval_without_zero() -> None:
    """The amplitude of a ripple worth 150 nats was told as 0.0045 N m within -0.23 and 0.24."""
    closed = bg.close_loop(shaft(), [log(1), log(2)], [log(3)])
    assert [one.trial.candidate.label for one in closed.added] == ["coulomb_loss at taken"]
    name = closed.added[0].trial.candidate.effect.coefficients[0]
    lower, upper = intervals(closed.corrected)[name]
    assert 0.0 < lower < FRICTION * 0.034 / INERTIA < upper
