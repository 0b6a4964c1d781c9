"""Text of tables: arrays of knots, values and slopes, and functions that interpolate between them.

In one argument the interpolant is the monotone piecewise cubic with the slopes of Fritsch and Butland (1984), SIAM J.
Sci. Stat. Comput. 5(2), as in ``scipy.interpolate.PchipInterpolator``: continuous with its first derivative, and never
beyond the values of its two knots. In two arguments it is the tensor product of cubic Hermite polynomials,

    f(x, y) = sum over the four corners of  H_a(x) H_b(y) f_ab + G_a(x) H_b(y) fx_ab + H_a(x) G_b(y) fy_ab
                                            + G_a(x) G_b(y) fxy_ab

with H, G the Hermite polynomials of value and slope, ``fx`` and ``fy`` the slopes of the columns and rows as above, and
``fxy`` the mean of the slopes of ``fx`` along y and of ``fy`` along x, so that a transposed table is the same surface.
Outside the knots the value is held and the slope is zero.

The slopes are computed here in plain floats, so that the text is the same on every machine. The polynomials are written
once for all tables of a module, as ``_curve`` and ``_surface`` with one ending for each derivative that is used.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

from bondgraph.declare.quantities import Table
from bondgraph.errors import GenerationError
from bondgraph.generate.expressions import derivative_ending
from bondgraph.generate.literals import array, grid, one_line

Orders = tuple[int, ...]
Rows = list[list[float]]

#: Endings of the names of a table's arrays and functions, none of which another table may use.
ENDINGS = ("", "_x", "_y", "_v", "_d", "_dx", "_dy", "_dxy", "_d1", "_d2", "_d11", "_d12", "_d22")

#: Value, first and second derivative in the fraction s of an interval h: of the first value, the second value, the
#: first slope and the second slope.
_BASIS = (
    ("(1 + 2*{s})*(1 - {s})**2", "{s}**2*(3 - 2*{s})", "{h}*{s}*(1 - {s})**2", "{h}*{s}**2*({s} - 1)"),
    ("6*{s}*({s} - 1)/{h}", "6*{s}*(1 - {s})/{h}", "(1 - {s})*(1 - 3*{s})", "{s}*(3*{s} - 2)"),
    ("(12*{s} - 6)/{h}**2", "(6 - 12*{s})/{h}**2", "(6*{s} - 4)/{h}", "(6*{s} - 2)/{h}"),
)


def pchip_slopes(x: Sequence[float], values: Sequence[float]) -> list[float]:
    """Slopes at the knots of the monotone piecewise cubic through ``(x, values)``.

    Inside: the harmonic mean of the neighbouring secants, weighted by the intervals, zero at extrema. At the ends: a
    one-sided three-point formula, limited so that the interpolant stays monotone.

    Examples
    --------
    >>> pchip_slopes([0.0, 1.0, 2.0], [0.0, 1.0, 4.0])
    [0.0, 1.5, 4.0]
    """
    widths = [b - a for a, b in itertools.pairwise(x)]
    secants = [(b - a) / h for (a, b), h in zip(itertools.pairwise(values), widths, strict=True)]
    if len(secants) == 1:
        return [secants[0], secants[0]]
    slopes = [_end_slope(widths[0], widths[1], secants[0], secants[1])]
    for i in range(1, len(secants)):
        slopes.append(_inner_slope(widths[i - 1], widths[i], secants[i - 1], secants[i]))
    slopes.append(_end_slope(widths[-1], widths[-2], secants[-1], secants[-2]))
    return slopes


def _inner_slope(width_left: float, width_right: float, left: float, right: float) -> float:
    if left * right <= 0:
        return 0.0
    weight_left, weight_right = 2 * width_right + width_left, width_right + 2 * width_left
    return (weight_left + weight_right) / (weight_left / left + weight_right / right)


def _end_slope(width: float, next_width: float, secant: float, next_secant: float) -> float:
    slope = ((2 * width + next_width) * secant - width * next_secant) / (width + next_width)
    if slope * secant <= 0:
        return 0.0
    if secant * next_secant <= 0 and abs(slope) > 3 * abs(secant):
        return 3 * secant
    return slope


def table_text(table: Table, stem: str, orders: Iterable[Orders]) -> str:
    """Arrays of a table and one function for each derivative that is used; they call :func:`interpolant_text`.

    Parameters
    ----------
    table
        As declared; the knots increase.
    stem
        Name of the function of the value; other names are this with an ending.
    orders
        Which derivatives to emit, one order for each argument; all zero for the value.

    Raises
    ------
    GenerationError
        If knots and values do not match, the knots do not increase, or a derivative above the second is asked for.
    """
    _check(table)
    arrays = _surface_arrays(table, stem) if table.y else _curve_arrays(table, stem)
    letters, kind = ("x, y", "surface") if table.y else ("x", "curve")
    parts = ["\n".join(arrays)]
    for order in sorted_orders(orders):
        if len(order) != len(letters.split(",")) or sum(order) > 2:
            raise GenerationError(
                f"table {table.name}: derivative of order {order} is not available"
                " - use it with as many arguments as it has and no derivative above the second",
                where=(table.name,),
            )
        ending = derivative_ending(order)
        names = ", ".join(line.partition(" = ")[0] for line in arrays)
        parts.append(
            f"def {stem}{ending}({letters}):\n"
            f'    """{_purpose(table, order)}"""\n'
            f"    return _{kind}{ending}({letters}, {names})"
        )
    return "\n\n\n".join(parts)


def interpolant_text(orders: Orders) -> str:
    """The function that interpolates in all tables of as many arguments as there are orders, or that derivative of it.

    Examples
    --------
    >>> print(interpolant_text((0,)).splitlines()[0])
    def _curve(x, knots, values, slopes):
    """
    what = _derivatives(orders) or "value"
    if len(orders) == 1:
        lines = [
            f"def _curve{derivative_ending(orders)}(x, knots, values, slopes):",
            f'    """Piecewise cubic Hermite polynomial: {what}, {_beyond(orders)}."""',
            *_located("x", "knots", "i", "s", "h"),
            *_basis(orders[0], "s", "h", "a"),
        ]
        return "\n".join([*lines, f"    return {_held(_along('a', 'values', 'slopes'), orders)}"])
    lines = [
        f"def _surface{derivative_ending(orders)}(x, y, knots_x, knots_y, values, slopes_x, slopes_y, twists):",
        f'    """Product of piecewise cubic Hermite polynomials in x and y: {what}, {_beyond(orders)}."""',
        *_located("x", "knots_x", "i", "s", "h"),
        *_located("y", "knots_y", "j", "r", "k"),
        *_basis(orders[0], "s", "h", "a"),
        *_basis(orders[1], "r", "k", "p"),
    ]
    for number, row in enumerate(("i", "i + 1")):
        lines += [f"    value_{number} = {_along('p', 'values', 'slopes_y', row, 'j')}"]
        lines += [f"    slope_{number} = {_along('p', 'slopes_x', 'twists', row, 'j')}"]
    total = "a0*value_0 + a1*value_1 + b0*slope_0 + b1*slope_1"
    return "\n".join([*lines, f"    return {_held(total, orders)}"])


def sorted_orders(orders: Iterable[Orders]) -> list[Orders]:
    """Orders without repetition, the value first, then first derivatives, in x before y."""
    return sorted(set(orders), key=lambda order: (sum(order), tuple(-i for i in order)))


def _check(table: Table) -> None:
    for letter, knots in (("x", table.x), ("y", table.y or (0.0, 1.0))):
        if len(knots) < 2 or any(not a < b for a, b in itertools.pairwise(knots)):
            raise GenerationError(
                f"table {table.name}: {letter} = {list(knots)} must have at least two points that increase",
                where=(table.name,),
            )
    rows = [row for row in table.values if isinstance(row, tuple)]
    lengths = {len(row) for row in rows} if table.y else {len(table.y)}
    if len(table.values) != len(table.x) or lengths != {len(table.y)} or (bool(rows) != bool(table.y)):
        raise GenerationError(
            f"table {table.name}: values must be {len(table.x)} {'rows' if table.y else 'numbers'}, one for each x"
            + (f", of {len(table.y)} numbers each, one for each y" if table.y else ""),
            where=(table.name,),
        )


def _curve_arrays(table: Table, stem: str) -> list[str]:
    values = [float(value) for value in table.values if not isinstance(value, tuple)]
    arrays = {"_x": table.x, "_v": values, "_d": pchip_slopes(table.x, values)}
    return [array(stem + ending, numbers) for ending, numbers in arrays.items()]


def _surface_arrays(table: Table, stem: str) -> list[str]:
    values = [[float(value) for value in row] for row in table.values if isinstance(row, tuple)]
    along_x = _transposed([pchip_slopes(table.x, column) for column in _transposed(values)])
    along_y = [pchip_slopes(table.y, row) for row in values]
    first = [pchip_slopes(table.y, row) for row in along_x]
    second = _transposed([pchip_slopes(table.x, column) for column in _transposed(along_y)])
    cross = [[(a + b) / 2 for a, b in zip(p, q, strict=True)] for p, q in zip(first, second, strict=True)]
    grids = {"_v": values, "_dx": along_x, "_dy": along_y, "_dxy": cross}
    knots = [array(f"{stem}_x", table.x), array(f"{stem}_y", table.y)]
    return knots + [grid(stem + ending, rows) for ending, rows in grids.items()]


def _located(argument: str, knots: str, index: str, fraction: str, width: str) -> list[str]:
    """Lines that find the interval of an argument, its width and where in it the argument lies, held at the ends."""
    return [
        f'    {index} = np.searchsorted({knots}[1:-1], {argument}, side="right")',
        f"    {width} = {knots}[{index} + 1] - {knots}[{index}]",
        f"    {fraction} = np.minimum(np.maximum(({argument} - {knots}[{index}])/{width}, 0.0), 1.0)",
    ]


def _basis(order: int, fraction: str, width: str, first: str) -> list[str]:
    names = (f"{letter}{end}" for letter in (first, chr(ord(first) + 1)) for end in (0, 1))
    return [f"    {name} = {text.format(s=fraction, h=width)}" for name, text in zip(names, _BASIS[order], strict=True)]


def _along(first: str, values: str, slopes: str, row: str = "", index: str = "i") -> str:
    """The cubic between two neighbouring points of a vector, or of a row of a matrix."""
    second, at = chr(ord(first) + 1), f"{row}, {index}" if row else index
    return (
        f"{first}0*{values}[{at}] + {first}1*{values}[{at} + 1]"
        f" + {second}0*{slopes}[{at}] + {second}1*{slopes}[{at} + 1]"
    )


def _held(text: str, orders: Orders) -> str:
    """The text, or zero beyond the ends of the arguments in which it is a slope."""
    names = {"x": "knots"} if len(orders) == 1 else {"x": "knots_x", "y": "knots_y"}
    beyond = [
        f"({argument} < {knots}[0]) | ({argument} > {knots}[-1])"
        for (argument, knots), order in zip(names.items(), orders, strict=True)
        if order
    ]
    return f"np.where({' | '.join(beyond)}, 0.0, {text})" if beyond else text


def _purpose(table: Table, orders: Orders) -> str:
    unit = f" [{table.unit}]" if table.unit else ""
    meaning = f": {table.meaning}" if table.meaning else ""
    what = f"; {found}" if (found := _derivatives(orders)) else ""
    return one_line(f"Table {table.name}{unit}{meaning}{what}, {_beyond(orders)}.")


def _derivatives(orders: Orders) -> str:
    named = [
        f"{('first', 'second')[order - 1]} derivative in {argument}"
        for argument, order in zip("xy", orders, strict=False)
        if order
    ]
    return " and ".join(named)


def _beyond(orders: Orders) -> str:
    return "zero beyond the ends" if any(orders) else "held beyond the ends"


def _transposed(rows: Rows) -> Rows:
    return [list(column) for column in zip(*rows, strict=True)]
