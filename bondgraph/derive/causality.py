"""Causality: a stroke for every bond, with the reason for each.

Sources and laws that exist in one form only fix their strokes first, then every storage chooses integral causality in
order of declaration where that is possible, then what is left follows the declared form of the laws. See
:mod:`bondgraph.derive.strokes` for the procedure.

The causal stroke of a bond marks the end that receives the effort; the other end receives the flow.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from bondgraph.declare.elements import LAW_GIVES, STORAGES, TWO_PORTS, Bond, Node
from bondgraph.declare.functions import switch
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.algebra import algebra
from bondgraph.derive.patterns import Pattern, stroke_patterns
from bondgraph.derive.refusals import clash, explain_chain, refusal, refuse_law, refuse_rings
from bondgraph.derive.strokes import ContradictionError, Decision, Reason, ReasonKind, StrokeSearch
from bondgraph.errors import CausalityError, suggest
from bondgraph.shown import Drawn
from bondgraph.text import count

__all__ = ["CausalGraph", "Reason", "ReasonKind", "Stroke", "assign_causality", "explain_chain"]

Stroke = Literal["source", "target"]


@dataclass(frozen=True, repr=False)
class CausalGraph(Drawn):
    """A flat bond graph with every stroke placed.

    ``strokes[i]`` is the end of bond i that receives the effort; ``reasons[i]`` says why; ``derivative`` names the
    storages (with their port, for fields) whose energy variable follows from the independent ones.
    """

    graph: BondGraph
    strokes: tuple[Stroke, ...]
    reasons: tuple[Reason, ...]
    derivative: tuple[tuple[str, int], ...]

    def __repr__(self) -> str:
        return f"<CausalGraph {self.graph.name}: {count(len(self.strokes), 'bond')}, {len(self.derivative)} dependent>"

    @functools.cached_property
    def bonds(self) -> tuple[Bond, ...]:
        """The bonds of the graph."""
        return self.graph.bonds

    def receives_effort(self, bond: int, node: str) -> bool:
        """Whether the effort of a bond acts on ``node``, that is, whether the stroke is at this end."""
        ends = self.bonds[bond]
        return (ends.target if self.strokes[bond] == "target" else ends.source) == node

    def explain(self, bond: int) -> str:
        """The chain of reasons of one stroke, as text."""
        return explain_chain(self.graph, self.reasons, bond)


def assign_causality(graph: BondGraph, independent: Sequence[str] = ()) -> CausalGraph:
    """Place every causal stroke of a graph.

    Parameters
    ----------
    graph
        The declared graph; parts are flattened.
    independent
        Storages that choose first, where several could be independent; the others follow in order of declaration. One
        port of a field is given as ``field.2``.

    Raises
    ------
    DeclarationError
        If the graph is not complete.
    CausalityError
        If two laws or sources impose the same variable; the message names the chain and both culprits.

    Examples
    --------
    >>> g = BondGraph("rc")
    >>> z = g.zero_junction("z")
    >>> _ = g.flow_source("s", 1.0, at=z)
    >>> _ = g.compliance("c", 1e6, at=z)
    >>> causal = assign_causality(g)
    >>> causal.strokes, causal.reasons[0].text
    (('source', 'source'), 'source s imposes the flow')
    """
    flat = graph.flatten()
    flat.validate()
    first = [_storage_port(flat, name) for name in dict.fromkeys(independent)]
    refuse_rings(flat)
    return _Assignment(flat).run(first)


def _storage_port(graph: BondGraph, name: str) -> tuple[Node, int]:
    """A storage by its name and the port that is meant, 0 for all."""
    storages = {node.name: node for node in graph.nodes.values() if node.kind in STORAGES}
    if name in storages:
        return storages[name], 0
    field, _, port = name.rpartition(".")
    if field in storages and port.isdigit() and 1 <= int(port) <= storages[field].ports:
        return storages[field], int(port)
    raise CausalityError(f"{graph.name}: no storage {name!r}{suggest(name, storages)}", where=(name,))


class _Assignment:
    """What the nodes of one graph ask for, in order of preference."""

    def __init__(self, graph: BondGraph) -> None:
        self.graph = graph
        self.patterns = {}
        for node in graph.nodes.values():
            with algebra(f"{graph.name}: {node.name}"):
                self.patterns[node.name] = stroke_patterns(node)
        several = {name: allowed for name, allowed in self.patterns.items() if allowed and len(allowed) > 1}
        self.search = StrokeSearch(graph, several)

    def run(self, first: Sequence[tuple[Node, int]]) -> CausalGraph:
        nodes = list(self.graph.nodes.values())
        storages = [*first, *((node, 0) for node in nodes if node.kind in STORAGES)]
        try:
            self.search.run([
                *(decision for node in nodes if node.kind in ("Se", "Sf") for decision in self._source(node)),
                *(decision for node in nodes for decision in self._law(node)),
                *(decision for node, port in storages for decision in self._storage(node, port)),
                *(decision for node in nodes for decision in self._element(node)),
                *(self._rest(bond) for bond in range(len(self.search.bonds))),
            ])  # fmt: skip
        except ContradictionError as contradiction:
            raise refusal(self.search, contradiction) from None
        return self._result()

    # ------------------------------------------------------------------ decisions

    def _source(self, node: Node) -> list[Decision]:
        gives = "effort" if node.kind == "Se" else "flow"
        reason = Reason("source", node.name, f"source {node.name} imposes the {gives}")
        return [Decision(bond, (node.kind == "Sf") == inward, reason) for bond, inward in self._bonds(node)]

    def _law(self, node: Node) -> list[Decision]:
        """Laws that allow one pattern only, and two-ports that can open: the other stroke would divide by zero."""
        if node.kind in TWO_PORTS and node.laws[0][1].has(switch):
            return [self._openable(node, bond, inward) for bond, inward in self._bonds(node)]
        allowed = self.patterns[node.name]
        if allowed is None or len(allowed) != 1:
            return []
        found = []
        for (bond, inward), takes_effort in zip(self._bonds(node), allowed[0], strict=True):
            reason = Reason("law", node.name, f"law of {node.name} gives the {'flow' if takes_effort else 'effort'}")
            found.append(Decision(bond, takes_effort == inward, reason))
        return found

    def _openable(self, node: Node, bond: int, inward: bool) -> Decision:
        takes_effort = node.kind == "TF" and not inward
        gives = "flow" if takes_effort else "effort"
        reason = Reason("law", node.name, f"{node.kind} {node.name}, whose modulus can become zero, gives the {gives}")
        return Decision(bond, takes_effort == inward, reason)

    def _storage(self, node: Node, port: int) -> list[Decision]:
        reason = Reason("integral", node.name, f"{node.name} in integral causality gives the {LAW_GIVES[node.kind]}")

        def otherwise(contradiction: ContradictionError, causes: Sequence[int]) -> Reason:
            text = f"{node.name} in derivative causality, since in integral causality "
            return Reason("derivative", node.name, text + clash(self.search, contradiction, causes), tuple(causes))

        bonds = self._bonds(node)[port - 1 : port] if port else self._bonds(node)
        return [Decision(bond, (node.kind == "I") == inward, reason, otherwise) for bond, inward in bonds]

    def _element(self, node: Node) -> list[Decision]:
        """Laws that allow several patterns take the declared form where they can."""
        if node.kind not in ("R", "X"):
            return []
        declared = (self.patterns[node.name] or (_declared(node),))[0]
        return [
            self._free(bond, takes_effort == inward, node.name)
            for (bond, inward), takes_effort in zip(self._bonds(node), declared, strict=True)
        ]

    def _rest(self, bond: int) -> Decision:
        """What nothing asks for: bonds in a ring of junctions or two-ports."""
        return self._free(bond, True, self.search.bonds[bond].target)

    def _free(self, bond: int, at_target: bool, node: str) -> Decision:
        def otherwise(contradiction: ContradictionError, causes: Sequence[int]) -> Reason:
            text = f"with the other stroke {clash(self.search, contradiction, causes)}"
            return Reason("propagated", node, text, tuple(causes))

        reason = Reason("chosen", node, f"chosen at {node}, nothing asks for the other stroke")
        return Decision(bond, at_target, reason, otherwise)

    def _bonds(self, node: Node) -> list[tuple[int, bool]]:
        return self.search.incidence[node.name]

    # ------------------------------------------------------------------ result

    def _result(self) -> CausalGraph:
        strokes: list[Stroke] = ["target" if at_target else "source" for at_target in self.search.at_target]
        reasons = [reason for reason in self.search.reasons if reason is not None]
        derivative = []
        for node in self.graph.nodes.values():
            for port, (bond, inward) in enumerate(self._bonds(node) if node.kind in STORAGES else (), start=1):
                if self.search.receives(bond, inward) != (node.kind == "I"):
                    refuse_law(self.search, node, bond)
                    derivative.append((node.name, port))
        return CausalGraph(self.graph, tuple(strokes), tuple(reasons), tuple(derivative))


def _declared(node: Node) -> Pattern:
    return (node.laws[0][0].startswith("flow"),) * node.ports


def bond_labels(causal: CausalGraph) -> list[str]:
    """``a->b`` for every bond; parallel bonds between the same nodes are numbered ``a->b#2``."""
    seen: dict[str, int] = {}
    labels = []
    for bond in causal.graph.bonds:
        label = f"{bond.source}->{bond.target}"
        seen[label] = seen.get(label, 0) + 1
        labels.append(label if seen[label] == 1 else f"{label}#{seen[label]}")
    return labels
