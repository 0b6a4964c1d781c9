"""Newton loops of a module as programs, so that they can run for all lanes at once.

A function ``_solve_...`` becomes three programs: what stands before its loop, one turn of the loop, and what it
returns. The variables that one turn hands to the next are the vector ``carried``; the function's arguments are the
vector ``argument``. Lanes that have settled stay as they are while others go on.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass

from bondgraph.compile.front.parse import Reader, Solver, Value
from bondgraph.compile.ir.tape import Program
from bondgraph.errors import ModelError


@dataclass(frozen=True)
class LoopPrograms:
    """The programs of one solver.

    ``start`` gives the carried variables before the loop, ``turn`` those after a turn and last whether the lane still
    moves (1 or 0), ``end`` the unknowns. ``limit`` is the largest number of turns.
    ``quick`` is a turn of plain Newton steps, see ``quick``, and ``arguments`` how many arguments the others read.
    """

    start: Program
    turn: Program
    end: Program
    limit: int
    quick: Program | None = None
    arguments: int = 0


def loop_programs(reader: Reader, solver: Solver) -> LoopPrograms:
    """The programs of a solver.

    Raises
    ------
    ModelError
        If the function has another form than a start, one loop that ends when all have settled, and a result.
    """
    return _Follower(reader, solver).programs()


class _Follower:
    def __init__(self, reader: Reader, solver: Solver) -> None:
        self._reader = reader
        self._tape = reader.tape
        self._solver = solver

    def programs(self) -> LoopPrograms:
        body = self._solver.function.body
        position = next(i for i, node in enumerate(body) if isinstance(node, ast.For))
        loop = body[position]
        if not isinstance(loop, ast.For) or loop.orelse:
            raise self._refused("its loop")
        names = [argument.arg for argument in self._solver.function.args.args]
        environment: dict[str, Value] = {name: self._tape.leaf("argument", k) for k, name in enumerate(names)}
        self._reader.follow(body[:position], environment)
        changed = dict.fromkeys(node.id for node in ast.walk(loop) if isinstance(node, ast.Name) and _is_stored(node))
        carried = [name for name in changed if name in environment]
        start = self._tape.program([self._node(environment, name) for name in carried])
        for k, name in enumerate(carried):
            environment[name] = self._tape.leaf("carried", k)
        after = dict(environment)
        moving = self._turn(loop, environment)
        turn = self._tape.program([*(self._node(environment, name) for name in carried), moving])
        returned = self._reader.follow(body[position + 1 :], after)
        unknowns = returned if isinstance(returned, tuple) else (returned,)
        end = self._tape.program([node for node in unknowns if isinstance(node, int)])
        return LoopPrograms(start, turn, end, self._limit(loop))

    def _turn(self, loop: ast.For, environment: dict[str, Value]) -> int:
        """Follow the body; the node that is 1 where a lane still moves."""
        moving: int | None = None
        for statement in loop.body:
            if not isinstance(statement, ast.If):
                self._reader.follow([statement], environment)
                continue
            call = statement.test
            ends = [ast.unparse(node) for node in statement.body] == ["break"]
            if not (ends and isinstance(call, ast.Call) and ast.unparse(call.func) == "np.all"):
                raise self._refused("a condition in its loop")
            settled = self._reader.expression(call.args[0], environment)
            moving = self._tape.where(settled, 0.0, 1.0)
        if moving is None:
            raise self._refused("a loop without an end")
        return moving

    def _limit(self, loop: ast.For) -> int:
        call = loop.iter
        if isinstance(call, ast.Call) and len(call.args) == 1 and isinstance(call.args[0], ast.Constant):
            return int(str(call.args[0].value))
        raise self._refused("the range of its loop")

    def _node(self, environment: dict[str, Value], name: str) -> int:
        value = environment[name]
        if not isinstance(value, int):
            raise self._refused(f"{name!r}")
        return value

    def _refused(self, what: str) -> ModelError:
        return ModelError(
            f"{self._solver.name}: {what} cannot be run for several lanes - regenerate the module",
            where=(self._solver.name,),
        )


def _is_stored(node: ast.Name) -> bool:
    return isinstance(node.ctx, ast.Store)
