"""Options of the commands that ask before an experiment or an estimation: sensitivity, design."""

from __future__ import annotations

import argparse

from bondgraph.cli.log_options import add_between, add_gaps, add_map, add_reading, add_set, add_start, add_window
from bondgraph.execute.executors import add_executor


def sensitivity_options(command: argparse.ArgumentParser) -> None:
    """Options of ``bondgraph sensitivity`` beside its model, its logs and what is free."""
    command.add_argument(
        "--rates", nargs="+", default=[], metavar="HZ",
        help="standard deviations and cost of these logs at several rates of samples: 40,20,10,5",
    )  # fmt: skip
    command.add_argument(
        "--global", dest="screen", choices=("morris", "sobol"),
        help="over the whole bounds, not at one point: elementary effects (morris: few evaluations, tells what does "
        "not matter) or shares of variance (sobol); needs pip install 'bondloop[sensitivity]'",
    )  # fmt: skip
    command.add_argument(
        "--response", nargs="+", default=[], metavar="WHAT",
        help="what --global asks of: likelihood (default), or outputs as simulated, by name; name:last, name:mean, "
        "name:largest or name:rms (default) say by which number",
    )  # fmt: skip
    command.add_argument(
        "--samples", type=int, default=0, metavar="N",
        help="base samples of sobol, a power of two (default: 1024), or trajectories of morris (default: 40)",
    )  # fmt: skip
    command.add_argument("--seed", type=int, default=0, help="seed of --global (default: 0)")
    _declared_noise(command)
    add_executor(command)
    command.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    command.add_argument("--out", default="sensitivity", metavar="DIR", help="folder to write (default: sensitivity)")


def design_options(command: argparse.ArgumentParser, model_help: str) -> None:
    """Options of ``bondgraph design``."""
    command.add_argument("model", metavar="MODEL", help=model_help)
    command.add_argument(
        "--scenario", nargs="+", default=[], metavar="NAME",
        help="manoeuvres declared beside the graph (a name that is none lists them)",
    )  # fmt: skip
    command.add_argument(
        "--inputs", nargs="+", default=[], metavar="FILE", help="logs whose times and inputs are manoeuvres"
    )
    command.add_argument(
        "--data", nargs="+", default=[], metavar="FILE",
        help="logs at hand: what they tell is known before; noises are taken from them unless given; steps of each "
        "input within their range are tried too",
    )  # fmt: skip
    command.add_argument(
        "--rival", nargs="+", default=[], metavar="MODEL",
        help="other models of the same machine: which manoeuvre tells them from MODEL soonest? With --data all are "
        "fitted to these logs first",
    )  # fmt: skip
    command.add_argument(
        "--free", nargs="+", default=[], metavar="NAME", help="parameters that an estimation would free (default: all "
        "with bounds)",
    )  # fmt: skip
    command.add_argument(
        "--noise", nargs="+", default=[], metavar="OUTPUT=STD",
        help="standard deviation of sensors, in the unit of the output (default: as declared beside the graph)",
    )  # fmt: skip
    command.add_argument("--rate", type=float, default=40.0, metavar="HZ", help="samples of scenarios (default: 40)")
    command.add_argument(
        "--error", type=float, default=0.01, help="chance of a wrong decision between rivals (default: 0.01)"
    )
    add_map(command)
    add_reading(command)
    add_window(command)
    add_gaps(command)
    add_between(command)
    add_set(command, "value of an input where the logs have no column of it, or of a parameter of a declared graph")
    add_start(command)
    add_executor(command)
    command.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    command.add_argument("--out", default="design", metavar="DIR", help="folder to write (default: design)")


def _declared_noise(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--declared-noise", action="store_true",
        help="take the noises that are declared beside the graph as known (default: taken from the logs, and free)",
    )  # fmt: skip
