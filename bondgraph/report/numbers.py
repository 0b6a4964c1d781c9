"""Numbers as people read them: few digits, the same rule in the terminal and on the page."""

from __future__ import annotations

import math

MISSING = "–"
#: Digits of a number in double precision.
_MOST_DIGITS = 15


def shown(value: float, digits: int = 3) -> str:
    """A number with a few significant digits; a dash where there is none.

    Examples
    --------
    >>> shown(76.2314), shown(0.00012345), shown(48210.0), shown(float("nan")), shown(0.0)
    ('76.2', '0.000123', '48210', '–', '0')
    >>> shown(3.2e-7), shown(1.5e9)
    ('3.2e-07', '1.5e+09')
    """
    if not math.isfinite(value):
        return MISSING if math.isnan(value) else ("∞" if value > 0 else "−∞")
    if value == 0.0:
        return "0"
    magnitude = math.floor(math.log10(abs(value)))
    if not -5 < magnitude < 7:
        return f"{value:.{digits}g}"
    return f"{value:.{max(digits - 1 - magnitude, 0)}f}"


def with_ends(value: float, ci95: tuple[float, float], unit: str = "") -> str:
    """A value with its unit and 95 % interval in one text; more digits where its ends would look alike.

    Where the ends are one number, or not known, the value stands alone.

    Examples
    --------
    >>> with_ends(0.55873, (0.5184, 0.5991), "kg/m"), with_ends(0.00908123, (0.0090791, 0.0090834))
    ('0.559 kg/m [0.518, 0.599]', '0.009081 [0.009079, 0.009083]')
    >>> with_ends(2.0, (2.0, 2.0), "s"), with_ends(2.0, (float("nan"), float("nan")), "1")
    ('2.00 s', '2.00')
    >>> with_ends(0.0, (0.0, 0.0173))
    '0 [0, 0.0173]'
    """
    own = "" if unit in ("", "1") else f" {unit}"
    if math.isnan(ci95[0]) or math.isnan(ci95[1]) or ci95[0] == ci95[1]:
        return f"{shown(value)}{own}"
    for digits in range(3, _MOST_DIGITS + 1):
        text, low, high = (shown(one, digits) for one in (value, *ci95))
        if low != high and all(text != end or value == one for end, one in zip((low, high), ci95, strict=True)):
            break
    return f"{text}{own} [{low}, {high}]"


def with_interval(value: float, ci95: tuple[float, float]) -> tuple[str, str]:
    """A value and its 95 % interval, both to the digits that the interval allows.

    Examples
    --------
    >>> with_interval(0.55873, (0.5184, 0.5991))
    ('0.559', '[0.518, 0.599]')
    >>> with_interval(1234.5, (1100.0, 1370.0))
    ('1234', '[1100, 1370]')
    >>> with_interval(2.0, (float("nan"), float("nan")))
    ('2.00', '–')
    >>> with_interval(2.29841e-5, (2.29832e-5, 2.2985e-5))
    ('2.29841e-05', '[2.29832e-05, 2.2985e-05]')
    >>> with_interval(5.43e-5, (5.373e-5, 5.487e-5))
    ('5.43e-05', '[5.373e-05, 5.487e-05]')
    """
    width = abs(ci95[1] - ci95[0])
    if not math.isfinite(width) or width == 0.0 or not math.isfinite(value):
        return shown(value), MISSING
    decimals = max(1 - math.floor(math.log10(width / 2)), 0)
    largest = max(abs(value), abs(ci95[0]), abs(ci95[1]))
    if decimals > 8 or largest >= 1e7 or largest < 1e-4:
        digits = min(max(math.floor(math.log10(largest)) - math.floor(math.log10(width / 2)) + 2, 4), _MOST_DIGITS)
        return f"{value:.{digits}g}", f"[{ci95[0]:.{digits}g}, {ci95[1]:.{digits}g}]"
    return f"{value:.{decimals}f}", f"[{ci95[0]:.{decimals}f}, {ci95[1]:.{decimals}f}]"


def change(before: float, after: float) -> str:
    """Relative change of an error in percent; a dash where it cannot be said.

    Examples
    --------
    >>> change(76.0, 16.0), change(2.0, 2.0), change(1.0, 1.5), change(0.0, 1.0)
    ('−79 %', '0 %', '+50 %', '–')
    """
    if not (math.isfinite(before) and math.isfinite(after)) or before == 0.0:
        return MISSING
    percent = 100.0 * (after / before - 1.0)
    if abs(percent) < 0.5:
        return "0 %"
    digits = 0 if abs(percent) < 99.5 or percent > 0 else 1
    return f"{'−' if percent < 0 else '+'}{abs(percent):.{digits}f} %"
