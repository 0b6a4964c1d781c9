"""Revising what is declared: another law for an element, another expression for a sensor or in place of an input.

Elements of parts are revised where they are, in a copy of their part. What a revised law takes from outside its part
(the coefficient of an effect, a speed elsewhere) becomes an input of the part, bound to it.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping

from sympy import Expr, Symbol

from bondgraph.declare.editing import copy
from bondgraph.declare.elements import STORAGES, own_variables
from bondgraph.declare.expressions import is_local, signal_name
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.handles import SubGraph
from bondgraph.declare.laws import apply_law
from bondgraph.declare.quantities import Integral, NamedSignal, Start, symbol
from bondgraph.errors import DeclarationError, suggest


def revise_law(graph: BondGraph, node: str, given: str, law: object) -> None:
    """Give an element another law for ``given``; a function is called with the old expression.

    The element of a part is named ``part.element``; its old expression is the one in the part's own names, and what the
    new one adds to it is in those of ``graph``.

    Raises
    ------
    DeclarationError
        If there is no such element, or it has no such law.

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
    revise_laws(graph, node, lambda laws: _with_law(graph, node, laws, given, law))


def _with_law(graph: BondGraph, node: str, laws: Mapping[str, Expr], given: str, law: object) -> dict[str, Expr]:
    if given not in laws:
        raise DeclarationError(f"{graph.name}: {node} has no law for its {given} that could be revised", where=(node,))
    revised = apply_law(law, laws[given], where=f"{graph.name}: {node}")
    return {**laws, given: revised}


def revise_laws(graph: BondGraph, node: str, laws: Callable[[Mapping[str, Expr]], Mapping[str, Expr]]) -> None:
    """Give an element other laws: what a function makes of the old ones, by what they give.

    Raises
    ------
    DeclarationError
        If there is no such element.

    Examples
    --------
    >>> g = BondGraph("sled")
    >>> body = g.one_junction("body")
    >>> c = g.parameter("c", 2.0, "N s/m")
    >>> _ = g.resistance("runners", c, at=body)
    >>> revise_laws(g, "runners", lambda laws: {"flow": symbol("effort") / c})
    >>> g.nodes["runners"].laws
    (('flow', effort/c),)
    """
    part, _, inner = node.partition(".")
    if inner and part in graph._subgraphs:
        found = _in_part(graph, part, lambda inside, taken: revise_laws(inside, inner, lambda old: taken(laws(old))))
        graph._subgraphs[part] = found
        return
    declared = graph._nodes.get(node)
    if declared is None:
        known = [*graph._nodes, *graph.flatten().nodes]
        raise DeclarationError(f"{graph.name}: no element {node!r}{suggest(node, known)}", where=(node,))
    changed = laws(dict(declared.laws))
    checked = tuple(
        (given, graph._checked(law, own_variables(declared, given) or (), node)) for given, law in changed.items()
    )
    graph._nodes[node] = dataclasses.replace(declared, laws=checked)


Laws = Mapping[str, Expr]


def _in_part(
    graph: BondGraph, name: str, revise: Callable[[BondGraph, Callable[[Laws], Laws]], None]
) -> SubGraph[BondGraph]:
    """A part with a copy of its graph that was revised; ``revise`` gets the copy, and what takes laws from outside."""
    part = graph._subgraphs[name]
    inside = copy(part.graph)
    bound = dict(part.bind)

    def taken(laws: Laws) -> Laws:
        return {given: _taken_in(graph, inside, bound, law) for given, law in laws.items()}

    revise(inside, taken)
    return dataclasses.replace(part, graph=inside, bind=tuple(bound.items()))


def _taken_in(graph: BondGraph, inside: BondGraph, bound: dict[str, Expr], law: Expr) -> Expr:
    """A law in the names of a part: symbols that only the outer graph knows become inputs of the part."""
    values: dict[Symbol, Expr] = {}
    for used in sorted(law.free_symbols, key=lambda one: str(one.name)):
        read = signal_name(used)
        local = is_local(used) or used.name == "t"
        known = inside.flatten().has_node(read.node) if read is not None else inside._has_quantity(used.name)
        if local or known or used.name in bound:
            continue
        name = f"from_outside_{re.sub(r'[^A-Za-z0-9]+', '_', used.name).strip('_')}"
        if name not in bound:
            unit = next((q.unit for q in graph.quantities.values() if q.name == used.name), "")
            inside.input(name, unit, f"{used.name} of {graph.name}")
            bound[name] = used
        values[used] = symbol(name)
    replaced: Expr = law.xreplace(values)
    return replaced


def replace_input(graph: BondGraph, name: str, expression: Expr) -> None:
    """Write an expression in the place of an input wherever parts or the graph itself use it.

    The input itself stays declared, so that the expression may follow from it.

    Raises
    ------
    DeclarationError
        If there is no such input.

    Examples
    --------
    >>> g = BondGraph("sled")
    >>> body = g.one_junction("body")
    >>> pull = g.input("pull", "N")
    >>> half = g.parameter("half", 0.5, "1")
    >>> _ = g.effort_source("rope", pull, at=body)
    >>> replace_input(g, "pull", half * pull)
    >>> g.nodes["rope"].law("effort")
    half*pull
    """
    if name not in {one.name for one in graph.flatten().inputs}:
        known = [one.name for one in graph.flatten().inputs]
        raise DeclarationError(f"{graph.name}: no input {name!r}{suggest(name, known)}", where=(name,))
    for part in list(graph._subgraphs.values()):
        inner = name if part.shared else name.removeprefix(f"{part.name}.")
        if (part.shared or inner != name) and part.graph._has_quantity(inner) and inner not in dict(part.bind):
            stand_in = f"given_{inner}"
            inside = copy(part.graph)
            unit = next((one.unit for one in inside.flatten().inputs if one.name == inner), "")
            stood = inside.input(stand_in, unit, f"what acts in the place of {inner}")
            if inside.subgraphs:
                replace_input(inside, inner, stood)
            else:
                _replace_everywhere(inside, {symbol(inner): stood})
            bind = (*part.bind, (stand_in, expression))
            graph._subgraphs[part.name] = dataclasses.replace(part, graph=inside, bind=bind)
    _replace_everywhere(graph, {symbol(name): expression})


def replace_signal(graph: BondGraph, name: str, expression: Expr) -> None:
    """Write an expression in the place of an integral or a named signal wherever the graph itself uses it.

    What it integrates stays as it is, so that the expression may follow from it.

    Raises
    ------
    DeclarationError
        If there is no such quantity.

    Examples
    --------
    >>> g = BondGraph("cart")
    >>> body = g.one_junction("body")
    >>> slope = g.integral("slope", g.input("bend", "rad/s"), "rad")
    >>> wave = g.integral("wave", lambda x: -x / 2, "rad")
    >>> _ = g.effort_source("weight", -9.81 * slope, at=body)
    >>> replace_signal(g, "slope", slope + wave)
    >>> g.nodes["weight"].law("effort")
    -9.81*slope - 9.81*wave
    """
    if name not in graph._quantities:
        raise DeclarationError(f"{graph.name}: no signal {name!r}{suggest(name, graph._quantities)}", where=(name,))
    values = {symbol(name): expression}
    own = graph._quantities[name]
    _replace_everywhere(graph, values)
    graph._quantities[name] = own
    for part in list(graph._subgraphs.values()):
        bind = tuple((inner, given.xreplace(values)) for inner, given in part.bind)
        graph._subgraphs[part.name] = dataclasses.replace(part, bind=bind)


def _replace_everywhere(graph: BondGraph, values: Mapping[Symbol, Expr]) -> None:
    """Replace symbols in the laws, signals and outputs of a graph; integrals keep what they integrate."""
    _replace_in_laws(graph, values)
    for name, quantity in graph._quantities.items():
        if isinstance(quantity, NamedSignal):
            graph._quantities[name] = dataclasses.replace(
                quantity, expression=quantity.expression.xreplace(dict(values))
            )


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
    revised = apply_law(expression, old.expression, where=f"{graph.name}: {name}")
    graph._outputs[name] = dataclasses.replace(old, expression=graph._checked(revised, (), name))


def revise_integral(graph: BondGraph, name: str, of: object) -> None:
    """Let an integral have another rate, which may depend on integrals declared after it; a function gets the old one.

    Raises
    ------
    DeclarationError
        If the graph itself does not declare the integral.

    Examples
    --------
    >>> g = BondGraph("swing")
    >>> x = g.integral("x", 0, "m")
    >>> v = g.integral("v", -4 * x, "m/s")
    >>> revise_integral(g, "x", v)
    >>> g.integrals[0].of
    v
    """
    old = graph._quantities.get(name)
    if not isinstance(old, Integral):
        known = [one.name for one in graph.integrals]
        raise DeclarationError(f"{graph.name}: no integral {name!r}{suggest(name, known)}", where=(name,))
    rate = apply_law(of, old.of, where=f"{graph.name}: {name}")
    graph._quantities[name] = dataclasses.replace(old, of=graph._checked(rate, (), name))


def revise_start(graph: BondGraph, name: str, signal: str, factor: float = 1.0) -> None:
    """Let a storage with one state, or an integral, start in a log at a multiple of a signal's first value.

    Parameters
    ----------
    graph
        The graph that declares it; where it starts without a log stays.
    name
        The storage, or the integral.
    signal, factor
        An input or output, and the multiple of it; in the coherent units of both.

    Raises
    ------
    DeclarationError
        If the graph itself declares no such storage or integral, or no such signal.

    Examples
    --------
    >>> g = BondGraph("sled")
    >>> body = g.one_junction("body")
    >>> mass = g.inertance("mass", 4.0, at=body, state="v")
    >>> g.measure_flow("speed", body, "")
    >>> revise_start(g, "mass", "speed")
    >>> str(g.nodes["mass"].starts[0])
    'speed'
    """
    known = (*graph._outputs, *(one.name for one in graph.inputs))
    if signal not in known:
        raise DeclarationError(f"{graph.name}: no input or output {signal!r}{suggest(signal, known)}", where=(signal,))
    quantity, node, start = graph._quantities.get(name), graph._nodes.get(name), Start(signal, factor)
    if isinstance(quantity, Integral):
        graph._quantities[name] = dataclasses.replace(quantity, start=start)
    elif node is not None and node.kind in STORAGES and not node.is_field:
        graph._nodes[name] = dataclasses.replace(node, starts=(start,))
    else:
        states = [one.name for one in graph.nodes.values() if one.kind in STORAGES]
        states += [one.name for one in graph.integrals]
        raise DeclarationError(
            f"{graph.name}: {name!r} is no storage with one state and no integral{suggest(name, states)}", where=(name,)
        )


def revise_initial(graph: BondGraph, name: str, value: float) -> None:
    """Let a storage with one state start at another number, in the coherent unit of its state.

    Raises
    ------
    DeclarationError
        If the graph itself declares no such storage, or one that starts at a signal or at an expression.

    Examples
    --------
    >>> g = BondGraph("sled")
    >>> mass = g.inertance("mass", 4.0, at=g.one_junction("body"), state="v")
    >>> revise_initial(g, "mass", 2.5)
    >>> g.nodes["mass"].initial
    (2.5,)
    """
    node = graph._nodes.get(name)
    if node is None or node.kind not in STORAGES or node.is_field or any(one is not None for one in node.starts):
        raise DeclarationError(f"{graph.name}: {name!r} is no storage that starts at one number", where=(name,))
    graph._nodes[name] = dataclasses.replace(node, initial=(float(value),), initial_units=())


def replace_symbols(graph: BondGraph, values: Mapping[str, Expr]) -> None:
    """Write other expressions in the place of parameters, in all laws and outputs that the graph itself declares.

    What parts take of these parameters is replaced too.

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
    _replace_in_laws(graph, {symbol(name): value for name, value in values.items()})
    for part_name, part in graph._subgraphs.items():
        bind = tuple(
            (name, bound.xreplace({symbol(one): value for one, value in values.items()})) for name, bound in part.bind
        )
        graph._subgraphs[part_name] = dataclasses.replace(part, bind=bind)


def _replace_in_laws(graph: BondGraph, values: Mapping[Symbol, Expr]) -> None:
    known = dict(values)
    for name, node in graph._nodes.items():
        if any(known.keys() & law.free_symbols for _, law in node.laws):
            laws = tuple((given, law.xreplace(known)) for given, law in node.laws)
            graph._nodes[name] = dataclasses.replace(node, laws=laws)
    for name, output in graph._outputs.items():
        if known.keys() & output.expression.free_symbols:
            graph._outputs[name] = dataclasses.replace(output, expression=output.expression.xreplace(known))
