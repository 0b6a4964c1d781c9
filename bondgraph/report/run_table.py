"""A simulated run in a few lines: first, last, lowest and highest value of each of its quantities."""

from __future__ import annotations

from bondgraph.data.log import Log, LogChannel
from bondgraph.report.numbers import shown
from bondgraph.text import count, few, instant, text_table

#: Mark between the nodes in the name of a bond's effort or flow.
_BOND = "->"
_DIGITS = 4


def run_text(log: Log) -> str:
    """A run as a table with a line per quantity, in its unit; efforts and flows of bonds are counted only.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.array([0.0, 1.0, 2.0])
    >>> print(run_text(Log("sled", time, {"v": LogChannel("v", "m/s", np.array([0.0, 3.5, 3.0]))})))
    sled: 3 rows from 0 to 2 s
             first   last  lowest  highest
    v [m/s]      0  3.000       0    3.500
    """
    rows = [[f"{one.name} [{one.unit}]", *_cells(one)] for one in log.channels.values() if _BOND not in one.name]
    ends = f" from {instant(float(log.time[0]))} to {instant(float(log.time[-1]))} s" if len(log) else ""
    lines = [f"{log.name}: {count(len(log), 'row')}{ends}"]
    if rows:
        lines.append(text_table(["", "first", "last", "lowest", "highest"], rows))
    if bonds := len(log.channels) - len(rows):
        lines.append(f"efforts and flows of bonds, which the table has too: {bonds}")
    return "\n".join(lines)


def _cells(one: LogChannel) -> list[str]:
    values = one.values[~one.missing]
    if not values.size:
        return [few(()), "", "", ""]
    if one.is_text:
        return [str(values[0]), str(values[-1]), "", ""]
    numbers = one.numbers[~one.missing]
    return [shown(float(each), _DIGITS) for each in (numbers[0], numbers[-1], numbers.min(), numbers.max())]
