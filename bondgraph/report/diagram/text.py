"""Widths of text before it is drawn, and laws broken into short lines.

An SVG viewer brings its own sans-serif font. Widths are those of DejaVu Sans, the widest of the common ones, so that a
label laid out with them fits with any of the others.
"""

from __future__ import annotations

# Advance widths of the printable ASCII characters, in thousandths of the font size (DejaVu Sans 2.37).
_REGULAR = (
    318, 401, 460, 838, 636, 950, 780, 275, 390, 390, 500, 838, 318, 361, 318, 337, 636, 636, 636, 636, 636, 636, 636,
    636, 636, 636, 337, 337, 838, 838, 838, 531, 1000, 684, 686, 698, 770, 632, 575, 775, 752, 295, 295, 656, 557, 863,
    748, 787, 603, 787, 695, 635, 611, 732, 684, 989, 685, 611, 685, 390, 337, 390, 838, 500, 500, 613, 635, 550, 635,
    615, 352, 635, 634, 278, 278, 579, 278, 974, 634, 612, 635, 635, 411, 521, 392, 634, 592, 818, 592, 592, 525, 636,
    337, 636, 838,
)  # fmt: skip
_OTHER = {"·": 318, "²": 401, "³": 401, "⁴": 401, "…": 1000, "−": 838, "→": 838}
_UNKNOWN = 850
_BOLD = 1.13
_BREAK_AFTER = "+-*/,·− )(."
#: Letters that a line may be longer where it breaks inside no name then: what the room beside a label holds.
_LONGER = 8


def text_width(text: str, size: float, bold: bool = False) -> float:
    """Width of one line of text in pixels at a font size in pixels.

    Examples
    --------
    >>> round(text_width("rotor", 10.0), 2)
    24.38
    """
    thousandths = sum(
        _REGULAR[ord(letter) - 32] if 32 <= ord(letter) < 127 else _OTHER.get(letter, _UNKNOWN) for letter in text
    )
    return thousandths / 1000 * size * (_BOLD if bold else 1.0)


def break_lines(text: str, length: int, lines: int) -> tuple[tuple[str, ...], bool]:
    """Break a law after operators into at most ``lines`` lines of about ``length`` characters.

    Returns the lines and whether the text was cut; a cut text ends in an ellipsis.

    Examples
    --------
    >>> break_lines("rho_air·cd_area/2·v·|v|", 12, 2)
    (('rho_air·', 'cd_area/2·v·|v|'), False)
    >>> break_lines("c_quadratic_loss_body·v·|v|", 22, 2)
    (('c_quadratic_loss_body·', 'v·|v|'), False)
    >>> break_lines("a + b + c + d", 5, 1)
    (('a + …',), True)
    """
    rest, broken = text.strip(), list[str]()
    while rest and len(broken) < lines:
        end = len(rest) if len(rest) <= length + 3 else _break_position(rest, length)
        broken.append(rest[:end].strip())
        rest = rest[end:].strip()
    if rest:
        broken[-1] = broken[-1][:length].rstrip() + " …"
    return tuple(broken), bool(rest)


def _break_position(text: str, length: int) -> int:
    """Where to break: after the last operator within ``length``, else soon after it, inside no name but the longest."""
    near: list[int] = [*range(length, length // 3, -1), *range(length + 1, min(length + _LONGER, len(text)) + 1)]
    for position in near:
        if text[position - 1] in _BREAK_AFTER and text[position : position + 1] not in ("*", ")", ","):
            return position
    return length


def plain(text: str) -> str:
    r"""Text that matplotlib does not take for mathematics: names of logs and graphs may hold any letter.

    Examples
    --------
    >>> print(plain("x$y"))
    x\$y
    """
    return text.replace("$", r"\$")
