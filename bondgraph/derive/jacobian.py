"""Jacobians of state equations by forward differentiation through their assignments.

Every assigned symbol s carries its non-zero derivatives with respect to the chosen variables. An assignment
``s = g(a, b)`` adds

    d_s__w = slope_s__a * d_a__w + slope_s__b * d_b__w          for each variable w on which a or b depends,

so that no expression is written out in full and nothing that is zero is written at all. Effort grows with the number of
non-zero derivatives. An algebraic loop ``r(z, a) = 0`` follows from the implicit function theorem,

    dr/dz * d_z__w = -dr/da * d_a__w,

a small linear system solved symbolically. Griewank and Walther (2008), Evaluating Derivatives, chapters 3 and 15.

At a kink (``Abs``, ``minimum``, ``maximum``, ``Piecewise``) the slope is that of one side; a step has slope zero.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import sympy
from sympy import Add, Expr, Mul, Piecewise, Pow, Symbol

from bondgraph.declare.expressions import normalise
from bondgraph.declare.functions import maximum, minimum
from bondgraph.declare.quantities import symbol
from bondgraph.derive.definitions import ONE, ZERO
from bondgraph.derive.equations import Assignment, ImplicitLoop, StateEquations
from bondgraph.derive.linear import is_zero, solve_linear
from bondgraph.derive.size import is_small
from bondgraph.errors import DerivationError, suggest

RowKind = Literal["derivatives", "outputs"]
ColumnKind = Literal["x", "u", "theta", "t"]
Row = dict[Symbol, Expr]

_STEPS = (sympy.sign, sympy.floor, sympy.ceiling)
_CHEAP = (*_STEPS, sympy.Abs, minimum, maximum)
#: Loops of up to this many unknowns are solved by minors, which need no pivot and so never divide by one that vanishes.
_BY_MINORS = 3


@dataclass(frozen=True)
class JacobianEntry:
    """One non-zero derivative: of row ``row`` with respect to column ``column``."""

    row: int
    column: int
    value: Expr


@dataclass(frozen=True)
class JacobianBlock:
    """Derivatives of all rows of one kind with respect to all variables of one kind; what is not listed is zero.

    ``rows`` are the symbols of the states whose rates are differentiated, or of the outputs.
    """

    of: RowKind
    by: ColumnKind
    rows: tuple[Symbol, ...]
    columns: tuple[Symbol, ...]
    entries: tuple[JacobianEntry, ...]

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return len(self.rows), len(self.columns)


@dataclass(frozen=True)
class Jacobian:
    """Derivatives of state equations as named partial derivatives and sparse blocks of expressions in them.

    ``assignments`` are to be computed in order after those of ``equations``; they use states, inputs, parameters,
    ``t``, symbols assigned there (those in the bodies of loops too, at the solution), and each other.
    """

    equations: StateEquations
    assignments: tuple[Assignment, ...]
    blocks: tuple[JacobianBlock, ...]

    def block(self, of: RowKind, by: ColumnKind) -> JacobianBlock:
        """The block of one kind of rows by one kind of variables.

        Raises
        ------
        DerivationError
            If it was not asked for.
        """
        for block in self.blocks:
            if block.of == of and block.by == by:
                return block
        known = ", ".join(f"{block.of} by {block.by}" for block in self.blocks)
        raise DerivationError(
            f"{self.equations.name}: the Jacobian of {of} by {by} was not computed, only {known or 'none'}",
            where=(self.equations.name,),
        )


def jacobian(
    equations: StateEquations,
    by: Sequence[ColumnKind] = ("x", "u", "theta"),
    of: Sequence[RowKind] = ("derivatives", "outputs"),
    parameters: Sequence[str] | None = None,
) -> Jacobian:
    """Derivatives of the state derivatives and outputs.

    Parameters
    ----------
    equations
        As derived.
    by
        Variables: states ``x``, inputs ``u``, parameters ``theta``, time ``t``.
    of
        Rows: the state derivatives, the outputs, or both.
    parameters
        Names of the parameters that make the columns of ``theta``, in that order; all where omitted.

    Raises
    ------
    DerivationError
        If a parameter does not exist, or an algebraic loop is singular whatever its parameters.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> from bondgraph.derive.derivation import derive
    >>> g = BondGraph("car")
    >>> F, m, c = g.input("F", "N"), g.parameter("m", 900.0, "kg"), g.parameter("c", 0.4, "kg/m")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("engine", F, at=body)
    >>> _ = g.inertance("mass", m, at=body, state="v")
    >>> _ = g.resistance("aero", lambda v: c * v**2, at=body)
    >>> found = jacobian(derive(assign_causality(g)), by=("x", "u"))
    >>> [(assignment.symbol, assignment.expression) for assignment in found.assignments]
    [(d_e_aero__v, 2*c*v)]
    >>> [entry.value for block in found.blocks for entry in block.entries]
    [-d_e_aero__v/m, 1/m]
    """
    columns: dict[ColumnKind, tuple[Symbol, ...]] = {kind: _columns(equations, kind, parameters) for kind in by}
    sweep = _Sweep(equations, [used for kind in by for used in columns[kind]])
    for step in equations.assignments:
        if isinstance(step, ImplicitLoop):
            _LoopSweep(sweep, step).run()
        else:
            sweep.assign(step)
    blocks: list[JacobianBlock] = []
    for kind in of:
        names, rows = _rows(equations, kind, sweep)
        for variables in by:
            index = {used: column for column, used in enumerate(columns[variables])}
            entries = tuple(
                JacobianEntry(i, index[used], value)
                for i, row in enumerate(rows)
                for used, value in row.items()
                if used in index
            )
            blocks.append(JacobianBlock(kind, variables, names, columns[variables], entries))
    values = [entry.value for block in blocks for entry in block.entries]
    return Jacobian(equations, _needed(sweep.assignments, values), tuple(blocks))


def _columns(equations: StateEquations, kind: ColumnKind, parameters: Sequence[str] | None) -> tuple[Symbol, ...]:
    if kind == "x":
        return tuple(state.symbol for state in equations.states)
    if kind == "u":
        return tuple(signal.symbol for signal in equations.inputs)
    if kind == "t":
        return (symbol("t"),)
    known = {parameter.name: parameter.symbol for parameter in equations.parameters}
    for name in parameters or ():
        if name not in known:
            raise DerivationError(f"{equations.name}: no parameter {name!r}{suggest(name, known)}", where=(name,))
    return tuple(known[name] for name in (known if parameters is None else parameters))


def _rows(equations: StateEquations, kind: RowKind, sweep: _Sweep) -> tuple[tuple[Symbol, ...], list[Row]]:
    if kind == "outputs":
        names = tuple(output.symbol for output in equations.outputs)
        return names, [sweep.row(o.expression, f"output_{o.symbol}", o.unit) for o in equations.outputs]
    names = tuple(state.symbol for state in equations.states)
    rates = zip(equations.states, equations.derivatives, strict=True)
    return names, [sweep.row(rate, f"rate_{state.symbol}", _ratio(state.unit, "s")) for state, rate in rates]


def _needed(assignments: Sequence[Assignment], values: Iterable[Expr]) -> tuple[Assignment, ...]:
    """The assignments on which values depend."""
    wanted = {used for value in values for used in value.free_symbols}
    kept = []
    for assignment in reversed(assignments):
        if assignment.symbol in wanted:
            kept.append(assignment)
            wanted |= assignment.expression.free_symbols
    return tuple(reversed(kept))


# ---------------------------------------------------------------------- one expression


def gradient(expression: Expr, active: Container[Symbol]) -> Row:
    """Derivatives of an expression of real quantities with respect to the active symbols in it.

    Parameters
    ----------
    expression
        In the vocabulary of laws.
    active
        Symbols that vary; the others are constant. What is zero whatever the values is left out.

    Examples
    --------
    >>> v, k = symbol("v"), symbol("k")
    >>> gradient(k * v * sympy.Abs(v), {v})
    {v: k*v*sign(v) + k*Abs(v)}
    """
    memo: dict[Expr, Row] = {}

    def walk(node: Expr) -> Row:
        if node not in memo:
            memo[node] = rule(node)
        return memo[node]

    def rule(node: Expr) -> Row:
        if isinstance(node, Symbol):
            return {node: ONE} if node in active else {}
        if not node.args or isinstance(node, _STEPS):
            return {}
        if isinstance(node, sympy.Min | sympy.Max):
            return walk(normalise(node))
        if isinstance(node, Piecewise):
            return _piecewise(node, [walk(value) for value, _ in node.args])
        inner = [walk(argument) for argument in node.args]
        if not any(inner):
            return {}
        if isinstance(node, Add):
            return _combined((ONE, row) for row in inner)
        if isinstance(node, Mul):
            factors = node.args
            return _combined((Mul(*factors[:i], *factors[i + 1 :]), row) for i, row in enumerate(inner) if row)
        if isinstance(node, Pow):
            return _combined(_power(node, *inner))
        return _combined((node.fdiff(i), row) for i, row in enumerate(inner, start=1) if row)

    return walk(expression)


def _combined(parts: Iterable[tuple[Expr, Row]]) -> Row:
    """The sum of rows, each times a factor."""
    terms: dict[Symbol, list[Expr]] = {}
    for factor, row in parts:
        for used, value in row.items():
            terms.setdefault(used, []).append(value if factor is ONE else factor * value)
    sums = {used: values[0] if len(values) == 1 else Add(*values) for used, values in terms.items()}
    return {used: value for used, value in sums.items() if value != 0}


def _power(node: Expr, base: Row, exponent: Row) -> list[tuple[Expr, Row]]:
    parts = []
    if base:
        parts.append((node.exp * node.base ** (node.exp - 1), base))
    if exponent:
        parts.append((node * sympy.log(node.base), exponent))
    return parts


def _piecewise(node: Expr, rows: Sequence[Row]) -> Row:
    used = dict.fromkeys(found for row in rows for found in row)
    conditions = [condition for _, condition in node.args]
    chosen = {
        found: Piecewise(*((row.get(found, ZERO), condition) for row, condition in zip(rows, conditions, strict=True)))
        for found in used
    }
    return {found: value for found, value in chosen.items() if value != 0}


# ---------------------------------------------------------------------- all assignments


class _Sweep:
    """Derivatives of every symbol computed so far, and the assignments that hold them."""

    def __init__(self, equations: StateEquations, columns: Sequence[Symbol]) -> None:
        self.name = equations.name
        self.rank = {column: i for i, column in enumerate(columns)}
        self.tangents: dict[Symbol, Row] = {column: {column: ONE} for column in columns}
        self.assignments: list[Assignment] = []
        self.units = _units(equations)
        self.taken = {*self.units, *(output.symbol.name for output in equations.outputs)}

    def row(self, value: Expr, owner: str, unit: str = "") -> Row:
        """Derivatives of an expression, columns in order."""
        parts = []
        for used, slope in self._shared(gradient(value, self.tangents), owner).items():
            tangent = self.tangents[used]
            if len(tangent) > 1:
                per = _ratio(unit, self.units.get(used.name, ""))
                slope = self.name_it(slope, f"slope_{owner}__{used}", per, f"slope of {owner} in {used}")
            parts.append((slope, tangent))
        found = _combined(parts)
        return {column: found[column] for column in sorted(found, key=self.rank.__getitem__)}

    def _shared(self, slopes: Row, owner: str) -> Row:
        """Slopes with the functions that several of them use under names, so that each is evaluated once."""
        count: dict[Expr, int] = {}
        for value in slopes.values():
            for node in value.atoms(sympy.Function):
                count[node] = count.get(node, 0) + 1
        shared = [node for node, times in count.items() if times > 1 and not isinstance(node, _CHEAP)]
        names: dict[Expr, Expr] = {}
        for node in sorted(shared, key=lambda node: (node.count_ops(), str(node))):
            meaning = f"shared by the slopes of {owner}"
            names[node] = self.name_it(node.xreplace(names), f"part_{owner}_{len(names)}", "", meaning)
        return {used: value.xreplace(names) for used, value in slopes.items()} if names else slopes

    def assign(self, step: Assignment) -> None:
        """Differentiate one assignment."""
        self.store(step.symbol, self.row(step.expression, step.symbol.name, step.unit))

    def store(self, of: Symbol, row: Row, prefix: str = "d") -> None:
        """Keep the derivatives of a symbol, each under a name unless it is small."""
        self.tangents.pop(of, None)
        kept = {}
        for column, value in row.items():
            unit = _ratio(self.units.get(of.name, ""), self.units.get(column.name, ""))
            kept[column] = self.name_it(value, f"{prefix}_{of}__{column}", unit, f"derivative of {of} by {column}")
        if kept:
            self.tangents[of] = kept

    def name_it(self, value: Expr, wanted: str, unit: str, meaning: str) -> Expr:
        """The value itself where it may be repeated, else the symbol of a new assignment."""
        if is_small(value):
            return value
        while wanted in self.taken:
            wanted += "_"
        self.taken.add(wanted)
        self.units[wanted] = unit
        self.assignments.append(Assignment(symbol(wanted), value, unit, meaning))
        return self.assignments[-1].symbol


def _units(equations: StateEquations) -> dict[str, str]:
    """Units of everything that is declared or assigned; empty where not known."""
    units = {"t": "s"}
    units |= {signal.name: signal.unit for signal in equations.inputs}
    units |= {parameter.name: parameter.unit for parameter in equations.parameters}
    units |= {table.name: "" for table in equations.tables}
    units |= {state.symbol.name: state.unit for state in equations.states}
    for step in equations.assignments:
        if isinstance(step, ImplicitLoop):
            units |= {used.name: unit for used, unit in zip(step.unknowns, step.units, strict=True)}
        local = step.body if isinstance(step, ImplicitLoop) else (step,)
        units |= {assignment.symbol.name: assignment.unit for assignment in local}
    return units


def _ratio(above: str, below: str) -> str:
    if not above or not below:
        return ""
    return above if below == "1" else f"({above})/({below})"


# ---------------------------------------------------------------------- algebraic loops


class _LoopSweep:
    """Derivatives of the unknowns of one loop by the implicit function theorem."""

    def __init__(self, sweep: _Sweep, loop: ImplicitLoop) -> None:
        self.sweep, self.loop = sweep, loop
        self.known: dict[Expr, Expr] = {}

    def run(self) -> None:
        """Differentiate body and residuals with the unknowns as variables of their own, then eliminate those."""
        sweep, unknowns = self.sweep, self.loop.unknowns
        for unknown in unknowns:
            sweep.rank[unknown] = len(sweep.rank)
            sweep.tangents[unknown] = {unknown: ONE}
        for local in self.loop.body:
            sweep.store(local.symbol, sweep.row(local.expression, local.symbol.name, local.unit), "held")
        rows = [sweep.row(r, f"{self.loop.name}_{i}") for i, r in enumerate(self.loop.residuals)]
        matrix = [
            [self._short(row.get(z, ZERO), f"{i}_{j}") for j, z in enumerate(unknowns)] for i, row in enumerate(rows)
        ]
        found = {column for row in rows for column in row} - set(unknowns)
        columns = sorted(found, key=sweep.rank.__getitem__)
        solve = self._solver(matrix)
        solved = {column: solve([-row.get(column, ZERO) for row in rows]) for column in columns}
        for i, unknown in enumerate(unknowns):
            sweep.store(unknown, {column: values[i] for column, values in solved.items() if values[i] != 0})
        for local in self.loop.body:
            self._close(local)

    def _close(self, local: Assignment) -> None:
        """The derivatives of a symbol of the body with the unknowns following the variables."""
        held = self.sweep.tangents.get(local.symbol, {})
        inner = [(held[z], self.sweep.tangents.get(z, {})) for z in self.loop.unknowns if z in held]
        outer = {column: value for column, value in held.items() if column not in self.loop.unknowns}
        self.sweep.store(local.symbol, _combined([(ONE, outer), *inner]))

    def _short(self, value: Expr, hint: str) -> Expr:
        """A value under a name, the same name for the same value."""
        if value not in self.known:
            name = f"jacobian_{self.loop.name}_{hint}"
            self.known[value] = self.sweep.name_it(value, name, "", f"Jacobian of the loop {self.loop.name}")
        return self.known[value]

    def _solver(self, matrix: list[list[Expr]]) -> Callable[[list[Expr]], list[Expr]]:
        if len(matrix) > _BY_MINORS:
            return lambda right: solve_linear([[*row] for row in matrix], right, self._short, self._singular)
        every = tuple(range(len(matrix)))
        whole = _minor(matrix, every, every)
        if is_zero(whole):
            raise self._singular([0])
        determinant = self._short(whole, "determinant")
        cofactors = [[self._cofactor(matrix, row, column) for row in every] for column in every]
        return lambda right: [
            Add(*(cofactor * value for cofactor, value in zip(line, right, strict=True))) / determinant
            for line in cofactors
        ]

    def _cofactor(self, matrix: list[list[Expr]], row: int, column: int) -> Expr:
        rows = tuple(i for i in range(len(matrix)) if i != row)
        columns = tuple(j for j in range(len(matrix)) if j != column)
        minor = self._short(_minor(matrix, rows, columns), f"minor_{row}_{column}")
        return minor if (row + column) % 2 == 0 else -minor

    def _singular(self, columns: list[int]) -> DerivationError:
        unknowns = ", ".join(str(self.loop.unknowns[column]) for column in columns)
        return DerivationError(
            f"{self.sweep.name}: {self.loop.meaning or f'loop {self.loop.name}'} does not determine {unknowns}: its "
            "residuals depend on each other - give its elements laws that do",
            where=(self.loop.name,),
        )


def _minor(matrix: list[list[Expr]], rows: tuple[int, ...], columns: tuple[int, ...]) -> Expr:
    """Determinant of a part of a small matrix, expanded along its first row."""
    if not rows:
        return ONE
    terms = []
    for k, column in enumerate(columns):
        if matrix[rows[0]][column] != 0:
            rest = _minor(matrix, rows[1:], columns[:k] + columns[k + 1 :])
            terms.append(matrix[rows[0]][column] * rest * (-1) ** k)
    return Add(*terms)
