"""The table that a command computes: a file, text for a program that reads it, or a summary for a person."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from bondgraph.cli.printing import say
from bondgraph.data.log import Log
from bondgraph.data.write import csv_text, write_log
from bondgraph.files import output_file
from bondgraph.report.run_table import run_text

#: Name of the standard output in place of a file, by the convention of POSIX utilities (guideline 13 of section 12.2).
STANDARD_OUTPUT = "-"


def check_files(names: Iterable[str | None]) -> None:
    """Refuse files that cannot be written, before any work is done for them.

    Raises
    ------
    OptionError
        If the folder of a file does not exist, or it is a folder itself.
    """
    for name in names:
        if name and name != STANDARD_OUTPUT:
            output_file(Path(name))


def give_table(log: Log, out: str | None, pictured: bool) -> None:
    """Write a table to ``out``, or print it where a program reads it; a person at a terminal is given a summary.

    Where a run is ``pictured`` and nobody named a file, programs get no table.
    """
    if out == STANDARD_OUTPUT:
        print(csv_text(log), end="")
        return
    if out:
        print(f"written: {write_log(out, log)}", file=sys.stderr)
    if sys.stdout.isatty():
        say(run_text(log))
        if not out:
            say("the table: --out FILE (.csv, .csv.gz, .parquet) writes it, --out - prints it")
    elif not (out or pictured):
        print(csv_text(log), end="")
