"""Units: one registry (pint), conversion to SI, and dimensions as exponent vectors.

Inside the toolkit every number is in SI; other units appear only where a unit string is written next to a declared
value or in the header of a log. Angles are dimensionless, as in the SI.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import pint

from bondgraph.errors import DeclarationError

_BASE = ("[mass]", "[length]", "[time]", "[current]", "[temperature]", "[substance]", "[luminosity]")
_SYMBOLS = ("kg", "m", "s", "A", "K", "mol", "cd")

#: Exponents of kg, m, s, A, K, mol, cd.
Dimension = tuple[Fraction, ...]

DIMENSIONLESS: Dimension = (Fraction(0),) * len(_BASE)


@functools.cache
def registry() -> pint.UnitRegistry[Any]:
    """The unit registry of the toolkit (built once, on first use)."""
    units: pint.UnitRegistry[Any] = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
    return units


@functools.cache
def parse_unit(unit: str) -> pint.Unit:
    """The pint unit of a unit string; ``1`` is dimensionless.

    Raises
    ------
    DeclarationError
        If the string is not a unit.

    Examples
    --------
    >>> parse_unit("N m / A").is_compatible_with("V s")
    True
    """
    try:
        return registry().Unit("dimensionless" if unit.strip() in ("", "1") else unit)
    except Exception as error:  # pint raises many kinds: undefined unit, tokenizer and syntax errors
        raise DeclarationError(
            f"unit {unit!r} is not known ({type(error).__name__}) - "
            "write SI units such as 'N m', 'rad/s', 'kg m^2' or '1'",
            where=(unit,),
        ) from None


@functools.cache
def dimension(unit: str) -> Dimension:
    """Exponents of the SI base units of a unit string.

    Examples
    --------
    >>> dimension("N m") == dimension("W s")
    True
    """
    powers: Mapping[str, Any] = parse_unit(unit).dimensionality
    return tuple(Fraction(powers.get(base, 0)).limit_denominator(1000) for base in _BASE)


@functools.cache
def conversion(unit: str, to: str) -> tuple[float, float]:
    """Factor and offset with which a value in ``unit`` becomes one in ``to``: ``value * factor + offset``.

    Raises
    ------
    DeclarationError
        If the two units have different dimensions or either is unknown.

    Examples
    --------
    >>> round(conversion("rpm", "rad/s")[0], 6)
    0.10472
    """
    if dimension(unit) != dimension(to):
        raise DeclarationError(
            f"unit {unit!r} is {dimension_text(dimension(unit))}, not {dimension_text(dimension(to))} as {to!r} is",
            where=(unit, to),
        )
    source, target = parse_unit(unit), parse_unit(to)
    zero = float(registry().Quantity(0.0, source).to(target).magnitude)
    one = float(registry().Quantity(1.0, source).to(target).magnitude)
    return one - zero, zero


def dimension_text(exponents: Dimension) -> str:
    """A dimension written in SI base units.

    Examples
    --------
    >>> dimension_text(dimension("N"))
    'kg m s^-2'
    """
    parts = [
        symbol if power == 1 else f"{symbol}^{power}"
        for symbol, power in zip(_SYMBOLS, exponents, strict=True)
        if power != 0
    ]
    return " ".join(parts) or "1"
