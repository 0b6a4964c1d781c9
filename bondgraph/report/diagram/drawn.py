"""What is drawn: nodes with their laws, bonds with their strokes, modulating signals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bondgraph.errors import DeclarationError, suggest
from bondgraph.shown import Drawn
from bondgraph.text import count

Kind = Literal["0", "1", "Se", "Sf", "R", "C", "I", "TF", "GY"]
Stroke = Literal["source", "target"]

JUNCTIONS = ("0", "1")


@dataclass(frozen=True)
class DrawnNode:
    """One node: ``name`` is dotted inside sub-graphs, ``law`` and ``note`` are shown below the name (may be empty)."""

    name: str
    kind: Kind
    domain: str = ""
    law: str = ""
    note: str = ""


@dataclass(frozen=True)
class DrawnBond:
    """One bond, pointing the way of positive power; ``stroke`` is the end that receives the effort, None if unknown."""

    source: str
    target: str
    stroke: Stroke | None = None


@dataclass(frozen=True, repr=False)
class Drawing(Drawn):
    """A bond graph reduced to what a picture shows.

    ``signals`` are pairs (from, to) of node names: the second is modulated by a variable of the first. ``definitions``
    are pairs (name, text) of named expressions that laws use.

    Raises
    ------
    DeclarationError
        If a bond or signal names a node that is not there, or a name is used twice.

    Examples
    --------
    >>> Drawing("pair", (DrawnNode("a", "1"), DrawnNode("b", "R")), (DrawnBond("a", "b"),))
    <Drawing pair: 2 nodes, 1 bond>
    >>> Drawing("pair", (DrawnNode("a", "1"),), (DrawnBond("a", "b"),))
    Traceback (most recent call last):
    ...
    bondgraph.errors.DeclarationError: pair: bond a -> b ends at 'b', which is not a node of the drawing
    """

    title: str
    nodes: tuple[DrawnNode, ...]
    bonds: tuple[DrawnBond, ...]
    signals: tuple[tuple[str, str], ...] = ()
    definitions: tuple[tuple[str, str], ...] = ()

    def __repr__(self) -> str:
        return f"<Drawing {self.title}: {count(len(self.nodes), 'node')}, {count(len(self.bonds), 'bond')}>"

    def __post_init__(self) -> None:
        known: set[str] = set()
        for node in self.nodes:
            if node.name in known:
                raise DeclarationError(f"{self.title}: two nodes are named {node.name!r}", where=(node.name,))
            known.add(node.name)
        ends = [
            (f"bond {bond.source} -> {bond.target}", end) for bond in self.bonds for end in (bond.source, bond.target)
        ]
        ends += [(f"signal {pair[0]} -> {pair[1]}", end) for pair in self.signals for end in pair]
        for what, end in ends:
            if end not in known:
                raise DeclarationError(
                    f"{self.title}: {what} ends at {end!r}, which is not a node of the drawing{suggest(end, known)}",
                    where=(what,),
                )

    def node(self, name: str) -> DrawnNode:
        """The node of that name."""
        return next(node for node in self.nodes if node.name == name)


def frame_of(name: str) -> str:
    """Dotted name of the innermost sub-graph a node lies in; empty at the top.

    Examples
    --------
    >>> frame_of("axle.rear.hub"), frame_of("body")
    ('axle.rear', '')
    """
    return name.rpartition(".")[0]


def local_name(name: str) -> str:
    """Name of a node within its sub-graph.

    Examples
    --------
    >>> local_name("axle.hub")
    'hub'
    """
    return name.rpartition(".")[2]


def other_end(bond: DrawnBond, name: str) -> str:
    """The node at the other end of a bond.

    Examples
    --------
    >>> other_end(DrawnBond("a", "b"), "b")
    'a'
    """
    return bond.target if bond.source == name else bond.source
