"""Commands of daily work: new, inspect, compare, report, completion."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path

import shtab

from bondgraph.cli.arguments import parser
from bondgraph.cli.fmus import compare_fmu, is_fmu
from bondgraph.cli.log_options import read_given
from bondgraph.cli.printing import say
from bondgraph.cli.runs import model_and_logs
from bondgraph.cli.scaffold import write_scaffold
from bondgraph.cli.values import finite
from bondgraph.files import output_file, output_folder
from bondgraph.report.comparison import compare_logs, comparison_text, write_comparison
from bondgraph.report.figures import save_figure
from bondgraph.report.html import rewrite_report
from bondgraph.report.inspection import inspect_log, inspection_figure, inspection_text


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
    found = inspect_log(log)
    say(json.dumps(finite(found.to_dict()), indent=1) if options.json else inspection_text(found))
    if options.plot:
        save_figure(inspection_figure(log), Path(options.plot))
        print(f"picture: {options.plot}", file=sys.stderr)
    return 0


def compare(options: argparse.Namespace) -> int:
    """Lay a model at its declared values over logs."""
    if is_fmu(options.model):
        return compare_fmu(options)
    model, driven, logs = model_and_logs(options)
    folder = output_folder(Path(options.out))
    compared = compare_logs(model, logs, driven, options.start)
    write_comparison(compared, folder)
    say(comparison_text(compared))
    print(f"written: {folder}")
    return 1 if all(math.isnan(one.rms) for run in compared.runs for one in run.errors) else 0


def report(options: argparse.Namespace) -> int:
    """Write the reports of finished folders again."""
    for folder in options.folders:
        print(f"report: {rewrite_report(Path(folder))}")
    return 0


def completion(options: argparse.Namespace) -> int:
    """Print the completion script of a shell."""
    print(shtab.complete(parser(), shell=options.shell))
    return 0
