"""Models that are no bond graphs: state equations of one's own, as expressions or as a Python function.

What comes out is a model like any other: it simulates, filters and estimates with the same compiled kernels and exact
derivatives, and its text is a generated module that ``bondgraph.load`` reads and the commands take.
"""

from __future__ import annotations

import ast
import inspect
import keyword
import linecache
import math
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bondgraph.coherent import coherent
from bondgraph.errors import ModelError, suggest
from bondgraph.simulate.model import Model
from bondgraph.simulate.traced import CALLED, Traced, TraceError, constant, lines_of, noted
from bondgraph.syntax import parsed

#: Rates or outputs: expressions by name, or a function of ``(t, x, u, theta)``.
Given = Mapping[str, str] | Callable[..., Any]

_RESERVED = ("t", "x", "u", "theta", "np")
_STACK = '''def _stack(x, rows):
    """Rows, each a number or of the batch shape of x, as one array of shape (len(rows), *batch)."""
    stacked = np.empty((len(rows), *x.shape[1:]))
    for i, row in enumerate(rows):
        stacked[i] = row
    return stacked
'''


class _Vector(tuple[Traced, ...]):
    """Quantities of one kind, by place or by name: ``x[0]``, ``x.speed``, ``x["speed"]``."""

    names: tuple[str, ...]

    @classmethod
    def of(cls, names: Sequence[str]) -> _Vector:
        vector = cls(Traced(ast.Name(_local(name), ast.Load())) for name in names)
        vector.names = tuple(names)
        return vector

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # numpy asks for protocols
            raise AttributeError(name)
        return self[name]

    def __getitem__(self, key: Any) -> Any:
        if not isinstance(key, str):
            return super().__getitem__(key)
        if key not in self.names:
            raise TraceError(f"there is no {key!r}{suggest(key, self.names)} - there are {', '.join(self.names)}")
        return super().__getitem__(self.names.index(key))


class _Tables(NamedTuple):
    """What is declared: names with their numbers, and units by name."""

    name: str
    states: Mapping[str, float]
    inputs: Mapping[str, float | None]
    parameters: Mapping[str, float | tuple[float, float, float]]
    units: Mapping[str, str]

    def unit(self, name: str) -> str:
        return self.units.get(name, "1")

    @property
    def vectors(self) -> tuple[_Vector, _Vector, _Vector]:
        return _Vector.of(list(self.states)), _Vector.of(list(self.inputs)), _Vector.of(list(self.parameters))


def state_space(
    name: str,
    *,
    states: Mapping[str, float],
    rates: Given,
    outputs: Given,
    inputs: Mapping[str, float | None] | None = None,
    parameters: Mapping[str, float | tuple[float, float, float]] | None = None,
    units: Mapping[str, str] | None = None,
    doc: str = "",
) -> Model:
    """A model of state equations that come from no graph.

    A function is called once with quantities in place of numbers, so that it must be arithmetic, functions of numpy and
    ``numpy.where``; loops over fixed ranges and functions that it calls are followed. A function that computes in
    another way, or a module that another program wrote, becomes a model as a module of the format of
    :func:`bondgraph.simulate.model.load`.

    Parameters
    ----------
    name
        Of the model.
    states
        Start values by name.
    rates
        Time derivatives: an expression for each state (``"mu*(1 - x**2)*v - x"``, with ``t`` for the time in s), or a
        function of ``(t, x, u, theta)`` that gives them in the order of the states, or by name. Elements are found by
        place or by name: ``x[0]``, ``x.speed``.
    outputs
        What is measured: expressions by name, or a function that gives a dict.
    inputs
        Defaults by name; None: no default, a log must have it. They run straight between samples.
    parameters
        Values by name; (value, lower, upper) of those that may be estimated.
    units
        Coherent SI units by name, also of outputs; those not named are pure numbers.
    doc
        What the model is.

    Raises
    ------
    ModelError
        If a name or a unit cannot be used, an expression cannot be read, or what a function does cannot be followed;
        the message says in which line.

    Examples
    --------
    >>> import bondgraph as bg
    >>> model = bg.state_space(
    ...     "van_der_pol", states={"x": 2.0, "v": 0.0}, parameters={"mu": (1.0, 0.1, 10.0)},
    ...     rates={"x": "v", "v": "mu*(1 - x**2)*v - x"}, outputs={"position": "x"},
    ... )
    >>> model.jacobian_x(0.0, model.x0(), model.u0(), model.theta()).tolist()
    [[0.0, 1.0], [-1.0, -3.0]]

    >>> def rates(t, x, u, theta):
    ...     prey, predator = x
    ...     eaten = theta.hunger * prey * predator
    ...     return theta.growth * prey - eaten, 0.5 * eaten - theta.loss * predator
    >>> bg.state_space(
    ...     "lotka_volterra", states={"prey": 10.0, "predator": 5.0}, rates=rates, outputs={"seen": "prey"},
    ...     parameters={"growth": (1.0, 0.1, 3.0), "hunger": (0.1, 0.01, 1.0), "loss": (0.8, 0.1, 3.0)},
    ...     units={"growth": "1/s", "hunger": "1/s", "loss": "1/s"},
    ... )
    <Model lotka_volterra: 2 states, 0 inputs, 3 parameters, 1 output>
    """
    tables = _Tables(name, states, inputs or {}, parameters or {}, units or {})
    _check_names(tables)
    _check_bounds(tables)
    derivatives = _followed(tables, rates, "rates")
    if isinstance(derivatives, Mapping):
        _require_same(tables, derivatives, list(states), "rates")
        derivatives = [derivatives[state] for state in states]
    if len(derivatives) != len(states):
        raise ModelError(
            f"{name}: rates gives {len(derivatives)} numbers for {len(states)} states - give one for each of"
            f" {', '.join(states)}",
            where=(name, "rates"),
        )
    measured = _followed(tables, outputs, "outputs")
    if not isinstance(measured, Mapping):
        raise ModelError(f"{name}: outputs gives numbers without names - let it return a dict", where=(name, "outputs"))
    _check_units(tables, list(measured))
    return Model.from_text(_module(tables, doc, derivatives, measured), name)


def _check_names(tables: _Tables) -> None:
    every = [*tables.states, *tables.inputs, *tables.parameters]
    for one in every:
        if not one.isidentifier() or keyword.iskeyword(one) or one in CALLED:
            raise ModelError(
                f"{tables.name}: {one!r} cannot name a quantity - use letters, digits and _, and no function's name",
                where=(tables.name, one),
            )
        if every.count(one) > 1:
            raise ModelError(f"{tables.name}: {one!r} names two quantities - rename one", where=(tables.name, one))
    if not tables.states:
        raise ModelError(f"{tables.name}: there are no states - give at least one", where=(tables.name, "states"))


def _check_bounds(tables: _Tables) -> None:
    for one, given in tables.parameters.items():
        values = given if isinstance(given, tuple | list) else (given,)
        good = all(isinstance(value, int | float) and math.isfinite(value) for value in values)
        if not good or len(values) not in (1, 3) or sorted(values) != [*values[1:2], values[0], *values[2:]]:
            raise ModelError(
                f"{tables.name}: parameter {one!r} is {given!r} - give a finite number, or (value, lower, upper) with"
                " the value between its bounds",
                where=(tables.name, one),
            )


def _check_units(tables: _Tables, outputs: Sequence[str]) -> None:
    known = [*tables.states, *tables.inputs, *tables.parameters, *outputs]
    for one, unit in tables.units.items():
        if one not in known:
            raise ModelError(
                f"{tables.name}: units names {one!r}{suggest(one, known)} - there are {', '.join(known)}",
                where=(tables.name, one),
            )
        si, factor = coherent(unit)
        if factor != 1.0:
            raise ModelError(
                f"{tables.name}: {one} is in [{unit}], and equations are in coherent SI - write them in [{si}]",
                where=(tables.name, one),
            )


def _require_same(tables: _Tables, found: Mapping[str, object], wanted: Sequence[str], what: str) -> None:
    unknown = [f"of {one!r}, which is none{suggest(one, wanted)}" for one in found if one not in wanted]
    wrong = unknown or [f"has nothing for {one!r}" for one in wanted if one not in found]
    if wrong:
        raise ModelError(
            f"{tables.name}: {what} {wrong[0]} - give one for each of {', '.join(wanted)}", where=(tables.name, what)
        )


def _followed(tables: _Tables, given: Given, what: str) -> Mapping[str, Any] | list[Any]:
    """Rates or outputs as expressions of the quantities."""
    if isinstance(given, Mapping):
        return {one: _read(tables, f"{what} of {one}", text) for one, text in given.items()}
    parameters = list(inspect.signature(given).parameters)
    if len(parameters) != 4:
        raise ModelError(
            f"{tables.name}: {what} is a function of ({', '.join(parameters)}) - let it take (t, x, u, theta)",
            where=(tables.name, what),
        )
    try:
        found = given(Traced(ast.Name("t", ast.Load())), *tables.vectors)
    except Exception as error:  # whatever the function does, its line is told
        raise ModelError(
            f"{tables.name}: {what}: {_place(given, error)}: {error}", where=(tables.name, what)
        ) from error
    if isinstance(found, Mapping):
        return {str(one): value for one, value in found.items()}
    if isinstance(found, Traced | float | int):
        return [found]
    if not isinstance(found, Iterable):
        raise ModelError(
            f"{tables.name}: {what} gives {found!r} - let it return its numbers", where=(tables.name, what)
        )
    return list(found)


def _place(function: Callable[..., Any], error: Exception) -> str:
    """The line in which a function failed, as its source has it."""
    own = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename != __file__]
    traced = inspect.getsourcefile(Traced)
    own = [frame for frame in own if frame.filename != traced] or own
    if not own:
        return getattr(function, "__name__", "function")
    text = linecache.getline(own[-1].filename, own[-1].lineno or 0).strip()
    return f"line {own[-1].lineno}{f' ({text})' if text else ''}"


def _read(tables: _Tables, what: str, text: str) -> Any:
    """An expression in the names of the quantities."""
    known: dict[str, Any] = {"t": Traced(ast.Name("t", ast.Load())), "pi": math.pi}
    for vector in tables.vectors:
        known.update(zip(vector.names, vector, strict=True))
    try:
        return _evaluated(parsed(text.strip(), mode="eval").body, known)
    except (SyntaxError, ValueError, TypeError, RecursionError, TraceError) as error:
        reason = error.msg if isinstance(error, SyntaxError) else error
        raise ModelError(
            f"{tables.name}: {what}: {text!r} cannot be read ({reason}) - write it like 'k*x - sqrt(c)*v'",
            where=(tables.name, what),
        ) from None


_BINARY: Mapping[type, str] = {
    ast.Add: "add", ast.Sub: "subtract", ast.Mult: "multiply", ast.Div: "divide", ast.Pow: "power", ast.Mod: "mod",
    ast.BitAnd: "logical_and", ast.BitOr: "logical_or",
}  # fmt: skip
_COMPARED: Mapping[type, str] = {
    ast.Lt: "less", ast.LtE: "less_equal", ast.Gt: "greater", ast.GtE: "greater_equal",
}  # fmt: skip
_UNARY: Mapping[type, str] = {ast.USub: "negative", ast.Invert: "logical_not"}


def _evaluated(node: ast.expr, known: Mapping[str, Any]) -> Any:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return node.value
    if isinstance(node, ast.Name):
        if node.id not in known:
            raise TraceError(f"there is no {node.id!r}{suggest(node.id, known)}")
        return known[node.id]
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        return noted(_BINARY[type(node.op)], _evaluated(node.left, known), _evaluated(node.right, known))
    if isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
        return noted(_UNARY[type(node.op)], _evaluated(node.operand, known))
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _COMPARED:
        sides = [_evaluated(side, known) for side in (node.left, node.comparators[0])]
        return noted(_COMPARED[type(node.ops[0])], *sides)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        return noted(node.func.id, *(_evaluated(one, known) for one in node.args))
    raise TraceError(f"{ast.unparse(node)!r} is no arithmetic")


def _local(name: str) -> str:
    """The name of a quantity in the functions of the module, whose arguments have names of their own."""
    return f"{name}_" if name in _RESERVED else name


def _module(tables: _Tables, doc: str, rates: Sequence[Any], outputs: Mapping[str, Any]) -> str:
    """The text of the generated module."""
    ends = [value if isinstance(value, tuple) else (value, None, None) for value in tables.parameters.values()]
    rows: dict[str, Sequence[tuple[Any, ...]]] = {
        "STATES": [(one, tables.unit(one), float(value), "state") for one, value in tables.states.items()],
        "INPUTS": [
            (one, tables.unit(one), float(value or 0.0), "linear", None, "input")
            for one, value in tables.inputs.items()
        ],
        "PARAMETERS": [
            (one, tables.unit(one), *(None if end is None else float(end) for end in values), "parameter")
            for one, values in zip(tables.parameters, ends, strict=True)
        ],
        "OUTPUTS": [(one, tables.unit(one), "output") for one in outputs],
    }
    zeros = tuple(one for one, value in tables.inputs.items() if value == 0.0)
    parts = [f"{(doc or f'State equations of {tables.name}.')!r}\nimport numpy as np\n"]
    head = [f"NAME = {tables.name!r}", 'FORMAT = "bondgraph-module/1"', f"ZERO_DEFAULTS = {zeros!r}"]
    parts.append("\n".join([*head, *(f"{table} = {_table(values)}" for table, values in rows.items())]) + "\n\n")
    parts += [_function(tables, "rhs", rates), _function(tables, "output", list(outputs.values())), _STACK]
    return "\n".join(parts)


def _table(rows: Sequence[tuple[Any, ...]]) -> str:
    return "(\n" + "".join(f"    {row!r},\n" for row in rows) + ")" if rows else "()"


def _function(tables: _Tables, name: str, roots: Sequence[Any]) -> str:
    kinds = zip(("x", "u", "theta"), (tables.states, tables.inputs, tables.parameters), strict=True)
    unpacked = [f"{_local(one)} = {kind}[{k}]" for kind, names in kinds for k, one in enumerate(names)]
    lines, rows = lines_of([_checked(tables, name, root) for root in roots], _prefix(tables))
    body = [*unpacked, *lines, f"return _stack(x, ({''.join(f'{row}, ' for row in rows)}))"]
    return f"def {name}(t, x, u, theta):\n" + "".join(f"    {line}\n" for line in body) + "\n"


def _checked(tables: _Tables, name: str, root: Any) -> Traced:
    if isinstance(root, Traced):
        return root
    if isinstance(root, float | int | np.number) and math.isfinite(root):
        return constant(float(root))
    raise ModelError(
        f"{tables.name}: {name} gives {root!r} - give arithmetic of quantities, or a number", where=(tables.name, name)
    )


def _prefix(tables: _Tables) -> str:
    """Beginning of the names of intermediate results, with which no quantity begins."""
    prefix = "part"
    while any(one.startswith(prefix) for one in (*tables.states, *tables.inputs, *tables.parameters)):
        prefix = f"_{prefix}"
    return prefix
