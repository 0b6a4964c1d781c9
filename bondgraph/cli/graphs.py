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
from bondgraph.derive.modes import by_value, modes_json, modes_text
from bondgraph.errors import OptionError, suggest
from bondgraph.files import output_file
from bondgraph.generate.drift import check, explain, render_all, write
from bondgraph.report.drawing import drawing_of, save_drawing
from bondgraph.report.evaluate import evaluate as evaluate_points


def equations(options: argparse.Namespace) -> int:
    """Print the state equations of a graph."""
    causal = assign_causality(load_graph(options.graph), options.independent)
    derivation = Derivation(causal, smooth=not options.exact)
    derived = derivation.equations()
    check_closed(derived)
    check_dimensions(derived)
    shown = by_value(derived)
    if options.json:
        answer = equations_json(derivation, shown)
        print(json.dumps(answer | {"modes": modes_json(derived)} if options.exact else answer, indent=1))
    elif options.latex:
        print(latex(shown))
    else:
        print("\n".join(filter(None, (equations_text(derivation, shown), modes_text(derived)))))
    return 0


def evaluate(options: argparse.Namespace) -> int:
    """Print derivatives, outputs and bond variables at given points."""
    points = read_json(options.points, "--points")
    if not isinstance(points, list):
        raise OptionError(f"--points {options.points}: expected a list of points", where=("--points",))
    print(json.dumps(finite(evaluate_points(load_graph(options.graph), points, smooth=not options.exact)), indent=1))
    return 0


def draw(options: argparse.Namespace) -> int:
    """Draw a graph with its causal strokes."""
    graph = load_graph(options.graph)
    target = output_file(Path(options.out or f"{graph.name}.svg"))
    save_drawing(drawing_of(assign_causality(graph)), target)
    print(f"drawn: {target}")
    return 0


def generate(options: argparse.Namespace) -> int:
    """Write the generated modules, or compare them with their graphs."""
    declared: tuple[str, ...] = tuple(getattr(importlib.import_module(options.graphs), "GENERATED", ()))
    if options.exact and not options.names:
        raise OptionError("generate --exact needs the NAMEs of the graphs it is meant for", where=("--exact",))
    modules = render_all(_named(declared, options.names) if options.names else declared, smooth=not options.exact)
    folder = Path(options.folder)
    complete = not options.names
    if options.check:
        differences = check(folder, modules, complete)
        if differences:
            print(explain(differences, _command(options)))
            return 1
        print(f"{len(modules)} generated modules are what their graphs give")
        return 0
    for path in write(folder, modules, complete):
        print(f"written: {path}")
    return 0


def _command(options: argparse.Namespace) -> str:
    return shlex.join(["bondgraph", "generate", *options.names, *(["--exact"] if options.exact else [])])


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
