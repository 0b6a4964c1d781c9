"""A kernel that says everything kernels can say; it runs as Python too."""

from __future__ import annotations

import math
from typing import NamedTuple

from bondgraph.arrays import FloatArray, IntArray

#: Results of each kind.
ROWS = 24
_SHARE = 0.25


class Inner(NamedTuple):
    """A record inside a record."""

    values: FloatArray
    count: int


class Outer(NamedTuple):
    """Arrays, numbers and a record."""

    matrix: FloatArray
    cube: FloatArray
    order: IntArray
    scale: float
    shift: int
    inner: Inner


def run(outer: Outer, row: FloatArray, floats: FloatArray, integers: IntArray) -> int:
    """Fill in results; how many integers there are."""
    rows, columns = outer.matrix.shape
    matrix, inner = outer.matrix, outer.inner
    place = 0
    for i in range(rows):
        floats[place] = _weighed(matrix[i], outer.order, outer.scale)
        place += 1
    for i in range(1, rows):
        if i == 3:
            break
        matrix[i, 0] += 0.5 * matrix[i - 1, columns - 1]
    for i in range(0, rows, 2):
        matrix[i, 1] *= -_SHARE
    floats[place] = abs(row[0]) + math.sqrt(abs(row[1])) + math.log1p(row[2] * row[2]) + math.copysign(2.0, row[3])
    floats[place + 1], floats[place + 2] = max(row[0], row[1]), min(row[0], row[1])
    floats[place + 3] = math.pi if not row[0] > 0.0 else -math.e
    floats[place + 4] = outer.shift / 2 + math.log(outer.scale) + inner.count
    floats[place + 5] = _mixed(outer.shift, 2)
    floats[place + 6] = outer.cube[1, 1, inner.count]
    _turned(outer.cube, inner.values)
    _raise_all(outer, 3)
    integers[0], integers[1] = outer.shift // 2, (outer.shift + 20) // 4
    integers[2], integers[3] = -outer.shift // 3, outer.cube.size
    integers[4] = outer.cube.shape[1] + 10 * outer.order.size
    integers[5] = min(outer.shift, inner.count) - max(outer.shift, inner.count)
    integers[6] = _first_above(row, -0.5)
    integers[7] = _first_above(row, 99.0)
    integers[8] = int(row[0] < row[1]) + 2 * int(row[0] >= row[1] and row[2] != row[3]) + 1
    integers[9] = 4 if row[0] < 0.0 or row[1] < 0.0 else 5
    integers[10] = _sign(row[0]) + 5
    integers[11] = _halved(100)
    integers[12] = _changed(inner.count)
    integers[13] = int(7.9) + math.ceil(2.1) + math.ceil(-2.9)
    outer.cube[2] = outer.cube[0]
    outer.cube[0, 1] = -1.5
    matrix[4] = row
    inner.values[:] = row
    inner.values[:] = matrix[0]
    for i in range(outer.order.size):
        integers[14 + i] = outer.order[i] + 1
    while place < 20:
        place += inner.count
    integers[19] = place
    for i in range(2):
        k = outer.order[i]
        integers[20] += k
    for k in range(3):
        integers[21] += 10 * k
    integers[22] = k
    return integers.size


def _weighed(row: FloatArray, order: IntArray, scale: float) -> float:
    """A sum in an order of its own."""
    total = 0.0
    for k in range(order.size):
        if order[k] < row.size:
            total += scale * row[order[k]] - k
    return total


def _turned(cube: FloatArray, values: FloatArray) -> None:
    """Lanes as the last axis."""
    rows, columns, lanes = cube.shape
    for i in range(rows):
        for j in range(columns):
            for lane in range(lanes):
                cube[i, j, lane] = values[lane] - cube[i, j, lane] * values[lane]
    for lane in range(lanes):
        values[lane] += cube[0, 0, lane]


def _raise_all(outer: Outer, times: int) -> None:
    for _ in range(times):
        for i in range(outer.inner.values.size):
            outer.inner.values[i] += outer.scale


def _first_above(row: FloatArray, limit: float) -> int:
    """The first that is above, -1 if there is none."""
    for i in range(row.size):
        if row[i] > limit:
            return i
    return -1


def _sign(x: float) -> int:
    if x > 0.0:
        return 1
    elif x < 0.0:
        return -1
    else:
        return 0


def _halved(number: int) -> int:
    """Turns until nothing is left."""
    turns: int = 0
    while number > 0:
        number = number // 2
        turns += 1
    return turns


def _changed(number: int) -> int:
    """A parameter that gets another value on one way only."""
    if number > 10:
        number = 10
    return number * 2


def _mixed(one: float, other: float) -> float:
    """Integers where floats are asked for."""
    return one / other
