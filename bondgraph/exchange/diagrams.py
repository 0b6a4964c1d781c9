"""Drawings as text of other tools: Graphviz DOT and Mermaid.

An arrow points the way of positive power. The causal stroke is a bar at the end that receives the effort: a ``tee`` in
DOT, and in Mermaid, which has no such end, a bar in the label of the bond at its side.
"""

from __future__ import annotations

import re

from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.errors import require_kind
from bondgraph.report.declared import drawing_of
from bondgraph.report.diagram.drawn import Drawing, DrawnBond, DrawnNode, frame_of, local_name
from bondgraph.report.diagram.text import plain


def dot_text(graph: BondGraph | Drawing) -> str:
    r"""A graph with its causality, or a drawing, as Graphviz DOT; sub-graphs are clusters, signals are dashed.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("rc")
    >>> node = g.zero_junction("z", bg.ELECTRICAL)
    >>> _ = g.compliance("c", 1e6, at=node)
    >>> print(dot_text(g))
    digraph "rc" {
      rankdir=LR;
      node [shape=plaintext];
      "z" [label="0\nz"];
      "c" [label="C\nc\nu = 1000000·q"];
      "z" -> "c" [dir=both, arrowhead=lnormal, arrowtail=tee];
    }
    """
    drawing = _drawing(graph)
    lines = [f"digraph {_quoted(drawing.title)} {{", "  rankdir=LR;", "  node [shape=plaintext];"]
    frames: dict[str, list[DrawnNode]] = {}
    for node in drawing.nodes:
        frames.setdefault(frame_of(node.name), []).append(node)
    for frame, nodes in frames.items():
        inside = [f"{_quoted(node.name)} [label={_quoted(_label(node))}];" for node in nodes]
        if not frame:
            lines += [f"  {line}" for line in inside]
            continue
        lines += [f"  subgraph {_quoted(f'cluster_{frame}')} {{", f"    label={_quoted(frame)};"]
        lines += [*(f"    {line}" for line in inside), "  }"]
    for bond in drawing.bonds:
        lines.append(f"  {_quoted(bond.source)} -> {_quoted(bond.target)} [{_dot_ends(bond)}];")
    for source, target in drawing.signals:
        lines.append(f"  {_quoted(source)} -> {_quoted(target)} [style=dashed, arrowhead=vee];")
    return "\n".join([*lines, "}"])


def mermaid_text(graph: BondGraph | Drawing) -> str:
    """A graph with its causality, or a drawing, as a Mermaid flowchart, as Markdown pages show it.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("rc")
    >>> node = g.zero_junction("z", bg.ELECTRICAL)
    >>> _ = g.compliance("c", 1e6, at=node)
    >>> print(mermaid_text(g))
    flowchart LR
      n0["0 z"]
      n1["C c"]
      n0 -- "|–" --> n1
    """
    drawing = _drawing(graph)
    number = {node.name: f"n{k}" for k, node in enumerate(drawing.nodes)}
    lines = ["flowchart LR"]
    for node in drawing.nodes:
        label = re.sub(r'["\\\n]', " ", f"{node.kind} {node.name}")
        lines.append(f'  {number[node.name]}["{label}"]')
    for bond in drawing.bonds:
        stroke = {"source": ' -- "|–" -->', "target": ' -- "–|" -->', None: " -->"}[bond.stroke]
        lines.append(f"  {number[bond.source]}{stroke} {number[bond.target]}")
    lines += [f"  {number[source]} -.-> {number[target]}" for source, target in drawing.signals]
    return "\n".join(lines)


def _drawing(graph: BondGraph | Drawing) -> Drawing:
    require_kind("a diagram", graph, (BondGraph, Drawing), "graph")
    return graph if isinstance(graph, Drawing) else drawing_of(assign_causality(graph))


def _label(node: DrawnNode) -> str:
    law = f"\n{plain(node.law)}" if node.law else ""
    return f"{node.kind}\n{local_name(node.name)}{law}"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'


def _dot_ends(bond: DrawnBond) -> str:
    if bond.stroke is None:
        return "arrowhead=lnormal"
    at_target = bond.stroke == "target"
    head, tail = ("teelnormal", "none") if at_target else ("lnormal", "tee")
    return f"dir=both, arrowhead={head}, arrowtail={tail}"
