"""Nodes and bonds of a corrected graph as Python lines: junctions, elements, what stands in the middle of a bond.

Nodes and bonds are written in the order in which the corrected graph has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from sympy import Expr

from bondgraph.declare.domains import DOMAINS, Domain
from bondgraph.declare.elements import Bond, Node
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import ParameterStart
from bondgraph.report.python_expressions import UnwritableError, Writer

#: Own variables of laws by what they give.
_OWN: Mapping[str, Mapping[str, str]] = {
    "R": {"effort": "flow", "flow": "effort"},
    "C": {"effort": "displacement", "displacement": "effort"},
    "I": {"flow": "momentum", "momentum": "flow"},
}
#: The law that a builder takes as its first argument; others are named.
_FIRST = {"R": "effort", "C": "effort"}
_BUILDERS = {"R": "resistance", "C": "compliance", "I": "inertance", "Se": "effort_source", "Sf": "flow_source"}
_JUNCTIONS = {"0": "zero_junction", "1": "one_junction"}
_EDITING, _ELEMENTS, _REVISION = (f"bondgraph.declare.{name}" for name in ("editing", "elements", "revision"))


def write_nodes(writer: Writer, before: BondGraph, after: BondGraph) -> None:
    """Add lines for what was added, changed, or put into the middle of a bond.

    Raises
    ------
    UnwritableError
        Where there are none.
    """
    change = _Change(writer, before, after)
    for name, node in after.nodes.items():
        if name in change.written:
            continue
        if name not in before.nodes:
            change.add(node)
        elif node.laws != before.nodes[name].laws:
            _revise(writer, before.nodes[name], node)
    change.add_bonds(len(after.bonds))
    if left := change.removed:
        raise UnwritableError(f"the bond {left[0]}, which it lacks")


def _revise(writer: Writer, old: Node, node: Node) -> None:
    """Lines for the laws of an element that were changed, or for all where it has others than it had."""
    if [given for given, _ in old.laws] == [given for given, _ in node.laws]:
        revise = writer.use(_REVISION, "revise_law")
        for given, law in [one for one in node.laws if one not in old.laws]:
            text = writer.expression(law)
            writer.lines.append(f"{revise}(g, {node.name!r}, {given!r}, {text})")
        return
    texts = ", ".join(f"{given!r}: {writer.expression(law)}" for given, law in node.laws)
    writer.lines.append(f"{writer.use(_REVISION, 'revise_laws')}(g, {node.name!r}, lambda laws: {{{texts}}})")


@dataclass
class _Change:
    """The first graph as lines have changed it: names of nodes, and bonds that are still to come or to go."""

    writer: Writer
    before: BondGraph
    after: BondGraph
    written: set[str] = field(default_factory=set)
    removed: list[Bond] = field(init=False)
    _new: list[tuple[int, Bond]] = field(init=False)

    def __post_init__(self) -> None:
        left = list(self.before.bonds)
        self._new = []
        for place, bond in enumerate(self.after.bonds):
            if bond in left:
                left.remove(bond)
            else:
                self._new.append((place, bond))
        self.removed = left

    def add(self, node: Node) -> None:
        """Write a node that is new, after the bonds that come before its own."""
        ends = [(place, bond) for place, bond in self._new if node.name in (bond.source, bond.target)]
        if node.kind in _JUNCTIONS:
            self._add_junction(node, [bond for _, bond in ends])
        elif len(ends) == 1 and node.kind in _BUILDERS:
            self._add_element(node, *ends[0])
        else:
            raise UnwritableError(f"the element {node.name}")

    def add_bonds(self, place: int) -> None:
        """Write the new bonds that stand before a place."""
        for own in [one for one in self._new if one[0] < place]:
            bond = own[1]
            if any(end not in self.before.nodes and end not in self.written for end in (bond.source, bond.target)):
                continue  # of a node that comes later
            self.writer.lines.append(f"g.bond({bond.source!r}, {bond.target!r})")
            self._new.remove(own)

    def _add_junction(self, node: Node, ends: list[Bond]) -> None:
        domain = _domain(self.writer, node.domain)
        split = next(
            (one for one in self.removed if {Bond(one.source, node.name), Bond(node.name, one.target)} <= {*ends}), None
        )
        if split is None:
            self.writer.lines.append(f"g.{_JUNCTIONS[node.kind]}({node.name!r}{f', {domain}' if domain else ''})")
        else:
            editing = self.writer.use(_EDITING, "split_bond")
            bond, made = (self.writer.use(_ELEMENTS, name) for name in ("Bond", "Node"))
            given = f"{node.name!r}, {node.kind!r}{f', {domain}' if domain else ''}"
            self.writer.lines.append(f"{editing}(g, {bond}({split.source!r}, {split.target!r}), {made}({given}))")
            self.removed.remove(split)
            inside = (Bond(split.source, node.name), Bond(node.name, split.target))
            self._new = [one for one in self._new if one[1] not in inside]
        self.written.add(node.name)

    def _add_element(self, node: Node, place: int, bond: Bond) -> None:
        self.add_bonds(place)
        junction = bond.source if bond.target == node.name else bond.target
        shares = self._sharing(node.name) if junction == f"flow_of_{node.name}" else None
        method = f"g.{_BUILDERS[node.kind]}"
        self.writer.lines.append(f"{method}({node.name!r}, {_laws(self.writer, node)}, at={(shares or junction)!r})")
        self._done(node.name)
        if shares:
            self._share(node.name)

    def _sharing(self, element: str) -> str | None:
        """The junction at which a source acts in the place of an element, see ``share_effort``."""
        return next((bond.target for _, bond in self._new if bond.source == f"share_of_{element}"), None)

    def _share(self, element: str) -> None:
        law = self.after.nodes[f"share_of_{element}"].law("effort")
        if law is None:
            raise UnwritableError(f"the element share_of_{element}")
        share: Expr = -law / signal("effort", element)
        function = self.writer.use(_EDITING, "share_effort")
        self.writer.lines.append(f"{function}(g, {element!r}, {self.writer.expression(share)})")
        self._done(f"flow_of_{element}", f"share_of_{element}")

    def _done(self, *names: str) -> None:
        """Nodes that are written with their bonds to what is written or was there."""
        self.written.update(names)
        self._new = [one for one in self._new if not {one[1].source, one[1].target} & {*names}]


def _domain(writer: Writer, domain: Domain | None) -> str:
    if domain is None:
        return ""
    if DOMAINS.get(domain.name) == domain:
        return writer.use("bondgraph.declare.domains", domain.name.upper())
    writer.use("bondgraph.declare.domains", "Domain")
    return repr(domain)


def _laws(writer: Writer, node: Node) -> str:
    own = _OWN.get(node.kind)
    if own is None:
        ((_, law),) = node.laws
        return writer.expression(law)
    texts = []
    for given, law in node.laws:
        if given not in own:
            raise UnwritableError(f"the law of {node.name}")
        text = f"lambda {own[given]}: {writer.expression(law, {own[given]})}"
        texts.append(text if given == _FIRST.get(node.kind) else f"{given}={text}")
    if isinstance(node.start(), ParameterStart):
        texts.append(f"initial={str(node.start())!r}")
    elif any(node.initial):
        texts.append(f"{'guess' if node.kind == 'R' else 'initial'}={node.initial[0]!r}")
    if node.state:
        texts.append(f"state={node.state!r}")
    return ", ".join(texts)
