"""Logs as the options of a command ask for them (:mod:`bondgraph.cli.log_options` declares those)."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path

from bondgraph.data.log import Log
from bondgraph.data.read import read_log
from bondgraph.data.select import split_at_gaps, window
from bondgraph.errors import OptionError


def read_given(path: str | Path, options: argparse.Namespace) -> Log:
    """A log as the options of a command describe it, and the part of it that they ask for.

    Raises
    ------
    DataError
        If it cannot be read, or has no samples in the window.
    OptionError
        If ``--units`` is written wrongly.
    """
    log = read_log(path, units=units_by_column(options.units), time=options.time)
    start, end = getattr(options, "start_time", None), getattr(options, "until", None)
    if start is None and end is None:
        return log
    return window(
        log, -math.inf if start is None else start, math.inf if end is None else math.nextafter(end, math.inf)
    )


def read_parts(path: str | Path, options: argparse.Namespace) -> tuple[Log, ...]:
    """The log of :func:`read_given`, or its parts between jumps in time where ``--split-gaps`` asks for them.

    Raises
    ------
    DataError
        If it cannot be read, or has no samples in the window.
    OptionError
        If ``--units`` is written wrongly.
    """
    log = read_given(path, options)
    return split_at_gaps(log) if options.split_gaps else (log,)


def units_by_column(options: Sequence[str], option_name: str = "--units") -> dict[str, str]:
    """Units from ``column=unit`` pairs and JSON files.

    Raises
    ------
    OptionError
        If one is neither.

    Examples
    --------
    >>> units_by_column(["speed=km/h", "lever=deg"])
    {'speed': 'km/h', 'lever': 'deg'}
    """
    found: dict[str, str] = {}
    for option in options:
        column, equals, unit = option.rpartition("=")
        if option.endswith(".json") and not equals:
            found |= _units_file(Path(option), option_name)
        elif equals and column.strip() and unit.strip():
            found[column.strip()] = unit.strip()
        else:
            raise OptionError(
                f"{option_name} {option}: write it as column=unit, such as speed=km/h, or name a JSON file",
                where=(option_name, option),
            )
    return found


def _units_file(path: Path, option_name: str) -> dict[str, str]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise OptionError(
            f"{option_name} {path}: the file cannot be read ({error})", where=(option_name, str(path))
        ) from None
    if not isinstance(content, dict) or not all(isinstance(unit, str) for unit in content.values()):
        raise OptionError(
            f'{option_name} {path}: the file must hold an object such as {{"speed": "km/h"}}',
            where=(option_name, str(path)),
        )
    return content
