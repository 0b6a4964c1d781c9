"""Algebraic loops: found, torn, solved in closed form where they are linear or rational, else by iteration."""

from __future__ import annotations

import numpy as np
import pytest
import sympy

from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import Derivation, derive
from bondgraph.derive.equations import ImplicitLoop
from bondgraph.derive.linear import quotient, solve_linear
from bondgraph.derive.order import components, tear
from bondgraph.derive.zero import ZeroTest, is_regular, is_zero
from tests.derive.compare import compare, loaded
from tests.derive.spec import damper, derivatives, force, graph, mass, outputs, same, spring

VALUES = {"m": 1.0, "k": 2.0, "b": 3.0, "c": 0.5, "v": 0.05, "i": 1e-6}


def loops_of(g: BondGraph) -> list[ImplicitLoop]:
    return [step for step in derive(assign_causality(g)).assignments if isinstance(step, ImplicitLoop)]


def test_a_linear_loop_has_a_closed_form():
    nodes = {"F": force(), "a": "1", "ra": damper("b"), "z": "0", "rz": damper("k"), "s": spring("c"), "y": "1"}
    g = graph(nodes, "F->a a->ra a->z z->rz z->y y->s", VALUES, "u")
    assert not loops_of(g)
    assert compare(g) == ""


def test_a_loop_of_a_rational_law_with_one_root_has_a_closed_form():
    """A resistance whose flow saturates, effort = b*flow/(c - flow), in parallel with a gap that keeps it linear."""
    nodes = {"F": ("Sf", {"flow": "u"}), "v": "1", "r": ("R", {"effort": "b*flow/(c - flow)"})}
    g = graph(nodes, "F->v v->r", VALUES, "u", outputs=[{"name": "e", "variable": "effort", "at": "r"}])
    assert same(outputs(g), e="b*u/(c - u)")
    turned = graph(
        nodes | {"F": force()}, "F->v v->r", VALUES, "u", outputs=[{"name": "f", "variable": "flow", "at": "r"}]
    )
    assert same(outputs(turned), f="c*u/(b + u)")


def test_a_rational_loop_is_solved_without_iteration():
    signals = [{"name": "x", "is": "u/(1 + y)"}, {"name": "y", "is": "b/x - 1 + c"}]
    g = graph({"v": "1", "m": mass(), "F": force("x")}, "F->v v->m", VALUES, "u", signals=signals)
    assert not loops_of(g)
    assert same(derivatives(g), f_m="(u - b)/(c*m)")


def test_a_nonlinear_loop_guesses_the_argument_of_its_law():
    nodes = {
        "s": force(),
        "a": "1",
        "d": ("R", {"flow": "i*(exp(effort/v) - 1)"}),
        "r": damper(),
        "z": "0",
        "k": spring(),
    }
    g = graph(nodes, "s->a a->d a->r a->z z->k", VALUES, "u")
    (loop,) = loops_of(g)
    assert [unknown.name for unknown in loop.unknowns] == ["e_a_d"] and loop.meaning == "loop of d, r"
    module = loaded(derive(assign_causality(g)))
    theta = np.array([given.value for given in derive(assign_causality(g)).parameters])
    for volts in (-5.0, 0.0, 0.3, 2.0, 20.0):
        with np.errstate(over="ignore", invalid="ignore"):
            (rate,) = module["rhs"](0.0, np.array([0.1]), np.array([volts]), theta)
        drop = volts - 0.2
        assert rate == pytest.approx(1e-6 * np.expm1((drop - 3.0 * rate) / 0.05), rel=1e-6, abs=1e-12)


def test_a_loop_through_two_nonlinear_laws():
    nodes = {
        "s": force(), "a": "1", "d": ("R", {"flow": "effort + effort**3"}), "z": "0",
        "k": ("R", {"effort": "b*flow + tanh(flow)"}),
        "e": ("R", {"flow": "2*tanh(effort) + effort/9"}), "m": mass(), "y": "1",
    }  # fmt: skip
    g = graph(nodes, "s->a a->d a->z z->k z->e z->y y->m", VALUES, "u")
    assert loops_of(g)
    assert [compare(g, seed) for seed in range(4)] == [""] * 4


def test_a_rate_through_an_implicit_law_follows_from_the_implicit_function_theorem():
    """A dependent mass whose momentum is given implicitly, its rate checked against differences of the root."""
    law = ("I", {"residual": "flow - momentum - c*momentum**3"})
    nodes = {"s": ("Sf", {"flow": "sin(u)"}), "v": "1", "I": law}
    wanted = [{"name": "p", "variable": "momentum", "at": "I"}, {"name": "e", "variable": "effort", "at": "I"}]
    equations = derive(assign_causality(graph(nodes, "s->v v->I", VALUES, "u", outputs=wanted)))
    assert [given.name for given in equations.inputs] == ["u", "d_u"]
    module, theta = loaded(equations), np.array([given.value for given in equations.parameters])

    def at(u: float) -> np.ndarray:
        return module["output"](0.0, np.zeros(0), np.array([u, 1.0]), theta)

    step = 1e-5
    assert at(0.6)[1] == pytest.approx((at(0.6 + step)[0] - at(0.6 - step)[0]) / (2 * step), rel=1e-8)
    assert compare(graph(nodes, "s->v v->I", VALUES, "u", outputs=wanted)) == ""


def test_a_rate_through_a_nonlinear_loop_that_is_not_a_single_law():
    nodes = {
        "s": force("sin(u)"), "a": "1", "d": ("R", {"flow": "effort + effort**3"}), "r": damper(), "z": "0",
        "t": ("GY", {"modulus": "k"}),
        "x": ("R", {"effort": "b*flow + c*flow**3"}), "w": "1", "mm": mass(), "y": "0", "e": spring(),
    }  # fmt: skip
    g = graph(nodes, "s->a a->d a->r a->z z->x z->t t->y y->e y->w w->mm", VALUES, "u")
    assert [compare(g, seed) for seed in range(3)] == [""] * 3


@pytest.mark.parametrize("size", [2, 4, 6])
def test_grids_of_resistances(size):
    """A square grid of resistances between two terminals, which is all loops, against nodal analysis."""
    g = BondGraph("grid")
    u, r = g.input("u", ""), g.parameter("r", 2.0, "")
    node = {(i, j): g.zero_junction(f"n{i}_{j}") for i in range(size) for j in range(size)}
    edges = [((i, j), (i + a, j + b)) for i, j in node for a, b in ((0, 1), (1, 0)) if (i + a, j + b) in node]
    for number, (a, b) in enumerate(edges):
        link = g.one_junction(f"l{number}")
        g.bond(node[a], link)
        g.bond(link, node[b])
        g.resistance(f"r{number}", r * (1 + number), at=link)
    source = g.effort_source("s", u, at=node[0, 0])
    g.effort_source("ground", 0, at=node[size - 1, size - 1])
    g.measure("current", source.flow, "")
    equations = derive(assign_causality(g))
    (found,) = loaded(equations)["output"](0.0, np.zeros(0), np.array([3.0]), np.array([2.0]))
    places = {place: index for index, place in enumerate(node)}
    laplace = np.zeros((size * size, size * size))
    for number, (a, b) in enumerate(edges):
        conductance = 1 / (2.0 * (1 + number))
        for p, q in ((a, b), (b, a)):
            laplace[places[p], places[p]] += conductance
            laplace[places[p], places[q]] -= conductance
    inner = list(range(1, size * size - 1))
    potentials = np.zeros(size * size)
    potentials[0] = 3.0
    potentials[inner] = np.linalg.solve(laplace[np.ix_(inner, inner)], -laplace[inner, 0] * 3.0)
    assert found == pytest.approx(laplace[0] @ potentials, rel=1e-9)


def test_a_ladder_of_resistances_is_torn_at_few_places():
    g = BondGraph("ladder")
    u, r = g.input("u", ""), g.parameter("r", 2.0, "")
    before = g.zero_junction("n0")
    g.effort_source("s", u, at=before)
    for i in range(1, 41):
        link, after = g.one_junction(f"l{i}"), g.zero_junction(f"n{i}")
        g.bond(before, link)
        g.bond(link, after)
        g.resistance(f"a{i}", r, at=link)
        g.resistance(f"b{i}", r, at=after)
        before = after
    g.measure("last", before.effort, "")
    derivation = Derivation(assign_causality(g))
    equations = derivation.equations()
    found = loaded(equations)["output"](0.0, np.zeros(0), np.array([1.0]), np.array([2.0]))
    phi = (1 + np.sqrt(5)) / 2
    expected = (phi + 1 / phi) / (phi**81 + phi**-81)  # Fibonacci numbers: 1/F(81)
    assert found[0] == pytest.approx(expected, rel=1e-9)


def test_loops_do_not_leave_unused_results_behind():
    nodes = {
        "s": force(),
        "a": "1",
        "d": ("R", {"flow": "i*(exp(effort/v) - 1)"}),
        "r": damper(),
        "z": "0",
        "k": spring(),
    }
    equations = derive(assign_causality(graph(nodes, "s->a a->d a->r a->z z->k", VALUES, "u")))
    assert not [
        step.symbol for step in equations.assignments if hasattr(step, "symbol") and step.symbol.name.endswith("_part")
    ]


# ---------------------------------------------------------------------- the parts


def test_components_come_in_order_of_computation():
    edges = {"out": ["loop_a", "x"], "loop_a": ["loop_b"], "loop_b": ["loop_a", "x"], "x": []}
    assert components(["out"], edges.__getitem__) == [["x"], ["loop_a", "loop_b"], ["out"]]


def test_components_of_a_very_long_chain_need_no_recursion():
    found = components([0], lambda i: [i + 1] if i < 50_000 else [])
    assert len(found) == 50_001 and found[0] == [50_000]


def test_tearing_leaves_an_order():
    edges = {1: [2], 2: [3], 3: [1, 4], 4: [2]}
    torn, order = tear([1, 2, 3, 4], edges.__getitem__)
    assert torn in ([2], [3]) and len(order) == 3
    position = {key: index for index, key in enumerate(order)}
    assert all(position[child] < position[key] for key in order for child in edges[key] if child in position)
    assert tear([1, 2, 3, 4], edges.__getitem__, prefer={4})[0][0] == 4
    assert tear([1, 2, 3, 4], edges.__getitem__, must=[1])[0][0] == 1


def test_linear_systems_are_solved_exactly():
    a, b, c, d, e, f = sympy.symbols("a b c d e f", real=True)
    found = solve_linear([[a, b], [c, d]], [e, f], lambda value, _: value, lambda columns: ValueError(columns))
    assert sympy.simplify(found[0] - (d * e - b * f) / (a * d - b * c)) == 0
    assert sympy.simplify(found[1] - (a * f - c * e) / (a * d - b * c)) == 0
    with pytest.raises(ValueError, match="1"):
        solve_linear([[a, b], [a * c, b * c]], [e, f], lambda value, _: value, lambda columns: ValueError(columns))


def test_quotients_have_no_fractions_in_fractions():
    a, b, c = sympy.symbols("a b c", real=True)
    assert quotient(a, 1 + b / c) == a * c / (b + c)
    assert quotient(a, sympy.Integer(1)) == a


@pytest.mark.parametrize(
    ("text", "zero"),
    [
        ("(a + b)**3 - a**3 - 3*a**2*b - 3*a*b**2 - b**3", True), ("a/(a + b) + b/(a + b) - 1", True), ("a - b", False),
        ("sin(a)**2 + cos(a)**2 - 1", True), ("exp(2*a) - exp(a)**2", True), ("1 - tanh(a)**2", False),
        ("1 + b**2*(1 - tanh(a)**2)", False), ("sqrt(a**2) - Abs(a)", True), ("a*sign(a) - Abs(a)", True),
        ("cosh(a)**2 - sinh(a)**2 - 1", True), ("1e-300*a", False), ("a/(b - b + 1) - a", True),
        ("Max(a, 0) - a", False),
        ("log(exp(a)) - a", True), ("1 - 1/(1 + 1e-17*a**2)", False),
    ],
)  # fmt: skip
def test_zero_is_decided_exactly(text, zero):
    a, b = sympy.symbols("a b", real=True)
    assert is_zero(sympy.sympify(text, locals={"a": a, "b": b})) is zero


def test_zero_is_decided_through_what_names_stand_for():
    a, b, x, y = sympy.symbols("a b x y", real=True)
    test = ZeroTest()
    test.define(x, sympy.sin(a) * b)
    test.define(y, x / b)
    assert test.is_zero(y - sympy.sin(a)) and not test.is_zero(y - x)
    assert test.is_zero(y**2 + sympy.cos(a) ** 2 - 1)


def test_regular_matrices_of_expressions():
    a, b = sympy.symbols("a b", real=True)
    assert is_regular([[sympy.Integer(0), a], [b, sympy.Integer(0)]])
    assert not is_regular([[a, b, a + b], [b, a, a + b], [a, a, 2 * a]])
    assert is_regular([[sympy.tanh(a), b], [b, a]])
