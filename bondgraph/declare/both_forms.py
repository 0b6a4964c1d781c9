"""Laws given in both forms must be each other's inverse."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence

from sympy import Expr, Symbol

from bondgraph.declare.elements import ENERGY_VARIABLE, LAW_GIVES, Node
from bondgraph.declare.floats import NoFloatError, float_value
from bondgraph.declare.quantities import Parameter, symbol
from bondgraph.errors import DeclarationError

_SIZES = (0.01, 0.3, 1.0, 4.0)
_FEWEST = 3


def check_both_forms(node: Node, parameters: Sequence[Parameter], graph: str) -> None:
    """Raise DeclarationError where the two forms of a law contradict each other wherever both have a value.

    Laws with several branches need not agree everywhere: the square root of a square is an inverse on one side only.

    Examples
    --------
    >>> laws = (("effort", symbol("R") * symbol("flow")), ("flow", symbol("effort") * symbol("R")))
    >>> check_both_forms(Node("r", "R", laws=laws), [Parameter("R", 2.0, "")], "g")
    Traceback (most recent call last):
    ...
    bondgraph.errors.DeclarationError: g: r: its two laws contradict each other: at flow 0.01 the effort is 0.02, but at
    effort 0.02 the flow is 0.04 - correct one of them, or give one only
    """
    laws = dict(node.laws)
    gives = LAW_GIVES.get(node.kind, "effort")
    stored = ENERGY_VARIABLE.get(node.kind, "flow")
    if node.kind not in ("R", "C", "I") or not {gives, stored} <= laws.keys():
        return
    first, second, own = laws[gives], laws[stored], symbol(stored)
    declared = {quantity.symbol: quantity.value for quantity in parameters}
    wrong: list[tuple[float, float, float]] = []
    for size in (*_SIZES, *(-s for s in _SIZES)):
        at = _point(first, second, declared) | {own: size}
        there = _real(first, at)
        back = None if there is None else _real(second, {**at, symbol(gives): there})
        if there is None or back is None:
            continue
        if abs(back - size) <= 1e-3 * (abs(back) + abs(size)):
            return
        wrong.append((size, there, back))
    if len(wrong) >= _FEWEST:
        x, there, back = wrong[0]
        raise DeclarationError(
            f"{graph}: {node.name}: its two laws contradict each other: at {stored} {x:.6g} the {gives} is"
            f" {there:.6g}, but at {gives} {there:.6g} the {stored} is {back:.6g} - correct one of them, or give one"
            " only",
            where=(node.name,),
        )


def _point(first: Expr, second: Expr, declared: Mapping[Symbol, float]) -> dict[Symbol, float]:
    """Parameters at their values, whatever else the laws use at random ones."""
    draw = random.Random(0)
    used = sorted(first.free_symbols | second.free_symbols, key=str)
    return {name: declared.get(name, draw.uniform(0.5, 1.5)) for name in used}


def _real(law: Expr, at: Mapping[Symbol, float]) -> float | None:
    """The value of a law; None where it has none, or uses a table."""
    try:
        value = float(float_value(law, at))
    except NoFloatError:
        return None
    return value if math.isfinite(value) else None
