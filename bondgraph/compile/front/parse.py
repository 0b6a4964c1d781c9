"""Read the equations of a generated module into a tape, by running its text with operations in place of numbers.

Assignments, tables and other functions without loops are followed; a function with a loop (``_solve_...``, Newton's
method) stays one operation. Its residuals, by which it is differentiated, are the assignments in its loop up to
``_r0, _r1, ...``, see :func:`Reader.residuals`.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bondgraph.compile.ir.tape import FUNCTIONS, Tape
from bondgraph.errors import ModelError

#: A node, several, the numbers of a table, or the name of an input vector.
Value = int | tuple["Value", ...] | npt.NDArray[np.float64] | str

_OPERATORS: dict[type, str] = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div", ast.Pow: "power"}
_COMPARISONS: dict[type, str] = {
    ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge", ast.Eq: "eq", ast.NotEq: "ne",
}  # fmt: skip
_CONSTANTS = {"nan": float("nan"), "inf": float("inf"), "pi": float(np.pi), "e": float(np.e)}
_TRUTHS = ("lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not")


@dataclass(frozen=True)
class Solver:
    """A function of a module that solves an algebraic loop; its first arguments are guesses of the unknowns."""

    name: str
    function: ast.FunctionDef
    unknowns: int


class Reader:
    """Reads functions of one module into a tape.

    Parameters
    ----------
    tree
        The module, as :func:`bondgraph.compile.loader.parse_module` gives it.
    namespace
        What running it defined, for the numbers of its tables.
    tape
        Where operations go.
    """

    def __init__(self, tree: ast.Module, namespace: Mapping[str, Any], tape: Tape) -> None:
        self.tape = tape
        self._functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
        self._arrays = {name: value for name, value in namespace.items() if isinstance(value, np.ndarray)}
        self._numbers = {name: value for name, value in namespace.items() if isinstance(value, float | int)}
        self.solvers = {
            name: Solver(name, function, _count_returned(function))
            for name, function in self._functions.items()
            if _has_loop(function) and name != "_stack"
        }

    def has(self, name: str) -> bool:
        """True for a function that the module has."""
        return name in self._functions

    def equations(self, name: str) -> tuple[int, ...]:
        """Nodes of the rows that ``rhs``, ``output`` or ``start`` returns.

        Raises
        ------
        ModelError
            If the text holds a form that is not followed.
        """
        arguments: list[Value] = [self.tape.leaf("t", 0), "x", "u", "theta"]
        result = self._call(self._functions[name], arguments)
        rows = result if isinstance(result, tuple) else (result,)
        return tuple(self._node(row) for row in rows)

    def residuals(self, solver: Solver, unknowns: Sequence[int], quantities: Sequence[int]) -> tuple[int, ...]:
        """Residuals of a loop at given unknowns and quantities, as nodes.

        Raises
        ------
        ModelError
            If the function does not name its residuals.
        """
        names = [argument.arg for argument in solver.function.args.args]
        environment: dict[str, Value] = dict(zip(names, [*unknowns, *quantities], strict=True))
        wanted = [f"_r{k}" for k in range(solver.unknowns)]
        loop = next(node for node in solver.function.body if isinstance(node, ast.For | ast.While))
        for statement in loop.body:
            self.follow([statement], environment)
            if all(name in environment for name in wanted):
                return tuple(self._node(environment[name]) for name in wanted)
        raise ModelError(
            f"{solver.name}: the loop does not name its residuals {', '.join(wanted)} - regenerate the module",
            where=(solver.name,),
        )

    # ------------------------------------------------------------------ statements

    def _call(self, function: ast.FunctionDef, arguments: Sequence[Value]) -> Value:
        names = [argument.arg for argument in function.args.args]
        environment: dict[str, Value] = dict(zip(names, arguments, strict=True))
        result = self.follow(function.body, environment)
        if result is None:
            raise self._unknown(function, "a function without a value")
        return result

    def follow(self, body: Iterable[ast.stmt], environment: dict[str, Value]) -> Value | None:
        """Run assignments, changing the environment; the value of a return."""
        for statement in body:
            if isinstance(statement, ast.Return) and statement.value is not None:
                return self._value(statement.value, environment)
            if isinstance(statement, ast.Assign):
                self._assign(statement.targets[0], self._value(statement.value, environment), environment)
            elif not (isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)):
                raise self._unknown(statement, "a statement that is not followed")
        return None

    def _assign(self, target: ast.expr, value: Value, environment: dict[str, Value]) -> None:
        if isinstance(target, ast.Name):
            environment[target.id] = value
            if isinstance(value, int) and self.tape.operations[value].kind not in ("constant", "leaf"):
                self.tape.names.setdefault(value, target.id)
            return
        if isinstance(target, ast.Tuple):
            if isinstance(value, str):
                value = tuple(self.tape.leaf(value, k) for k in range(len(target.elts)))
            if isinstance(value, tuple):
                for name, part in zip(target.elts, value, strict=True):
                    self._assign(name, part, environment)
                return
        raise self._unknown(target, "an assignment that is not followed")

    # ------------------------------------------------------------------ expressions

    def expression(self, node: ast.expr, environment: Mapping[str, Value]) -> int:
        """The node of an expression in an environment."""
        return self._node(self._value(node, environment))

    def _value(self, node: ast.expr, environment: Mapping[str, Value]) -> Value:
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            return self.tape.constant(float(node.value))
        if isinstance(node, ast.Name):
            return self._named(node, environment)
        if isinstance(node, ast.Attribute) and node.attr in _CONSTANTS:
            return self.tape.constant(_CONSTANTS[node.attr])
        if isinstance(node, ast.Tuple | ast.List):
            return tuple(self._value(part, environment) for part in node.elts)
        if isinstance(node, ast.UnaryOp | ast.BinOp):
            return self._operator(node, environment)
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            left, right = (self._node(self._value(side, environment)) for side in (node.left, node.comparators[0]))
            return self.tape.compare(_COMPARISONS[type(node.ops[0])], left, right)
        if isinstance(node, ast.Subscript):
            return self._element(node, environment)
        if isinstance(node, ast.Call):
            return self._called(node, environment)
        raise self._unknown(node, "an expression that is not followed")

    def _named(self, node: ast.Name, environment: Mapping[str, Value]) -> Value:
        if node.id in environment:
            return environment[node.id]
        if node.id in self._arrays:
            array: npt.NDArray[np.float64] = np.asarray(self._arrays[node.id], dtype=np.float64)
            return array
        if node.id in self._numbers:
            return self.tape.constant(float(self._numbers[node.id]))
        raise self._unknown(node, "a name that is not known")

    def _operator(self, node: ast.UnaryOp | ast.BinOp, environment: Mapping[str, Value]) -> Value:
        if isinstance(node, ast.UnaryOp):
            operand = self._node(self._value(node.operand, environment))
            if isinstance(node.op, ast.Invert | ast.Not):
                return self.tape.logic("not", operand)
            return self.tape.neg(operand) if isinstance(node.op, ast.USub) else operand
        left, right = (self._node(self._value(side, environment)) for side in (node.left, node.right))
        if isinstance(node.op, ast.BitAnd | ast.BitOr):
            return self.tape.logic("and" if isinstance(node.op, ast.BitAnd) else "or", left, right)
        if self.tape.operations[left].kind in ("search", "offset") and isinstance(node.right, ast.Constant):
            step = int(node.right.value)  # type: ignore[arg-type]
            return self.tape.offset(left, -step if isinstance(node.op, ast.Sub) else step)
        operation: Callable[[int, int], int] = getattr(self.tape, _OPERATORS[type(node.op)])
        return operation(left, right)

    def _element(self, node: ast.Subscript, environment: Mapping[str, Value]) -> Value:
        owner = self._value(node.value, environment)
        if isinstance(owner, str) and isinstance(node.slice, ast.Constant):
            return self.tape.leaf(owner, int(node.slice.value))  # type: ignore[arg-type]
        if not isinstance(owner, np.ndarray):
            raise self._unknown(node, "an element that is not followed")
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        fixed = [_fixed_index(part) for part in parts]
        if None not in fixed:
            chosen = owner[tuple(fixed)]
            return chosen if isinstance(chosen, np.ndarray) else self.tape.constant(float(chosen))
        indices = [self._node(self._value(part, environment)) for part in parts]
        return self.tape.gather(self.tape.array(owner), *indices)

    def _called(self, node: ast.Call, environment: Mapping[str, Value]) -> Value:
        if isinstance(node.func, ast.Name):
            return self._own(node, node.func.id, environment)
        name = node.func.attr if isinstance(node.func, ast.Attribute) else ""
        arguments = [self._value(argument, environment) for argument in node.args]
        right = [ast.unparse(keyword) for keyword in node.keywords] == ["side='right'"]
        if name == "searchsorted" and right and isinstance(arguments[0], np.ndarray):
            return self.tape.search(self.tape.array(arguments[0]), self._node(arguments[1]))
        if name == "broadcast_arrays":
            return tuple(arguments)
        rewrite = _REWRITES.get(name)
        nodes = [argument for argument in arguments if isinstance(argument, int)]
        if rewrite is None or len(nodes) != len(arguments):
            raise self._unknown(node, "a call that is not followed")
        return rewrite(self.tape, nodes)

    def _own(self, node: ast.Call, name: str, environment: Mapping[str, Value]) -> Value:
        arguments = [self._value(argument, environment) for argument in node.args]
        if name == "_stack":
            return arguments[-1]
        if name in self.solvers:
            solver = self.solvers[name]
            nodes = self.tape.solve(name, [self._node(argument) for argument in arguments], solver.unknowns)
            return nodes if solver.unknowns > 1 else nodes[0]
        if name in self._functions:
            return self._call(self._functions[name], arguments)
        raise self._unknown(node, "a function that is not in the module")

    def _node(self, value: Value) -> int:
        if isinstance(value, int):
            return value
        raise ModelError(f"generated module: {type(value).__name__} stands where one number is needed - regenerate it")

    def _unknown(self, node: ast.AST, problem: str) -> ModelError:
        text = ast.unparse(node).splitlines()[0] if not isinstance(node, ast.FunctionDef) else node.name
        return ModelError(f"generated module: {text!r} is {problem} - regenerate it", where=(text,))


def _has_loop(function: ast.FunctionDef) -> bool:
    return any(isinstance(node, ast.For | ast.While) for node in ast.walk(function))


def _count_returned(function: ast.FunctionDef) -> int:
    returned = [node.value for node in ast.walk(function) if isinstance(node, ast.Return)]
    return len(returned[-1].elts) if returned and isinstance(returned[-1], ast.Tuple) else 1


def _fixed_index(node: ast.expr | None) -> int | slice | None:
    """A whole number or a slice of whole numbers; None for an index that is computed."""
    if isinstance(node, ast.Slice):
        lower, upper = (None if bound is None else _fixed_index(bound) for bound in (node.lower, node.upper))
        return slice(lower, upper)
    try:
        value = ast.literal_eval(node) if node is not None else None
    except ValueError:
        return None
    return value if isinstance(value, int) else None


def _logic(kind: str) -> Callable[[Tape, list[int]], int]:
    return lambda tape, nodes: tape.logic(kind, *nodes)


def _function(name: str) -> Callable[[Tape, list[int]], int]:
    return lambda tape, nodes: tape.function(name, *nodes)


_REWRITES: dict[str, Callable[[Tape, list[int]], int]] = {
    **{name: _function(name) for name in (*FUNCTIONS, "minimum", "maximum", "arctan2")},
    "where": lambda tape, nodes: tape.where(*nodes),
    "clip": lambda tape, nodes: tape.function("minimum", tape.function("maximum", nodes[0], nodes[1]), nodes[2]),
    "asarray": lambda tape, nodes: nodes[0],
    "array": lambda tape, nodes: nodes[0],
    "float64": lambda tape, nodes: nodes[0],
    "zeros_like": lambda tape, nodes: tape.constant(0.0),
    "ones_like": lambda tape, nodes: tape.constant(1.0),
    "full_like": lambda tape, nodes: nodes[1],
    "logical_and": _logic("and"),
    "logical_or": _logic("or"),
    "logical_not": _logic("not"),
}
