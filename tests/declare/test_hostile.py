"""Graph files and laws that would hang, crash or give no number: each is refused in the user's words, at once."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sympy

from bondgraph.declare.effect import Effect
from bondgraph.declare.expressions import parse
from bondgraph.declare.files import load_graph, read_graph
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.limits import DEEPEST_PART
from bondgraph.declare.quantities import symbol
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import Derivation, check_closed
from bondgraph.errors import DeclarationError, DerivationError
from bondgraph.units import conversion, dimension, parse_unit
from tests.cli.conftest import MOTOR


@pytest.fixture
def motor() -> dict[str, Any]:
    """A motor as a JSON object that a test may spoil."""
    return copy.deepcopy(MOTOR)


NAMES = {name: symbol(name) for name in ("flow", "r", "m")}

CONDITIONS = (
    "(flow>0)*r", "-(flow>0)", "+(flow>0)", "r + (flow>0)", "r/(flow>0)", "sin(flow>0)", "max(flow>0, 1)",
    "(flow>0)**2", "2**(flow>0)", "switch(flow>0, 1)", "Heaviside(flow, flow>0)", "True*flow", "(flow>0) > 1",
    "Piecewise((flow>0, flow>0), (1, True))",
)  # fmt: skip
VALUES = ("Piecewise((1, 2))", "Piecewise((1, r))", "r if flow else 1", "And(flow, 1)", "flow and r", "not flow")
NO_NUMBERS = (
    "asin(3)*flow", "acosh(0.5)*flow", "atanh(2)*flow", "log(0)*flow", "flow*sqrt(-1)", "(-8)**(1/3)*flow", "1e400",
    "flow*0**(-1)", "flow*(1-1)/(1-1)", "atan2(0, 0)", "tan(pi/2)*flow", "log(flow-flow)", "cbrt(-8)", "Mod(flow, 0)",
)  # fmt: skip
TOO_LARGE = (
    "((9**1000)**1000)**1000", "9**9**9**9", "floor(exp(10000000))", "exp(exp(exp(exp(10))))", "1" * 400, "9" * 5000,
    "flow" + "**2" * 30, "2**(2**(2**(2**(2**2))))", "abs(" * 80 + "flow" + ")" * 80, "flow" + "+flow" * 20_000,
)  # fmt: skip


@pytest.mark.parametrize("law", CONDITIONS)
def test_a_condition_is_no_value(law: str) -> None:
    with pytest.raises(DeclarationError, match=r"bearing: .* is a condition, not a value in .* - write Piecewise"):
        parse(law, NAMES, "bearing")


@pytest.mark.parametrize("law", VALUES)
def test_a_value_is_no_condition(law: str) -> None:
    with pytest.raises(DeclarationError, match=r"bearing: .* is a value, not a condition in .* - compare it"):
        parse(law, NAMES, "bearing")


def test_a_piecewise_needs_pairs() -> None:
    with pytest.raises(DeclarationError, match="Piecewise takes pairs"):
        parse("Piecewise()", NAMES, "bearing")


@pytest.mark.parametrize("law", NO_NUMBERS)
def test_a_law_without_a_finite_real_number_is_refused(law: str) -> None:
    with pytest.raises(DeclarationError, match="bearing: the law has no finite real value"):
        parse(law, NAMES, "bearing")


@pytest.mark.parametrize("law", TOO_LARGE, ids=[law[:20] for law in TOO_LARGE])
def test_a_law_that_is_too_large_is_refused_at_once(law: str) -> None:
    with pytest.raises(DeclarationError, match=r"bearing: expression .* cannot be read") as refused:
        parse(law, NAMES, "bearing")
    assert len(refused.value.message) < 600


@pytest.mark.parametrize("law", ["1e308*flow", "flow*1e-300", "2**1000*flow", "(1/3)**600", "sqrt(2)*pi/4", "-1e-308"])
def test_numbers_that_a_float_holds_are_accepted(law: str) -> None:
    assert parse(law, NAMES, "bearing").is_finite is not False


def _rotor(law: Any, **values: float) -> BondGraph:
    graph = BondGraph("rotor")
    for name, value in values.items():
        graph.parameter(name, value, "1")
    shaft = graph.one_junction("shaft")
    graph.inertance("disc", 1.0, at=shaft)
    graph.resistance("bearing", law, at=shaft)
    return graph


@pytest.mark.parametrize("law", ["sqrt(-m)", "log(-m)", "asin(m + 1)", "(-m)**0.3"])
def test_a_root_that_is_not_real_at_the_declared_parameters_is_refused(law: str) -> None:
    with pytest.raises(DeclarationError, match=r"rotor: bearing: .* has no real value at the declared parameters"):
        _rotor(lambda flow: flow * parse(law, NAMES, "bearing"), m=2.0)
    _rotor(lambda flow: flow * parse("sqrt(m)", NAMES, "bearing"), m=2.0)


def test_a_root_in_a_branch_that_is_not_taken_is_nobodys_fault() -> None:
    _rotor(lambda flow: sympy.Piecewise((flow * sympy.sqrt(-symbol("m")), symbol("m") < 0), (flow, True)), m=2.0)


@pytest.mark.parametrize("number", [sympy.asin(3), sympy.zoo, sympy.I, sympy.Integer(10) ** 600])
def test_laws_written_in_python_hold_no_such_numbers_either(number: Any) -> None:
    with pytest.raises(DeclarationError, match="rotor: bearing: the law has no finite real value"):
        _rotor(lambda flow: flow * number)


@pytest.mark.parametrize("law", ["1/(flow(shaft) - flow(shaft))", "asin(3)*t", "1e200*1e200*t"])
def test_signals_and_integrals_of_files_hold_no_such_numbers(law: str, motor: dict[str, Any]) -> None:
    for group, record in (("signals", {"name": "x", "is": law}), ("integrals", {"name": "x", "of": law})):
        spoiled = {**motor, "graph": {**motor["graph"], group: [record]}}
        with pytest.raises(DeclarationError, match=r"x: .*(no finite real value|too large)"):
            graph_from_json(spoiled)


def test_an_equation_without_a_finite_number_is_refused_with_its_name(motor: dict[str, Any]) -> None:
    equations = Derivation(assign_causality(graph_from_json(motor))).equations()
    check_closed(equations)
    object.__setattr__(equations, "derivatives", (sympy.zoo * symbol("u_a"), *equations.derivatives[1:]))
    with pytest.raises(DerivationError, match=r"the equation of d\(.*\)/dt has no finite real value"):
        check_closed(equations)


def test_two_forms_whose_conditions_compare_complex_numbers(motor: dict[str, Any]) -> None:
    bearing = motor["nodes"][-1]
    bearing |= {"effort": "Piecewise((flow, sqrt(flow - 10) > 1), (1, True))", "flow": "max(sqrt(effort - 9), 1)"}
    for record in (*motor["graph"]["inputs"], *motor["graph"]["parameters"]):
        record.pop("unit")
    graph_from_json(motor).validate()


# ------------------------------------------------------------------ files


def _set(*path: Any) -> Callable[[dict[str, Any]], None]:
    """A change of a graph file: the last of the path is the value."""

    def change(motor: dict[str, Any]) -> None:
        place: Any = motor
        for key in path[:-2]:
            place = place[key]
        place[path[-2]] = path[-1]

    return change


SPOILED = {
    "a billion ports": (_set("nodes", 3, "ports", 1_000_000_000), "R: ports must be .* at most 200 but is 1000000000"),
    "a value of 400 digits": (_set("graph", "parameters", 0, "value", int("9" * 400)), "must be a finite number"),
    "a value that is none": (_set("graph", "parameters", 0, "value", float("nan")), "nan must be a finite number"),
    "a bound without end": (_set("graph", "parameters", 0, "bounds", [0, float("inf")]), "inf must be a finite number"),
    "a start of 400 digits": (_set("nodes", 2, "initial", int("9" * 400)), "must be a finite number"),
    "an endless unit": (_set("graph", "parameters", 0, "unit", "9**9**9**9"), "unit '9.*' is not known"),
    "a unit that pint cannot work out": (_set("graph", "parameters", 0, "unit", "degC**2/dB"), "is not known"),
    "a name with a way out": (_set("graph", "name", "../../x"), "name '../../x' holds '/'"),
    "an absolute name": (_set("graph", "name", "/tmp/x"), "name '/tmp/x' holds '/'"),
    "a name with an end of line": (_set("graph", "name", "a\nb"), r"holds '\\n'"),
    "a name of dots": (_set("graph", "name", ".."), "name '..' has no letters"),
    "a name without end": (_set("graph", "name", "x" * 5000), "has 5000 letters"),
}


@pytest.mark.parametrize("label", SPOILED)
def test_a_spoiled_file_is_refused_in_words(label: str, motor: dict[str, Any], tmp_path: Path) -> None:
    change, message = SPOILED[label]
    change(motor)
    path = tmp_path / "motor.json"
    path.write_text(json.dumps(motor))
    with pytest.raises(DeclarationError, match=message) as refused:
        read_graph(path)
    assert len(refused.value.message) < 600


def _nested(parts: int) -> dict[str, Any]:
    disc = {"id": "disc", "kind": "I", "flow": "momentum"}
    hub = [{"id": "hub", "kind": "1"}, disc]
    graph: dict[str, Any] = {"graph": {"name": "g"}, "nodes": hub, "bonds": [{"source": "hub", "target": "disc"}]}
    for level in range(parts):
        part = {"id": "p", "kind": "graph", "graph": graph, "ports": {"hub": "hub" if level == 0 else "p.hub"}}
        graph = {"graph": {"name": "g"}, "nodes": [part], "bonds": []}
    return graph


def test_parts_inside_parts_have_an_end() -> None:
    graph_from_json(_nested(DEEPEST_PART - 1)).validate()
    with pytest.raises(DeclarationError, match="parts stand more than 30 deep"):
        graph_from_json(_nested(DEEPEST_PART))
    with pytest.raises(DeclarationError, match="is nested more than 100 deep"):
        graph_from_json(_nested(300))


@pytest.mark.parametrize("text", ['{"graph": ' + "9" * 5000 + "}", "[" * 100_000, '{"a": "\udcff"}'])
def test_what_json_itself_cannot_read_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "motor.json"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(DeclarationError, match=r"motor.json: not JSON"):
        read_graph(path)


def test_a_folder_is_no_graph_file(tmp_path: Path) -> None:
    (tmp_path / "motor.json").mkdir()
    with pytest.raises(DeclarationError, match=r"motor.json: cannot be read \(Is a directory\)"):
        read_graph(tmp_path / "motor.json")


@pytest.mark.parametrize("reference", [".x:y", ":y", "..:y", "a..b:y"])
def test_a_reference_that_names_no_module(reference: str) -> None:
    with pytest.raises(DeclarationError, match=f"{reference}: "):
        load_graph(reference)


@pytest.mark.parametrize("name", ["../x", "a/b", "", "\x00"])
def test_graphs_and_effects_take_no_name_that_leads_elsewhere(name: str) -> None:
    with pytest.raises(DeclarationError, match="name"):
        BondGraph(name)
    with pytest.raises(DeclarationError, match="name"):
        Effect(name, "e", "effort = 0", ())


# ------------------------------------------------------------------ units


@pytest.mark.parametrize(
    "unit",
    [
        "9**9**9**9",
        "m^9^9^9",
        "m**(9**9**9)",
        "m^999999999",
        "m**2**3",
        "1e999999",
        "m^(1e9)",
        "m" * 300,
        "degC**2/dB",
        "dB/Hz",
    ],
)
def test_a_unit_that_keeps_a_reader_busy_is_refused(unit: str) -> None:
    with pytest.raises(DeclarationError, match="is not known"):
        parse_unit(unit)


@pytest.mark.parametrize(
    "unit", ["m^(1/2)", "V^0.5", "m**-2", "kg m^2", "W/(m^2 K)", "s^(-1)", "m²", "N m s / rad", "inH2O", "m3"]
)
def test_units_with_powers_are_units(unit: str) -> None:
    assert dimension(unit)


def test_a_unit_of_differences_does_not_become_one_with_an_offset() -> None:
    with pytest.raises(DeclarationError, match="cannot be converted"):
        conversion("delta_degC", "degC")
