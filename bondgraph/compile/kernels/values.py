"""Values of a kernel's text and the instructions that work them out (imports numba); see ``compiler``."""

from __future__ import annotations

import ast
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from bondgraph.compile.kernels.arguments import Fields, Function, Kind, Number, Numbers, width
from bondgraph.compile.lanes.compiler import C_NAMES
from bondgraph.compile.lanes.instructions import FLOAT, INTEGER, TRUTH, Instructions
from bondgraph.compile.numba_internals import callback_array, ir, value_type
from bondgraph.errors import ModelError

#: Functions of one number that LLVM has itself.
_INTRINSICS = {"math.sqrt": "llvm.sqrt", "math.log": "llvm.log", "abs": "llvm.fabs"}


@dataclass(frozen=True)
class Array:
    """An array: where it begins, its lengths, and the names by which the function came to it."""

    data: Any
    lengths: tuple[Any, ...]
    path: tuple[str, ...]


@dataclass(frozen=True)
class Record:
    """A record: its kind, where its words begin, and the names by which the function came to it."""

    kind: Fields
    words: Any
    path: tuple[str, ...]


@dataclass(frozen=True)
class Callback:
    """A compiled function of others."""

    kind: Function
    address: Any


def loaded(builder: Any, words: Any, place: int, kind: Kind, path: tuple[str, ...]) -> Any:
    """A value from its words, which do not change while the kernel runs."""
    here = builder.gep(words, [ir.Constant(INTEGER, place)], inbounds=True) if place else words
    if isinstance(kind, Fields):
        return Record(kind, here, path)

    def load(at: Any) -> Any:
        word = builder.load(at)
        word.set_metadata("invariant.load", builder.module.add_metadata([]))
        return word

    first = load(here)
    if isinstance(kind, Function):
        return Callback(kind, first)
    if isinstance(kind, Number):
        return builder.bitcast(first, FLOAT) if kind.is_float else first
    item = FLOAT if kind.is_float else INTEGER
    lengths = [load(builder.gep(here, [ir.Constant(INTEGER, 1 + k)], inbounds=True)) for k in range(kind.axes)]
    return Array(builder.inttoptr(first, item.as_pointer()), tuple(lengths), path)


def flat(values: Sequence[Any]) -> list[Any]:
    """Arguments as LLVM passes them."""
    flat: list[Any] = []
    for value in values:
        if isinstance(value, Array):
            flat += [value.data, *value.lengths]
        else:
            flat.append(value.words if isinstance(value, Record) else value)
    return flat


def kind_of_value(value: Any) -> Kind:
    """Kind of an argument of a call."""
    if isinstance(value, Array):
        return Numbers(value.data.type.pointee == FLOAT, len(value.lengths))
    return value.kind if isinstance(value, Record) else Number(value.type == FLOAT)


class Values:
    """Works out the values of expressions in one function.

    ``kernel`` has the functions and constants of the text, ``function`` is the one that is written. What is read from
    records comes in its first block, once, and so do the places of variables.
    """

    def __init__(self, kernel: Any, function: Any) -> None:
        self._kernel, self._function = kernel, function
        self._first = ir.IRBuilder(function.append_basic_block("first"))
        self._builder = ir.IRBuilder(function.append_basic_block("body"))
        self._do = Instructions(self._builder)
        self._names: dict[str, Any] = {}
        self._places: dict[str, Any] = {}
        self._read: dict[tuple[str, ...], Any] = {}
        self._accesses: list[tuple[Any, tuple[str, ...]]] = []

    def _value(self, node: ast.expr) -> Any:
        """The value of an expression."""
        if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
            return self._do.number(node.value)
        if isinstance(node, ast.Name):
            return self._named(node.id)
        if isinstance(node, ast.Attribute):
            return self._attribute(node)
        if isinstance(node, ast.Tuple):
            return tuple(self._value(part) for part in node.elts)
        if isinstance(node, ast.Subscript):
            return self._part(node)
        if isinstance(node, ast.BinOp):
            return self._arithmetic(node.op, self._value(node.left), self._value(node.right))
        if isinstance(node, ast.BoolOp):
            return self._both(node)
        if isinstance(node, ast.UnaryOp):
            if isinstance(node.op, ast.Not):
                return self._builder.not_(self._truth(node.operand))
            return self._do.negative(self._value(node.operand))
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            return self._do.compare(node.ops[0], self._value(node.left), self._value(node.comparators[0]))
        if isinstance(node, ast.IfExp):
            return self._chosen(
                self._truth(node.test), lambda: self._value(node.body), lambda: self._value(node.orelse)
            )
        if isinstance(node, ast.Call):
            return self._called(node)
        raise refused(node)

    def _named(self, name: str) -> Any:
        if name in self._places:
            return self._builder.load(self._places[name])
        return self._names[name] if name in self._names else self._do.number(self._kernel.scope[name])

    def _attribute(self, node: ast.Attribute) -> Any:
        """A field of a record, ``size`` or ``shape`` of an array, or a number of a library such as ``math.inf``."""
        if isinstance(node.value, ast.Name) and node.value.id in self._kernel.scope:
            return self._do.number(getattr(self._kernel.scope[node.value.id], node.attr))
        owner = self._value(node.value)
        if isinstance(owner, Array) and node.attr == "size":
            return functools.reduce(self._product, owner.lengths)
        if isinstance(owner, Array) and node.attr == "shape":
            return owner.lengths
        if not isinstance(owner, Record):
            raise refused(node)
        path = (*owner.path, node.attr)
        if path not in self._read:
            names = [name for name, _ in owner.kind.named]
            index = names.index(node.attr)
            place = sum(width(kind) for _, kind in owner.kind.named[:index])
            self._read[path] = loaded(self._first, owner.words, place, owner.kind.named[index][1], path)
        return self._read[path]

    def _part(self, node: ast.Subscript) -> Any:
        """An element of an array, or what is left of it after fewer indices than it has axes."""
        owner = self._value(node.value)
        if isinstance(owner, tuple) and isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, int):
            return owner[node.slice.value]
        if is_whole(node):
            return owner
        place, path = self._element(node)
        left = owner.lengths[len(indices(node)) :]
        return Array(place, left, path) if left else self._load(place, path)

    def _element(self, node: ast.Subscript) -> tuple[Any, tuple[str, ...]]:
        """Where an element or part of an array is, and the names by which the function came to the array."""
        owner, at_each = self._value(node.value), indices(node)
        if not isinstance(owner, Array) or len(at_each) > len(owner.lengths):
            raise refused(node)
        place = self._do.number(0)
        for index, length in zip(at_each, owner.lengths, strict=False):
            at = self._value(index)
            place = at if index is at_each[0] else self._sum(self._product(place, length), at)
        for length in owner.lengths[len(at_each) :]:
            place = self._product(place, length)
        return self._builder.gep(owner.data, [place], inbounds=True), owner.path

    def _product(self, one: Any, other: Any) -> Any:
        return self._builder.mul(one, other, flags=("nsw",))

    def _sum(self, one: Any, other: Any) -> Any:
        return self._builder.add(one, other, flags=("nsw",))

    def _load(self, place: Any, path: tuple[str, ...]) -> Any:
        loaded = self._builder.load(place)
        self._accesses.append((loaded, path))
        return loaded

    def _store(self, place: Any, path: tuple[str, ...], value: Any) -> None:
        fitting = self._do.as_float(value) if place.type.pointee == FLOAT else value
        self._accesses.append((self._builder.store(fitting, place), path))

    def _arithmetic(self, kind: ast.operator, one: Any, other: Any) -> Any:
        if isinstance(kind, ast.FloorDiv):
            return self._floor_division(one, other)
        return self._do.arithmetic(kind, one, other)

    def _floor_division(self, one: Any, other: Any) -> Any:
        """The quotient of integers, rounded downwards."""
        towards_zero, rest = self._builder.sdiv(one, other), self._builder.srem(one, other)
        zero = self._do.number(0)
        uneven = self._builder.icmp_signed("!=", rest, zero)
        below = self._builder.icmp_signed("<", self._builder.xor(rest, other), zero)
        down = self._builder.zext(self._builder.and_(uneven, below), INTEGER)
        return self._builder.sub(towards_zero, down)

    def _truth(self, node: ast.expr) -> Any:
        value = self._value(node)
        return value if value.type == TRUTH else self._do.compare(ast.NotEq(), value, self._do.number(0))

    def _both(self, node: ast.BoolOp) -> Any:
        """``and`` or ``or``: what stands behind is not worked out where the first decides."""
        first, *others = node.values
        value = self._truth(first)
        either = isinstance(node.op, ast.Or)
        decided = functools.partial(self._do.number, either)
        for other in others:
            asked = functools.partial(self._truth, other)
            value = self._chosen(value, decided, asked) if either else self._chosen(value, asked, decided)
        return value

    def _chosen(self, test: Any, one: Callable[[], Any], other: Callable[[], Any]) -> Any:
        """One of two values, of which only that one is worked out."""
        ways = []
        blocks = [self._function.append_basic_block(name) for name in ("one", "other", "end")]
        self._builder.cbranch(test, *blocks[:2])
        for block, way in zip(blocks[:2], (one, other), strict=True):
            self._builder.position_at_end(block)
            ways.append((way(), self._builder.block))
        as_float = FLOAT in (ways[0][0].type, ways[1][0].type)
        for position, (value, block) in enumerate(ways):
            self._builder.position_at_end(block)
            ways[position] = (self._do.as_float(value) if as_float else value, block)
            self._builder.branch(blocks[2])
        self._builder.position_at_end(blocks[2])
        phi = self._builder.phi(ways[0][0].type)
        for value, block in ways:
            phi.add_incoming(value, block)
        return phi

    def _called(self, node: ast.Call) -> Any:
        name = ast.unparse(node.func)
        arguments = [self._value(argument) for argument in node.args]
        if name in self._kernel.functions:
            kinds = self._kernel.functions[name].args.args
            arguments = [self._fitting(value, given) for value, given in zip(arguments, kinds, strict=True)]
            function = self._kernel.function(name, tuple(kind_of_value(value) for value in arguments))
            return self._builder.call(function, flat(arguments))
        if isinstance(node.func, ast.Attribute) and ast.unparse(node.func.value) not in self._kernel.scope:
            return self._call_back(self._value(node.func), arguments)
        return self._library(node, name, arguments)

    def _fitting(self, value: Any, parameter: ast.arg) -> Any:
        """An argument as its parameter is declared: an integer where a float is asked for becomes one."""
        declared = ast.unparse(parameter.annotation) if parameter.annotation else ""
        if isinstance(value, Array | Record) or declared not in ("int", "float"):
            return value
        return self._do.as_float(value) if declared == "float" else self._do.as_integer(value)

    def _call_back(self, called: Any, arguments: Sequence[Any]) -> None:
        """A call of a compiled function with the convention of numba's C callbacks."""
        wanted = called.kind.signature.args
        # numba takes None for what a callback without a value returns, which is a pointer
        type_ = ir.FunctionType(ir.IntType(8).as_pointer(), [value_type(kind) for kind in wanted])
        function = self._builder.inttoptr(called.address, type_.as_pointer())
        values = [
            callback_array(kind, self._builder, value.data, value.lengths)
            if isinstance(value, Array)
            else self._do.as_float(value)
            if value_type(kind) == FLOAT
            else self._do.as_integer(value)
            for kind, value in zip(wanted, arguments, strict=True)
        ]
        self._builder.call(function, values)

    def _library(self, node: ast.Call, name: str, values: Sequence[Any]) -> Any:
        if any(isinstance(value, Array | Record | tuple) for value in values):
            raise refused(node)
        if name in ("min", "max") and len(values) == 2:
            kind = ast.Lt() if name == "min" else ast.Gt()
            return self._do.choose(self._do.compare(kind, values[1], values[0]), values[1], values[0])
        if name == "int":
            return self._do.as_integer(values[0])
        if name == "math.ceil":
            return self._do.as_integer(self._do.intrinsic("llvm.ceil", self._do.as_float(values[0])))
        floats = [self._do.as_float(value) for value in values]
        if name == "math.isnan":
            return self._builder.fcmp_unordered("uno", floats[0], floats[0])
        if name == "math.isfinite":
            size = self._do.intrinsic("llvm.fabs", floats[0])
            return self._builder.fcmp_ordered("<", size, self._do.number(math.inf))
        if name in _INTRINSICS and values[0].type == FLOAT:
            return self._do.intrinsic(_INTRINSICS[name], floats[0])
        if name in C_NAMES:
            function = self._kernel.declared(C_NAMES[name], ir.FunctionType(FLOAT, [FLOAT] * len(floats)))
            return self._builder.call(function, floats)
        raise refused(node)


def is_whole(node: ast.Subscript) -> bool:
    """True for ``array[:]``."""
    return ast.unparse(node.slice) == ":"


def indices(node: ast.Subscript) -> list[ast.expr]:
    """The indices of an element or a part of an array."""
    return node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]


def refused(node: ast.AST) -> ModelError:
    """The error for what kernels do not have."""
    where = f"line {getattr(node, 'lineno', '?')}"
    return ModelError(f"{where}: kernels do not have {ast.unparse(node)!r} - write it in their part of Python")
