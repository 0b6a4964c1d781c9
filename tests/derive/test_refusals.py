"""Graphs that must be refused: the type of the error, what it names and the way out it shows."""

from __future__ import annotations

import pytest
import sympy

from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.errors import BondGraphError, CausalityError, DeclarationError, DerivationError, DimensionError
from tests.derive.spec import damper, force, graph, mass, speed, spring

VALUES = {"m": 1.0, "k": 2.0, "b": 3.0}
CUBIC = ("R", {"effort": "b*flow**3"})


def refused(g: BondGraph) -> BondGraphError:
    with pytest.raises(BondGraphError) as caught:
        check_dimensions(derive(assign_causality(g)))
    return caught.value


CONFLICTS = {
    "two sources of effort": (
        graph({"z": "0", "s1": force("1"), "s2": force("2"), "r": damper()}, "s1->z s2->z z->r", VALUES),
        [
            "bond s2 -> z cannot carry its stroke at z",
            "source s2 imposes the effort",
            "source s1",
            "remove one of s1, s2",
        ],
    ),
    "two sources of flow": (
        graph({"v": "1", "s1": speed("1"), "s2": speed("2"), "r": damper()}, "s1->v s2->v v->r", VALUES),
        ["bond s2 -> v", "source s1 imposes the flow", "remove one of s1, s2", "0-junction"],
    ),
    "two sources through a transformer": (
        graph({"t": ("TF", {"modulus": "k"}), "s1": force("1"), "s2": force("2")}, "s1->t t->s2", VALUES),
        ["carried through the transformer t", "remove one of s1, s2"],
    ),
    "two sources through a gyrator": (
        graph({"g": ("GY", {"modulus": "k"}), "s1": force("1"), "s2": speed("2")}, "s1->g g->s2", VALUES),
        ["carried through the gyrator g", "s1", "s2"],
    ),
    "two sources bonded to each other": (
        graph({"s1": force("1"), "s2": force("2")}, "s1->s2"),
        ["bond s1 -> s2", "remove one of s1, s2"],
    ),
    "a chain of junctions between two sources": (
        graph({"s1": speed("1"), "a": "1", "z": "0", "b": "1", "s2": speed("2")}, "s1->a a->z z->b b->s2"),
        ["source s2 imposes the flow", "bond s1 -> a: source s1 imposes the flow", "remove one of s1, s2"],
    ),
    "a law that cannot take what the source imposes": (
        graph({"s": force("1"), "r": CUBIC}, "s->r", VALUES),
        [
            "law of r gives the effort",
            "source s already imposes the effort",
            "give r its law as flow(effort)",
            "make s an Sf",
        ],
    ),
    "a law against the only storage": (
        graph({"z": "0", "c1": spring(), "r1": CUBIC}, "z->c1 z->r1", VALUES),
        [
            "bond z -> r1 cannot carry its stroke at z (law of r1 gives an effort) because c1 already imposes the "
            "effort of 0-junction z; give r1 its law as flow(effort)",
            "separate them by a 1-junction",
        ],
    ),
    "derivative causality through a law": (
        graph(
            {"s": speed("1"), "z": "0", "a": "1", "d": ("R", {"flow": "tanh(effort)"}), "i": mass(), "r": damper()},
            "s->z z->a a->d a->i z->r",
            VALUES,
        ),
        [
            "bond a -> d cannot carry its stroke at d (law of d gives a flow) because i already imposes the flow of "
            "1-junction a",
            "give d its law as effort(flow)",
        ],
    ),
    "a law of which the inverse has two branches": (
        graph(
            {"s": force("1"), "a": "1", "r": ("R", {"effort": "b*flow**2"}), "z": "0", "c": spring(), "d": damper()},
            "s->a a->r a->z z->c z->d",
            VALUES,
        ),
        ["r"],
    ),
    "nothing imposes the flow": (
        graph({"v": "1", "s": force("1"), "r": CUBIC}, "s->v v->r", VALUES),
        ["only this bond is left to impose the flow of 1-junction v", "give r its law as flow(effort)"],
    ),
    "a ring of junctions of one kind": (
        graph({"a": "0", "b": "0", "c": "0", "k": spring()}, "a->b b->c c->a a->k", VALUES),
        ["bond c -> a closes a ring of 0-junctions", "flow", "remove this bond"],
    ),
    "parallel bonds between junctions of one kind": (
        graph({"a": "1", "b": "1", "m": mass()}, "a->b a->b a->m", VALUES),
        ["closes a ring of 1-junctions"],
    ),
}


@pytest.mark.parametrize("name", CONFLICTS)
def test_conflicts_name_the_chain_the_culprits_and_the_ways_out(name):
    g, texts = CONFLICTS[name]
    error = refused(g)
    assert isinstance(error, CausalityError) and error.message.startswith("g: ") and error.where
    for text in texts:
        assert text in error.message


UNDETERMINED = {
    "a ring of unity gain": (
        graph(
            {"a": "1", "z": "0", "b": "1", "y": "0", "r": damper(), "i": mass()},
            "a->z z->b b->y y->a a->r b->i",
            VALUES,
        ),
        ["bond a -> z", "bond y -> a"],
    ),
    "a source of its own effect": (
        graph({"s": ("Se", {"effort": "effort(r)"}), "r": damper()}, "s->r", VALUES),
        ["bond s -> r"],
    ),
    "a signal of itself": (
        graph({"v": "1", "m": mass()}, "v->m", VALUES, signals=[{"name": "x", "is": "x + 1"}]),
        ["signal x"],
    ),
    "two signals of each other": (
        graph(
            {"v": "1", "m": mass()}, "v->m", VALUES, signals=[{"name": "x", "is": "2*y"}, {"name": "y", "is": "x/2"}]
        ),
        ["signal x", "signal y"],
    ),
    "junctions alone": (graph({"a": "1", "b": "0"}, "a->b b->a"), ["bond a -> b"]),
}


@pytest.mark.parametrize("name", UNDETERMINED)
def test_loops_that_determine_nothing_are_named(name):
    g, texts = UNDETERMINED[name]
    error = refused(g)
    assert isinstance(error, DerivationError) and "its gain is exactly one" in error.message
    for text in texts:
        assert text in error.message and text in error.where


def test_a_singular_loop_is_seen_through_named_intermediate_results():
    """Three loops with gains of many parts, whose determinant vanishes only when they are multiplied out."""
    signals = [
        {"name": "x", "is": "(a*b + c)*y/(a*b + c + 1) + (b + c)*z/(a*b + c + 1) + u"},
        {"name": "y", "is": "(a*b + c + 1)*x/(a*b + c) - (b + c)*z/(a*b + c) + u"},
        {"name": "z", "is": "x/3 + y/5 + u"},
    ]
    g = graph({"v": "1", "m": mass()}, "v->m", VALUES | {"a": 1, "c": 2}, "u", signals=signals)
    assert "gain is exactly one" in refused(g).message


DECLARATIONS = {
    "a transformer with two incoming bonds": (
        {"a": "1", "b": "1", "t": ("TF", {"modulus": "k"}), "i": mass(), "r": damper()},
        "a->t b->t a->i b->r",
        "t: a TF has one incoming and one outgoing bond, this one has 2 in and 0 out",
    ),
    "a transformer with three bonds": (
        {"a": "1", "b": "1", "t": ("TF", {"modulus": "k"}), "i": mass(), "r": damper()},
        "a->t t->b t->a a->i b->r",
        "this one has 1 in and 2 out",
    ),
    "an element with two bonds": (
        {"a": "1", "b": "1", "i": mass()},
        "a->i b->i",
        "i: the I storage has 1 port(s) but 2 bond(s)",
    ),
    "an element without bonds": (
        {"a": "1", "r": damper(), "i": mass()},
        "a->i",
        "r: the R element has 1 port(s) but 0",
    ),
    "a junction without bonds": ({"a": "1", "b": "1", "i": mass()}, "a->i", "b: 1-junction without bonds"),
    "a field with a bond missing": (
        {"a": "1", "c": ("C", {"ports": 2, "energy": "displacement1**2 + displacement2**2"})},
        "a->c",
        "2 port(s) but 1 bond(s)",
    ),
    "a signal of a node that does not exist": (
        {"shaft": "1", "i": mass(), "r": ("R", {"effort": "b*flow(shfat)"})},
        "shaft->i shaft->r",
        "did you mean 'shaft'?",
    ),
    "the effort of a 1-junction": (
        {"shaft": "1", "i": mass(), "r": ("R", {"effort": "b*effort(shaft)"})},
        "shaft->i shaft->r",
        "the bonds of a 1-junction differ in effort",
    ),
    "the displacement of an inertance": (
        {"v": "1", "i": mass(), "r": ("R", {"effort": "b*displacement(i)"})},
        "v->i v->r",
        "i is an I, only a C has a displacement",
    ),
    "a port that an element does not have": (
        {"v": "1", "i": mass(), "r": ("R", {"effort": "b*flow3(i)"})},
        "v->i v->r",
        "i has one port - write flow(i)",
    ),
    "a port that is not said": (
        {"v": "1", "w": "1", "i": mass(), "t": ("TF", {"modulus": "k"}), "r": ("R", {"effort": "b*flow(t)"})},
        "v->i v->t t->w w->r",
        "t has 2 ports - write flow1(t)",
    ),
    "two states of one name": (
        {
            "v": "1",
            "i": ("I", {"flow": "momentum", "state": "x"}),
            "c": ("C", {"effort": "displacement", "state": "x"}),
        },
        "v->i v->c",
        "c: state 'x' is taken by i",
    ),
    "a state named as a parameter": (
        {"v": "1", "i": ("I", {"flow": "momentum/m", "state": "m"})},
        "v->i",
        "state 'm' is taken",
    ),
    "no nodes": ({}, "", "the graph has no nodes"),
}


@pytest.mark.parametrize("name", DECLARATIONS)
def test_what_is_known_only_at_the_end_is_refused_before_causality(name):
    nodes, bonds, text = DECLARATIONS[name]
    error = refused(graph(nodes, bonds, VALUES))
    assert isinstance(error, DeclarationError) and text in error.message


def test_domains_do_not_mix():
    g = BondGraph("mixed")
    wheel, body = g.one_junction("wheel", ROTATION), g.one_junction("body", TRANSLATION)
    g.bond(wheel, body)
    g.inertance("mass", 1.0, at=body)
    error = refused(g)
    assert isinstance(error, DeclarationError)
    assert error.message == (
        "mixed: bond wheel -> body joins rotation and translation; put a transformer or gyrator between them"
    )


def test_an_unknown_storage_cannot_be_preferred():
    with pytest.raises(CausalityError, match="no storage 'kk'; did you mean 'k'"):
        assign_causality(graph({"v": "1", "k": spring()}, "v->k", VALUES), ["kk"])


def test_a_field_whose_laws_do_not_determine_what_is_asked():
    """The effort of port 1 does not depend on its own displacement: it cannot be imposed while port 2 is a state."""
    nodes = {
        "s": force("1"),
        "a": "0",
        "c": ("C", {"ports": 2, "laws": ["k*displacement2", "k*displacement1"]}),
        "b": "1",
        "m": mass(),
    }
    error = refused(graph(nodes, "s->a a->c b->c b->m", VALUES))
    assert isinstance(error, DerivationError) and "C c do not determine displacement1(c)" in error.message


@pytest.mark.parametrize(
    ("unit", "law", "text"),
    [
        ("kg/m", lambda c, v: c * v, "aero: effort must be kg m s^-2 but c*flow is kg s^-1"),
        ("N s/m", lambda c, v: c * v + v, "aero: c*flow + flow adds"),
        ("N", lambda c, v: c * sympy.tanh(v * c), "aero: tanh(c*flow) needs a pure number but c*flow is"),
    ],
)
def test_a_wrong_unit_is_found_with_its_element(unit, law, text):
    g = BondGraph("car")
    m, c = g.parameter("m", 900.0, "kg"), g.parameter("c", 0.4, unit)
    body = g.one_junction("body", TRANSLATION)
    g.inertance("mass", m, at=body)
    g.resistance("aero", lambda v: law(c, v), at=body)
    error = refused(g)
    assert isinstance(error, DimensionError) and text in error.message and error.where == ("aero",)
