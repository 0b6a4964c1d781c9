"""Storages between two junctions: their equations in closed form, and machines of scipy that hide one of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph import effects
from bondgraph.build import build
from bondgraph.data.log import FloatArray
from bondgraph.declare.domains import ELECTRICAL, TRANSLATION
from bondgraph.declare.editing import copy, handle, with_bounds, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.simulate.model import Model

NUMBERS = st.floats(-5.0, 5.0)
SCALE = Scale(10.0, 2.0)


def coils() -> BondGraph:
    """Two circuits of a source, a resistance and a coil each."""
    g = BondGraph("coils")
    for name, resistance, inductance in (("a", 2.0, 0.5), ("b", 5.0, 0.9)):
        loop = g.one_junction(name, ELECTRICAL)
        g.effort_source(f"source_{name}", g.input(f"u{name}", "V"), at=loop)
        g.resistance(f"copper_{name}", g.parameter(f"R{name}", resistance, "V/A"), at=loop)
        g.inertance(f"coil_{name}", g.parameter(f"L{name}", inductance, "V s/A"), at=loop, state=f"i{name}")
        g.measure_flow(f"current_{name}", loop)
    return g


def carts() -> BondGraph:
    """Two carts, the first pushed, each with drag, and a damper between them."""
    g = BondGraph("carts")
    first, second = g.one_junction("first", TRANSLATION), g.one_junction("second", TRANSLATION)
    g.effort_source("push", g.input("force", "N"), at=first)
    for name, mass, drag in (("first", 4.0, 3.0), ("second", 7.0, 2.0)):
        g.inertance(f"cart_{name}", g.parameter(f"m_{name}", mass, "kg"), at=name, state=f"v_{name}")
        g.resistance(f"drag_{name}", g.parameter(f"d_{name}", drag, "N s/m"), at=name)
        g.measure_flow(f"speed_{name}", handle(g, name))
    between = g.zero_junction("between", TRANSLATION)
    g.bond(first, between)
    g.bond(between, second)
    damper = g.parameter("d_between", 1.0, "N s/m")
    g.resistance("damper", flow=lambda effort: effort / damper, at=between)
    return g


def nodes() -> BondGraph:
    """Two nodes of a circuit, each with a condenser and a resistance to earth, one fed by a current."""
    g = BondGraph("nodes")
    g.flow_source("feed", g.input("current", "A"), at=g.zero_junction("n1", ELECTRICAL))
    g.zero_junction("n2", ELECTRICAL)
    for name, capacitance, resistance in (("n1", 2e-3, 50.0), ("n2", 3e-3, 80.0)):
        c = g.parameter(f"C_{name}", capacitance, "A s/V")
        g.compliance(f"condenser_{name}", 1 / c, at=name, state=f"q_{name}")
        g.resistance(f"shunt_{name}", g.parameter(f"R_{name}", resistance, "V/A"), at=name)
        g.measure_effort(f"voltage_{name}", handle(g, name))
    return g


def extended(g: BondGraph, function: EffectFunction, first: str, second: str = "") -> Effect:
    """The graph extended by an effect at a junction or between two."""
    at = Place.between(handle(g, first), handle(g, second), SCALE) if second else Place(handle(g, first), SCALE)
    effect = function(g, at)
    assert effect is not None
    return effect


def matrix(share: float) -> FloatArray:
    """Inductances of two coils, a share of whose flux is common."""
    mutual = share * np.sqrt(0.5 * 0.9)
    return np.array([[0.5, mutual], [mutual, 0.9]])


@pytest.fixture(scope="module")
def coupled() -> Model:
    g = coils()
    extended(g, effects.mutual_inductance, "a", "b")
    return build(g).model


@given(st.floats(-0.9, 0.9), NUMBERS, NUMBERS, NUMBERS, NUMBERS)
def test_two_coils_that_share_a_flux_obey_the_inverse_of_their_matrix(
    coupled: Model, share: float, i1: float, i2: float, u1: float, u2: float
) -> None:
    voltages = np.array([u1 - 2.0 * i1, u2 - 5.0 * i2])
    inductances = matrix(share)
    theta = coupled.theta(M_mutual_inductance_a_b=inductances[0, 1])
    found = coupled.rhs(0.0, np.array([i1, i2]), np.array([u1, u2]), theta)
    np.testing.assert_allclose(found, np.linalg.solve(inductances, voltages), rtol=1e-9, atol=1e-9)


def test_a_coil_without_a_partner_shares_nothing() -> None:
    g = coils()
    lamp = g.one_junction("lamp", ELECTRICAL)
    g.resistance("wire", g.parameter("R_lamp", 3.0, "V/A"), at=lamp)
    before = copy(g)
    assert effects.mutual_inductance(g, Place.between(handle(g, "a"), lamp, SCALE)) is None
    assert g == before


def test_a_capacitance_between_two_nodes_takes_what_the_difference_of_their_voltages_asks_for() -> None:
    g = nodes()
    extended(g, effects.capacitance_between, "n1", "n2")
    model = build(g).model
    own, shared = np.diag([2e-3, 3e-3]), 7e-4
    together = own + shared * np.array([[1.0, -1.0], [-1.0, 1.0]])
    volts, current = np.array([1.5, -0.8]), 0.3
    rates = np.linalg.solve(together, np.array([current, 0.0]) - volts / [50.0, 80.0])
    theta = model.theta(c_capacitance_between_n1_n2=shared)
    found = model.rhs(0.0, own @ volts, np.array([current]), theta)
    np.testing.assert_allclose(found, own @ rates, rtol=1e-12)


def test_springs_to_the_frame_and_between_carts_swing_as_their_matrices_say() -> None:
    """Eigenvalues of the built model without drag are those of mass and stiffness."""
    for function, second, stiffness in (
        (effects.return_spring, "", np.array([[1.0, 0.0], [0.0, 0.0]])),
        (effects.spring_between, "second", np.array([[1.0, -1.0], [-1.0, 1.0]])),
    ):
        g = carts()
        (name,) = extended(g, function, "first", second).coefficients
        free = {"d_first": 0.0, "d_second": 0.0, "d_between": 1e-9}
        model = build(with_values(g, {name: 2.0, **free})).model
        count = len(model.states)
        rates = model.rhs(0.0, np.eye(count), np.zeros((1, count)), model.theta())
        swings = np.abs(np.linalg.eigvals(rates).imag).max()
        squares = np.linalg.eigvals(np.linalg.solve(np.diag([4.0, 7.0]), 2.0 * stiffness))
        assert swings == pytest.approx(np.sqrt(squares.real.max()), rel=1e-6)
        assert count == 3


def test_a_spring_to_the_frame_takes_the_position_that_is_declared() -> None:
    g = carts()
    g.integral("x_first", handle(g, "first").flow, "m", "position", initial=0.4)
    (name,) = extended(g, effects.return_spring, "first").coefficients
    model = build(with_values(g, {name: 2.0})).model
    assert len(model.states) == 3
    rates = model.rhs(0.0, model.x0(), np.zeros(1), model.theta())
    assert rates[model.index("state", "v_first")] == pytest.approx(-2.0 * 0.4 / 4.0)


def steps(seed: int, count: int, size: float, held: int) -> FloatArray:
    """Levels that are held for some samples."""
    chance = np.random.default_rng(seed)
    return np.repeat(chance.uniform(-size, size, count // held + 1), held)[:count]


def recorded(rates: Callable[..., list[float]], u: FloatArray, dt: float, noise: Sequence[float]) -> FloatArray:
    """States (n, ...) of a machine from rest with held inputs (n, inputs), with noise of its sensors."""
    x, rows = np.zeros(len(rates(np.zeros(9), u[0]))), []
    for now in u:
        rows.append(x[: len(noise)])
        x = solve_ivp(lambda t, x, now=now: rates(x, now), (0.0, dt), x, rtol=1e-9, atol=1e-11).y[:, -1]
    return np.array(rows) + np.random.default_rng(9).normal(0.0, noise, (len(u), len(noise)))


def shared_flux(x: FloatArray, u: FloatArray) -> list[float]:
    voltages = [u[0] - 2.1 * x[0], u[1] - 4.6 * x[1]]
    return list(np.linalg.solve([[0.45, 0.08], [0.08, 0.95]], voltages))


def sprung(x: FloatArray, u: FloatArray) -> list[float]:
    joint = 6.5 * x[2] + 1.1 * (x[0] - x[1])
    return [(u[0] - 3.4 * x[0] - joint) / 4.4, (joint - 1.8 * x[1]) / 6.5, x[0] - x[1]]


def held_back(x: FloatArray, u: FloatArray) -> list[float]:
    joint = 1.1 * (x[0] - x[1])
    return [(u[0] - 3.4 * x[0] - joint - 5.2 * x[2]) / 4.4, (joint - 1.8 * x[1]) / 6.5, x[0]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "rates", "label", "name", "size"),
    [
        (coils, shared_flux, "mutual_inductance at a and b", "M_mutual_inductance_a_b", 0.08),
        (carts, sprung, "spring_between at first and second", "c_spring_between_first_second", 6.5),
        (carts, held_back, "return_spring at first", "c_return_spring_first", 5.2),
    ],
)
def test_machines_of_other_code_tell_what_couples_them(
    machine: Callable[[], BondGraph], rates: Callable[..., list[float]], label: str, name: str, size: float
) -> None:
    g, dt = machine(), 0.02 if machine is coils else 0.1
    g = with_bounds(g, {one.name: (0.5 * one.value, 2.0 * one.value) for one in g.parameters})
    logs = []
    for seed in (1, 2):
        u = np.stack([steps(10 * seed + k, 600, 10.0, 30 - 7 * k) for k in range(len(g.inputs))], axis=1)
        y = recorded(rates, u, dt, (0.02, 0.02))
        columns = {f"{one.name} [{one.unit}]": u[:, k] for k, one in enumerate(g.inputs)}
        columns |= {f"{one.name} [{one.unit}]": y[:, k] for k, one in enumerate(g.outputs)}
        logs.append(bg.Log.from_dataframe(pd.DataFrame({"time [s]": dt * np.arange(600), **columns})))
    closed = bg.close_loop(g, train=logs[:1], holdout=logs[1:])
    assert [one.trial.candidate.label for one in closed.added] == [label]
    assert closed.corrected.values[name] == pytest.approx(size, rel=0.03)
