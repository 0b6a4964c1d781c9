"""Graph files: written and read again without loss, and what a malformed one is told."""

from __future__ import annotations

import json

import networkx as nx
import pytest

from bondgraph.declare.domains import ELECTRICAL, ROTATION, Domain
from bondgraph.declare.files import graph_from_json, graph_to_json, load_graph, read_graph, to_networkx, write_graph
from bondgraph.declare.graph import BondGraph, ElementType
from bondgraph.errors import BondGraphError, DeclarationError
from tests.derive.random_graphs import RandomGraph

DC_MOTOR = {
    "directed": True,
    "multigraph": True,
    "graph": {
        "format": "bondgraph/1",
        "name": "dc_motor",
        "doc": "armature, gyrator, rotor",
        "inputs": [{"name": "u_a", "unit": "V", "meaning": "armature voltage"}],
        "parameters": [
            {"name": "L_a", "value": 0.01, "unit": "H", "bounds": [0.001, 0.1]},
            {"name": "R_a", "value": 1.0, "unit": "ohm"},
            {"name": "k_m", "value": 0.1, "unit": "N m / A"},
            {"name": "J", "value": 0.02, "unit": "kg m^2"},
            {"name": "b", "value": 0.1, "unit": "N m s"},
        ],
        "outputs": [{"name": "omega", "variable": "flow", "at": "shaft"}],
    },
    "nodes": [
        {"id": "supply", "kind": "Se", "effort": "u_a"},
        {"id": "loop", "kind": "1", "domain": "electrical"},
        {"id": "L", "kind": "I", "flow": "momentum/L_a"},
        {"id": "R", "kind": "R", "effort": "R_a*flow"},
        {"id": "machine", "kind": "GY", "modulus": "k_m"},
        {"id": "shaft", "kind": "1", "domain": "rotation"},
        {"id": "rotor", "kind": "I", "flow": "momentum/J"},
        {"id": "bearing", "kind": "R", "effort": "b*flow"},
    ],
    "bonds": [
        {"source": a, "target": b}
        for a, b in (
            ("supply", "loop"),
            ("loop", "L"),
            ("loop", "R"),
            ("loop", "machine"),
            ("machine", "shaft"),
            ("shaft", "rotor"),
            ("shaft", "bearing"),
        )
    ],
}


def everything() -> BondGraph:
    """One graph with every kind of declaration."""
    magnetic = Domain("magnetic", "A", "Wb/s", "Wb", "A s", "mmf", "flux_rate")
    axle = BondGraph("axle", doc="a shaft with two ends")
    k = axle.parameter("k", 200.0, "N m / rad", "stiffness", (100.0, 300.0))
    speed_up = axle.input("boost", "1", default=1.0)
    twist = axle.zero_junction("twist", ROTATION)
    axle.compliance("spring", k, at=twist, initial=0.1)
    axle.measure("wound", speed_up * axle.signal("torque", twist.effort, "N m"), "N m")
    g = BondGraph("everything", doc="all there is\nin two lines")
    u = g.input("u", "V", "a voltage", default=2.5)
    gear = g.input("gear", "1", letters={"H": 10.0, "L": 22.0})
    held = g.input("held", "A", hold=True)
    a, b = g.parameter("a", 1e-7, "1", "tiny", (0.0, 1.0)), g.parameter("b", 3.0, "1")
    curve = g.table("curve", [0.0, 1.0, 2.5], [1.0, 3.0, 2.0], "V", "A", meaning="a curve")
    surface = g.table("surface", [0, 1], [[1, 2, 3], [4, 5, 6]], "1", ("", "rad/s"), y=[0.0, 0.5, 2.0])
    z, v, w = g.zero_junction("z", ELECTRICAL), g.one_junction("v", ELECTRICAL), g.one_junction("w", ROTATION)
    m = g.one_junction("m", magnetic)
    g.effort_source("se", u + 2 * curve(held), at=v)
    g.flow_source("sf", held, at=z)
    g.bond(v, z)
    g.resistance("both", g.parameter("R", 2.0, "ohm"), at=v)
    g.resistance("cubic", lambda i: b * i**3, at=v)
    g.resistance("implicit", residual=lambda e, f: e - b * f - f**3, at=z, guess=0.3)
    g.compliance("c", lambda q: q / a + q**3, displacement=lambda e: a * e, at=z, initial=1e-6, state="charge")
    g.compliance("inverse", displacement=lambda e: 1e-3 * e, at=z)
    g.inertance("l", residual=lambda f, p: f - p / 2, at=v)
    g.transformer("t", surface(b, w.flow), w, m)
    g.gyrator("gy", gear * b, v, w)
    g.field("I", "coils", energy=lambda p, s: p**2 + p * s / 3 + s**2, at=(v, v), initial=(0.5, 0.0), state="linked")
    g.field("R", "cross", [lambda e, f: e + f / 3, lambda e, f: f + e / 3], form="flow", at=(z, z))
    g.field("R", "bound", [lambda *x: x[0] - x[2], lambda *x: x[1] - x[3]], form="residual", at=(m, w))
    g.field("C", "well", [lambda p, q: p + q / 9, lambda p, q: q + p / 9], at=(z, z))
    g.element(
        "own",
        ElementType({("effort", "flow"): lambda f, e: (f - e, f), ("effort", "effort"): lambda f, g: (g, -f)}),
        at=(v, z),
    )
    g.include("front", axle, {"hub": "twist"}, {"k": 100 * b})
    g.include("rear", axle)
    g.bond(w, "front.hub")
    g.bond("rear.twist", w)
    g.integral("angle", lambda x: w.flow - x / 100, "rad", "turned so far", initial=0.25)
    slip = g.signal("slip", w.flow - 0.5 * b, "rad/s", "difference of speeds")
    g.measure_flow("omega", w, "a speed")
    g.measure_effort("torque", "front.spring", unit="N m")
    g.measure("doubled", 2 * slip, "rad/s")
    return g


def test_every_declaration_survives_a_file(tmp_path):
    g = everything()
    write_graph(g, tmp_path / "everything.json")
    again = read_graph(tmp_path / "everything.json")
    assert again == g
    assert again.source == "everything.json"
    write_graph(again, tmp_path / "again.json")
    assert (tmp_path / "again.json").read_text() == (tmp_path / "everything.json").read_text()


@pytest.mark.parametrize("linear", [True, False])
def test_random_graphs_survive_a_file(linear):
    for seed in range(80_000, 80_040):
        g = RandomGraph(seed, linear=linear, mesh=0.2).graph
        assert graph_from_json(json.loads(json.dumps(graph_to_json(g)))) == g, seed


def test_a_file_is_what_networkx_writes_and_reads():
    g = graph_from_json(DC_MOTOR)
    assert graph_to_json(g)["nodes"] == DC_MOTOR["nodes"]
    assert graph_to_json(g)["bonds"] == DC_MOTOR["bonds"]
    network = nx.node_link_graph(graph_to_json(g), edges="bonds", directed=True, multigraph=True)
    assert list(network.edges()) == [(bond.source, bond.target) for bond in g.bonds]
    assert network.graph["name"] == "dc_motor" and network.nodes["R"]["effort"] == "R_a*flow"
    written = nx.node_link_data(to_networkx(g), edges="bonds")
    assert graph_from_json(written) == g


def test_a_graph_function_is_loaded_by_name():
    g = load_graph("tests.declare.test_files:everything")
    assert g.name == "everything" and g.source == "tests/declare/test_files.py"


@pytest.mark.parametrize(
    ("reference", "text"),
    [
        ("nowhere.json", "no such file"),
        ("nowhere", "no such file - give a graph file (motor.json, sled.py, sled.py:name), or module:name"),
        ("bondgraph.nowhere:x", "there is no module 'bondgraph.nowhere'"),
        ("tests.declare.test_files:everythin", "has no function or graph 'everythin'; did you mean 'everything'?"),
        ("os:getcwd", "gives a str, not a BondGraph"),
    ],
)
def test_references_that_lead_nowhere(reference, text):
    with pytest.raises(DeclarationError) as caught:
        load_graph(reference)
    assert text in caught.value.message


@pytest.mark.parametrize("content", ["", "{", "[1, 2", "nonsense", '{"graph": }', "\udcff"])
def test_what_is_not_json_is_told_so(tmp_path, content):
    path = tmp_path / "broken.json"
    path.write_bytes(content.encode("utf-8", "surrogateescape"))
    with pytest.raises(DeclarationError, match=r"broken.json: not JSON"):
        read_graph(path)


def changed(path: list, value) -> dict:
    """The motor with one entry replaced (or added, or removed where the value is the class ``del``)."""
    data = json.loads(json.dumps(DC_MOTOR))
    place = data
    for key in path[:-1]:
        place = place[key]
    if value is delattr:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return data


MALFORMED = [
    (["colour"], 1, "unknown key 'colour'"),
    (["graph", "paramters"], [], "did you mean 'parameters'?"),
    (["nodes"], 5, "nodes must be a list but is 5"),
    (["nodes", 0], "supply", "node 0 'supply' must be an object with an id"),
    (["nodes", 0, "id"], delattr, "must be an object with an id"),
    (["nodes", 0, "id"], 3, "must be an object with an id"),
    (["nodes", 2, "kind"], "L", "kind 'L' is not known"),
    (["nodes", 2, "kind"], delattr, "kind None is not known"),
    (["nodes", 2, "flwo"], "1", "unknown key 'flwo'; did you mean 'flow'?"),
    (["nodes", 2, "flow"], delattr, "L: an I needs a law"),
    (["nodes", 2, "flow"], "flow/L_a", "the law uses 'flow' but may use momentum"),
    (["nodes", 2, "flow"], [1], "expected an expression"),
    (["nodes", 2, "ports"], "two", "ports must be a whole number"),
    (["nodes", 2, "ports"], 0, "ports must be a whole number"),
    (["nodes", 2, "ports"], 2, "unknown key 'flow'; did you mean 'flow2'?"),
    (["nodes", 2, "initial"], "x", "initial x: no input or output 'x'"),
    (["nodes", 2, "initial"], [1, "x"], "initial x: no input or output 'x'"),
    (["nodes", 2, "initial"], ["omega", "x"], "expected a number"),
    (["nodes", 2, "initial"], True, "expected a number"),
    (["nodes", 1, "domain"], "electric", "did you mean 'electrical'?"),
    (["nodes", 1, "domain"], {"name": "x"}, "key 'effort_unit' is missing"),
    (["nodes", 1, "doc"], 3, "doc must be a text"),
    (["nodes", 4, "modulus"], "0", "a modulus of zero passes no power"),
    (["nodes", 4, "ports"], 2, "unknown key 'ports'"),
    (["nodes", 3, "form"], "power", "form 'power' - use effort or flow"),
    (["nodes", 3, "laws"], "R_a", "laws must be a list"),
    (["nodes", 3, "residual"], "effort - flow", "a residual together with effort"),
    (["nodes", 5, "id"], "loop", "declared twice"),
    (["nodes", 5, "id"], "a shaft", "use letters, digits and underscores"),
    (["bonds", 0, "target"], "lop", "node 'lop' is not declared; did you mean 'loop'?"),
    (["bonds", 0, "target"], delattr, "'target' is missing"),
    (["bonds", 0], "supply->loop", "expected an object"),
    (["bonds", 0, "target"], "supply", "joins a node with itself"),
    (["bonds"], {}, "bonds must be a list"),
    (["graph"], [], "expected an object"),
    (["graph", "format"], "bondgraph/2", "is not 'bondgraph/1'"),
    (["directed"], False, "must be a directed multigraph"),
    (["graph", "inputs", 0, "name"], "t", "reserved for time"),
    (["graph", "inputs", 0, "name"], "effort", "reserved"),
    (["graph", "inputs", 0, "name"], 3, "name must be a text"),
    (["graph", "inputs", 0, "unit"], "Vlt", "unit 'Vlt' is not known"),
    (["graph", "inputs", 0, "default"], "x", "expected a number"),
    (["graph", "inputs", 0, "interpolation"], "cubic", "use linear, hold, band limited"),
    (["graph", "inputs", 0, "letters"], {"H": "x"}, "letter H"),
    (["graph", "inputs", 0, "letters"], 3, "letters must be an object"),
    (["graph", "parameters", 0, "value"], delattr, "key 'value' is missing"),
    (["graph", "parameters", 0, "value"], "1", "expected a number"),
    (["graph", "parameters", 0, "value"], 5.0, "value 5.0 H lies outside its bounds (0.001, 0.1)"),
    (["graph", "parameters", 0, "value"], float("nan"), "must be a finite number"),
    (["graph", "parameters", 0, "bounds"], [1], "must be two numbers"),
    (["graph", "parameters", 0, "bounds"], "x", "a list of numbers"),
    (["graph", "parameters", 0, "tolerance"], "x", "expected a number"),
    (["graph", "parameters", 0, "tolerance"], 4.0, "must be a share of the value"),
    (["graph", "parameters", 0, "bounds"], [1.0, 0.0], "the lower first"),
    (["graph", "parameters", 0, "name"], "R_a", "declared twice"),
    (["graph", "parameters", 0, "name"], "2x", "use letters, digits and underscores"),
    (["graph", "outputs", 0, "at"], "shat", "no node 'shat'; did you mean 'shaft'?"),
    (["graph", "outputs", 0, "at"], delattr, "'at' is missing"),
    (["graph", "outputs", 0, "variable"], "flw", "use effort, flow, displacement or momentum"),
    (["graph", "outputs"], [{"name": "x", "is": "2*"}], "cannot be read"),
    (["graph", "outputs"], [{"name": "x", "is": "u_a > 1"}], "is a condition, not a value"),
    (["graph", "signals"], [{"name": "x"}], "key 'is' is missing"),
    (["graph", "integrals"], [{"name": "x", "of": "yy"}], "'yy' is not declared"),
    (["graph", "tables"], {"T": {"x": [0, 1]}}, "key 'values' is missing"),
    (["graph", "tables"], {"T": {"x": [0, 1], "values": [1]}}, "needs 2 values"),
    (["graph", "tables"], {"T": {"x": [1, 0], "values": [1, 2]}}, "strictly increasing"),
    (["graph", "tables"], [1], "tables must be an object"),
    (["graph", "tables"], {"T": {"x": [0, 1], "y": [0, 1], "values": [[1, 2], [3]]}}, "needs 2 rows of 2 values"),
    (["graph", "tables"], {"T": {"x": [0, "a"], "values": [1, 2]}}, "expected a number"),
    (["graph", "tables"], {"T": {"x": [0, 1], "values": [1, float("inf")]}}, "must be a finite number"),
    (["nodes", 3], {"id": "R", "kind": "graph"}, "key 'graph' is missing"),
    (["nodes", 3], {"id": "R", "kind": "graph", "graph": {}, "ports": {"a": "b"}}, "has no node 'b'"),
    (["nodes", 3], {"id": "R", "kind": "graph", "graph": {}, "bind": {"x": "1"}}, "has no input or parameter 'x'"),
    (
        ["nodes", 3],
        {"id": "R", "kind": "X", "forms": [{"effort2": "flow1"}]},
        "forms that give one effort or flow for each port",
    ),
    (["nodes", 3], {"id": "R", "kind": "X", "forms": [{"power1": "1"}]}, "does not give '1.power1'"),
    (["nodes", 3], {"id": "R", "kind": "X"}, "for port(s) none"),
    (["nodes", 3], {"id": "R", "kind": "X", "forms": [3]}, "a form must be an object"),
    (["nodes", 3, "effort"], "R_a*flow/0", "no finite real value"),
    (["nodes", 3, "effort"], "sqrt(-1)*flow", "no finite real value"),
]


@pytest.mark.parametrize(
    ("path", "value", "text"), MALFORMED, ids=[f"{path[-1]}-{text[:20]}" for path, _, text in MALFORMED]
)
def test_a_malformed_file_is_told_what_is_wrong(path, value, text):
    with pytest.raises(BondGraphError) as caught:
        graph_from_json(changed(path, value), "motor.json").validate()
    assert text in caught.value.message and caught.value.where


def test_no_entry_of_a_file_can_raise_anything_but_a_readable_error():
    """Every value of a file replaced by values of other types: refused in words, or read."""

    def places(value, path=()):
        yield path
        children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for key, child in children:
            yield from places(child, (*path, key))

    whole = json.loads(json.dumps(graph_to_json(everything())))
    for path in list(places(whole)):
        for value in (None, True, -1, "x", [[]], {"x": 1}):
            data = json.loads(json.dumps(whole))
            place = data
            for key in path[:-1]:
                place = place[key]
            if path:
                place[path[-1]] = value
            else:
                data = value
            try:
                graph_from_json(data).validate()
            except BondGraphError as error:
                assert str(error)


def test_a_declared_default_of_zero_is_kept_apart_from_none():
    g = BondGraph("g")
    for name, default in (("none", None), ("zero", 0.0), ("one", 1.0)):
        g.input(name, "V", default=default)
    written = graph_to_json(g)["graph"]["inputs"]
    assert [record.get("default") for record in written] == [None, 0.0, 1.0]
    again = graph_from_json(graph_to_json(g), "g.json")
    assert again == g and [one.has_default for one in again.inputs] == [False, True, True]
