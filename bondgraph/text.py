"""Short text of results: counts and names in one line, numbers as tables."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence, Sized
from typing import TypeAlias

#: Header and rows of a table, cell by cell.
Table: TypeAlias = tuple[Sequence[str], Sequence[Sequence[str]]]

#: Names written out in one line; more are counted.
_SHOWN = 6
#: Seconds from which four significant digits would need an exponent.
_LONG = 1e4


def few(names: Sequence[str], most: int = _SHOWN) -> str:
    """Names in one line, those beyond the first few as a count.

    Examples
    --------
    >>> few(["mass", "drag"]), few("abcdefgh", 3), few([])
    ('mass, drag', 'a, b, c and 5 more', 'none')
    """
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(names[:most]) or "none") + more


def sentence(text: str, names: Collection[str] = ()) -> str:
    """A text with a capital letter and a full stop; one of the ``names`` at its beginning stays as it is.

    Examples
    --------
    >>> sentence("the fit ended early"), sentence("k_u rests on its bound", ["k_u"]), sentence("k is free.", "k")
    ('The fit ended early.', 'k_u rests on its bound.', 'k is free.')
    """
    first = text.split(maxsplit=1)[0].rstrip(",:;") if text.split() else ""
    begun = text if first in names or not first.isalpha() else text[:1].upper() + text[1:]
    return begun if begun.endswith((".", "!", "?")) else f"{begun}."


def count(number: int, noun: str) -> str:
    """A number of things.

    Examples
    --------
    >>> count(1, "state"), count(0, "log")
    ('1 state', '0 logs')
    """
    return f"{number} {noun}{'' if number == 1 else 's'}"


def inflected(things: Sized, one: str, several: str) -> str:
    """The form of words that goes with one thing, or with several or none.

    Examples
    --------
    >>> [f"{', '.join(names)} {inflected(names, 'rests', 'rest')}" for names in (["v"], ["v", "omega"])]
    ['v rests', 'v, omega rest']
    """
    return one if len(things) == 1 else several


def number(value: float) -> str:
    """A number with four significant digits, without an exponent where it is readable so.

    Examples
    --------
    >>> number(176.04321), number(1.5e-7), number(123456.7), number(float("nan"))
    ('176', '1.5e-07', '1.235e+05', 'nan')
    """
    return f"{value:.4g}"


def known(value: float) -> str:
    """A number as :func:`number` shows it, and a dash for what nothing tells.

    Examples
    --------
    >>> known(176.04321), known(float("nan")), known(float("inf"))
    ('176', '-', '-')
    """
    return number(value) if math.isfinite(value) else "-"


def instant(value: float) -> str:
    """A time in seconds: as a number, and from ten thousand seconds on in whole ones, not in an exponent.

    Examples
    --------
    >>> instant(20.0), instant(41759.975), instant(1.7e9)
    ('20', '41760', '1700000000')
    """
    return f"{value:.0f}" if abs(value) >= _LONG else number(value)


def text_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in columns as wide as their longest cell: the first flush left, the others flush right.

    Examples
    --------
    >>> print(text_table(["name", "value"], [["mass", "80"], ["c", "12.5"]]))
    name  value
    mass     80
    c      12.5
    """
    columns = list(zip(header, *rows, strict=True))
    widths = [max(map(len, column)) for column in columns]
    flush = [str.ljust, *(str.rjust for _ in header[1:])]
    return "\n".join(
        "  ".join(align(cell, width) for align, cell, width in zip(flush, line, widths, strict=True)).rstrip()
        for line in (header, *rows)
    )
