"""Declaring quantities: inputs, parameters, tables, integrals, signals and what is measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_args

from sympy import Expr, Symbol

from bondgraph.declare.declared_units import DeclaredUnit, coherent_table, declared_unit
from bondgraph.declare.domains import Domain
from bondgraph.declare.expressions import signal
from bondgraph.declare.functions import TableFunction, table_function
from bondgraph.declare.handles import At, Handle
from bondgraph.declare.laws import apply_law
from bondgraph.declare.other_names import node_hint
from bondgraph.declare.quantities import (
    Input,
    Integral,
    Interpolation,
    NamedSignal,
    Output,
    Parameter,
    Requirement,
    Table,
    symbol,
)
from bondgraph.declare.quantity_checks import check_quantity, check_table
from bondgraph.declare.requirements import check_requirement
from bondgraph.declare.starts import initial_of
from bondgraph.declare.store import GraphStore
from bondgraph.errors import DeclarationError


class QuantityBuilder(GraphStore):
    """The part of the builder that declares quantities; each method returns the symbol to use in laws.

    Numbers are given in the unit of the declaration, or as pint quantities, and are coherent SI from there on; so is
    every law. The declared unit is the one in which results are shown.
    """

    def input(
        self,
        name: str,
        unit: str,
        meaning: str = "",
        *,
        default: Any = None,
        hold: bool = False,
        between: Interpolation | None = None,
        letters: Mapping[str, float] | None = None,
    ) -> Symbol:
        """Declare a known signal from outside; ``letters`` are the codes of a text signal and their values.

        A log must hold it, or the command that reads the log must give it, unless a ``default`` is declared. Between
        samples it runs linearly, unless ``between`` is ``"hold"`` (as ``hold``) or ``"band limited"``.

        Examples
        --------
        >>> from bondgraph.declare.graph import BondGraph
        >>> g = BondGraph("shaker")
        >>> _ = g.input("force", "N", "behind a reconstruction filter", between="band limited")
        >>> g.inputs[0].interpolation
        'band limited'
        """
        way = self._between(name, between, hold or bool(letters))
        own = self._unit(unit, name, 0.0 if default is None else default)
        codes = tuple((letter, own.number(value)) for letter, value in (letters or {}).items())
        value = 0.0 if default is None else own.number(default)
        zero = default is not None and value == 0.0
        declared = Input(name, own.unit, meaning, value, way, codes, shown_unit=own.shown, zero_default=zero)
        return self._declare(declared)

    def parameter(
        self,
        name: str,
        value: Any,
        unit: str | None = None,
        meaning: str = "",
        bounds: tuple[Any, Any] | None = None,
        tolerance: float | None = None,
    ) -> Symbol:
        """Declare a constant; with ``bounds`` it may be estimated between them.

        Value and bounds are numbers in ``unit``, or pint quantities; the unit of a quantity need not be repeated.
        ``tolerance`` is the share of the value by which a constant without bounds may be off, two standard deviations:
        0.04 of a data sheet's 4 %, 0 of a constant of nature. A closed loop asks for it; without it takes ten percent.

        Examples
        --------
        >>> from bondgraph.declare.graph import BondGraph
        >>> g = BondGraph("sled")
        >>> mass = g.parameter("mass", 80.0, "lb", "sled with driver", (60.0, 120.0))
        >>> round(g.parameters[0].value, 6), g.parameters[0].unit, g.parameters[0].display_unit
        (36.28739, 'kg', 'lb')
        >>> weight = mass * g.parameter("gravity", 9.81, "m/s^2", tolerance=0.0)
        """
        own = self._unit(unit, name, value)
        limits = None
        if bounds is not None:
            lower, upper = bounds
            limits = (own.number(lower), own.number(upper))
        return self._declare(Parameter(name, own.number(value), own.unit, meaning, limits, own.shown, tolerance))

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
        """Declare a tabulated function (one row of ``values`` per ``x`` where ``y`` is given); call it in laws.

        Points and values are numbers in the units given, or pint quantities that fit them.
        """
        units = (argument_unit,) if isinstance(argument_unit, str) else tuple(argument_unit)
        while units and not units[-1]:
            units = units[:-1]
        try:
            rows = tuple(map(tuple, values)) if len(y) else tuple(values)
            given = Table(name, tuple(x), rows, tuple(y), unit, units, meaning)
            table = coherent_table(given, f"{self.name}: table {name}")
        except (TypeError, ValueError) as error:
            raise DeclarationError(
                f"{self.name}: table {name}: its points and values must be numbers, not symbols or texts ({error}) - "
                "multiply the table by a parameter where it is used",
                where=(name,),
            ) from None
        check_table(table, self.name)
        self._declare(table)
        return table_function(name, 2 if len(y) else 1)

    def integral(self, name: str, of: Any, unit: str, meaning: str = "", *, initial: Any = 0.0) -> Symbol:
        """Declare an extra state whose rate is ``of``: the angle of a shaft, a distance, a controller's memory.

        A rate that depends on the state itself is given as a function of it. The rate is in coherent SI, as all laws
        are; ``unit`` is that of ``initial`` and of what is shown. ``initial`` may be an expression of
        parameters, in coherent SI, or a signal of a log, see :mod:`bondgraph.declare.starts`.

        Examples
        --------
        >>> from bondgraph.declare.graph import BondGraph
        >>> g = BondGraph("filter")
        >>> u = g.input("u", "V")
        >>> g.integral("smoothed", lambda x: (u - x) / 2, "V")
        smoothed
        """
        own = symbol(name)
        expression = self._checked(self._given(name, of, own), (), name, also=own)
        return self._declare_integral(name, expression, unit, meaning, initial)

    def signal(self, name: str, expression: Any, unit: str, meaning: str = "") -> Symbol:
        """Name an expression of flows, efforts, displacements, momenta, inputs and parameters."""
        return self._declare_signal(name, self._checked(expression, (), name), unit, meaning)

    def implicit_signal(self, name: str, residual: Any, unit: str, meaning: str = "", *, guess: Any = 0.0) -> Symbol:
        """Name the value at which ``residual``, a function of it, vanishes; Newton's method starts at ``guess``.

        The guess is an expression of states, inputs and parameters, near enough to lead to the wanted root.

        Examples
        --------
        >>> from bondgraph.declare.graph import BondGraph
        >>> g = BondGraph("orbit")
        >>> anomaly = g.input("anomaly", "rad", "mean anomaly")
        >>> e = g.parameter("e", 0.1, "1", "eccentricity")
        >>> from sympy import sin
        >>> g.implicit_signal("E", lambda E: E - e * sin(E) - anomaly, "rad", "eccentric anomaly", guess=anomaly)
        E
        """
        own = symbol(name)
        expression = self._checked(self._given(name, residual, own), (), name, also=own)
        if own not in expression.free_symbols:
            raise DeclarationError(f"{self.name}: {name}: the residual does not contain {name} - use signal()", (name,))
        return self._declare_signal(name, expression, unit, meaning, self._checked(guess, (), f"{name}: guess"))

    def require(self, positive: Any, reason: str) -> None:
        """Declare that an expression of parameters must be positive, with the physical reason.

        It is checked here, whenever values of parameters are changed, and before causality is assigned.

        Examples
        --------
        >>> from bondgraph.declare.graph import BondGraph
        >>> g = BondGraph("belt")
        >>> C, r = g.parameter("C", 0.2, "m"), g.parameter("r", 0.3, "m")
        >>> g.require(C - r, "the pulley covers the other axis")
        Traceback (most recent call last):
        ...
        bondgraph.errors.DeclarationError: belt: the pulley covers the other axis: C - r is -0.1 with C = 0.2 m,
        r = 0.3 m - it must be positive
        """
        requirement = Requirement(self._checked(positive, (), "requirement"), reason)
        check_requirement(requirement, self.parameters, self.name)
        self._requirements.append(requirement)

    def measure(self, name: str, expression: Any, unit: str, meaning: str = "") -> None:
        """Declare a measured quantity as an expression."""
        if name in self._outputs:
            raise DeclarationError(f"{self.name}: output {name} is declared twice - use another name", (name,))
        own = self._unit(unit, name)
        output = Output(name, self._checked(expression, (), name), own.unit, meaning, own.shown)
        self._check_real(output.expression, name)
        check_quantity(output, self.name)
        self._outputs[name] = output

    def measure_flow(self, name: str, at: At, meaning: str = "", unit: str | None = None) -> None:
        """Declare that the flow of a node is measured; the unit is its domain's."""
        self._measure_variable(name, "flow", at, meaning, unit)

    def measure_effort(self, name: str, at: At, meaning: str = "", unit: str | None = None) -> None:
        """Declare that the effort of a node is measured; the unit is its domain's."""
        self._measure_variable(name, "effort", at, meaning, unit)

    def measure_displacement(self, name: str, at: At, meaning: str = "", unit: str | None = None) -> None:
        """Declare that the displacement of a compliance is measured; the unit is its domain's."""
        self._measure_variable(name, "displacement", at, meaning, unit)

    def measure_momentum(self, name: str, at: At, meaning: str = "", unit: str | None = None) -> None:
        """Declare that the momentum of an inertance is measured; the unit is its domain's."""
        self._measure_variable(name, "momentum", at, meaning, unit)

    def _between(self, name: str, between: Interpolation | None, held: bool) -> Interpolation:
        known = get_args(Interpolation)
        if between is not None and between not in known:
            raise DeclarationError(
                f"{self.name}: input {name}: between={between!r} - use {', '.join(map(repr, known))}", where=(name,)
            )
        if held and between not in (None, "hold"):
            raise DeclarationError(
                f"{self.name}: input {name} is held between samples, as codes always are, and declared {between!r} - "
                "declare one of the two",
                where=(name,),
            )
        return "hold" if held else between or "linear"

    def _domain(self, node: str) -> Domain | None:
        """The domain of a node: of a junction its own, of an element with one bond that of its junction."""
        beside = [
            one.target if one.source == node else one.source for one in self._bonds if node in (one.source, one.target)
        ]
        own = self._nodes[node].domain if node in self._nodes else None
        alone = own is None and len(beside) == 1 and beside[0] in self._nodes
        return self._nodes[beside[0]].domain if alone else own

    def _unit(self, unit: str | None, name: str, value: Any = 20.0) -> DeclaredUnit:
        return declared_unit(unit, f"{self.name}: {name}", value)

    def _declare_integral(self, name: str, of: Expr, unit: str, meaning: str, initial: Any) -> Symbol:
        own = self._unit(unit, name, initial)
        begun = initial_of(initial, f"{self.name}: {name}", own.number, self._quantities, (own.unit,))
        return self._declare(Integral(name, of, own.unit, meaning, begun.value, own.shown, begun.start))

    def _declare_signal(
        self, name: str, expression: Expr, unit: str, meaning: str, guess: Expr | None = None
    ) -> Symbol:
        own = self._unit(unit, name)
        return self._declare(NamedSignal(name, expression, own.unit, meaning, guess, own.shown))

    def _given(self, name: str, value: Any, own: Symbol) -> Expr:
        """An expression, or what a function makes of the quantity's own symbol."""
        return apply_law(value, own, where=f"{self.name}: {name}")

    def _measure_variable(
        self, name: str, variable: str, at: At, meaning: str, unit: str | None, port: int = 0
    ) -> None:
        node = at.name if isinstance(at, Handle) else at
        port = at.number if isinstance(at, Handle) else port
        if not self.has_node(node):
            raise DeclarationError(
                f"{self.name}: output {name}: no node {node!r}{node_hint(node, self._nodes)}", (name,)
            )
        domain = self._domain(node)
        own_unit = "" if domain is None else getattr(domain, f"{variable}_unit")
        self.measure(name, signal(variable, node, port), own_unit if unit is None else unit, meaning)
