"""Options that every command with logs takes: other names, units, the column of time, windows, constants, the start.

``add_*`` declare them, the others read them; whoever adds a command with logs takes both from here.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from bondgraph.cli.numbers import finite
from bondgraph.data.log import Log
from bondgraph.data.read import EXTRAS, read_log
from bondgraph.data.select import window
from bondgraph.declare.editing import with_inputs_between
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Interpolation
from bondgraph.errors import OptionError

#: How inputs run between samples, by the words of ``--inputs-between``.
WAYS: Mapping[str, Interpolation] = {"held": "hold", "linear": "linear", "band": "band limited"}
#: Endings of files that are read as logs.
LOGS_HELP = "logs: " + ", ".join(EXTRAS).replace(".", "")


def add_reading(command: argparse.ArgumentParser) -> None:
    """Add ``--units`` and ``--time``: what a file does not say itself."""
    command.add_argument(
        "--units", nargs="+", action="extend", default=[], metavar="COLUMN=UNIT",
        help="units of columns whose headers have none or a wrong one, or a JSON file of them",
    )  # fmt: skip
    command.add_argument("--time", metavar="COLUMN", help="column with the time, where it is not called so")


def add_fmu_units(command: argparse.ArgumentParser) -> None:
    """Add ``--fmu-units``: what an FMU does not say itself."""
    command.add_argument(
        "--fmu-units", nargs="+", action="extend", default=[], metavar="NAME=UNIT",
        help="units of variables for which an FMU has none, or a JSON file of them",
    )  # fmt: skip


def add_window(command: argparse.ArgumentParser, *, until: bool = True) -> None:
    """Add ``--from`` and, where the command has none of its own, ``--until``: the part of each log that is used."""
    command.add_argument("--from", dest="start_time", type=finite, metavar="T", help="first time of the logs used, s")
    if until:
        command.add_argument("--until", type=finite, metavar="T", help="end of what is used of the logs, s")


def add_map(command: argparse.ArgumentParser) -> None:
    """Add ``--map``: columns that are called otherwise in the model."""
    command.add_argument(
        "--map", nargs="+", action="extend", default=[], metavar="COLUMN=NAME",
        help="columns that have other names in the model, or a JSON file of them",
    )  # fmt: skip


def add_set(command: argparse.ArgumentParser, help_text: str) -> None:
    """Add ``--set``: values of parameters and of inputs that logs lack."""
    command.add_argument("--set", nargs="+", action="extend", default=[], metavar="NAME=VALUE", help=help_text)


def add_start(command: argparse.ArgumentParser, default: str = "measured") -> None:
    """Add ``--start``: the rule by which states begin (:func:`bondgraph.estimate.initial.initial_states`)."""
    command.add_argument(
        "--start", default=default, choices=("measured", "settled", "model"),
        help="states at the start of a log: measured ones as measured and the others as declared (measured), or where "
        "they come to rest while the measured ones are held (settled), or all as declared (model); default: "
        f"{default}",
    )  # fmt: skip


def add_between(command: argparse.ArgumentParser) -> None:
    """Add ``--inputs-between``: how inputs that logs give run between their samples."""
    command.add_argument(
        "--inputs-between", nargs="+", action="extend", default=[], metavar="WAY",
        help="inputs between samples: held (a controller's output), linear (slow signals, the default), or band "
        "(sampled behind an anti-aliasing filter); of all but codes and those declared as held, or of one: force=band",
    )  # fmt: skip


def inputs_between(graph: BondGraph, options: argparse.Namespace) -> BondGraph:
    """The graph with its inputs running between samples as ``--inputs-between`` says.

    Raises
    ------
    OptionError
        If there is no such way or input, or the input is a code.

    Examples
    --------
    >>> g = BondGraph("shaker")
    >>> _ = g.input("force", "N"), g.input("switch", "1", hold=True)
    >>> asked = argparse.Namespace(inputs_between=["band"])
    >>> [one.interpolation for one in inputs_between(g, asked).inputs]
    ['band limited', 'hold']
    """
    running = [one.name for one in graph.flatten().inputs if not one.is_held]
    ways = ways_between(running, options)
    return with_inputs_between(graph, **ways) if ways else graph


def ways_between(running: Sequence[str], options: argparse.Namespace) -> dict[str, Interpolation]:
    """How inputs run between samples, by their names; ``running`` are those that are meant where none is named.

    Raises
    ------
    OptionError
        If there is no such way.
    """
    ways: dict[str, Interpolation] = {}
    for option in options.inputs_between:
        name, equals, word = (part.strip() for part in option.rpartition("="))
        if word not in WAYS or bool(name) != bool(equals):
            raise OptionError(
                f"--inputs-between {option}: write {', '.join(WAYS)}, or input=way such as force=band",
                where=("--inputs-between", option),
            )
        ways |= dict.fromkeys([name] if name else running, WAYS[word])
    return ways


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
