"""Numbers as they are declared, in whatever unit, brought to coherent SI at the declaring line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import pint

from bondgraph.coherent import coherent, in_si, is_quantity
from bondgraph.declare.domains import Domain
from bondgraph.declare.quantities import Table
from bondgraph.errors import DeclarationError
from bondgraph.units import dimension, unit_text

_Read = TypeVar("_Read")


@dataclass(frozen=True)
class DeclaredUnit:
    """The unit of one declaration: its coherent SI ``unit``, and itself as ``shown`` where it is another.

    Examples
    --------
    >>> declared_unit("kN", "g: F", 2.0)
    DeclaredUnit(unit='N', shown='kN', factor=1000.0, text='kN', where='g: F')
    >>> declared_unit("kN", "g: F", 2.0).number(2.0)
    2000.0
    """

    unit: str
    shown: str
    factor: float
    text: str
    where: str

    def number(self, value: Any) -> float:
        """A declared number, or a pint quantity, in coherent SI."""
        if is_quantity(value):
            return float(_located(self.where, lambda: in_si(value, self.unit)))
        return float(value) * self.factor if self.factor != 1.0 else float(value)


def declared_unit(unit: str | pint.Unit | None, where: str, value: Any = 20.0) -> DeclaredUnit:
    """The unit of a declaration at ``where`` (``graph: name``), that of its ``value`` where that is a pint quantity.

    Raises
    ------
    DeclarationError
        If there is no unit, it is unknown, has an offset or is a logarithm.
    """
    if isinstance(unit, pint.Unit):
        unit = unit_text(unit)
    if not unit and is_quantity(value):
        unit = unit_text(value.units)
    if unit is None:
        raise DeclarationError(f"{where}: {value} has no unit - give one, '1' for a pure number", where=(where,))
    number = value.magnitude if is_quantity(value) else value
    number = number if isinstance(number, int | float) else 20.0
    text = unit
    own, factor = _located(where, lambda: coherent(text, float(number)))
    return DeclaredUnit(own, "" if own == text else text, factor, text, where)


def coherent_table(table: Table, where: str) -> Table:
    """A table whose points and values are given in its units, in coherent SI.

    Examples
    --------
    >>> coherent_table(Table("T", (0.0, 60.0), (1.0, 2.0), (), "kN m", ("rpm",)), "g: T").values
    (1000.0, 2000.0)
    """
    own = declared_unit(table.unit, where)
    arguments = [declared_unit(unit, where) for unit in table.argument_units]
    numbers: list[Callable[[Any], float]] = [*(one.number for one in arguments), float, float]
    rows: Any = tuple(tuple(map(own.number, row)) for row in table.values) if table.y else None  # type: ignore[arg-type]
    shown = any(one.shown for one in arguments)
    return Table(
        table.name,
        tuple(map(numbers[0], table.x)),
        rows or tuple(map(own.number, table.values)),
        tuple(map(numbers[1], table.y)),
        own.unit,
        tuple(one.unit for one in arguments),
        table.meaning,
        own.shown,
        tuple(one.text for one in arguments) if shown else (),
    )


def storage_units(kind: str, domain: Domain | None) -> tuple[str, ...]:
    """Units that the start value of a storage may have: those of its variables, none where the domain is not known."""
    if domain is None:
        return ()
    return (domain.flow_unit, domain.momentum_unit) if kind == "I" else (domain.effort_unit, domain.displacement_unit)


def initial_value(value: Any, where: str, units: Sequence[str] = ()) -> float:
    """The start value of a storage: a number in coherent SI, or a pint quantity that fits one of its ``units``.

    Raises
    ------
    DeclarationError
        If it fits none of them.

    Examples
    --------
    >>> from bondgraph.units import registry
    >>> initial_value(registry().Quantity(36.0, "km/h"), "car: mass")
    10.0
    """
    if not is_quantity(value):
        return float(value)
    if units and dimension(unit_text(value.units)) not in [dimension(unit) for unit in units]:
        raise DeclarationError(f"{where}: initial {value:~} must be in {' or '.join(map(repr, units))}", where=(where,))
    return float(_located(where, lambda: in_si(value)))


def _located(where: str, read: Callable[[], _Read]) -> _Read:
    """What ``read`` gives; a refusal is told with the place of the declaration."""
    try:
        return read()
    except DeclarationError as error:
        name = where.rpartition(": ")[2]
        raise DeclarationError(f"{where}: {error.message}", where=(name,)) from None
