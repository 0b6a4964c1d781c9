"""From a causal graph to its drawing: laws as short text, signals from nodes to the laws that read them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import cast

from sympy import Expr, Symbol

from bondgraph.declare.domains import UNDECLARED_PREFIXES, Domain
from bondgraph.declare.elements import Node
from bondgraph.declare.expressions import is_local, signal_name, symbols_in
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Integral, NamedSignal, symbol
from bondgraph.declare.read_text import TYPESET, ReadPrinter
from bondgraph.derive.causality import CausalGraph
from bondgraph.report.diagram.drawn import Drawing, DrawnBond, DrawnNode, Kind, frame_of
from bondgraph.report.diagram.labels import LAW_LENGTH, LAW_LINES

#: Letters of a law's text that fit into the box of its element, and those of a name that is long there.
_FITS, _LONG = LAW_LENGTH * LAW_LINES, 16
#: Letters that laws use of their own element.
_OWN_LETTERS = ("q", "p", "E", "t", "F", "v", "tau", "omega", "u", "i")
DERIVATIVE = "derivative causality"


def drawing_of(causal: CausalGraph) -> Drawing:
    """The drawing of a graph whose strokes are placed.

    Efforts and flows in the laws carry the letters of their domain (``tau``, ``omega``), displacements and momenta are
    ``q`` and ``p``; names inside a sub-graph stand without its prefix.

    Examples
    --------
    >>> from bondgraph.declare.domains import ROTATION
    >>> from bondgraph.derive.causality import assign_causality
    >>> g = BondGraph("rotor")
    >>> shaft = g.one_junction("shaft", ROTATION)
    >>> _ = g.inertance("rotor", g.parameter("J", 0.02, "kg m^2"), at=shaft)
    >>> _ = g.resistance("drag", lambda omega: g.parameter("c", 0.1, "N m s^2") * omega * abs(omega), at=shaft)
    >>> [node.law for node in drawing_of(assign_causality(g)).nodes]
    ['', 'omega = p/J', 'tau = c·omega·|omega|']
    """
    graph = causal.graph
    domains = _domains(graph)
    dependent = {name for name, _ in causal.derivative}
    nodes = tuple(
        DrawnNode(
            node.name,
            cast(Kind, node.kind),
            node.domain.name if node.domain else "",
            law_text(node, domains[node.name]),
            DERIVATIVE if node.name in dependent else "",
        )
        for node in graph.nodes.values()
    )
    bonds = tuple(
        DrawnBond(bond.source, bond.target, stroke) for bond, stroke in zip(graph.bonds, causal.strokes, strict=True)
    )
    return Drawing(graph.name, nodes, bonds, _signals(graph), (*_definitions(graph), *_abbreviations(graph, nodes)))


def _abbreviations(graph: BondGraph, drawn: Sequence[DrawnNode]) -> tuple[tuple[str, str], ...]:
    """The short names that laws were drawn with, each with its parameter and its element."""
    pairs = []
    for node in drawn:
        for name, letter in short_names(graph.nodes[node.name]).items():
            if node.law and re.search(rf"\b{letter}\b", node.law) and name.rpartition(".")[2] not in node.law:
                pairs.append((letter, f"in {node.name} is {name}"))
    return tuple(pairs)


def law_text(node: Node, domain: Domain | None) -> str:
    """What an element's law says, as short text; empty for a junction."""
    if not node.laws:
        return ""
    given: dict[str, Expr] = dict(node.laws)
    preferred = ("flow",) if node.kind == "I" else ("effort", "flow", "modulus", "residual", "energy")
    shown = [name for name in preferred if name in given][:1] or [name for name, _ in node.laws]
    effort, flow = (domain.effort_prefix, domain.flow_prefix) if domain else UNDECLARED_PREFIXES
    letters = {"effort": effort, "flow": flow, "displacement": "q", "momentum": "p", "energy": "E", "residual": "0"}
    letters["modulus"] = "r" if node.kind == "GY" else "m"
    laws = [(name, given[name]) for name in shown]
    text = _equations(laws, letters, node)
    return _equations(laws, letters, node, short_names(node)) if len(text) > _FITS else text


def _equations(
    laws: Sequence[tuple[str, Expr]], letters: Mapping[str, str], node: Node, short: Mapping[str, str] | None = None
) -> str:
    named = {symbol(name): symbol(letter) for name, letter in (short or {}).items()}
    frame = frame_of(node.name)
    parts = [f"{_lettered(name, letters)} = {_expression(law.xreplace(named), letters, frame)}" for name, law in laws]
    return ", ".join(parts)


def short_names(node: Node) -> dict[str, str]:
    """Short names of the parameters of a law that have long ones: what stands before the first underscore.

    Where two would be called the same, or something else is, they are numbered: c1, c2.
    """
    used = {one.name for _, law in node.laws for one in symbols_in(law) if signal_name(one) is None}
    long = sorted(name for name in used if len(name) > _LONG)
    taken = {*_OWN_LETTERS, *(used - set(long))}
    stems = [name.rpartition(".")[2].partition("_")[0] for name in long]
    numbers: dict[str, int] = {}
    found: dict[str, str] = {}
    for name, stem in zip(long, stems, strict=True):
        letter = stem
        while letter in taken or letter in found.values() or (stems.count(stem) > 1 and letter == stem):
            numbers[stem] = numbers.get(stem, 0) + 1
            letter = f"{stem}{numbers[stem]}"
        found[name] = letter
    return found


def _lettered(name: str, letters: Mapping[str, str]) -> str:
    """``effort2`` as ``tau_2``."""
    stem = name.rstrip("0123456789")
    number = name[len(stem) :]
    return letters.get(stem, stem) + (f"_{number}" if number else "")


def _expression(expression: Expr, letters: Mapping[str, str], frame: str) -> str:
    """An expression with the element's own letters and without the prefix of its own sub-graph."""
    renamed = {}
    for used in expression.free_symbols:
        read = signal_name(used)
        if read is not None:
            renamed[used] = symbol(f"{read.variable}{read.port or ''}({_inside(read.node, frame)})")
        elif is_local(used):
            renamed[used] = symbol(_lettered(used.name, letters))
        else:
            renamed[used] = symbol(_inside(used.name, frame))
    return str(_PRINTER.doprint(expression.xreplace(renamed)))


def _inside(name: str, frame: str) -> str:
    return name[len(frame) + 1 :] if frame and name.startswith(f"{frame}.") else name


class _LawPrinter(ReadPrinter):
    """Laws in the notation of drawings, sums with a plus in front."""

    def __init__(self) -> None:
        super().__init__(TYPESET)

    def _as_ordered_terms(self, expression: Expr, order: str | None = None) -> list[Expr]:
        terms: list[Expr] = super()._as_ordered_terms(expression, order=order)
        return sorted(terms, key=lambda term: bool(term.could_extract_minus_sign()))


_PRINTER = _LawPrinter()


def _domains(graph: BondGraph) -> dict[str, Domain | None]:
    """Domain of every node: its own, or that of the first neighbour that has one."""
    found = {name: node.domain for name, node in graph.nodes.items()}
    for bond in graph.bonds:
        for end, other in ((bond.source, bond.target), (bond.target, bond.source)):
            if found[end] is None:
                found[end] = graph.nodes[other].domain
    return found


def _signals(graph: BondGraph) -> tuple[tuple[str, str], ...]:
    """Pairs (node read, node whose law reads it), through named signals and integrals, in order of declaration."""
    named = {q.name: q for q in graph.quantities.values() if isinstance(q, NamedSignal | Integral)}
    pairs: dict[tuple[str, str], None] = {}
    for node in graph.nodes.values():
        read: dict[str, None] = {}
        for _, law in node.laws:
            _collect(law, named, read, frozenset())
        for source in graph.nodes:
            if source in read and source != node.name:
                pairs[source, node.name] = None
    return tuple(pairs)


def _definitions(graph: BondGraph) -> tuple[tuple[str, str], ...]:
    """Named signals and integrals as text; an integral by its rate."""
    pairs = []
    for quantity in graph.quantities.values():
        frame = frame_of(quantity.name)
        if isinstance(quantity, NamedSignal) and quantity.guess is not None:
            pairs.append((quantity.name, f"from  0 = {_expression(quantity.expression, {}, frame)}"))
        elif isinstance(quantity, NamedSignal):
            pairs.append((quantity.name, f"= {_expression(quantity.expression, {}, frame)}"))
        elif isinstance(quantity, Integral):
            pairs.append((quantity.name, f"= ∫ {_expression(quantity.of, {}, frame)} dt"))
    return tuple(pairs)


def _collect(
    law: Expr, named: Mapping[str, NamedSignal | Integral], read: dict[str, None], seen: frozenset[str]
) -> None:
    """Add the nodes that an expression reads, directly or through named quantities."""
    used: Symbol
    for used in symbols_in(law):  # in order of names, not of their hashes: arrows are drawn in this order
        signal = signal_name(used)
        if signal is not None:
            read[signal.node] = None
        elif used.name in named and used.name not in seen:
            quantity = named[used.name]
            inner = quantity.expression if isinstance(quantity, NamedSignal) else quantity.of
            _collect(inner, named, read, seen | {used.name})
