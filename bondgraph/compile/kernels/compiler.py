"""Compiles kernels from their text to LLVM instructions (imports numba).

Kernels are written in a small part of Python: loops over ranges, branches, numbers, and elements of arrays in records.
numba takes all of Python, and most of its time goes into finding out what is told here by the form of the text: the
kind of a parameter is that of what is given, the kind of a variable that of its first value, the kind of a result
stands in the signature. The whole kernel becomes one module that LLVM improves once, where numba has LLVM improve each
function, and again everything that it calls.

- Indices are not negative and inside their array.
- What a function is given as an array does not overlap what it reads through records, and the arrays of one record do
  not overlap. A record inside a record may share its memory.
- A variable keeps the kind of its first value. A product and a sum may be rounded as one.
"""

from __future__ import annotations

import ast
import functools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from bondgraph.compile.kernels.arguments import Fields, Kind, Number, Numbers, width
from bondgraph.compile.kernels.values import Array, Record, Values, flat, indices, is_whole, loaded, refused
from bondgraph.compile.lanes.instructions import FLOAT, INTEGER
from bondgraph.compile.numba_internals import ir
from bondgraph.errors import ModelError
from bondgraph.syntax import parsed

_RESULTS = {"None": ir.VoidType(), "int": INTEGER, "float": FLOAT}
_WORDS = INTEGER.as_pointer()


def kernel_module(sources: Sequence[str], name: str, kinds: Sequence[Kind]) -> str:
    """LLVM instructions of a kernel, with an entry ``entry`` that takes the words of all arguments.

    Parameters
    ----------
    sources
        The texts of its modules.
    name, kinds
        The function to be called, and the kinds of its arguments.

    Raises
    ------
    ModelError
        If the text has statements that kernels do not have.

    Examples
    --------
    >>> text = '''
    ... def total(x: FloatArray) -> float:
    ...     found = 0.0
    ...     for i in range(x.size):
    ...         found += x[i]
    ...     return found
    ...
    ... def run(x: FloatArray, y: FloatArray) -> None:
    ...     y[0] = total(x)
    ... '''
    >>> "fadd contract double" in kernel_module([text], "run", [Numbers(True, 1), Numbers(True, 1)])
    True
    """
    kernel = _Kernel(sources)
    entry = ir.Function(kernel.module, ir.FunctionType(INTEGER, [_WORDS]), "entry")
    builder = ir.IRBuilder(entry.append_basic_block("entry"))
    given, place = [], 0
    for index, kind in enumerate(kinds):
        given.append(loaded(builder, entry.args[0], place, kind, (str(index),)))
        place += width(kind)
    result = builder.call(kernel.function(name, tuple(kinds)), flat(given))
    builder.ret(result if result.type == INTEGER else ir.Constant(INTEGER, 0))
    return str(kernel.module)


def _types(kind: Kind) -> list[Any]:
    """Types by which LLVM passes an argument."""
    if isinstance(kind, Numbers):
        return [(FLOAT if kind.is_float else INTEGER).as_pointer(), *[INTEGER] * kind.axes]
    if isinstance(kind, Number):
        return [FLOAT if kind.is_float else INTEGER]
    return [_WORDS]


class _Kernel:
    """The functions and constants of a kernel, and those functions that are written so far."""

    def __init__(self, sources: Sequence[str]) -> None:
        self.module = ir.Module("kernel")
        self.functions: dict[str, ast.FunctionDef] = {}
        self.scope: dict[str, Any] = {"math": math}
        self._written: dict[tuple[str, tuple[Kind, ...]], Any] = {}
        for node in (node for source in sources for node in parsed(source).body):
            if isinstance(node, ast.FunctionDef):
                self.functions[node.name] = node
            elif isinstance(node, ast.Assign):
                exec(compile(ast.Module([node], []), "<kernel>", "exec"), self.scope)

    def function(self, name: str, kinds: tuple[Kind, ...]) -> Any:
        """A function for arguments of these kinds, written when it is first called."""
        if (name, kinds) not in self._written:
            node = self.functions[name]
            types = [type_ for kind in kinds for type_ in _types(kind)]
            result = _RESULTS[ast.unparse(node.returns) if node.returns else "None"]
            written = ir.Function(self.module, ir.FunctionType(result, types), f"{name}.{len(self._written)}")
            written.linkage = "internal"
            written.attributes.add("nounwind")
            self._written[name, kinds] = written
            _Body(self, node, written, kinds).write()
        return self._written[name, kinds]

    def declared(self, name: str, type_: Any) -> Any:
        """A function of LLVM or of the mathematical library, which depends on nothing but its arguments."""
        if name not in self.module.globals:
            function = ir.Function(self.module, type_, name)
            if not name.startswith("llvm."):
                function.attributes.add("nounwind")
                function.attributes.add("readnone")
        return self.module.globals[name]


class _Body(Values):
    """Writes the instructions of one function, statement by statement."""

    def __init__(self, kernel: _Kernel, node: ast.FunctionDef, written: Any, kinds: Sequence[Kind]) -> None:
        super().__init__(kernel, written)
        self._node = node
        self._loops: list[tuple[Any, Any]] = []
        given = iter(written.args)
        for argument, kind in zip(node.args.args, kinds, strict=True):
            self._names[argument.arg] = self._parameter(argument.arg, kind, given)
        for name in sorted(_given_values(node) & set(self._names)):  # parameters that are changed
            self._places[name] = self._first.alloca(self._names[name].type)
            self._first.store(self._names[name], self._places[name])

    def _parameter(self, name: str, kind: Kind, given: Iterator[Any]) -> Any:
        first = next(given)
        if isinstance(kind, Numbers):
            return Array(first, tuple(next(given) for _ in range(kind.axes)), (name,))
        return Record(kind, first, (name,)) if isinstance(kind, Fields) else first

    def write(self) -> None:
        """Write the whole function."""
        self._run(self._node.body)
        if not self._builder.block.is_terminated:
            if isinstance(self._function.function_type.return_type, ir.VoidType):
                self._builder.ret_void()
            else:
                self._builder.unreachable()
        self._first.position_at_end(self._function.entry_basic_block)  # others may have written there too
        self._first.branch(self._function.basic_blocks[1])
        self._tell_apart()

    def _tell_apart(self) -> None:
        """Tell LLVM which arrays do not overlap."""
        metadata = self._kernel.module.add_metadata
        paths = sorted({path for _, path in self._accesses})
        domain = metadata([self._function.name])
        scopes = {path: metadata([f"{self._function.name}: {'.'.join(path)}", domain]) for path in paths}
        apart = {path: [scopes[other] for other in paths if not _may_overlap(path, other)] for path in paths}
        for access, path in self._accesses:
            access.set_metadata("alias.scope", metadata([scopes[path]]))
            if apart[path]:
                access.set_metadata("noalias", metadata(apart[path]))

    def _run(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            if self._builder.block.is_terminated:
                return
            self._statement(statement)

    def _statement(self, node: ast.stmt) -> None:
        if isinstance(node, ast.Assign):
            self._assign(node.targets[0], self._value(node.value))
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            self._assign(node.target, self._value(node.value))
        elif isinstance(node, ast.AugAssign):
            self._change(node)
        elif isinstance(node, ast.For) and isinstance(node.iter, ast.Call) and isinstance(node.target, ast.Name):
            self._count(node, node.target, node.iter)
        elif isinstance(node, ast.While):
            self._loop(lambda: self._run(node.body), lambda: self._truth(node.test), lambda: None)
        elif isinstance(node, ast.If):
            self._branch(node)
        elif isinstance(node, ast.Break):
            self._builder.branch(self._loops[-1][1])
        elif isinstance(node, ast.Return):
            self._return(node)
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            self._called(node.value)
        elif not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            raise refused(node)

    def _return(self, node: ast.Return) -> None:
        if node.value is None:
            self._builder.ret_void()
            return
        value = self._value(node.value)
        is_float = self._function.function_type.return_type == FLOAT
        self._builder.ret(self._do.as_float(value) if is_float else value)

    def _count(self, node: ast.For, target: ast.Name, turns: ast.Call) -> None:
        """A loop over a range, upwards."""
        limits = [self._value(one) for one in turns.args]
        start, stop = (self._do.number(0), *limits) if len(limits) == 1 else limits[:2]
        step = limits[2] if len(limits) == 3 else self._do.number(1)
        if ast.unparse(turns.func) != "range" or (len(limits) == 3 and isinstance(turns.args[2], ast.UnaryOp)):
            raise refused(turns)
        counter = self._first.alloca(INTEGER)
        self._builder.store(start, counter)

        def body() -> None:
            self._assign(target, self._builder.load(counter))
            self._run(node.body)

        self._turns(counter, stop, step, body)

    def _turns(self, counter: Any, stop: Any, step: Any, body: Callable[[], None]) -> None:
        """A loop as long as a counter has not come to its end."""

        def turn() -> None:
            self._builder.store(self._sum(self._builder.load(counter), step), counter)

        self._loop(body, lambda: self._builder.icmp_signed("<", self._builder.load(counter), stop), turn)

    def _loop(self, body: Callable[[], None], goes_on: Callable[[], Any], turn: Callable[[], None]) -> None:
        test, inside, after, end = (self._function.append_basic_block(name) for name in ("test", "in", "turn", "end"))
        self._builder.branch(test)
        self._builder.position_at_end(test)
        self._builder.cbranch(goes_on(), inside, end)
        self._builder.position_at_end(inside)
        self._loops.append((after, end))
        body()
        self._loops.pop()
        if not self._builder.block.is_terminated:
            self._builder.branch(after)
        self._builder.position_at_end(after)
        turn()
        self._builder.branch(test)
        self._builder.position_at_end(end)

    def _branch(self, node: ast.If) -> None:
        then, end = self._function.append_basic_block("then"), self._function.append_basic_block("end")
        other = self._function.append_basic_block("else") if node.orelse else end
        self._builder.cbranch(self._truth(node.test), then, other)
        for block, statements in ((then, node.body), (other, node.orelse)):
            if statements:
                self._builder.position_at_end(block)
                self._run(statements)
                if not self._builder.block.is_terminated:
                    self._builder.branch(end)
        self._builder.position_at_end(end)
        if not any(end in _targets(block) for block in self._function.basic_blocks):
            self._builder.unreachable()  # all ways return

    def _assign(self, target: ast.expr, value: Any) -> None:
        if isinstance(target, ast.Tuple) and isinstance(value, tuple) and len(target.elts) == len(value):
            for part, one in zip(target.elts, value, strict=True):
                self._assign(part, one)
        elif isinstance(target, ast.Subscript):
            self._set(target, value)
        elif isinstance(target, ast.Name) and isinstance(value, Array | Record):
            self._names[target.id] = value
        elif isinstance(target, ast.Name):
            self._builder.store(value, self._place(target, value))
        else:
            raise refused(target)

    def _set(self, target: ast.Subscript, value: Any) -> None:
        """Give an element of an array a value, or all elements of an array or a part of it."""
        if not is_whole(target) and len(indices(target)) == self._axes(target):
            self._store(*self._element(target), value)
            return
        whole = self._part(target)
        if isinstance(value, Array) and len(value.lengths) != len(whole.lengths):
            raise refused(target)
        counter = self._first.alloca(INTEGER)
        self._builder.store(self._do.number(0), counter)
        size = functools.reduce(self._product, whole.lengths)

        def element(array: Any) -> tuple[Any, tuple[str, ...]]:
            return self._builder.gep(array.data, [self._builder.load(counter)], inbounds=True), array.path

        def one() -> None:
            self._store(*element(whole), self._load(*element(value)) if isinstance(value, Array) else value)

        self._turns(counter, size, self._do.number(1), one)

    def _axes(self, target: ast.Subscript) -> int:
        owner = self._value(target.value)
        if not isinstance(owner, Array):
            raise refused(target)
        return len(owner.lengths)

    def _place(self, target: ast.Name, value: Any) -> Any:
        """The place of a variable, made for its first value."""
        if target.id not in self._places:
            self._places[target.id] = self._first.alloca(value.type)
        place = self._places[target.id]
        if place.type.pointee != value.type:
            raise ModelError(f"line {target.lineno}: {target.id} has two kinds of values - give it one")
        return place

    def _change(self, node: ast.AugAssign) -> None:
        if isinstance(node.target, ast.Subscript):
            place, path = self._element(node.target)
            self._store(place, path, self._arithmetic(node.op, self._load(place, path), self._value(node.value)))
        elif isinstance(node.target, ast.Name):
            now = self._value(ast.Name(node.target.id))
            self._assign(node.target, self._arithmetic(node.op, now, self._value(node.value)))
        else:
            raise refused(node)


def _given_values(function: ast.FunctionDef) -> set[str]:
    """Names to which a function gives values."""
    return {node.id for node in ast.walk(function) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}


def _may_overlap(one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    """True for an array and itself, and for arrays of a record and of a record inside it."""
    within, others = one[:-1], other[:-1]
    shorter = min(len(within), len(others))
    inside = within != others and shorter > 0 and within[:shorter] == others[:shorter]
    return one == other or inside


def _targets(block: Any) -> Sequence[Any]:
    """Blocks to which a block goes."""
    return [one for one in getattr(block.terminator, "operands", ()) if isinstance(one, ir.Block)]
