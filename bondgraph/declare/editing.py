"""Editing: a graph extended without touching the original, for effects that are added to a declared machine."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, get_args

from sympy import Expr

from bondgraph.declare.declared_units import DeclaredUnit
from bondgraph.declare.elements import Bond, Node
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph, Handle
from bondgraph.declare.quantities import Input, Interpolation, Parameter
from bondgraph.declare.quantity_checks import check_quantity
from bondgraph.declare.requirements import check_requirements
from bondgraph.declare.starts import restarted
from bondgraph.declare.validation import node_domains
from bondgraph.errors import DeclarationError, suggest
from bondgraph.text import few


def copy(graph: BondGraph) -> BondGraph:
    """A graph equal to ``graph`` that can grow on its own.

    Examples
    --------
    >>> g = BondGraph("machine")
    >>> _ = g.one_junction("shaft")
    >>> h = copy(g)
    >>> _ = h.one_junction("wheel")
    >>> list(g.nodes), list(h.nodes)
    (['shaft'], ['shaft', 'wheel'])
    """
    twin = BondGraph(graph.name, graph.doc, graph.source)
    twin._nodes = dict(graph._nodes)
    twin._bonds = list(graph._bonds)
    twin._quantities = dict(graph._quantities)
    twin._outputs = dict(graph._outputs)
    twin._requirements = list(graph._requirements)
    twin._subgraphs = dict(graph._subgraphs)
    return twin


def handle(graph: BondGraph, name: str) -> Handle:
    """The handle of a declared node, its domain found through its bonds where it is not declared.

    Raises
    ------
    DeclarationError
        If there is no such node.
    """
    flat = graph.flatten()
    if name not in flat.nodes:
        raise DeclarationError(f"{graph.name}: no node {name!r}{suggest(name, flat.nodes)}", where=(name,))
    return Handle(name, flat.nodes[name].kind, node_domains(flat)[name])


def split_bond(graph: BondGraph, bond: Bond, junction: Node) -> Handle:
    """Put a junction into the middle of a bond: ``a -> b`` becomes ``a -> junction -> b``.

    Raises
    ------
    DeclarationError
        If the graph does not have the bond, or the node is not a junction.

    Examples
    --------
    >>> g = BondGraph("line")
    >>> a, b = g.one_junction("a"), g.one_junction("b")
    >>> middle = split_bond(g, g.bond(a, b), Node("z", "0"))
    >>> [str(bond) for bond in g.bonds]
    ['a -> z', 'z -> b']
    """
    if bond not in graph._bonds:
        raise DeclarationError(f"{graph.name}: there is no bond {bond}", where=(f"bond {bond}",))
    if not junction.is_junction:
        raise DeclarationError(f"{graph.name}: {junction.name} is a {junction.kind}, not a junction", (junction.name,))
    middle = graph.add_node(junction)
    index = graph._bonds.index(bond)
    graph._bonds[index : index + 1] = [Bond(bond.source, middle.name), Bond(middle.name, bond.target)]
    return middle


def share_effort(graph: BondGraph, element: str, share: Expr) -> None:
    """Let an element at a 1-junction act there with a share of its effort, a storage go on as if it acted with all.

    It leaves the junction for a source that imposes the junction's flow on it. A share that changes with time then
    changes an effort; a storage whose coefficient changes would give or take what it holds at that moment.

    Raises
    ------
    DeclarationError
        If the element has not one bond to a 1-junction.

    Examples
    --------
    >>> g = BondGraph("sled")
    >>> body = g.one_junction("body")
    >>> _ = g.inertance("mass", 40.0, at=body)
    >>> _ = g.inertance("load", 10.0, at=body)
    >>> share_effort(g, "load", g.parameter("share", 0.5, "1"))
    >>> [str(bond) for bond in g.bonds], g.nodes["share_of_load"].law("effort")
    (['body -> mass', 'flow_of_load -> load', 'share_of_load -> body'], -effort(load)*share)
    """
    own = [bond for bond in graph._bonds if element in (bond.source, bond.target)]
    nodes = graph.flatten().nodes
    ends = [bond.source for bond in own if bond.source in nodes and nodes[bond.source].kind == "1"]
    if len(own) != 1 or len(ends) != 1:
        raise DeclarationError(f"{graph.name}: {element} is not at a 1-junction that drives it", where=(element,))
    junction = handle(graph, ends[0])
    source = graph.flow_source(f"flow_of_{element}", junction.flow)
    graph._bonds[graph._bonds.index(own[0])] = Bond(source.name, element)
    graph.effort_source(f"share_of_{element}", -share * signal("effort", element), at=junction)


def with_values(graph: BondGraph, values: Mapping[str, Any]) -> BondGraph:
    """The same graph with other parameter values, in coherent SI or as pint quantities.

    Parameters of parts are named ``part.parameter``.

    Raises
    ------
    DeclarationError
        If there is no such parameter, or a value lies outside its bounds or makes the machine impossible.

    Examples
    --------
    >>> g = BondGraph("rotor")
    >>> _ = g.parameter("J", 0.02, "kg m^2")
    >>> with_values(g, {"J": 0.03}).parameters[0].value
    0.03
    """
    twin = copy(graph)
    inner: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        part, dot, rest = name.partition(".")
        if dot and part in twin._subgraphs:
            inner.setdefault(part, {})[rest] = value
            continue
        sharing = [p.name for p in twin.subgraphs if p.shared and _has_parameter(p.graph, name)]
        for shared in sharing:
            inner.setdefault(shared, {})[name] = value
        declared = twin._quantities.get(name)
        if declared is None and sharing:
            continue
        if not isinstance(declared, Parameter):
            known = [parameter.name for parameter in graph.flatten().parameters]
            raise _unknown(graph, name, known)
        changed = dataclasses.replace(
            declared, value=DeclaredUnit(declared.unit, "", 1.0, declared.unit, f"{graph.name}: {name}").number(value)
        )
        check_quantity(changed, graph.name)
        twin._quantities[name] = changed
    for part, own in inner.items():
        subgraph = twin._subgraphs[part]
        twin._subgraphs[part] = dataclasses.replace(subgraph, graph=with_values(subgraph.graph, own))
    restarted(twin)
    flat = twin.flatten()
    check_requirements(flat.requirements, flat.parameters, graph.name)
    return twin


def _unknown(graph: BondGraph, name: str, known: Sequence[str]) -> DeclarationError:
    return DeclarationError(
        f"{graph.name}: no parameter {name!r}{suggest(name, known)} - it has {few(known)}", where=(name,)
    )


def with_bounds(graph: BondGraph, bounds: Mapping[str, tuple[float, float]]) -> BondGraph:
    """The same graph with other bounds of some of its own parameters, in coherent SI.

    Raises
    ------
    DeclarationError
        If there is no such parameter, or its value lies outside its new bounds.

    Examples
    --------
    >>> g = BondGraph("rotor")
    >>> _ = g.parameter("c", 0.0, "N m s", "drag", (0.0, 0.1))
    >>> with_bounds(g, {"c": (0.0, 1.0)}).parameters[0].bounds
    (0.0, 1.0)
    """
    twin = copy(graph)
    for name, own in bounds.items():
        declared = twin._quantities.get(name)
        if not isinstance(declared, Parameter):
            known = [parameter.name for parameter in graph.parameters]
            raise _unknown(graph, name, known)
        changed = dataclasses.replace(declared, bounds=own)
        check_quantity(changed, graph.name)
        twin._quantities[name] = changed
    return twin


def with_inputs_between(graph: BondGraph, **ways: Interpolation) -> BondGraph:
    """The graph with some inputs running another way between samples: ``linear``, ``hold`` or ``band limited``.

    Inputs of parts are named as in the flat graph, ``part.input`` or as the graph shares them.

    Raises
    ------
    DeclarationError
        If there is no such input or no such way, or the input is a code, which is always held.

    Examples
    --------
    >>> g = BondGraph("shaker")
    >>> _ = g.input("force", "N")
    >>> with_inputs_between(g, force="band limited").inputs[0].interpolation
    'band limited'
    """
    twin = copy(graph)
    declared = {one.name: one for one in graph.flatten().inputs}
    for name, way in ways.items():
        if name not in declared:
            raise DeclarationError(f"{graph.name}: no input {name!r}{suggest(name, declared)}", where=(name,))
        if way not in get_args(Interpolation) or (declared[name].letters and way != "hold"):
            known = ["hold"] if declared[name].letters else get_args(Interpolation)
            raise DeclarationError(
                f"{graph.name}: input {name} cannot be {way!r} between samples - use {', '.join(map(repr, known))}",
                where=(name,),
            )
        _run_between(twin, name, way)
    return twin


def _run_between(graph: BondGraph, name: str, way: Interpolation) -> None:
    """Let an input run a way between samples where it is declared: in the graph or in copies of its parts."""
    own = graph._quantities.get(name)
    if isinstance(own, Input):
        graph._quantities[name] = dataclasses.replace(own, interpolation=way)
    for part in list(graph._subgraphs.values()):
        inner = name if part.shared else name.removeprefix(f"{part.name}.")
        if (part.shared or inner != name) and inner not in dict(part.bind):
            inside = copy(part.graph)
            _run_between(inside, inner, way)
            graph._subgraphs[part.name] = dataclasses.replace(part, graph=inside)


def with_input_rates(graph: BondGraph, names: Sequence[str]) -> BondGraph:
    """The graph with the rates of some inputs among its inputs, whether or not its equations need them.

    Models of such a graph, with and without a storage that follows one of these inputs, have the same inputs.

    Raises
    ------
    DeclarationError
        If there is no such input, or it is held between samples, where it has no rate.

    Examples
    --------
    >>> g = BondGraph("shaker")
    >>> _ = g.input("speed", "m/s")
    >>> [one.name for one in with_input_rates(g, ["speed"]).inputs]
    ['speed', 'd_speed']
    """
    twin = copy(graph)
    declared = {one.name: one for one in graph.flatten().inputs}
    for name in names:
        if name not in declared:
            raise DeclarationError(f"{graph.name}: no input {name!r}{suggest(name, declared)}", where=(name,))
        if declared[name].is_held:
            raise DeclarationError(f"{graph.name}: input {name} is held between samples and has no rate", where=(name,))
        rate = f"d_{name}"
        while rate in twin.flatten().quantities:
            rate += "_"
        twin._quantities[rate] = declared[name].rate(rate)
    return twin


def without_input_rates(graph: BondGraph) -> BondGraph:
    """The graph as it was before :func:`with_input_rates`; one that has no rates among its inputs is returned itself.

    Examples
    --------
    >>> g = BondGraph("shaker")
    >>> _ = g.input("speed", "m/s")
    >>> without_input_rates(with_input_rates(g, ["speed"])) == g
    True
    """
    rates = {one.name for one in graph.inputs if one.rate_of}
    if not rates:
        return graph
    twin = copy(graph)
    twin._quantities = {name: one for name, one in twin._quantities.items() if name not in rates}
    return twin


def _has_parameter(graph: BondGraph, name: str) -> bool:
    return isinstance(graph.flatten().quantities.get(name), Parameter)
