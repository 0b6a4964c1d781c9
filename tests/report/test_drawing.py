"""Drawn bond graphs: well-formed SVG with every name, half arrows and strokes at the right ends."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.errors import DeclarationError, OptionError
from bondgraph.report.declared import short_names
from bondgraph.report.diagram.canvas import Line, Primitive, Rectangle, Text
from bondgraph.report.drawing import (
    Drawing,
    DrawnBond,
    DrawnNode,
    draw_svg,
    drawing_of,
    picture_of,
    save_drawing,
)
from tests.report.samples import SAMPLES, dc_motor, two_mass_driveline

SVG = "{http://www.w3.org/2000/svg}"
FOLDER = Path(__file__).resolve().parent


def parts(drawing: Drawing, role: str) -> list[Primitive]:
    return [part for part in picture_of(drawing).primitives if part.role == role]


def marks_per_bond(drawing: Drawing) -> list[tuple[Line, Line, Line | None]]:
    """Line, harpoon and stroke of every bond in the order of the drawing (the legend's own bond comes after them)."""
    found: list[list[Line]] = []
    for part in picture_of(drawing).primitives:
        if isinstance(part, Line) and part.role == "bond":
            found.append([part])
        elif isinstance(part, Line) and part.role in ("harpoon", "stroke"):
            found[-1].append(part)
    return [(line, rest[0], rest[1] if len(rest) > 1 else None) for line, *rest in found[: len(drawing.bonds)]]


@pytest.mark.parametrize("name", SAMPLES)
def test_svg_is_well_formed_and_shows_every_name_and_law(name: str) -> None:
    drawing = SAMPLES[name]()
    root = ElementTree.fromstring(draw_svg(drawing))
    texts = ["".join(element.itertext()) for element in root.iter(f"{SVG}text")]
    tooltips = [element.text or "" for element in root.iter(f"{SVG}title")]
    everything = "".join(texts).replace(" ", "")
    for node in drawing.nodes:
        local = node.name.rpartition(".")[2]
        assert (local if node.kind in ("0", "1") else f"{node.kind} {local}") in texts
        assert any(tooltip.startswith(f"{node.kind} {node.name}") and node.law in tooltip for tooltip in tooltips)
        assert node.law.replace(" ", "") in everything, f"the law of {node.name} is not shown in full"
    frames = {node.name.rpartition(".")[0].rpartition(".")[2] for node in drawing.nodes if "." in node.name}
    assert frames <= set(texts)


@pytest.mark.parametrize("name", SAMPLES)
def test_half_arrows_are_at_the_head_and_on_the_flow_side(name: str) -> None:
    for line, harpoon, _ in marks_per_bond(SAMPLES[name]()):
        assert harpoon.points[0] == line.points[-1]
        (x0, y0), (x1, y1) = line.points[-2:]
        barb_x, barb_y = harpoon.points[1]
        assert math.dist((x0, y0), (barb_x, barb_y)) < math.dist((x0, y0), (x1, y1)), "the barb points backwards"
        across = (barb_x - x1, barb_y - y1)
        if abs(y1 - y0) < 1e-6:
            assert across[1] > 0, "below a horizontal bond"
        elif abs(x1 - x0) < 1e-6:
            assert across[0] > 0, "to the right of a vertical bond"


@pytest.mark.parametrize("name", SAMPLES)
def test_strokes_are_at_the_end_that_receives_the_effort(name: str) -> None:
    drawing = SAMPLES[name]()
    for bond, (line, _, stroke) in zip(drawing.bonds, marks_per_bond(drawing), strict=True):
        assert stroke is not None
        (ax, ay), (bx, by) = stroke.points
        end, inner = (line.points[-1], line.points[-2]) if bond.stroke == "target" else line.points[:2]
        assert ((ax + bx) / 2, (ay + by) / 2) == pytest.approx(end)
        assert (bx - ax) * (end[0] - inner[0]) + (by - ay) * (end[1] - inner[1]) == pytest.approx(0.0, abs=1e-6)


def test_a_bond_without_causality_has_no_stroke() -> None:
    drawing = Drawing("open", (DrawnNode("a", "1"), DrawnNode("m", "I")), (DrawnBond("a", "m"),))
    assert [stroke for _, _, stroke in marks_per_bond(drawing)] == [None]


def test_texts_of_nodes_lie_inside_their_boxes() -> None:
    from bondgraph.report.diagram.text import text_width

    boxes = [part.box for part in parts(SAMPLES["vehicle"](), "node") if isinstance(part, Rectangle)]
    labels = [
        part
        for part in picture_of(SAMPLES["vehicle"]()).primitives
        if isinstance(part, Text) and part.role == "" and part.text != ""
    ]
    for text in labels:
        width = text_width(text.text, text.size, text.bold)
        width += text_width(text.lead.text + " ", text.lead.size, bold=True) if text.lead else 0.0
        left = {"start": text.x, "middle": text.x - width / 2, "end": text.x - width}[text.anchor]
        assert any(
            box.left <= left and left + width <= box.right + 0.5 and box.top <= text.y <= box.bottom for box in boxes
        ), text.text


def test_an_added_element_is_marked() -> None:
    drawing = two_mass_driveline()
    plain, marked = draw_svg(drawing), draw_svg(drawing, frozenset({"drag"}))
    assert ">added<" not in plain
    assert ">added<" in marked and "added to the declared model" in marked
    colour = "#c2185b"
    root = ElementTree.fromstring(marked)
    bonds = [path for path in root.iter(f"{SVG}path") if path.get("class") == "bond" and path.get("stroke") == colour]
    assert len(bonds) == 1


def test_marking_an_unknown_element_names_the_nearest() -> None:
    with pytest.raises(DeclarationError, match=r"cannot mark 'drug'.*did you mean 'drag'"):
        draw_svg(two_mass_driveline(), frozenset({"drug"}))


def test_a_bond_to_nowhere_is_refused() -> None:
    with pytest.raises(DeclarationError, match=r"bond a -> rotr ends at 'rotr'.*did you mean 'rotor'"):
        Drawing("d", (DrawnNode("a", "1"), DrawnNode("rotor", "I")), (DrawnBond("a", "rotr"),))
    with pytest.raises(DeclarationError, match="two nodes are named 'a'"):
        Drawing("d", (DrawnNode("a", "1"), DrawnNode("a", "I")), ())


@pytest.mark.parametrize(("suffix", "start"), [(".svg", b"<svg"), (".png", b"\x89PNG"), (".pdf", b"%PDF")])
def test_files_are_written_in_the_format_of_their_suffix(tmp_path: Path, suffix: str, start: bytes) -> None:
    path = tmp_path / f"motor{suffix}"
    save_drawing(dc_motor(), path)
    assert path.read_bytes().startswith(start)


def test_an_unknown_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"motor.bmp: a drawing cannot be written as .bmp - use .svg, .png or .pdf"):
        save_drawing(dc_motor(), tmp_path / "motor.bmp")


@pytest.mark.slow
def test_the_text_is_the_same_under_every_hash_seed() -> None:
    code = (
        "import hashlib; from tests.report import samples; from bondgraph.report.drawing import draw_svg;"
        "print([hashlib.sha256(draw_svg(make()).encode()).hexdigest() for make in samples.SAMPLES.values()])"
    )
    path = str(FOLDER.parents[1])
    printed = {
        subprocess.run(
            [sys.executable, "-c", code], env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": path},
            capture_output=True, text=True, check=True,
        ).stdout
        for seed in ("0", "4711")
    }  # fmt: skip
    here = [hashlib.sha256(draw_svg(make()).encode()).hexdigest() for make in SAMPLES.values()]
    assert printed == {f"{here}\n"}


def declared_winch() -> BondGraph:
    """A motor with a brake that its own speed modulates, and a drum geared rigidly to it (derivative causality)."""
    g = BondGraph("winch")
    drum = BondGraph("drum")
    rim = drum.one_junction("rim", ROTATION)
    drum.inertance("disc", drum.parameter("J_drum", 2.0, "kg m^2"), at=rim)
    torque = g.input("torque", "N m", "motor torque")
    c = g.parameter("c", 0.1, "N m s^2")
    gear = g.parameter("gear", 4.0, "1")
    shaft = g.one_junction("shaft", ROTATION)
    g.effort_source("motor", torque, at=shaft)
    g.inertance("rotor", g.parameter("J", 0.02, "kg m^2"), at=shaft)
    g.include("drum", drum, {"rim": "rim"})
    g.transformer("gearbox", gear, shaft, "drum.rim")
    speed = g.signal("speed", abs(shaft.flow), "rad/s")
    g.resistance("brake", lambda omega: c * speed * omega, at="drum.rim")
    rope = g.one_junction("rope", TRANSLATION)
    g.transformer("radius", 5, "drum.rim", rope)
    g.effort_source("load", -100.0, at=rope)
    return g


def test_a_declared_graph_is_drawn_with_its_laws_signals_and_strokes() -> None:
    causal = assign_causality(declared_winch())
    drawing = drawing_of(causal)
    laws = {node.name: node.law for node in drawing.nodes}
    assert laws["rotor"] == "omega = p/J"
    assert laws["drum.disc"] == "omega = p/J_drum"
    assert laws["brake"] == "tau = c·omega·speed"
    assert laws["gearbox"] == "m = gear"
    assert drawing.signals == (("shaft", "brake"),)
    assert drawing.definitions == (("speed", "= |flow(shaft)|"),)
    assert [bond.stroke for bond in drawing.bonds] == list(causal.strokes)
    assert {node.name for node in drawing.nodes if node.note == "derivative causality"} == {
        name for name, _ in causal.derivative
    }
    assert causal.derivative
    assert "derivative causality" in draw_svg(drawing)


def test_a_long_law_is_drawn_with_short_names_that_are_explained_below() -> None:
    """A formula was drawn as "F = c_formula_magnitude_ ..." and cut there."""
    g = BondGraph("platform")
    body = g.one_junction("body", TRANSLATION)
    g.inertance("mass", g.parameter("m", 4.0, "kg"), at=body)
    one = g.parameter("c1_magnitude_of_flow_of_body_body", 2.0, "N s/m")
    two = g.parameter("c2_magnitude_of_flow_of_body_body", 2.0, "N/(m/s)^2")
    g.resistance("formula", lambda v: one * abs(v) + two * v * abs(v), at=body)
    c = g.parameter("c_quadratic_loss_body", 2.0, "N s/m")
    g.resistance("short", lambda v: c * v, at=body)
    drawing = drawing_of(assign_causality(g))
    laws = {node.name: node.law for node in drawing.nodes}
    assert laws["formula"] == "F = c1·|v| + c2·v·|v|" and laws["short"] == "F = c_quadratic_loss_body·v"
    assert ("c1", "in formula is c1_magnitude_of_flow_of_body_body") in drawing.definitions
    assert "in formula is c2_magnitude_of_flow_of_body_body" in draw_svg(drawing)
    assert not [text for _, text in drawing.definitions if "quadratic" in text]


def test_short_names_are_told_apart() -> None:
    g = BondGraph("platform")
    body = g.one_junction("body", TRANSLATION)
    every = [g.parameter(name, 2.0, "N") for name in ("c_quadratic_of_one_place", "c_quadratic_of_other_place", "c")]
    node = g.resistance("sum", lambda v: sum(every) * v, at=body)
    assert short_names(g.nodes[node.name]) == {
        "c_quadratic_of_one_place": "c1", "c_quadratic_of_other_place": "c2",
    }  # fmt: skip
