"""Losses that grow by a logarithm: where that begins is estimated with them."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph import effects
from bondgraph.data.log import FloatArray

DROP, KNEE = 0.55, 1.3


def cell() -> bg.BondGraph:
    """A choke and a cell that is declared as a resistance."""
    g = bg.BondGraph("cell")
    u = g.input("u", "V")
    loop = g.one_junction("loop", bg.ELECTRICAL)
    membrane = g.parameter("R", 0.4, "ohm", "", (0.05, 2.0))
    g.effort_source("rectifier", u, at=loop)
    g.inertance("choke", g.parameter("L", 0.02, "H"), at=loop, state="i")
    g.resistance("membrane", lambda flow: membrane * flow, at=loop)
    g.measure_flow("current", loop)
    return g


def electrolysed(seed: int) -> bg.Log:
    """The cell by scipy, with an overvoltage that grows by the logarithm of the current from 1.3 A on."""
    chance, time = np.random.default_rng(seed), 0.02 * np.arange(900)
    u = np.repeat(chance.uniform(-3.0, 6.0, 30), 30)

    def rate(t: float, x: FloatArray) -> FloatArray:
        given = np.interp(t, time, u)
        return np.asarray((given - 0.22 * x - DROP * np.arcsinh(x / KNEE)) / 0.02)

    i = solve_ivp(rate, (0.0, time[-1]), [0.0], t_eval=time, rtol=1e-8, atol=1e-9, max_step=0.02).y[0]
    table = {"time [s]": time, "u [V]": u, "current [A]": i + chance.normal(0.0, 0.1, time.size)}
    return bg.Log.from_dataframe(pd.DataFrame(table), name=f"run{seed}")


@pytest.mark.slow
def test_an_overvoltage_is_found_with_the_current_at_which_it_begins() -> None:
    """The current was fixed at a fiftieth of the largest one, and a leak beside the cell mended the form."""
    functions = (effects.electrode_loss, effects.quadratic_loss)
    closed = bg.close_loop(cell(), [electrolysed(1), electrolysed(2)], effects=functions)
    (found,) = closed.added
    assert found.trial.candidate.label == "activation_drop at loop" and not found.trial.forms
    values, std = closed.corrected.values, closed.corrected.std
    (size,), (knee,) = found.coefficients[:1], found.trial.candidate.effect.shapes
    assert values[size] == pytest.approx(DROP, abs=4.0 * std[size])
    assert values[knee] == pytest.approx(KNEE, abs=4.0 * std[knee])
