"""Bond variables of a causal graph: which are equal, what they are called, and the rule that gives each."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from sympy import Expr, Symbol

from bondgraph.declare.domains import UNDECLARED_PREFIXES, Domain
from bondgraph.declare.elements import MULTIPORTS, SOURCES, STORAGES, Node
from bondgraph.declare.expressions import signal_name, symbols_in
from bondgraph.declare.functions import smooth_step, switch
from bondgraph.declare.quantities import Input, Integral, NamedSignal, ParameterStart, Start, symbol
from bondgraph.declare.starts import check_initial_unit, check_start, signals_of
from bondgraph.declare.validation import node_domains
from bondgraph.derive.causality import CausalGraph
from bondgraph.derive.definitions import Constrained, Definition, Key, Law, Rate, Residual
from bondgraph.derive.delays import LateInputs
from bondgraph.derive.equations import State, StateVariable
from bondgraph.derive.laws import linear_coefficient
from bondgraph.derive.modes import ModeNotes
from bondgraph.errors import DerivationError


@dataclass(frozen=True)
class Port:
    """One port of an element: its bond, and +1 where the bond's flow counts as it does for the element."""

    node: Node
    number: int
    bond: int
    sign: int

    def local(self, variable: str) -> Symbol:
        """The element's own symbol of a variable at this port."""
        return symbol(f"{variable}{self.suffix}")

    @property
    def suffix(self) -> str:
        """The number of the port where the element's own variables are numbered."""
        return str(self.number) if self.node.is_field else ""


class BondVariables:
    """Keys, names, units and definitions of every variable of a causal graph (built once, then only read).

    Made by :func:`bondgraph.derive.rules.bond_variables`, which adds the rules of the nodes to those of the quantities.
    """

    def __init__(self, causal: CausalGraph, smooth: bool = True, free: bool = False) -> None:
        self.causal = causal
        self.smooth = smooth
        self.modes = ModeNotes(free)
        self.graph = causal.graph
        self.incidence = causal.graph.incidence()
        self.domains = node_domains(causal.graph)
        self.parameters = {p.symbol for p in self.graph.parameters}
        self.definitions: dict[Key, Definition] = {}
        self.labels: dict[Key, tuple[str, str, str]] = {}
        self.states: list[State] = []
        self._inertias: dict[str, Expr | None] = {}
        self._by_port: dict[tuple[str, int], State] = {}
        self._names: dict[str, None] = dict.fromkeys(self.graph.quantities)
        self._derivative = set(causal.derivative)
        self._roots = self._merged()
        self.late = LateInputs.of(self.graph, self.unused)
        self.input_rates = self._rates_of_inputs()
        self._label_junctions_and_storages()
        self._declare_states()
        self._state_symbols = {state.symbol for state in self.states}
        for quantity in self.graph.quantities.values():
            self.modes.owner = quantity.name
            self._quantity(quantity)
        self.modes.owner = ""

    # ------------------------------------------------------------------ equal variables

    def _merged(self) -> dict[Key, Key]:
        """Efforts are one variable at a 0-junction, flows at a 1-junction: the key that stands for each."""
        parent: dict[Key, Key] = {}

        def find(key: Key) -> Key:
            while (above := parent.get(key, key)) != key:
                parent[key] = parent.get(above, above)
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
        return {(letter, bond): find((letter, bond)) for letter in "ef" for bond in count}

    def effort(self, bond: int) -> Key:
        """Key of a bond's effort."""
        return self._roots["e", bond]

    def flow(self, bond: int) -> Key:
        """Key of a bond's flow."""
        return self._roots["f", bond]

    def ports(self, node: Node) -> list[Port]:
        """Ports of an element in order of its bonds; a source's flow counts along its bond, any other's inward."""
        pairs = enumerate(self.incidence[node.name], start=1)
        return [
            Port(node, number, bond, 1 if inward or node.kind in SOURCES else -1) for number, (bond, inward) in pairs
        ]

    @functools.cached_property
    def positions(self) -> dict[str, int]:
        """Position of every node in the order of declaration."""
        return {name: position for position, name in enumerate(self.graph.nodes)}

    @functools.cached_property
    def state_elements(self) -> dict[str, str]:
        """The storage that each state belongs to, by the state's name."""
        return {state.symbol.name: state.element for state in self.states if state.element}

    def elements_of(self, key: Key) -> tuple[str, ...]:
        """Elements with a law for which a variable is one of their own."""
        if key[0] == "q":
            return (key[1],)
        return tuple(self._elements_by_key.get(key, ()))

    @functools.cached_property
    def _elements_by_key(self) -> dict[Key, dict[str, None]]:
        found: dict[Key, dict[str, None]] = {}
        for node in self.graph.nodes.values():
            for bond, _ in self.incidence[node.name] if node.kind in MULTIPORTS else ():
                for key in (self.effort(bond), self.flow(bond)):
                    found.setdefault(key, {})[node.name] = None
        return found

    def own(self, port: Port, variable: str) -> tuple[Key, int]:
        """Key of an element's own effort or flow and the sign with which the bond's variable enters it."""
        return (self.effort(port.bond), 1) if variable == "effort" else (self.flow(port.bond), port.sign)

    # ------------------------------------------------------------------ names and units

    def _label_junctions_and_storages(self) -> None:
        nodes = self.graph.nodes.values()
        for node in nodes:
            if node.is_junction:
                self._label_junction(node)
        for node in nodes:
            for port in self.ports(node) if node.kind in STORAGES else ():
                self.label_port(port)

    def _label_junction(self, node: Node) -> None:
        bond = self.incidence[node.name][0][0]
        key = self.effort(bond) if node.kind == "0" else self.flow(bond)
        variable = "effort" if node.kind == "0" else "flow"
        self.label(key, variable, node.name, self.domains[node.name], f"{variable} of {node.name}")

    def label_port(self, port: Port) -> None:
        """Name effort and flow of a port after its element, where they have no name yet."""
        domain, name = self.bond_domain(port.bond), f"{port.node.name}{port.suffix}"
        for key, variable in ((self.effort(port.bond), "effort"), (self.flow(port.bond), "flow")):
            self.label(key, variable, name, domain, f"{variable} of {name}")

    def label(self, key: Key, variable: str, name: str, domain: Domain | None, meaning: str) -> None:
        """Give an effort or flow a name, unit and meaning, where it has none yet."""
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
        ends = self.causal.bonds[bond]
        return self.domains[ends.source] or self.domains[ends.target]

    def unused(self, name: str) -> str:
        """A name that nothing else has, with underscores behind it if need be; taken from now on."""
        while name in self._names:
            name += "_"
        self._names[name] = None
        return name

    @property
    def inputs(self) -> tuple[Input, ...]:
        """The declared inputs and those that follow them later."""
        return (*self.graph.inputs, *self.late.inputs)

    def _rates_of_inputs(self) -> dict[Symbol, Symbol]:
        """The rate of every input that changes between samples, by the input."""
        declared = {one.rate_of: one.symbol for one in self.graph.inputs if one.rate_of}
        changing = (one for one in self.inputs if not one.is_held and not one.rate_of)
        return {
            one.symbol: declared[one.name] if one.name in declared else symbol(self.unused(f"d_{one.name}"))
            for one in changing
        }

    # ------------------------------------------------------------------ states

    def _declare_states(self) -> None:
        for node in self.graph.nodes.values():
            for port in self.ports(node) if node.kind in STORAGES else ():
                if (node.name, port.number) not in self._derivative:
                    state = self._state(port)
                    self.states.append(state)
                    self._by_port[node.name, port.number] = state
        for quantity in self.graph.integrals:
            meaning = quantity.meaning or "integral"
            rate = symbol(quantity.name)
            begun, unit = quantity.start, quantity.unit
            self._check_start(begun, quantity.name, unit)
            self.states.append(State(rate, unit, quantity.initial, meaning, "", "integral", quantity.shown_unit, begun))

    def _state(self, port: Port) -> State:
        node, domain = port.node, self.bond_domain(port.bond)
        variable: StateVariable = "displacement" if node.kind == "C" else "momentum"
        if self.constant_inertia(node) is not None:
            variable = "flow"
        unit = "" if domain is None else getattr(domain, f"{variable}_unit")
        prefix = {"displacement": "q", "momentum": "p"}.get(variable)
        if prefix is None:
            prefix = UNDECLARED_PREFIXES[1] if domain is None else domain.flow_prefix
        wanted = node.state_name(port.number) or f"{prefix}_{node.name}{port.suffix}"
        initial = node.initial[port.number - 1] if len(node.initial) >= port.number else 0.0
        where = f" (port {port.number})" if node.ports > 1 else ""
        begun = node.start(port.number)
        self._check_start(begun, node.name, unit)
        for given in node.initial_units[port.number - 1 : port.number]:
            check_initial_unit(given, variable, unit, f"{self.graph.name}: {node.name}")
        return State(
            symbol(self.unused(wanted)), unit, initial, f"{variable} of {node.name}{where}", node.name, variable,
            start=begun,
        )  # fmt: skip

    def _check_start(self, start: Start | ParameterStart | None, name: str, unit: str) -> None:
        """A state starts at a signal of its own unit, which only its causality and law decide."""
        if isinstance(start, Start):
            check_start(start, signals_of(self.graph)[start.signal], f"{self.graph.name}: {name}", (unit,))

    def constant_inertia(self, node: Node) -> Expr | None:
        """The inertia of a one-port inertance whose law is ``momentum/inertia`` with a constant inertia, else None."""
        if node.name not in self._inertias:
            self._inertias[node.name] = self._constant_inertia(node)
        return self._inertias[node.name]

    def _constant_inertia(self, node: Node) -> Expr | None:
        law = node.law("flow")
        if node.kind != "I" or node.ports > 1 or law is None:
            return None
        reciprocal = linear_coefficient(law, symbol("momentum"))
        if reciprocal is None or not reciprocal.free_symbols <= self.parameters:
            return None
        return 1 / reciprocal

    def state_of(self, node: str, port: int = 1) -> State | None:
        """The state of a storage's port, None where it is dependent."""
        return self._by_port.get((node, port))

    def energy_variable(self, node: Node, port: int) -> tuple[Key, int] | Expr:
        """A storage's energy variable: a key where it is dependent, else an expression of its state."""
        state = self.state_of(node.name, port)
        if state is None:
            return ("q", node.name, port), 1
        return state.symbol * (self.constant_inertia(node) or 1) if state.variable == "flow" else state.symbol

    # ------------------------------------------------------------------ quantities and expressions

    def _quantity(self, quantity: object) -> None:
        if isinstance(quantity, Integral):
            rate: Key = ("d", ("x", quantity.name))
            self.definitions[rate] = self.law(quantity.of)
            self.labels[rate] = (f"d_{quantity.name}", "", f"rate of {quantity.name}")
        elif isinstance(quantity, NamedSignal):
            self.definitions["s", quantity.name] = self._named_signal(quantity)
            self.labels["s", quantity.name] = (quantity.name, quantity.unit, quantity.meaning or "signal")

    def _named_signal(self, quantity: NamedSignal) -> Law | Residual:
        own = symbol(quantity.name)
        if quantity.guess is None:
            return self.law(quantity.expression)
        inside = {symbol(s.name): s.expression for s in self.graph.signals if s.guess is None}
        guess = quantity.guess
        while not inside.keys().isdisjoint(guess.free_symbols):
            guess = guess.xreplace(inside)
        start = self.law(guess)
        if any(key[0] != "x" for key in start.depends):
            raise DerivationError(
                f"{self.graph.name}: {quantity.name}: the guess must follow from states, inputs and parameters alone - "
                "leave out efforts, flows and implicit signals",
                where=(quantity.name,),
            )
        law = self.law(quantity.expression, unknown=own)
        return Residual(law.template, own, 1, law.arguments, start.template)

    def law(
        self, expression: Expr, own: dict[Symbol, tuple[Key, int]] | None = None, unknown: Symbol | None = None
    ) -> Law:
        """An expression as a definition: its own variables, signals, states and named signals become keys."""
        own = own or {}
        expression = self._with_switches(self.late.law(expression), own)
        arguments: list[tuple[Symbol, Key, int]] = []
        replace: dict[Symbol, Expr] = {}
        for used in symbols_in(expression):
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
        for used in symbols_in(template):
            if used in self._state_symbols and used not in own:
                arguments.append((used, ("x", used.name), 1))
        return Law(template, tuple(dict.fromkeys(arguments)))

    def _with_switches(self, expression: Expr, own: dict[Symbol, tuple[Key, int]]) -> Expr:
        """Switches as smooth steps, or as jumps whose sides are held."""
        if not expression.has(switch):
            return expression
        return (
            expression.replace(switch, smooth_step)
            if self.smooth
            else self.modes.hold(expression, lambda value: self.law(value, own), self.unused)
        )

    def signal(self, used: Symbol) -> tuple[Key, int] | Expr:
        """The variable a signal reads, as a key with sign, or as an expression of states."""
        read = signal_name(used)
        assert read is not None
        node = self.graph.nodes[read.node]
        if read.variable in ("displacement", "momentum"):
            return self.energy_variable(node, read.port or 1)
        if node.is_junction:
            bond = self.incidence[node.name][0][0]
            return (self.effort(bond) if read.variable == "effort" else self.flow(bond)), 1
        return self.own(self.ports(node)[(read.port or 1) - 1], read.variable)

    # ------------------------------------------------------------------ rules

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
        if isinstance(inner, Constrained):
            raise inner.rate_refusal()
        explicit = [*self.input_rates.items(), (symbol("t"), symbol("t") ** 0)]
        constant = tuple(k for k in inner.depends if self._is_constant(k))
        rate = Rate(of, inner, tuple(explicit), constant)
        self.definitions[key] = rate
        name, _, meaning = self.labels.get(of, ("rate", "", "a variable"))
        self.labels[key] = (f"d_{name}", "", f"rate of {meaning}")
        return rate

    @functools.cached_property
    def _changing(self) -> set[Symbol]:
        """Symbols with a rate of their own. A held input has none: it does not change while it is held."""
        return {*self.input_rates, symbol("t")}

    def _is_constant(self, key: Key) -> bool:
        """Whether a modulus or signal depends on parameters only."""
        rule = self.definitions.get(key)
        return isinstance(rule, Law) and not rule.arguments and not (rule.template.free_symbols & self._changing)

    def _refuse_second_derivative(self, of: Key) -> None:
        name, _, meaning = self.labels.get(of, (str(of), "", ""))
        what = meaning or name
        storage = str(of[1]) if of[0] == "q" else name
        bonds = [bond for bond, _ in self.incidence.get(storage, [])]
        why = "; ".join(self.causal.explain(bond) for bond in bonds)
        laws = [reason.node for reason in self.causal.reasons if reason.kind == "law"]
        law = f"a law that has one form only ({', '.join(dict.fromkeys(laws))})" if laws else "the laws on its way"
        raise DerivationError(
            f"{self.graph.name}: {storage} is in derivative causality ({why}) and its {what} depends on its own rate "
            f"through {law}, so its equation cannot be made explicit - give such a law in the other form or as a "
            "residual, or put a (small) storage between",
            where=(storage,),
        )
