"""The builder: a bond graph declared step by step, in the order in which an engineer draws it.

Everything after the graph is immutable; only :class:`BondGraph` grows. A mistake is found at the declaring line, except
what can only be known at the end (a junction without bonds, a signal of a node declared later), which
:meth:`BondGraph.validate` finds before causality is assigned.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy
from sympy import Expr, Symbol

from bondgraph.declare.composition import flatten
from bondgraph.declare.domains import Domain
from bondgraph.declare.elements import LAW_GIVES, Bond, Node, allowed_laws, check_node, foreign_locals
from bondgraph.declare.expressions import is_local, normalise, signal, signal_name
from bondgraph.declare.functions import TableFunction, table_function
from bondgraph.declare.quantities import Input, Integral, NamedSignal, Output, Parameter, Table, symbol
from bondgraph.declare.validation import check_quantity, check_table, validate
from bondgraph.errors import DeclarationError, suggest

Law = Callable[..., Any] | Expr | float


@dataclass(frozen=True)
class Handle:
    """A declared node: pass it as ``at=``, read its variables as signals in other laws."""

    name: str
    kind: str
    domain: Domain | None

    @property
    def effort(self) -> Symbol:
        """The effort as a signal (of a 0-junction, or of an element's bond)."""
        return signal("effort", self.name)

    @property
    def flow(self) -> Symbol:
        """The flow as a signal (of a 1-junction, or of an element's bond)."""
        return signal("flow", self.name)

    @property
    def displacement(self) -> Symbol:
        """The displacement of a compliance as a signal."""
        return signal("displacement", self.name)

    @property
    def momentum(self) -> Symbol:
        """The momentum of an inertance as a signal."""
        return signal("momentum", self.name)


@dataclass(frozen=True)
class SubGraph:
    """A graph used as a part of another; ``ports`` names the inner junctions that outer bonds may reach.

    ``bind`` gives inner inputs and parameters as expressions of the outer graph.
    """

    name: str
    graph: BondGraph
    ports: tuple[tuple[str, str], ...]
    bind: tuple[tuple[str, Expr], ...] = ()


At = Handle | str


class BondGraph:
    """A bond graph under construction.

    Parameters
    ----------
    name
        Name of the model; the generated module is called so.
    doc
        What the graph describes; its first line heads the generated module.
    source
        Where it is declared, for the header of the generated module.

    Raises
    ------
    DeclarationError
        By every method, at the line that declares something impossible.

    Examples
    --------
    >>> from bondgraph.declare.domains import ROTATION
    >>> g = BondGraph("rotor", doc="a rotor with a bearing")
    >>> torque = g.input("torque", "N m", "driving torque")
    >>> J = g.parameter("J", 0.02, "kg m^2", "rotor inertia", (0.01, 0.05))
    >>> b = g.parameter("b", 0.1, "N m s", "bearing friction")
    >>> shaft = g.one_junction("shaft", ROTATION)
    >>> _ = g.effort_source("drive", torque, at=shaft)
    >>> _ = g.inertance("rotor", J, at=shaft)
    >>> _ = g.resistance("bearing", lambda omega: b * omega, at=shaft)
    >>> _ = g.measure_flow("omega", shaft, "shaft speed")
    >>> [str(bond) for bond in g.bonds]
    ['drive -> shaft', 'shaft -> rotor', 'shaft -> bearing']
    """

    def __init__(self, name: str, doc: str | None = "", source: str = "") -> None:
        self.name = name
        self.doc = (doc or "").strip()
        self.source = source
        self._nodes: dict[str, Node] = {}
        self._bonds: list[Bond] = []
        self._quantities: dict[str, Input | Parameter | Table | Integral | NamedSignal] = {}
        self._outputs: dict[str, Output] = {}
        self._subgraphs: dict[str, SubGraph] = {}

    # ------------------------------------------------------------------ what has been declared

    @property
    def nodes(self) -> Mapping[str, Node]:
        """Junctions and elements by name, in order of declaration."""
        return self._nodes

    @property
    def bonds(self) -> tuple[Bond, ...]:
        """Bonds in order of declaration."""
        return tuple(self._bonds)

    @property
    def quantities(self) -> Mapping[str, Input | Parameter | Table | Integral | NamedSignal]:
        """Inputs, parameters, tables, integrals and named signals by name, in order of declaration."""
        return self._quantities

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Declared inputs."""
        return tuple(q for q in self._quantities.values() if isinstance(q, Input))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Declared parameters."""
        return tuple(q for q in self._quantities.values() if isinstance(q, Parameter))

    @property
    def tables(self) -> tuple[Table, ...]:
        """Declared tables."""
        return tuple(q for q in self._quantities.values() if isinstance(q, Table))

    @property
    def integrals(self) -> tuple[Integral, ...]:
        """Extra states that integrate an expression."""
        return tuple(q for q in self._quantities.values() if isinstance(q, Integral))

    @property
    def signals(self) -> tuple[NamedSignal, ...]:
        """Named expressions."""
        return tuple(q for q in self._quantities.values() if isinstance(q, NamedSignal))

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Measured quantities in order of declaration."""
        return tuple(self._outputs.values())

    @property
    def subgraphs(self) -> tuple[SubGraph, ...]:
        """Parts that are graphs themselves."""
        return tuple(self._subgraphs.values())

    def incidence(self) -> dict[str, list[tuple[int, bool]]]:
        """The bonds of every node: index of the bond, and whether it points to the node."""
        bonds: dict[str, list[tuple[int, bool]]] = {name: [] for name in self._nodes}
        for index, bond in enumerate(self._bonds):
            for end, inward in ((bond.source, False), (bond.target, True)):
                if end in bonds:
                    bonds[end].append((index, inward))
        return bonds

    def __eq__(self, other: object) -> bool:
        """Whether both declare the same graph (where it was declared does not matter)."""
        return isinstance(other, BondGraph) and self._value() == other._value()

    __hash__ = None  # type: ignore[assignment]  # it grows

    def __repr__(self) -> str:
        return f"BondGraph({self.name!r}: {len(self._nodes)} nodes, {len(self._bonds)} bonds)"

    def _value(self) -> tuple[Any, ...]:
        return (
            self.name, self.doc, tuple(self._nodes.values()), self.bonds, tuple(self._quantities.values()),
            self.outputs, self.subgraphs,
        )  # fmt: skip

    # ------------------------------------------------------------------ quantities

    def input(
        self,
        name: str,
        unit: str,
        meaning: str = "",
        *,
        default: float = 0.0,
        hold: bool = False,
        letters: Mapping[str, float] | None = None,
    ) -> Symbol:
        """Declare a known signal from outside; ``letters`` are the codes of a text signal and their values."""
        codes = tuple((letter, float(value)) for letter, value in (letters or {}).items())
        interpolation = "hold" if hold or codes else "linear"
        return self._declare(Input(name, unit, meaning, float(default), interpolation, codes))  # type: ignore[arg-type]

    def parameter(
        self, name: str, value: float, unit: str, meaning: str = "", bounds: tuple[float, float] | None = None
    ) -> Symbol:
        """Declare a constant; with ``bounds`` it may be estimated between them."""
        limits = (float(bounds[0]), float(bounds[1])) if bounds is not None else None
        return self._declare(Parameter(name, float(value), unit, meaning, limits))

    def table(
        self,
        name: str,
        x: Sequence[float],
        values: Sequence[Any],
        unit: str = "",
        argument_unit: str | tuple[str, ...] = "",
        *,
        y: Sequence[float] = (),
        meaning: str = "",
    ) -> type[TableFunction]:
        """Declare a tabulated function (one row of ``values`` per ``x`` where ``y`` is given); call it in laws."""
        units = (argument_unit,) if isinstance(argument_unit, str) else tuple(argument_unit)
        rows = tuple(tuple(map(float, row)) for row in values) if len(y) else tuple(map(float, values))
        table = Table(name, tuple(map(float, x)), rows, tuple(map(float, y)), unit, units, meaning)
        check_table(table, self.name)
        self._declare(table)
        return table_function(name, 2 if len(y) else 1)

    def integral(self, name: str, of: Any, unit: str, meaning: str = "", *, initial: float = 0.0) -> Symbol:
        """Declare an extra state whose rate is ``of``: the angle of a shaft, a distance, a random walk's mean."""
        expression = self._checked(of, (), name)
        return self._declare(Integral(name, expression, unit, meaning, float(initial)))

    def signal(self, name: str, expression: Any, unit: str, meaning: str = "") -> Symbol:
        """Name an expression of flows, efforts, displacements, momenta, inputs and parameters."""
        return self._declare(NamedSignal(name, self._checked(expression, (), name), unit, meaning))

    def _declare(self, quantity: Input | Parameter | Table | Integral | NamedSignal) -> Symbol:
        check_quantity(quantity, self.name)
        if quantity.name in self._quantities:
            raise DeclarationError(
                f"{self.name}: {quantity.name} is declared twice - use another name", where=(quantity.name,)
            )
        self._quantities[quantity.name] = quantity
        return symbol(quantity.name)

    # ------------------------------------------------------------------ junctions and elements

    def zero_junction(self, name: str, domain: Domain | None = None) -> Handle:
        """A common-effort junction."""
        return self.add_node(Node(name, "0", domain))

    def one_junction(self, name: str, domain: Domain | None = None) -> Handle:
        """A common-flow junction."""
        return self.add_node(Node(name, "1", domain))

    def effort_source(self, name: str, effort: Any, at: At | None = None) -> Handle:
        """A source that imposes an effort, constant, from an input, or modulated by signals."""
        return self._one_port(Node(name, "Se", laws=(("effort", normalise(effort)),)), at, from_element=True)

    def flow_source(self, name: str, flow: Any, at: At | None = None) -> Handle:
        """A source that imposes a flow, constant, from an input, or modulated by signals."""
        return self._one_port(Node(name, "Sf", laws=(("flow", normalise(flow)),)), at, from_element=True)

    def resistance(
        self,
        name: str,
        effort: Law | None = None,
        *,
        flow: Law | None = None,
        residual: Callable[..., Any] | Expr | None = None,
        at: At | None = None,
    ) -> Handle:
        """A dissipator: ``effort`` as a function of the flow, ``flow`` of the effort, both, or ``residual(effort, flow)``.

        A number or expression that is not a function is the coefficient of a linear law.
        """
        own_effort, own_flow = symbol("effort"), symbol("flow")
        laws: list[tuple[str, Expr]] = []
        if effort is not None and not callable_law(effort):
            laws = [("effort", normalise(effort) * own_flow), ("flow", own_effort / normalise(effort))]
        elif effort is not None:
            laws.append(("effort", apply_law(effort, own_flow)))
        if flow is not None and callable_law(flow):
            laws.append(("flow", apply_law(flow, own_effort)))
        elif flow is not None:
            laws = [("effort", own_flow / normalise(flow)), ("flow", normalise(flow) * own_effort)]
        if residual is not None:
            laws.append(("residual", apply_law(residual, own_effort, own_flow)))
        return self._one_port(Node(name, "R", laws=tuple(laws)), at)

    def compliance(
        self,
        name: str,
        effort: Law,
        *,
        displacement: Law | None = None,
        at: At | None = None,
        initial: float = 0.0,
        state: str = "",
    ) -> Handle:
        """A spring or capacitor: ``effort`` as a function of the displacement, or the stiffness of a linear one.

        ``displacement`` as a function of the effort lets a nonlinear compliance be a dependent storage in closed form.
        """
        return self._storage("C", name, effort, displacement, at, initial, state)

    def inertance(
        self,
        name: str,
        inertia: Law,
        *,
        flow: Law | None = None,
        momentum: Law | None = None,
        at: At | None = None,
        initial: float = 0.0,
        state: str = "",
    ) -> Handle:
        """A mass, inertia or inductance: its value, or for a nonlinear one ``inertia`` as the function flow(momentum)."""
        own = symbol("momentum")
        law = inertia if callable_law(inertia) else own / normalise(inertia)
        return self._storage("I", name, flow if flow is not None else law, momentum, at, initial, state)

    def _storage(
        self, kind: str, name: str, law: Law, inverse: Law | None, at: At | None, initial: float, state: str
    ) -> Handle:
        gives, stored = LAW_GIVES[kind], {"C": "displacement", "I": "momentum"}[kind]
        own, power = symbol(stored), symbol(gives)
        expression = apply_law(law, own) if callable_law(law) else normalise(law)
        if kind == "C" and not callable_law(law):
            expression = expression * own
        laws = [(gives, expression)]
        if inverse is not None:
            laws.append((stored, apply_law(inverse, power)))
        return self._one_port(Node(name, kind, laws=tuple(laws), initial=(float(initial),), state=state), at)

    def transformer(self, name: str, modulus: Any, source: At, target: At) -> Handle:
        """A TF of modulus m between two nodes: effort_in = m effort_out, flow_out = m flow_in."""
        return self._two_port("TF", name, modulus, source, target)

    def gyrator(self, name: str, modulus: Any, source: At, target: At) -> Handle:
        """A GY of modulus r between two nodes: effort_in = r flow_out, effort_out = r flow_in."""
        return self._two_port("GY", name, modulus, source, target)

    modulated_transformer = transformer
    modulated_gyrator = gyrator

    def _two_port(self, kind: str, name: str, modulus: Any, source: At, target: At) -> Handle:
        handle = self.add_node(Node(name, kind, laws=(("modulus", normalise(modulus)),)))
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
        initial: Sequence[float] = (),
    ) -> Handle:
        """A multiport C, I or R, its port k bonded to the k-th junction of ``at``.

        Laws are functions of all ports' own variables (displacements, momenta, flows or, with ``form="flow"``, efforts;
        ``form="residual"``: all efforts, then all flows), or ``energy`` is such a function whose gradient gives them.
        """
        ports = len(at) or len(laws or ())
        stems = {"C": ("displacement",), "I": ("momentum",)}.get(kind)
        stems = stems or {"effort": ("flow",), "flow": ("effort",)}.get(form, ("effort", "flow"))
        own = [symbol(f"{stem}{port}") for stem in stems for port in range(1, ports + 1)]
        gives = LAW_GIVES.get(kind, form)
        if energy is not None:
            pairs: tuple[tuple[str, Expr], ...] = (("energy", apply_law(energy, *own)),)
        else:
            pairs = tuple((f"{gives}{i + 1}", apply_law(law, *own)) for i, law in enumerate(laws or ()))
        handle = self.add_node(Node(name, kind, laws=pairs, ports=ports, initial=tuple(map(float, initial))))
        for junction in at:
            self.bond(junction, handle)
        return handle

    def _one_port(self, node: Node, at: At | None, from_element: bool = False) -> Handle:
        handle = self.add_node(node)
        if at is not None:
            ends = (handle, at) if from_element else (at, handle)
            self.bond(*ends)
        return handle

    def add_node(self, node: Node) -> Handle:
        """Add a node given as a value (what the methods above end in)."""
        check_node(node, self.name)
        if node.name in self._nodes or node.name in self._subgraphs:
            raise DeclarationError(f"{self.name}: node {node.name} is declared twice - use another name", (node.name,))
        if not all(math.isfinite(value) for value in node.initial):
            raise DeclarationError(f"{self.name}: {node.name}: initial {node.initial} must be finite", (node.name,))
        allowed = allowed_laws(node.kind, node.ports)
        for given, law in node.laws:
            self._checked(law, allowed[given], node.name)
        self._nodes[node.name] = node
        return Handle(node.name, node.kind, node.domain)

    # ------------------------------------------------------------------ bonds, parts, outputs

    def bond(self, source: At, target: At) -> Bond:
        """Bond two nodes; positive power flows from ``source`` to ``target``."""
        ends = [end.name if isinstance(end, Handle) else end for end in (source, target)]
        for end in ends:
            if end not in self._nodes and not self._is_port(end):
                known = [*self._nodes, *(f"{part.name}.{port}" for part in self.subgraphs for port, _ in part.ports)]
                raise DeclarationError(
                    f"{self.name}: bond {ends[0]} -> {ends[1]}: node {end!r} is not declared{suggest(end, known)}",
                    where=(f"bond {ends[0]} -> {ends[1]}",),
                )
        if ends[0] == ends[1]:
            raise DeclarationError(
                f"{self.name}: bond {ends[0]} -> {ends[1]} joins a node with itself - bond two different nodes",
                where=(f"bond {ends[0]} -> {ends[1]}",),
            )
        bond = Bond(ends[0], ends[1])
        self._bonds.append(bond)
        return bond

    def _is_port(self, end: str) -> bool:
        part, _, port = end.partition(".")
        if part not in self._subgraphs:
            return False
        subgraph = self._subgraphs[part]
        return port in dict(subgraph.ports) or subgraph.graph.has_node(port)

    def has_node(self, name: str) -> bool:
        """Whether a node of that (possibly dotted) name exists here or in a part."""
        return name in self._nodes or self._is_port(name)

    def include(
        self,
        name: str,
        graph: BondGraph,
        ports: Mapping[str, str] | None = None,
        bind: Mapping[str, Any] | None = None,
    ) -> SubGraph:
        """Use a graph as a part; outer bonds reach it as ``"name.port"``.

        ``bind`` replaces inputs and parameters of the part by expressions of this graph.
        """
        if name in self._nodes or name in self._subgraphs:
            raise DeclarationError(f"{self.name}: {name} is declared twice - use another name", (name,))
        for port, inner in (ports or {}).items():
            if not graph.has_node(inner):
                raise DeclarationError(
                    f"{self.name}: port {name}.{port}: {graph.name} has no node {inner!r}{suggest(inner, graph.nodes)}",
                    where=(f"{name}.{port}",),
                )
        bound = {key: self._checked(value, (), f"{name}.{key}") for key, value in (bind or {}).items()}
        replaceable = [q.name for q in (*graph.inputs, *graph.parameters)]
        for key in bound:
            if key not in replaceable:
                raise DeclarationError(
                    f"{self.name}: {name}: {graph.name} has no input or parameter {key!r}{suggest(key, replaceable)}",
                    where=(f"{name}.{key}",),
                )
        part = SubGraph(name, graph, tuple((ports or {}).items()), tuple(bound.items()))
        self._subgraphs[name] = part
        return part

    def exchange(self, name: str, graph: BondGraph) -> None:
        """Replace the part ``name`` by another graph with the same ports."""
        if name not in self._subgraphs:
            raise DeclarationError(f"{self.name}: no part {name!r}{suggest(name, self._subgraphs)}", where=(name,))
        old = self._subgraphs.pop(name)
        try:
            new = [key for key, _ in old.bind if key in graph.quantities]
            self.include(name, graph, dict(old.ports), {key: dict(old.bind)[key] for key in new})
        except DeclarationError:
            self._subgraphs[name] = old
            raise
        self._subgraphs = {key: self._subgraphs[key] for key in sorted(self._subgraphs, key=lambda k: k == name)}

    def measure(self, name: str, expression: Any, unit: str, meaning: str = "") -> None:
        """Declare a measured quantity as an expression."""
        if name in self._outputs:
            raise DeclarationError(f"{self.name}: output {name} is declared twice - use another name", (name,))
        output = Output(name, self._checked(expression, (), name), unit, meaning)
        check_quantity(output, self.name)
        self._outputs[name] = output

    def measure_flow(self, name: str, at: At, meaning: str = "", unit: str | None = None) -> None:
        """Declare that the flow of a node is measured; the unit is its domain's."""
        self._measure_variable(name, "flow", at, meaning, unit)

    def measure_effort(self, name: str, at: At, meaning: str = "", unit: str | None = None) -> None:
        """Declare that the effort of a node is measured; the unit is its domain's."""
        self._measure_variable(name, "effort", at, meaning, unit)

    def _measure_variable(self, name: str, variable: str, at: At, meaning: str, unit: str | None) -> None:
        node = at.name if isinstance(at, Handle) else at
        if not self.has_node(node):
            raise DeclarationError(f"{self.name}: output {name}: no node {node!r}{suggest(node, self._nodes)}", (name,))
        domain = self._nodes[node].domain if node in self._nodes else None
        own_unit = "" if domain is None else getattr(domain, f"{variable}_unit")
        self.measure(name, signal(variable, node), own_unit if unit is None else unit, meaning)

    # ------------------------------------------------------------------ checks

    def _checked(self, expression: Any, own: tuple[str, ...], where: str) -> Expr:
        """The normalised expression, if it uses only declared names, signals and the element's own variables."""
        result = normalise(expression)
        symbols = sorted(result.free_symbols, key=lambda s: str(s.name))
        foreign = foreign_locals([s for s in symbols if is_local(s)], own)
        if foreign:
            allowed = ", ".join(own) or "none of its own variables"
            raise DeclarationError(
                f"{self.name}: {where}: the law uses {foreign[0]!r} but may use {allowed}", where=(where,)
            )
        for used in symbols:
            if is_local(used) or signal_name(used) or used.name == "t" or used.name in self._quantities:
                continue
            if self._is_inner_quantity(used.name):
                continue
            raise DeclarationError(
                f"{self.name}: {where}: {used.name!r} is not declared{suggest(used.name, self._quantities)} - "
                "declare it as a parameter, input or signal first",
                where=(where,),
            )
        for function in result.atoms(TableFunction):
            if function.table_name not in self._quantities:
                raise DeclarationError(
                    f"{self.name}: {where}: table {function.table_name!r} is not declared in this graph", where=(where,)
                )
        return result

    def _is_inner_quantity(self, name: str) -> bool:
        part, _, inner = name.partition(".")
        if part not in self._subgraphs:
            return False
        graph = self._subgraphs[part].graph
        return inner in graph.quantities or graph._is_inner_quantity(inner)

    def validate(self) -> None:
        """Raise DeclarationError for what can only be known when the graph is complete.

        Bonds per element, junctions without bonds, mixed domains, signals of nodes that do not exist.
        """
        validate(self.flatten())

    def flatten(self) -> BondGraph:
        """The same machine without parts: inner names get the part's name and a dot in front."""
        return flatten(self)


def callable_law(law: Any) -> bool:
    """Whether a law is given as a function (and not as the coefficient of a linear one)."""
    return callable(law) and not isinstance(law, sympy.Basic)


def apply_law(law: Any, *own: Symbol) -> Expr:
    """A law as an expression of the element's own variables."""
    return normalise(law(*own) if callable_law(law) else law)

