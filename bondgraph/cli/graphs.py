"""Commands on declared graphs: equations, evaluate, draw, generate."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from bondgraph.cli.arguments import FOLDER
from bondgraph.cli.values import read_json
from bondgraph.declare.files import load_graph
from bondgraph.declare.loading import is_code_reference, load_module
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import Derivation, check_closed
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.derive.explicit import equations_json, equations_text
from bondgraph.derive.latex import latex
from bondgraph.derive.modes import by_value, modes_json, modes_text
from bondgraph.errors import OptionError, suggest
from bondgraph.files import finite, output_file
from bondgraph.generate.drift import check, explain, render_all, write
from bondgraph.report.drawing import drawing_of, save_drawing
from bondgraph.report.evaluate import evaluate as evaluate_points
from bondgraph.text import inflected


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
    if options.exact and not options.names:
        raise OptionError("generate --exact needs the NAMEs of the graphs it is meant for", where=("--exact",))
    folder = Path(options.folder)
    modules = _modules(options)
    complete = not options.names
    if options.check:
        differences = check(folder, modules, complete)
        if differences:
            print(explain(differences, _command(options)))
            return 1
        print(_unchanged(modules))
        return 0
    written = [f"written: {path}" for path in write(folder, modules, complete)]
    print("\n".join(written or [f"nothing to write: {_unchanged(modules)}"]))
    return 0


def _unchanged(modules: Mapping[str, str]) -> str:
    said = inflected(
        modules, "generated module is what its graph gives", "generated modules are what their graphs give"
    )
    return f"{len(modules)} {said}"


def _modules(options: argparse.Namespace) -> dict[str, str]:
    """Texts of the modules that are asked for; the header of one that is given by reference names its folder too."""
    direct = [name for name in options.names if _is_reference(name)]
    declared = _declared(options) if len(direct) < len(options.names) or not options.names else ()
    references = _named(declared, options.names) if options.names else list(declared)
    folder = Path(options.folder).as_posix()
    elsewhere = () if folder == FOLDER else ("--folder", folder)
    return render_all(references, smooth=not options.exact, options=dict.fromkeys(direct, elsewhere))


def _declared(options: argparse.Namespace) -> tuple[str, ...]:
    """References of the graphs that a package declares."""
    return tuple(getattr(load_module(options.graphs), "GENERATED", ()))


def _is_reference(name: str) -> bool:
    return is_code_reference(name) or name.endswith(".json")


def _command(options: argparse.Namespace) -> str:
    folder = [] if options.folder == FOLDER else ["--folder", options.folder]
    return shlex.join(["bondgraph", "generate", *options.names, *(["--exact"] if options.exact else []), *folder])


def _named(declared: Sequence[str], names: Sequence[str]) -> list[str]:
    """References of graphs given by reference, by file, or by the name of a declared graph."""
    by_name = {load_graph(reference).name: reference for reference in declared}
    found = []
    for name in names:
        if _is_reference(name):
            found.append(name)
        elif name in by_name:
            found.append(by_name[name])
        else:
            raise OptionError(
                f"generate {name}: no graph of this name{suggest(name, by_name)} - the declared ones are "
                f"{', '.join(by_name)}; any other is given as FILE.py, FILE.py:name or module:name",
                where=(name,),
            )
    return found
