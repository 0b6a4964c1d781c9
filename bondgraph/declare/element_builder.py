"""Declaring junctions and elements, each in one line, with its law as a function of its own variables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from sympy import Expr, Symbol

from bondgraph.declare.declared_units import initial_value, storage_units
from bondgraph.declare.domains import Domain
from bondgraph.declare.elements import ENERGY_VARIABLE, LAW_GIVES, Node, numbered
from bondgraph.declare.handles import At, ElementType, Handle, Law
from bondgraph.declare.laws import apply_law, as_expression, callable_law
from bondgraph.declare.quantities import symbol
from bondgraph.declare.starts import Initial, initial_of, starts_of
from bondgraph.declare.store import GraphStore
from bondgraph.errors import DeclarationError


class ElementBuilder(GraphStore):
    """The part of the builder that declares nodes; each method returns the handle of the new node."""

    def zero_junction(self, name: str, domain: Domain | None = None) -> Handle:
        """A common-effort junction."""
        return self.add_node(Node(name, "0", domain))

    def one_junction(self, name: str, domain: Domain | None = None) -> Handle:
        """A common-flow junction."""
        return self.add_node(Node(name, "1", domain))

    def effort_source(self, name: str, effort: Any, at: At | None = None) -> Handle:
        """A source that imposes an effort, constant, from an input, or modulated by signals."""
        return self._one_port(
            Node(name, "Se", laws=(("effort", self._expression(name, effort)),)), at, from_element=True
        )

    def flow_source(self, name: str, flow: Any, at: At | None = None) -> Handle:
        """A source that imposes a flow, constant, from an input, or modulated by signals."""
        return self._one_port(Node(name, "Sf", laws=(("flow", self._expression(name, flow)),)), at, from_element=True)

    def resistance(
        self,
        name: str,
        effort: Law | None = None,
        *,
        flow: Law | None = None,
        residual: Callable[..., Any] | Expr | None = None,
        at: At | None = None,
        guess: float = 0.0,
    ) -> Handle:
        """A dissipator: ``effort`` as a function of the flow, ``flow`` of the effort, both, or a residual of both.

        A number or expression that is not a function is the coefficient of a linear law. ``guess`` is where the search
        for the root of a residual starts.
        """
        own_effort, own_flow = symbol("effort"), symbol("flow")
        laws: list[tuple[str, Expr]] = []
        if effort is not None and not callable_law(effort):
            coefficient = self._expression(name, effort)
            laws = [("effort", coefficient * own_flow), ("flow", own_effort / coefficient)]
        elif effort is not None:
            laws.append(("effort", self._law(name, effort, own_flow)))
        if flow is not None and callable_law(flow):
            laws.append(("flow", self._law(name, flow, own_effort)))
        elif flow is not None:
            conductance = self._expression(name, flow)
            laws = [("effort", own_flow / conductance), ("flow", conductance * own_effort)]
        if residual is not None:
            laws.append(("residual", self._law(name, residual, own_effort, own_flow)))
        return self._one_port(Node(name, "R", laws=tuple(laws), initial=(float(guess),) if guess else ()), at)

    def compliance(
        self,
        name: str,
        effort: Law | None = None,
        *,
        displacement: Law | None = None,
        residual: Callable[..., Any] | Expr | None = None,
        at: At | None = None,
        initial: Any = 0.0,
        state: str = "",
    ) -> Handle:
        """A spring or capacitor: ``effort`` as a function of the displacement, or the stiffness of a linear one.

        ``displacement`` as a function of the effort lets a nonlinear compliance be a dependent storage in closed form;
        it may also be given alone, or both may be bound by ``residual(effort, displacement)``. That of a linear one is
        its capacity, ``displacement=C``. ``initial`` may be an expression of parameters, ``C * T0``, or a signal of a
        log, see :mod:`bondgraph.declare.starts`.
        """
        return self._storage("C", name, effort, displacement, residual, at, initial, state)

    def inertance(
        self,
        name: str,
        inertia: Law | None = None,
        *,
        flow: Law | None = None,
        momentum: Law | None = None,
        residual: Callable[..., Any] | Expr | None = None,
        at: At | None = None,
        initial: Any = 0.0,
        state: str = "",
    ) -> Handle:
        """A mass, inertia or inductance: its value, or for a nonlinear one the function flow(momentum).

        ``momentum`` as a function of the flow may be given beside it or alone, or both may be bound by
        ``residual(flow, momentum)``. The state of a linear one is its flow, of any other its momentum. ``initial`` is
        that of the state, and may be an expression of parameters, or a signal of a log: ``initial=omega_input``,
        ``initial="omega"``.
        """
        law = flow if flow is not None else inertia
        if law is not None and not callable_law(law) and flow is None:
            law = symbol("momentum") / self._expression(name, law)
        return self._storage("I", name, law, momentum, residual, at, initial, state)

    def _storage(
        self,
        kind: str,
        name: str,
        law: Law | None,
        inverse: Law | None,
        residual: Law | None,
        at: At | None,
        initial: Any,
        state: str,
    ) -> Handle:
        gives, stored = LAW_GIVES[kind], ENERGY_VARIABLE[kind]
        own, power = symbol(stored), symbol(gives)
        laws: list[tuple[str, Expr]] = []
        if law is not None:
            is_stiffness = kind == "C" and not callable_law(law)
            laws.append((gives, self._expression(name, law) * own if is_stiffness else self._law(name, law, own)))
        if inverse is not None:
            held = self._law(name, inverse, power)
            if not callable_law(inverse) and not {own, power} & held.free_symbols:  # a capacity, a mass
                laws, held = laws or [(gives, own / held)], held * power
            laws.append((stored, held))
        if residual is not None:
            laws.append(("residual", self._law(name, residual, power, own)))
        domain = at.domain if isinstance(at, Handle) else None
        begun = self._initial(name, initial, storage_units(kind, domain))
        node = Node(
            name, kind, laws=tuple(laws), initial=(begun.value,), state=state, starts=starts_of([begun]),
            initial_units=(begun.unit,),
        )  # fmt: skip
        return self._one_port(node, at)

    def _initial(self, name: str, value: Any, units: Sequence[str] = ()) -> Initial:
        """The start of a state that somebody gave to an element."""
        where = f"{self.name}: {name}"
        return initial_of(value, where, lambda one: initial_value(one, where, units), self._quantities, units)

    def transformer(self, name: str, modulus: Any, source: At, target: At) -> Handle:
        """A TF of modulus m between two nodes: effort_in = m effort_out, flow_out = m flow_in."""
        return self._two_port("TF", name, modulus, source, target)

    def gyrator(self, name: str, modulus: Any, source: At, target: At) -> Handle:
        """A GY of modulus r between two nodes: effort_in = r flow_out, effort_out = r flow_in."""
        return self._two_port("GY", name, modulus, source, target)

    modulated_transformer = transformer
    modulated_gyrator = gyrator

    def _two_port(self, kind: str, name: str, modulus: Any, source: At, target: At) -> Handle:
        handle = self.add_node(Node(name, kind, laws=(("modulus", self._expression(name, modulus)),)))
        self.bond(source, handle)
        self.bond(handle, target)
        return handle

    def field(
        self,
        kind: str,
        name: str,
        laws: Sequence[Any] | None = None,
        *,
        energy: Any | None = None,
        form: str = "effort",
        at: Sequence[At] = (),
        initial: Sequence[Any] = (),
        state: str | Sequence[str] = "",
    ) -> Handle:
        """A multiport C, I or R, its port k bonded to the k-th junction of ``at``.

        Laws are functions of all ports' own variables (displacements, momenta, flows or, with ``form="flow"``, efforts;
        ``form="residual"``: all efforts, then all flows), or ``energy`` is such a function whose gradient gives them.
        ``state`` names the states, one name per port, or all by one stem and the number of the port.
        """
        ports = len(at) or len(laws or ())
        own_stems = {"effort": ("flow",), "flow": ("effort",)}.get(form, ("effort", "flow"))
        stems = (ENERGY_VARIABLE[kind],) if kind in ENERGY_VARIABLE else own_stems
        own = [symbol(name) for stem in stems for name in (numbered(stem, ports) if ports > 1 else (stem,))]
        gives = LAW_GIVES.get(kind, form)
        if energy is not None:
            pairs: tuple[tuple[str, Expr], ...] = (("energy", self._law(name, energy, *own)),)
        else:
            names = numbered(gives, len(laws or ())) if ports > 1 else (gives,)
            pairs = tuple((given, self._law(name, law, *own)) for given, law in zip(names, laws or (), strict=True))
        stem = state if isinstance(state, str) else " ".join(state)
        begun = [self._initial(name, one) for one in initial]
        values = tuple(one.value for one in begun)
        units = tuple(one.unit for one in begun)
        node = Node(name, kind, None, pairs, ports, values, stem, starts=starts_of(begun), initial_units=units)
        return self._multiport(node, at)

    def element(self, name: str, kind: ElementType, at: Sequence[At] = ()) -> Handle:
        """An element of one's own kind, its port k bonded to the k-th junction of ``at``."""
        return self._multiport(Node(name, "X", laws=kind.laws(f"{self.name}: {name}"), ports=kind.ports), at)

    def _expression(self, name: str, value: Any) -> Expr:
        """The expression that somebody gave to an element."""
        return as_expression(value, f"{self.name}: {name}")

    def _law(self, name: str, law: Any, *own: Symbol) -> Expr:
        """The law of an element as an expression of its own variables."""
        return apply_law(law, *own, where=f"{self.name}: {name}")

    def _multiport(self, node: Node, at: Sequence[At]) -> Handle:
        handle = self.add_node(node)
        for junction in at:
            self.bond(junction, handle)
        return handle

    def _one_port(self, node: Node, at: At | None, from_element: bool = False) -> Handle:
        handle = self.add_node(node)
        if at is not None:
            try:
                self.bond(*((handle, at) if from_element else (at, handle)))
            except DeclarationError:  # a cell of a notebook is mended and run again
                del self._nodes[node.name]
                raise
        return handle
