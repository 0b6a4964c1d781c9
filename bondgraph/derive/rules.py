"""The rule of every variable of a node: junction sums, laws of elements, rates of storages."""

from __future__ import annotations

import functools
from collections.abc import Mapping

import sympy
from sympy import Eq, Expr, Symbol

from bondgraph.declare.elements import ENERGY_VARIABLE, LAW_GIVES, Node
from bondgraph.declare.functions import number
from bondgraph.declare.modal import smooth_effort
from bondgraph.declare.modal_laws import is_modal
from bondgraph.declare.quantities import symbol
from bondgraph.derive.causality import CausalGraph
from bondgraph.derive.definitions import ONE, ZERO, Constrained, Key, Law, Residual, Scaled, Sum
from bondgraph.derive.equations import ModeKind
from bondgraph.derive.laws import slope, solve_for
from bondgraph.derive.modes import Draft
from bondgraph.derive.patterns import equations_of, forms, match, unknowns_of
from bondgraph.derive.variables import BondVariables, Port
from bondgraph.errors import DerivationError

#: The value of a mode at which the flow of an element is held at zero.
_CONSTRAINED = {"friction": 0, "impact": 1}


def bond_variables(causal: CausalGraph, smooth: bool = True, free: bool = False) -> BondVariables:
    """The variables of a causal graph, each with the rule that gives it.

    Parameters
    ----------
    causal
        Graph with all strokes placed.
    smooth
        Whether switches, friction and impacts are taken as smooth laws, else as modes.
    free
        Whether the efforts of elements with modes are given from outside.

    Raises
    ------
    DerivationError
        If a law does not determine what a node must give.
    """
    variables = BondVariables(causal, smooth, free)
    for node in causal.graph.nodes.values():
        variables.modes.owner = node.name
        _define(variables, node)
    variables.modes.owner = ""
    return variables


def _define(variables: BondVariables, node: Node) -> None:
    """Define what a node gives to its bonds, and the rates of its states."""
    _DEFINE[node.kind](variables, node)


def _junction(variables: BondVariables, node: Node) -> None:
    """The bond that imposes the common variable receives the balance of the others."""
    bonds = variables.incidence[node.name]
    imposes_by_effort = node.kind == "0"
    strong = next(b for b, _ in bonds if variables.causal.receives_effort(b, node.name) == imposes_by_effort)
    sign = {bond: 1 if inward else -1 for bond, inward in bonds}
    read = variables.flow if imposes_by_effort else variables.effort
    terms = tuple((-sign[strong] * sign[bond], read(bond)) for bond, _ in bonds if bond != strong)
    key = read(strong)
    variables.definitions[key] = Sum(terms)
    ends = variables.causal.bonds[strong]
    variable = "flow" if imposes_by_effort else "effort"
    domain = variables.bond_domain(strong)
    variables.label(key, variable, f"{ends.source}_{ends.target}", domain, f"{variable} of bond {ends}")


def _source(variables: BondVariables, node: Node) -> None:
    gives, law = node.laws[0]
    port = variables.ports(node)[0]
    variables.label_port(port)
    variables.definitions[variables.own(port, gives)[0]] = variables.law(law)


def _two_port(variables: BondVariables, node: Node) -> None:
    first, second = variables.ports(node)
    inward, outward = (first, second) if first.sign > 0 else (second, first)
    for port, side in ((inward, "in"), (outward, "out")):
        domain = variables.bond_domain(port.bond)
        for key, variable in ((variables.effort(port.bond), "effort"), (variables.flow(port.bond), "flow")):
            variables.label(key, variable, f"{node.name}_{side}", domain, f"{variable} of {node.name} ({side} side)")
    modulus: Key = ("m", node.name)
    law = node.law("modulus")
    assert law is not None
    variables.definitions[modulus] = variables.law(law)
    variables.labels[modulus] = (f"m_{node.name}", "", f"modulus of {node.name}")
    takes_effort = variables.causal.receives_effort(outward.bond, node.name)
    e_in, f_in = variables.effort(inward.bond), variables.flow(inward.bond)
    e_out, f_out = variables.effort(outward.bond), variables.flow(outward.bond)
    if node.kind == "TF":
        pairs = ((e_in, e_out), (f_out, f_in)) if takes_effort else ((e_out, e_in), (f_in, f_out))
        inverted = not takes_effort
    else:
        pairs = ((f_in, e_out), (f_out, e_in)) if takes_effort else ((e_in, f_out), (e_out, f_in))
        inverted = takes_effort
    for given, of in pairs:
        variables.definitions[given] = Scaled(modulus, of, inverted)


# ---------------------------------------------------------------------- laws without memory


def _resistance(variables: BondVariables, node: Node) -> None:
    """What each port gives, from the law that has it as its subject, or by solving the laws for it."""
    if is_modal(dict(node.laws)):
        _modal(variables, node)
        return
    ports = variables.ports(node)
    pattern = tuple(variables.causal.receives_effort(port.bond, node.name) for port in ports)
    unknowns = unknowns_of(node, pattern)
    own = {port.local(v): variables.own(port, v) for port in ports for v in ("effort", "flow")}
    for port in ports:
        variables.label_port(port)
    explicit = _explicit(node, unknowns)
    if explicit is not None:
        for unknown, law in explicit.items():
            key, sign = own[unknown]
            variables.definitions[key] = variables.law(sign * law, own)
        return
    _solve(variables, node, equations_of(node), unknowns, own)


def _modal(variables: BondVariables, node: Node) -> None:
    """The effort of an element with modes: smooth, given from outside, or by its mode."""
    port = variables.ports(node)[0]
    variables.label_port(port)
    key, _ = variables.own(port, "effort")
    own = {symbol(v): variables.own(port, v) for v in ("effort", "flow")}
    laws = dict(node.laws)
    if variables.smooth:
        variables.definitions[key] = variables.law(smooth_effort(laws), own)
        return
    kind: ModeKind = "impact" if "gap" in laws else "friction"
    mode = symbol(variables.unused(f"mode_{node.name}"))
    variables.modes.drafts[mode] = Draft(kind, node.name, _zero_functions(variables, node, laws, own))
    if variables.modes.free:
        variables.modes.efforts[node.name] = symbol(variables.unused(f"effort_{node.name}"))
        variables.definitions[key] = Law(variables.modes.efforts[node.name], ())
        return
    slip = variables.law(mode * laws["capacity"] if kind == "friction" else ZERO, own)
    static = variables.law(_static(laws) if kind == "friction" else ONE)
    flow, sign = variables.own(port, "flow")
    locked = Eq(mode, _CONSTRAINED[kind])
    variables.definitions[key] = Constrained(node.name, ("d", flow), locked, slip, static, sign)


def _zero_functions(
    variables: BondVariables, node: Node, laws: Mapping[str, Expr], own: dict[Symbol, tuple[Key, int]]
) -> tuple[tuple[Law, str, str], ...]:
    name = node.name
    domain = variables.bond_domain(variables.ports(node)[0].bond)
    effort, flow, distance = (
        "" if domain is None else unit
        for unit in (
            domain and domain.effort_unit, domain and domain.flow_unit, domain and domain.displacement_unit,
        )
    )  # fmt: skip
    if "gap" in laws:
        rows = [
            (laws["gap"], distance, f"gap of {name}"),
            (-symbol("effort"), effort, f"push of {name}"),
            (symbol("flow"), flow, f"opening speed of {name}"),
        ]
    else:
        static = _static(laws)
        rows = [
            (symbol("flow"), flow, f"flow of {name}"),
            (static - symbol("effort"), effort, f"what {name} can carry forward beyond its effort"),
            (static + symbol("effort"), effort, f"what {name} can carry backward beyond its effort"),
        ]
    return tuple((variables.law(law, own), unit or "", meaning) for law, unit, meaning in rows)


def _static(laws: Mapping[str, Expr]) -> Expr:
    """What a friction can hold: its static capacity, or the sliding one at rest."""
    return laws.get("static", laws["capacity"]).xreplace({symbol("flow"): ZERO})


def _explicit(node: Node, unknowns: list[Symbol]) -> dict[Symbol, Expr] | None:
    """Laws that give exactly the unknowns, as declared."""
    given = forms(node) if node.kind == "X" else [dict(node.laws)]
    for form in given:
        if all(unknown.name in form for unknown in unknowns):
            return {unknown: form[unknown.name] for unknown in unknowns}
    return None


def _solve(
    variables: BondVariables,
    node: Node,
    equations: list[Expr],
    unknowns: list[Symbol],
    own: dict[Symbol, tuple[Key, int]],
) -> None:
    """Define each unknown by one of the equations: in closed form where it is linear in it, else by its residual.

    An equation may contain other unknowns; then they form an algebraic loop, which is solved as any other. Newton's
    method starts from the declared start value of the port.
    """
    implicit = node.kind == "R" and node.laws[0][0].startswith("residual")
    givers = match(equations, unknowns, spare=implicit)
    if givers is None:
        names = ", ".join(f"{unknown.name}({node.name})" for unknown in unknowns)
        raise DerivationError(
            f"{variables.graph.name}: the laws of {node.kind} {node.name} do not determine {names} from what its bonds "
            "give - give them in another form, or change what imposes its variables",
            where=(node.name,),
        )
    for position, (unknown, giver) in enumerate(zip(unknowns, givers, strict=True)):
        key, sign = own[unknown]
        if unknown not in equations[giver].free_symbols:  # the equation holds through what the unknown does elsewhere
            variables.definitions[key] = variables.law(sign * unknown + equations[giver], own)
            continue
        solved = solve_for(equations[giver], unknown)
        if solved is not None:
            variables.definitions[key] = variables.law(sign * solved, own)
        else:
            law = variables.law(equations[giver], own, unknown=unknown)
            guess = number(node.initial[position]) if position < len(node.initial) else ZERO
            variables.definitions[key] = Residual(law.template, unknown, sign, law.arguments, sign * guess)


# ---------------------------------------------------------------------- storages


def _storage(variables: BondVariables, node: Node) -> None:
    """Independent ports give their power variable by the law; of dependent ones the law gives the energy variable.

    What a dependent port gives to its bond is the rate of its energy variable.
    """
    ports = variables.ports(node)
    gives, stored = LAW_GIVES[node.kind], ENERGY_VARIABLE[node.kind]
    own = {port.local(gives): variables.own(port, gives) for port in ports}
    states: dict[Symbol, Expr] = {}
    unknowns = []
    for port in ports:
        value = variables.energy_variable(node, port.number)
        if isinstance(value, Expr):
            states[port.local(stored)] = value
            unknowns.append(port.local(gives))
            _state_rate(variables, port)
        else:
            own[port.local(stored)] = value
            unknowns.append(port.local(stored))
            _dependent_rate(variables, port)
    equations = [law.xreplace(states) for law in _storage_laws(node, ports, is_dependent=not states)]
    _solve(variables, node, equations, unknowns, own)


def _storage_laws(node: Node, ports: list[Port], is_dependent: bool) -> list[Expr]:
    """The laws of a storage as expressions that vanish."""
    gives, stored = LAW_GIVES[node.kind], ENERGY_VARIABLE[node.kind]
    laws = dict(node.laws)
    if "residual" in laws:
        return [laws["residual"]]
    if stored in laws and (is_dependent or gives not in laws):
        return [laws[stored] - symbol(stored)]
    if "energy" in laws:
        return [_gradient(laws["energy"], port.local(stored)) - port.local(gives) for port in ports]
    return [laws[port.local(gives).name] - port.local(gives) for port in ports]


@functools.lru_cache(maxsize=1024)
def _gradient(energy: Expr, variable: Symbol) -> Expr:
    """What a storage gives at a port; kept, for a machine is derived again with every effect that is tried."""
    return sympy.factor_terms(slope(energy, variable))


def _state_rate(variables: BondVariables, port: Port) -> None:
    state = variables.state_of(port.node.name, port.number)
    assert state is not None
    taken = "flow" if port.node.kind == "C" else "effort"
    inertia = variables.constant_inertia(port.node)
    balance = symbol(taken) if inertia is None else symbol(taken) / inertia
    rate: Key = ("d", ("x", state.symbol.name))
    variables.labels[rate] = (f"d_{state.symbol.name}", "", f"rate of {state.meaning}")
    variables.definitions[rate] = variables.law(balance, {symbol(taken): variables.own(port, taken)})


def _dependent_rate(variables: BondVariables, port: Port) -> None:
    node, stored = port.node, ENERGY_VARIABLE[port.node.kind]
    domain = variables.bond_domain(port.bond)
    unit = "" if domain is None else getattr(domain, f"{stored}_unit")
    letter, name = "q" if node.kind == "C" else "p", f"{node.name}{port.suffix}"
    key: Key = ("q", node.name, port.number)
    variables.labels[key] = (f"{letter}_{name}", unit, f"{stored} of {name} (dependent)")
    taken, sign = variables.own(port, "flow" if node.kind == "C" else "effort")
    variables.definitions[taken] = Sum(((sign, ("d", key)),))


_DEFINE = {
    "0": _junction, "1": _junction, "Se": _source, "Sf": _source, "R": _resistance, "X": _resistance,
    "C": _storage, "I": _storage, "TF": _two_port, "GY": _two_port,
}  # fmt: skip
