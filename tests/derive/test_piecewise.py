"""Loops that are straight between kinks: solved without iteration, also where the gain of a branch exceeds one."""

from __future__ import annotations

import numpy as np
import sympy
from scipy.optimize import brentq
from sympy import Abs, Symbol, tanh

from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.functions import maximum, minimum
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.derive.equations import ImplicitLoop
from bondgraph.derive.piecewise import lines_of, solve_piecewise
from tests.derive.compare import compare, loaded
from tests.derive.spec import force, graph, mass

A, B, X = (Symbol(name, real=True) for name in "abx")


def belt() -> BondGraph:
    """A belt whose grip the weaker of two clamps limits, the second of which grows with the force that is carried."""
    g = BondGraph("belt", doc="Two masses, a belt between them.")
    u, v, m = g.input("u", "N"), g.input("v", "N"), g.parameter("m", 2.0, "kg")
    grip, edge = g.parameter("grip", 1.2, "1"), g.parameter("edge", 0.15, "m/s")
    spring, gain = g.parameter("spring", 400.0, "N"), g.parameter("gain", 1.5, "1")
    clamp = g.input("clamp", "N", default=300.0)
    a, link, b = (
        g.one_junction("a", TRANSLATION),
        g.zero_junction("link", TRANSLATION),
        g.one_junction("b", TRANSLATION),
    )
    g.inertance("first", m, at=a)
    g.inertance("second", m, at=b)
    g.effort_source("push", u, at=a)
    g.effort_source("load", -v, at=b)
    g.bond(a, link)
    g.bond(link, b)
    second = g.signal("second_clamp", spring + gain * maximum(link.effort, 0), "N", "clamp of the second side")
    g.resistance("slip", lambda speed: grip * tanh(speed / edge) * minimum(clamp, second), at=link)
    g.measure_effort("belt_force", link, "force of the belt")
    return g


def belt_force(speed: float, clamp: float, grip: float, spring: float, gain: float) -> float:
    """The only solution, by cases."""
    slope = grip * np.tanh(speed / 0.15)
    if slope <= 0:
        return float(slope * min(clamp, spring))
    if clamp * (1 - slope * gain) <= spring:
        return float(slope * clamp)
    return float(slope * spring / (1 - slope * gain))


def test_a_self_locking_belt_is_solved_in_every_branch():
    equations = derive(assign_causality(belt()))
    assert not any(isinstance(step, ImplicitLoop) for step in equations.assignments)
    draw = np.random.default_rng(1).uniform
    speed, clamp, grip, spring, gain = (
        draw(low, high, 2000) for low, high in ((-0.3, 0.6), (0, 2000), (0.05, 1.5), (1, 1000), (0, 3))
    )
    values = {"grip": grip, "edge": 0.15, "spring": spring, "gain": gain, "m": 2.0}
    theta = np.array([np.broadcast_to(values[parameter.name], 2000) for parameter in equations.parameters])
    u = np.array([clamp if given.name == "clamp" else np.zeros(2000) for given in equations.inputs])
    (force,) = loaded(equations)["output"](0.0, np.array([speed, 0 * speed]), u, theta)
    expected = [belt_force(*case) for case in zip(speed, clamp, grip, spring, gain, strict=True)]
    np.testing.assert_allclose(force, expected, rtol=1e-9)
    locked = grip * np.tanh(speed / 0.15) * gain > 1
    assert 100 < locked.sum() < 1900


def test_such_a_loop_satisfies_all_equations_of_its_bonds():
    assert [compare(belt(), seed) for seed in range(4)] == [""] * 4


def test_a_falling_law_is_solved_wherever_its_kinks_are():
    """x = law(x) with a law that falls has one solution, which bracketing finds too."""
    signals = [{"name": "x", "is": "a - Max(x, b) - Min(2*x, c)/2 - Abs(x - d)/4"}]
    values = {"m": 1.0, "a": 0.0, "b": 0.0, "c": 0.0, "d": 0.0}
    g = graph({"F": force("x"), "v": "1", "m": mass()}, "F->v v->m", values, signals=signals)
    equations = derive(assign_causality(g))
    assert not any(isinstance(step, ImplicitLoop) for step in equations.assignments)
    order = [parameter.name for parameter in equations.parameters]
    cases = np.random.default_rng(2).uniform(-3, 3, (4, 300))
    theta = np.array([np.ones(300) if name == "m" else cases["abcd".index(name)] for name in order])
    found = loaded(equations)["rhs"](0.0, np.zeros((1, 300)), np.zeros((0, 300)), theta)[0]

    def solution(a: float, b: float, c: float, d: float) -> float:
        return float(brentq(lambda x: a - max(x, b) - min(2 * x, c) / 2 - abs(x - d) / 4 - x, -100, 100, xtol=1e-13))

    np.testing.assert_allclose(found, [solution(*case) for case in cases.T], atol=1e-9)


def test_laws_with_other_parts_are_left_alone():
    assert lines_of(X**2, X) is None
    assert lines_of(minimum(A, sympy.sin(X)), X) is None
    assert lines_of(maximum(X, A) * X, X) is None
    assert solve_piecewise(A + B * X, X, lambda value, _: value) is None
    assert solve_piecewise(X + maximum(X, 0), X, lambda value, _: value) is None


def test_laws_with_too_many_branches_are_left_to_an_iteration():
    assert lines_of(sum(Abs(X - number) for number in range(5)), X) is None
