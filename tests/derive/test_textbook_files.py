"""Textbook graphs as a stranger writes them, in graph files, against equations written down by hand."""

from __future__ import annotations

import json

import pytest

from bondgraph.cli import main
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import Derivation
from bondgraph.derive.explicit import equations_json
from bondgraph.report.evaluate import evaluate
from tests.derive.textbook import (
    dependent,
    electrical,
    mechanical,
    networks,
    refused,
    semiconductors,
    spellings,
    vehicles,
)
from tests.derive.textbook.case import Case

CASES = (
    *dependent.CASES,
    *electrical.CASES,
    *mechanical.CASES,
    *networks.CASES,
    *semiconductors.CASES,
    *spellings.CASES,
    *vehicles.CASES,
)
WHERE = {"der": "derivatives", "out": "outputs", "signal": "signals"}


def answer(found: dict, kind: str, name: str) -> float:
    return found["bonds"][name][kind] if kind in ("effort", "flow") else found[WHERE[kind]][name]


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_textbook_graphs_have_the_equations_of_the_book(case: Case):
    points = [case.point(seed) for seed in range(3)]
    answers = evaluate(graph_from_json(json.loads(json.dumps(case.graph))), points)
    for point, found in zip(points, answers, strict=True):
        assert set(found["derivatives"]) == set(point["states"])
        for (kind, name), expected in case.expected(point).items():
            assert answer(found, kind, name) == pytest.approx(expected, rel=1e-7, abs=1e-12), f"{kind} {name}"


@pytest.mark.parametrize(("name", "loops"), [("diode_with_series_resistance_both_forms", 1), ("michaelis_menten", 0)])
def test_only_what_has_no_closed_form_is_iterated(name: str, loops: int):
    case = next(case for case in CASES if case.name == name)
    derivation = Derivation(assign_causality(graph_from_json(case.graph)))
    assert len(equations_json(derivation, derivation.equations())["implicit"]) == loops


@pytest.mark.parametrize("name", ["slider_crank_engine", "two_levels_of_parts_with_ports", "storage_on_a_zero_source"])
def test_the_commands_take_the_same_files(name: str, tmp_path, capsys):
    case = next(case for case in CASES if case.name == name)
    graph, points = tmp_path / "g.json", tmp_path / "p.json"
    graph.write_text(json.dumps(case.graph))
    points.write_text(json.dumps([case.point(0)]))
    assert main(["equations", str(graph), "--json"]) == 0
    assert {state["name"] for state in json.loads(capsys.readouterr().out)["states"]}
    assert main(["evaluate", str(graph), "--points", str(points), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)[0]
    for (kind, variable), expected in case.expected(case.point(0)).items():
        assert answer(found, kind, variable) == pytest.approx(expected, rel=1e-7, abs=1e-12)
    run = tmp_path / "run.csv"
    assert main(["simulate", str(graph), "--until", "0.01", "--step", "0.005", "--all", "--out", str(run)]) == 0
    assert len(run.read_text().splitlines()) == 4
    assert main(["draw", str(graph), "--out", str(tmp_path / "g.svg")]) == 0


def test_points_may_name_dependent_storages_and_ports():
    case = next(case for case in CASES if case.name == "coupled_coils_in_series")
    states = {"momentum1(coils)": 1.4, "momentum2(coils)": 0.9}
    point = {"states": states, "inputs": {"u": 5.0}, "parameters": {"L1": 1.0, "L2": 0.5, "M": 0.4, "R": 3.0}}
    found = evaluate(graph_from_json(case.graph), [point])[0]["derivatives"]
    rate = (5.0 - 3.0) / 2.3
    assert found == {
        "momentum1(coils)": pytest.approx(1.4 * rate), "momentum2(coils)": pytest.approx(0.9 * rate)
    }  # fmt: skip


@pytest.mark.parametrize("name", refused.files())
def test_impossible_graphs_are_refused_in_words(name: str, tmp_path, capsys):
    kind, words, data = refused.files()[name]
    graph = tmp_path / "g.json"
    graph.write_text(json.dumps(data))
    assert main(["equations", str(graph), "--json"]) == 2
    said = capsys.readouterr()
    error = json.loads(said.out)["error"]
    assert error["type"] == kind and error["where"]
    assert error["message"] in said.err
    for word in words:
        assert word in error["message"]
