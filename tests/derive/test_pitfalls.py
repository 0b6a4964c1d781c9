"""Shapes of graphs that trip up derivations."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import check_closed, derive
from bondgraph.derive.equations import Assignment, ImplicitLoop
from bondgraph.generate.module import render
from tests.derive.compare import compare, loaded
from tests.derive.spec import assigned, damper, derivatives, force, graph, mass, outputs, same, speed, spring


def test_junctions_with_two_bonds_and_with_one():
    nodes = {"F": force(), "a": "1", "b": "0", "c": "1", "d": "0", "m": mass(), "e": "1", "end": "0", "k": spring()}
    g = graph(nodes, "F->a a->b b->c c->d d->m k->e e->c end->b", {"m": 2.0, "k": 3.0}, "u")
    assert same(derivatives(g), f_m="(u + k*q_k)/m", q_k="-f_m")
    assert compare(g) == ""


def test_a_junction_with_one_bond_lets_nothing_through():
    blocked = graph({"v": "1", "m": mass(), "z": "0"}, "v->m v->z", {"m": 2.0})
    assert derivatives(blocked) == {} and compare(blocked) == ""
    loose = graph({"z": "0", "k": spring(), "v": "1"}, "z->k z->v", {"k": 2.0})
    assert derivatives(loose) == {} and compare(loose) == ""


def test_a_junction_with_outgoing_bonds_only():
    nodes = {"v": "1", "m": mass(), "k": spring(), "b": damper()}
    assert same(
        derivatives(graph(nodes, "v->m v->k v->b", {"m": 1, "k": 2, "b": 3})), f_m="-(k*q_k + b*f_m)/m", q_k="f_m"
    )


def test_a_junction_with_incoming_bonds_only():
    g = graph({"v": "1", "m": mass(), "k": spring(), "F": force()}, "m->v k->v F->v", {"m": 1, "k": 2}, "u")
    assert same(derivatives(g), f_m="-(u + k*q_k)/m", q_k="f_m")
    assert compare(g) == ""


def test_meshes_in_the_junction_structure():
    nodes = {
        "s": speed(), "z": "0", "a": "1", "b": "1", "y": "0", "C": spring("1/C"),
        "Ra": damper("Ra"), "Rb": damper("Rb"),
    }  # fmt: skip
    g = graph(
        nodes,
        "s->z z->a a->Ra a->y z->b b->Rb b->y y->C",
        {"C": 1, "Ra": 2, "Rb": 3},
        "u",
        outputs=[{"name": "i_a", "variable": "flow", "at": "a"}],
    )
    assert same(derivatives(g), q_C="u")
    assert same(outputs(g), i_a="u*Rb/(Ra + Rb)")


@pytest.mark.parametrize(("source", "junction", "store"), [(force(), "1", mass()), (speed(), "0", spring("1/m"))])
def test_a_reversed_source_drives_the_other_way(source, junction, store):
    state = "f_x" if junction == "1" else "q_x"
    along = derivatives(graph({"s": source, "j": junction, "x": store}, "s->j j->x", {"m": 2}, "u"))[state]
    against = derivatives(graph({"s": source, "j": junction, "x": store}, "j->s j->x", {"m": 2}, "u"))[state]
    assert along != 0 and against == -along


@pytest.mark.parametrize(("bonds", "sign"), [("v->m v->b", -1), ("v->m b->v", -1), ("m->v v->b", -1)])
def test_passive_elements_do_not_care_which_way_their_bond_points(bonds, sign):
    found = derivatives(graph({"v": "1", "m": mass(), "b": damper()}, bonds, {"m": 1, "b": 3}))
    assert same(found, f_m="-b*f_m/m")


def test_the_flow_of_a_source_as_a_signal_counts_along_its_bond():
    wanted = [{"name": "i", "variable": "flow", "at": "s"}]
    nodes = {"s": force(), "j": "1", "R": damper("R")}
    assert same(outputs(graph(nodes, "s->j j->R", {"R": 2}, "u", outputs=wanted)), i="u/R")
    nodes = {"s": speed(), "z": "0", "R": damper("R")}
    assert same(outputs(graph(nodes, "s->z z->R", {"R": 2}, "u", outputs=wanted)), i="u")


def test_a_transformer_bonded_to_a_source_and_to_an_element():
    nodes = {"s": force(), "t": ("TF", {"modulus": "n"}), "R": damper("R")}
    g = graph(nodes, "s->t t->R", {"n": 2, "R": 3}, "u", outputs=[{"name": "i", "variable": "flow", "at": "R"}])
    assert same(outputs(g), i="u/(n*R)")
    assert compare(g) == ""


def test_elements_bonded_to_each_other():
    assert same(derivatives(graph({"s": force(), "m": mass()}, "s->m", {"m": 2}, "u")), f_m="u/m")
    assert same(derivatives(graph({"C": spring(), "m": mass()}, "C->m", {"m": 2, "k": 3})), q_C="-f_m", f_m="k*q_C/m")
    assert same(derivatives(graph({"C": spring(), "R": damper()}, "R->C", {"b": 2, "k": 3})), q_C="-k*q_C/b")


def test_a_storage_on_a_zero_source_stays_empty():
    nodes = {"s": ("Se", {"effort": "0"}), "z": "0", "C": spring("1/C"), "F": speed()}
    g = graph(nodes, "s->z z->C F->z", {"C": 2}, "u", outputs=[{"name": "q", "variable": "displacement", "at": "C"}])
    assert derivatives(g) == {} and outputs(g)["q"] == 0
    assert compare(g) == ""


def test_a_graph_without_states_has_outputs():
    g = graph(
        {"s": force(), "v": "1", "R": damper("R")},
        "s->v v->R",
        {"R": 2},
        "u",
        outputs=[{"name": "i", "variable": "flow", "at": "v"}],
    )
    equations = derive(assign_causality(g))
    module = loaded(equations)
    assert module["STATES"] == () and module["rhs"](0.0, np.zeros(0), np.array([3.0]), np.array([2.0])).shape == (0,)
    np.testing.assert_allclose(module["output"](0.0, np.zeros(0), np.array([3.0]), np.array([2.0])), [1.5])


def test_a_storage_that_follows_an_input_makes_its_rate_an_input():
    g = graph(
        {"s": speed(), "v": "1", "m": mass(), "b": damper()},
        "s->v v->m v->b",
        {"m": 2, "b": 3},
        "u",
        outputs=[{"name": "F", "variable": "effort", "at": "s"}],
    )
    equations = derive(assign_causality(g))
    assert [(given.name, given.meaning) for given in equations.inputs] == [
        ("u", ""), ("d_u", "rate of u (a storage depends on it)"),
    ]  # fmt: skip
    assert same(outputs(g), F="m*d_u + b*u")
    assert compare(g) == ""


def test_the_rate_of_a_held_input_is_zero():
    g = BondGraph("held")
    gear = g.input("gear", "1", letters={"low": 20.0, "high": 10.0})
    v = g.one_junction("v")
    g.flow_source("s", gear, at=v)
    g.inertance("m", 2.0, at=v)
    g.measure_effort("F", "m")
    assert outputs(g)["F"] == 0 and [given.name for given in derive(assign_causality(g)).inputs] == ["gear"]


def test_a_rate_of_time_is_one():
    g = graph(
        {"s": speed("a*t**2"), "v": "1", "m": mass()},
        "s->v v->m",
        {"m": 2, "a": 3},
        outputs=[{"name": "F", "variable": "effort", "at": "m"}],
    )
    assert same(outputs(g), F="2*a*m*t")


@pytest.mark.parametrize("exponent", [-7, -3, 0, 3, 7])
def test_parameters_over_fourteen_decades(exponent):
    value = 10.0**exponent
    nodes = {"F": force(), "v": "1", "m": mass(), "z": "0", "k": spring(), "w": "1", "b": damper(), "M": mass("M")}
    g = graph(nodes, "F->v v->m v->z z->k z->w w->b w->M", {"m": value, "k": 1 / value, "b": value**0.5, "M": 3.0}, "u")
    module = loaded(derive(assign_causality(g)))
    theta = np.array([value, 1 / value, value**0.5, 3.0])
    found = module["rhs"](0.0, np.array([0.3, -0.2, 0.7]), np.array([1.1]), theta)
    spring_force = -0.2 / value
    expected = [(1.1 - spring_force) / value, 0.3 - 0.7, (spring_force - value**0.5 * 0.7) / 3.0]
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_an_element_a_parameter_a_state_and_an_input_of_the_same_name():
    nodes = {"u": force("u"), "m": "1", "k": ("I", {"flow": "momentum/m"}), "q_k": spring("k"), "f_k": damper("q_k")}
    g = graph(nodes, "u->m m->k m->q_k m->f_k", {"m": 2, "k": 3, "q_k": 5, "f_k": 7}, "u")
    found = derivatives(g)
    assert len(set(found)) == 2 and compare(g) == ""
    states = [state.symbol.name for state in derive(assign_causality(g)).states]
    assert not set(states) & {"u", "m", "k", "q_k", "f_k"}


def test_states_of_different_elements_never_share_a_name():
    nodes = {"a": "1", "x1": spring(), "m": mass(), "b": "1", "M": mass()}
    nodes["x"] = ("C", {"ports": 2, "energy": "displacement1**2 + displacement2**2"})
    g = graph(nodes, "a->x1 a->x b->x a->m b->M", {"k": 2, "m": 1})
    states = [state.symbol.name for state in derive(assign_causality(g)).states]
    assert len(set(states)) == len(states) == 5
    assert compare(g) == ""


def test_python_keywords_as_names():
    nodes = {"lambda": "1", "class": mass("import"), "if": damper("for")}
    wanted = [{"name": "del", "is": "flow(lambda)*for"}]
    g = graph(nodes, "lambda->class lambda->if", {"import": 2, "for": 3}, outputs=wanted)
    module = loaded(derive(assign_causality(g)))
    np.testing.assert_allclose(module["rhs"](0.0, np.array([4.0]), np.zeros(0), np.array([2.0, 3.0])), [-6.0])
    np.testing.assert_allclose(module["output"](0.0, np.array([4.0]), np.zeros(0), np.array([2.0, 3.0])), [12.0])


def test_parallel_bonds_through_two_transformers_are_numbered_in_the_outputs():
    nodes = {"a": "1", "m": mass(), "z": "0", "k": spring(), "t": ("TF", {"modulus": "n"})}
    g = graph(nodes, "a->m a->z a->t t->z z->k", {"m": 1, "k": 2, "n": 0.5})
    assert same(derivatives(g), f_m="-k*q_k*(1 + n)/m", q_k="f_m*(1 + n)")
    field = {"a": "1", "m": mass(), "f": ("C", {"ports": 2, "energy": "k*(displacement1 + displacement2)**2/2"})}
    g = graph(field, "a->m a->f a->f", {"m": 1, "k": 2})
    assert same(derivatives(g), f_m="-2*k*(q_f1 + q_f2)/m", q_f1="f_m", q_f2="f_m")
    names = [output.symbol.name for output in derive(assign_causality(g), bonds=True).outputs]
    assert names == [f"{v}({b})" for v in ("effort", "flow") for b in ("a->m", "a->f", "a->f#2")]


def long_chain(links: int, pattern: str) -> BondGraph:
    """A source at one end of a long chain of alternating junctions and two-ports, with sinks on the way."""
    g = BondGraph("long")
    u, r = g.input("u", ""), g.parameter("r", 2.0, "")
    before = g.one_junction("start")
    g.effort_source("s", u, at=before)
    for i in range(links):
        kind = pattern[i % len(pattern)]
        after = g.zero_junction(f"z{i}") if kind in "0g" else g.one_junction(f"o{i}")
        if kind == "t":
            g.transformer(f"t{i}", r, before, after)
        elif kind == "g":
            g.gyrator(f"g{i}", r, before, after)
        else:
            g.bond(before, after)
        before = after
    g.inertance("m", r, at=before)
    g.measure("last", before.flow if before.kind == "1" else before.effort, "")
    return g


@pytest.mark.parametrize("pattern", ["01", "t", "t0t1", "g01"])
def test_long_chains_need_no_recursion(pattern):
    g = long_chain(450, pattern)
    equations = derive(assign_causality(g), bonds=True)
    check_closed(equations)
    assert len(render(equations)) > 1000


def test_a_long_chain_without_states_stays_small():
    """Every stage uses the one before; without names the last expression would hold all of them."""
    g = BondGraph("stages")
    r, n = g.parameter("r", 2.0, ""), g.parameter("n", 1.01, "")
    value = g.input("u", "")
    for i in range(300):
        z = g.one_junction(f"v{i}")
        g.effort_source(f"s{i}", value, at=z)
        g.resistance(f"r{i}", r, at=z)
        value = z.flow * n + i
    g.measure("last", z.flow, "")
    equations = derive(assign_causality(g))
    text = render(equations)
    assert len(text) < 40_000 and max(map(len, text.splitlines())) < 400
    found = loaded(equations)["output"](0.0, np.zeros(0), np.array([1.0]), np.array([2.0, 1.01]))
    expected = 1.0
    for i in range(300):
        flow = expected / 2.0
        expected = flow * 1.01 + i
    np.testing.assert_allclose(found, [flow], rtol=1e-13)


def test_a_junction_with_very_many_bonds():
    g = BondGraph("star")
    v = g.one_junction("v")
    g.inertance("m", 1.0, at=v)
    for i in range(1500):
        g.resistance(f"r{i}", 2.0, at=v)
    assert same(derivatives(g), f_m="-3000*f_m")


def test_named_signals_keep_their_names():
    signals = [{"name": "slip", "is": "flow(a) - flow(b)"}, {"name": "unused", "is": "slip**2"}]
    nodes = {
        "a": "1",
        "b": "1",
        "ma": mass(),
        "mb": mass(),
        "ra": ("R", {"effort": "c*flow*tanh(slip)"}),
        "rb": ("R", {"effort": "c*slip*flow"}),
    }
    g = graph(nodes, "a->ma b->mb a->ra b->rb", {"m": 1, "c": 2}, signals=signals)
    assert "slip" in assigned(g)
    assert compare(g) == ""


def test_modulation_by_efforts_and_flows_of_elements_and_by_displacements():
    nodes = {
        "F": force(), "v": "1", "m": mass(), "k": ("C", {"effort": "k*displacement"}),
        "b": ("R", {"effort": "b*flow*(1 + effort(k)**2)"}), "t": ("TF", {"modulus": "2 + sin(displacement(k))"}),
        "w": "1", "r": ("R", {"effort": "(b + flow(b)**2)*flow"}), "M": mass(),
        "s": ("Se", {"effort": "k*momentum(m)"}),
    }  # fmt: skip
    g = graph(nodes, "F->v v->m v->k v->b v->t t->w w->r w->M s->w", {"m": 1.5, "k": 2, "b": 0.3}, "u")
    assert [compare(g, seed) for seed in range(3)] == ["", "", ""]


def test_a_sensor_of_every_kind_is_an_output():
    nodes = {"F": force(), "v": "1", "m": mass(), "z": "0", "k": spring(), "b": damper()}
    wanted = [
        {"name": "a", "variable": "effort", "at": "m"}, {"name": "b", "variable": "flow", "at": "b"},
        {"name": "c", "variable": "displacement", "at": "k"}, {"name": "d", "variable": "momentum", "at": "m"},
        {"name": "e", "variable": "effort", "at": "z"}, {"name": "f", "is": "2*flow(v) + t"},
    ]  # fmt: skip
    g = graph(nodes, "F->v v->m v->z z->k z->b", {"m": 2, "k": 3, "b": 4}, "u", outputs=wanted)
    assert same(outputs(g), a="u - k*q_k", b="k*q_k/b", c="q_k", d="m*f_m", e="k*q_k", f="2*f_m + t")


def test_a_controller_of_signals_and_an_integral():
    nodes = {"drive": ("Se", {"effort": "torque"}), "w": "1", "J": mass("J"), "b": damper()}
    signals = [{"name": "error", "is": "u - flow(w)"}, {"name": "torque", "is": "kp*error + ki*sum_of_error"}]
    integrals = [{"name": "sum_of_error", "of": "error", "initial": 0.5}]
    g = graph(
        nodes, "drive->w w->J w->b", {"J": 1, "b": 2, "kp": 3, "ki": 4}, "u", signals=signals, integrals=integrals
    )
    assert same(derivatives(g), f_J="(kp*(u - f_J) + ki*sum_of_error - b*f_J)/J", sum_of_error="u - f_J")
    assert derive(assign_causality(g)).states[1].initial == 0.5


def test_laws_that_are_steps_have_no_pulses_in_their_rates():
    nodes = {"s": speed("b*sign(u)*u + abs(u)"), "v": "1", "m": mass()}
    g = graph(nodes, "s->v v->m", {"b": 3, "m": 2}, "u", outputs=[{"name": "F", "variable": "effort", "at": "m"}])
    assert same(outputs(g), F="m*d_u*(b*sign(u) + sign(u))")


def test_everything_an_assignment_uses_is_known_before():
    nodes = {
        "s": force(),
        "a": "1",
        "d": ("R", {"flow": "i*(exp(effort/v) - 1)"}),
        "r": damper(),
        "z": "0",
        "k": spring(),
    }
    equations = derive(
        assign_causality(graph(nodes, "s->a a->d a->r a->z z->k", {"i": 1e-6, "v": 0.05, "b": 2, "k": 3}, "u"))
    )
    check_closed(equations)
    assert any(isinstance(step, ImplicitLoop) for step in equations.assignments)
    assert all(isinstance(step, Assignment | ImplicitLoop) for step in equations.assignments)


def test_tables_in_two_arguments_go_through_derivation_and_rates():
    """A map that is a plane, so that the interpolant is exact, imposed on a dependent mass."""
    g = BondGraph("map")
    u = g.input("u", "")
    plane = g.table(
        "plane", [-2.0, 0.5, 3.0], [[2 * x - 3 * y for y in (-4.0, 4.0)] for x in (-2.0, 0.5, 3.0)], y=[-4.0, 4.0]
    )
    v, w = g.one_junction("v"), g.one_junction("w")
    g.compliance("k", g.parameter("k", 5.0, ""), at=w)
    g.inertance("M", g.parameter("M", 2.0, ""), at=w)
    g.flow_source("s", plane(u, w.flow), at=v)
    g.inertance("m", g.parameter("m", 0.7, ""), at=v)
    g.measure("force", Handle("m", "I", None).effort, "")
    equations = derive(assign_causality(g))
    found = loaded(equations)["output"](0.0, np.array([0.3, 0.4]), np.array([0.2, 0.9]), np.array([5.0, 2.0, 0.7]))
    np.testing.assert_allclose(found, [0.7 * (2 * 0.9 - 3 * (-5.0 * 0.3 / 2.0))], rtol=1e-12)
