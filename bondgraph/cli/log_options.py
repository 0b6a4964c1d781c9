"""Options that every command with logs takes: other names, units, the column of time, windows, constants, the start.

Each ``add_*`` declares one; :mod:`bondgraph.cli.given_logs` reads them, so that help comes at once.
"""

from __future__ import annotations

import argparse

from bondgraph.cli.numbers import finite
from bondgraph.data.formats.extras import EXTRAS

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


def add_gaps(command: argparse.ArgumentParser) -> None:
    """Add ``--split-gaps``: logs are cut where their time jumps."""
    command.add_argument(
        "--split-gaps", action="store_true",
        help="cut logs where time jumps by ten times the usual interval, and half a second at least: each part has a "
        "start of its own, since nobody knows what the inputs did meanwhile",
    )  # fmt: skip


def add_across_gaps(command: argparse.ArgumentParser) -> None:
    """Add ``--across-gaps``: models lead across jumps in time."""
    command.add_argument(
        "--across-gaps", action="store_true",
        help="lead the models across jumps in time; if not, parts between jumps of ten times the usual interval, and "
        "half a second at least, are logs of their own",
    )  # fmt: skip


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
