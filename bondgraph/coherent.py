"""Coherent SI: the unit in which a quantity is computed, and the unit in which it is shown and read."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Any, TypeVar, cast

import pint

from bondgraph.errors import DeclarationError
from bondgraph.units import dimension, dimension_text, parse_unit, product_text, registry, unit_text

#: Units with a name of their own that stand for a named unit of the same dimension: kN for N, psi for Pa, hp for W.
_NAMED = ("N", "Pa", "J", "W", "V", "C", "ohm", "S", "F", "H", "Wb", "T")
#: Order in which a unit is written: ``N m``, ``kg m^2``, ``V s``.
_ORDER = (*_NAMED, "kg", "A", "K", "mol", "cd", "m", "rad", "s")


def coherent(unit: str, value: float = 20.0) -> tuple[str, float]:
    """The coherent SI unit of a declared unit, and the factor into it; a unit that is coherent is given back itself.

    Parameters
    ----------
    unit
        A unit string.
    value
        A number declared in it, for the message.

    Raises
    ------
    DeclarationError
        If the unit is unknown, has an offset (degC) or is a logarithm (dB): no factor leads from it to the SI.

    Examples
    --------
    >>> coherent("lb"), coherent("kN/mm"), coherent("N m/A"), coherent("1")
    (('kg', 0.45359237), ('N/m', 1000000.0), ('N m/A', 1.0), ('1', 1.0))
    >>> coherent("degC")
    Traceback (most recent call last):
    ...
    bondgraph.errors.DeclarationError: unit 'degC' has an offset - write kelvins, 293.15 K for 20 degC, or 'delta_degC'
    for a difference of temperatures; columns of logs may be in degC
    """
    try:
        return _coherent(unit)
    except _OffsetError:
        parsed = parse_unit(unit)
        si = f"{_in_base(value, parsed, unit):.10g} {_coherent_text(parsed)}"
        raise DeclarationError(
            f"unit {unit!r} has an offset - write kelvins, {si} for {value:g} {unit}, or 'delta_{unit}' "
            f"for a difference of temperatures; columns of logs may be in {unit}",
            where=(unit,),
        ) from None


def has_offset(unit: str) -> bool:
    """True for a unit whose zero is not that of the SI.

    Raises
    ------
    DeclarationError
        If the unit is unknown or a logarithm.

    Examples
    --------
    >>> has_offset("degC"), has_offset("delta_degC"), has_offset("K")
    (True, False, False)
    """
    try:
        _coherent(unit)
    except _OffsetError:
        return True
    return False


class _OffsetError(Exception):
    """A unit whose zero is not that of the SI."""


@functools.cache
def _coherent(unit: str) -> tuple[str, float]:
    parsed = parse_unit(unit)
    zero, one, two = (_in_base(number, parsed, unit) for number in (0.0, 1.0, 2.0))
    if abs(two - 2.0 * one + zero) > 1e-9 * abs(two):
        raise DeclarationError(f"unit {unit!r} is a logarithm - write the ratio or the level itself", where=(unit,))
    if zero != 0.0:
        raise _OffsetError
    factor = _shortest(one)
    return (unit, 1.0) if factor == 1.0 else (_coherent_text(parsed), factor)


def _in_base(value: float, parsed: pint.Unit, unit: str) -> float:
    try:
        return float(registry().Quantity(value, parsed).to_base_units().magnitude)
    except pint.PintError as error:  # a logarithm or an offset within a product
        raise DeclarationError(f"unit {unit!r} has no factor to the SI ({error}) - write SI units", (unit,)) from None


def _shortest(factor: float) -> float:
    """A factor without the rounding of the products from which it came: 0.45359237, not 0.4535923700000001."""
    short = float(f"{factor:.14g}")
    return short if abs(factor - short) <= 4.0 * math.ulp(factor) else factor


def _coherent_text(parsed: pint.Unit) -> str:
    """The coherent SI unit of the same dimension, written with the named units of which the unit consists."""
    powers: dict[str, Any] = {}
    for name, power in registry().Quantity(1.0, parsed).unit_items():
        for symbol, own in _coherent_parts(name).items():
            powers[symbol] = powers.get(symbol, 0) + own * power
    ordered = sorted(((symbol, power) for symbol, power in powers.items() if power), key=lambda p: _ORDER.index(p[0]))
    return product_text(ordered)


@functools.cache
def _coherent_parts(name: str) -> Mapping[str, Any]:
    """Powers of SI units that make up one unit of the registry."""
    for symbol in _NAMED:
        if dimension(name) == dimension(symbol):
            return {symbol: 1}
    bases = list(registry().Quantity(1.0, name).to_base_units().unit_items())
    return {f"{registry().Unit(base):~}": power for base, power in bases}


_Numbers = TypeVar("_Numbers", bound=Any)


class Displayed:
    """A quantity that is computed in coherent SI and shown and read in the unit in which it was declared.

    ``unit`` is that of all numbers inside; ``shown_unit`` is empty where the declared unit is that one.
    """

    unit: str
    shown_unit: str

    @property
    def display_unit(self) -> str:
        """The unit that stands beside the quantity wherever it is shown or read."""
        return self.shown_unit or self.unit

    def shown(self, value: _Numbers) -> _Numbers:
        """A value, or an array of values or differences, in the unit in which it is shown."""
        return displayed(value, self.shown_unit)

    def coherent(self, value: _Numbers) -> _Numbers:
        """A value given in the unit in which the quantity is shown, in coherent SI."""
        found: _Numbers = value * coherent(self.shown_unit)[1] if self.shown_unit else value
        return found


def displayed(value: _Numbers, unit: str) -> _Numbers:
    """A value in coherent SI in a unit; where a decimal number leads back to the same value, that one.

    Examples
    --------
    >>> displayed(80 * 0.45359237, "lb"), displayed(3.0, "")
    (80.0, 3.0)
    """
    factor = coherent(unit)[1] if unit else 1.0
    if factor == 1.0:
        return value
    if isinstance(value, float):
        for digits in (15, 16):
            short = float(f"{value / factor:.{digits}g}")
            if short * factor == value:
                return cast(_Numbers, short)
    return cast(_Numbers, value / factor)


def in_si(value: Any, unit: str = "") -> Any:
    """The number of a pint quantity, of whatever registry, in coherent SI; ``unit`` is what it has to fit.

    Raises
    ------
    DeclarationError
        If it does not fit; a temperature in degC fits no unit of differences.

    Examples
    --------
    >>> in_si(registry().Quantity(2.0, "kN"), "N"), in_si(registry().Quantity(20.0, "degC"), "K")
    (2000.0, 293.15)
    """
    text = unit_text(value.units)
    if unit and dimension(text) != dimension(unit):
        need = dimension_text(dimension(unit))
        raise DeclarationError(f"{value:~} is {dimension_text(dimension(text))}, not {need} as {unit!r} is", (unit,))
    try:
        return value.magnitude * coherent(text)[1]
    except DeclarationError:
        given = registry().Quantity(value.magnitude, parse_unit(text))
        try:
            _ = given.to(parse_unit(unit)) if unit else given
        except pint.DimensionalityError:  # pint keeps degC from units of differences, whose dimension is the same
            raise DeclarationError(
                f"{value:~} is counted from another zero than kelvins, {unit!r} is for differences of temperatures - "
                f"write the difference itself in {unit}",
                where=(unit,),
            ) from None
        return given.to_base_units().magnitude


def is_quantity(value: Any) -> bool:
    """True for a pint quantity of any registry."""
    return isinstance(value, pint.Quantity)
