"""Units: one registry (pint), conversion to SI, and dimensions as exponent vectors.

Inside the toolkit every number is in coherent SI. Other units appear where a unit string is written next to a declared
value or in the header of a log: the number is converted there, once, and the declared unit is kept as the unit in which
the quantity is shown and read (:class:`bondgraph.coherent.Displayed`). Angles are dimensionless, as in the SI, but an
angular speed is not taken for a number of events per time: where one is needed and the other written, a factor of 2 pi
is at stake.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Mapping
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
    units.define("@alias turn = rev")
    return units


#: Products that are often written as one word; pint takes ``Nm`` for a measure of yarn.
_WORDS = {
    "Nm": "N*m", "Nms": "N*m*s", "Ns": "N*s", "Vs": "V*s", "As": "A*s", "Ws": "W*s", "Js": "J*s", "Pas": "Pa*s",
    "Ohm": "ohm",
}  # fmt: skip
_WORD = re.compile(rf"\b({'|'.join(_WORDS)})\b")
_POWER = re.compile(r"\b(m|s|kg|A|K)(\d)\b")

#: Spellings that the registry does not know, or takes for something else: ``Grad`` is its gigaradian, ``U`` its unit of
#: enzymes; and what is meant by them.
_MEANT = (
    (re.compile(r"(U|Umdr\.?)(\s*/\s*(min|Min)|\s*min\s*\^?-1)|Umin|UPM|upm|U\.p\.m\.|RPM|r\.p\.m\.?"), "rpm"),
    (re.compile(r"(U|Umdr\.?)\s*/\s*s"), "turn/s"),
    (re.compile(r"U|Umdr\.?"), "turn"),
    (re.compile(r"Grad\s*/\s*(s|sec)"), "deg/s"),
    (re.compile(r"Grad"), "deg"),
)


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


def _require_no_level_in_a_product(unit: pint.Unit) -> None:
    """Refuse decibels per hertz and the like: no factor belongs to them, and some versions of pint invent one."""
    terms = [*registry().Quantity(1.0, unit).unit_items()]
    if len(terms) > 1 or any(power != 1 for _, power in terms):
        for name, _ in terms:
            zero, one, two = (registry().Quantity(value, name).to_base_units().magnitude for value in (0.0, 1.0, 2.0))
            if abs(two - 2.0 * one + zero) > 1e-9 * abs(two):
                raise ValueError(f"{name} is a logarithm")


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
    if meant := meant_unit(unit):
        raise DeclarationError(f"unit {unit!r} is not one; did you mean {meant!r}?", where=(unit,))
    try:
        _require_short(unit)
        found: pint.Unit = registry().Unit(_spelled(unit))
        _ = found.dimensionality  # worked out when it is first asked for; some units have none
        _require_no_level_in_a_product(found)
        return found
    except Exception as error:  # pint raises many kinds: undefined unit, tokenizer and syntax errors
        raise DeclarationError(
            f"unit {unit!r} is not known ({type(error).__name__}) - "
            "write SI units such as 'N m', 'rad/s', 'kg m^2' or '1'",
            where=(unit,),
        ) from None


def meant_unit(unit: str) -> str:
    """The unit that is meant by a spelling that the registry would take for another; empty for all others.

    Examples
    --------
    >>> meant_unit("U/min"), meant_unit("Grad"), meant_unit("rpm")
    ('rpm', 'deg', '')
    """
    return next((meant for pattern, meant in _MEANT if pattern.fullmatch(unit.strip())), "")


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
    >>> dimension_text(dimension("N")), dimension_text(dimension("rad"))
    ('kg m s^-2', 'a pure number')
    """
    parts = [
        symbol if power == 1 else f"{symbol}^{power}"
        for symbol, power in zip(_SYMBOLS, exponents, strict=True)
        if power != 0
    ]
    return " ".join(parts) or "a pure number"


#: What to write where an angular speed is meant.
ANGULAR_UNITS = "'rpm' or 'turn/s' for revolutions, 'rad/s' for radians"


@functools.cache
def is_angular_rate(unit: str) -> bool:
    """Whether a unit is one of angular speed: rad/s, rpm, deg/s, turn/s.

    Examples
    --------
    >>> is_angular_rate("rpm"), is_angular_rate("1/min"), is_angular_rate("rad/s^2")
    (True, False, False)
    """
    return dimension(unit) == dimension("1/s") and "radian" in _bases(unit)


@functools.cache
def is_bare_rate(unit: str) -> bool:
    """Whether a unit is a bare number per time, from which nobody can tell turns from radians: 1/s, 1/min, Hz.

    Examples
    --------
    >>> is_bare_rate("1/min"), is_bare_rate("Hz"), is_bare_rate("rpm"), is_bare_rate("")
    (True, True, False, False)
    """
    return dimension(unit) == dimension("1/s") and "radian" not in _bases(unit)


def _bases(unit: str) -> str:
    return str(registry().Quantity(1.0, parse_unit(unit)).to_base_units().units)


def unit_text(unit: Any) -> str:
    """A pint unit, of whatever registry, as a unit string of the toolkit.

    Examples
    --------
    >>> unit_text(registry().Unit("lb ft/s^2")), unit_text(registry().Unit("deg/s"))
    ('lb ft/s^2', 'deg/s')
    """
    terms = [(_symbol(unit, name), power) for name, power in unit._REGISTRY.Quantity(1.0, unit).unit_items()]
    return product_text(terms)


def _symbol(unit: Any, name: str) -> str:
    """The symbol of a unit where it reads as that unit, else its name."""
    short = f"{unit._REGISTRY.Unit(name):~}"
    try:
        return short if parse_unit(short) == parse_unit(name) else name
    except DeclarationError:
        return name


def product_text(terms: Iterable[tuple[str, float]]) -> str:
    """Units and their powers as a unit string.

    Examples
    --------
    >>> product_text([("J", 1), ("kg", -1), ("K", -1)]), product_text([("s", -1)]), product_text([("kg", 1), ("m", 2)])
    ('J/(kg K)', '1/s', 'kg m^2')
    """
    listed = [(symbol, power) for symbol, power in terms if power]
    above = " ".join(_factor(symbol, power) for symbol, power in listed if power > 0) or "1"
    below = [_factor(symbol, -power) for symbol, power in listed if power < 0]
    return above if not below else f"{above}/({' '.join(below)})" if len(below) > 1 else f"{above}/{below[0]}"


def _factor(symbol: str, power: float) -> str:
    return symbol if power == 1 else f"{symbol}^{power:g}"
