"""The command that writes graphs for other tools: export."""

from __future__ import annotations

import argparse
from pathlib import Path

from bondgraph.build import build
from bondgraph.declare.files import load_graph
from bondgraph.exchange.c_source import c_source
from bondgraph.exchange.diagrams import dot_text, mermaid_text
from bondgraph.exchange.fmu import export_fmu, has_compiler
from bondgraph.exchange.networks import write_graphml
from bondgraph.files import output_file, write_text


def export(options: argparse.Namespace) -> int:
    """Write a graph for another tool."""
    if options.out:
        output_file(Path(options.out))
    graph = load_graph(options.graph)
    if options.to == "fmu":
        path = export_fmu(build(graph).model, options.out or f"{graph.name}.fmu", options.fmi, options.kind)
        print(f"written: {path}")
        if options.kind == "model-exchange" and not has_compiler():
            print("no C compiler (cc, gcc, clang) was found: it holds sources alone, which the importer compiles")
        return 0
    if options.to == "graphml":
        path = Path(options.out or f"{graph.name}.graphml")
        write_graphml(graph, path)
        print(f"written: {path}")
        return 0
    if options.to == "c":
        text = c_source(build(graph).model)
    else:
        text = (dot_text if options.to == "dot" else mermaid_text)(graph) + "\n"
    if options.out:
        write_text(Path(options.out), text)
        print(f"written: {options.out}")
    else:
        print(text, end="")
    return 0
