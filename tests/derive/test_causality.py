"""Causal strokes: where they are, why, what else could be chosen."""

from __future__ import annotations

import itertools
import random

import pytest

from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.derive.alternatives import alternatives, compare
from bondgraph.derive.causality import CausalGraph, assign_causality
from bondgraph.derive.dependence import dependences
from bondgraph.derive.derivation import Derivation, derive
from bondgraph.derive.explanation import explain
from bondgraph.derive.patterns import match, stroke_patterns
from bondgraph.derive.strokes import ContradictionError, Decision, Reason, StrokeSearch
from bondgraph.errors import CausalityError
from tests.derive.random_graphs import RandomGraph
from tests.derive.spec import damper, derivatives, force, graph, mass, same, speed, spring

VALUES = {"m": 1.0, "M": 2.0, "k": 3.0, "b": 4.0, "n": 5.0}


def check(causal: CausalGraph) -> None:
    """Every junction has one bond that imposes its variable, every two-port strokes that fit it."""
    incidence = causal.graph.incidence()
    for node in causal.graph.nodes.values():
        at = [causal.receives_effort(bond, node.name) for bond, _ in incidence[node.name]]
        if node.kind == "0":
            assert sum(at) == 1
        elif node.kind == "1":
            assert sum(not stroke for stroke in at) == 1
        elif node.kind == "TF":
            assert at[0] != at[1]
        elif node.kind == "GY":
            assert at[0] == at[1]
        elif node.kind in ("Se", "Sf"):
            assert at == [node.kind == "Sf"]
    assert len(causal.strokes) == len(causal.reasons) == len(causal.graph.bonds)


def test_strokes_of_random_graphs_are_consistent():
    placed = 0
    for seed in range(60_000, 60_150):
        try:
            causal = assign_causality(RandomGraph(seed, linear=False, mesh=0.2).graph)
        except CausalityError:
            continue
        check(causal)
        placed += 1
    assert placed > 60


def most_integral(g: BondGraph) -> int | None:
    """The largest number of storages in integral causality over all strokes that fit, by trying all of them."""
    incidence, count = g.incidence(), len(g.bonds)
    best = None
    for strokes in itertools.product((False, True), repeat=count):
        fits, integral = True, 0
        for node in g.nodes.values():
            at = [strokes[bond] == inward for bond, inward in incidence[node.name]]
            ones = sum(at)
            allowed = {
                "0": ones == 1,
                "1": len(at) - ones == 1,
                "TF": ones == 1,
                "GY": ones != 1,
                "Se": ones == 0,
                "Sf": ones == 1,
            }
            fits = fits and allowed.get(node.kind, True)
            integral += {"I": ones, "C": len(at) - ones}.get(node.kind, 0)
        if fits:
            best = integral if best is None else max(best, integral)
    return best


def test_as_many_storages_as_possible_are_independent():
    """Greedy choice with backtracking against exhaustive search on small graphs without laws that fix strokes."""
    compared = 0
    for seed in range(70_000, 70_120):
        g = RandomGraph(seed, mesh=0.3, sizes=(2, 4)).graph
        if len(g.bonds) > 11 or any(node.ports > 1 for node in g.nodes.values()):
            continue
        try:
            causal = assign_causality(g)
        except CausalityError as error:
            assert "ring of" in error.message or most_integral(g) is None
            continue
        storages = sum(node.ports for node in g.nodes.values() if node.kind in ("C", "I"))
        assert storages - len(causal.derivative) == most_integral(g)
        compared += 1
    assert compared > 40


def test_reasons_lead_back_to_where_they_began():
    nodes = {"s": speed(), "v": "1", "t": ("TF", {"modulus": "n"}), "w": "1", "m": mass(), "z": "0", "k": spring()}
    causal = assign_causality(graph(nodes, "s->v v->t t->w w->m w->z z->k", VALUES, "u"))
    assert [reason.kind for reason in causal.reasons] == ["source"] + ["propagated"] * 5
    assert causal.explain(3) == (
        "bond w -> m: t -> w imposes the flow of 1-junction w <- bond t -> w: the stroke is carried through the "
        "transformer t <- bond v -> t: s -> v imposes the flow of 1-junction v <- bond s -> v: source s imposes the "
        "flow"
    )
    assert causal.derivative == (("m", 1),)


def test_a_dependent_storage_says_what_is_in_the_way():
    causal = assign_causality(graph({"v": "1", "m": mass(), "M": mass("M")}, "v->m v->M", VALUES))
    assert causal.reasons[1].text == "v -> m imposes the flow of 1-junction v"
    nodes = {"s": force(), "z": "0", "k": spring(), "a": "1", "b": "1", "y": "0", "K": spring("n"), "kk": spring("b")}
    causal = assign_causality(graph(nodes, "s->z z->k z->a a->y y->K y->b b->kk", VALUES, "u"))
    assert {name for name, _ in causal.derivative} == {"k"} | {name for name, _ in causal.derivative}
    check(causal)


def test_a_choice_that_leads_nowhere_is_taken_back():
    """Both springs independent would leave the 1-junction between them without a flow, seen only at its last bond."""
    closed = graph({"k": spring(), "a": "1", "z": "0", "K": spring("n")}, "k->a a->z z->K", VALUES)
    causal = assign_causality(closed)
    check(causal)
    assert causal.derivative == (("K", 1),)
    assert causal.reasons[0].kind == "integral"
    nodes = {
        "g": ("GY", {"modulus": "n"}),
        "v": "1",
        "x": "0",
        "y": "0",
        "m": mass(),
        "M": mass("M"),
        "w": "1",
        "s": force(),
    }
    hidden = assign_causality(graph(nodes, "s->v v->x x->m v->g g->y y->M y->w w->x", VALUES, "u"))
    check(hidden)


def test_preferred_storages_choose_first():
    nodes = {"F": force(), "v": "1", "m": mass(), "M": mass("M")}
    g = graph(nodes, "F->v v->m v->M", VALUES, "u")
    assert same(derivatives(g), f_m="u/(m + M)")
    assert same(derivatives(g, ["M"]), f_M="u/(m + M)")


def test_alternatives_tell_what_each_choice_costs():
    nodes = {
        "F": force(),
        "v": "1",
        "m": ("I", {"flow": "tanh(momentum) + momentum"}),
        "M": mass("M"),
        "r": damper(),
        "z": "0",
        "k": spring(),
    }
    g = graph(nodes, "F->v v->m v->M v->r v->z z->k", VALUES, "u")
    default, other = alternatives(g)
    assert (default.states, default.dependent, default.implicit) == (("m", "k"), ("M",), 0)
    assert (other.independent, other.states, other.dependent, other.implicit) == (("M",), ("M", "k"), ("m",), 1)
    assert min(default.operations, other.operations) > 0
    refused = compare(g, [["nothing"]])[0]
    assert "no storage 'nothing'" in refused.refused and refused.states == ()


def test_dependent_storages_name_the_independent_ones_and_the_gains():
    nodes = {"s": speed(), "z": "0", "a": "1", "m": mass(), "b": "1", "M": mass("M")}
    g = graph(nodes, "s->z z->a a->m z->b b->M", VALUES, "u")
    (found,) = dependences(Derivation(assign_causality(g)))
    assert found.text == "M is dependent: flow(M) follows f_m of m with gain -1 and input u with gain 1"
    geared = graph(
        {"a": "1", "m": mass(), "t": ("TF", {"modulus": "n"}), "b": "1", "M": mass("M"), "K": spring(), "z": "0"},
        "a->m a->t t->b b->M b->z z->K",
        VALUES,
    )
    (found,) = dependences(Derivation(assign_causality(geared)))
    assert [(gain.variable, gain.element, str(gain.value)) for gain in found.gains] == [("f_m", "m", "n")]
    modulated = graph(
        {
            "a": "1",
            "m": mass(),
            "t": ("TF", {"modulus": "sin(displacement(K))"}),
            "b": "1",
            "M": mass("M"),
            "K": spring(),
        },
        "a->m a->t t->b b->M a->K",
        VALUES,
    )
    (found,) = dependences(Derivation(assign_causality(modulated)))
    assert {gain.variable: str(gain.value) for gain in found.gains} == {"f_m": "sin(q_K)", "q_K": "f_m*cos(q_K)"}
    still = graph({"s": speed("0"), "v": "1", "m": mass()}, "s->v v->m", VALUES)
    assert dependences(Derivation(assign_causality(still)))[0].text == "m is dependent: nothing changes flow(m)"


def test_the_explanation_covers_bonds_dependent_storages_and_loops():
    nodes = {
        "F": force(),
        "v": "1",
        "m": mass(),
        "M": mass("M"),
        "r": damper(),
        "s": ("R", {"flow": "tanh(effort)"}),
        "z": "0",
    }
    g = graph(nodes, "F->v v->m v->M v->z z->r z->s", VALUES, "u")
    text = explain(Derivation(assign_causality(g)))
    assert "F->v: v receives the effort; source F imposes the effort" in text
    assert "M is dependent: flow(M) follows f_m of m with gain 1" in text
    assert "algebraic loop through r, s, closed by" in text and "solved by Newton's method" in text


def test_loops_name_their_elements():
    nodes = {"F": force(), "a": "1", "ra": damper("b"), "z": "0", "rz": damper("k"), "c": "1", "rc": damper("n")}
    wanted = [{"name": "i", "variable": "flow", "at": "a"}]
    g = graph(nodes, "F->a a->ra a->z z->rz z->c c->rc", VALUES, "u", outputs=wanted)
    derivation = Derivation(assign_causality(g))
    equations = derivation.equations()
    assert [loop.elements for loop in derivation.loops] == [("ra", "rz", "rc")]
    assert derivation.equations() == equations and len(derivation.loops) == 1


@pytest.mark.parametrize("closed_modulus", ["switch(u, 0.1)", "2*switch(u - 1, 0.1)"])
def test_a_transformer_that_can_open_never_divides_by_its_modulus(closed_modulus):
    nodes = {"a": "1", "m": mass(), "t": ("TF", {"modulus": closed_modulus}), "z": "0", "k": spring(), "r": damper()}
    g = graph(nodes, "a->m a->t t->z z->k a->r", VALUES, "u")
    assert assign_causality(g).derivative == ()
    turned = graph(
        {"z": "0", "k": spring(), "t": nodes["t"], "a": "1", "m": mass(), "r": damper()},
        "z->k z->t t->a a->m z->r",
        VALUES,
        "u",
    )
    with pytest.raises(CausalityError, match=r"whose modulus can become zero.*exchange the sides of t"):
        assign_causality(turned)


def test_matching_gives_each_unknown_an_equation():
    x, y, z = symbol("x"), symbol("y"), symbol("z")
    assert match([x + y, x - y], [x, y]) == [0, 1]
    assert match([y**3 - 1, x + y], [x, y]) == [1, 0]
    assert match([x, x], [x, y]) is None
    assert match([x + y + z, y, x * y], [x, y, z]) == [2, 1, 0]


@pytest.mark.parametrize(
    ("laws", "allowed"),
    [
        (["b*flow2", "-b*flow1"], ((False, False), (True, True))),  # a gyrator
        (["b*flow1 + k*flow2", "b*flow2"], ((False, False), (False, True), (True, False), (True, True))),
        (["b*(flow1 + flow2)", "b*(flow1 + flow2)"], ((False, False), (False, True), (True, False))),  # of rank one
        (["b*flow1**3", "b*flow2"], ((False, False),)),
    ],
)
def test_a_field_of_linear_laws_allows_the_patterns_that_determine_it(laws, allowed):
    nodes = {"a": "1", "b": "1", "f": ("R", {"ports": 2, "laws": laws}), "m": mass(), "M": mass()}
    assert stroke_patterns(graph(nodes, "a->f b->f a->m b->M", VALUES).nodes["f"]) == allowed


def test_search_finds_the_first_assignment_in_the_order_of_preference():
    """Against exhaustive search: random decisions on random rings and trees of junctions."""
    for seed in range(40):
        rng = random.Random(seed)
        g = BondGraph("search")
        names = [g.zero_junction(f"j{i}") if rng.random() < 0.5 else g.one_junction(f"j{i}") for i in range(4)]
        for i in range(1, 4):
            g.bond(names[i], rng.choice(names[:i]))
        for i, junction in enumerate(names):
            g.resistance(f"r{i}", 1.0, at=junction)
        wanted = [(bond, rng.random() < 0.5) for bond in rng.sample(range(len(g.bonds)), len(g.bonds))]

        def otherwise(contradiction, causes):
            return Reason("propagated", contradiction.node, "", tuple(causes))

        search = StrokeSearch(g, {})
        search.run([Decision(bond, at, Reason("chosen", "", ""), otherwise) for bond, at in wanted])
        assert search.at_target == first_fitting(g, wanted)


def first_fitting(g: BondGraph, wanted: list[tuple[int, bool]]) -> list[bool]:
    incidence = g.incidence()
    for turned in itertools.product((False, True), repeat=len(wanted)):
        strokes = {bond: at != turn for (bond, at), turn in zip(wanted, turned, strict=True)}
        ones = {
            n.name: sum(strokes[b] == inward for b, inward in incidence[n.name])
            for n in g.nodes.values()
            if n.is_junction
        }
        if all(ones[name] == (1 if g.nodes[name].kind == "0" else len(incidence[name]) - 1) for name in ones):
            return [strokes[bond] for bond in range(len(g.bonds))]
    raise AssertionError("no strokes fit")


def test_decisions_that_cannot_be_turned_contradict_each_other():
    g = graph({"z": "0", "a": damper(), "b": damper()}, "z->a z->b", VALUES)
    search = StrokeSearch(g, {})
    asked = [Decision(bond, False, Reason("law", name, "")) for bond, name in ((0, "a"), (1, "b"))]
    with pytest.raises(ContradictionError):
        search.run(asked)


def test_assignment_is_fast_with_many_dependent_storages():
    g = BondGraph("many")
    v = g.one_junction("v")
    for i in range(400):
        g.inertance(f"m{i}", 1.0 + i, at=v)
    causal = assign_causality(g)
    assert len(causal.derivative) == 399
    assert len(derive(causal).states) == 1
