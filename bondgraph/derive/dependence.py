"""Dependent storages explained: which independent ones determine them, and with which gain."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from sympy import Expr

from bondgraph.declare.elements import LAW_GIVES
from bondgraph.declare.expressions import to_text
from bondgraph.declare.functions import number
from bondgraph.declare.quantities import symbol
from bondgraph.derive.derivation import Derivation
from bondgraph.derive.equations import Assignment, OutputEquation, StateEquations
from bondgraph.derive.jacobian import jacobian
from bondgraph.derive.linear import quotient

#: Gains that are longer than this are written in the names of intermediate results.
_LONG = 60


@dataclass(frozen=True)
class Gain:
    """How much a dependent variable changes with one state or input; ``element`` is the storage of the state."""

    variable: str
    element: str
    value: Expr


@dataclass(frozen=True)
class Dependence:
    """A storage in derivative causality: the variable that is imposed on it, and what imposes it."""

    storage: str
    port: int
    variable: str
    gains: tuple[Gain, ...]

    @property
    def text(self) -> str:
        """The dependence in one line."""
        if not self.gains:
            return f"{self.storage} is dependent: nothing changes {self.variable}"
        parts = []
        for gain in self.gains:
            of = f"{gain.variable} of {gain.element}" if gain.element else f"input {gain.variable}"
            parts.append(f"{of} with gain {to_text(gain.value)}")
        return f"{self.storage} is dependent: {self.variable} follows {' and '.join(parts)}"


def dependences(derivation: Derivation) -> tuple[Dependence, ...]:
    """For every dependent port the independent storages and inputs that its variable follows, with the gains.

    The gain is the derivative of the imposed flow (of an I) or effort (of a C) with respect to a state or an input;
    where the dependence is nonlinear it holds at a point.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> g = BondGraph("geared")
    >>> n, J1, J2 = g.parameter("n", 3.0, "1"), g.parameter("J1", 1.0, "kg m^2"), g.parameter("J2", 2.0, "kg m^2")
    >>> a, b = g.one_junction("a"), g.one_junction("b")
    >>> _ = g.inertance("J_1", J1, at=a)
    >>> _ = g.transformer("gear", n, a, b)
    >>> _ = g.inertance("J_2", J2, at=b)
    >>> dependences(Derivation(assign_causality(g)))[0].text
    'J_2 is dependent: flow(J_2) follows f_J_1 of J_1 with gain n'
    """
    causal, read = derivation.causal, derivation.variables
    equations = derivation.equations()
    ports = [read.ports(causal.graph.nodes[name])[number - 1] for name, number in causal.derivative]
    keys = [read.own(port, LAW_GIVES[port.node.kind]) for port in ports]
    derivation.compute([key for key, _ in keys])
    outputs = tuple(
        OutputEquation(symbol(f"imposed_{index}"), sign * derivation.values[key], "", "")
        for index, (key, sign) in enumerate(keys)
    )
    equations = dataclasses.replace(equations, assignments=tuple(derivation.assignments), outputs=outputs)
    rows = _rows(equations)
    found = []
    for index, port in enumerate(ports):
        variable = f"{LAW_GIVES[port.node.kind]}{port.suffix}({port.node.name})"
        found.append(Dependence(port.node.name, port.number, variable, tuple(rows.get(index, []))))
    return tuple(found)


def _rows(equations: StateEquations) -> dict[int, list[Gain]]:
    """Gains of every output with respect to states and inputs."""
    found = jacobian(equations, by=("x", "u"), of=("outputs",))
    known: dict[Expr, Expr] = {}
    for step in (*equations.assignments, *found.assignments):
        if isinstance(step, Assignment):
            value = step.expression.xreplace(known)
            if value.count_ops() <= _LONG:
                known[step.symbol] = value
    elements = {state.symbol: state.element for state in equations.states}
    rows: dict[int, list[Gain]] = {}
    for block in found.blocks:
        for entry in block.entries:
            column = block.columns[entry.column]
            value = quotient(entry.value.xreplace(known), number(1))
            rows.setdefault(entry.row, []).append(Gain(str(column), elements.get(column, ""), value))
    return rows
