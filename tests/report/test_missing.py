"""Pictures of what is missing: each shows its own law, whatever else is missing beside it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from sympy import Abs

import bondgraph as bg
from bondgraph import effects
from bondgraph.arrays import FloatArray
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import Effect, Place, Scale
from bondgraph.report.missing import missing_efforts


def pair() -> bg.BondGraph:
    """Two carts on a spring, whose speeds are nearly one."""
    g = bg.BondGraph("pair")
    push = g.input("push", "N")
    front, rear = g.one_junction("front", bg.TRANSLATION), g.one_junction("rear", bg.TRANSLATION)
    link, stretch = g.zero_junction("link", bg.TRANSLATION), g.one_junction("stretch", bg.TRANSLATION)
    for source, target in ((front, link), (link, rear), (link, stretch)):
        g.bond(source, target)
    g.effort_source("engine", push, at=front)
    for cart, mass in ((front, 40.0), (rear, 60.0)):
        drag = g.parameter(f"drag_{cart.name}", 6.0, "N s/m", "", (1.0, 30.0))
        g.inertance(f"cart_{cart.name}", g.parameter(f"mass_{cart.name}", mass, "kg"), at=cart, state=f"v_{cart.name}")
        g.resistance(f"wheels_{cart.name}", lambda v, drag=drag: drag * v, at=cart)
        g.measure_flow(f"speed_{cart.name}", cart)
    g.compliance("spring", g.parameter("stiffness", 200.0, "N/m"), at=stretch, state="x")
    g.resistance("damper", g.parameter("damping", 20.0, "N s/m"), at=stretch)
    return g


def pushed(seed: int) -> bg.MatchedLog:
    """A log of the carts in a wind that brakes the front one a little and the rear one more."""
    g, winds = pair(), {}
    for place, size in (("front", 1.5), ("rear", 4.0)):
        effect = effects.quadratic_loss(g, Place(handle(g, place), Scale(100.0, 4.0)))
        assert isinstance(effect, Effect)
        winds[effect.coefficients[0]] = size
    chance, time = np.random.default_rng(seed), 0.1 * np.arange(400)
    force = np.repeat(chance.uniform(-150.0, 250.0, 20), 20)[np.newaxis]
    run = bg.simulate(bg.build(with_values(g, winds)).model, time, force)
    return bg.MatchedLog(f"run{seed}", time, run.u, run.y + 0.01 * chance.standard_normal(run.y.shape))


@pytest.mark.slow
def test_two_laws_at_two_places_are_drawn_each_for_itself() -> None:
    """Both pictures had the sum of both laws as their dots, 15 N off the law of the front cart, which takes 8 N."""
    settings = bg.LoopSettings(faults=False, max_effects=2)
    loop = bg.close_loop(pair(), [pushed(1), pushed(2)], [], [effects.quadratic_loss], settings)
    pictures = missing_efforts(loop)
    assert {one.title for one in pictures} == {"quadratic_loss at front", "quadratic_loss at rear"}
    for one in pictures:
        law = np.interp(one.x, one.law_x, one.law)
        size = float(np.sqrt(np.mean(law**2)))
        assert abs(np.mean(one.missing - law)) < 0.01 * size
        assert np.sqrt(np.mean((one.missing - law) ** 2)) < 0.15 * size


def swing(cubic: float = 0.0, power: float = 1.0) -> bg.BondGraph:
    """A mass on a spring with a damper, either of which may be bent."""
    g = bg.BondGraph("swing")
    body = g.one_junction("body", bg.TRANSLATION)
    k, d = g.parameter("k", 200.0, "N/m", "", (50.0, 800.0)), g.parameter("d", 6.0, "N s/m", "", (0.5, 60.0))
    g.effort_source("push", g.input("force", "N"), at=body)
    g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body, state="v")
    hard = g.parameter("hard", cubic, "N/m^3")
    g.compliance("spring", (lambda q: k * q + hard * q**3) if cubic else k, at=body, state="q")
    one = g.parameter("one", 1.0, "m/s")
    g.resistance("damper", (lambda v: d * v * (Abs(v) / one) ** (power - 1.0)) if power > 1.0 else d, at=body)
    g.measure_flow("speed", body)
    g.measure_displacement("way", "spring")
    return g


def swung(seed: int, **bent: float) -> bg.MatchedLog:
    """A run of the mass under steps of force."""
    chance, time = np.random.default_rng(seed), 0.02 * np.arange(600)
    force = np.repeat(chance.uniform(-60.0, 60.0, 20), 30)[np.newaxis]
    run = bg.simulate(bg.build(swing(**bent)).model, time, force)
    return bg.MatchedLog(f"run{seed}", time, run.u, run.y + 0.004 * chance.standard_normal(run.y.shape))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bent", "law", "signal", "true"),
    [
        ({"cubic": 1500.0}, effects.hardening_spring, "displacement of spring", lambda q: 1500.0 * q**3),
        ({"power": 1.8}, effects.resistance_exponent, "flow of body", None),
    ],
)
def test_a_law_that_bends_an_element_is_drawn_over_its_signal(
    bent: dict[str, float], law: Any, signal: str, true: Callable[[FloatArray], FloatArray] | None
) -> None:
    """A spring had no picture; of a bent damper all of the damper was drawn through what is missing of it."""
    loop = bg.close_loop(swing(), [swung(1, **bent), swung(2, **bent)], [], [law], bg.LoopSettings(faults=False))
    assert [one.trial.candidate.function.__name__ for one in loop.added] == [law.__name__]
    (one,) = missing_efforts(loop)
    assert one.x_label.startswith(signal)
    drawn = np.interp(one.x, one.law_x, one.law)
    size = float(np.sqrt(np.mean(drawn**2)))
    assert abs(np.mean(one.missing - drawn)) < 0.1 * size
    assert np.sqrt(np.mean((one.missing - drawn) ** 2)) < 0.6 * size
    assert np.corrcoef(one.missing, drawn)[0, 1] > 0.8
    if true is not None:
        np.testing.assert_allclose(one.law, true(one.law_x), rtol=0.15, atol=0.05 * size)
