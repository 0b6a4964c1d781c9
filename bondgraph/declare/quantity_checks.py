"""Checks of single declared quantities, and what they may be called."""

from __future__ import annotations

import itertools
import math
import re
from typing import Any

from bondgraph.coherent import coherent
from bondgraph.declare.other_names import such_as
from bondgraph.declare.quantities import Input, Integral, NamedSignal, Output, Parameter, Table
from bondgraph.errors import DeclarationError

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z0-9_]+)*\Z")
_RESERVED = re.compile(r"(t|pi|(effort|flow|displacement|momentum)\d*)\Z")

Quantity = Input | Parameter | Table | Integral | NamedSignal | Output


def is_free_name(name: str) -> bool:
    """Whether a quantity or state may be called so.

    Examples
    --------
    >>> is_free_name("front.J"), is_free_name("2nd"), is_free_name("flow1")
    (True, False, False)
    """
    return bool(_NAME.match(name)) and not _RESERVED.match(name)


def check_quantity(quantity: Quantity, graph: str) -> None:
    """Raise DeclarationError unless name, unit, values and bounds of a quantity are possible."""
    name = quantity.name
    where = f"{graph}: {name}"
    if not _NAME.match(name):
        raise DeclarationError(
            f"{graph}: name {name!r} - use letters, digits and underscores{such_as(name)}", where=(name,)
        )
    if _RESERVED.match(name) and not isinstance(quantity, Output):
        raise DeclarationError(
            f"{where}: this name is reserved for time, pi and the elements' own variables - use another", where=(name,)
        )
    try:
        for unit in (quantity.unit, *getattr(quantity, "argument_units", ())):
            _check_coherent(unit)
    except DeclarationError as error:
        raise DeclarationError(f"{where}: {error.message}", where=(name,)) from None
    for label in ("value", "default", "initial"):
        value = getattr(quantity, label, 0.0)
        if not math.isfinite(value):
            raise DeclarationError(f"{where}: {label} {value} must be a finite number", where=(name,))
    if isinstance(quantity, Parameter) and quantity.bounds is not None:
        _check_bounds(quantity, where)
    if isinstance(quantity, Parameter) and quantity.tolerance is not None:
        _check_tolerance(quantity, where)


def _check_tolerance(parameter: Parameter, where: str) -> None:
    tolerance = parameter.tolerance
    if not (isinstance(tolerance, (int, float)) and 0.0 <= tolerance < 1.0):
        raise DeclarationError(
            f"{where}: tolerance {tolerance!r} must be a share of the value, from 0 (exact) to below 1 - "
            "give 0.04 for four percent",
            where=(parameter.name,),
        )


def _check_coherent(unit: str) -> None:
    own, _ = coherent(unit)
    if own != unit:
        raise DeclarationError(f"unit {unit!r} is not coherent SI - give numbers in {own!r} and shown_unit={unit!r}")


def _check_bounds(parameter: Parameter, where: str) -> None:
    assert parameter.bounds is not None
    lower, upper = (parameter.shown(bound) for bound in parameter.bounds)
    if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper):
        raise DeclarationError(
            f"{where}: bounds ({lower}, {upper}) must be two finite numbers, the lower first", where=(parameter.name,)
        )
    value = parameter.shown(parameter.value)
    if not lower <= value <= upper:
        raise DeclarationError(
            f"{where}: value {value} {parameter.display_unit} lies outside its bounds ({lower}, {upper}) - "
            "correct the value or widen the bounds",
            where=(parameter.name,),
        )


def check_table(table: Table, graph: str) -> None:
    """Raise DeclarationError unless a table has increasing arguments and one finite value for each."""
    where = f"{graph}: table {table.name}"
    for label, points in (("x", table.x), ("y", table.y)):
        if label == "y" and not points:
            continue
        if len(points) < 2 or any(b <= a for a, b in itertools.pairwise(points)):
            raise DeclarationError(
                f"{where}: {label} must have at least 2 strictly increasing points, got {list(points)[:6]}",
                where=(table.name,),
            )
    rows: Any = table.values
    if len(rows) != len(table.x) or (table.y and any(len(row) != len(table.y) for row in rows)):
        shape = f"{len(table.x)} rows of {len(table.y)}" if table.y else str(len(table.x))
        raise DeclarationError(f"{where}: needs {shape} values, got {len(rows)}", where=(table.name,))
    flat = [value for row in rows for value in row] if table.y else list(rows)
    if not all(math.isfinite(value) for value in (*flat, *table.x, *table.y)):
        raise DeclarationError(f"{where}: all points and values must be finite", where=(table.name,))
