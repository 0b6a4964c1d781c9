"""One level of the layout: its items ordered in layers, their blocks made, arranged and joined to one block."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from bondgraph.report.diagram.arrangement import Grid, Item, arrange
from bondgraph.report.diagram.cells import Block
from bondgraph.report.diagram.geometry import Box, Path
from bondgraph.report.diagram.layers import assign_layers, order_layers


@dataclass(frozen=True)
class Link:
    """A bond between two items of one level."""

    bond: int
    source: Item
    target: Item


ItemBlock = Callable[[Item, tuple[int, ...], tuple[int, ...]], Block]


def place_level(
    ranks: Mapping[Item, float],
    links: Sequence[Link],
    outside: Mapping[int, Item],
    left: tuple[int, ...],
    right: tuple[int, ...],
    item_block: ItemBlock,
) -> Block:
    """Lay out the items of one level and the bonds between them.

    Parameters
    ----------
    ranks
        The items, each with its position along the power path.
    links
        Bonds between items.
    outside
        For each bond that leaves the level, the item it starts from.
    left, right
        The bonds that leave on each side, from top to bottom.
    item_block
        Makes the block of an item, given the bonds on its left and right side from top to bottom.
    """
    grid = _grid(ranks, links, outside, left, right)
    blocks = _blocks(grid, item_block)
    arrangement = arrange(grid, blocks, may_fold=not left and not right)
    placed = [block.moved(*point) for block, point in zip(blocks, arrangement.points, strict=True)]
    full = _whole_bonds(grid, placed, arrangement.pieces)
    ports = {("left", bond): full[bond][0] for bond in left} | {("right", bond): full[bond][-1] for bond in right}
    routes = {bond: path for block in placed for bond, path in block.routes.items()}
    routes |= {bond: path for bond, path in full.items() if bond not in outside}
    boxes: dict[str, Box] = {name: box for block in placed for name, box in block.boxes.items()}
    frames = tuple(frame for block in placed for frame in block.frames)
    half_width, half_height = arrangement.width / 2, arrangement.height / 2
    open_routes = {bond: full[bond] for bond in outside}
    whole = Block(half_width, half_width, half_height, half_height, boxes, frames, routes, ports, open_routes)
    return whole.moved(-half_width, -half_height)


def _grid(
    ranks: Mapping[Item, float],
    links: Sequence[Link],
    outside: Mapping[int, Item],
    left: tuple[int, ...],
    right: tuple[int, ...],
) -> Grid:
    """Layers, bends of long bonds and the order within the layers."""
    items = list(ranks)
    index = {item: i for i, item in enumerate(items)}
    ends: list[tuple[int, int, int]] = []
    for link in links:
        a, b = sorted((index[link.source], index[link.target]), key=lambda i: (ranks[items[i]], i))
        ends.append((link.bond, a, b))
    layer = [value + bool(left) for value in assign_layers(len(items), [(a, b) for _, a, b in ends])]
    last = max(layer) + 1
    for side, bonds, place in (("left", left, 0), ("right", right, last)):
        for bond in bonds:
            items.append(Item("port", f"{side} {bond}"))
            layer.append(place)
            inner, port = index[outside[bond]], len(items) - 1
            ends.append((bond, port, inner) if side == "left" else (bond, inner, port))
    grid = Grid(items, layer)
    for bond, a, b in ends:
        _add_pieces(grid, bond, a, b)
    columns = [[i for i, value in enumerate(grid.layer) if value == k] for k in range(max(grid.layer) + 1)]
    fixed = frozenset([0] * bool(left) + [len(columns) - 1] * bool(right))
    grid.columns = order_layers(columns, [(a, b) for _, a, b in grid.pieces], fixed).layers
    return grid


def _add_pieces(grid: Grid, bond: int, a: int, b: int) -> None:
    """Split a bond that spans several layers by bends."""
    start = a
    for place in range(grid.layer[a] + 1, grid.layer[b]):
        grid.items.append(Item("bend", f"{bond} {place}"))
        grid.layer.append(place)
        grid.pieces.append((bond, start, len(grid.items) - 1))
        start = len(grid.items) - 1
    grid.pieces.append((bond, start, b))


def _blocks(grid: Grid, item_block: ItemBlock) -> list[Block]:
    """The block of every item; ports and bends are points."""
    blocks = []
    for i, item in enumerate(grid.items):
        bonds = {side: tuple(piece[0] for piece in grid.pieces_at(i, side)) for side in ("left", "right")}
        if item.form in ("node", "frame"):
            blocks.append(item_block(item, bonds["left"], bonds["right"]))
        else:
            ports = {(side, bond): (0.0, 0.0) for side in bonds for bond in bonds[side]}
            blocks.append(Block(0.0, 0.0, 0.0, 0.0, {}, ports=ports))
    return blocks


def _whole_bonds(grid: Grid, placed: Sequence[Block], pieces: Mapping[tuple[int, int], Path]) -> dict[int, Path]:
    """The polyline of every bond from left to right, including its parts inside the sub-graphs at its ends."""
    full: dict[int, Path] = {}
    last: dict[int, int] = {}
    for bond, a, b in grid.pieces:
        before = full[bond] if bond in full else placed[a].open_routes.get(bond, ())
        full[bond] = (*before, *pieces[bond, a])
        last[bond] = b
    return {bond: (*path, *placed[last[bond]].open_routes.get(bond, ())) for bond, path in full.items()}
