"""Options of the commands of daily work: look at a log, lay a model over it, begin a model, complete words."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from bondgraph.cli.log_options import (
    LOGS_HELP,
    add_between,
    add_fmu_units,
    add_gaps,
    add_map,
    add_reading,
    add_set,
    add_start,
    add_window,
)

#: Adds a command: all commands, its name, summary and examples.
AddCommand = Callable[[Any, str, str, str], argparse.ArgumentParser]
SHELLS = ("bash", "zsh", "tcsh")
FORMS = ("fmu", "c", "dot", "mermaid", "graphml")


def add_daily_commands(commands: Any, command: AddCommand) -> None:
    """Add ``new``, ``inspect``, ``compare``, ``report``, ``export``, ``docs`` and ``completion``."""
    c = command(
        commands, "new", "begin a machine: a folder with a graph, logs and a script, all of which run",
        "  bondgraph new sled\n  cd sled && bondgraph compare sled.py --data run1.csv",
    )  # fmt: skip
    c.add_argument("name", metavar="NAME", help="name of the machine and of the folder: letters, digits, underscores")

    _add_inspect(commands, command)

    c = command(
        commands, "compare", "lay a declared model over logs: errors of free simulation per channel, pictures",
        "  bondgraph compare sled.py --data run1.csv run2.csv\n"
        "  bondgraph compare motor.json --data run.csv --set R_a=1.2 --map engine_rpm=omega --from 2 --until 9\n"
        "  bondgraph compare engine.fmu --data drive.csv",
    )  # fmt: skip
    c.add_argument("model", metavar="MODEL", help="graph or generated module, as for filter; or an FMU")
    c.add_argument("--data", nargs="+", required=True, metavar="FILE", help=LOGS_HELP)
    add_map(c)
    add_reading(c)
    add_fmu_units(c)
    add_window(c)
    add_gaps(c)
    add_between(c)
    add_set(c, "value of an input where the logs have no column of it, or of a parameter of a declared graph")
    add_start(c)
    c.add_argument("--out", default="compared", metavar="DIR", help="folder to write (default: compared)")

    _add_report(commands, command)
    _add_export(commands, command)

    _add_docs(commands, command)

    c = command(
        commands, "completion", "print a script by which a shell completes commands and options",
        "  bondgraph completion bash > ~/.local/share/bash-completion/completions/bondgraph",
    )  # fmt: skip
    c.add_argument("shell", choices=SHELLS, help="shell")


def _add_inspect(commands: Any, command: AddCommand) -> None:
    c = command(
        commands, "inspect", "look at a log: channels, units, rates, gaps, outliers, suspicious units",
        "  bondgraph inspect run.csv\n  bondgraph inspect run.mf4 --from 20 --until 60 --plot run.png\n"
        "  bondgraph inspect run.csv --out seen\n"
        "  bondgraph inspect drive.bag --units cmd.linear.x=m/s --json",
    )  # fmt: skip
    c.add_argument("log", metavar="LOG", help=LOGS_HELP)
    add_reading(c)
    add_window(c)
    c.add_argument("--plot", metavar="FILE", help="picture of all channels: .png, .svg or .pdf")
    c.add_argument("--out", metavar="DIR", help="folder to write: report.html, result.json, NAME_channels.png")
    c.add_argument("--json", action="store_true", help="print one JSON object instead of text")


def _add_report(commands: Any, command: AddCommand) -> None:
    c = command(
        commands, "report", "write the report of a finished filter, estimate or close-loop again, without computing",
        "  bondgraph report loop\n  bondgraph report fit1 fit2",
    )  # fmt: skip
    c.add_argument("folders", nargs="+", metavar="DIR", help="folders that the commands wrote")


def _add_docs(commands: Any, command: AddCommand) -> None:
    c = command(
        commands, "docs", "build the documentation to HTML that opens without a network (extra docs; about a minute)",
        "  bondgraph docs --out site",
    )  # fmt: skip
    c.add_argument("--out", default="site", metavar="DIR", help="folder to write (default: site)")


def _add_export(commands: Any, command: AddCommand) -> None:
    c = command(
        commands, "export", "write a graph for other tools: FMU, C, Graphviz DOT, Mermaid, GraphML",
        "  bondgraph export motor.json --to fmu\n"
        "  bondgraph export motor.json --to fmu --fmi 3.0 --kind co-simulation --out motor.fmu\n"
        "  bondgraph export sled.py --to dot | dot -Tsvg > sled.svg\n"
        "In Python, bondgraph.exchange has these and to_control, from_control, to_casadi, from_networkx.",
    )  # fmt: skip
    c.add_argument("graph", metavar="GRAPH", help="graph of a Python file or module, or graph file")
    c.add_argument("--to", required=True, choices=FORMS, help="what to write")
    c.add_argument(
        "--fmi", default="2.0", choices=("2.0", "3.0"), type=lambda text: f"{text}.0" if text in ("2", "3") else text,
        help="version of the standard (default: 2.0)",
    )  # fmt: skip
    c.add_argument(
        "--kind", default="model-exchange", choices=("model-exchange", "co-simulation"),
        help="FMU that an importer integrates (C, the default) or that integrates itself (Python, extra fmu)",
    )  # fmt: skip
    c.add_argument("--out", metavar="FILE", help="file to write (default: NAME.fmu, NAME.graphml; text is printed)")
