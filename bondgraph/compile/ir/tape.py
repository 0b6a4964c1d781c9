"""Programs: the equations of a generated module as a list of elementary operations.

Each operation uses only earlier ones, so the list is an order of computation. A :class:`Tape` grows such a list and
keeps it small: equal operations are stored once (common subexpressions), constants are computed, and what is zero by
structure disappears. A :class:`Program` is a finished, immutable list with its results.

    kind                     arguments           value
    constant                                     the number
    leaf                                         (vector, position): x, u, theta, t, or a vector of derivatives' seeds
    add sub mul div pow neg  one or two numbers
    functions, see FUNCTIONS numbers
    lt le gt ge eq ne        two numbers         (result: a truth value)
    and or not               truth values
    where                    condition, a, b
    search                   number              key of an array: how many of its knots are not above the number
    offset                   index               integer added to it
    gather                   one or two indices  key of the array to read
    solve                    guesses, quantities (name of the function that solves an algebraic loop, its unknowns)
    item                     solve               position of the unknown
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

#: Functions of one number, with their form in Python's ``math`` for constants.
FUNCTIONS: dict[str, Callable[[float], float]] = {
    "tanh": math.tanh, "sin": math.sin, "cos": math.cos, "tan": math.tan, "arcsin": math.asin, "arccos": math.acos,
    "arctan": math.atan, "sinh": math.sinh, "cosh": math.cosh, "arcsinh": math.asinh, "arccosh": math.acosh,
    "arctanh": math.atanh, "exp": math.exp, "log": math.log, "sqrt": math.sqrt, "abs": abs, "floor": math.floor,
    "sign": lambda value: math.copysign(1.0, value) if value else 0.0,
}  # fmt: skip

_BINARY: dict[str, Callable[[float, float], float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "pow": lambda a, b: float(a**b),
    "minimum": min,
    "maximum": max,
    "arctan2": math.atan2,
}

#: Kinds whose result is a truth value.
TRUTHS = ("lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not")

COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "lt": lambda a, b: a < b, "le": lambda a, b: a <= b, "gt": lambda a, b: a > b,
    "ge": lambda a, b: a >= b, "eq": lambda a, b: a == b, "ne": lambda a, b: a != b,
}  # fmt: skip

_COMMUTATIVE = ("add", "mul", "minimum", "maximum", "and", "or")


@dataclass(frozen=True, slots=True)
class Operation:
    """One step of a program; ``arguments`` are positions of earlier steps."""

    kind: str
    arguments: tuple[int, ...] = ()
    value: Any = None


@dataclass(frozen=True)
class Program:
    """Operations in an order of computation, and the positions of the results.

    ``arrays`` holds the tables' numbers by key, ``names`` suggests what operations are called in printed text.
    """

    operations: tuple[Operation, ...]
    results: tuple[int, ...]
    arrays: Mapping[str, npt.NDArray[np.float64]] = field(repr=False)
    names: Mapping[int, str] = field(repr=False)

    def count(self) -> int:
        """Operations that compute something."""
        return sum(operation.kind not in ("constant", "leaf", "item") for operation in self.operations)


class Tape:
    """A growing list of operations in which equal ones are stored once.

    Examples
    --------
    >>> tape = Tape()
    >>> x = tape.leaf("x", 0)
    >>> tape.add(tape.mul(x, 0.0), tape.mul(2.0, x)) == tape.mul(x, 2.0)
    True
    >>> tape.program([tape.mul(x, x)]).operations
    (Operation(kind='leaf', arguments=(), value=('x', 0)), Operation(kind='mul', arguments=(0, 0), value=None))
    """

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self.arrays: dict[str, npt.NDArray[np.float64]] = {}
        self.names: dict[int, str] = {}
        self._known: dict[tuple[Hashable, ...], int] = {}

    # ------------------------------------------------------------------ leaves

    def constant(self, value: float) -> int:
        """A number."""
        number = float(value)
        return self._store(Operation("constant", (), number), (math.copysign(1.0, number), repr(number)))

    def leaf(self, vector: str, position: int) -> int:
        """An element of an input of the program."""
        return self._store(Operation("leaf", (), (vector, position)))

    def array(self, values: npt.ArrayLike) -> str:
        """Keep the numbers of a table; the key by which operations name them."""
        numbers = np.ascontiguousarray(values, dtype=np.float64)
        content = repr(numbers.shape).encode() + numbers.tobytes()
        key = f"table_{hashlib.sha256(content).hexdigest()[:10]}"
        self.arrays[key] = numbers
        return key

    # ------------------------------------------------------------------ arithmetic

    def add(self, a: int | float, b: int | float) -> int:
        """Sum."""
        a, b = self._node(a), self._node(b)
        if self._is(a, 0.0):
            return b
        if self._is(b, 0.0):
            return a
        if self.operations[b].kind == "neg":
            return self.sub(a, self.operations[b].arguments[0])
        if self.operations[a].kind == "neg":
            return self.sub(b, self.operations[a].arguments[0])
        return self._binary("add", a, b)

    def sub(self, a: int | float, b: int | float) -> int:
        """Difference."""
        a, b = self._node(a), self._node(b)
        if self._is(b, 0.0):
            return a
        if self._is(a, 0.0):
            return self.neg(b)
        if a == b:
            return self.constant(0.0)
        if self.operations[b].kind == "neg":
            return self.add(a, self.operations[b].arguments[0])
        return self._binary("sub", a, b)

    def neg(self, a: int | float) -> int:
        """-a."""
        a = self._node(a)
        operation = self.operations[a]
        if operation.kind == "constant":
            return self.constant(-self._number(a))
        if operation.kind == "neg":
            return operation.arguments[0]
        if operation.kind == "sub":
            return self.sub(operation.arguments[1], operation.arguments[0])
        return self._store(Operation("neg", (a,)))

    def mul(self, a: int | float, b: int | float) -> int:
        """Product; with a structural zero it is zero."""
        a, b = self._node(a), self._node(b)
        for one, other in ((a, b), (b, a)):
            if self._is(one, 0.0):
                return self.constant(0.0)
            if self._is(one, 1.0):
                return other
            if self._is(one, -1.0):
                return self.neg(other)
            if self.operations[one].kind == "neg":
                return self.neg(self.mul(self.operations[one].arguments[0], other))
        return self._binary("mul", a, b)

    def div(self, a: int | float, b: int | float) -> int:
        """Quotient."""
        a, b = self._node(a), self._node(b)
        if self._is(a, 0.0) and not self._is(b, 0.0):
            return a
        if self._is(b, 1.0):
            return a
        if self.operations[a].kind == "neg":
            return self.neg(self.div(self.operations[a].arguments[0], b))
        return self._binary("div", a, b)

    def power(self, a: int | float, b: int | float) -> int:
        """Power; small whole exponents become products."""
        a, b = self._node(a), self._node(b)
        if self.operations[b].kind != "constant" or self.operations[a].kind == "constant":
            return self._binary("pow", a, b)
        exponent = self._number(b)
        if exponent == 0.5:
            return self.function("sqrt", a)
        if not exponent.is_integer() or abs(exponent) > 8:
            return self._binary("pow", a, b)
        if exponent < 0:
            return self.div(1.0, self.power(a, -exponent))
        result = self.constant(1.0)
        for bit in f"{int(exponent):b}":
            result = self.mul(result, result)
            if bit == "1":
                result = self.mul(result, a)
        return result

    # ------------------------------------------------------------------ functions and choices

    def function(self, name: str, *arguments: int) -> int:
        """A function of FUNCTIONS, ``minimum``, ``maximum`` or ``arctan2``."""
        if len(arguments) == 2:
            return (
                arguments[0] if arguments[0] == arguments[1] and name != "arctan2" else self._binary(name, *arguments)
            )
        (a,) = arguments
        if self.operations[a].kind == "constant":
            folded = _quiet(FUNCTIONS[name], self._number(a))
            if folded is not None:
                return self.constant(folded)
        return self._store(Operation(name, (a,)))

    def compare(self, kind: str, a: int | float, b: int | float) -> int:
        """A truth value."""
        return self._store(Operation(kind, (self._node(a), self._node(b))))

    def logic(self, kind: str, *arguments: int) -> int:
        """``and``, ``or``, ``not`` of truth values."""
        return self._store(Operation(kind, tuple(sorted(arguments))))

    def where(self, condition: int, a: int | float, b: int | float) -> int:
        """The first number where the condition holds, else the second."""
        a, b = self._node(a), self._node(b)
        if a == b:
            return a
        return self._store(Operation("where", (condition, a, b)))

    def as_number(self, node: int) -> int:
        """1 or 0 for a truth value, so that it can be kept in a vector; any other node as it is."""
        return self.where(node, 1.0, 0.0) if self.operations[node].kind in TRUTHS else node

    def as_kept(self, node: int, number: int) -> int:
        """The number that stands for a node, as that node: a truth value again where it was one."""
        return self.compare("ne", number, 0.0) if self.operations[node].kind in TRUTHS else number

    def search(self, knots: str, a: int) -> int:
        """How many of the increasing numbers of an array are not above a: an index."""
        return self._store(Operation("search", (a,), knots))

    def offset(self, index: int, by: int) -> int:
        """An index plus a whole number."""
        return index if by == 0 else self._store(Operation("offset", (index,), by))

    def gather(self, array: str, *indices: int) -> int:
        """The element of an array at one or two indices."""
        return self._store(Operation("gather", indices, array))

    def solve(self, solver: str, arguments: Iterable[int], unknowns: int) -> tuple[int, ...]:
        """The unknowns of an algebraic loop."""
        call = self._store(Operation("solve", tuple(arguments), (solver, unknowns)))
        return tuple(self._store(Operation("item", (call,), k)) for k in range(unknowns))

    def emit(self, operation: Operation, arguments: Sequence[int]) -> int:
        """The same operation on other arguments."""
        kind = operation.kind
        if kind == "pow":
            return self.power(*arguments)
        if kind in ("add", "sub", "mul", "div", "neg", "where"):
            made: int = getattr(self, kind)(*arguments)
            return made
        if kind in FUNCTIONS or kind in _BINARY:
            return self.function(kind, *arguments)
        return self._store(Operation(kind, tuple(arguments), operation.value))

    # ------------------------------------------------------------------ results

    def is_zero(self, node: int) -> bool:
        """Whether a node is zero by structure."""
        return self._is(node, 0.0)

    def program(self, results: Iterable[int]) -> Program:
        """What the results need and nothing else, renumbered."""
        listed = list(results)
        needed = reachable(self.operations, listed)
        position = {node: i for i, node in enumerate(needed)}
        operations = tuple(
            Operation(op.kind, tuple(position[a] for a in op.arguments), op.value)
            for op in (self.operations[node] for node in needed)
        )
        used = {op.value for op in operations if op.kind in ("search", "gather")}
        arrays = {key: values for key, values in self.arrays.items() if key in used}
        names = {position[node]: name for node, name in self.names.items() if node in position}
        return Program(operations, tuple(position[node] for node in listed), arrays, names)

    def _binary(self, kind: str, a: int, b: int) -> int:
        if self.operations[a].kind == self.operations[b].kind == "constant":
            folded = _quiet(_BINARY[kind], self._number(a), self._number(b))
            if folded is not None:
                return self.constant(folded)
        ordered = (min(a, b), max(a, b)) if kind in _COMMUTATIVE else (a, b)
        return self._store(Operation(kind, ordered))

    def _store(self, operation: Operation, key: tuple[Hashable, ...] = ()) -> int:
        known = (operation.kind, operation.arguments, key or operation.value)
        if known not in self._known:
            self._known[known] = len(self.operations)
            self.operations.append(operation)
        return self._known[known]

    def _node(self, value: int | float) -> int:
        """Nodes are whole numbers, plain numbers are floats."""
        return self.constant(value) if isinstance(value, float) else value

    def _number(self, node: int) -> float:
        value = self.operations[node].value
        return value if isinstance(value, float) else math.nan

    def _is(self, node: int, value: float) -> bool:
        return self.operations[node].kind == "constant" and self._number(node) == value


def reachable(operations: list[Operation], results: Iterable[int], stop: Iterable[int] = ()) -> list[int]:
    """Positions of all that the results need, in order, without looking behind ``stop``."""
    ends = set(stop)
    found: set[int] = set()
    waiting = list(results)
    while waiting:
        node = waiting.pop()
        if node in found:
            continue
        found.add(node)
        if node not in ends:
            waiting.extend(operations[node].arguments)
    return sorted(found)


def _quiet(function: Callable[..., float], *arguments: float) -> float | None:
    """A constant, or None where Python refuses what numpy would call nan or inf."""
    try:
        value = function(*arguments)
    except (ArithmeticError, ValueError):
        return None
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
