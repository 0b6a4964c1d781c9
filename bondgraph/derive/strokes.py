"""Placing causal strokes: decisions in order of preference, propagation, and taking decisions back.

The sequential causality assignment procedure (Karnopp, Margolis, Rosenberg, *System Dynamics*, 5th ed. 2012, section
5.2) decides and propagates. Propagation alone does not see that a later junction is left without a stroke, so a
decision that turns out impossible is taken back: every stroke knows the strokes that forced it, hence a contradiction
knows the decisions it follows from, and the latest of them is turned round (conflict-directed backjumping, Prosser
1993, Comput. Intell. 9(3)). The first complete assignment in the order of preference is found, or the decisions that
exclude each other.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from bondgraph.declare.elements import Node
from bondgraph.declare.graph import BondGraph

ReasonKind = Literal["source", "law", "integral", "derivative", "propagated", "chosen"]


@dataclass(frozen=True)
class Reason:
    """Why a bond has its stroke: which node asked for it and which bonds made it necessary."""

    kind: ReasonKind
    node: str
    text: str
    causes: tuple[int, ...] = ()


@dataclass(frozen=True)
class Decision:
    """A stroke that is asked for; ``otherwise`` gives the reason of the opposite one, None where it is not possible."""

    bond: int
    at_target: bool
    reason: Reason
    otherwise: Callable[[ContradictionError, Sequence[int]], Reason] | None = None


class ContradictionError(Exception):
    """Demands that exclude each other: where, and the strokes they come from; ``wanted`` is one not yet placed."""

    def __init__(self, node: str, bonds: Iterable[int], wanted: tuple[int, Reason] | None = None) -> None:
        super().__init__(node)
        self.node, self.bonds, self.wanted = node, tuple(bonds), wanted


class StrokeSearch:
    """Strokes placed so far, why, and the decisions they follow from.

    Parameters
    ----------
    graph
        A flat graph.
    patterns
        For each element the strokes its law allows, as one tuple per possibility that tells for every port whether it
        receives the effort; an element that is not listed allows all.
    """

    def __init__(self, graph: BondGraph, patterns: dict[str, tuple[tuple[bool, ...], ...]]) -> None:
        self.graph = graph
        self.patterns = patterns
        self.incidence = graph.incidence()
        self.bonds = graph.bonds
        count = len(self.bonds)
        self.at_target: list[bool | None] = [None] * count
        self.reasons: list[Reason | None] = [None] * count
        self.trail: list[int] = []
        self._order = [0] * count
        self._open = {name: len(bonds) for name, bonds in self.incidence.items()}
        self._strong: dict[str, list[int]] = {name: [] for name in graph.nodes}
        self._decided: dict[int, int] = {}

    def run(self, decisions: Sequence[Decision]) -> None:
        """Place every decision's stroke, or its opposite; raise ContradictionError where neither is possible."""
        position = 0
        while position < len(decisions):
            decision = decisions[position]
            if decision.otherwise is not None and self.at_target[decision.bond] is not None:
                position += 1
                continue
            try:
                if self.at_target[decision.bond] is None:
                    self._decided[decision.bond] = position
                self._place(decision.bond, decision.at_target, decision.reason)
                position += 1
            except ContradictionError as contradiction:
                position = self._turn_round(decisions, contradiction)

    def _turn_round(self, decisions: Sequence[Decision], contradiction: ContradictionError) -> int:
        """Turn the latest decision that a contradiction follows from; the position from which to go on."""
        while True:
            bonds = self.roots(contradiction)
            open_roots = [bond for bond in bonds if decisions[self._decided[bond]].otherwise is not None]
            if not open_roots:
                raise contradiction
            latest = max(open_roots, key=self._order.__getitem__)
            position = self._decided[latest]
            decision = decisions[position]
            causes = tuple(bond for bond in bonds if bond != latest)
            assert decision.otherwise is not None
            reason = decision.otherwise(contradiction, causes)
            self._take_back(latest)
            try:
                self._place(latest, not decision.at_target, reason)
                return position + 1
            except ContradictionError as next_contradiction:
                contradiction = next_contradiction

    def roots(self, contradiction: ContradictionError) -> list[int]:
        """Bonds whose decided strokes a contradiction follows from, in the order in which they were placed."""
        stack = list(contradiction.bonds)
        if contradiction.wanted is not None:
            stack += contradiction.wanted[1].causes
        return self.roots_of(stack)

    def roots_of(self, bonds: Iterable[int]) -> list[int]:
        """Bonds whose decided strokes the strokes of ``bonds`` follow from, in the order in which they were placed."""
        found, seen, stack = [], set(), list(bonds)
        while stack:
            bond = stack.pop()
            reason = self.reasons[bond]
            if bond in seen or reason is None:
                continue
            seen.add(bond)
            if bond in self._decided:
                found.append(bond)
            else:
                stack.extend(reason.causes)
        return sorted(found, key=self._order.__getitem__)

    # ------------------------------------------------------------------ placing and taking back

    def _place(self, bond: int, at_target: bool, reason: Reason) -> None:
        queue: deque[str] = deque()
        self._assign(bond, at_target, reason, queue)
        while queue:
            node = self.graph.nodes[queue.popleft()]
            if node.is_junction:
                self._junction(node, queue)
            elif node.name in self.patterns:
                self._element(node, queue)

    def _assign(self, bond: int, at_target: bool, reason: Reason, queue: deque[str]) -> None:
        ends = self.bonds[bond]
        if self.at_target[bond] is not None:
            if self.at_target[bond] != at_target:
                raise ContradictionError(reason.node, (bond,), (bond, reason))
            return
        self.at_target[bond] = at_target
        self.reasons[bond] = reason
        self._order[bond] = len(self.trail)
        self.trail.append(bond)
        for end, inward in ((ends.source, False), (ends.target, True)):
            self._open[end] -= 1
            if (at_target == inward) == (self.graph.nodes[end].kind == "0"):
                self._strong[end].append(bond)
            queue.append(end)

    def _take_back(self, bond: int) -> None:
        """Take back the stroke of a bond and all that were placed after it."""
        for later in reversed(self.trail[self._order[bond] :]):
            self.at_target[later] = None
            self.reasons[later] = None
            self._decided.pop(later, None)
            ends = self.bonds[later]
            for end in (ends.source, ends.target):
                self._open[end] += 1
                if later in self._strong[end]:
                    self._strong[end].remove(later)
        del self.trail[self._order[bond] :]

    def receives(self, bond: int, inward: bool) -> bool | None:
        """Whether the effort acts on the end of a bond that it points to (``inward``) or from, None where undecided."""
        at_target = self.at_target[bond]
        return None if at_target is None else at_target == inward

    # ------------------------------------------------------------------ propagation

    def _junction(self, node: Node, queue: deque[str]) -> None:
        """One bond imposes the common variable: its effort acts on a 0-junction, its flow on a 1-junction."""
        strong, left = self._strong[node.name], self._open[node.name]
        if len(strong) > 1:
            raise ContradictionError(node.name, strong)
        if left == 0 and not strong:
            raise ContradictionError(node.name, (bond for bond, _ in self.incidence[node.name]))
        if left == 0 or (left > 1 and not strong):
            return
        common = "effort" if node.kind == "0" else "flow"
        open_bonds = [pair for pair in self.incidence[node.name] if self.at_target[pair[0]] is None]
        if strong:
            text = f"{self.bonds[strong[0]]} imposes the {common} of {node.kind}-junction {node.name}"
            causes: tuple[int, ...] = (strong[0],)
        else:
            text = f"only this bond is left to impose the {common} of {node.kind}-junction {node.name}"
            causes = tuple(bond for bond, _ in self.incidence[node.name] if bond != open_bonds[0][0])
        reason = Reason("propagated", node.name, text, causes)
        acts = (node.kind == "0") != bool(strong)
        for bond, inward in open_bonds:
            self._assign(bond, acts == inward, reason, queue)

    def _element(self, node: Node, queue: deque[str]) -> None:
        """Ports whose stroke follows from the others because the element's law allows nothing else."""
        bonds = self.incidence[node.name]
        states = [self.receives(bond, inward) for bond, inward in bonds]
        placed = tuple(bond for (bond, _), state in zip(bonds, states, strict=True) if state is not None)
        fitting = [
            pattern
            for pattern in self.patterns[node.name]
            if all(state is None or state is asked for state, asked in zip(states, pattern, strict=True))
        ]
        if not fitting:
            raise ContradictionError(node.name, placed)
        text = _CARRIED.get(node.kind, "the only stroke that the law of {0} allows beside its others").format(node.name)
        for port, (bond, inward) in enumerate(bonds):
            asked = fitting[0][port]
            if states[port] is None and all(pattern[port] is asked for pattern in fitting):
                self._assign(bond, asked == inward, Reason("propagated", node.name, text, placed), queue)


_CARRIED = {
    "TF": "the stroke is carried through the transformer {0}",
    "GY": "the stroke is carried through the gyrator {0}",
}
