"""The causality of a graph explained: each bond's stroke and why, dependent storages, algebraic loops."""

from __future__ import annotations

from bondgraph.derive.causality import bond_labels
from bondgraph.derive.dependence import dependences
from bondgraph.derive.derivation import Derivation


def explain(derivation: Derivation) -> str:
    """Text that says for every bond why its stroke is where it is, and what follows from that.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> g = BondGraph("two_masses")
    >>> a = g.one_junction("a")
    >>> _ = g.inertance("m_1", 1.0, at=a)
    >>> _ = g.inertance("m_2", 2.0, at=a)
    >>> print(explain(Derivation(assign_causality(g))))
    a->m_1: m_1 receives the effort; m_1 in integral causality gives the flow
    a->m_2: a receives the effort; a -> m_1 imposes the flow of 1-junction a
    m_2 is dependent: flow(m_2) follows f_m_1 of m_1 with gain 1
    loop of rates through m_1, m_2, closed by d_f_m_1, solved in closed form
    """
    causal = derivation.causal
    lines = []
    for label, bond, stroke, reason in zip(
        bond_labels(causal), causal.graph.bonds, causal.strokes, causal.reasons, strict=True
    ):
        end = bond.target if stroke == "target" else bond.source
        lines.append(f"{label}: {end} receives the effort; {reason.text}")
    lines += [dependence.text for dependence in dependences(derivation)]
    for loop in derivation.loops:
        kind = "loop of rates" if loop.of_rates else "algebraic loop"
        how = "in closed form" if loop.linear else "by Newton's method"
        through = f" through {', '.join(loop.elements)}" if loop.elements else ""
        lines.append(f"{kind}{through}, closed by {', '.join(loop.torn)}, solved {how}")
    return "\n".join(lines)
