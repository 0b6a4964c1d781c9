"""Causality: the sequential causality assignment procedure (SCAP), with the reason for every stroke.

Source: Karnopp, Margolis, Rosenberg, *System Dynamics*, 5th ed. (2012), section 5.2. Laws that exist in one form only fix
their stroke before storages choose, so that a storage never ends up differentiating through a law.

The causal stroke of a bond marks the end that receives the effort; the other end receives the flow.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from bondgraph.declare.elements import STORAGES, Node
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.laws import law_strokes
from bondgraph.errors import CausalityError, suggest

Stroke = Literal["source", "target"]
ReasonKind = Literal["source", "law", "integral", "derivative", "propagated", "chosen"]


@dataclass(frozen=True)
class Reason:
    """Why a bond has its stroke: which node asked for it and which bonds made it necessary."""

    kind: ReasonKind
    node: str
    text: str
    causes: tuple[int, ...] = ()


@dataclass(frozen=True)
class CausalGraph:
    """A flat bond graph with every stroke placed.

    ``strokes[i]`` is the end of bond i that receives the effort; ``reasons[i]`` says why; ``derivative`` names the
    storages (with their port, for fields) whose energy variable follows from the independent ones.
    """

    graph: BondGraph
    strokes: tuple[Stroke, ...]
    reasons: tuple[Reason, ...]
    derivative: tuple[tuple[str, int], ...]

    def receives_effort(self, bond: int, node: str) -> bool:
        """Whether the effort of a bond acts on ``node``, that is, whether the stroke is at this end."""
        end = self.graph.bonds[bond].target if self.strokes[bond] == "target" else self.graph.bonds[bond].source
        return end == node

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
        Storages that choose first, where several could be independent; the others follow in order of declaration.

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
    graph.validate()
    for name in independent:
        if name not in flat.nodes or flat.nodes[name].kind not in STORAGES:
            storages = [node.name for node in flat.nodes.values() if node.kind in STORAGES]
            raise CausalityError(f"{graph.name}: no storage {name!r}{suggest(name, storages)}", where=(name,))
    return _Assignment(flat).run(independent)


class _Conflict(Exception):
    """Two demands on one junction, element or bond."""

    def __init__(self, node: str, bond: int, wanted: Reason, others: Iterable[int]) -> None:
        super().__init__(node)
        self.node, self.bond, self.wanted, self.others = node, bond, wanted, tuple(others)


class _Assignment:
    """Strokes placed so far, with a trail so that a trial can be taken back."""

    def __init__(self, graph: BondGraph) -> None:
        self.graph = graph
        self.incidence = graph.incidence()
        self.at_target: list[bool | None] = [None] * len(graph.bonds)
        self.reasons: list[Reason | None] = [None] * len(graph.bonds)
        self.trail: list[int] = []

    # ------------------------------------------------------------------ the procedure

    def run(self, independent: Sequence[str]) -> CausalGraph:
        nodes = list(self.graph.nodes.values())
        first = [self.graph.nodes[name] for name in independent]
        try:
            for node in nodes:
                if node.kind in ("Se", "Sf"):
                    gives = "effort" if node.kind == "Se" else "flow"
                    reason = Reason("source", node.name, f"source {node.name} imposes the {gives}")
                    self._element(node, 0, node.kind == "Sf", reason)
            for node in nodes:
                self._fix_law(node)
            for node in (*first, *nodes):
                if node.kind in STORAGES:
                    self._storage(node)
            for node in nodes:
                self._choose(node)
        except _Conflict as conflict:
            raise self._refusal(conflict) from None
        return self._result()

    def _element(self, node: Node, port: int, receives_effort: bool, reason: Reason) -> None:
        """Ask for a stroke at (or away from) an element's port."""
        bond, inward = self.incidence[node.name][port]
        self._assign(bond, receives_effort == inward, reason)
        self._propagate(bond)

    def _fix_law(self, node: Node) -> None:
        for port, receives_effort in enumerate(law_strokes(node)):
            if receives_effort is not None and node.kind == "R":
                gives = "flow" if receives_effort else "effort"
                reason = Reason("law", node.name, f"law of {node.name} gives the {gives}")
                self._element(node, port, receives_effort, reason)

    def _storage(self, node: Node) -> None:
        gives = "effort" if node.kind == "C" else "flow"
        for port in range(node.ports):
            bond, _ = self.incidence[node.name][port]
            if self.at_target[bond] is not None:
                continue
            mark = len(self.trail)
            reason = Reason("integral", node.name, f"{node.name} in integral causality gives the {gives}")
            try:
                self._element(node, port, node.kind == "I", reason)
            except _Conflict as conflict:
                self._rollback(mark)
                text = f"{node.name} in derivative causality, since in integral causality {self._clash(conflict)}"
                self._element(node, port, node.kind == "C", Reason("derivative", node.name, text))

    def _choose(self, node: Node) -> None:
        """Free laws take the form declared first; what is then left (junction rings) is chosen."""
        receives = [given.startswith("flow") for given, _ in node.laws[:1]] if node.kind == "R" else [True]
        for port, (bond, _) in enumerate(self.incidence[node.name]):
            if self.at_target[bond] is not None or (node.kind != "R" and not node.is_junction):
                continue
            mark = len(self.trail)
            reason = Reason("chosen", node.name, f"chosen at {node.name}, nothing asks for the other stroke")
            try:
                self._element(node, port, receives[0], reason)
            except _Conflict:
                self._rollback(mark)
                self._element(node, port, not receives[0], reason)

    # ------------------------------------------------------------------ propagation

    def _assign(self, bond: int, at_target: bool, reason: Reason) -> None:
        if self.at_target[bond] is None:
            self.at_target[bond] = at_target
            self.reasons[bond] = reason
            self.trail.append(bond)
        elif self.at_target[bond] != at_target:
            raise _Conflict(reason.node, bond, reason, (bond,))

    def _rollback(self, mark: int) -> None:
        while len(self.trail) > mark:
            bond = self.trail.pop()
            self.at_target[bond] = None
            self.reasons[bond] = None

    def _propagate(self, bond: int) -> None:
        start = self.graph.bonds[bond]
        queue = deque([start.source, start.target])
        while queue:
            node = self.graph.nodes[queue.popleft()]
            before = len(self.trail)
            if node.is_junction:
                self._propagate_junction(node)
            elif node.kind in ("TF", "GY"):
                self._propagate_two_port(node)
            for changed in self.trail[before:]:
                queue.extend(end for end in (self.graph.bonds[changed].source, self.graph.bonds[changed].target))

    def _receives(self, bond: int, inward: bool) -> bool | None:
        at_target = self.at_target[bond]
        return None if at_target is None else at_target == inward

    def _propagate_junction(self, node: Node) -> None:
        """One bond imposes the common variable: its effort acts on a 0-junction, its flow on a 1-junction."""
        strong_receives = node.kind == "0"
        bonds = self.incidence[node.name]
        states = [self._receives(bond, inward) for bond, inward in bonds]
        strong = [bond for (bond, _), state in zip(bonds, states, strict=True) if state is strong_receives]
        open_bonds = [pair for pair, state in zip(bonds, states, strict=True) if state is None]
        common = "effort" if node.kind == "0" else "flow"
        if len(strong) > 1:
            latest = max(strong, key=self.trail.index)
            others = [bond for bond in strong if bond != latest]
            reason = self.reasons[latest]
            assert reason is not None
            raise _Conflict(node.name, latest, reason, others)
        if strong:
            text = f"{self.graph.bonds[strong[0]]} imposes the {common} of {node.kind}-junction {node.name}"
            for bond, inward in open_bonds:
                self._assign(bond, (not strong_receives) == inward, Reason("propagated", node.name, text, (strong[0],)))
        elif len(open_bonds) == 1:
            bond, inward = open_bonds[0]
            text = f"only this bond is left to impose the {common} of {node.kind}-junction {node.name}"
            causes = tuple(other for other, _ in bonds if other != bond)
            self._assign(bond, strong_receives == inward, Reason("propagated", node.name, text, causes))
        elif not open_bonds:
            latest = max((bond for bond, _ in bonds), key=self.trail.index)
            reason = self.reasons[latest]
            assert reason is not None
            raise _Conflict(node.name, latest, reason, ())

    def _propagate_two_port(self, node: Node) -> None:
        (bond_a, inward_a), (bond_b, inward_b) = self.incidence[node.name]
        a, b = self._receives(bond_a, inward_a), self._receives(bond_b, inward_b)
        opposite = node.kind == "TF"
        if a is not None and b is not None:
            if (a != b) != opposite:
                latest, other = sorted((bond_a, bond_b), key=self.trail.index, reverse=True)
                reason = self.reasons[latest]
                assert reason is not None
                raise _Conflict(node.name, latest, reason, (other,))
            return
        for known, bond, inward, cause in ((a, bond_b, inward_b, bond_a), (b, bond_a, inward_a, bond_b)):
            if known is not None:
                kind = "transformer" if opposite else "gyrator"
                reason = Reason("propagated", node.name, f"carried through the {kind} {node.name}", (cause,))
                self._assign(bond, (known != opposite) == inward, reason)

    # ------------------------------------------------------------------ result and refusals

    def _result(self) -> CausalGraph:
        strokes: list[Stroke] = ["target" if at_target else "source" for at_target in self.at_target]
        reasons = [reason for reason in self.reasons if reason is not None]
        derivative = []
        for node in self.graph.nodes.values():
            for port in range(node.ports if node.kind in STORAGES else 0):
                bond, inward = self.incidence[node.name][port]
                if self._receives(bond, inward) != (node.kind == "I"):
                    self._check_not_by_law(node, bond)
                    derivative.append((node.name, port + 1))
        return CausalGraph(self.graph, tuple(strokes), tuple(reasons), tuple(derivative))

    def _check_not_by_law(self, node: Node, bond: int) -> None:
        """A storage whose input is imposed by a law would have to be differentiated through that law."""
        root = bond
        while (reason := self.reasons[root]) is not None and reason.kind == "propagated":
            root = reason.causes[0]
        if reason is None or reason.kind != "law":
            return
        law = self.graph.bonds[root]
        junction = law.source if law.target == reason.node else law.target
        variable = "effort" if node.kind == "C" else "flow"
        form = "flow(effort)" if variable == "effort" else "effort(flow)"
        kind = self.graph.nodes[junction].kind
        at = f"{kind}-junction {junction}" if kind in "01" else junction
        raise CausalityError(
            f"{self.graph.name}: bond {law} cannot carry its stroke at {junction if variable == 'effort' else reason.node} "
            f"({reason.text.replace('the ', 'an ' if variable == 'effort' else 'a ')}) because {node.name} already imposes "
            f"the {variable} of {at}; give {reason.node} its law as {form} or separate them by a "
            f"{'1' if variable == 'effort' else '0'}-junction",
            where=(f"bond {law}", node.name),
        )

    def _clash(self, conflict: _Conflict) -> str:
        node = self.graph.nodes[conflict.node]
        if not conflict.others:
            common = "effort" if node.kind == "0" else "flow"
            return f"no bond would impose the {common} of {node.kind}-junction {node.name}"
        other = self.reasons[conflict.others[0]]
        return f"{other.text if other else 'another bond'}"

    def _refusal(self, conflict: _Conflict) -> CausalityError:
        graph, node = self.graph, self.graph.nodes[conflict.node]
        chain = explain_chain(graph, self.reasons, conflict.bond)
        bond = graph.bonds[conflict.bond]
        where = [f"bond {bond}", *(f"bond {graph.bonds[other]}" for other in conflict.others)]
        culprits = self._roots([conflict.bond, *conflict.others])
        others = "; ".join(explain_chain(graph, self.reasons, other) for other in conflict.others)
        if node.is_junction:
            common = "effort" if node.kind == "0" else "flow"
            junction = f"{node.kind}-junction {node.name}"
            if not conflict.others:
                what = f"{junction}: no bond can impose its {common}: every neighbour takes it from the junction ({chain})"
                todo = f"add a storage or source that gives the {common}, or change the kind of the junction"
            else:
                what = f"bond {bond} cannot carry its stroke at {node.name} ({chain}) because the {common} of {junction} "
                what += f"is already imposed ({others})"
                separator = "1" if node.kind == "0" else "0"
                todo = f"remove one of {', '.join(culprits)} or separate them by a {separator}-junction"
        else:
            what = f"bond {bond} cannot carry its stroke ({chain}): {node.name} asks for the opposite ({conflict.wanted.text}"
            what += f"; {others})" if others != chain else ")"
            todo = f"change one of {', '.join(dict.fromkeys([*culprits, node.name]))}"
        return CausalityError(f"{graph.name}: {what}; {todo}", where=tuple(dict.fromkeys([*where, *culprits])))

    def _roots(self, bonds: Iterable[int]) -> list[str]:
        found: dict[str, None] = {}
        stack, seen = list(bonds), set()
        while stack:
            bond = stack.pop(0)
            reason = self.reasons[bond]
            if bond in seen or reason is None:
                continue
            seen.add(bond)
            if reason.kind == "propagated":
                stack.extend(reason.causes)
            else:
                found[reason.node] = None
        return list(found)


def explain_chain(graph: BondGraph, reasons: Sequence[Reason | None], bond: int) -> str:
    """Reasons of a stroke back to the source, storage, law or choice it began with."""
    parts, seen = [], set()
    while bond not in seen:
        seen.add(bond)
        reason = reasons[bond]
        if reason is None:
            break
        parts.append(f"bond {graph.bonds[bond]}: {reason.text}")
        if reason.kind != "propagated" or not reason.causes:
            break
        bond = reason.causes[0]
    return " <- ".join(parts)
