"""Units: one registry (pint), conversion to SI, and dimensions as exponent vectors.

Inside the toolkit every number is in SI; other units appear only where a unit string is written next to a declared
value or in the header of a log. Angles are dimensionless, as in the SI.
"""

from __future__ import annotations

import functools
import re
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


#: Products that are often written as one word; pint takes ``Nm`` for a measure of yarn.
_WORDS = {
    "Nm": "N*m", "Nms": "N*m*s", "Ns": "N*s", "Vs": "V*s", "As": "A*s", "Ws": "W*s", "Js": "J*s", "Pas": "Pa*s",
    "Ohm": "ohm",
}  # fmt: skip
_WORD = re.compile(rf"\b({'|'.join(_WORDS)})\b")
_POWER = re.compile(r"\b(m|s|kg|A|K)(\d)\b")


def _spelled(unit: str) -> str:
    """A unit string as pint reads it."""
    text = unit.strip()
    if text in ("", "1", "-"):
        return "dimensionless"
    return _POWER.sub(r"\1^\2", _WORD.sub(lambda found: f"({_WORDS[found[1]]})", text))


#: Letters of a unit, and the size of its exponents, beyond which no quantity has a meaning.
_LONGEST, _LARGEST_POWER = 100, 100
_NUMBER = r"[-+]?\s*(?:\d+\.?\d*|\.\d+)"
_POWER_OF = re.compile(rf"(?:\^|\*\*)\s*(?:\(\s*({_NUMBER})(?:\s*/\s*\d+)?\s*\)|({_NUMBER}))(?!\s*(?:\^|\*\*))")


def _require_short(unit: str) -> None:
    """Refuse what would keep a reader of arithmetic busy for ever: long units, large powers, powers of powers."""
    if len(unit) > _LONGEST:
        raise ValueError(f"longer than {_LONGEST} letters")
    if any(abs(float((power[1] or power[2]).replace(" ", ""))) > _LARGEST_POWER for power in _POWER_OF.finditer(unit)):
        raise ValueError(f"a power above {_LARGEST_POWER}")
    rest = _POWER_OF.sub("", unit)
    if "^" in rest or "**" in rest or re.search(r"\d[eE]\d|\d{4}", unit):
        raise ValueError("a power that is no number, or a large number")


@functools.cache
def parse_unit(unit: str) -> pint.Unit:
    """The pint unit of a unit string; ``1`` and ``-`` are dimensionless, ``Nm`` is a newton metre, ``m3`` a cubic one.

    Raises
    ------
    DeclarationError
        If the string is not a unit.

    Examples
    --------
    >>> parse_unit("N m / A").is_compatible_with("V s"), parse_unit("Nm s/rad") == parse_unit("N m s / rad")
    (True, True)
    """
    try:
        _require_short(unit)
        found: pint.Unit = registry().Unit(_spelled(unit))
        _ = found.dimensionality  # worked out when it is first asked for; some units have none
        return found
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
    try:
        zero = float(registry().Quantity(0.0, source).to(target).magnitude)
        one = float(registry().Quantity(1.0, source).to(target).magnitude)
    except Exception as error:  # pint refuses products of offset and of logarithmic units in many ways
        raise DeclarationError(
            f"unit {unit!r} cannot be converted to {to!r} ({type(error).__name__}) - use units without offset or"
            " logarithm, such as K",
            where=(unit, to),
        ) from None
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
