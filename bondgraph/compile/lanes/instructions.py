"""LLVM instructions for values of printed text: numbers, and vectors of one number per lane (imports numba).

Arithmetic of a vector and a number is that of the vector and as many copies of the number. Products may be fused with
sums (``contract``), as numba is told to do for everything else.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from bondgraph.compile.numba_internals import ir

#: Lanes in one vector: those of the longest vector register of a processor.
VECTOR = 8

FLOAT, INTEGER, TRUTH = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
FLOATS, INTEGERS, TRUTHS = (ir.VectorType(kind, VECTOR) for kind in (FLOAT, INTEGER, TRUTH))

#: Instructions for floats, and for integers and truth values.
_ARITHMETIC = {
    ast.Add: ("fadd", "add"), ast.Sub: ("fsub", "sub"), ast.Mult: ("fmul", "mul"), ast.Div: ("fdiv", ""),
    ast.FloorDiv: ("", "sdiv"), ast.BitAnd: ("", "and_"), ast.BitOr: ("", "or_"), ast.LShift: ("", "shl"),
    ast.RShift: ("", "ashr"),
}  # fmt: skip
#: Functions of the mathematical library of C that printed text may call.
LIBRARY = ("tan", "acos", "atan2", "sinh", "cosh", "asinh", "acosh", "atanh")
#: Name of the table of their addresses, and of the function that says where it is.
_LIBRARY_TABLE, LIBRARY_PLACE = "library.table", "library.place"
_ADDRESS = ir.IntType(8).as_pointer()
_COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


@dataclass(frozen=True)
class Array:
    """An array of floats: where it begins, and its lengths."""

    data: Any
    lengths: tuple[Any, ...]


def is_packed(value: Any) -> bool:
    """True for a value that is one number per lane."""
    return isinstance(value.type, ir.VectorType)


def _is_float(value: Any) -> bool:
    return value.type in (FLOAT, FLOATS)


class Instructions:
    """Writes instructions for values at the place where a builder stands."""

    def __init__(self, builder: Any) -> None:
        self.builder = builder

    def number(self, value: float | int | bool) -> Any:
        """A number of the text."""
        kind = TRUTH if isinstance(value, bool) else INTEGER if isinstance(value, int) else FLOAT
        return ir.Constant(kind, value)

    def arithmetic(self, kind: ast.operator, left: Any, right: Any) -> Any:
        """A sum, product and so on; an integer beside a float, or under a fraction, is taken as a float."""
        left, right = self._alike(left, right, as_floats=isinstance(kind, ast.Div))
        name = _ARITHMETIC[type(kind)][not _is_float(left)]
        if _is_float(left):
            return getattr(self.builder, name)(left, right, flags=("contract",))
        return getattr(self.builder, name)(left, right)

    def compare(self, kind: ast.cmpop, left: Any, right: Any) -> Any:
        """A truth value; nan differs from everything."""
        left, right = self._alike(left, right)
        sign = _COMPARISONS[type(kind)]
        if not _is_float(left):
            return self.builder.icmp_signed(sign, left, right)
        return (self.builder.fcmp_unordered if sign == "!=" else self.builder.fcmp_ordered)(sign, left, right)

    def choose(self, test: Any, one: Any, other: Any) -> Any:
        """One value where a truth holds, else the other."""
        one, other = self._alike(one, other)
        if is_packed(test) or is_packed(one):
            test, one, other = (self.spread(value) for value in (test, one, other))
        return self.builder.select(test, one, other)

    def negative(self, value: Any) -> Any:
        """The number with the other sign."""
        return self.builder.fneg(value) if _is_float(value) else self.builder.neg(value)

    def as_float(self, value: Any) -> Any:
        """The value as a float: a truth value is 0 or 1."""
        if _is_float(value):
            return value
        truth = value.type in (TRUTH, TRUTHS)
        kind = FLOATS if is_packed(value) else FLOAT
        return (self.builder.uitofp if truth else self.builder.sitofp)(value, kind)

    def as_integer(self, value: Any) -> Any:
        """The whole part of a float, 0 or 1 for a truth value."""
        kind = INTEGERS if is_packed(value) else INTEGER
        if value.type == kind:
            return value
        return (self.builder.fptosi if _is_float(value) else self.builder.zext)(value, kind)

    def bits_as_float(self, value: Any) -> Any:
        """The float that has the bits of an integer."""
        return self.builder.bitcast(value, FLOATS if is_packed(value) else FLOAT)

    def bits_as_integer(self, value: Any) -> Any:
        """The integer that has the bits of a float."""
        return self.builder.bitcast(value, INTEGERS if is_packed(value) else INTEGER)

    def intrinsic(self, name: str, value: Any) -> Any:
        """A function of one number that LLVM has itself."""
        kind = f"v{VECTOR}f64" if is_packed(value) else "f64"
        return self.builder.call(self._declared(f"{name}.{kind}", value.type, [value.type]), [value])

    def external(self, name: str, values: Sequence[Any]) -> Any:
        """A function of the mathematical library, called for one lane after another."""
        place = self.builder.gep(library_table(self.builder.module), [_at(0), _at(LIBRARY.index(name))])
        kind = ir.FunctionType(FLOAT, [FLOAT] * len(values)).as_pointer()
        function = self.builder.bitcast(self.builder.load(place), kind)
        values = [self.as_float(value) for value in values]
        if not any(map(is_packed, values)):
            return self.builder.call(function, values)
        spread = [self.spread(value) for value in values]
        return self._by_lane(
            FLOATS, lambda lane: self.builder.call(function, [self._lane(one, lane) for one in spread])
        )

    def any_of(self, value: Any) -> Any:
        """The integer that has each bit which an integer of any lane has."""
        name = f"llvm.vector.reduce.or.v{VECTOR}i64"
        return self.builder.call(self._declared(name, INTEGER, [INTEGERS]), [value])

    def spread(self, value: Any) -> Any:
        """A number as one that is the same in all lanes."""
        if is_packed(value):
            return value
        kind = ir.VectorType(value.type, VECTOR)
        if isinstance(value, ir.Constant):
            return ir.Constant(kind, [value.constant] * VECTOR)
        undefined = ir.Constant(kind, ir.Undefined)
        first = self.builder.insert_element(undefined, value, _at(0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), VECTOR), [0] * VECTOR)
        return self.builder.shuffle_vector(first, undefined, zeros)

    def load_row(self, place: Any) -> Any:
        """The numbers of a whole vector of lanes from where the first is."""
        return self.builder.load(self.builder.bitcast(place, FLOATS.as_pointer()), align=FLOAT_BYTES)

    def store_row(self, value: Any, place: Any) -> None:
        """Write a whole vector of lanes to where the first is."""
        packed = self.spread(self.as_float(value))
        self.builder.store(packed, self.builder.bitcast(place, FLOATS.as_pointer()), align=FLOAT_BYTES)

    def gather(self, table: Any, index: Any) -> Any:
        """Elements of a table, one for each lane or one alone."""

        def read(at: Any) -> Any:
            return self.builder.load(self.builder.gep(table, [self.number(0), at], inbounds=True))

        if not is_packed(index):
            return read(index)
        return self._by_lane(FLOATS, lambda lane: read(self._lane(index, lane)))

    def _by_lane(self, kind: Any, one: Callable[[int], Any]) -> Any:
        found = ir.Constant(kind, ir.Undefined)
        for lane in range(VECTOR):
            found = self.builder.insert_element(found, one(lane), _at(lane))
        return found

    def _lane(self, value: Any, lane: int) -> Any:
        return self.builder.extract_element(value, _at(lane))

    def _alike(self, left: Any, right: Any, as_floats: bool = False) -> tuple[Any, Any]:
        if as_floats or _is_float(left) != _is_float(right):
            left, right = self.as_float(left), self.as_float(right)
        if is_packed(left) != is_packed(right):
            left, right = self.spread(left), self.spread(right)
        return left, right

    def _declared(self, name: str, result: Any, arguments: Sequence[Any]) -> Any:
        module = self.builder.module
        if name not in module.globals:
            ir.Function(module, ir.FunctionType(result, arguments), name)
        return module.globals[name]


def library_table(module: Any) -> Any:
    """The addresses of the functions of the mathematical library, to be filled in when the module is loaded.

    Were they symbols, the linker would need room beside the code that it does not reckon with beforehand, and could not
    map everything as one piece.
    """
    if _LIBRARY_TABLE not in module.globals:
        table = ir.GlobalVariable(module, ir.ArrayType(_ADDRESS, len(LIBRARY)), _LIBRARY_TABLE)
        table.linkage, table.initializer = "internal", ir.Constant(table.value_type, None)
        place = ir.Function(module, ir.FunctionType(_ADDRESS, []), LIBRARY_PLACE)
        builder = ir.IRBuilder(place.append_basic_block("entry"))
        builder.ret(builder.bitcast(table, _ADDRESS))
    return module.globals[_LIBRARY_TABLE]


#: Alignment that is asked of rows; those of a work buffer have more, and a vector is read as fast.
FLOAT_BYTES = 8


def _at(lane: int) -> Any:
    return ir.Constant(ir.IntType(32), lane)
