"""Declaring quantities: inputs, parameters, tables, integrals, signals and what is measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sympy import Symbol

from bondgraph.declare.expressions import signal
from bondgraph.declare.functions import TableFunction, table_function
from bondgraph.declare.handles import At, Handle, callable_law
from bondgraph.declare.quantities import Input, Integral, NamedSignal, Output, Parameter, Requirement, Table, symbol
from bondgraph.declare.quantity_checks import check_quantity, check_table
from bondgraph.declare.requirements import check_requirement
from bondgraph.declare.store import GraphStore
from bondgraph.errors import DeclarationError, suggest


class QuantityBuilder(GraphStore):
    """The part of the builder that declares quantities; each method returns the symbol to use in laws."""

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
        return self._declare(Input(name, unit, meaning, float(default), "hold" if hold or codes else "linear", codes))

    def parameter(
        self, name: str, value: float, unit: str, meaning: str = "", bounds: tuple[float, float] | None = None
    ) -> Symbol:
        """Declare a constant; with ``bounds`` it may be estimated between them."""
        limits = None
        if bounds is not None:
            lower, upper = bounds
            limits = (float(lower), float(upper))
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
        while units and not units[-1]:
            units = units[:-1]
        rows = tuple(tuple(map(float, row)) for row in values) if len(y) else tuple(map(float, values))
        table = Table(name, tuple(map(float, x)), rows, tuple(map(float, y)), unit, units, meaning)
        check_table(table, self.name)
        self._declare(table)
        return table_function(name, 2 if len(y) else 1)

    def integral(self, name: str, of: Any, unit: str, meaning: str = "", *, initial: float = 0.0) -> Symbol:
        """Declare an extra state whose rate is ``of``: the angle of a shaft, a distance, a controller's memory.

        A rate that depends on the state itself is given as a function of it.

        Examples
        --------
        >>> from bondgraph.declare.graph import BondGraph
        >>> g = BondGraph("filter")
        >>> u = g.input("u", "V")
        >>> g.integral("smoothed", lambda x: (u - x) / 2, "V")
        smoothed
        """
        own = symbol(name)
        expression = self._checked(of(own) if callable_law(of) else of, (), name, also=own)
        return self._declare(Integral(name, expression, unit, meaning, float(initial)))

    def signal(self, name: str, expression: Any, unit: str, meaning: str = "") -> Symbol:
        """Name an expression of flows, efforts, displacements, momenta, inputs and parameters."""
        return self._declare(NamedSignal(name, self._checked(expression, (), name), unit, meaning))

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
        expression = self._checked(residual(own) if callable_law(residual) else residual, (), name, also=own)
        if own not in expression.free_symbols:
            raise DeclarationError(f"{self.name}: {name}: the residual does not contain {name} - use signal()", (name,))
        return self._declare(NamedSignal(name, expression, unit, meaning, self._checked(guess, (), f"{name}: guess")))

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
        output = Output(name, self._checked(expression, (), name), unit, meaning)
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

    def _measure_variable(
        self, name: str, variable: str, at: At, meaning: str, unit: str | None, port: int = 0
    ) -> None:
        node = at.name if isinstance(at, Handle) else at
        port = at.number if isinstance(at, Handle) else port
        if not self.has_node(node):
            raise DeclarationError(f"{self.name}: output {name}: no node {node!r}{suggest(node, self._nodes)}", (name,))
        domain = self._nodes[node].domain if node in self._nodes else None
        own_unit = "" if domain is None else getattr(domain, f"{variable}_unit")
        self.measure(name, signal(variable, node, port), own_unit if unit is None else unit, meaning)
