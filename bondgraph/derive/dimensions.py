"""Dimensions: every derived equation must be homogeneous; a wrong unit is found with the element's name.

What has no unit (a graph file may leave units out) is not checked; where an unnamed intermediate has none, the
dimension of its expression is taken.
"""

from __future__ import annotations

from sympy import Expr, Symbol, preorder_traversal

from bondgraph.declare.dimensions import SECOND, DimensionReader, Known, MismatchError, of_unit, subtract
from bondgraph.declare.expressions import to_text
from bondgraph.declare.quantities import Input, Parameter, ParameterStart
from bondgraph.derive.equations import Assignment, ImplicitLoop, StateEquations
from bondgraph.errors import DimensionError
from bondgraph.units import dimension_text


def check_dimensions(equations: StateEquations) -> None:
    """Raise DimensionError unless every equation with known units is homogeneous.

    Each law is checked by itself when the graph is complete; here the laws meet, also where no domain is declared. A
    graph in which nothing has a unit is not checked.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> from bondgraph.derive.derivation import derive
    >>> g = BondGraph("car")
    >>> F, u, m = g.input("F", "N"), g.input("u", "V"), g.parameter("m", 900.0, "kg")
    >>> body = g.one_junction("body")
    >>> _ = g.inertance("mass", m, at=body)
    >>> _ = g.effort_source("push", F, at=body)
    >>> _ = g.effort_source("pull", u, at=body)
    >>> check_dimensions(derive(assign_causality(g)))
    Traceback (most recent call last):
    ...
    bondgraph.errors.DimensionError: car: d(f_mass)/dt: F + u adds F, which is kg m s^-2, and u, which is
    kg m^2 s^-3 A^-1 - correct the law or its units
    """
    declared: list[Input | Parameter] = [*equations.inputs, *equations.parameters]
    if any(quantity.unit for quantity in declared):
        _Checker(equations, declared).run()


class _Checker:
    def __init__(self, equations: StateEquations, declared: list[Input | Parameter]) -> None:
        self.equations = equations
        self.known: dict[Symbol, Known] = {Symbol("t", real=True): SECOND}
        self.known |= {quantity.symbol: of_unit(quantity.unit) for quantity in declared}
        self.known |= {state.symbol: of_unit(state.unit) for state in equations.states}
        tables = {table.name: table for table in equations.tables}
        self.reader = DimensionReader(self.known, {q.symbol for q in declared if q.unit}, tables)

    def run(self) -> None:
        """Check all equations, again as long as they tell the dimension of a state that has no unit."""
        while self._pass():
            self.reader = DimensionReader(self.known, self.reader.declared, self.reader.tables)
        for output in self.equations.outputs:
            self._require(output.symbol.name, of_unit(output.unit), output.expression)
        for state in self.equations.states:
            if isinstance(state.start, ParameterStart) and not _has_bare_number(state.start.expression):
                self._require(f"initial of {state.symbol.name}", self.known[state.symbol], state.start.expression)

    def _pass(self) -> bool:
        """Check assignments and rates; whether a state's dimension was found that was not known."""
        for step in self.equations.assignments:
            if isinstance(step, ImplicitLoop):
                self._loop(step)
            else:
                self._assignment(step)
        learned = False
        for state, value in zip(self.equations.states, self.equations.derivatives, strict=True):
            own = self.known[state.symbol]
            found = self._require(f"d({state.symbol.name})/dt", None if own is None else subtract(own, SECOND), value)
            if own is None and found is not None and not value.is_zero:
                self.known[state.symbol] = tuple(a + b for a, b in zip(found, SECOND, strict=True))
                learned = True
        return learned

    def _assignment(self, step: Assignment) -> None:
        found = self._require(step.symbol.name, of_unit(step.unit), step.expression)
        self.known[step.symbol] = of_unit(step.unit) or found

    def _loop(self, step: ImplicitLoop) -> None:
        for unknown, unit in zip(step.unknowns, step.units, strict=True):
            self.known[unknown] = of_unit(unit)
        for local in step.body:
            self._assignment(local)
        for residual in step.residuals:
            self._require(step.name, None, residual)

    def _require(self, name: str, needed: Known, value: Expr) -> Known:
        try:
            found = self.reader.of(value)
        except MismatchError as mismatch:
            raise DimensionError(
                f"{self.equations.name}: {name}: {mismatch} - correct the law or its units", where=(name,)
            ) from None
        if needed is not None and found is not None and found != needed and not value.is_zero:
            raise DimensionError(
                f"{self.equations.name}: {name} must be {dimension_text(needed)} but {to_text(value)} is "
                f"{dimension_text(found)} - correct the law or its units",
                where=(name,),
            )
        return found if found is not None else needed


def _has_bare_number(expression: Expr) -> bool:
    """True where a number is added or is a factor: 293.15*C is a heat, with kelvins that nobody wrote.

    Examples
    --------
    >>> C, T0 = Symbol("C"), Symbol("T0")
    >>> _has_bare_number(293.15 * C), _has_bare_number(-C * T0**2)
    (True, False)
    """
    sums = [part for part in preorder_traversal(expression) if part.is_Add or part.is_Mul]
    return any(one.is_Number and abs(one) != 1 for part in sums for one in part.args)
