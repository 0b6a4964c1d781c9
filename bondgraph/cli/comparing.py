"""The command that lays a model over logs."""

from __future__ import annotations

import argparse
import math

from bondgraph.cli.fmus import compare_fmu, is_fmu
from bondgraph.cli.folders import answer_folder
from bondgraph.cli.printing import say
from bondgraph.cli.runs import model_and_logs
from bondgraph.report.comparison import compare_logs, comparison_text, write_comparison


def compare(options: argparse.Namespace) -> int:
    """Lay a model at its declared values over logs."""
    if is_fmu(options.model):
        return compare_fmu(options)
    model, driven, logs = model_and_logs(options)
    folder = answer_folder(options)
    compared = compare_logs(model, logs, driven, options.start)
    write_comparison(compared, folder)
    say(comparison_text(compared))
    print(f"written: {folder}")
    return 1 if all(math.isnan(one.rms) for run in compared.runs for one in run.errors) else 0
