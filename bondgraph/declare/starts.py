"""Starts of states beside numbers: the first value of a signal in a log, an expression of parameters.

``initial=omega`` names the symbol of a declared input, ``initial="speed"`` an input or an output by its name, and
``initial=0.25 * omega`` or ``"0.25*speed"`` a share of either. A pair ``(omega, 12.0)`` gives the number, too, at which
the state starts without a log; alone, a signal leaves that to the input's default, or zero. ``initial=C*T0``, or the
same as text, moves with the parameters C and T0 that were declared before.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from sympy import Expr

from bondgraph.coherent import is_quantity
from bondgraph.declare.expressions import parse
from bondgraph.declare.laws import as_expression
from bondgraph.declare.quantities import Input, Parameter, ParameterStart, Start
from bondgraph.errors import DeclarationError, suggest
from bondgraph.units import dimension, unit_text

if TYPE_CHECKING:
    from bondgraph.declare.store import GraphStore

_TEXT = re.compile(r"(?:(?P<factor>[^*]+)\*)?\s*(?P<name>[A-Za-z_][A-Za-z0-9_.]*)\s*\Z")
_HOW = (
    "give a number, an expression of declared parameters, the symbol of an input, the name of an input or output, or a "
    "multiple such as '0.25*speed'"
)


@dataclass(frozen=True)
class Initial:
    """The start of one state: a number in coherent SI, and the signal that comes before it where a log has it.

    Of a start that follows parameters the number is its value at the declared ones. ``unit`` is that of a pint
    quantity; empty for a number.
    """

    value: float
    start: Start | ParameterStart | None = None
    unit: str = field(default="", repr=False)


def initial_of(
    value: Any, where: str, number: Callable[[Any], float], inputs: Mapping[str, Any], units: Collection[str] = ()
) -> Initial:
    """The declared ``initial`` of a state.

    Parameters
    ----------
    value
        A number or pint quantity, an expression of parameters, a signal, or a pair of a signal and a number.
    where
        The place of the declaration, ``graph: name``.
    number
        Brings a number to coherent SI.
    inputs
        What is declared so far, by name.
    units
        Units that the state may have; empty where they are not known yet.

    Raises
    ------
    DeclarationError
        If it is none of these, an input takes text, or its unit does not fit.

    Examples
    --------
    >>> initial_of(2.5, "g: rotor", float, {})
    Initial(value=2.5, start=None)
    >>> initial_of("-0.5*speed", "g: rotor", float, {})
    Initial(value=0.0, start=Start(signal='speed', factor=-0.5))
    """
    signal, rest = value if isinstance(value, tuple | list) and len(value) == 2 else (value, None)
    if not isinstance(signal, str) and not (isinstance(signal, Expr) and signal.free_symbols):
        if rest is not None:
            raise _unreadable(value, where)
        return Initial(number(value), unit=_unit(value))
    followed = _of_parameters(signal, where, inputs)
    if followed is not None:
        if rest is not None:
            raise _unreadable(value, where)
        return Initial(value_of(followed, inputs, where), followed)
    start = _named(signal, where) if isinstance(signal, str) else _of_symbol(signal, where, inputs)
    declared = inputs.get(start.signal)
    if declared is None and not isinstance(signal, str) and "." not in start.signal:
        raise DeclarationError(
            f"{where}: initial {start}: {start.signal!r} is not declared{suggest(start.signal, inputs)} - declare the "
            "input first, or name an output as text",
            where=(where.rpartition(": ")[2], start.signal),
        )
    if isinstance(declared, Input):
        check_start(start, declared, where, units)
        return Initial(start.factor * declared.default if rest is None else number(rest), start, _unit(rest))
    return Initial(0.0 if rest is None else number(rest), start, _unit(rest))


def _unit(value: Any) -> str:
    return unit_text(value.units) if is_quantity(value) else ""


def check_initial_unit(given: str, variable: str, unit: str, where: str) -> None:
    """Refuse a start in the unit of another variable of a storage than its state, which its law decides.

    Raises
    ------
    DeclarationError
        If the dimensions differ.

    Examples
    --------
    >>> check_initial_unit("km/h", "flow", "m/s", "car: mass")
    >>> try:
    ...     check_initial_unit("degC", "displacement", "J", "oven: load")
    ... except DeclarationError as error:
    ...     print(error.message.partition(" - ")[0])
    oven: load: initial is given in 'degC', but the state is the displacement in 'J'
    """
    if given and unit and dimension(given) != dimension(unit):
        raise DeclarationError(
            f"{where}: initial is given in {given!r}, but the state is the {variable} in {unit!r} - give it in "
            f"{unit!r}; a log that measures the element begins at what its sensor shows",
            where=(where.rpartition(": ")[2],),
        )


def starts_of(initials: Sequence[Initial]) -> tuple[Start | ParameterStart | None, ...]:
    """The signals and expressions of several starts, nothing where all are numbers."""
    found = tuple(one.start for one in initials)
    return found if any(found) else ()


def check_start(start: Start, signal: Any, where: str, units: Collection[str]) -> None:
    """Raise DeclarationError where a signal takes text, or its unit is none of those the state may have."""
    name = where.rpartition(": ")[2]
    if getattr(signal, "letters", ()):
        raise DeclarationError(
            f"{where}: initial {start}: {start.signal} takes text, a state starts at a number - name another signal",
            where=(name, start.signal),
        )
    known = [unit for unit in units if unit]
    if signal.unit and known and dimension(signal.unit) not in [dimension(unit) for unit in known]:
        raise DeclarationError(
            f"{where}: initial {start}: {start.signal} is in {signal.unit!r}, the state in "
            f"{' or '.join(map(repr, known))} - name a signal of that unit, or give a "
            "number: a log begins at what its sensor shows",
            where=(name, start.signal),
        )


def check_starts(graph: GraphStore) -> None:
    """Raise DeclarationError where a state of a (flat) graph starts at a signal or parameter that it does not have."""
    signals = signals_of(graph)
    listed = [(node.name, start) for node in graph.nodes.values() for start in node.starts]
    for name, start in [*listed, *((one.name, one.start) for one in graph.integrals)]:
        if start is None:
            continue
        where = f"{graph.name}: {name}"
        if isinstance(start, ParameterStart):
            value_of(start, graph.quantities, where)
            continue
        if start.signal not in signals:
            raise DeclarationError(
                f"{where}: initial {start}: no input or output {start.signal!r}{suggest(start.signal, signals)} - it "
                f"has {', '.join(signals) or 'none'}",
                where=(name, start.signal),
            )
        check_start(start, signals[start.signal], where, ())


def signals_of(graph: GraphStore) -> dict[str, Any]:
    """Inputs and outputs of a (flat) graph by name; an input comes before an output of the same name."""
    found: list[Any] = [*graph.outputs, *graph.inputs]
    return {one.name: one for one in found}


def value_of(start: ParameterStart, declared: Mapping[str, Any], where: str) -> float:
    """The value of a start that follows parameters, at the declared ones.

    Raises
    ------
    DeclarationError
        If it is no number there, or uses something else than parameters.
    """
    names = sorted(used.name for used in start.expression.free_symbols)
    values = {name: one.value for name in names if isinstance(one := declared.get(name), Parameter)}
    if len(values) < len(names):
        raise _unreadable(start, where)
    value = start.expression.subs({used: values[used.name] for used in start.expression.free_symbols})
    if not (value.is_number and value.is_real and math.isfinite(float(value))):
        raise DeclarationError(
            f"{where}: initial {start} has no value at the declared parameters ({value}) - correct it or their values",
            where=(where.rpartition(": ")[2], *names),
        )
    return float(value)


def restarted(graph: GraphStore) -> None:
    """Bring the numbers of starts that follow parameters to the values that these have now."""
    for name, node in graph._nodes.items():
        if any(isinstance(one, ParameterStart) for one in node.starts):
            pairs = zip(node.initial, node.starts, strict=True)
            values = tuple(_restarted(graph, name, value, start) for value, start in pairs)
            graph._nodes[name] = dataclasses.replace(node, initial=values)
    for one in graph.integrals:
        if isinstance(one.start, ParameterStart):
            value = _restarted(graph, one.name, one.initial, one.start)
            graph._quantities[one.name] = dataclasses.replace(one, initial=value)


def _restarted(graph: GraphStore, name: str, value: float, start: Start | ParameterStart | None) -> float:
    if not isinstance(start, ParameterStart):
        return value
    return value_of(start, graph.quantities, f"{graph.name}: {name}")


def renamed_start(
    initial: Initial,
    rename: Callable[[str], str],
    bound: Mapping[str, Expr],
    outside: Callable[[Expr], Expr],
    where: str,
) -> Initial:
    """The start of a part's state in the names of the graph around it, which may bind what it starts at."""
    start = initial.start
    if start is None:
        return initial
    if isinstance(start, ParameterStart):
        told = outside(start.expression)
        return Initial(initial.value, ParameterStart(told)) if told.free_symbols else Initial(float(told))
    if start.signal not in bound:
        return Initial(initial.value, dataclasses.replace(start, signal=rename(start.signal)))
    expression = bound[start.signal] * start.factor
    if not expression.free_symbols:
        return Initial(float(expression))
    outer = _of_symbol(expression, where, {})
    return Initial(initial.value, outer)


def _named(text: str, where: str) -> Start:
    found = _TEXT.match(text.strip())
    try:
        if found is not None:
            return _start(found["name"], float(found["factor"] or 1.0), text, where)
    except ValueError:
        pass
    raise _unreadable(text, where)


def _of_symbol(signal: Expr, where: str, inputs: Mapping[str, Any]) -> Start:
    factor, symbol = as_expression(signal, where).as_coeff_Mul()
    if not symbol.is_Symbol:
        raise _unreadable(signal, where)
    if symbol.name in inputs and not isinstance(inputs[symbol.name], Input):
        raise _unreadable(signal, where)
    return _start(symbol.name, float(factor), signal, where)


def _of_parameters(given: Any, where: str, declared: Mapping[str, Any]) -> ParameterStart | None:
    """The start that an expression of declared parameters, or its text, is; None where it is something else."""
    known = {name: one.symbol for name, one in declared.items() if isinstance(one, Parameter)}
    if isinstance(given, str):
        try:
            found = parse(given, known, where)
        except DeclarationError:
            return None
    else:
        found = as_expression(given, where)
    names = {used.name for used in found.free_symbols}
    return ParameterStart(found) if names and names <= set(known) else None


def _start(signal: str, factor: float, given: Any, where: str) -> Start:
    if not math.isfinite(factor) or factor == 0.0:
        raise _unreadable(given, where)
    return Start(signal, factor)


def _unreadable(given: Any, where: str) -> DeclarationError:
    name = where.rpartition(": ")[2]
    return DeclarationError(f"{where}: initial {given} is no start of a state - {_HOW}", where=(name,))
