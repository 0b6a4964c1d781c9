"""Print programs as loops over lanes: members or sigma points side by side, which compilers turn into SIMD code.

All vectors of all lanes stand in one flat work buffer ``w``. Element ``row`` of lane ``l`` is ``w[row*LANES + l]``,
with the product written out as a number:

    for l in range(n):
        slip_7 = w[16 + l]*w[480 + l] - w[32 + l]
        w[64 + l] = _lane_tanh(slip_7)*w[496 + l]

The offsets are literals, so that a compiler knows which rows overlap. ``compiler`` compiles this text, and what it
says is what Python and numba make of it. What has no form without branches (a Newton loop, a rare function) is worked
out in a loop of its own between two such loops. Every name ends in its number, so that no two can be the same.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bondgraph.compile.front.solver import LoopPrograms
from bondgraph.compile.ir.tape import TRUTHS, Operation, Program

#: Lanes worked on together: two vectors of eight numbers.
LANES = 16

#: Functions that have a form without branches.
_LANE_FUNCTIONS = {"tanh": "_lane_tanh", "exp": "_lane_exp", "sin": "_lane_sin", "cos": "_lane_cos",
                   "arcsin": "_lane_arcsin", "arctan": "_lane_arctan", "log": "_lane_log", "pow": "_lane_pow",
                   "sqrt": "math.sqrt", "abs": "abs", "floor": "np.floor"}  # fmt: skip
_INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/", "lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==",
          "ne": "!=", "and": "&", "or": "|"}  # fmt: skip
_SMOOTH = (*_LANE_FUNCTIONS, *_INFIX, "constant", "leaf", "neg", "not", "sign", "minimum", "maximum", "where",
           "search", "offset", "gather", "item")  # fmt: skip
#: Kinds that stand inside another line when only that uses them.
_NESTED = ("add", "sub", "mul", "div", "neg")
_LONGEST = 90
#: Plain Newton steps before a lane is left to the guarded iteration.
_QUICK_TURNS = 8
_ELEMENT = re.compile(r"w\[\d+ \+ l\]")


@dataclass(frozen=True)
class Place:
    """Where a vector of a program is: from ``row`` on in the work buffer, in a plain vector, or as these texts."""

    row: int = 0
    vector: str = ""

    texts: tuple[str, ...] = ()

    def text(self, position: int) -> str:
        """The element as it is read inside of a loop over lanes."""
        if self.texts:
            return self.texts[position]
        return f"{self.vector}_{self.row + position}" if self.vector else element(self.row + position)


def element(row: int) -> str:
    """A row of the work buffer, inside of a loop over lanes."""
    return f"w[{row * LANES} + l]"


def lane_function(
    name: str,
    arguments: str,
    program: Program,
    places: Mapping[str, Place],
    targets: Sequence[int],
    spare: int,
    solvers: Mapping[str, LoopPrograms] | None = None,
) -> tuple[str, int]:
    """Text of a function that runs a program for all lanes, and the number of spare rows it uses.

    Parameters
    ----------
    name, arguments
        Of the function; the arguments end in ``w, n``.
    program
        What to compute.
    places
        Where each vector of leaves is.
    targets
        Row of the work buffer for each result.
    spare
        First row that may be used for what one loop hands to the next.
    solvers
        Programs of the solvers of algebraic loops, by name.
    """
    printer = _Printer(program, places, spare, solvers or {})
    body = printer.loops(targets)
    vectors = [f"    {vector}_{i} = {vector}[{i}]" for vector, i in printer.vector_elements()]
    text = "\n".join([f"def {name}({arguments}):", *vectors, *body])
    return text, printer.spilled()


class _Printer:
    def __init__(
        self, program: Program, places: Mapping[str, Place], spare: int, solvers: Mapping[str, LoopPrograms]
    ) -> None:
        self._solvers = solvers
        self._scratch = 0
        self._program = program
        self._places = places
        self._spare = spare
        self._phase = _phases(program.operations)
        self._uses = Counter(a for operation in program.operations for a in operation.arguments)
        self._uses.update(program.results)
        self._users: dict[int, list[int]] = {}
        for i, operation in enumerate(program.operations):
            for argument in operation.arguments:
                self._users.setdefault(argument, []).append(i)
        self._rows: dict[tuple[int, int], int] = {}
        self._assign_rows()
        self._text: dict[int, str] = {}

    def vector_elements(self) -> list[tuple[str, int]]:
        """Elements of plain vectors that the program reads."""
        leaves = [op.value for op in self._program.operations if op.kind == "leaf"]
        found = [(self._places[vector], position) for vector, position in leaves]
        return [(place.vector, place.row + position) for place, position in found if place.vector]

    def spilled(self) -> int:
        """Spare rows used."""
        return len(self._rows) + self._scratch

    def loops(self, targets: Sequence[int]) -> list[str]:
        """Lines of all loops: for each phase one over smooth operations, then one for each that is not."""
        operations = self._program.operations
        stores = dict.fromkeys(zip(self._program.results, targets, strict=True))
        lines: list[str] = []
        # a result may be a rough operation of the last phase, which is read one phase later
        last = max([*self._phase, *(self._done(node) for node, _ in stores)], default=0)
        for phase in range(last + 1):
            self._text = {}
            here = [i for i, op in enumerate(operations) if self._phase[i] == phase and op.kind in _SMOOTH]
            body = [line for node in here for line in self._statement(node, phase)]
            for node in here:
                if self._is_handed_on(node, phase):
                    body.append(f"{element(self._row(node))} = {self._read(node, phase)}")
            ready = [(node, row) for node, row in stores if self._done(node) == phase]
            body += [f"{element(row)} = {self._read(node, phase)}" for node, row in ready]
            lines += _loop(body)
            self._text = {}  # after that loop its names hold the last lane's values: all that follows reads rows
            for i, operation in enumerate(operations):
                if self._phase[i] == phase and operation.kind not in _SMOOTH:
                    lines += self._rough(i, operation, phase)
        return lines or ["    pass"]

    def _done(self, node: int) -> int:
        """Phase in which a node can be read."""
        return self._phase[node] + (self._program.operations[node].kind not in _SMOOTH)

    def _assign_rows(self) -> None:
        """Rows for what outlives its loop."""
        for node, operation in enumerate(self._program.operations):
            if operation.kind == "solve":
                for k in range(operation.value[1]):
                    self._rows.setdefault((node, k), self._spare + len(self._rows))
            elif operation.kind != "item" and (
                operation.kind not in _SMOOTH or self._is_handed_on(node, self._phase[node])
            ):
                self._rows[node, 0] = self._spare + len(self._rows)

    def _row(self, node: int) -> int:
        operation = self._program.operations[node]
        if operation.kind == "item":
            return self._rows[operation.arguments[0], operation.value]
        return self._rows[node, 0]

    def _is_handed_on(self, node: int, phase: int) -> bool:
        operation = self._program.operations[node]
        if operation.kind in ("constant", "leaf", "item"):
            return False
        users = self._users.get(node, [])
        return any(self._phase[i] > phase or self._program.operations[i].kind not in _SMOOTH for i in users)

    def _read(self, node: int, phase: int) -> str:
        """Text by which a node is read in a loop of a phase."""
        operation = self._program.operations[node]
        if operation.kind == "constant":
            return _number(operation.value)
        if operation.kind == "leaf":
            vector, position = operation.value
            return self._places[vector].text(position)
        if node in self._text:
            return self._text[node]
        row = element(self._row(node))
        return f"({row} != 0.0)" if operation.kind in TRUTHS else row

    def _argument(self, node: int, phase: int) -> str:
        text = self._read(node, phase)
        return text if " " not in text or _ELEMENT.fullmatch(text) else f"({text})"

    def _statement(self, node: int, phase: int) -> list[str]:
        operation = self._program.operations[node]
        if operation.kind in ("constant", "leaf", "item"):
            return []
        arguments = [self._argument(a, phase) for a in operation.arguments]
        before, text = self._smooth(node, operation, arguments)
        nested = operation.kind in _NESTED and self._uses[node] == 1 and len(text) < _LONGEST
        if nested and self._consumer_nests(node, phase):
            self._text[node] = text
            return before
        name = self._name(node)
        self._text[node] = name
        return [*before, f"{name} = {text}"]

    def _consumer_nests(self, node: int, phase: int) -> bool:
        """Whether the one operation that uses a node is a line of the same loop that reads it once."""
        nesting = (*_NESTED, *_LANE_FUNCTIONS)
        users = self._users.get(node, [])
        return all(self._phase[i] == phase and self._program.operations[i].kind in nesting for i in users) and bool(
            users
        )

    def _name(self, node: int) -> str:
        stem = re.sub(r"\W", "", self._program.names.get(node, "")).strip("_")
        return f"{stem or 'v'}_{node}"

    def _smooth(self, node: int, operation: Operation, a: Sequence[str]) -> tuple[list[str], str]:
        kind = operation.kind
        if kind in _INFIX:
            return [], f"{a[0]} {_INFIX[kind]} {a[1]}"
        if kind == "neg":
            return [], f"-{a[0]}"
        if kind == "not":
            return [], f"not {a[0]}"
        if kind in _LANE_FUNCTIONS:
            return [], f"{_LANE_FUNCTIONS[kind]}({', '.join(map(_bare, a))})"
        if kind == "where":
            return [], f"{a[1]} if {a[0]} else {a[2]}"
        if kind in ("minimum", "maximum"):  # a where it is the chosen one or nan, as numpy does
            return (
                [],
                f"{a[0]} if ({a[0]} {'<=' if kind == 'minimum' else '>='} {a[1]}) | ({a[0]} != {a[0]}) else {a[1]}",
            )
        if kind == "sign":
            below = f"{self._name(node)}s"
            return [f"{below} = -1.0 if {a[0]} < 0.0 else {a[0]}"], f"1.0 if {a[0]} > 0.0 else {below}"
        if kind == "offset":
            return [], f"{a[0]} + {operation.value}"
        if kind == "gather":
            return [], f"{operation.value}[{', '.join(map(_bare, a))}]"
        return _search_lines(
            self._name(node), str(operation.value), self._program.arrays[str(operation.value)].size, a[0]
        )

    def _rough(self, node: int, operation: Operation, phase: int) -> list[str]:
        """Loops for an operation that is not one line of arithmetic."""
        arguments = [self._read(a, phase) for a in operation.arguments]
        if operation.kind == "solve":
            return self._solve(node, operation, arguments)
        return _loop([f"{element(self._row(node))} = np.{operation.kind}({', '.join(arguments)})"])

    def _solve(self, node: int, operation: Operation, arguments: Sequence[str]) -> list[str]:
        """Newton's method for all lanes together, until the last has settled."""
        name, unknowns = operation.value
        loop = self._solvers[name]
        results = [self._rows[node, k] for k in range(unknowns)]
        first = self._spare + len(self._rows)
        if loop.quick is None:
            return self._guarded(node, loop, arguments, results, first)
        # plain steps first: the unknowns, the size of the last step, the state of the lane, whether it goes on
        carried = [first + k for k in range(unknowns + 3)]
        size, mode = element(carried[unknowns]), element(carried[unknowns + 1])
        start = [f"{element(row)} = {arguments[k]}" for k, row in enumerate(carried[:unknowns])]
        before = _loop([*start, f"{size} = np.inf", f"{mode} = 1.0"])
        turns = self._iteration(f"quick_{node}", loop.quick, _QUICK_TURNS, carried, arguments, first + unknowns + 3)
        after = _loop([f"{element(row)} = {element(carried[k])}" for k, row in enumerate(results)])
        ask = [
            "    left = 0",
            "    for l in range(n):",
            f"        left |= np.int64({mode} != 0.0)",
            "    if left != 0:",
        ]
        solved = first + unknowns + 3
        rest = self._guarded(node, loop, arguments, [solved + k for k in range(unknowns)], solved + unknowns)
        chosen = [
            f"{element(row)} = {element(row)} if {mode} == 0.0 else {element(solved + k)}"
            for k, row in enumerate(results)
        ]
        return [*before, *turns, *after, *ask, *(f"    {line}" for line in [*rest, *_loop(chosen)])]

    def _guarded(
        self, node: int, loop: LoopPrograms, arguments: Sequence[str], results: Sequence[int], first: int
    ) -> list[str]:
        """The iteration of the module, with scratch rows from ``first`` on."""
        count = len(loop.start.results)
        carried = [first + k for k in range(count + 1)]
        before, after = (
            self._lines(part, rows, carried, arguments, first + count + 1)
            for part, rows in ((loop.start, carried[:-1]), (loop.end, results))
        )
        turns = self._iteration(f"moving_{node}", loop.turn, loop.limit, carried, arguments, first + count + 1)
        return [*before, *turns, *after]

    def _iteration(
        self, name: str, turn: Program, limit: int, carried: Sequence[int], arguments: Sequence[str], spare: int
    ) -> list[str]:
        """Turns until no lane goes on."""
        lines = self._lines(turn, carried, carried, arguments, spare)
        ask = [f"{name} = 0", "for l in range(n):", f"    {name} |= np.int64({element(carried[-1])})"]
        end = [f"if {name} == 0:", "    break"]
        return [
            f"    for _ in range({limit}):",
            *(f"    {line}" for line in lines),
            *(f"        {line}" for line in [*ask, *end]),
        ]

    def _lines(
        self, part: Program, rows: Sequence[int], carried: Sequence[int], arguments: Sequence[str], spare: int
    ) -> list[str]:
        """Loops of one part of an iteration."""
        places = {"argument": Place(texts=tuple(arguments)), "carried": Place(carried[0])}
        printer = _Printer(part, places, spare, {})
        lines = printer.loops(rows)
        self._scratch = max(self._scratch, spare + printer.spilled() - self._spare - len(self._rows))
        return lines


def _phases(operations: Sequence[Operation]) -> list[int]:
    """For each operation the number of loops that must have ended before it can run."""
    phases: list[int] = []
    for operation in operations:
        before = [phases[a] + (operations[a].kind not in _SMOOTH) for a in operation.arguments]
        phases.append(max(before, default=0))
    return phases


def _loop(body: Sequence[str]) -> list[str]:
    return ["    for l in range(n):", *(f"        {line}" for line in body)] if body else []


def _search_lines(name: str, array: str, size: int, a: str) -> tuple[list[str], str]:
    """A binary search with a fixed number of steps: how many knots are not above the argument."""
    lines = [f"{name}a = {a}", f"{name}i = 0"]
    step = 1
    while step * 2 <= size:
        step *= 2
    while step:
        index = f"{name}i + {step - 1}"
        lines.append(f"{name}k = min({index}, {size - 1})")
        lines.append(f"{name}i = {name}i + {step} if ({name}a >= {array}[{name}k]) & ({index} < {size}) else {name}i")
        step //= 2
    return lines, f"{name}i"


def _bare(text: str) -> str:
    """The text without parentheses around all of it."""
    if not text.startswith("(") or not text.endswith(")"):
        return text
    depth = 0
    for i, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return text[1:-1] if i == len(text) - 1 else text
    return text


def _number(value: object) -> str:
    number = float(str(value))
    if number != number:
        return "np.nan"
    if number in (float("inf"), float("-inf")):
        return "np.inf" if number > 0 else "(-np.inf)"
    return f"({number!r})" if number < 0 else repr(number)
