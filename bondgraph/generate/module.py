"""Text of a generated module: header, tables of quantities, interpolated tables, solvers, ``rhs`` and ``output``.

The module imports numpy only and runs without this library. It is the same for the same equations on every machine:
no date, host or path, names in order of declaration, own printing order.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import sympy
from sympy import Expr

from bondgraph.declare.quantities import ParameterStart
from bondgraph.derive.equations import Assignment, ImplicitLoop, Mode, StateEquations
from bondgraph.errors import GenerationError
from bondgraph.generate.expressions import ExpressionPrinter, derivative_ending
from bondgraph.generate.literals import one_line
from bondgraph.generate.modes import mode_tables, reset_names
from bondgraph.generate.names import identifiers, stems
from bondgraph.generate.newton import LoopText, linear_solver_text, loop_text
from bondgraph.generate.preamble import preamble
from bondgraph.generate.tables import ENDINGS, interpolant_text, sorted_orders, table_text
from bondgraph.version import __version__

_STACK = '''def _stack(x, rows):
    """Rows, each a number or of the batch shape of x, as one array of shape (len(rows), *batch)."""
    stacked = np.empty((len(rows), *x.shape[1:]))
    for i, row in enumerate(rows):
        stacked[i] = row
    return stacked'''


@dataclass(frozen=True)
class _Line:
    """One assignment of the text: the names it defines and those it uses."""

    defines: tuple[str, ...]
    uses: tuple[str, ...]
    text: str


def render(equations: StateEquations, command: str | None = None) -> str:
    """Text of the module of a model.

    Parameters
    ----------
    equations
        As derived.
    command
        Shell command that regenerates the module; ``bondgraph generate <name>`` where omitted.

    Returns
    -------
    str
        Python source with ``rhs(t, x, u, theta)`` and ``output(t, x, u, theta)``, vector axis first, batch axes last.

    Raises
    ------
    GenerationError
        If a name is declared twice or used before it is computed, or an expression has no numpy form.
    """
    body = _body(equations)
    digest = hashlib.sha256(body.encode()).hexdigest()[:16]
    header = (
        f"# Generated from {one_line(equations.source)} -- do not edit.",
        f"# Regenerate with:  {one_line(command or f'bondgraph generate {equations.name}')}",
        f"# Generator: bondgraph {__version__}, sympy {sympy.__version__}.  Equations: {digest}",
    )
    return "\n".join(header) + "\n" + body


def _body(equations: StateEquations) -> str:
    printer = _printer(equations)
    assignments, solvers = _assignment_lines(equations, printer)
    functions = [
        _function(
            "rhs", "dx/dt, shape (n_x, *batch).", equations, assignments, _rate_lines(equations, printer), printer
        ),
        _function(
            "output", "y, shape (n_y, *batch).", equations, assignments, _output_lines(equations, printer), printer
        ),
    ]
    functions += _start_function(equations, printer)
    functions += _mode_functions(equations, assignments, printer, solvers)
    called = {name: solver for name, solver in solvers.items() if _calls(name, functions)}
    sizes = sorted({solver.unknowns for solver in called.values() if solver.unknowns > 1})
    code = [*map(linear_solver_text, sizes), *(solver.function for solver in called.values()), *functions, _STACK]
    head = "\n".join([preamble(equations), *mode_tables(equations)])
    return "\n\n\n".join([head, *_table_parts(equations, printer, code), *code]) + "\n"


def _calls(function: str, texts: Iterable[str]) -> bool:
    return any(f"{function}(" in text for text in texts)


def _table_parts(equations: StateEquations, printer: ExpressionPrinter, code: Sequence[str]) -> list[str]:
    """Interpolation and the tables that the code uses."""
    parts = []
    needed: list[tuple[int, ...]] = []
    for table in equations.tables:
        stem = printer.table_stem(table.name)
        orders = [orders for name, orders in printer.used_tables if name == table.name]
        used = [order for order in orders if _calls(stem + derivative_ending(order), code)]
        if used:
            parts.append(table_text(table, stem, used))
            needed += used
    return [*map(interpolant_text, sorted_orders(needed)), *parts]


def _printer(equations: StateEquations) -> ExpressionPrinter:
    declared = [
        *(parameter.name for parameter in equations.parameters),
        *(signal.name for signal in equations.inputs),
        *(state.symbol.name for state in equations.states),
    ]
    known = declared if "t" in declared else ["t", *declared]
    names = {"t": "t"} | identifiers([*declared, *_computed(equations.assignments)])
    table_stems = stems([table.name for table in equations.tables], "_table_", ENDINGS)
    printer = ExpressionPrinter(names, (), table_stems, equations.name)
    for name in known:
        printer.declare(name)
    return printer


def _computed(assignments: Sequence[Assignment | ImplicitLoop]) -> list[str]:
    names: list[str] = []
    for item in assignments:
        if isinstance(item, Assignment):
            names.append(item.symbol.name)
        else:
            names += [symbol.name for symbol in item.unknowns]
            names += [inner.symbol.name for inner in item.body]
    return names


def _assignment_lines(equations: StateEquations, printer: ExpressionPrinter) -> tuple[list[_Line], dict[str, LoopText]]:
    """All assignments as lines in order of computation, and the solver of each loop by the name of its function."""
    lines: list[_Line] = []
    solvers: dict[str, LoopText] = {}
    loops = [item.name for item in equations.assignments if isinstance(item, ImplicitLoop)]
    functions = stems(loops, "_solve_", ("",))
    for item in equations.assignments:
        if isinstance(item, Assignment):
            lines.append(_assignment_line(item, printer))
            printer.declare(item.symbol.name)
            continue
        if functions[item.name] in solvers:
            raise GenerationError(
                f"{equations.name}: two loops are called {item.name!r} - give them different names",
                where=(equations.name, item.name),
            )
        loop = solvers[functions[item.name]] = loop_text(item, functions[item.name], printer)
        unknowns = tuple(unknown.name for unknown in item.unknowns)
        lines.append(_Line(unknowns, loop.uses, loop.call + _comment("", item.meaning or f"loop {item.name}")))
        lines += [_assignment_line(inner, printer) for inner in item.body]
    return lines, solvers


def _assignment_line(item: Assignment, printer: ExpressionPrinter) -> _Line:
    name = item.symbol.name
    return _line(name, printer.identifier(name), item.expression, _comment(item.unit, item.meaning), printer)


def _rate_lines(equations: StateEquations, printer: ExpressionPrinter) -> list[_Line]:
    if len(equations.states) != len(equations.derivatives):
        raise GenerationError(
            f"{equations.name}: {len(equations.states)} states but {len(equations.derivatives)} derivatives"
            " - give one for each state",
            where=(equations.name,),
        )
    rates = zip(equations.states, equations.derivatives, strict=True)
    return [
        _line("", f"dx{i}", rate, _comment("", f"d({state.symbol.name})/dt"), printer)
        for i, (state, rate) in enumerate(rates)
    ]


def _output_lines(equations: StateEquations, printer: ExpressionPrinter) -> list[_Line]:
    return [
        _line("", f"y{i}", output.expression, _comment("", f"{output.symbol.name} [{output.unit or '?'}]"), printer)
        for i, output in enumerate(equations.outputs)
    ]


def _start_function(equations: StateEquations, printer: ExpressionPrinter) -> list[str]:
    """The initial states where some follow parameters, the others as they are given; nothing where none does."""
    if not any(isinstance(state.start, ParameterStart) for state in equations.states):
        return []
    rows = [
        _line(
            "",
            f"_x{i}",
            state.start.expression if isinstance(state.start, ParameterStart) else state.symbol,
            _comment(state.unit, state.symbol.name),
            printer,
        )
        for i, state in enumerate(equations.states)
    ]
    purpose = "Initial x, shape (n_x, *batch): states that follow parameters, the others as they are in x."
    return [_function("start", purpose, equations, [], rows, printer)]


def _mode_functions(
    equations: StateEquations, assignments: Sequence[_Line], printer: ExpressionPrinter, solvers: dict[str, LoopText]
) -> list[str]:
    """The zero functions of all modes, and for each element with modes the states after its impact or lock."""
    if not equations.modes:
        return []
    rows = [
        _line("", f"_event{i}", function.expression, _comment(function.unit, function.meaning), printer)
        for i, function in enumerate(function for mode in equations.modes for function in mode.functions)
    ]
    purpose = "Zero functions of the modes, shape (n_events, *batch), in the order of EVENTS."
    functions = [_function("events", purpose, equations, assignments, rows, printer)]
    for name, mode in zip(reset_names(equations), equations.modes, strict=True):
        if mode.reset is not None:
            between = replace(equations, assignments=mode.reset.assignments)
            functions.append(_reset_function(name, mode, between, solvers))
    return functions


def _reset_function(name: str, mode: Mode, equations: StateEquations, solvers: dict[str, LoopText]) -> str:
    printer = _printer(equations)
    lines, own_solvers = _assignment_lines(equations, printer)
    assert mode.reset is not None
    states = zip(equations.states, mode.reset.states, strict=True)
    rows = [
        _line("", f"_x{i}", value, _comment(state.unit, state.symbol.name), printer)
        for i, (state, value) in enumerate(states)
    ]
    what = "an impact on" if mode.kind == "impact" else "locking"
    text = _function(name, f"x after {what} {mode.element}, shape (n_x, *batch).", equations, lines, rows, printer)
    for solver, loop in own_solvers.items():
        if _calls(solver, [text]) and solvers.setdefault(solver, loop).function != loop.function:
            raise GenerationError(
                f"{equations.name}: {mode.element}: the loop {loop.function.split('(')[0][4:]} differs at an impact - "
                "derive the graph smooth",
                where=(equations.name, mode.element),
            )
    return text


def _line(name: str, target: str, expression: Expr, comment: str, printer: ExpressionPrinter) -> _Line:
    printer.forget()
    text = printer.text(expression)
    return _Line((name,), tuple(printer.used), f"{target} = {text}{comment}")


def _comment(unit: str, meaning: str) -> str:
    parts = [f"[{unit}]" if unit else "", one_line(meaning)]
    text = " ".join(part for part in parts if part)
    return f"  # {text}" if text else ""


def _function(
    name: str,
    purpose: str,
    equations: StateEquations,
    assignments: Sequence[_Line],
    rows: Sequence[_Line],
    printer: ExpressionPrinter,
) -> str:
    """A function that unpacks and computes only what its rows need."""
    wanted = {used for row in rows for used in row.uses}
    needed: list[_Line] = []
    for line in reversed(assignments):
        if not wanted.isdisjoint(line.defines):
            needed.append(line)
            wanted.update(line.uses)
    lines = [f"def {name}(t, x, u, theta):", f'    """{purpose}"""']
    vectors = {
        "x": [state.symbol.name for state in equations.states],
        "u": [quantity.name for quantity in equations.inputs],
        "theta": [quantity.name for quantity in equations.parameters],
    }
    for vector, names in vectors.items():
        lines += [
            f"    {printer.identifier(unpacked)} = {vector}[{i}]"
            for i, unpacked in enumerate(names)
            if unpacked in wanted
        ]
    lines += [f"    {line.text}" for line in [*reversed(needed), *rows]]
    results = [row.text.partition(" ")[0] for row in rows]
    return "\n".join([*lines, f"    return _stack(x, ({', '.join(results)}{',' * (len(results) == 1)}))"])
