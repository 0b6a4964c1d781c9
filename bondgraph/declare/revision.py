"""Revising what is declared: another law for an element, another expression for a sensor."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from sympy import Expr, Symbol

from bondgraph.declare.elements import own_variables
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.handles import callable_law
from bondgraph.declare.quantities import symbol
from bondgraph.errors import DeclarationError, suggest


def revise_law(graph: BondGraph, node: str, given: str, law: object) -> None:
    """Give an element another law for ``given``; a function is called with the old expression.

    Raises
    ------
    DeclarationError
        If the graph itself does not declare the element, or it has no such law.

    Examples
    --------
    >>> g = BondGraph("sled")
    >>> body = g.one_junction("body")
    >>> c, d = g.parameter("c", 2.0, "N s/m"), g.parameter("d", 1.0, "N")
    >>> _ = g.resistance("runners", c, at=body)
    >>> revise_law(g, "runners", "effort", lambda old: old + d)
    >>> g.nodes["runners"].law("effort")
    c*flow + d
    """
    declared = graph._nodes.get(node)
    if declared is None or declared.law(given) is None:
        raise DeclarationError(
            f"{graph.name}: no element {node!r} with a law for its {given}{suggest(node, graph._nodes)} - a part is "
            "revised where it is declared",
            where=(node,),
        )
    revised = law(declared.law(given)) if callable_law(law) else law  # type: ignore[operator]
    checked = graph._checked(revised, own_variables(declared, given) or (), node)
    laws = tuple((name, checked if name == given else old) for name, old in declared.laws)
    graph._nodes[node] = dataclasses.replace(declared, laws=laws)


def revise_output(graph: BondGraph, name: str, expression: object) -> None:
    """Let a sensor show something else; a function is called with what it showed.

    Raises
    ------
    DeclarationError
        If the graph itself does not declare the output.

    Examples
    --------
    >>> g = BondGraph("sled")
    >>> body = g.one_junction("body")
    >>> g.measure_flow("speed", body, "")
    >>> revise_output(g, "speed", lambda shown: 2 * shown)
    >>> g.outputs[0].expression
    2*flow(body)
    """
    if name not in graph._outputs:
        raise DeclarationError(f"{graph.name}: no output {name!r}{suggest(name, graph._outputs)}", where=(name,))
    old = graph._outputs[name]
    revised = expression(old.expression) if callable_law(expression) else expression  # type: ignore[operator]
    graph._outputs[name] = dataclasses.replace(old, expression=graph._checked(revised, (), name))


def replace_symbols(graph: BondGraph, values: Mapping[str, Expr]) -> None:
    """Write other expressions in the place of parameters, in all laws and outputs that the graph itself declares.

    Examples
    --------
    >>> g = BondGraph("sled")
    >>> body = g.one_junction("body")
    >>> c, share = g.parameter("c", 2.0, "N s/m"), g.parameter("share", 0.5, "1")
    >>> _ = g.resistance("runners", c, at=body)
    >>> replace_symbols(g, {"c": c * share})
    >>> g.nodes["runners"].law("effort")
    c*flow*share
    """
    known: dict[Symbol, Expr] = {symbol(name): value for name, value in values.items()}
    for name, node in graph._nodes.items():
        if any(known.keys() & law.free_symbols for _, law in node.laws):
            laws = tuple((given, law.xreplace(known)) for given, law in node.laws)
            graph._nodes[name] = dataclasses.replace(node, laws=laws)
    for name, output in graph._outputs.items():
        if known.keys() & output.expression.free_symbols:
            graph._outputs[name] = dataclasses.replace(output, expression=output.expression.xreplace(known))
