"""Requirements: what must be positive for a machine to be possible, checked at the values of its parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from sympy import Expr, Symbol

from bondgraph.declare.expressions import to_text
from bondgraph.declare.floats import NoFloatError, float_value
from bondgraph.declare.quantities import Parameter, Requirement
from bondgraph.errors import DeclarationError

#: Longer expressions are not shown in messages.
_SHOWN = 60


def check_requirement(
    requirement: Requirement, parameters: Iterable[Parameter], graph: str, values: Mapping[str, float] | None = None
) -> None:
    """Raise DeclarationError unless a requirement holds, with the reason and the values that break it.

    Parameters
    ----------
    requirement
        What must be positive. What uses more than parameters (a part whose parameter was bound) is not checked.
    parameters
        Declared parameters.
    graph
        Name of the graph, for the message.
    values
        Values of parameters that differ from the declared ones.
    """
    used = sorted(requirement.positive.free_symbols, key=lambda symbol: str(symbol.name))
    declared = {parameter.symbol: parameter for parameter in parameters}
    if not set(used) <= set(declared):
        return
    given = {name: (values or {}).get(name.name, declared[name].value) for name in used}
    found = _value(requirement.positive, given)
    if found > 0:
        return
    known = ", ".join(
        f"{name} = {declared[name].shown(value):.6g} {declared[name].display_unit}".rstrip()
        for name, value in given.items()
    )
    what = to_text(requirement.positive)
    if len(used) == 1 and what == str(used[0]):
        is_what = ""
    else:
        is_what = f"{what if len(what) <= _SHOWN else 'what is left'} is {found:.4g} with "
    raise DeclarationError(
        f"{graph}: {requirement.reason}: {is_what}{known} - it must be positive",
        where=tuple(str(name) for name in used),
    )


def check_requirements(
    requirements: Iterable[Requirement],
    parameters: Iterable[Parameter],
    graph: str,
    values: Mapping[str, float] | None = None,
) -> None:
    """Check all requirements of a flat graph, see :func:`check_requirement`."""
    known = tuple(parameters)
    for requirement in requirements:
        check_requirement(requirement, known, graph, values)


def _value(expression: Expr, given: Mapping[Symbol, float]) -> float:
    """The value of an expression, NaN where it is not real or none is known."""
    try:
        return float(float_value(expression, given))
    except NoFloatError:
        return math.nan
