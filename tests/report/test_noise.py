"""Process noise in reports: the states that it drives, and those where it is too little to matter."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.correct.declared_fit import fit_declared
from bondgraph.correct.loop import LoopSettings
from bondgraph.estimate.local import no_report
from bondgraph.report.noise import idle


def pair() -> bg.BondGraph:
    g = bg.BondGraph("pair")
    for name in ("first", "second"):
        body = g.one_junction(name, bg.TRANSLATION)
        g.effort_source(f"pull_{name}", g.input(f"force_{name}", "N", hold=True), at=body)
        g.inertance(f"mass_{name}", g.parameter(f"m_{name}", 2.0, "kg", "", (0.5, 8.0)), at=body, state=f"v_{name}")
        g.resistance(f"drag_{name}", g.parameter(f"d_{name}", 1.0, "N s/m", "", (0.2, 5.0)), at=body)
        g.measure_flow(f"speed_{name}", body)
    return g


def log(gusts: float, seed: int) -> bg.MatchedLog:
    """Two masses behind held forces, exactly sampled; gusts push the second one, m/s each sample."""
    chance, time = np.random.default_rng(seed), 0.1 * np.arange(400)
    force = np.repeat(chance.uniform(-5.0, 5.0, (2, 40)), 10, axis=1)
    keeps, speed = np.exp(-0.05), np.zeros((2, 400))
    for k in range(1, 400):
        speed[:, k] = keeps * speed[:, k - 1] + (1.0 - keeps) * force[:, k - 1]
        speed[1, k] += gusts * chance.standard_normal()
    return bg.MatchedLog(f"run{seed}", time, force, speed + 0.02 * chance.standard_normal(speed.shape))


@pytest.mark.parametrize(("gusts", "little"), [(0.0, ["v_first", "v_second"]), (0.05, ["v_first"])])
def test_noise_that_explains_nothing_is_no_finding(gusts: float, little: list[str]) -> None:
    """Of a rotor without any process noise a report said that it drives omega: 0.85, from 0.05 to 15."""
    found = fit_declared(pair(), [log(gusts, 1), log(gusts, 2)], [], LoopSettings(), no_report).fit
    assert idle(found) == little
