"""Lines and patches that turn a declaration into the corrected one."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sympy import Expr, Rational

import bondgraph as bg
from bondgraph.correct.scores.gates import Gate, gated
from bondgraph.declare.domains import Domain
from bondgraph.declare.editing import copy, split_bond, with_inputs_between, with_values
from bondgraph.declare.effect import EffectFunction, Place, Scale, effect_functions
from bondgraph.declare.elements import Node
from bondgraph.declare.expressions import FUNCTIONS, parse
from bondgraph.declare.functions import table_function
from bondgraph.declare.handles import Handle
from bondgraph.declare.quantities import Start, symbol
from bondgraph.declare.revision import revise_output
from bondgraph.effects import friction, loads, losses, storages
from bondgraph.effects.benches import BENCHES
from bondgraph.effects.catalogue import added, every_effect
from bondgraph.report.python_lines import correction_lines, declaration_patch, write_python

DECLARATION = """\
import bondgraph as bg


def sled() -> bg.BondGraph:
    graph = bg.BondGraph("sled")
    force = graph.input("force", "N", "push")
    mass = graph.parameter("mass", 176.0, "lb", "sled", (130.0, 265.0))
    body = graph.one_junction("body", bg.TRANSLATION)
    graph.effort_source("push", force, at=body)
    graph.inertance("sled", mass, at=body, state="v")
    graph.measure_flow("speed", body)
    return graph
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "sled.py"
    path.write_text(DECLARATION)
    return path


def _effects() -> list[EffectFunction]:
    return [one for module in (losses, friction, loads, storages) for one in effect_functions(module)]


def test_lines_of_every_effect_give_the_corrected_graph(file: Path) -> None:
    """What is compared is the whole declaration: names, units, bounds, meanings, laws, order."""
    declared, tried = bg.build(str(file)).graph, set()
    for effect in _effects():
        corrected = copy(declared)
        added = effect(corrected, Place(Handle("body", "1", bg.TRANSLATION), Scale(100.0, 5.0)))
        if added is None or not added.coefficients:
            continue  # it belongs to another kind of place
        corrected = with_values(corrected, {added.coefficients[0]: 0.3, "mass": 91.5})
        text = correction_lines(declared, corrected)
        names = {"g": copy(declared)}
        exec(text, names)
        assert text and names["g"] == corrected, added.name
        tried.add(added.name)
    assert len(tried) >= 9


def _made(declared: bg.BondGraph, corrected: bg.BondGraph) -> str:
    """The lines for a correction, after they were run: empty where there are none, or they make another graph."""
    text = correction_lines(declared, corrected)
    names = {"g": copy(declared)}
    exec(text, names)
    return text if names["g"] == corrected else ""


@pytest.mark.parametrize("domain", BENCHES)
def test_every_effect_at_every_place_has_lines(domain: str) -> None:
    """63 of 333 pairs had none: in the middle of a bond, between two junctions, storages by effort or flow, delays."""
    bench, tried = BENCHES[domain](), 0
    for function in every_effect().values():
        for place, effect, graph in added(function, bench):
            coefficient = next(one for one in graph.parameters if one.name in effect.parameters)
            low, high = coefficient.bounds or (0.0, 1.0)
            corrected = with_values(graph, {coefficient.name: low + 0.3 * (high - low)})
            assert _made(bench.graph, corrected), (effect.name, place.label)
            tried += 1
    assert tried >= 20


@pytest.mark.parametrize("when", ["from", "until"])
def test_effects_that_begin_or_end_have_lines(when: Any) -> None:
    bench, tried = BENCHES["mechanical"](), set()
    log = bg.MatchedLog("run", np.arange(3.0), np.zeros((2, 3)), np.zeros((2, 3)))
    for function in (storages.added_inertia, friction.coulomb_loss, storages.hardening_spring):
        for place, effect, graph in added(gated(function, Gate(when, "run", 1.0), [log]), bench):
            assert _made(bench.graph, graph), (effect.name, place.label)
            tried.add(effect.name)
    assert {"added_inertia", "hardening_spring"} < tried


def test_an_effect_in_a_bond_of_a_graph_without_domains_has_lines() -> None:
    g = bg.BondGraph("plain")
    first, second = g.one_junction("first"), g.one_junction("second")
    own = Domain("own", "V", "A", "C", "V s", "u", "i")
    third = g.one_junction("third", own)
    bonds = [g.bond(first, second), g.bond(second, third)]
    for bond in bonds:
        corrected = copy(g)
        split_bond(corrected, bond, Node("middle", "0", own if bond.target == "third" else None))
        corrected.compliance("spring", 40.0, at="middle", initial=0.2, state="x")
        assert "split_bond(g, Bond(" in _made(g, corrected)
    twin = copy(g)
    twin._bonds.pop()
    assert correction_lines(g, twin) == ""


def test_numbers_before_sums_do_not_multiply_their_terms() -> None:
    """A rate of ``50*(command - reached)/range`` became one of ``(50*command - 50*reached)/range``."""

    def sled(law: Expr | None) -> bg.BondGraph:
        g = bg.BondGraph("sled")
        body = g.one_junction("body", bg.TRANSLATION)
        for name in "abc":
            g.parameter(name, 2.0, "1", "a number")
        g.resistance("air", lambda v: v if law is None else v * law, at=body)
        return g

    a, b, c = map(symbol, "abc")
    for law in (50.0 * ((a - b) / c), -((a - b) / c), 3 * ((a + b) * (a - c)), Rational(3, 2) * ((a + b) / c) + a):
        assert _made(sled(None), sled(law)), law


def test_a_patch_makes_the_file_declare_the_corrected_graph(file: Path, tmp_path: Path) -> None:
    declared, corrected = (bg.build(str(file)).graph for _ in range(2))
    friction.quadratic_loss(corrected, Place(Handle("body", "1", bg.TRANSLATION), Scale(100.0, 5.0)))
    corrected = with_values(corrected, {"c_quadratic_loss_body": 1.5, "mass": 95.0})
    said = write_python(tmp_path, declared, corrected, str(file))
    assert len(said) == 2 and file.read_text() == DECLARATION
    if shutil.which("patch"):
        subprocess.run(["patch", str(file), str(tmp_path / "correction.patch")], check=True, capture_output=True)
        assert bg.build(str(file)).graph == corrected
    assert "graph.resistance('quadratic_loss_body'" in (tmp_path / "correction.patch").read_text()


def test_lines_of_a_law_that_the_logs_contradict_say_so(file: Path, tmp_path: Path) -> None:
    """A refused law stood in the patch as "found", and the patched file simulated worse than the declared one."""
    declared, corrected = (bg.build(str(file)).graph for _ in range(2))
    friction.quadratic_loss(corrected, Place(Handle("body", "1", bg.TRANSLATION), Scale(100.0, 5.0)))
    for line in write_python(tmp_path, declared, corrected, str(file), contradicted=True):
        assert "(the logs contradict what they add): " in line
    for name in ("corrected_lines.py", "correction.patch"):
        text = (tmp_path / name).read_text()
        assert "but contradicted by the logs" in text and "found by closing" not in text


@pytest.mark.parametrize(
    "spoiled",
    [
        DECLARATION.replace("    return graph", "    if not force:\n        return graph\n    return graph"),
        DECLARATION.replace("def sled() -> bg.BondGraph:", "def other() -> bg.BondGraph:"),
        DECLARATION.replace("return graph", "return graph.flatten()"),
    ],
)
def test_files_without_one_place_for_lines_get_no_patch(spoiled: str, tmp_path: Path) -> None:
    path = tmp_path / "sled.py"
    path.write_text(spoiled)
    graph = bg.build(str(path)).graph
    assert declaration_patch(str(path), graph, with_values(graph, {"mass": 90.0})) == ""
    assert declaration_patch("vehicle_graphs.driveline:driveline", graph, graph) == ""


def test_inputs_that_run_another_way_between_samples_do_so_after_the_lines(file: Path, tmp_path: Path) -> None:
    declared = bg.build(str(file)).graph
    corrected = with_inputs_between(declared, force="hold")
    lines = correction_lines(declared, corrected)
    assert "with_inputs_between(g, force='hold')  # or hold=True where force is declared" in lines
    names = {"g": copy(declared)}
    exec(lines, names)
    assert names["g"] == corrected
    assert len(write_python(tmp_path, declared, corrected, str(file))) == 2
    outer = bg.BondGraph("two")
    outer.include("front", copy(declared))
    outer.include("rear", copy(declared))
    both = with_inputs_between(outer, **{"rear.force": "band limited", "front.force": "hold"})
    names = {"g": copy(outer)}
    exec(correction_lines(outer, both), names)
    assert names["g"] == both


def test_a_changed_output_and_what_has_no_lines(file: Path) -> None:
    declared, corrected = (bg.build(str(file)).graph for _ in range(2))
    scale = corrected.parameter("scale", 1.2, "1", "of the sensor")
    revise_output(corrected, "speed", lambda old: scale * old)
    assert "revise_output(g, 'speed', " in correction_lines(declared, corrected)
    corrected.add_node(Node("second", "TF", laws=(("modulus", symbol("scale")),)))
    assert correction_lines(declared, corrected) == ""


def test_fractions_of_whole_numbers_stay_fractions() -> None:
    """A convection has an eighth root: its lines gave 0.125, which is another law, and so there were none."""

    def sled(loss: float) -> bg.BondGraph:
        g = bg.BondGraph("sled")
        body = g.one_junction("body", bg.TRANSLATION)
        g.inertance("mass", g.parameter("m", 80.0, "kg", "sled"), at=body, state="v")
        if loss:
            c = g.parameter("c", loss, "N", "air", (0.0, 8.0))
            u = g.parameter("u", 2.0, "m/s", "speed of that force")
            g.resistance("air", lambda v: c * v / u * ((v / u) ** 2) ** Rational(1, 8), at=body)
        return g

    text = correction_lines(sled(0.0), sled(1.5))
    assert "Rational(1, 4)" in text and "from sympy import Rational" in text


LAWS = [
    "b*flow*sqrt(abs(flow)/w)", "b*cbrt(flow)", "b*flow**1.5", "b*pi*flow/w", "b*atan2(flow, w)", "b*floor(flow/w)",
    "b*log(1 + flow**2)*exp(-flow/w)", "b*asinh(flow/w) + b*acos(tanh(flow/w))", "b*ceiling(flow)", "b*Mod(flow, w)",
    "b*max(flow, w, 0) + b*min(flow, 0)", "b*clip(flow, 0, w)", "b*switch(flow - w, 0.01)", "b*sign(flow)*2**flow",
    "b*flow if flow > w else 0", "b*flow if 0 < flow else b*w", "b*(flow if flow > 0 and flow < w or flow < -w else w)",
    "b*flow if not (flow < w or flow > 2*w) else 0", "b*Heaviside(flow, 0)", "curve(flow)*b", "b*map(flow, w)",
    "lambda*flow", "b*flow*flow(body)", "b*flow*g", "b*flow*sin(sin_)", "b*flow*symbol",
    "b*flow*delay(w, 0.5)", "b*flow + inside.c*flow",
]  # fmt: skip


@pytest.mark.parametrize("law", LAWS)
def test_every_function_of_laws_can_be_written(law: str) -> None:
    """`they cannot write the function sqrt`: lines knew no function that sympy makes of others."""

    def sled(text: str) -> bg.BondGraph:
        g = bg.BondGraph("sled")
        body = g.one_junction("body", bg.TRANSLATION)
        g.inertance("mass", g.parameter("m", 80.0, "kg", "sled"), at=body, state="v")
        for name in ("b", "w", "lambda", "g", "sin_", "symbol"):
            g.parameter(name, 2.0, "1", "a number")
        g.table("curve", [0.0, 1.0], [0.0, 3.0], unit="1", meaning="a curve")
        g.table("map", [0.0, 1.0], [[0.0, 3.0], [1.0, 2.0]], unit="1", meaning="a map", y=[0.0, 1.0])
        inner = bg.BondGraph("part")
        inner.parameter("c", 2.0, "1", "a number")
        g.include("inside", inner)
        read: dict[str, Any] = {name: symbol(name) for name in (*g.quantities, "inside.c")}
        read |= {"curve": table_function("curve"), "map": table_function("map", 2)}
        g.resistance("air", lambda flow: parse(text, {**read, "flow": flow}, "air"), at=body)
        return g

    declared, corrected = sled("b*flow"), sled(law)
    text = correction_lines(declared, corrected)
    names = {"g": copy(declared)}
    exec(text, names)
    assert text and names["g"] == corrected


def test_every_function_that_texts_accept_is_tried() -> None:
    spelled = " ".join(LAWS)
    inverses = {"sec", "csc", "cot"}  # written as quotients
    same = {"Abs": "abs", "ln": "log", "Min": "min", "Max": "max", "minimum": "min", "maximum": "max", "pow": "**"}
    plain = {"cos", "sin", "tan", "asin", "atan", "sinh", "cosh", "acosh", "atanh"}  # as those that are tried
    for name in FUNCTIONS:
        assert name in inverses | plain or f"{same.get(name, name)}" in spelled, name


def test_an_integral_begins_where_the_corrected_one_does() -> None:
    """A part that began at a temperature of its own had no lines."""

    def body(begun: float | None) -> bg.BondGraph:
        g = bg.BondGraph("body")
        plate = g.zero_junction("plate", bg.THERMAL)
        g.compliance("heat", 1 / g.parameter("C", 500.0, "J/K", "plate"), at=plate, state="Q")
        if begun is not None:
            inside = g.integral("inside", lambda inside: plate.effort - inside, "K s", "part", initial=begun)
            g.flow_source("wall", -inside, at=plate)
        return g

    assert "initial=310.0" in correction_lines(body(None), body(310.0))
    assert "initial" not in correction_lines(body(None), body(0.0)) != ""


def test_a_storage_starts_at_a_signal_after_the_lines(file: Path, tmp_path: Path) -> None:
    """Beside a sensor that is late the mass starts at its signal: no lines could say so."""
    declared = bg.build(str(file)).graph
    begun = copy(declared)
    name, node = next((name, node) for name, node in begun.nodes.items() if node.kind == "I")
    begun._nodes[name] = replace(node, starts=(Start("speed", 2.0),))
    text = correction_lines(declared, begun)
    assert f"revise_start(g, '{name}', 'speed', 2.0)" in text and _made(declared, begun) == text
    (lines, patch) = write_python(tmp_path, declared, begun, str(file))
    assert "(they set where states start, no law): " in lines and patch.startswith("as a patch")


def test_a_correction_without_lines_says_so(tmp_path: Path) -> None:
    declared, corrected = bg.BondGraph("one"), bg.BondGraph("other")
    (said,) = write_python(tmp_path, declared, corrected)
    assert said.startswith("No Python lines") and "corrected_graph.json" in said
    assert "they cannot write a part of the graph that is no element and no quantity" in said
    assert not (tmp_path / "corrected_lines.py").exists()


def test_lines_that_add_no_law_say_so_and_what_cannot_be_written_is_named(file: Path, tmp_path: Path) -> None:
    """Beside a verdict that nothing is missing stood lines and a patch, as if there were a law in them."""
    declared = bg.build(str(file)).graph
    estimated = with_values(declared, {"mass": 95.0})
    for line in write_python(tmp_path, declared, estimated, str(file)):
        assert "(they set estimated values, no law): " in line
    begun = copy(declared)
    name, node = next((name, node) for name, node in begun.nodes.items() if node.kind == "I")
    begun._nodes[name] = replace(node, initial=(3.0,))
    (said,) = write_python(tmp_path, declared, begun)
    assert f"(it cannot be written where {name} starts)" in said
    begun.add_node(Node("second", "TF", laws=(("modulus", symbol("mass")),)))
    (said,) = write_python(tmp_path, declared, begun)
    assert "they cannot write the element second" in said
