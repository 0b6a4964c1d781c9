"""Bond variables of a causal graph: which are equal, what they are called, and the rule that gives each."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from sympy import Expr, Symbol, diff

from bondgraph.declare.domains import UNDECLARED_PREFIXES, Domain
from bondgraph.declare.elements import ENERGY_VARIABLE, LAW_GIVES, Node
from bondgraph.declare.expressions import signal_name
from bondgraph.declare.quantities import Integral, NamedSignal, Parameter, symbol
from bondgraph.declare.validation import node_domains
from bondgraph.derive.causality import CausalGraph
from bondgraph.derive.definitions import Definition, Key, Law, Rate, Residual, Scaled, Sum
from bondgraph.derive.equations import State, StateVariable
from bondgraph.derive.laws import affine_parts, inverse, linear_coefficient
from bondgraph.errors import DerivationError


@dataclass(frozen=True)
class Port:
    """One port of an element: its bond, and +1 where the bond points into the element."""

    node: Node
    number: int
    bond: int
    sign: int

    def local(self, variable: str) -> Symbol:
        """The element's own symbol of a variable at this port."""
        return symbol(f"{variable}{self.number}" if self.node.ports > 1 else variable)


class BondVariables:
    """Keys, names, units and definitions of every variable of a causal graph (built once, then only read)."""

    def __init__(self, causal: CausalGraph) -> None:
        self.causal = causal
        self.graph = causal.graph
        self.incidence = causal.graph.incidence()
        self.domains = node_domains(causal.graph)
        self.parameters = {p.symbol for p in self.graph.parameters}
        self.input_rates = {
            i.symbol: symbol(f"d_{i.name}") for i in self.graph.inputs if i.interpolation == "linear"
        }  # an input that is held between samples does not change while it is held
        self.definitions: dict[Key, Definition] = {}
        self.labels: dict[Key, tuple[str, str, str]] = {}
        self.states: list[State] = []
        self.state_rates: list[Key] = []
        self._derivative = set(causal.derivative)
        self._merge()
        self._define()

    # ------------------------------------------------------------------ equal variables

    def _merge(self) -> None:
        """Union of efforts at 0-junctions and of flows at 1-junctions."""
        parent: dict[Key, Key] = {}

        def find(key: Key) -> Key:
            while (above := parent.get(key, key)) != key:
                key = above
            return key

        for node in self.graph.nodes.values():
            if node.is_junction:
                letter = "e" if node.kind == "0" else "f"
                bonds = [bond for bond, _ in self.incidence[node.name]]
                for bond in bonds[1:]:
                    a, b = find((letter, bonds[0])), find((letter, bond))
                    parent[max(a, b)] = min(a, b)
        count = range(len(self.graph.bonds))
        self._roots = {(letter, bond): find((letter, bond)) for letter in "ef" for bond in count}

    def effort(self, bond: int) -> Key:
        """Key of a bond's effort."""
        return self._roots["e", bond]

    def flow(self, bond: int) -> Key:
        """Key of a bond's flow."""
        return self._roots["f", bond]

    def ports(self, node: Node) -> list[Port]:
        """Ports of an element in order of its bonds."""
        pairs = enumerate(self.incidence[node.name], start=1)
        return [Port(node, number, bond, 1 if inward else -1) for number, (bond, inward) in pairs]

    # ------------------------------------------------------------------ definitions

    def _define(self) -> None:
        for node in self.graph.nodes.values():
            if node.is_junction:
                self._label_junction(node)
        storages = [node for node in self.graph.nodes.values() if node.kind in ("C", "I")]
        for node in storages:
            for port in self.ports(node):
                self._label_port(port)
        self._declare_states(storages)
        for quantity in self.graph.quantities.values():
            if isinstance(quantity, Integral):
                self._integral(quantity)
            elif isinstance(quantity, NamedSignal):
                self.definitions["s", quantity.name] = self.law(quantity.expression)
                self.labels["s", quantity.name] = (quantity.name, quantity.unit, quantity.meaning or "signal")
        for node in self.graph.nodes.values():
            getattr(self, f"_define_{_METHOD[node.kind]}")(node)

    def _label_junction(self, node: Node) -> None:
        bonds = [bond for bond, _ in self.incidence[node.name]]
        key = self.effort(bonds[0]) if node.kind == "0" else self.flow(bonds[0])
        variable = "effort" if node.kind == "0" else "flow"
        self._label(key, variable, node.name, self.domains[node.name], f"{variable} of {node.name}")

    def _label_port(self, port: Port) -> None:
        domain = self.bond_domain(port.bond)
        suffix = str(port.number) if port.node.ports > 1 else ""
        for key, variable in ((self.effort(port.bond), "effort"), (self.flow(port.bond), "flow")):
            name = port.node.name + suffix
            self._label(key, variable, name, domain, f"{variable} of {name}")

    def _label(self, key: Key, variable: str, name: str, domain: Domain | None, meaning: str) -> None:
        if key in self.labels:
            return
        prefix = UNDECLARED_PREFIXES[0 if variable == "effort" else 1]
        unit = ""
        if domain is not None:
            prefix = domain.effort_prefix if variable == "effort" else domain.flow_prefix
            unit = domain.effort_unit if variable == "effort" else domain.flow_unit
        self.labels[key] = (f"{prefix}_{name}", unit, meaning)

    def bond_domain(self, bond: int) -> Domain | None:
        """Domain of a bond, from the end that knows it."""
        ends = self.graph.bonds[bond]
        return self.domains[ends.source] or self.domains[ends.target]

    def _define_junction(self, node: Node) -> None:
        """The bond that imposes the common variable receives the balance of the others."""
        bonds = self.incidence[node.name]
        imposes_by_effort = node.kind == "0"
        strong = next(b for b, _ in bonds if self.causal.receives_effort(b, node.name) == imposes_by_effort)
        sign = {bond: 1 if inward else -1 for bond, inward in bonds}
        read = self.flow if imposes_by_effort else self.effort
        terms = tuple((-sign[strong] * sign[bond], read(bond)) for bond, _ in bonds if bond != strong)
        key = read(strong)
        self.definitions[key] = Sum(terms)
        ends = self.graph.bonds[strong]
        variable = "flow" if imposes_by_effort else "effort"
        domain = self.bond_domain(strong)
        self._label(key, variable, f"{ends.source}_{ends.target}", domain, f"{variable} of bond {ends}")

    def _define_source(self, node: Node) -> None:
        gives, law = node.laws[0]
        port = self.ports(node)[0]
        self._label_port(port)
        key = self.effort(port.bond) if gives == "effort" else self.flow(port.bond)
        self.definitions[key] = self.law(law)

    def _define_resistance(self, node: Node) -> None:
        ports = self.ports(node)
        gives = ["effort" if not self.causal.receives_effort(p.bond, node.name) else "flow" for p in ports]
        own = {
            port.local("flow" if given == "effort" else "effort"): self._own(port, "flow" if given == "effort" else "effort")
            for port, given in zip(ports, gives, strict=True)
        }
        for port, given in zip(ports, gives, strict=True):
            self._label_port(port)
            key, sign = self._own(port, given)
            local = port.local(given)
            self.definitions[key] = self._resistance_rule(node, given, local, sign, own)

    def _resistance_rule(
        self, node: Node, given: str, local: Symbol, sign: int, own: dict[Symbol, tuple[Key, int]]
    ) -> Definition:
        explicit = node.law(local.name)
        if explicit is not None:
            return self.law(sign * explicit, own)
        template = node.law(local.name.replace(given, "residual"))
        if template is None:
            other = "flow" if given == "effort" else "effort"
            law = node.law(other)
            assert law is not None  # a law of a fixed form has fixed its stroke
            solved = inverse(law, local, symbol(other))
            assert solved is not None
            return self.law(sign * solved, own)
        parts = affine_parts(template, local)
        if parts is not None:
            return self.law(-sign * parts[1] / parts[0], own)
        law_of = self.law(template, own, unknown=local)
        return Residual(law_of.template, local, sign, law_of.arguments)

    def _own(self, port: Port, variable: str) -> tuple[Key, int]:
        """Key of an element's own effort or flow and the sign with which the bond's variable enters it."""
        return (self.effort(port.bond), 1) if variable == "effort" else (self.flow(port.bond), port.sign)

    def _define_two_port(self, node: Node) -> None:
        first, second = self.ports(node)
        inward, outward = (first, second) if first.sign > 0 else (second, first)
        for port, side in ((inward, "in"), (outward, "out")):
            domain = self.bond_domain(port.bond)
            for key, variable in ((self.effort(port.bond), "effort"), (self.flow(port.bond), "flow")):
                self._label(key, variable, f"{node.name}_{side}", domain, f"{variable} of {node.name} ({side} side)")
        modulus: Key = ("m", node.name)
        law = node.law("modulus")
        assert law is not None
        self.definitions[modulus] = self.law(law)
        self.labels[modulus] = (f"m_{node.name}", "", f"modulus of {node.name}")
        takes_effort = self.causal.receives_effort(outward.bond, node.name)
        e_in, f_in = self.effort(inward.bond), self.flow(inward.bond)
        e_out, f_out = self.effort(outward.bond), self.flow(outward.bond)
        if node.kind == "TF":
            pairs = ((e_in, e_out), (f_out, f_in)) if takes_effort else ((e_out, e_in), (f_in, f_out))
            inverted = not takes_effort
        else:
            pairs = ((f_in, e_out), (f_out, e_in)) if takes_effort else ((e_in, f_out), (e_out, f_in))
            inverted = takes_effort
        for given, of in pairs:
            self.definitions[given] = Scaled(modulus, of, inverted)

    # ------------------------------------------------------------------ storages and states

    def _declare_states(self, storages: list[Node]) -> None:
        for node in storages:
            for port in self.ports(node):
                if (node.name, port.number) in self._derivative:
                    continue
                domain = self.bond_domain(port.bond)
                variable, unit = self._state_variable(node, domain)
                name = self._state_name(node, port, variable, domain)
                initial = node.initial[port.number - 1] if len(node.initial) >= port.number else 0.0
                suffix = f" (port {port.number})" if node.ports > 1 else ""
                meaning = f"{variable} of {node.name}{suffix}"
                state = State(symbol(name), unit, initial, meaning, node.name, variable)
                self.states.append(state)

    def _state_variable(self, node: Node, domain: Domain | None) -> tuple[StateVariable, str]:
        """Flow for a constant inertance, momentum for any other, displacement for compliances."""
        if node.kind == "C":
            return "displacement", "" if domain is None else domain.displacement_unit
        if self.constant_inertia(node) is not None:
            return "flow", "" if domain is None else domain.flow_unit
        return "momentum", "" if domain is None else domain.momentum_unit

    def constant_inertia(self, node: Node) -> Expr | None:
        """The inertia of a one-port inertance whose law is ``momentum/inertia`` with a constant inertia, else None."""
        law = node.law("flow")
        if node.kind != "I" or law is None:
            return None
        reciprocal = linear_coefficient(law, symbol("momentum"))
        if reciprocal is None or not reciprocal.free_symbols <= self.parameters:
            return None
        return 1 / reciprocal

    def _state_name(self, node: Node, port: Port, variable: StateVariable, domain: Domain | None) -> str:
        if node.state:
            return node.state
        suffix = str(port.number) if node.ports > 1 else ""
        prefix = {"displacement": "q", "momentum": "p"}.get(variable)
        if prefix is None:
            prefix = UNDECLARED_PREFIXES[1] if domain is None else domain.flow_prefix
        name = f"{prefix}_{node.name}{suffix}"
        while name in self.graph.quantities:
            name += "_"
        return name

    def state_of(self, node: str, port: int = 1) -> State | None:
        """The state of a storage's port, None where it is dependent."""
        if (node, port) in self._derivative:
            return None
        return self._states_by_port[node, port]

    @functools.cached_property
    def _states_by_port(self) -> dict[tuple[str, int], State]:
        count: dict[str, int] = {}
        found = {}
        for state in self.states:
            port = count.get(state.element, 0) + 1
            while (state.element, port) in self._derivative:
                port += 1
            count[state.element] = port
            found[state.element, port] = state
        return found

    def _integral(self, quantity: Integral) -> None:
        state = State(
            symbol(quantity.name), quantity.unit, quantity.initial, quantity.meaning or "integral", "", "integral"
        )
        self.states.append(state)
        self.definitions["d", ("x", quantity.name)] = self.law(quantity.of)
        self.labels["d", ("x", quantity.name)] = (f"d_{quantity.name}", "", f"rate of {quantity.name}")

    def _define_storage(self, node: Node) -> None:
        ports = self.ports(node)
        dependent = [p for p in ports if (node.name, p.number) in self._derivative]
        if dependent and node.is_field:
            raise DerivationError(
                f"{self.graph.name}: port {dependent[0].number} of the {node.kind} field {node.name} is in derivative "
                f"causality ({self.causal.explain(dependent[0].bond)}) - a field's storage must be independent; move "
                "what imposes its variable away, or give the field in one-port elements",
                where=(node.name,),
            )
        for port in ports:
            if dependent:
                self._dependent(port)
            else:
                self._independent(port)

    def _independent(self, port: Port) -> None:
        node, gives = port.node, LAW_GIVES[port.node.kind]
        state = self.state_of(node.name, port.number)
        assert state is not None
        rate: Key = ("d", ("x", state.symbol.name))
        self.labels[rate] = (f"d_{state.symbol.name}", "", f"rate of {state.meaning}")
        key, sign = self._own(port, gives)
        taken, taken_sign = self._own(port, "flow" if gives == "effort" else "effort")
        inertia = self.constant_inertia(node)
        if inertia is not None and state.variable == "flow":
            self.definitions[key] = self.law(sign * state.symbol)
            self.definitions[rate] = self.law(symbol("effort") / inertia, {symbol("effort"): (taken, taken_sign)})
            return
        self.definitions[key] = self.law(sign * self._storage_law(port))
        self.definitions[rate] = self.law(symbol("given"), {symbol("given"): (taken, taken_sign)})

    def _storage_law(self, port: Port) -> Expr:
        """The storage's law with its states in place of its energy variables."""
        node = port.node
        own = ENERGY_VARIABLE[node.kind]
        energy = node.law("energy")
        law = node.law(port.local(LAW_GIVES[node.kind]).name) if energy is None else diff(energy, port.local(own))
        assert law is not None
        replace = {}
        for other in self.ports(node):
            state = self.state_of(node.name, other.number)
            assert state is not None
            replace[other.local(own)] = state.symbol
        return law.xreplace(replace)

    def _dependent(self, port: Port) -> None:
        """Energy variable from the imposed variable, imposed bond variable as its rate."""
        node = port.node
        gives, own = LAW_GIVES[node.kind], symbol(ENERGY_VARIABLE[node.kind])
        stored: Key = ("q", node.name, port.number)
        law, given_inverse = node.law(gives), node.law(own.name)
        assert law is not None
        power = symbol(gives)
        arguments = {power: self._own(port, gives)}
        solved = given_inverse if given_inverse is not None else inverse(law, own, power)
        if solved is not None:
            self.definitions[stored] = self.law(solved, arguments)
        else:
            law_of = self.law(law - power, arguments, unknown=own)
            self.definitions[stored] = Residual(law_of.template, own, 1, law_of.arguments)
        domain = self.bond_domain(port.bond)
        unit = "" if domain is None else getattr(domain, f"{own.name}_unit")
        letter = "q" if node.kind == "C" else "p"
        self.labels[stored] = (f"{letter}_{node.name}", unit, f"{own.name} of {node.name} (dependent)")
        key, sign = self._own(port, "flow" if gives == "effort" else "effort")
        self.definitions[key] = Sum(((sign, ("d", stored)),))

    # ------------------------------------------------------------------ expressions

    def law(
        self, expression: Expr, own: dict[Symbol, tuple[Key, int]] | None = None, unknown: Symbol | None = None
    ) -> Law:
        """An expression as a definition: its own variables, signals, states and named signals become keys."""
        arguments: list[tuple[Symbol, Key, int]] = []
        replace: dict[Symbol, Expr] = {}
        own = own or {}
        for used in sorted(expression.free_symbols, key=lambda s: str(s.name)):
            if used == unknown:
                continue
            if used in own:
                arguments.append((used, *own[used]))
            elif signal_name(used):
                value = self.signal(used)
                if isinstance(value, Expr):
                    replace[used] = value
                else:
                    arguments.append((used, *value))
            elif isinstance(self.graph.quantities.get(used.name), NamedSignal):
                arguments.append((used, ("s", used.name), 1))
        template = expression.xreplace(replace) if replace else expression
        states = self._state_symbols
        for used in sorted(template.free_symbols, key=lambda s: str(s.name)):
            if used in states and used not in own:
                arguments.append((used, ("x", used.name), 1))
        return Law(template, tuple(dict.fromkeys(arguments)))

    @functools.cached_property
    def _state_symbols(self) -> set[Symbol]:
        return {state.symbol for state in self.states} | {symbol(i.name) for i in self.graph.integrals}

    def signal(self, used: Symbol) -> tuple[Key, int] | Expr:
        """The variable a signal reads, as a key with sign, or as an expression of states."""
        read = signal_name(used)
        assert read is not None
        node = self.graph.nodes[read.node]
        number = read.port or 1
        if read.variable in ("displacement", "momentum"):
            state = self.state_of(node.name, number)
            if state is None:
                return ("q", node.name, number), 1
            inertia = self.constant_inertia(node)
            return state.symbol * inertia if state.variable == "flow" and inertia is not None else state.symbol
        if node.is_junction:
            bond = self.incidence[node.name][0][0]
            return (self.effort(bond) if read.variable == "effort" else self.flow(bond)), 1
        return self._own(self.ports(node)[number - 1], read.variable)

    def definition(self, key: Key) -> Definition | None:
        """The rule of a variable; rates are made when first asked for. States have none."""
        if key in self.definitions:
            return self.definitions[key]
        if key[0] == "x":
            return None
        if key[0] == "d":
            return self._rate(key)
        raise KeyError(key)

    def _rate(self, key: Key) -> Rate:
        of = key[1]
        if of[0] == "d":
            self._refuse_second_derivative(of[1])
        inner = self.definition(of)
        assert inner is not None and not isinstance(inner, Rate)
        explicit = [*self.input_rates.items(), (symbol("t"), symbol("t") ** 0)]
        constant = tuple(k for k in inner.depends if self._is_constant(k))
        self.definitions[key] = Rate(of, inner, tuple(explicit), constant)
        name, _, meaning = self.labels.get(of, ("rate", "", "a variable"))
        self.labels[key] = (f"d_{name}", "", f"rate of {meaning}")
        return self.definitions[key]  # type: ignore[return-value]

    def _is_constant(self, key: Key) -> bool:
        """Whether a modulus or signal depends on parameters only."""
        rule = self.definitions.get(key)
        changing = {*self.input_rates, symbol("t")}
        return isinstance(rule, Law) and not rule.arguments and not (rule.template.free_symbols & changing)

    def _refuse_second_derivative(self, of: Key) -> None:
        name = self.labels.get(of, (str(of),))[0]
        storage = of[1] if of[0] == "q" else name
        raise DerivationError(
            f"{self.graph.name}: storage {storage} is in derivative causality and its {name} depends on its own rate "
            "through a law, so its equation cannot be made explicit - give the law that imposes its variable in the "
            "other form, or put a (small) storage between them",
            where=(str(storage),),
        )

    def parameter_symbols(self) -> set[Symbol]:
        """Symbols of the declared parameters."""
        return {q.symbol for q in self.graph.quantities.values() if isinstance(q, Parameter)}


_METHOD = {
    "0": "junction", "1": "junction", "Se": "source", "Sf": "source", "R": "resistance", "C": "storage",
    "I": "storage", "TF": "two_port", "GY": "two_port",
}  # fmt: skip
