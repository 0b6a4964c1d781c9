"""Options of the commands of daily work: look at a log, lay a model over it, begin a model, complete words."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from bondgraph.cli.log_options import LOGS_HELP, add_map, add_reading, add_set, add_start, add_window

#: Adds a command: all commands, its name, summary and examples.
AddCommand = Callable[[Any, str, str, str], argparse.ArgumentParser]
SHELLS = ("bash", "zsh", "tcsh")


def add_daily_commands(commands: Any, command: AddCommand) -> None:
    """Add ``new``, ``inspect``, ``compare`` and ``completion``."""
    c = command(
        commands, "new", "begin a machine: a folder with a graph, logs and a script, all of which run",
        "  bondgraph new sled\n  cd sled && bondgraph compare sled.py --data run1.csv",
    )  # fmt: skip
    c.add_argument("name", metavar="NAME", help="name of the machine and of the folder: letters, digits, underscores")

    c = command(
        commands, "inspect", "look at a log: channels, units, rates, gaps, outliers, suspicious units",
        "  bondgraph inspect run.csv\n  bondgraph inspect run.mf4 --from 20 --until 60 --plot run.png\n"
        "  bondgraph inspect drive.bag --units cmd.linear.x=m/s --json",
    )  # fmt: skip
    c.add_argument("log", metavar="LOG", help=LOGS_HELP)
    add_reading(c)
    add_window(c)
    c.add_argument("--plot", metavar="FILE", help="picture of all channels: .png, .svg or .pdf")
    c.add_argument("--json", action="store_true", help="print one JSON object instead of text")

    c = command(
        commands, "compare", "lay a declared model over logs: errors of free simulation per channel, pictures",
        "  bondgraph compare sled.py --data run1.csv run2.csv\n"
        "  bondgraph compare motor.json --data run.csv --set R_a=1.2 --map engine_rpm=omega --from 2 --until 9",
    )  # fmt: skip
    c.add_argument("model", metavar="MODEL", help="as for filter: graph of a file or module, or generated module")
    c.add_argument("--data", nargs="+", required=True, metavar="FILE", help=LOGS_HELP)
    add_map(c)
    add_reading(c)
    add_window(c)
    add_set(c, "value of an input where the logs have no column of it, or of a parameter of a declared graph")
    add_start(c)
    c.add_argument("--out", default="compared", metavar="DIR", help="folder to write (default: compared)")

    c = command(
        commands, "completion", "print a script by which a shell completes commands and options",
        "  bondgraph completion bash > ~/.local/share/bash-completion/completions/bondgraph",
    )  # fmt: skip
    c.add_argument("shell", choices=SHELLS, help="shell")
