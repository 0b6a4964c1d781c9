"""Iron of a core at a node: its current grows with a power of the flux, beside a load at the same voltage."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import Effect, Place, Scale
from bondgraph.effects import added_compliance, coulomb_loss, magnetic_saturation, quadratic_loss
from bondgraph.effects.places import elements_at
from bondgraph.simulate.simulation import simulate

_STEP, _SAMPLES = 5e-4, 400
_L, _RATED, _SHARE, _POWER = 2.5, 0.4, 3.0, 6.0


def transformer(by_hand: bool = False) -> bg.BondGraph:
    """A core behind a winding, with a load; by hand its iron saturates, as a current that follows from its flux."""
    g = bg.BondGraph("transformer")
    winding, core = g.one_junction("winding", bg.ELECTRICAL), g.zero_junction("core", bg.ELECTRICAL)
    g.effort_source("mains", g.input("u", "V"), at=winding)
    g.resistance("copper", g.parameter("R", 12.0, "V/A", "winding", (4.0, 40.0)), at=winding)
    g.inertance("stray", g.parameter("L_s", 0.3, "V s/A", "stray inductance", (0.1, 1.0)), at=winding, state="i")
    g.bond(winding, core)
    if by_hand:
        g.inertance(
            "magnetising", flow=lambda flux: flux / _L * (1 + _SHARE * (flux / (_L * _RATED)) ** _POWER), at=core,
            state="flux",
        )  # fmt: skip
    else:
        main = g.parameter("L", _L, "V s/A", "main inductance", (0.8, 10.0))
        g.inertance("magnetising", main, at=core, state="i_m")
    burden = g.parameter("R_l", 400.0, "V/A", "load", (100.0, 1500.0))
    g.resistance("load", flow=lambda effort: effort / burden, at=core)
    g.measure_flow("current", winding)
    g.measure_effort("voltage", core)
    return g


def mains(seed: int) -> np.ndarray:
    """Half a second of alternating voltage, whose size changes, (1, samples)."""
    chance, time = np.random.default_rng(seed), _STEP * np.arange(float(_SAMPLES))
    size = np.repeat(chance.uniform(80.0, 330.0, 10), _SAMPLES // 10)
    return (size * np.sin(2 * np.pi * 50.0 * time + chance.uniform(0.0, 6.0)))[np.newaxis]


def shown(g: bg.BondGraph, u: np.ndarray) -> np.ndarray:
    time = _STEP * np.arange(float(_SAMPLES))
    return simulate(bg.build(g).model, time, u, rtol=1e-9).raise_if_failed().y


def saturating(g: bg.BondGraph) -> Effect | None:
    return magnetic_saturation(g, Place(handle(g, "core"), Scale(300.0, _RATED)))


def test_the_current_of_a_core_is_a_power_of_its_flux() -> None:
    g = transformer()
    effect = saturating(g)
    assert effect is not None
    lossy = with_values(g, {effect.coefficients[0]: _SHARE, effect.shapes[0]: _POWER})
    found, by_hand = shown(lossy, mains(1)), shown(transformer(by_hand=True), mains(1))
    assert found == pytest.approx(by_hand, abs=1e-5 * np.abs(by_hand).max())
    assert np.abs(by_hand - shown(transformer(), mains(1))).max() > 0.1 * np.abs(by_hand).max()


def test_a_node_without_an_inductance_takes_no_iron() -> None:
    g = transformer()
    assert saturating(transformer(by_hand=True)) is None  # its iron saturates already
    assert elements_at(g, Place(handle(g, "core"), Scale(1.0, 1.0)), "C") == []
    bare = bg.BondGraph("bare")
    assert magnetic_saturation(bare, Place(bare.zero_junction("node", bg.ELECTRICAL), Scale(1.0, 1.0))) is None


@pytest.mark.slow
def test_a_core_that_saturates_is_found_with_its_power() -> None:
    """It was the cube of a current elsewhere, and a search without an end."""
    chance, time, logs = np.random.default_rng(5), _STEP * np.arange(float(_SAMPLES)), []
    for seed in (1, 2):
        u = mains(seed)
        y = shown(transformer(by_hand=True), u) + np.array([[0.01], [1.0]]) * chance.standard_normal((2, _SAMPLES))
        logs.append(bg.MatchedLog(f"run{seed}", time, u, y))
    offered = [magnetic_saturation, quadratic_loss, coulomb_loss, added_compliance]
    closed = bg.close_loop(transformer(), logs, effects=offered)
    assert [one.trial.candidate.label for one in closed.added] == ["magnetic_saturation at core"]
    assert closed.corrected.values["m_magnetic_saturation_core"] == pytest.approx(_POWER, abs=0.5)
