"""The builder: what each line declares, and what it refuses at that line."""

from __future__ import annotations

import copy
import pickle

import pytest
import sympy

from bondgraph.declare.domains import DOMAINS, ELECTRICAL, ROTATION, TRANSLATION, Domain, domain_named
from bondgraph.declare.elements import Bond, Node, allowed_laws, own_variables
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.quantities import Input, Parameter, symbol
from bondgraph.declare.switching import positive_part
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.errors import DeclarationError


def law(g: BondGraph, name: str) -> dict[str, str]:
    return {given: str(expression) for given, expression in g.nodes[name].laws}


def test_elements_take_functions_expressions_or_coefficients():
    g = BondGraph("g")
    b = g.parameter("b", 2.0, "")
    g.resistance("coefficient", b)
    g.resistance("number", 2.5)
    g.resistance("function", lambda v: b * v**3)
    g.resistance("inverse", flow=lambda e: e / b)
    g.resistance("conductance", flow=b)
    g.resistance("both", lambda v: b * v, flow=lambda e: e / b)
    g.resistance("implicit", residual=lambda e, f: e - f**3)
    g.compliance("stiffness", b)
    g.compliance("spring", lambda q: b * q**3)
    g.compliance("soft", displacement=lambda e: e / b)
    g.compliance("capacity", displacement=b)
    g.inertance("mass", b)
    g.inertance("weight", momentum=b)
    g.inertance("fast", lambda p: p / sympy.sqrt(1 + p**2))
    g.inertance("slow", momentum=lambda f: b * f)
    g.inertance("given", flow=lambda p: p / b, momentum=lambda f: b * f)
    assert law(g, "coefficient") == {"effort": "b*flow", "flow": "effort/b"}
    assert law(g, "number") == {"effort": "2.5*flow", "flow": "0.4*effort"}
    assert law(g, "function") == {"effort": "b*flow**3"}
    assert law(g, "inverse") == {"flow": "effort/b"}
    assert law(g, "conductance") == {"effort": "flow/b", "flow": "b*effort"}
    assert law(g, "both") == {"effort": "b*flow", "flow": "effort/b"}
    assert law(g, "implicit") == {"residual": "effort - flow**3"}
    assert law(g, "stiffness") == {"effort": "b*displacement"}
    assert law(g, "capacity") == {"effort": "displacement/b", "displacement": "b*effort"}
    assert law(g, "weight") == {"flow": "momentum/b", "momentum": "b*flow"}
    assert law(g, "spring") == {"effort": "b*displacement**3"}
    assert law(g, "soft") == {"displacement": "effort/b"}
    assert law(g, "mass") == {"flow": "momentum/b"}
    assert law(g, "fast") == {"flow": "momentum/sqrt(momentum**2 + 1)"}
    assert law(g, "slow") == {"momentum": "b*flow"}
    assert law(g, "given") == {"flow": "momentum/b", "momentum": "b*flow"}


def test_bonds_point_the_way_of_power_through_sources_junctions_and_elements():
    g = BondGraph("g")
    a, b = g.one_junction("a"), g.zero_junction("b")
    g.effort_source("s", 1, at=a)
    g.transformer("t", 2, a, b)
    g.compliance("c", 1, at=b)
    g.field("C", "f", energy=lambda x, y: x**2 + y**2, at=(a, b))
    assert list(map(str, g.bonds)) == ["s -> a", "a -> t", "t -> b", "b -> c", "a -> f", "b -> f"]
    assert g.incidence()["t"] == [(1, True), (2, False)]


def test_handles_read_signals_of_ports():
    handle = Handle("gear", "TF", ROTATION)
    assert str(handle.flow) == "flow(gear)" and str(handle.port(2).effort) == "effort2(gear)"
    assert str(handle.port(1).displacement) == "displacement1(gear)" and str(handle.momentum) == "momentum(gear)"


REFUSED = {
    "a name twice": (lambda g: (g.parameter("x", 1, ""), g.input("x", "")), "x is declared twice"),
    "a node twice": (lambda g: (g.one_junction("x"), g.zero_junction("x")), "node x is declared twice"),
    "a part twice": (lambda g: (g.include("x", BondGraph("p")), g.include("x", BondGraph("p"))), "x is declared twice"),
    "an output twice": (lambda g: (g.measure("x", 1, ""), g.measure("x", 2, "")), "output x is declared twice"),
    "a bad name": (lambda g: g.parameter("two words", 1, ""), "use letters, digits and underscores"),
    "a bad node name": (lambda g: g.one_junction("two words"), "use letters, digits and underscores"),
    "a bond as a name": (lambda g: g.zero_junction("air -> room"), "underscores, such as 'air_room'"),
    "a bond as a parameter": (lambda g: g.parameter("air -> room", 1, ""), "underscores, such as 'air_room'"),
    "a bond as a place": (lambda g: g.resistance("loss", 1.0, at="air -> room"), "that is a bond: name the junction"),
    "a bond that is measured": (lambda g: g.measure_effort("T", "air -> room"), "that is a bond: name the junction"),
    "a bond in one text": (lambda g: g.bond("air -> room"), "give both nodes, such as bond('air', 'room')"),
    "time": (lambda g: g.parameter("t", 1, ""), "reserved for time"),
    "a reserved word of elements": (lambda g: g.input("displacement2", ""), "reserved for time, pi and the elements'"),
    "no number": (lambda g: g.parameter("x", float("inf"), ""), "value inf must be a finite number"),
    "a value out of bounds": (
        lambda g: g.parameter("x", 3, "m", bounds=(0, 1)),
        "value 3.0 m lies outside its bounds (0.0, 1.0)",
    ),
    "a tolerance in percent": (
        lambda g: g.parameter("x", 3, "m", tolerance=4),
        "x: tolerance 4 must be a share of the value, from 0 (exact) to below 1 - give 0.04 for four percent",
    ),
    "a tolerance below zero": (lambda g: g.parameter("x", 3, "m", tolerance=-0.1), "tolerance -0.1 must be a share"),
    "bounds the wrong way round": (lambda g: g.parameter("x", 3, "m", bounds=(5, 1)), "the lower first"),
    "an unknown symbol": (lambda g: g.resistance("r", sympy.Symbol("b", real=True)), "'b' is not declared"),
    "a symbol of another kind": (lambda g: g.measure("y", sympy.Symbol("x", real=True), ""), "'x' is not declared"),
    "own variables outside": (lambda g: g.measure("y", symbol("flow"), ""), "uses 'flow' but may use none"),
    "another's variable": (lambda g: g.resistance("r", lambda f: symbol("displacement")), "may use flow"),
    "an unknown table": (
        lambda g: g.measure("y", other_table()(1.0), ""),
        "table 'curve' is not declared in this graph",
    ),
    "an unknown node": (lambda g: (g.one_junction("shaft"), g.bond("shaft", "shfat")), "did you mean 'shaft'?"),
    "an unknown measured node": (
        lambda g: (g.one_junction("shaft"), g.measure_flow("y", "shfat")),
        "did you mean 'shaft'?",
    ),
    "an unknown part": (lambda g: g.exchange("axle", BondGraph("p")), "no part 'axle'"),
    "a port that leads nowhere": (lambda g: g.include("a", BondGraph("p"), {"hub": "j"}), "p has no node 'j'"),
    "a bound name that does not exist": (
        lambda g: g.include("a", BondGraph("p"), bind={"k": 1}),
        "p has no input or parameter 'k'",
    ),
    "an initial value that is no number": (lambda g: g.compliance("c", 1, initial=float("nan")), "must be finite"),
    "an element without a law": (
        lambda g: g.resistance("r"),
        "r: an R needs a law - give its effort or flow or residual",
    ),
    "two kinds of law": (
        lambda g: g.resistance("r", 1, residual=lambda e, f: e - f),
        "a residual together with effort and flow",
    ),
    "a condition": (lambda g: g.effort_source("s", symbol("t") > 1), "is a condition, not a value"),
    "an infinite law": (lambda g: g.effort_source("s", sympy.zoo), "no finite real value"),
    "a modulus of zero": (lambda g: g.add_node(Node("t", "TF", laws=(("modulus", sympy.S.Zero),))), "passes no power"),
    "an unknown kind": (lambda g: g.add_node(Node("x", "Q")), "kind 'Q' is not known"),
    "a law of another kind": (
        lambda g: g.add_node(Node("x", "C", laws=(("flow", symbol("t")),))),
        "a C does not give 'flow'",
    ),
    "ports of a one-port": (
        lambda g: g.add_node(Node("x", "Se", ports=2)),
        "only C, I, R and X may have several ports",
    ),
}


def other_table() -> type:
    return BondGraph("other").table("curve", [0, 1], [0, 1])


@pytest.mark.parametrize("name", REFUSED)
def test_a_mistake_is_found_at_its_line(name):
    declare, text = REFUSED[name]
    with pytest.raises(DeclarationError) as caught:
        declare(BondGraph("g"))
    assert text in caught.value.message and caught.value.where
    assert caught.value.message.startswith("g: ")


def test_an_element_that_hangs_nowhere_is_not_kept():
    """A cell of a notebook that was mended and run again said that its element was declared twice."""
    g = BondGraph("g")
    g.zero_junction("air")
    with pytest.raises(DeclarationError, match="is not declared"):
        g.resistance("loss", 1.0, at="are")
    g.resistance("loss", 1.0, at="air")


def test_a_field_needs_one_law_for_each_port():
    g = BondGraph("g")
    a, b = g.one_junction("a"), g.one_junction("b")
    with pytest.raises(
        DeclarationError, match="x: a C with 2 ports needs an energy or 2 laws of one form, but has effort1"
    ):
        g.field("C", "x", [lambda x, y: x + y], at=(a, b))


def test_quantities_keep_what_was_declared():
    g = BondGraph("g", doc=" two\nlines ")
    g.input("u", "V", "voltage", default=3.0)
    g.input("gear", "1", letters={"H": 1, "L": 2})
    g.parameter("k", 1.5, "N/m", "stiffness", (1, 2))
    assert g.inputs == (Input("u", "V", "voltage", 3.0), Input("gear", "1", "", 0.0, "hold", (("H", 1.0), ("L", 2.0))))
    assert g.inputs[1].is_held and not g.inputs[0].is_held
    assert g.parameters == (Parameter("k", 1.5, "N/m", "stiffness", (1.0, 2.0)),) and g.doc == "two\nlines"
    assert "2 nodes" not in repr(g) and g != BondGraph("g")


def test_units_of_measured_variables_come_from_the_domain():
    g = BondGraph("g")
    v = g.one_junction("v", ELECTRICAL)
    g.inertance("l", 1.0, at=v)
    g.measure_flow("i", v)
    g.measure_momentum("p", "l", unit="V s")
    z = g.zero_junction("z", ELECTRICAL)
    g.measure_effort("u", z)
    c = g.add_node(Node("c", "C", ELECTRICAL, laws=(("effort", symbol("displacement")),)))
    g.measure_displacement("q", c)
    assert [output.unit for output in g.outputs] == ["A", "V s", "V", "C"]


def test_units_of_what_is_measured_at_an_element_are_those_of_its_junction():
    """A length at a spring had no unit, and logs in metres were refused."""
    g = BondGraph("g")
    body = g.one_junction("body", TRANSLATION)
    g.inertance("mass", 1.0, at=body)
    g.compliance("spring", 5.0, at=body)
    g.measure_displacement("x", "spring")
    g.measure_effort("pull", "spring")
    g.measure_momentum("p", "mass")
    assert [output.unit for output in g.outputs] == ["m", "N", "N s"]


def test_domains_multiply_to_power_or_say_that_they_do_not():
    for domain in DOMAINS.values():
        assert domain.pseudo == (domain.name == "thermal")
    with pytest.raises(DeclarationError, match=r"domain x: effort \[N\] times flow \[V\] is not a power"):
        Domain("x", "N", "V", "m", "N s", "F", "v")
    assert Domain("x", "N", "V", "m", "N s", "F", "v", pseudo=True).pseudo
    with pytest.raises(DeclarationError, match="did you mean 'rotation'"):
        domain_named("rotaton")


def test_own_variables_of_each_kind():
    assert allowed_laws("I", 1)["residual"] == ("flow", "momentum")
    assert allowed_laws("R", 2)["residual2"] == ("effort1", "effort2", "flow1", "flow2")
    assert own_variables(Node("c", "C", ports=3), "energy") == ("displacement1", "displacement2", "displacement3")
    assert own_variables(Node("x", "X"), "effort1") is None
    assert str(Bond("a", "b")) == "a -> b"


# ---------------------------------------------------------------------- parts


def stage() -> BondGraph:
    """A mass on a spring between two ports."""
    g = BondGraph("stage")
    m, k = g.parameter("m", 2.0, "kg"), g.parameter("k", 3.0, "N/m")
    left, body, right = g.zero_junction("left"), g.one_junction("body"), g.zero_junction("right")
    g.compliance("spring", k, at=left)
    g.bond(left, body)
    g.inertance("mass", m, at=body)
    g.bond(body, right)
    g.resistance("leak", 4.0, at=right)
    g.signal("speed", body.flow, "m/s")
    g.integral("travel", symbol("speed"), "m")
    g.measure("position", symbol("travel"), "m")
    return g


def joined(count: int) -> BondGraph:
    """An array of parts, each bonded to the next."""
    g = BondGraph("array")
    force = g.input("F", "N")
    for i in range(count):
        g.include(f"stage{i}", stage(), {"in": "left", "out": "right"}, {"k": (i + 1) * 10.0})
        if i:
            g.bond(f"stage{i - 1}.out", f"stage{i}.in")
    start = g.one_junction("start")
    g.effort_source("push", force, at=start)
    g.inertance("pusher", 1.0, at=start)
    g.bond(start, "stage0.in")
    return g


def test_parts_are_flattened_with_dotted_names():
    flat = joined(2).flatten()
    assert list(flat.nodes)[:4] == ["stage0.left", "stage0.body", "stage0.right", "stage0.spring"]
    outer = ["stage0.right -> stage1.left", "push -> start", "start -> pusher", "start -> stage0.left"]
    assert [str(bond) for bond in flat.bonds[-4:]] == outer
    assert [p.name for p in flat.parameters] == ["stage0.m", "stage1.m"]
    assert str(flat.nodes["stage1.spring"].laws[0][1]) == "20*displacement"
    assert [o.name for o in flat.outputs] == ["stage0.position", "stage1.position"]
    assert [str(i.of) for i in flat.integrals] == ["stage0.speed", "stage1.speed"]
    states = [state.symbol.name for state in derive(assign_causality(joined(2))).states]
    assert states[:2] == ["q_stage0.spring", "f_stage0.mass"]


def test_parts_within_parts_to_any_depth():
    inner = joined(2)
    outer = BondGraph("outer")
    outer.include("left", inner, {"end": "stage1.out"})
    outer.include("right", BondGraph("empty"))
    wall = outer.one_junction("wall")
    outer.bond("left.end", wall)
    outer.resistance("drag", 2.0, at=wall)
    outer.measure("deep", Handle("left.stage1.mass", "I", None).momentum, "N s")
    outermost = BondGraph("outermost")
    outermost.include("machine", outer)
    outermost.measure("deeper", Handle("machine.left.stage0.spring", "C", None).displacement, "m")
    flat = outermost.flatten()
    assert "machine.left.stage1.mass" in flat.nodes and "machine.wall" in flat.nodes
    assert str(flat.bonds[-2]) == "machine.left.stage1.right -> machine.wall"
    equations = derive(assign_causality(outermost))
    outputs = {output.symbol.name: str(output.expression) for output in equations.outputs}
    assert outputs["deeper"] == "q_machine.left.stage0.spring"
    assert outputs["machine.deep"].count("f_machine.left.stage1.mass") == 1
    assert len(equations.states) == 7


def test_a_part_may_be_exchanged_by_name():
    g = joined(2)
    stiff = stage()
    stiff.resistance("damper", 5.0, at="body")
    before = [str(bond) for bond in g.bonds]
    g.exchange("stage0", stiff)
    assert "stage0.damper" in g.flatten().nodes and "stage1.damper" not in g.flatten().nodes
    assert [str(bond) for bond in g.bonds] == before and [part.name for part in g.subgraphs] == ["stage0", "stage1"]
    assert dict(g.subgraphs[0].bind)["k"] == 10
    with pytest.raises(DeclarationError, match="other has no node 'left'"):
        g.exchange("stage1", BondGraph("other"))
    assert [part.name for part in g.subgraphs] == ["stage0", "stage1"]


def test_a_part_used_twice_is_not_shared():
    part = stage()
    g = BondGraph("twins")
    a, b = g.include("a", part), g.include("b", part)
    assert a.graph is b.graph
    g.bond("a.right", "b.left")
    equations = derive(assign_causality(g))
    assert len(equations.states) == 6 and len({state.symbol for state in equations.states}) == 6


def test_tables_of_parts_keep_apart():
    def part(values: list[float]) -> BondGraph:
        g = BondGraph("part")
        curve = g.table("curve", [0.0, 1.0], values)
        v = g.one_junction("v")
        g.inertance("m", 1.0, at=v)
        g.resistance("r", lambda f: curve(f) + curve(2 * f), at=v)
        return g

    g = BondGraph("g")
    g.include("a", part([0.0, 1.0]))
    g.include("b", part([0.0, 5.0]))
    equations = derive(assign_causality(g))
    assert [(table.name, table.values) for table in equations.tables] == [
        ("a.curve", (0.0, 1.0)),
        ("b.curve", (0.0, 5.0)),
    ]
    assert "b.curve(2*f_b.m)" in str([step.expression for step in equations.assignments])


def test_switches_may_be_used_in_any_law():
    g = BondGraph("g")
    v = g.one_junction("v")
    g.inertance("m", 1.0, at=v)
    g.resistance("r", lambda f: positive_part(f, 0.1), at=v)
    assert law(g, "r") == {"effort": "flow*switch(flow, 0.1)"}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("capacitance", "a BondGraph has no 'capacitance'; it is called compliance(name, displacement=C) here"),
        ("add_bond", "a BondGraph has no 'add_bond'; it is called bond here"),
        ("R", "a BondGraph has no 'R'; it is called resistance here"),
        ("resistence", "a BondGraph has no 'resistence'; did you mean 'resistance'?"),
        ("zzzzzz", "a BondGraph has no 'zzzzzz'"),
    ],
)
def test_a_name_of_other_tools_is_told_ours(name, message):
    with pytest.raises(AttributeError) as refused:
        getattr(BondGraph("g"), name)
    assert str(refused.value).startswith(message)


def test_a_graph_is_copied_though_it_answers_to_names_it_lacks():
    g = BondGraph("g")
    g.one_junction("v", TRANSLATION)
    assert [*copy.deepcopy(g).nodes] == [*pickle.loads(pickle.dumps(g)).nodes] == ["v"]
    assert not hasattr(g, "to_dataframe")
