"""Where everything lies in the drawing of a bond graph.

Junctions, transformers and gyrators form the backbone, laid out in layers from the sources to the loads; one-port
elements stand around their junction; each sub-graph is laid out by itself and takes part in the level above as one
block with ports on its left and right side. Bonds of the backbone run horizontally and change height only in the
channels between layers, so they never run over a label.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import networkx as nx

from bondgraph.report.diagram.arrangement import Item
from bondgraph.report.diagram.cells import Block, Hanger, cell
from bondgraph.report.diagram.drawn import JUNCTIONS, Drawing, frame_of, other_end
from bondgraph.report.diagram.geometry import Box, Path, Point, bounding_box, moved_path, path_crossings, simplified
from bondgraph.report.diagram.labels import Label, label_of
from bondgraph.report.diagram.layers import assign_layers
from bondgraph.report.diagram.levels import Link, place_level
from bondgraph.report.diagram.routing import route_signals
from bondgraph.report.diagram.text import text_width

FRAME_TITLE = 26.0
FRAME_PADDING = 16.0


@dataclass(frozen=True)
class Frame:
    """The frame around a sub-graph; ``depth`` counts from 1."""

    name: str
    box: Box
    depth: int


@dataclass(frozen=True)
class Layout:
    """Positions of all parts of a drawing.

    ``bonds`` and ``signals`` are polylines in the order of the drawing, from source to target, ending at the edges of
    the boxes; ``branches`` are the points where a signal, by index, leaves an
    earlier one of the same source.
    """

    boxes: Mapping[str, Box]
    labels: Mapping[str, Label]
    frames: tuple[Frame, ...]
    bonds: tuple[Path, ...]
    signals: tuple[Path, ...] = ()
    branches: tuple[tuple[int, Point], ...] = ()

    @property
    def extent(self) -> Box:
        """The box around everything."""
        corners = [Box(x, y, 0.0, 0.0) for path in (*self.bonds, *self.signals) for x, y in path]
        return bounding_box([*self.boxes.values(), *(frame.box for frame in self.frames), *corners])

    def moved(self, dx: float, dy: float) -> Layout:
        """The same layout elsewhere."""
        return Layout(
            {name: box.moved(dx, dy) for name, box in self.boxes.items()},
            self.labels,
            tuple(Frame(frame.name, frame.box.moved(dx, dy), frame.depth) for frame in self.frames),
            tuple(moved_path(path, dx, dy) for path in self.bonds),
            tuple(moved_path(path, dx, dy) for path in self.signals),
            tuple((index, (x + dx, y + dy)) for index, (x, y) in self.branches),
        )

    @property
    def crossings(self) -> int:
        """How often bonds cross each other."""
        return sum(path_crossings(path, other) for i, path in enumerate(self.bonds) for other in self.bonds[i + 1 :])


@functools.lru_cache(maxsize=8)
def lay_out(drawing: Drawing, highlight: frozenset[str] = frozenset()) -> Layout:
    """Place nodes, frames, bonds and signals of a drawing.

    Examples
    --------
    >>> from bondgraph.report.diagram.drawn import Drawing, DrawnBond, DrawnNode
    >>> pair = Drawing("pair", (DrawnNode("a", "1"), DrawnNode("m", "I")), (DrawnBond("a", "m", "target"),))
    >>> lay_out(pair).crossings
    0
    """
    labels = {node.name: label_of(node, node.name in highlight) for node in drawing.nodes}
    backbone = _backbone(drawing)
    best = _lay_out_once(drawing, labels, backbone, _power_ranks(drawing, backbone))
    if best.crossings:
        other = _lay_out_once(drawing, labels, backbone, _distance_ranks(drawing, backbone))
        best = min(best, other, key=lambda layout: (layout.crossings, _ink(layout)))
    titles = [
        Box(frame.box.left + 4, frame.box.top, text_width(frame.name, 12.0, bold=True) + 12, FRAME_TITLE - 6)
        for frame in best.frames
    ]
    frames = [frame.box for frame in best.frames]
    routed = route_signals(drawing.signals, best.boxes, best.bonds, titles, frames)
    return dataclasses.replace(best, signals=routed.paths, branches=routed.branches)


def _lay_out_once(
    drawing: Drawing, labels: Mapping[str, Label], backbone: _Backbone, ranks: Mapping[str, int]
) -> Layout:
    plan = _Plan(drawing, labels, backbone, ranks)
    return _finish(plan.block("", (), ()), plan)


def _ink(layout: Layout) -> float:
    """Total length of the bonds."""
    return sum(abs(x2 - x1) + abs(y2 - y1) for path in layout.bonds for (x1, y1), (x2, y2) in itertools.pairwise(path))


@dataclass(frozen=True)
class _Backbone:
    """What takes part in the layering, and what hangs at it.

    ``leaves`` and ``pendants`` give the index of the one bond by which a one-port element, or a dead-end junction with
    its elements (a spring and damper between two speeds), hangs at a junction of the same sub-graph.
    """

    names: tuple[str, ...]
    leaves: Mapping[str, int]
    pendants: Mapping[str, int]


def _backbone(drawing: Drawing) -> _Backbone:
    kinds = {node.name: node.kind for node in drawing.nodes}
    bonds_at: dict[str, list[int]] = {node.name: [] for node in drawing.nodes}
    for index, bond in enumerate(drawing.bonds):
        bonds_at[bond.source].append(index)
        bonds_at[bond.target].append(index)
    leaves: dict[str, int] = {}
    for name, indices in bonds_at.items():
        if len(indices) == 1 and kinds[name] not in JUNCTIONS:
            host = other_end(drawing.bonds[indices[0]], name)
            if kinds[host] in JUNCTIONS and frame_of(host) == frame_of(name):
                leaves[name] = indices[0]
    pendants = _pendants(drawing, kinds, bonds_at, leaves)
    names = tuple(name for name in kinds if name not in leaves and name not in pendants)
    return _Backbone(names, leaves, pendants)


def _pendants(
    drawing: Drawing, kinds: Mapping[str, str], bonds_at: Mapping[str, list[int]], leaves: Mapping[str, int]
) -> dict[str, int]:
    """Dead-end junctions that hang at one which the power path passes: those of springs and dampers first."""
    own_leaves: dict[str, list[str]] = {name: [] for name in kinds}
    for leaf, index in leaves.items():
        own_leaves[other_end(drawing.bonds[index], leaf)].append(leaf)
    chosen: dict[str, int] = {}
    for host, kind in kinds.items():
        if kind not in JUNCTIONS:
            continue
        through = [index for index in bonds_at[host] if other_end(drawing.bonds[index], host) not in leaves]
        dead_ends = []
        for index in through:
            name = other_end(drawing.bonds[index], host)
            ends_here = len(bonds_at[name]) == 1 + len(own_leaves[name]) and frame_of(name) == frame_of(host)
            if kinds[name] in JUNCTIONS and ends_here and 1 <= len(own_leaves[name]) <= 3:
                heavy = any(kinds[leaf] not in ("C", "R") for leaf in own_leaves[name])
                dead_ends.append((heavy, len(own_leaves[name]), index, name))
        places = min(len(through) - 2, 1 if own_leaves[host] else 2)
        for _, _, index, name in sorted(dead_ends)[: max(places, 0)]:
            chosen[name] = index
    return chosen


def _power_ranks(drawing: Drawing, backbone: _Backbone) -> dict[str, int]:
    """Layers of the whole backbone along the direction of power; bonds that would close a cycle count reversed."""
    index = {name: i for i, name in enumerate(backbone.names)}
    ordered: nx.DiGraph[int] = nx.DiGraph()
    ordered.add_nodes_from(index.values())
    for bond in drawing.bonds:
        if bond.source in index and bond.target in index and bond.source != bond.target:
            start, end = index[bond.source], index[bond.target]
            if nx.has_path(ordered, end, start):
                start, end = end, start
            ordered.add_edge(start, end)
    return dict(zip(backbone.names, assign_layers(len(index), sorted(ordered.edges)), strict=True))


def _distance_ranks(drawing: Drawing, backbone: _Backbone) -> dict[str, int]:
    """Distance of the backbone nodes from the first source of each connected part."""
    graph: nx.Graph[str] = nx.Graph()
    graph.add_nodes_from(backbone.names)
    kinds = {node.name: node.kind for node in drawing.nodes}
    starts: list[str] = []
    for bond in drawing.bonds:
        if bond.source in graph and bond.target in graph:
            graph.add_edge(bond.source, bond.target)
        if kinds[bond.source] in ("Se", "Sf"):
            starts.append(bond.source if bond.source in graph else bond.target)
    ranks: dict[str, int] = {}
    for start in [*starts, *backbone.names]:
        if start in graph and start not in ranks:
            for name, distance in nx.single_source_shortest_path_length(graph, start).items():
                ranks.setdefault(name, distance)
    return {name: ranks[name] for name in backbone.names}


class _Plan:
    """The drawing seen as nested levels; makes the block of a sub-graph from those inside it."""

    def __init__(self, drawing: Drawing, labels: Mapping[str, Label], backbone: _Backbone, ranks: Mapping[str, int]):
        self.drawing, self.labels, self.backbone, self.ranks = drawing, labels, backbone, ranks
        self.kinds = {node.name: node.kind for node in drawing.nodes}
        self.hanging: dict[str, list[int]] = {}
        for name, index in (*backbone.leaves.items(), *backbone.pendants.items()):
            self.hanging.setdefault(other_end(drawing.bonds[index], name), []).append(index)

    def item_of(self, level: str, name: str) -> Item | None:
        """The item of a level that a backbone node belongs to: itself, the sub-graph it is in, or none."""
        frame, start = frame_of(name), f"{level}." if level else ""
        if frame == level:
            return Item("node", name)
        if not frame.startswith(start):
            return None
        return Item("frame", start + frame[len(start) :].split(".")[0])

    def rank(self, item: Item) -> float:
        """Where along the power path an item lies: for a sub-graph the mean of its nodes."""
        if item.form == "node":
            return float(self.ranks[item.name])
        inside = [self.ranks[name] for name in self.backbone.names if name.startswith(f"{item.name}.")]
        return sum(inside) / len(inside)

    def links(self, level: str) -> list[Link]:
        """Backbone bonds between different items of a level."""
        links = []
        for index, bond in enumerate(self.drawing.bonds):
            if bond.source in self.ranks and bond.target in self.ranks:
                source, target = self.item_of(level, bond.source), self.item_of(level, bond.target)
                if source is not None and target is not None and source != target:
                    links.append(Link(index, source, target))
        return links

    def block(self, level: str, left: tuple[int, ...], right: tuple[int, ...]) -> Block:
        """Lay out one level; ``left`` and ``right`` are the bonds that leave it there, from top to bottom."""
        items: list[Item] = []
        for name in self.backbone.names:
            item = self.item_of(level, name)
            if item is not None and item not in items:
                items.append(item)
        outside: dict[int, Item] = {}
        for index in (*left, *right):
            bond = self.drawing.bonds[index]
            inner = self.item_of(level, bond.source) or self.item_of(level, bond.target)
            if inner is not None:
                outside[index] = inner
        ranks = {item: self.rank(item) for item in items}
        return place_level(ranks, self.links(level), outside, left, right, self._item_block)

    def _item_block(self, item: Item, left: tuple[int, ...], right: tuple[int, ...]) -> Block:
        if item.form == "node":
            return cell(item.name, self._hangers(item.name), self.labels[item.name], left, right)
        return self.block(item.name, left, right).framed(item.name, FRAME_TITLE, FRAME_PADDING)

    def _hangers(self, host: str) -> list[Hanger]:
        """One-port elements and dead-end junctions at a node, as blocks."""
        hangers = []
        for index in self.hanging.get(host, []):
            bond = self.drawing.bonds[index]
            name = other_end(bond, host)
            block = None
            if name in self.backbone.pendants:
                block = cell(name, self._hangers(name), self.labels[name], (), (), hangs=True)
            hangers.append(Hanger(index, name, self.kinds[name], bond.source == host, self.labels[name], block))
        return hangers


def _finish(block: Block, plan: _Plan) -> Layout:
    """Shift the outermost block so that everything has positive coordinates, and orient the bonds."""
    top = block.moved(block.left, block.above)
    frames = tuple(Frame(name, box, name.count(".") + 1) for name, box in top.frames)
    paths = []
    for index, bond in enumerate(plan.drawing.bonds):
        path = simplified(top.routes[index])
        box = top.boxes[bond.source].grown(1)
        starts = box.left <= path[0][0] <= box.right and box.top <= path[0][1] <= box.bottom
        paths.append(path if starts else path[::-1])
    return Layout(top.boxes, plan.labels, frames, tuple(paths))
