"""A backbone node with the one-port elements around it, as one block of the layout."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from bondgraph.report.diagram.geometry import Box, Path, moved_path
from bondgraph.report.diagram.labels import Label

EXIT_SPACING = 14.0
LEAF_BOND = 34.0
LEAF_GAP = 12.0
_ORDER = {"Se": 0, "Sf": 0, "I": 1, "C": 2, "R": 3}


@dataclass(frozen=True)
class Block:
    """Something placed as a whole; all coordinates relative to its reference point.

    ``left``, ``right``, ``above``, ``below`` are its extents. ``ports`` gives for (side, bond) the point where the bond
    leaves, ``open_routes`` the part of that bond inside the block, from left to right.
    """

    left: float
    right: float
    above: float
    below: float
    boxes: Mapping[str, Box]
    frames: tuple[tuple[str, Box], ...] = ()
    routes: Mapping[int, Path] = field(default_factory=dict)
    ports: Mapping[tuple[str, int], tuple[float, float]] = field(default_factory=dict)
    open_routes: Mapping[int, Path] = field(default_factory=dict)

    def moved(self, dx: float, dy: float) -> Block:
        """The block with its contents shifted; the extents stay relative to the old reference point."""
        return Block(
            self.left, self.right, self.above, self.below,
            {name: box.moved(dx, dy) for name, box in self.boxes.items()},
            tuple((name, box.moved(dx, dy)) for name, box in self.frames),
            {bond: moved_path(path, dx, dy) for bond, path in self.routes.items()},
            {key: (x + dx, y + dy) for key, (x, y) in self.ports.items()},
            {bond: moved_path(path, dx, dy) for bond, path in self.open_routes.items()},
        )  # fmt: skip

    def framed(self, name: str, title: float, padding: float) -> Block:
        """The block inside a frame with room for a title; the frame passes through the ports."""
        above, below = self.above + title, self.below + padding
        box = Box(-self.left, -above, self.left + self.right, above + below)
        return Block(
            self.left, self.right, above, below,
            self.boxes, ((name, box), *self.frames), self.routes, self.ports, self.open_routes,
        )  # fmt: skip


@dataclass(frozen=True)
class Hanger:
    """A one-port element, or a dead-end junction with its elements (then ``block`` is set), at a junction."""

    bond: int
    name: str
    kind: str
    outwards: bool
    label: Label
    block: Block | None = None


def cell(
    name: str, hangers: Sequence[Hanger], own: Label, left: Sequence[int], right: Sequence[int], hangs: bool = False
) -> Block:
    """Place a node at the origin and what hangs at it on the sides that no backbone bond uses.

    ``left`` and ``right`` are the backbone bonds that leave on those sides, from top to bottom. Sources stand on the
    left where they can, storages above, resistances below; a dead-end junction hangs below, a second one above. A node
    that ``hangs`` itself keeps its upper side free.
    """
    height = max(own.height, EXIT_SPACING * max(len(left), len(right)) + 8)
    box = Box(-own.width / 2, -height / 2, own.width, height)
    leaves = sorted((end for end in hangers if end.block is None), key=lambda end: _ORDER.get(end.kind, 2))
    pendants = [end for end in hangers if end.block is not None]
    slots = _hanging_slots(leaves) if hangs else _slots(leaves, bool(left), bool(right), len(pendants))
    block = Block(box.width / 2, box.width / 2, height / 2, height / 2, {name: box}, ports=_ports(box, left, right))
    for slot, members in slots.items():
        for leaf, leaf_box, path in _stand(members, slot, box):
            block = _with(block, {leaf.name: leaf_box}, {leaf.bond: path if leaf.outwards else path[::-1]})
    for k, pendant in enumerate(pendants):
        block = _hung(block, pendant, box, k == 0)
    return block


def _ports(box: Box, left: Sequence[int], right: Sequence[int]) -> dict[tuple[str, int], tuple[float, float]]:
    ports: dict[tuple[str, int], tuple[float, float]] = {}
    for side, bonds, x in (("left", left, box.left), ("right", right, box.right)):
        for k, bond in enumerate(bonds):
            ports[side, bond] = (x, (k - (len(bonds) - 1) / 2) * EXIT_SPACING)
    return ports


def _with(block: Block, boxes: Mapping[str, Box], routes: Mapping[int, Path]) -> Block:
    """The block with more in it and its extents grown accordingly."""
    return Block(
        max(block.left, *(-box.left for box in boxes.values())),
        max(block.right, *(box.right for box in boxes.values())),
        max(block.above, *(-box.top for box in boxes.values())),
        max(block.below, *(box.bottom for box in boxes.values())),
        {**block.boxes, **boxes}, block.frames, {**block.routes, **routes}, block.ports,
    )  # fmt: skip


def _hung(block: Block, pendant: Hanger, host: Box, below: bool) -> Block:
    """The block with a dead-end junction below it, or upside down above it."""
    inner = pendant.block
    if inner is None:
        return block
    own = inner.boxes[pendant.name]
    sign = 1 if below else -1
    shift = sign * (host.height / 2 + LEAF_BOND + own.height / 2)
    boxes = {name: _flipped(box, sign).moved(0.0, shift) for name, box in inner.boxes.items()}
    routes = {bond: tuple((x, sign * y + shift) for x, y in path) for bond, path in inner.routes.items()}
    path: Path = ((0.0, sign * host.height / 2), (0.0, shift - sign * own.height / 2))
    routes[pendant.bond] = path if pendant.outwards else path[::-1]
    return _with(block, boxes, routes)


def _flipped(box: Box, sign: int) -> Box:
    return box if sign > 0 else Box(box.left, -box.bottom, box.width, box.height)


def _slots(leaves: list[Hanger], left_used: bool, right_used: bool, pendants: int) -> dict[str, list[Hanger]]:
    """Sides for the one-ports: a source to the left, an odd one out to the right, the others half above, half below."""
    rest = list(leaves)
    slots: dict[str, list[Hanger]] = {"left": [], "right": [], "above": [], "below": []}
    if not left_used and rest and (rest[0].kind in ("Se", "Sf") or (len(rest) % 2 == 1 and right_used)):
        slots["left"] = [rest.pop(0)]
    if not right_used and len(rest) % 2 == 1:
        slots["right"] = [rest.pop()]
    half = len(rest) if pendants else (len(rest) + 1) // 2
    slots["above"], slots["below"] = rest[:half], rest[half:]
    return slots


def _hanging_slots(leaves: list[Hanger]) -> dict[str, list[Hanger]]:
    """Sides for the one-ports of a node that hangs: one or two below, a third to the right."""
    return {"right": leaves[2:], "below": leaves[:2]}


def _stand(leaves: Sequence[Hanger], slot: str, box: Box) -> Iterable[tuple[Hanger, Box, Path]]:
    """Boxes and bonds (from the junction outwards) of the one-ports on one side."""
    if slot in ("left", "right"):
        for leaf in leaves:
            label, sign = leaf.label, -1 if slot == "left" else 1
            near = sign * (box.width / 2 + LEAF_BOND)
            place = Box(near if sign > 0 else near - label.width, -label.height / 2, label.width, label.height)
            yield leaf, place, ((sign * box.width / 2, 0.0), (near, 0.0))
        return
    sign = -1 if slot == "above" else 1
    total = sum(leaf.label.width for leaf in leaves) + LEAF_GAP * (len(leaves) - 1)
    x = -total / 2
    near = sign * (box.height / 2 + LEAF_BOND)
    for k, leaf in enumerate(leaves):
        label = leaf.label
        place = Box(x, near if sign > 0 else near - label.height, label.width, label.height)
        step = min(16.0, (box.width - 12) / max(len(leaves), 1))
        start = (k - (len(leaves) - 1) / 2) * step
        yield leaf, place, ((start, sign * box.height / 2), (x + label.width / 2, near))
        x += label.width + LEAF_GAP
