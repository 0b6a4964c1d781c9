"""Plain Newton steps for algebraic loops, tried before the damped iteration that the module itself has.

The function ``_solve_...`` of a module guards its steps by halving and turning them, and goes on until they no longer
change a digit; most of its work is wasted where the guess is good. Here its undamped steps are taken as long as each is
at most half as long as the one before (Deuflhard 2011, Newton Methods for Nonlinear Problems, section 3.3), until one
is so short that the next would be lost in rounding, since they shrink quadratically. Lanes in which that fails are left
to the guarded iteration. What does not change with the unknowns is taken out of the loop, and divisions by it with it.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass, replace

from bondgraph.compile.front.parse import Reader, Solver, Value
from bondgraph.compile.front.solver import LoopPrograms, loop_programs
from bondgraph.compile.ir.tape import Operation, Program, Tape, reachable

#: A step shorter than this share of the unknown is the last one: the error that remains is about its square.
_LAST = 1e-8

#: Shorter than any number that matters, for unknowns at zero.
_NOTHING = 1e-30


@dataclass(frozen=True)
class _Call:
    """A call with what its Newton steps need beyond its arguments, and its programs."""

    key: str
    extras: tuple[int, ...]
    programs: LoopPrograms


class LoopCalls:
    """Rewrites calls of solvers so that they also carry what their plain Newton steps read.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> reader = pendulum().program.reader
    >>> LoopCalls(reader).widen([3, 4])
    [3, 4]
    """

    def __init__(self, reader: Reader) -> None:
        self._reader = reader
        self._tape: Tape = reader.tape
        self._plain = {name: loop_programs(reader, solver) for name, solver in reader.solvers.items()}
        self._calls: dict[tuple[str, tuple[int, ...]], _Call] = {}
        self._new: dict[int, int] = {}
        #: Programs of all calls, by the name in their operation.
        self.programs: dict[str, LoopPrograms] = {}

    def widen(self, nodes: Sequence[int]) -> list[int]:
        """The same nodes with widened calls."""
        if not self._plain:
            return list(nodes)
        tape = self._tape
        for node in reachable(tape.operations, nodes, stop=self._new):
            if node in self._new:
                continue
            operation = tape.operations[node]
            arguments = [self._new[argument] for argument in operation.arguments]
            if operation.kind in ("constant", "leaf"):
                self._new[node] = node
            elif operation.kind == "solve" and operation.value[0] in self._plain:
                self._new[node] = self._widened(operation, arguments)
            else:
                self._new[node] = tape.emit(operation, arguments)
                if node in tape.names:
                    tape.names.setdefault(self._new[node], tape.names[node])
            self._new[self._new[node]] = self._new[node]
        return [self._new[node] for node in nodes]

    def _widened(self, operation: Operation, arguments: Sequence[int]) -> int:
        name, unknowns = operation.value
        known = (name, tuple(arguments))
        if known not in self._calls:
            key = f"{name}_{len(self._calls)}"
            self._calls[known] = self._call(key, self._reader.solvers[name], arguments)
            self.programs[key] = self._calls[known].programs
        call = self._calls[known]
        return self._tape.emit(Operation("solve", (), (call.key, unknowns)), [*arguments, *call.extras])

    def _call(self, key: str, solver: Solver, arguments: Sequence[int]) -> _Call:
        plain = self._plain[solver.name]
        tape, n = self._tape, solver.unknowns
        unknowns = [tape.leaf("carried", k) for k in range(n)]
        steps = _newton_steps(self._reader, solver, unknowns, arguments[n:])
        if steps is None:
            return _Call(key, (), plain)
        first = len(arguments)
        inside, extras = _outside(tape, steps, unknowns, first)
        quick = _turn(tape, unknowns, inside)
        return _Call(key, tuple(extras), replace(plain, quick=quick, arguments=first))


def _newton_steps(
    reader: Reader, solver: Solver, unknowns: Sequence[int], quantities: Sequence[int]
) -> list[int] | None:
    """Newton's steps ``_newton_...`` that the loop of a solver works out; None where it names none."""
    names = [argument.arg for argument in solver.function.args.args]
    environment: dict[str, Value] = dict(zip(names, [*unknowns, *quantities], strict=True))
    wanted = [f"_newton_{name}" for name in names[: solver.unknowns]]
    loop = next(node for node in solver.function.body if isinstance(node, ast.For | ast.While))
    told = {node.id for node in ast.walk(loop) if isinstance(node, ast.Name)}
    if not told.issuperset(wanted):
        return None
    missing = {node.id for node in ast.walk(solver.function) if isinstance(node, ast.Name)} - set(names)
    for statement in loop.body:
        reads = {node.id for node in ast.walk(statement) if isinstance(node, ast.Name)}
        if reads & missing & _BOOKKEEPING:  # how far the damped iteration has come
            continue
        reader.follow([statement], environment)
        if all(name in environment for name in wanted):
            found = [environment[name] for name in wanted]
            return [node for node in found if isinstance(node, int)]
    return None


#: Names of the damped iteration that its Newton steps do not need.
_BOOKKEEPING = {"_trial", "_better", "_demand", "_part", "_error"}


def _outside(tape: Tape, steps: Sequence[int], unknowns: Sequence[int], first: int) -> tuple[list[int], list[int]]:
    """Steps that read what does not move from the vector ``argument``, from ``first`` on, and what that is."""
    moving = set(unknowns)
    needed = reachable(tape.operations, steps)
    for node in needed:
        if any(argument in moving for argument in tape.operations[node].arguments):
            moving.add(node)
    extras: list[int] = []

    def read(node: int) -> int:
        if node in new:
            return new[node]
        if tape.operations[node].kind == "constant":
            return node
        number = tape.as_number(node)
        if number not in extras:
            extras.append(number)
        return tape.as_kept(node, tape.leaf("argument", first + extras.index(number)))

    new: dict[int, int] = {unknown: unknown for unknown in unknowns}
    for node in needed:
        operation = tape.operations[node]
        if node not in moving or node in new:
            continue
        if operation.kind == "div" and operation.arguments[1] not in moving:
            new[node] = tape.mul(read(operation.arguments[0]), read(tape.div(1.0, operation.arguments[1])))
        else:
            new[node] = tape.emit(operation, [read(argument) for argument in operation.arguments])
    return [read(step) for step in steps], extras


def _turn(tape: Tape, unknowns: Sequence[int], steps: Sequence[int]) -> Program:
    """One turn: the unknowns, the size of the step, whether the lane goes on (1), has settled (0) or failed (-1)."""
    before, mode = tape.leaf("carried", len(unknowns)), tape.leaf("carried", len(unknowns) + 1)
    size = tape.constant(0.0)
    settled: int | None = None
    moved = []
    for unknown, step in zip(unknowns, steps, strict=True):
        length, there = tape.function("abs", step), tape.add(unknown, step)
        scale = tape.add(1.0, tape.function("abs", unknown))  # of several unknowns each counts by its own size
        size = tape.add(size, tape.div(length, scale) if len(unknowns) > 1 else length)
        limit = tape.add(tape.mul(_LAST, tape.function("abs", there)), _NOTHING)
        short = tape.compare("le", length, limit)
        settled = short if settled is None else tape.logic("and", settled, short)
        moved.append(there)
    goes = tape.compare("eq", mode, 1.0)
    shorter = tape.compare("le", size, tape.mul(0.5, before))
    taken = tape.logic("and", goes, shorter)
    ends = tape.where(settled, 0.0, 1.0) if settled is not None else mode
    after = tape.where(goes, tape.where(shorter, ends, -1.0), mode)
    kept = [tape.where(taken, there, unknown) for unknown, there in zip(unknowns, moved, strict=True)]
    going = tape.where(tape.compare("eq", after, 1.0), 1.0, 0.0)
    return tape.program([*kept, tape.where(goes, size, before), after, going])
