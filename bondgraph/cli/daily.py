"""Commands of daily work that need no model: new, inspect, completion."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import shtab

from bondgraph.cli.arguments import parser
from bondgraph.cli.folders import answer_folder
from bondgraph.cli.given_logs import read_given
from bondgraph.cli.printing import say
from bondgraph.cli.scaffold import write_scaffold
from bondgraph.data.log import Log
from bondgraph.files import finite, output_file
from bondgraph.report.figures import save_figure
from bondgraph.report.inspection import Inspection, inspect_log, inspection_figure, inspection_text


def new(options: argparse.Namespace) -> int:
    """Write a folder with a machine that runs."""
    folder = write_scaffold(options.name, Path.cwd())
    name = options.name
    print(f"written: {folder.name}/{name}.py, run1.csv, run2.csv\n\nnext, in {folder.name}:")
    for command, meaning in (
        (f"draw {name}.py", "the graph with its causal strokes"),
        (f"compare {name}.py --data run1.csv", "the model as declared, laid over a log"),
        (f"estimate {name}.py --data run1.csv --free mass drag", "its parameters from the log"),
        (f"close-loop {name}.py --data run1.csv --holdout run2.csv", "the effect that the model lacks"),
    ):
        print(f"  bondgraph {command:<52} # {meaning}")
    return 0


def inspect(options: argparse.Namespace) -> int:
    """Print what a log holds and what is suspicious in it."""
    if options.plot:
        output_file(Path(options.plot))
    log = read_given(options.log, options)
    folder = answer_folder(options) if options.out else None
    found = inspect_log(log)
    say(json.dumps(finite(found.to_dict()), indent=1) if options.json else inspection_text(found))
    if options.plot:
        save_figure(inspection_figure(log), Path(options.plot))
        print(f"picture: {options.plot}", file=sys.stderr)
    if folder:
        _write_inspection(options, log, found, folder)
    return 0


def _write_inspection(options: argparse.Namespace, log: Log, found: Inspection, folder: Path) -> None:
    # Pages load rooms that a look at a log does without.
    from bondgraph.report.collect import versions
    from bondgraph.report.html import Provenance
    from bondgraph.report.inspection_page import write_inspection

    made = Provenance(options.command_line, None, versions(), (Path(options.log).name,))
    write_inspection(log, found, folder, made)
    print(f"report: {folder / 'report.html'}", file=sys.stderr)


def completion(options: argparse.Namespace) -> int:
    """Print the completion script of a shell."""
    print(shtab.complete(parser(), shell=options.shell))
    return 0
