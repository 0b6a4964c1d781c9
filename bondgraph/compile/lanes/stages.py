"""Stage arithmetic of integration methods, printed as loops over rows and lanes.

Steps copy and add whole vectors of the work buffer. Which ones depends on the stage, so that a loop written once for
all of them would have offsets known at run time only: no compiler packs it into vector instructions, since the vectors
may overlap. Here every combination is printed with its offsets as numbers:

    if s == 2:
        a_0 = tableau[row + 4]
        a_1 = tableau[row + 5]
        for i in range(11):
            for l in range(n):
                w[i*16 + 736 + l] = w[i*16 + 560 + l] + a_0*w[i*16 + 3296 + l] + a_1*w[i*16 + 3472 + l]

A row of a tableau holds alpha, gamma, m, whether slopes are new, then a and c, see ``rosenbrock``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bondgraph.compile.lanes.text import LANES
from bondgraph.compile.rosenbrock import TABLEAUS

#: Stages of the stiff methods, and the most that one has.
COUNTS = sorted({tableau.stages for tableau in TABLEAUS.values()})
MOST_STAGES = max(COUNTS)


def runge_kutta_text(rows: Mapping[str, int], n_x: int) -> list[str]:
    """Functions of the classical method: ``begin``, then after each evaluation ``first``, ``inner`` or ``last``."""
    x, stage, slope, total = (_element(rows[name]) for name in ("x", "stage", "slope", "total"))
    reached = f"{stage} = {x} + reach*{slope}"
    return [
        _function("begin", "w, n", _loop([f"{stage} = {x}"], n_x)),
        _function("first", "weight, reach, w, n", _loop([f"{total} = weight*{slope}", reached], n_x)),
        _function("inner", "weight, reach, w, n", _loop([f"{total} = {total} + weight*{slope}", reached], n_x)),
        _function("last", "weight, w, n", _loop([f"{x} = {x} + ({total} + weight*{slope})"], n_x)),
    ]


def rosenbrock_text(rows: Mapping[str, int], n_x: int) -> list[str]:
    """Functions of stiff methods: ``reach`` a stage, form the ``right`` side, ``keep`` its solution, ``finish``."""
    x, stage, slope, total, trend = (_element(rows[name]) for name in ("x", "stage", "slope", "total", "trend"))
    solved = [_element(rows["stages"] + s * n_x) for s in range(MOST_STAGES)]
    reach, right, keep, finish = [], [], [], []
    for s in range(MOST_STAGES):
        terms = [f"a_{j}*{solved[j]}" for j in range(s)]
        reads = [f"a_{j} = tableau[row + {4 + j}]" for j in range(s)]
        reach += _when(f"s == {s}", reads, [f"{stage} = {' + '.join([x, *terms])}"], n_x) if s > 0 else []
        terms = [f"trend*{trend}", *(f"c_{j}*{solved[j]}" for j in range(s))]
        reads = ["trend = tableau[row + 1]*step", *(f"c_{j} = tableau[row + stages + {4 + j}]/step" for j in range(s))]
        right += _when(f"s == {s}", reads, [f"{total} = {' + '.join([slope, *terms])}"], n_x)
        keep += _when(f"s == {s}", [], [f"{solved[s]} = {total}"], n_x)
    for count in COUNTS:
        reads = [f"m_{s} = tableau[{4 + s * (4 + 2 * count)}]" for s in range(count)]
        terms = [f"m_{s}*{solved[s]}" for s in range(count)]
        finish += _when(f"stages == {count}", reads, [f"{x} = {' + '.join([x, *terms])}"], n_x)
    return [
        _function("reach", "tableau, row, s, w, n", reach),
        _function("right", "tableau, row, stages, s, step, w, n", right),
        _function("keep", "s, w, n", keep),
        _function("finish", "tableau, stages, w, n", finish),
    ]


def direction_text(rows: Mapping[str, int], n_x: int) -> list[str]:
    """Functions of one direction in a classical step, in a buffer ``d`` of its value, its stage and its sum."""
    value, stage, total = (_element(k * n_x, "d") for k in range(3))
    slope = _element(rows["dout"])
    turn = [f"{total} = {total} + weight*{slope}", f"{stage} = {value} + reach*{slope}"]
    return [
        _function("begin_direction", "d, n", _loop([f"{stage} = {value}", f"{total} = 0.0"], n_x)),
        _function("bring_direction", "d, w, n", _loop([f"{_element(rows['din'])} = {stage}"], n_x)),
        _function("turn_direction", "weight, reach, d, w, n", _loop(turn, n_x)),
        _function("finish_direction", "d, n", _loop([f"{value} = {value} + {total}"], n_x)),
    ]


def stiff_direction_text(rows: Mapping[str, int], n_x: int) -> list[str]:
    """Functions that bring a direction from its buffer ``d`` before a step, and take it back after."""
    value, before, after = _element(0, "d"), _element(rows["din"]), _element(rows["dout"])
    return [
        _function("bring_direction", "d, w, n", _loop([f"{before} = {value}"], n_x)),
        _function("take_direction", "d, w, n", _loop([f"{value} = {after}"], n_x)),
    ]


def keep_slopes_text(source: int, targets: Sequence[int], count: int) -> str:
    """``keep_slopes``: copy ``count`` rows to where those of each stage are kept."""
    lines = [
        line
        for s, target in enumerate(targets)
        for line in _when(f"s == {s}", [], [f"{_element(target)} = {_element(source)}"], count)
    ]
    return _function("keep_slopes", "s, w, n", lines)


def _element(row: int, buffer: str = "w") -> str:
    """Row ``i`` of the vector that begins at a row."""
    return f"{buffer}[i*{LANES} + {row * LANES} + l]"


def _function(name: str, arguments: str, lines: Sequence[str]) -> str:
    return "\n".join([f"def {name}({arguments}):", *(f"    {line}" for line in lines)])


def _loop(body: Sequence[str], count: int) -> list[str]:
    return [f"for i in range({count}):", "    for l in range(n):", *(f"        {line}" for line in body)]


def _when(condition: str, reads: Sequence[str], body: Sequence[str], count: int) -> list[str]:
    return [f"if {condition}:", *(f"    {line}" for line in [*reads, *_loop(body, count)])]
