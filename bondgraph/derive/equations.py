"""The value that passes from derivation to generation: ordered assignments and state derivatives.

Named bond variables are the common subexpressions: an assignment uses states, inputs, parameters, ``t`` and symbols
assigned before it, nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sympy import Expr, Symbol

from bondgraph.coherent import Displayed
from bondgraph.declare.quantities import Input, Parameter, ParameterStart, Start, Table
from bondgraph.shown import Typeset
from bondgraph.text import count

StateVariable = Literal["flow", "momentum", "displacement", "effort", "integral"]
ModeKind = Literal["switch", "friction", "impact"]


@dataclass(frozen=True)
class Assignment:
    """``symbol = expression``; the unit is empty where it is not known (then it is not checked)."""

    symbol: Symbol
    expression: Expr
    unit: str
    meaning: str


@dataclass(frozen=True)
class ImplicitLoop:
    """A nonlinear algebraic loop without closed form: ``residuals(unknowns) = 0``, solved by Newton's method.

    ``body`` holds assignments that depend on the unknowns and that the residuals use, in order. ``guesses`` are
    expressions in symbols known before the loop.
    """

    name: str
    unknowns: tuple[Symbol, ...]
    guesses: tuple[Expr, ...]
    residuals: tuple[Expr, ...]
    units: tuple[str, ...]
    body: tuple[Assignment, ...]
    meaning: str


@dataclass(frozen=True)
class State(Displayed):
    """One state: the symbol it has in the equations, its unit, start value and the storage it belongs to.

    ``start`` is the signal of a log at which it starts, or the expression of parameters, if it has one.
    """

    symbol: Symbol
    unit: str
    initial: float
    meaning: str
    element: str
    variable: StateVariable
    shown_unit: str = ""
    start: Start | ParameterStart | None = None


@dataclass(frozen=True)
class OutputEquation(Displayed):
    """A measured quantity as an expression of states, inputs, parameters and assigned symbols."""

    symbol: Symbol
    expression: Expr
    unit: str
    meaning: str
    shown_unit: str = ""


@dataclass(frozen=True)
class ZeroFunction:
    """An expression at whose zero a mode ends."""

    expression: Expr
    unit: str
    meaning: str


@dataclass(frozen=True)
class Reset:
    """The values of all states after an impact or lock; ``assignments`` are computed before, for this alone."""

    assignments: tuple[Assignment | ImplicitLoop, ...]
    states: tuple[Expr, ...]


@dataclass(frozen=True)
class Mode:
    """A discrete value that holds between events; ``symbol`` is the held input by which the equations take it.

    ``functions`` are, of a switch, its argument; of a friction, its flow and what it can carry beyond its effort in
    either direction; of an impact, its gap, what it pushes and the speed at which it opens.
    """

    symbol: Symbol
    kind: ModeKind
    element: str
    functions: tuple[ZeroFunction, ...]
    reset: Reset | None = None


@dataclass(frozen=True, repr=False)
class StateEquations(Typeset):
    """Explicit state equations of one graph, ready to be printed.

    ``derivatives[i]`` is the time derivative of ``states[i]``; ``assignments`` are in order of computation. At the
    zeros of ``events`` a law jumps or bends and a mode may end (only where the laws are not derived smooth).
    """

    name: str
    doc: str
    source: str
    states: tuple[State, ...]
    inputs: tuple[Input, ...]
    parameters: tuple[Parameter, ...]
    tables: tuple[Table, ...]
    assignments: tuple[Assignment | ImplicitLoop, ...]
    derivatives: tuple[Expr, ...]
    outputs: tuple[OutputEquation, ...]
    events: tuple[Expr, ...] = ()
    modes: tuple[Mode, ...] = ()

    def __repr__(self) -> str:
        sizes = f"{count(len(self.states), 'state')}, {count(len(self.inputs), 'input')}"
        loops = sum(isinstance(step, ImplicitLoop) for step in self.assignments)
        return f"<StateEquations {self.name}: {sizes}, {count(loops, 'implicit loop')}>"
