"""Commands that analyse a declared graph: linearise."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from bondgraph.cli.values import assignments, names
from bondgraph.declare.files import load_graph
from bondgraph.errors import OptionError
from bondgraph.files import finite, output_file
from bondgraph.report.figures import save_figure
from bondgraph.report.linear import bode_figure, linear_answer, linear_json, linear_text, transfer_text


def linearise(options: argparse.Namespace) -> int:
    """Print the linear model of a graph at an operating point, its modes and transfer functions."""
    at: dict[str, float] = {}
    for name, value in assignments(options.at, "--at").items():
        if isinstance(value, str):
            raise OptionError(f"--at {name}={value}: the value must be a number", where=("--at", name))
        at[name] = value
    if options.bode:
        output_file(Path(options.bode))
    answer = linear_answer(load_graph(options.graph), at, options.steady, names(options.moving))
    pairs = [(given, measured) for given, measured in options.transfer]
    print(json.dumps(finite(linear_json(answer)), indent=1) if options.json else linear_text(answer))
    if not options.json:
        for given, measured in pairs:
            print(f"\n{transfer_text(answer, given, measured)}")
    if options.bode:
        every = [(given, measured) for given in answer.model.inputs for measured in answer.model.outputs]
        if not (pairs or every):
            raise OptionError("--bode: the graph has no input or no output to draw", where=("--bode",))
        save_figure(bode_figure(answer, pairs or every[:4]), Path(options.bode))
    return 0
