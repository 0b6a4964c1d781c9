"""Commands on declared graphs: equations, evaluate, draw, generate."""

from __future__ import annotations

import argparse
import importlib
import json
import shlex
from collections.abc import Sequence
from pathlib import Path

from bondgraph.cli.values import finite, read_json
from bondgraph.declare.files import load_graph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import Derivation, check_closed
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.derive.explicit import equations_json, equations_text
from bondgraph.derive.latex import latex
from bondgraph.errors import OptionError, suggest
from bondgraph.generate.drift import check, explain, render_all, write
from bondgraph.report.drawing import drawing_of, save_drawing
from bondgraph.report.evaluate import evaluate as evaluate_points


def equations(options: argparse.Namespace) -> int:
    """Print the state equations of a graph."""
    derivation = Derivation(assign_causality(load_graph(options.graph), options.independent))
    derived = derivation.equations()
    check_closed(derived)
    check_dimensions(derived)
    if options.json:
        print(json.dumps(equations_json(derivation, derived), indent=1))
    else:
        print(latex(derived) if options.latex else equations_text(derivation, derived))
    return 0


def evaluate(options: argparse.Namespace) -> int:
    """Print derivatives, outputs and bond variables at given points."""
    points = read_json(options.points, "--points")
    if not isinstance(points, list):
        raise OptionError(f"--points {options.points}: expected a list of points", where=("--points",))
    print(json.dumps(finite(evaluate_points(load_graph(options.graph), points)), indent=1))
    return 0


def draw(options: argparse.Namespace) -> int:
    """Draw a graph with its causal strokes."""
    graph = load_graph(options.graph)
    target = Path(options.out or f"{graph.name}.svg")
    save_drawing(drawing_of(assign_causality(graph)), target)
    print(f"drawn: {target}")
    return 0


def generate(options: argparse.Namespace) -> int:
    """Write the generated modules, or compare them with their graphs."""
    declared: tuple[str, ...] = tuple(getattr(importlib.import_module(options.graphs), "GENERATED", ()))
    modules = render_all(_named(declared, options.names) if options.names else declared)
    folder = Path(options.folder)
    complete = not options.names
    if options.check:
        differences = check(folder, modules, complete)
        if differences:
            print(explain(differences, shlex.join(["bondgraph", "generate", *options.names])))
            return 1
        print(f"{len(modules)} generated modules are what their graphs give")
        return 0
    for path in write(folder, modules, complete):
        print(f"written: {path}")
    return 0


def _named(declared: Sequence[str], names: Sequence[str]) -> list[str]:
    """References of graphs given by reference, by file, or by the name of a declared graph."""
    by_name = {load_graph(reference).name: reference for reference in declared}
    found = []
    for name in names:
        if ":" in name or name.endswith(".json"):
            found.append(name)
        elif name in by_name:
            found.append(by_name[name])
        else:
            raise OptionError(
                f"generate {name}: no graph of this name{suggest(name, by_name)} - the declared ones are "
                f"{', '.join(by_name)}; any other is given as module:function",
                where=(name,),
            )
    return found
