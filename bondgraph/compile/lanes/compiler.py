"""Compiles printed modules of lane functions: from their text to LLVM instructions (imports numba).

numba could compile the same text, but it would infer a type for each of thousands of variables, give each a place in
memory, and have LLVM find out again what the printer knew: which lines are the same for all lanes and which rows
differ. That takes ten times as long. The text consists of few kinds of statements (see ``lanes.text`` and the kernels
``step_kernel``, ``tangent_kernel``, ``stiff_tangent_kernel``), and every value in it is a float, an integer, a truth
value or an array by its form.

- ``for l in range(n)`` is a loop over whole vectors of lanes: ``n`` is rounded up to them, the work buffer has room.
  ``w[... + l]`` is a row there, everything else one number for all lanes.
- A name is the value it was given last; only what loops change (``x += ...``) has a place in memory.
- ``a if c else b`` selects, and both sides are worked out: nothing branches.
- A function that returns a value is put in where it is called; one that does not is called, and must not be given
  arrays that overlap.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from bondgraph.compile.lanes.instructions import FLOAT, VECTOR, Array, Instructions, is_packed, library_table
from bondgraph.compile.numba_internals import array_of, cgutils, ir, sigutils, value_type
from bondgraph.errors import ModelError
from bondgraph.syntax import parsed

#: Functions of one number that LLVM has itself.
_INTRINSICS = {"abs": "llvm.fabs", "math.sqrt": "llvm.sqrt", "np.floor": "llvm.floor"}
#: Names of other functions in the mathematical library of C.
C_NAMES = {
    "np.tan": "tan", "np.arccos": "acos", "np.arctan2": "atan2", "np.sinh": "sinh", "np.cosh": "cosh",
    "np.arcsinh": "asinh", "np.arccosh": "acosh", "np.arctanh": "atanh",
    "math.log1p": "log1p", "math.copysign": "copysign",
}  # fmt: skip
#: The count of lanes in printed text.
_LANE_COUNT = "n"


def lane_module(source: str, exports: Mapping[str, str]) -> str:
    """LLVM instructions of a printed module.

    Parameters
    ----------
    source
        Its text.
    exports
        Signatures, in numba's notation, of the functions that may be called from outside; each gets an entry with the
        convention of numba's C callbacks, named after it.

    Raises
    ------
    ModelError
        If the text has other statements than are printed.

    Examples
    --------
    >>> text = '''
    ... def double(w, n):
    ...     for l in range(n):
    ...         w[16 + l] = 2.0*w[0 + l]
    ... '''
    >>> instructions = lane_module(text, {"double": "void(float64[::1], int64)"})
    >>> "fmul contract <8 x double>" in instructions
    True
    """
    printed = _Printed(source)
    library_table(printed.module)
    for name, signature in exports.items():
        _export(printed, name, sigutils.normalize_signature(signature)[0])
    return str(printed.module)


def entry_name(function: str) -> str:
    """Name of the entry of an exported function."""
    return f"entry.{function}"


class _Printed:
    """A printed module: its functions, numbers and tables, and the instructions written so far."""

    def __init__(self, source: str) -> None:
        self.module = ir.Module("lanes")
        self.functions: dict[str, ast.FunctionDef] = {}
        self.scope: dict[str, Any] = {"np": np, "math": math}
        for node in parsed(source).body:
            if isinstance(node, ast.FunctionDef):
                self.functions[node.name] = node
            elif isinstance(node, ast.Assign):
                exec(compile(ast.Module([node], []), "<printed>", "exec"), self.scope)

    def table(self, name: str) -> Any:
        """A table in memory."""
        own = f"table.{name}"
        if own not in self.module.globals:
            values = self.scope[name]
            kept = ir.GlobalVariable(self.module, ir.ArrayType(FLOAT, values.size), own)
            kept.linkage, kept.global_constant = "internal", True
            kept.initializer = ir.Constant(kept.value_type, [ir.Constant(FLOAT, float(v)) for v in values.flat])
        return self.module.globals[own]

    def function(self, name: str, arguments: Sequence[Any]) -> Any:
        """A function of the module for arguments of these kinds, written when it is first called."""
        own = f"lanes.{name}"
        if own not in self.module.globals:
            kinds = [value.type for value in _flat(arguments)]
            written = ir.Function(self.module, ir.FunctionType(ir.VoidType(), kinds), own)
            written.linkage = "internal"
            written.attributes.add("noinline")
            _write(self, self.functions[name], written, arguments)
        return self.module.globals[own]


def _flat(arguments: Sequence[Any]) -> list[Any]:
    """Arguments with arrays as where they begin and their lengths."""
    flat = []
    for value in arguments:
        flat += [value.data, *value.lengths] if isinstance(value, Array) else [value]
    return flat


def _write(printed: _Printed, function: ast.FunctionDef, written: Any, arguments: Sequence[Any]) -> None:
    """Write the instructions of a function."""
    for argument in written.args:
        if isinstance(argument.type, ir.PointerType):
            argument.add_attribute("noalias")
    given = iter(written.args)
    names: dict[str, Any] = {}
    for argument, value in zip(function.args.args, arguments, strict=True):
        if isinstance(value, Array):
            names[argument.arg] = Array(next(given), tuple(next(given) for _ in value.lengths))
        else:
            names[argument.arg] = next(given)
    builder = ir.IRBuilder(written.append_basic_block("entry"))
    _Body(printed, Instructions(builder), names, _changed(function.body)).run(function.body)
    builder.ret_void()


def _changed(statements: Sequence[ast.stmt]) -> set[str]:
    """Names that loops change."""
    found: set[str] = set()
    for node in statements:
        if isinstance(node, ast.AugAssign):
            found.add(ast.unparse(node.target))
        elif isinstance(node, ast.For | ast.If):
            found |= _changed(node.body) | _changed(node.orelse)
    return found


def _export(printed: _Printed, name: str, kinds: Sequence[Any]) -> None:
    """An entry that calls a function with what numba hands to C callbacks."""
    # numba takes None for what a callback without a value returns, which is a pointer
    nothing = ir.IntType(8).as_pointer()
    kind = ir.FunctionType(nothing, [value_type(one) for one in kinds])
    entry = ir.Function(printed.module, kind, entry_name(name))
    builder = ir.IRBuilder(entry.append_basic_block("entry"))
    arguments = []
    for one, value in zip(kinds, entry.args, strict=True):
        data, lengths = array_of(one, builder, value)
        arguments.append(value if data is None else Array(data, lengths))
    builder.call(printed.function(name, arguments), _flat(arguments))
    builder.ret(ir.Constant(nothing, None))


class _Body:
    """Writes the instructions of one function body, statement by statement."""

    def __init__(
        self,
        printed: _Printed,
        instructions: Instructions,
        names: dict[str, Any],
        changed: Collection[str] = (),
    ) -> None:
        self._printed = printed
        self._do = instructions
        self._builder = instructions.builder
        self._names = names
        self._changed = changed
        self._places: dict[str, Any] = {}
        self._loops: list[Any] = []
        self._lane = ""

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
            self._change(node)
        elif isinstance(node, ast.For) and isinstance(node.iter, ast.Call) and isinstance(node.target, ast.Name):
            self._loop(node, node.target.id, node.iter.args[0])
        elif isinstance(node, ast.If):
            self._branch(node)
        elif isinstance(node, ast.Break):
            self._loops[-1].do_break()
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            self._call(node.value)
        elif not isinstance(node, ast.Pass) and not (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        ):
            raise _refused(node)

    def _loop(self, node: ast.For, index: str, turns: ast.expr) -> None:
        count = self.value(turns)
        lanes = isinstance(turns, ast.Name) and turns.id == _LANE_COUNT
        if lanes:
            up = self._builder.add(count, self._do.number(VECTOR - 1))
            count = self._builder.sdiv(up, self._do.number(VECTOR))
        with cgutils.for_range(self._builder, count) as loop:
            if lanes:
                self._lane, self._names[index] = index, self._builder.mul(loop.index, self._do.number(VECTOR))
                self.run(node.body)
                self._lane = ""
            else:
                self._names[index] = loop.index
                self._loops.append(loop)
                self.run(node.body)
                self._loops.pop()

    def _branch(self, node: ast.If) -> None:
        test = self.value(node.test)
        if not node.orelse:
            with self._builder.if_then(test):
                self.run(node.body)
            return
        with self._builder.if_else(test) as (then, otherwise):
            with then:
                self.run(node.body)
            with otherwise:
                self.run(node.orelse)

    def _call(self, node: ast.Call) -> None:
        arguments = [self._argument(argument) for argument in node.args]
        name = ast.unparse(node.func)
        if name not in self._printed.functions:
            raise _refused(node)
        self._builder.call(self._printed.function(name, arguments), _flat(arguments))

    def _argument(self, node: ast.expr) -> Any:
        """An argument of a call; what has one index less than an array is one of its rows."""
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
            array = self._names.get(node.value.id)
            if isinstance(array, Array) and len(array.lengths) == 2:
                first = self._builder.mul(self.value(node.slice), array.lengths[1])
                return Array(self._builder.gep(array.data, [first], inbounds=True), array.lengths[1:])
        return self.value(node)

    def _change(self, node: ast.AugAssign) -> None:
        place = self._places[ast.unparse(node.target)]
        value = self.value(node.value)
        if is_packed(value):
            value = self._do.any_of(value)
        self._builder.store(self._do.arithmetic(node.op, self._builder.load(place), value), place)

    def _assign(self, target: ast.expr, node: ast.expr | None) -> None:
        if isinstance(target, ast.Tuple) and isinstance(node, ast.Tuple):
            found = [self.value(part) for part in node.elts]
            self._names.update(zip(map(ast.unparse, target.elts), found, strict=True))
            return
        value = self.value(node)
        if isinstance(target, ast.Subscript):
            self._store(target, value)
        elif isinstance(target, ast.Name) and target.id in self._changed:
            if target.id not in self._places:
                self._places[target.id] = cgutils.alloca_once(self._builder, value.type)
            self._builder.store(value, self._places[target.id])
        elif isinstance(target, ast.Name):
            self._names[target.id] = value
        else:
            raise _refused(target)

    def _store(self, target: ast.Subscript, value: Any) -> None:
        place = self._element(target)
        if self._is_row(target):
            self._do.store_row(value, place)
        else:
            self._builder.store(self._do.as_float(value), place)

    def value(self, node: ast.expr | None) -> Any:
        """The value of an expression."""
        if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
            return self._do.number(node.value)
        if isinstance(node, ast.Name):
            if node.id in self._places:
                return self._builder.load(self._places[node.id])
            return self._names[node.id] if node.id in self._names else self._do.number(self._printed.scope[node.id])
        if isinstance(node, ast.Attribute):
            return self._attribute(node)
        if isinstance(node, ast.Subscript):
            return self._read(node)
        if isinstance(node, ast.BinOp):
            return self._do.arithmetic(node.op, self.value(node.left), self.value(node.right))
        if isinstance(node, ast.BoolOp):
            first, *others = map(self.value, node.values)
            for other in others:
                first = (self._builder.or_ if isinstance(node.op, ast.Or) else self._builder.and_)(first, other)
            return first
        if isinstance(node, ast.UnaryOp):
            inner = self.value(node.operand)
            return self._do.negative(inner) if isinstance(node.op, ast.USub) else self._builder.not_(inner)
        if isinstance(node, ast.Compare):
            return self._do.compare(node.ops[0], self.value(node.left), self.value(node.comparators[0]))
        if isinstance(node, ast.IfExp):
            return self._do.choose(self.value(node.test), self.value(node.body), self.value(node.orelse))
        if isinstance(node, ast.Call):
            return self._called(node)
        raise _refused(node)

    def _attribute(self, node: ast.Attribute) -> Any:
        """``array.size``, or a number of a library such as ``np.inf``."""
        array = self._names.get(ast.unparse(node.value))
        if isinstance(array, Array) and node.attr == "size":
            return array.lengths[0]
        found = getattr(self._printed.scope.get(ast.unparse(node.value)), node.attr, None)
        if not isinstance(found, float):
            raise _refused(node)
        return self._do.number(found)

    def _read(self, node: ast.Subscript) -> Any:
        owner = node.value
        if isinstance(owner, ast.Attribute) and owner.attr == "shape" and isinstance(node.slice, ast.Constant):
            return self._names[ast.unparse(owner.value)].lengths[node.slice.value]
        if ast.unparse(owner) not in self._names:
            return self._do.gather(self._printed.table(ast.unparse(owner)), self._table_index(node))
        place = self._element(node)
        return self._do.load_row(place) if self._is_row(node) else self._builder.load(place)

    def _is_row(self, node: ast.Subscript) -> bool:
        """True for an element of a lane: ``w[... + l]`` in a loop over lanes."""
        last = node.slice.right if isinstance(node.slice, ast.BinOp) else node.slice
        return bool(self._lane) and isinstance(last, ast.Name) and last.id == self._lane

    def _element(self, node: ast.Subscript) -> Any:
        """Where an element of an array is."""
        return self._builder.gep(self._names[ast.unparse(node.value)].data, [self.value(node.slice)], inbounds=True)

    def _table_index(self, node: ast.Subscript) -> Any:
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        first, *others = [self.value(index) for index in indices]
        sizes = self._printed.scope[ast.unparse(node.value)].shape[1:]
        for size, index in zip(sizes, others, strict=True):
            first = self._do.arithmetic(ast.Mult(), first, self._do.number(int(size)))
            first = self._do.arithmetic(ast.Add(), first, index)
        return first

    def _called(self, node: ast.Call) -> Any:
        if isinstance(node.func, ast.Attribute) and node.func.attr == "view":
            bits = self.value(node.func.value)
            whole = ast.unparse(node.args[0]) == "np.int64"
            return self._do.bits_as_integer(bits) if whole else self._do.bits_as_float(bits)
        given = [self.value(argument) for argument in node.args]
        name = ast.unparse(node.func)
        if name in ("np.int64", "int"):
            return self._do.as_integer(given[0])
        if name in ("np.float64", "float"):
            return self._do.as_float(given[0])
        if name == "min":
            return self._do.choose(self._do.compare(ast.LtE(), *given), *given)
        if name in _INTRINSICS:
            return self._do.intrinsic(_INTRINSICS[name], given[0])
        if name in C_NAMES:
            return self._do.external(C_NAMES[name], given)
        if name not in self._printed.functions:
            raise _refused(node)
        function = self._printed.functions[name]
        names = {argument.arg: value for argument, value in zip(function.args.args, given, strict=True)}
        return _Body(self._printed, self._do, names).run(function.body)


def _refused(node: ast.AST | None) -> ModelError:
    text = ast.unparse(node) if node is not None else "return"
    return ModelError(f"{text!r} cannot be compiled for lanes - regenerate the module", where=(text,))
