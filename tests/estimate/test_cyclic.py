"""Angles that act by their sine: known but for whole turns, so that no filter begins with points many turns apart."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.build import BuiltModel
from bondgraph.data.log import MatchedLog
from bondgraph.estimate.cyclic import ANYWHERE, repeats
from bondgraph.estimate.declared import declared_problem
from bondgraph.estimate.setup import state_sizes

#: Inertia in kg m^2, loss in N m s and unbalance in N m of the drum of the logs, and the angle in rad where it begins.
TRUE, BEGINS = {"J": 0.6, "c": 0.08, "u": 0.9}, 0.3


@functools.cache
def drum(turns: float = 1.0) -> BuiltModel:
    """A drum with an unbalance that nothing measures the angle of; ``turns`` of what it acts on for one of the drum."""
    g = bg.BondGraph("drum")
    torque = g.input("torque", "N m", "drive")
    inertia = g.parameter("J", 0.5, "kg m^2", "drum", (0.1, 2.0))
    loss = g.parameter("c", 0.05, "N m s", "bearing", (0.005, 0.5))
    unbalance = g.parameter("u", 0.6, "N m", "unbalance", (0.0, 5.0))
    shaft = g.one_junction("shaft", bg.ROTATION)
    g.effort_source("drive", torque, at=shaft)
    g.inertance("rotor", inertia, at=shaft, state="omega")
    g.resistance("bearing", lambda omega: loss * omega, at=shaft)
    g.compliance("unbalance", lambda phi: unbalance * sympy.sin(turns * phi), at=shaft, state="phi")
    g.measure_flow("speed", shaft, "speed of the drum")
    return bg.build(g)


@functools.cache
def spun() -> MatchedLog:
    """A minute of the true drum by another integrator, its sensor noisy by 0.02 rad/s."""
    time = np.arange(0.0, 60.0, 0.05)
    torque = 1.0 + 0.5 * np.sin(0.2 * time)

    def rates(now: float, state: np.ndarray) -> list[float]:
        held_back = TRUE["c"] * state[0] + TRUE["u"] * np.sin(state[1])
        return [(np.interp(now, time, torque) - held_back) / TRUE["J"], state[0]]

    found = solve_ivp(rates, (0.0, time[-1]), [0.0, BEGINS], t_eval=time, rtol=1e-9, atol=1e-9)
    speed = found.y[0] + np.random.default_rng(1).normal(0.0, 0.02, time.size)
    return MatchedLog("spun", time, torque[np.newaxis], speed[np.newaxis])


@given(turns=st.integers(1, 5), sizes=st.lists(st.floats(0.1, 1e3), min_size=2, max_size=2))
def test_an_angle_that_acts_by_whole_turns_is_found_whatever_its_size(turns: int, sizes: list[float]) -> None:
    model = drum(float(turns)).model
    found = dict(zip(model.names("state"), repeats(model, np.array(sizes)), strict=True))
    assert found == {"phi": True, "omega": False}


def test_an_angle_that_acts_otherwise_is_none() -> None:
    assert not repeats(drum(0.37).model, np.array([1.0, 1.0])).any()


def test_nobody_knows_more_of_an_angle_than_that_it_is_somewhere_in_a_turn() -> None:
    model = drum().model
    sizes = dict(zip(model.names("state"), state_sizes(model, [spun()]), strict=True))
    assert sizes["phi"] == ANYWHERE
    assert sizes["omega"] == pytest.approx(np.abs(spun().y).max())


def test_the_likelihood_follows_its_parameters_and_the_estimate_is_true() -> None:
    """With sigma points 31 rad apart a millionth of a millionth moved it by a thousand nats; intervals were 1e-9."""
    problem = declared_problem(drum().model, ["omega"], [spun()], list(TRUE), "free")
    point = problem.start[:, np.newaxis]
    assert problem.nll(point + 1e-12)[0] == pytest.approx(problem.nll(point)[0], rel=1e-9)
    found = bg.estimate(problem)
    assert found.outcome.succeeded
    for name, true in TRUE.items():
        assert found.values[name] == pytest.approx(true, abs=4.0 * found.std[name])
        assert found.std[name] > 1e-7
