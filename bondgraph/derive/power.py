"""Stored energy and power balance of a graph as expressions.

Every element's power is the product of effort and flow of its bonds, counted as positive into the element. Junctions,
transformers and gyrators pass power on, whatever modulates them, so what the sources supply is stored or dissipated:

    d(stored)/dt = supplied - dissipated.

The stored energy (the Hamiltonian, as a function of the energy variables) is the integral of the storages' laws,

    sum of  p^2 / (2 I)  and  k q^2 / 2        for linear storages,

and its rate follows from the state derivatives by the chain rule, not from the storages' power: that both sides agree
is a check of the derivation. Karnopp, Margolis and Rosenberg (2012), System Dynamics, 5th ed., sections 3.2 and 7.1.

Bonds of pseudo-bond domains (temperature and heat flow) carry no power as effort times flow; their elements are left
out and listed as ``excluded``. What a resistance passes to such a bond is dissipated on its power side.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import sympy
from sympy import Add, Expr, Symbol

from bondgraph.declare.elements import ENERGY_VARIABLE, LAW_GIVES, SOURCES, STORAGES, TWO_PORTS, Node
from bondgraph.declare.expressions import normalise, signal, to_text
from bondgraph.declare.functions import TableFunction, jump, switch
from bondgraph.declare.quantities import symbol
from bondgraph.derive.causality import CausalGraph
from bondgraph.derive.definitions import ZERO
from bondgraph.derive.derivation import derive
from bondgraph.derive.equations import OutputEquation, StateEquations
from bondgraph.derive.integrals import agree, integral, line_integral
from bondgraph.derive.jacobian import gradient, jacobian
from bondgraph.derive.laws import solve_for
from bondgraph.derive.modes import by_value
from bondgraph.derive.rules import bond_variables
from bondgraph.errors import DerivationError, suggest

Energies = Mapping[str, Callable[..., Any] | Expr]


@dataclass(frozen=True)
class ElementPower:
    """The power that flows into one element [W], and the energy it stores [J] where it is a storage."""

    element: str
    kind: str
    power: Expr
    energy: Expr | None


@dataclass(frozen=True)
class PowerBalance:
    """``rate = supplied - dissipated``, where ``rate`` is the time derivative of ``stored``.

    Expressions in states, inputs, parameters, ``t`` and the symbols assigned in ``equations``, whose outputs are the
    four of them (``stored_energy`` [J] and three powers [W]), so that they can be printed and simulated as any model.
    ``excluded`` names the elements with bonds of pseudo-bond domains only.
    """

    stored: Expr
    supplied: Expr
    dissipated: Expr
    rate: Expr
    elements: tuple[ElementPower, ...]
    excluded: tuple[str, ...]
    equations: StateEquations


def power_balance(causal: CausalGraph, energies: Energies | None = None, smooth: bool = True) -> PowerBalance:
    """Stored energy, supplied and dissipated power of a causal graph.

    Parameters
    ----------
    causal
        Graph with all strokes placed; storages may be dependent.
    energies
        Stored energy of storages whose law has no integral in closed form, by their name: a function of the energy
        variables (one per port), or an expression in ``displacement`` or ``momentum``. It is checked against the law.
    smooth
        As in :func:`~bondgraph.derive.derivation.derive`.

    Raises
    ------
    DerivationError
        If the energy of a storage is not known, does not belong to its law or depends on more than its own variables,
        or a storage, transformer or gyrator joins a pseudo-bond domain with a true one. The element is named.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> g = BondGraph("oscillator")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("push", g.input("F", "N"), at=body)
    >>> _ = g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body, state="v")
    >>> _ = g.compliance("spring", g.parameter("k", 8.0, "N/m"), at=body, state="q")
    >>> _ = g.resistance("damper", g.parameter("c", 0.5, "N s/m"), at=body)
    >>> balance = power_balance(assign_causality(g))
    >>> balance.stored, balance.supplied
    (k*q**2/2 + m*v**2/2, F*v)
    """
    return _Balance(causal, energies or {}, smooth).run()


class _Balance:
    """Bonds with and without power, energies of the storages, and their sums."""

    def __init__(self, causal: CausalGraph, energies: Energies, smooth: bool) -> None:
        self.causal, self.smooth = causal, smooth
        self.graph = causal.graph
        self.variables = bond_variables(causal, smooth)
        self.incidence = self.graph.incidence()
        self.energies = energies
        self.tables = {table.name: table for table in self.graph.tables}
        storages = [node.name for node in self.graph.nodes.values() if node.kind in STORAGES]
        for name in energies:
            if name not in storages:
                raise DerivationError(f"{self.graph.name}: no storage {name!r}{suggest(name, storages)}", where=(name,))

    def run(self) -> PowerBalance:
        elements, excluded = self._elements()
        stores = [node for node in elements if node.kind in STORAGES]
        equations, energies, powers = self._derived(stores)
        found = [
            ElementPower(node.name, node.kind, self._power(node, powers), energies.get(node.name)) for node in elements
        ]

        def total(*kinds: str) -> Expr:
            return Add(*(element.power for element in found if element.kind in kinds))

        stored, supplied, dissipated = Add(*energies.values()), -total(*SOURCES), total("R", "X")
        equations, rate = self._rate(equations, stored)
        joule, watt = ("J", "W") if self._has_units(elements) else ("", "")
        outputs = (
            OutputEquation(symbol("stored_energy"), stored, joule, "energy in the storages"),
            OutputEquation(symbol("supplied_power"), supplied, watt, "power of the sources"),
            OutputEquation(symbol("dissipated_power"), dissipated, watt, "power into the resistances"),
            OutputEquation(symbol("stored_energy_rate"), rate, watt, "rate of the energy in the storages"),
        )
        return PowerBalance(
            stored, supplied, dissipated, rate, tuple(found), excluded, replace(equations, outputs=outputs)
        )

    # ------------------------------------------------------------------ what takes part

    def _is_pseudo(self, bond: int) -> bool:
        domain = self.variables.bond_domain(bond)
        return domain is not None and domain.pseudo

    def _elements(self) -> tuple[list[Node], tuple[str, ...]]:
        """Elements other than junctions, transformers and gyrators with power bonds, and the names of those without."""
        found, excluded = [], []
        for node in self.graph.nodes.values():
            if node.is_junction:
                continue
            pseudo = [self._is_pseudo(bond) for bond, _ in self.incidence[node.name]]
            if all(pseudo):
                excluded.append(node.name)
                continue
            if any(pseudo) and node.kind in (*STORAGES, *TWO_PORTS):
                raise DerivationError(
                    f"{self.graph.name}: {node.kind} {node.name} joins a pseudo-bond domain with a true one, so its "
                    "power is not defined - use true bonds (entropy flow instead of heat flow) on both sides",
                    where=(node.name,),
                )
            if node.kind not in TWO_PORTS:
                found.append(node)
        return found, tuple(excluded)

    def _has_units(self, elements: Sequence[Node]) -> bool:
        bonds = [bond for node in elements for bond, _ in self.incidence[node.name]]
        return all(self.variables.bond_domain(bond) is not None for bond in bonds)

    # ------------------------------------------------------------------ values

    def _derived(self, stores: Sequence[Node]) -> tuple[StateEquations, dict[str, Expr], list[Expr]]:
        """Equations with the energy of every storage and the power of every bond among what they compute."""
        graph = copy.deepcopy(self.graph)
        taken = {output.name: None for output in graph.outputs}
        names = []
        for node in stores:
            name = f"energy_of_{node.name}"
            while name in taken:
                name += "_"
            taken[name] = None
            names.append(name)
            graph.measure(name, self._energy(node), "")
        equations = by_value(derive(replace(self.causal, graph=graph), bonds=True, smooth=self.smooth))
        values = [output.expression for output in equations.outputs]
        count, first = len(graph.bonds), len(self.graph.outputs)
        energies = dict(zip((node.name for node in stores), values[first:], strict=False))
        efforts, flows = values[-2 * count : -count], values[-count:]
        return equations, energies, [effort * flow for effort, flow in zip(efforts, flows, strict=True)]

    def _power(self, node: Node, powers: Sequence[Expr]) -> Expr:
        bonds = [(bond, inward) for bond, inward in self.incidence[node.name] if not self._is_pseudo(bond)]
        return Add(*(powers[bond] if inward else -powers[bond] for bond, inward in bonds))

    def _rate(self, equations: StateEquations, stored: Expr) -> tuple[StateEquations, Expr]:
        """The time derivative of the stored energy by the chain rule, and the equations with the slopes it uses."""
        output = OutputEquation(symbol("stored_energy"), stored, "", "")
        slopes = jacobian(replace(equations, outputs=(output,)), by=("x", "u", "t"), of=("outputs",))
        terms = [entry.value * equations.derivatives[entry.column] for entry in slopes.block("outputs", "x").entries]
        rates = self.variables.input_rates  # what is held between samples has none
        for entry in slopes.block("outputs", "u").entries:
            driving = equations.inputs[entry.column].symbol
            terms += [entry.value * rates[driving]] if driving in rates else []
        terms += [entry.value for entry in slopes.block("outputs", "t").entries]
        return replace(equations, assignments=(*equations.assignments, *slopes.assignments)), Add(*terms)

    # ------------------------------------------------------------------ energies

    def _energy(self, node: Node) -> Expr:
        """The energy of a storage in signals that read its variables."""
        own = [port.local(ENERGY_VARIABLE[node.kind]) for port in self.variables.ports(node)]
        laws = dict(node.laws)
        if not self.smooth:  # a smooth switch has no integral in closed form, a jump has
            laws = {given: law.replace(switch, jump) for given, law in laws.items()}
        self._check_own(node, own, laws)
        read: Sequence[Symbol] = own
        if node.name in self.energies:
            energy = self._given(node, own, laws)
        elif "energy" in laws:
            energy = laws["energy"]
        else:
            energy, read = self._integrated(node, own, laws)
        ports = [port.number if node.ports > 1 else 0 for port in self.variables.ports(node)]
        stems = [local.name.rstrip("0123456789") for local in read]
        signals = [signal(stem, node.name, port) for stem, port in zip(stems, ports, strict=True)]
        return energy.xreplace(dict(zip(read, signals, strict=True)))

    def _check_own(self, node: Node, own: Sequence[Symbol], laws: Mapping[str, Expr]) -> None:
        power = [port.local(LAW_GIVES[node.kind]) for port in self.variables.ports(node)]
        allowed = {*own, *power, *(parameter.symbol for parameter in self.graph.parameters)}
        foreign = sorted({str(used) for law in laws.values() for used in law.free_symbols - allowed})
        if foreign:
            raise DerivationError(
                f"{self.graph.name}: the law of {node.kind} {node.name} uses {foreign[0]}, so its energy is not a "
                f"function of its {ENERGY_VARIABLE[node.kind]} alone - leave {foreign[0]} out of the law, or give it "
                "a port of its own",
                where=(node.name,),
            )

    def _given(self, node: Node, own: Sequence[Symbol], laws: Mapping[str, Expr]) -> Expr:
        given = self.energies[node.name]
        energy = normalise(given(*own) if callable(given) and not isinstance(given, sympy.Basic) else given)
        if not is_energy_of(energy, node, own, laws):
            raise DerivationError(
                f"{self.graph.name}: the energy {to_text(energy)} given for {node.kind} {node.name} does not belong to "
                f"its law - its derivative must be the {LAW_GIVES[node.kind]}",
                where=(node.name,),
            )
        return energy

    def _integrated(self, node: Node, own: Sequence[Symbol], laws: Mapping[str, Expr]) -> tuple[Expr, Sequence[Symbol]]:
        """The integral of a storage's law, and the own variables it is written in."""
        power, stored = LAW_GIVES[node.kind], ENERGY_VARIABLE[node.kind]
        read: Sequence[Symbol] = own
        if node.ports > 1:
            energy = line_integral([laws[f"{power}{i + 1}"] for i in range(node.ports)], own)
            if energy is not None and not is_energy_of(energy, node, own, laws):
                raise DerivationError(
                    f"{self.graph.name}: {node.kind} field {node.name} stores no energy: its laws are not the gradient "
                    "of one (port 1 must feel of port 2 what port 2 feels of port 1) - correct the laws",
                    where=(node.name,),
                )
        else:
            law = solve_for(laws["residual"], symbol(power)) if "residual" in laws else laws.get(power)
            energy = None if law is None else integral(law, own[0], self.tables)
            if (
                stored in laws and law is None
            ):  # energy and co-energy add up to the product of both variables (Legendre)
                read = [symbol(power)]
                inner = integral(laws[stored], read[0], self.tables)
                energy = None if inner is None else read[0] * laws[stored] - inner
        if energy is None:
            tabulated = any(law.has(TableFunction) for law in laws.values())
            reason = "a table that cannot be integrated" if tabulated else "no integral in closed form"
            todo = f"give it as energies={{{node.name!r}: function of its {stored}}}"
            raise DerivationError(
                f"{self.graph.name}: the stored energy of {node.kind} {node.name} is not known: its law has {reason} - "
                f"{f'use a table of its {stored} alone' if tabulated else todo}",
                where=(node.name,),
            )
        return energy, read


def is_energy_of(energy: Expr, node: Node, own: Sequence[Symbol], laws: Mapping[str, Expr]) -> bool:
    """Whether the gradient of an energy satisfies the laws of a storage, tried at random points in 30 digits.

    Examples
    --------
    >>> q = symbol("displacement")
    >>> spring = Node("spring", "C", laws=(("effort", q**3),))
    >>> is_energy_of(q**4 / 4, spring, [q], dict(spring.laws)), is_energy_of(q**4, spring, [q], dict(spring.laws))
    (True, False)
    """
    slopes = gradient(energy, set(own))
    power, stored = LAW_GIVES[node.kind], ENERGY_VARIABLE[node.kind]
    for local in own:
        suffix, slope = local.name.removeprefix(stored), slopes.get(local, ZERO)
        here = {symbol(power + suffix): slope}
        if "residual" in laws:
            first, *rest = Add.make_args(laws["residual"].xreplace(here))
            sides = first, -Add(*rest)
        elif "energy" in laws:
            sides = slope, gradient(laws["energy"], set(own)).get(local, ZERO)
        elif power + suffix in laws:
            sides = slope, laws[power + suffix]
        else:
            sides = laws[stored].xreplace(here), local
        if not agree(*sides):
            return False
    return True
