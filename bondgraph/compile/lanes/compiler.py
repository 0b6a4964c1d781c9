"""Compiles printed loops over lanes: straight from their text to LLVM instructions (imported only where numba is).

numba could compile the same text, but it would infer a type for each of thousands of variables and give each a place in
memory, which takes several times as long as all that LLVM does afterwards. The printed functions need none of it: they
consist of few kinds of statements (see ``lanes.text``), and every value in them is a float, an integer or a truth value
by its form. Each becomes a numba intrinsic, which other compiled functions call as they call each other.

- A name is the value it was given last; only what loops change (``x |= ...``) has a place in memory.
- ``a if c else b`` selects, and both sides are worked out: without branches loops become SIMD code.
- ``range(n)`` is rounded up to whole vectors, so that no loop for a rest is made; the work buffer has room for them.
- The vectors a function is called with must not overlap, so that loops need no checks of whether they do.
- Functions printed beside (``lanes.math``) are put in where they are called; what else is called is numba's.
"""

from __future__ import annotations

import ast
import builtins
import functools
import inspect
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numba.extending import intrinsic

from bondgraph.compile.numba_internals import cgutils, ir, types
from bondgraph.errors import ModelError

_FLOAT, _INTEGER = ir.DoubleType(), ir.IntType(64)
#: Instructions for floats, and for integers and truth values.
_ARITHMETIC = {
    ast.Add: ("fadd", "add"), ast.Sub: ("fsub", "sub"), ast.Mult: ("fmul", "mul"), ast.Div: ("fdiv", ""),
    ast.BitAnd: ("", "and_"), ast.BitOr: ("", "or_"), ast.LShift: ("", "shl"),
}  # fmt: skip
_COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
#: Functions of one number that LLVM has itself.
_INTRINSICS = {abs: "llvm.fabs", math.sqrt: "llvm.sqrt", np.floor: "llvm.floor"}
#: Floats in the longest vector of a processor.
_VECTOR = 8


def lane_loops(function: Callable[..., None]) -> Any:
    """A printed function as an intrinsic that compiled functions call; its arguments are float vectors and integers.

    Raises
    ------
    ModelError
        If the function has other statements than are printed; when it is compiled first.

    Examples
    --------
    >>> from numba import njit
    >>> @lane_loops
    ... def double(w, n):
    ...     for l in range(n):
    ...         w[8 + l] = 2.0*w[0 + l]
    >>> w = np.arange(16.0)
    >>> njit(lambda w, n: double(w, n))(w, 8)
    >>> w[8:]
    array([ 0.,  2.,  4.,  6.,  8., 10., 12., 14.])
    """

    def define(typing_context: Any, *arguments: Any) -> Any:
        return types.void(*arguments), functools.partial(_call, function)

    own = inspect.signature(function)
    first = inspect.Parameter("typing_context", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    define.__name__ = function.__name__
    define.__signature__ = own.replace(parameters=[first, *own.parameters.values()])  # type: ignore[attr-defined]
    return intrinsic(define)


def _call(function: Callable[..., None], context: Any, builder: Any, signature: Any, arguments: Sequence[Any]) -> Any:
    """Call the function; it stands once in each module of LLVM code."""
    given = [
        context.make_array(kind)(context, builder, value).data if isinstance(kind, types.Array) else value
        for kind, value in zip(signature.args, arguments, strict=True)
    ]
    name = f"lanes.{function.__name__}"
    if name not in builder.module.globals:
        kind = ir.FunctionType(ir.VoidType(), [value.type for value in given])
        _write(function, ir.Function(builder.module, kind, name), context)
    builder.call(builder.module.globals[name], given)
    return context.get_dummy_value()


def _write(function: Callable[..., None], body: Any, context: Any) -> None:
    """Write the instructions of a function."""
    body.linkage = "internal"
    body.attributes.add("noinline")
    for argument in body.args:
        if isinstance(argument.type, ir.PointerType):
            argument.add_attribute("noalias")
    builder = ir.IRBuilder(body.append_basic_block("entry"))
    tree = _parsed(function)
    changed = {ast.unparse(node.target) for node in ast.walk(tree) if isinstance(node, ast.AugAssign)}
    places = {name: builder.alloca(_INTEGER, name=name) for name in sorted(changed)}
    names = {argument.arg: value for argument, value in zip(tree.args.args, body.args, strict=True)}
    _Body(context, builder, function.__globals__, names, places).run(tree.body)
    builder.ret_void()


@functools.cache
def _parsed(function: Callable[..., Any]) -> ast.FunctionDef:
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
    assert isinstance(tree, ast.FunctionDef)
    return tree


class _Body:
    """Writes the instructions of one function body, statement by statement."""

    def __init__(
        self, context: Any, builder: Any, scope: Mapping[str, Any], names: dict[str, Any], places: Mapping[str, Any]
    ) -> None:
        self._context = context
        self._builder = builder
        self._scope = scope
        self._names = names
        self._places = places
        self._loops: list[Any] = []

    def run(self, statements: Sequence[ast.stmt]) -> Any:
        """Write statements; the value they return, if they do."""
        for statement in statements:
            if isinstance(statement, ast.Return):
                return self.value(statement.value)
            self._statement(statement)
        return None

    def _statement(self, node: ast.stmt) -> None:
        if isinstance(node, ast.Assign):
            self._assign(node.targets[0], node.value)
        elif isinstance(node, ast.AnnAssign):
            self._assign(node.target, node.value)
        elif isinstance(node, ast.AugAssign):
            place = self._places[ast.unparse(node.target)]
            changed = self._arithmetic(node.op, self._builder.load(place), self.value(node.value))
            self._builder.store(changed, place)
        elif isinstance(node, ast.For) and isinstance(node.iter, ast.Call) and isinstance(node.target, ast.Name):
            with cgutils.for_range(self._builder, self._turns(self.value(node.iter.args[0]))) as loop:
                self._names[node.target.id] = loop.index
                self._loops.append(loop)
                self.run(node.body)
                self._loops.pop()
        elif isinstance(node, ast.If) and not node.orelse:
            with self._builder.if_then(self.value(node.test)):
                self.run(node.body)
        elif isinstance(node, ast.Break):
            self._loops[-1].do_break()
        elif not isinstance(node, ast.Pass | ast.Expr):
            raise _refused(node)

    def _turns(self, count: Any) -> Any:
        """A count of lanes as whole vectors; one that is written out as it is."""
        if isinstance(count, ir.Constant):
            return count
        up = self._builder.add(count, ir.Constant(_INTEGER, _VECTOR - 1))
        vectors = self._builder.sdiv(up, ir.Constant(_INTEGER, _VECTOR))
        return self._builder.mul(vectors, ir.Constant(_INTEGER, _VECTOR), flags=("nsw",))

    def _assign(self, target: ast.expr, node: ast.expr | None) -> None:
        if isinstance(target, ast.Tuple) and isinstance(node, ast.Tuple):
            found = [self.value(part) for part in node.elts]
            self._names.update(zip(map(ast.unparse, target.elts), found, strict=True))
            return
        value = self.value(node)
        if isinstance(target, ast.Subscript):
            truth = value.type == ir.IntType(1)
            self._builder.store(self._builder.uitofp(value, _FLOAT) if truth else value, self._element(target))
        elif isinstance(target, ast.Name) and target.id in self._places:
            self._builder.store(value, self._places[target.id])
        elif isinstance(target, ast.Name):
            self._names[target.id] = value
        else:
            raise _refused(target)

    def value(self, node: ast.expr | None) -> Any:
        """The value of an expression."""
        builder = self._builder
        if isinstance(node, ast.Constant):
            return ir.Constant(_INTEGER if isinstance(node.value, int) else _FLOAT, node.value)
        if isinstance(node, ast.Name):
            return builder.load(self._places[node.id]) if node.id in self._places else self._names[node.id]
        if isinstance(node, ast.Attribute):
            return ir.Constant(_FLOAT, self._global(node))
        if isinstance(node, ast.Subscript):
            return builder.load(self._element(node))
        if isinstance(node, ast.BinOp):
            return self._arithmetic(node.op, self.value(node.left), self.value(node.right))
        if isinstance(node, ast.UnaryOp):
            inner = self.value(node.operand)
            return builder.fneg(inner) if isinstance(node.op, ast.USub) else builder.not_(inner)
        if isinstance(node, ast.Compare):
            sides = self.value(node.left), self.value(node.comparators[0])
            return self._compare(_COMPARISONS[type(node.ops[0])], *sides)
        if isinstance(node, ast.IfExp):
            return builder.select(self.value(node.test), self.value(node.body), self.value(node.orelse))
        if isinstance(node, ast.Call):
            return self._called(node)
        raise _refused(node)

    def _arithmetic(self, kind: ast.operator, left: Any, right: Any) -> Any:
        name = _ARITHMETIC[type(kind)][left.type != _FLOAT]
        return getattr(self._builder, name)(left, right)

    def _compare(self, kind: str, left: Any, right: Any) -> Any:
        if left.type != _FLOAT:
            return self._builder.icmp_signed(kind, left, right)
        return (self._builder.fcmp_unordered if kind == "!=" else self._builder.fcmp_ordered)(kind, left, right)

    def _element(self, node: ast.Subscript) -> Any:
        """Where an element of a vector or of a table is."""
        builder, owner = self._builder, ast.unparse(node.value)
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        first, *others = [self.value(index) for index in indices]
        if owner in self._names:
            return builder.gep(self._names[owner], [first], inbounds=True)
        table = self._global(node.value)
        for size, index in zip(table.shape[1:], others, strict=True):
            first = builder.add(builder.mul(first, ir.Constant(_INTEGER, size)), index)
        name = f"table.{owner}"
        if name not in builder.module.globals:
            kept = ir.GlobalVariable(builder.module, ir.ArrayType(_FLOAT, table.size), name)
            kept.linkage, kept.global_constant = "internal", True
            kept.initializer = ir.Constant(kept.value_type, [ir.Constant(_FLOAT, float(v)) for v in table.flat])
        return builder.gep(builder.module.globals[name], [ir.Constant(_INTEGER, 0), first], inbounds=True)

    def _called(self, node: ast.Call) -> Any:
        builder = self._builder
        if isinstance(node.func, ast.Attribute) and node.func.attr == "view":  # the bits of an integer as a float
            return builder.bitcast(self.value(node.func.value), _FLOAT)
        function = self._global(node.func)
        given = [self.value(argument) for argument in node.args]
        if function is np.int64:
            return builder.fptosi(given[0], _INTEGER) if given[0].type == _FLOAT else builder.zext(given[0], _INTEGER)
        if function is min:
            return builder.select(self._compare("<=", *given), *given)
        if function in _INTRINSICS:
            return builder.call(builder.module.declare_intrinsic(_INTRINSICS[function], [_FLOAT]), given)
        if inspect.isfunction(function):
            tree = _parsed(function)
            names = {argument.arg: value for argument, value in zip(tree.args.args, given, strict=True)}
            return _Body(self._context, builder, function.__globals__, names, {}).run(tree.body)
        typing_context = self._context.typing_context
        kind = typing_context.resolve_value_type(function)
        signature = kind.get_call_type(typing_context, (types.float64,) * len(given), {})
        return self._context.get_function(kind, signature)(builder, given)

    def _global(self, node: ast.expr) -> Any:
        """What a name outside of the function stands for."""
        if isinstance(node, ast.Attribute):
            return getattr(self._global(node.value), node.attr)
        if isinstance(node, ast.Name):
            return self._scope[node.id] if node.id in self._scope else getattr(builtins, node.id)
        raise _refused(node)


def _refused(node: ast.AST | None) -> ModelError:
    text = ast.unparse(node) if node is not None else "return"
    return ModelError(f"{text!r} cannot be compiled for lanes - regenerate the module", where=(text,))
