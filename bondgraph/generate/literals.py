"""Python literals and comments as generated text writes them, the same on every machine."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Sequence

from bondgraph.errors import GenerationError

_LINE = 120


def one_line(text: str) -> str:
    r"""Text that can stand in a comment or docstring: one line, nothing that would end it.

    Examples
    --------
    >>> one_line("torque\n  of the belt")
    'torque of the belt'
    """
    return " ".join(text.split()).replace("\\", "/").replace('"""', "'''")


def string(text: str) -> str:
    r"""A string literal in double quotes.

    Examples
    --------
    >>> print(string('drag "of" Stribeck'))
    "drag \"of\" Stribeck"
    """
    return json.dumps(text, ensure_ascii=False)


def number(value: float | None, what: str) -> str:
    """A float that reads back exactly, or None; infinite bounds are numpy's.

    Raises
    ------
    GenerationError
        If the value is nan.

    Examples
    --------
    >>> number(2, "J"), number(None, "J"), number(-math.inf, "lower bound of J")
    ('2.0', 'None', '-np.inf')
    """
    if value is None:
        return "None"
    if math.isnan(value):
        raise GenerationError(f"{what} is nan - give it a number", where=(what,))
    if math.isinf(value):
        return "np.inf" if value > 0 else "-np.inf"
    return repr(float(value))


def array(name: str, values: Sequence[float]) -> str:
    """Text that makes a numpy vector, in lines of limited length.

    Examples
    --------
    >>> array("_table_torque_x", (0, 0.1))
    '_table_torque_x = np.array([0.0, 0.1])'
    """
    return f"{name} = np.array([{_numbers(name, values)}])"


def grid(name: str, rows: Sequence[Sequence[float]]) -> str:
    """Lines that make a numpy matrix, one line for each row.

    Examples
    --------
    >>> print(grid("_table_map_v", [[1, 2], [3, 4]]))
    _table_map_v = np.array([
        [1.0, 2.0],
        [3.0, 4.0],
    ])
    """
    lines = ",\n".join(f"    [{_numbers(name, row, 8)}]" for row in rows)
    return f"{name} = np.array([\n{lines},\n])"


def _numbers(name: str, values: Sequence[float], indent: int = 4) -> str:
    """Numbers on one line, or on lines of their own where they are many."""
    texts = [number(value, f"a value of {name}") for value in values]
    line = ", ".join(texts)
    if len(line) <= _LINE:
        return line
    lines = textwrap.wrap(line, _LINE - indent)
    return "\n" + "".join(f"{' ' * indent}{part.rstrip(',')},\n" for part in lines) + " " * (indent - 4)
