"""Text of functions that solve a nonlinear algebraic loop by Newton's method, for one state or a whole batch.

    def _solve_belt(F_b, c, v):             guesses of the unknowns, then the quantities the loop uses
        for _ in range(200):
            ...                             residuals and their analytic Jacobian at F_b
            ...                             accept F_b where the residual fell, else half as far to the other side
            if np.all(...): break           every member of the batch has settled
        return np.where(found, best, nan)

The Jacobian is that of forward differentiation through the assignments of the loop. A step is accepted where it reduces
the residual by a quarter of what Newton's method promises for its length (Armijo's rule), so that saturating laws such
as tanh do not throw it off; after a rejection the step is halved and turned round. Where the Jacobian is singular or
the guess is outside the domain of a law, a step of the size of the unknown is tried instead, and any reduction will do.
It ends when the step no longer changes the unknown in floating point. Where it ends with a Newton step that is not
small it has failed, and the unknowns are nan. Deuflhard (2011), Newton Methods for Nonlinear Problems, chapter 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy
from sympy import Expr, Symbol

from bondgraph.derive.equations import Assignment, ImplicitLoop
from bondgraph.derive.jacobian import gradient
from bondgraph.errors import GenerationError
from bondgraph.generate.expressions import ExpressionPrinter
from bondgraph.generate.literals import one_line

_EVALUATIONS = 200


@dataclass(frozen=True)
class LoopText:
    """A printed loop: the call that stands in the equations, the names it uses, and the function it calls."""

    unknowns: int
    call: str
    uses: tuple[str, ...]
    function: str


def loop_text(loop: ImplicitLoop, function: str, printer: ExpressionPrinter) -> LoopText:
    """Print a loop; afterwards the printer knows its unknowns and the symbols of its body.

    Parameters
    ----------
    loop
        Unknowns, guesses, residuals.
    function
        Name of the function to write.
    printer
        Knows all that is computed before the loop.

    Raises
    ------
    GenerationError
        If there are not as many residuals and guesses as unknowns, or a symbol is unknown.
    """
    _check(loop)
    printer.forget()
    guesses = [printer.text(guess) for guess in loop.guesses]
    guess_uses = tuple(printer.used)
    before = printer.known()
    for unknown in loop.unknowns:
        printer.declare(unknown.name)
    printer.forget()
    lines = _residual_lines(loop, printer)
    arguments = sorted((name for name in printer.used if name in before), key=printer.rank)
    unknowns = [printer.identifier(unknown.name) for unknown in loop.unknowns]
    parameters = [printer.identifier(name) for name in arguments]
    text = [f"def {function}({', '.join([*unknowns, *parameters])}):", *_purpose(loop, unknowns)]
    text += ["    " + line for line in _newton_lines(unknowns, lines)]
    call = f"{', '.join(unknowns)} = {function}({', '.join([*guesses, *parameters])})"
    return LoopText(len(unknowns), call, tuple(dict.fromkeys([*guess_uses, *arguments])), "\n".join(text))


def linear_solver_text(size: int) -> str:
    """A function ``_linear_<size>`` that solves a small system of equations, for one state or a batch."""
    rows = range(size)
    cells = [f"a{i}_{j}" for i in rows for j in rows]
    lines = [f"def _linear_{size}({', '.join(cells + [f'b{i}' for i in rows])}):"]
    lines += ['    """Solution of a x = b by Gaussian elimination with the largest pivot first."""']
    for k in rows:
        for i in range(k + 1, size):
            lines += [f"    swap = np.abs(a{i}_{k}) > np.abs(a{k}_{k})"]
            pairs = [(f"a{k}_{j}", f"a{i}_{j}") for j in range(k, size)] + [(f"b{k}", f"b{i}")]
            lines += [f"    {a}, {b} = np.where(swap, {b}, {a}), np.where(swap, {a}, {b})" for a, b in pairs]
        for i in range(k + 1, size):
            lines += [f"    factor = a{i}_{k}/a{k}_{k}"]
            lines += [f"    a{i}_{j} = a{i}_{j} - factor*a{k}_{j}" for j in range(k + 1, size)]
            lines += [f"    b{i} = b{i} - factor*b{k}"]
    for i in reversed(rows):
        known = "".join(f" - a{i}_{j}*x{j}" for j in range(i + 1, size))
        lines += [f"    x{i} = {f'(b{i}{known})' if known else f'b{i}'}/a{i}_{i}"]
    return "\n".join([*lines, f"    return {', '.join(f'x{i}' for i in rows)}"])


def _check(loop: ImplicitLoop) -> None:
    sizes = len(loop.unknowns), len(loop.guesses), len(loop.residuals)
    if len(set(sizes)) != 1 or not loop.unknowns:
        raise GenerationError(
            f"loop {loop.name}: {sizes[0]} unknowns, {sizes[1]} guesses and {sizes[2]} residuals"
            " - a loop needs one guess and one residual for each unknown",
            where=(loop.name,),
        )


def _purpose(loop: ImplicitLoop, unknowns: Sequence[str]) -> list[str]:
    units = [f"{name} [{unit}]" if unit else name for name, unit in zip(unknowns, loop.units, strict=True)]
    meaning = f" ({loop.meaning})" if loop.meaning else ""
    text = (
        f"{', '.join(units)} of the algebraic loop {loop.name}{meaning}, by damped Newton steps; nan where they fail."
    )
    return [f'    """{one_line(text)}"""']


def _residual_lines(loop: ImplicitLoop, printer: ExpressionPrinter) -> list[str]:
    """Body, residuals ``_r0, ...`` and Jacobian ``_j0_0, ...``, as lines."""
    seeds: list[dict[Symbol, Expr]] = [{unknown: sympy.S.One} for unknown in loop.unknowns]
    lines = []
    for assignment in _needed(loop):
        name = printer.identifier(assignment.symbol.name)
        lines.append(f"{name} = {printer.text(assignment.expression)}")
        printer.declare(assignment.symbol.name)
        slopes = _slopes(assignment.expression, seeds)
        for unknown, seed, slope in zip(loop.unknowns, seeds, slopes, strict=True):
            if slope == 0:
                continue
            if not (slope.is_number or slope.is_Symbol):
                temporary = printer.temporary(f"{name}_by_{printer.identifier(unknown.name)}")
                lines.append(f"{printer.identifier(temporary.name)} = {printer.text(slope)}")
                slope = temporary
            seed[assignment.symbol] = slope
    lines += [f"_r{i} = {printer.text(residual)}" for i, residual in enumerate(loop.residuals)]
    for i, residual in enumerate(loop.residuals):
        lines += [f"_j{i}_{j} = {printer.text(slope)}" for j, slope in enumerate(_slopes(residual, seeds))]
    return lines


def _slopes(expression: Expr, seeds: Sequence[dict[Symbol, Expr]]) -> list[Expr]:
    """Derivatives of an expression by the unknowns, given those of the symbols in it, one dictionary per unknown."""
    partial = gradient(expression, {symbol for seed in seeds for symbol in seed})
    return [sympy.Add(*(slope * seed[used] for used, slope in partial.items() if used in seed)) for seed in seeds]


def _needed(loop: ImplicitLoop) -> list[Assignment]:
    wanted = {symbol for residual in loop.residuals for symbol in residual.free_symbols}
    kept = []
    for assignment in reversed(loop.body):
        if assignment.symbol in wanted:
            kept.append(assignment)
            wanted |= assignment.expression.free_symbols
    return kept[::-1]


def _newton_lines(unknowns: Sequence[str], residual_lines: Sequence[str]) -> list[str]:
    best = [f"_best_{name}" for name in unknowns]
    step = [f"_step_{name}" for name in unknowns]
    lines = [f"{b}, {s} = {name}, 1.0 + np.abs({name})" for b, s, name in zip(best, step, unknowns, strict=True)]
    lines += _start_lines(len(unknowns))
    lines += [f"for _ in range({_EVALUATIONS}):"]
    loop = [*residual_lines, *_error_lines(unknowns)]
    loop += ["_better = _trial < (1.0 - _demand*np.abs(_part))*_error"]
    loop += _direction_lines(unknowns)
    loop += [f"{b} = np.where(_better, {name}, {b})" for b, name in zip(best, unknowns, strict=True)]
    loop += ["_part = np.where(_better, np.minimum(4.0*np.abs(_part), 1.0), -0.5*_part)"]
    still = " & ".join(f"(np.abs(_part*{s}) <= 4e-16*np.abs({b}))" for s, b in zip(step, best, strict=True))
    still = f"({still})" if len(unknowns) > 1 else still
    loop += [f"_settled = (_error == 0.0) | (np.abs(_part) < 1e-18) | {still}"]
    loop += ["_part = np.where(_settled, 0.0, _part)", "if np.all(_part == 0.0):", "    break"]
    loop += [f"{name} = {b} + _part*{s}" for name, b, s in zip(unknowns, best, step, strict=True)]
    lines += ["    " + line for line in loop]
    small = " & ".join(f"(np.abs({s}) <= 1e-6*np.abs({b}) + 1e-9)" for s, b in zip(step, best, strict=True))
    small = f"({small})" if len(unknowns) > 1 else small
    lines += [f"_found = (_error == 0.0) | {small}"]
    return [*lines, f"return {', '.join(f'np.where(_found, {b}, np.nan)' for b in best)}"]


def _start_lines(size: int) -> list[str]:
    weights = [f"_w{i}" for i in range(size)] if size > 1 else []
    names = ["_error", "_demand", "_part", *weights]
    return [f"{', '.join(names)} = {', '.join(['np.inf', '0.0', '-2.0', *('0.0' for _ in weights)])}"]


def _error_lines(unknowns: Sequence[str]) -> list[str]:
    """The size of the residuals at the trial; several are weighed by their Jacobian, so that units do not matter."""
    if len(unknowns) == 1:
        return ["_trial = np.abs(_r0)"]
    return [f"_trial = {' + '.join(f'_w{i}*np.abs(_r{i})' for i in range(len(unknowns)))}"]


def _direction_lines(unknowns: Sequence[str]) -> list[str]:
    """Newton's step from the trial where it is accepted; a step of the size of the unknown where there is none."""
    size = len(unknowns)
    newton = [f"_newton_{name}" for name in unknowns]
    if size == 1:
        lines = [f"{newton[0]} = -_r0/_j0_0"]
        update = ["_error = np.where(_better, _trial, _error)"]
    else:
        cells = [f"_j{i}_{j}" for i in range(size) for j in range(size)]
        lines = [f"{', '.join(newton)} = _linear_{size}({', '.join(cells + [f'-_r{i}' for i in range(size)])})"]
        update = []
        for i in range(size):
            row = " + ".join(f"np.abs(_j{i}_{j})*(1.0 + np.abs({name}))" for j, name in enumerate(unknowns))
            update += [f"_w{i} = np.where(_better, 1.0/({row} + 1e-30), _w{i})"]
        total = " + ".join(f"_w{i}*np.abs(_r{i})" for i in range(size))
        update += [f"_error = np.where(_better, {total}, _error)"]
    usable = " & ".join(f"(np.abs({n}) < 1e9*(1.0 + np.abs({name})))" for n, name in zip(newton, unknowns, strict=True))
    moving = " + ".join(f"np.abs({n})" for n in newton)
    lines += [
        f"_usable = {usable} & ({moving} > 0.0)",
        "_demand = np.where(_better, np.where(_usable, 0.25, 0.0), _demand)",
    ]
    for name, n in zip(unknowns, newton, strict=True):
        lines += [f"_step_{name} = np.where(_better, np.where(_usable, {n}, 1.0 + np.abs({name})), _step_{name})"]
    return lines + update
