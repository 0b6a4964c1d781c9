"""The layout of drawn bond graphs: nothing overlaps, and trees have no crossings."""

from __future__ import annotations

import itertools
import random

import pytest

from bondgraph.report.diagram.drawn import Drawing, DrawnBond, DrawnNode, frame_of, other_end
from bondgraph.report.diagram.geometry import Path, path_crossings, path_from, segments
from bondgraph.report.diagram.layout import Layout, lay_out
from tests.report.samples import SAMPLES


def random_tree(seed: int, junctions: int, extra_bonds: int = 0) -> Drawing:
    """Junctions in a tree, some of its connected parts as (nested) sub-graphs, one-ports at all of them."""
    draw = random.Random(seed)
    nodes: list[DrawnNode] = []
    bonds: list[DrawnBond] = []
    for i in range(junctions):
        parent = nodes[draw.randrange(max(0, i - 4), i)].name if i else ""
        frame = frame_of(parent)
        if parent and draw.random() < 0.25:
            frame = f"{frame}.part{i}" if frame else f"part{i}"
        nodes.append(DrawnNode(f"{frame}.j{i}" if frame else f"j{i}", draw.choice("01"), "rotation"))  # type: ignore[arg-type]
        if parent:
            ends = (parent, nodes[i].name) if draw.random() < 0.7 else (nodes[i].name, parent)
            bonds.append(DrawnBond(*ends, draw.choice(("source", "target"))))  # type: ignore[arg-type]
    for _ in range(extra_bonds):
        first, second = draw.sample(range(junctions), 2)
        bonds.append(DrawnBond(nodes[first].name, nodes[second].name, "source"))
    for host in list(nodes):
        for k in range(draw.choice((0, 1, 2, 3, 5))):
            kind = draw.choice(("R", "C", "I", "Se", "Sf"))
            nodes.append(DrawnNode(f"{host.name}_{kind}{k}", kind, "", "a·b + " * draw.randrange(9)))  # type: ignore[arg-type]
            ends = (nodes[-1].name, host.name) if kind in ("Se", "Sf") else (host.name, nodes[-1].name)
            bonds.append(DrawnBond(*ends, "target"))
    pairs = [(draw.choice(nodes).name, draw.choice(nodes).name) for _ in range(4)]
    return Drawing(f"tree {seed}", tuple(nodes), tuple(bonds), tuple(pair for pair in pairs if pair[0] != pair[1]))


def passes_through(path: Path, layout: Layout) -> list[str]:
    """Labels that a polyline passes over."""
    return [
        name
        for name, box in layout.boxes.items()
        if any(box.grown(-1).meets(start, end) for start, end in segments(path))
    ]


def check_no_overlaps(drawing: Drawing, layout: Layout) -> None:
    for (first, box), (second, other) in itertools.combinations(layout.boxes.items(), 2):
        assert not box.overlaps(other), f"labels of {first} and {second} overlap"
    for path in (*layout.bonds, *layout.signals):
        assert passes_through(path, layout) == []
    for frame in layout.frames:
        for name, box in layout.boxes.items():
            if name.startswith(f"{frame.name}."):
                assert frame.box.contains(box), f"{name} sticks out of {frame.name}"
            else:
                assert not frame.box.overlaps(box), f"{name} lies in {frame.name}"
    for frame, other_frame in itertools.combinations(layout.frames, 2):
        nested = other_frame.name.startswith(f"{frame.name}.") or frame.name.startswith(f"{other_frame.name}.")
        assert nested or not frame.box.overlaps(other_frame.box)


def check_ends(drawing: Drawing, layout: Layout) -> None:
    """Every bond and signal runs from the edge of its source to the edge of its target."""
    ends = [(bond.source, bond.target) for bond in drawing.bonds] + list(drawing.signals)
    for (source, target), path in zip(ends, (*layout.bonds, *layout.signals), strict=True):
        for name, (x, y) in ((source, path[0]), (target, path[-1])):
            box = layout.boxes[name]
            assert box.left - 1e-6 <= x <= box.right + 1e-6 and box.top - 1e-6 <= y <= box.bottom + 1e-6
            on_edge = min(abs(x - box.left), abs(x - box.right), abs(y - box.top), abs(y - box.bottom))
            assert on_edge == pytest.approx(0.0, abs=1e-6)


def on_one_line(first: Path, second: Path) -> bool:
    """Whether two polylines run along each other closer than their marks are wide."""
    for (a, b), (c, d) in itertools.product(segments(first), segments(second)):
        for axis in (0, 1):
            along = 1 - axis
            same = a[axis] == b[axis] and c[axis] == d[axis] and abs(a[axis] - c[axis]) < 6
            common = min(max(a[along], b[along]), max(c[along], d[along])) - max(
                min(a[along], b[along]), min(c[along], d[along])
            )
            if same and common > 1:
                return True
    return False


@pytest.mark.parametrize("name", SAMPLES)
def test_sample_graphs_have_no_overlap_and_no_crossing(name: str) -> None:
    drawing = SAMPLES[name]()
    layout = lay_out(drawing)
    check_no_overlaps(drawing, layout)
    check_ends(drawing, layout)
    assert layout.crossings == 0
    assert not any(on_one_line(a, b) for a, b in itertools.combinations(layout.bonds, 2))


@pytest.mark.parametrize("seed", range(12))
def test_trees_have_no_crossing(seed: int) -> None:
    drawing = random_tree(seed, 4 + seed)
    layout = lay_out(drawing)
    check_no_overlaps(drawing, layout)
    check_ends(drawing, layout)
    assert layout.crossings == 0


@pytest.mark.parametrize("seed", range(100, 112))
def test_rings_keep_clear_of_labels_and_of_each_other(seed: int) -> None:
    drawing = random_tree(seed, 4 + seed % 9, extra_bonds=3)
    layout = lay_out(drawing)
    check_no_overlaps(drawing, layout)
    check_ends(drawing, layout)
    assert not any(on_one_line(a, b) for a, b in itertools.combinations(layout.bonds, 2))


def test_signals_of_one_source_branch_where_they_part() -> None:
    drawing = SAMPLES["vehicle"]()
    layout = lay_out(drawing)
    assert layout.branches
    for index, point in layout.branches:
        source = drawing.signals[index][0]
        others = [
            path
            for k, path in enumerate(layout.signals)
            if k != index and drawing.signals[k][0] == source and path_from(path, point) != path
        ]
        assert path_from(layout.signals[index], point)[0] == point
        assert others, f"no other signal of {source} passes the branch"


def test_crossings_are_counted() -> None:
    """Two 0-junctions bonded to the same three others cannot all be drawn in layers without crossings."""
    hubs, rims = ["a", "b", "c"], ["x", "y", "z"]
    nodes = tuple(DrawnNode(name, "0") for name in hubs) + tuple(DrawnNode(name, "1") for name in rims)
    bonds = tuple(DrawnBond(hub, rim) for hub in hubs for rim in rims)
    layout = lay_out(Drawing("utility graph", nodes, bonds))
    assert layout.crossings >= 1
    assert layout.crossings == sum(path_crossings(a, b) for a, b in itertools.combinations(layout.bonds, 2))


def test_power_runs_from_left_to_right() -> None:
    drawing = SAMPLES["vehicle"]()
    layout = lay_out(drawing)
    path = ["engine.combustion", "engine.crank", "cvt.belt_in", "cvt.belt_out", "cvt.output"]
    places = [layout.boxes[name].centre[0] for name in path]
    assert places == sorted(places)


def test_a_long_path_is_folded_to_the_shape_of_a_page() -> None:
    extent = lay_out(SAMPLES["vehicle"]()).extent
    assert 1.0 < extent.width / extent.height < 3.0


def test_spring_and_damper_hang_below_the_power_path() -> None:
    layout = lay_out(SAMPLES["two_mass_driveline"]())
    motor, shaft, twist, load = (layout.boxes[name].centre for name in ("motor", "shaft", "twist", "load"))
    assert motor[1] == shaft[1] == load[1]
    assert twist[0] == shaft[0] and twist[1] > shaft[1]


def test_one_ports_stand_beside_their_junction() -> None:
    drawing = SAMPLES["dc_motor"]()
    layout = lay_out(drawing)
    for bond, path in zip(drawing.bonds, layout.bonds, strict=True):
        for name in (bond.source, bond.target):
            if drawing.node(name).kind in ("R", "C", "I", "Se"):
                assert len(path) == 2, f"the bond {name} - {other_end(bond, name)} should be straight"
