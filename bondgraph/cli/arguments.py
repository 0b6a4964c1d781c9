"""The commands and their options, with help that teaches."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any

from bondgraph.cli.daily_arguments import add_daily_commands
from bondgraph.cli.estimation_options import (
    add_knowledge,
    add_problem,
    add_robust,
    add_strict,
    estimate_options,
    profile_options,
)
from bondgraph.cli.experiment_options import design_options, sensitivity_options
from bondgraph.cli.log_options import (
    LOGS_HELP,
    add_across_gaps,
    add_between,
    add_fmu_units,
    add_gaps,
    add_map,
    add_reading,
    add_set,
    add_start,
    add_window,
)
from bondgraph.cli.numbers import count, finite, positive, seed, share
from bondgraph.execute.executors import add_executor
from bondgraph.version import __version__

GRAPH_HELP = (
    "graph of a Python file (sled.py, or sled.py:name where it declares several) or module "
    "(vehicle_graphs.baja:launch), or graph file (motor.json); the name is that of a BondGraph or of a function that "
    "returns one"
)
#: Kinds of files of the states' table that a filter writes.
STATE_FORMS = ("csv", "csv.gz", "parquet")
#: Folder of the generated modules.
FOLDER = "generated"
MODEL_HELP = GRAPH_HELP + ", or generated module (generated/driveline.py)"


def parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    top = argparse.ArgumentParser(
        prog="bondgraph",
        description="Bond graphs to corrected models: declare a machine, derive its model, explain its measurements.",
        epilog="bondgraph demo shows the whole path in about a minute; bondgraph COMMAND --help teaches each step.",
    )
    top.add_argument("--version", action="version", version=f"bondgraph {__version__}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_graph_commands(commands)
    _add_linearise(commands)
    _add_run_commands(commands)
    _add_loop_commands(commands)
    _add_effects(commands)
    add_daily_commands(commands, _command)
    return top


def _command(commands: Any, name: str, summary: str, examples: str) -> argparse.ArgumentParser:
    added: argparse.ArgumentParser = commands.add_parser(
        name, help=summary, description=summary, epilog=f"examples:\n{examples}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    return added


def _add_effects(commands: Any) -> None:
    c = _command(
        commands, "effects", "list the effects that a loop can try, or show one with its law and picture",
        "  bondgraph effects\n  bondgraph effects --domain hydraulic\n"
        "  bondgraph effects relief_valve --picture relief.svg",
    )  # fmt: skip
    c.add_argument("name", nargs="?", default="", metavar="NAME", help="an effect, by its name in any domain")
    c.add_argument(
        "--domain", default="", choices=("mechanical", "electrical", "hydraulic", "thermal", "chemical"),
        help="effects of one domain",
    )  # fmt: skip
    c.add_argument("--json", action="store_true", help="print the table as JSON")
    c.add_argument("--picture", metavar="FILE", help="draw the law over its variable (.svg, .png, .pdf)")


def _add_graph_commands(commands: Any) -> None:
    c = _command(
        commands, "equations", "assign causality and print the state equations of a graph",
        "  bondgraph equations motor.json\n  bondgraph equations vehicle_graphs.driveline:driveline --json",
    )  # fmt: skip
    c.add_argument("graph", metavar="GRAPH", help=GRAPH_HELP)
    c.add_argument("--json", action="store_true", help="print the stable JSON object instead of text")
    c.add_argument("--latex", action="store_true", help="print LaTeX instead of text")
    c.add_argument("--independent", nargs="+", default=(), metavar="STORAGE", help="storages that choose first")
    _add_exact(c)

    c = _command(
        commands, "evaluate", "evaluate a graph at given points: derivatives, outputs, every bond",
        "  bondgraph evaluate motor.json --points points.json --json\n"
        '  points.json: [{"states": {"momentum(L)": 0.01}, "inputs": {"u_a": 12}}]',
    )  # fmt: skip
    c.add_argument("graph", metavar="GRAPH", help=GRAPH_HELP)
    c.add_argument("--points", required=True, metavar="P.json", help="list of points in energy variables")
    c.add_argument("--json", action="store_true", help="answer in JSON (always so; kept for scripts)")
    _add_exact(c)

    c = _command(
        commands, "draw", "draw a graph with its causal strokes",
        "  bondgraph draw vehicle_graphs.driveline:driveline -o driveline.svg\n"
        "  bondgraph draw motor.json -o motor.png",
    )  # fmt: skip
    c.add_argument("graph", metavar="GRAPH", help=GRAPH_HELP)
    c.add_argument("-o", "--out", metavar="FILE", help="picture to write: .svg, .png or .pdf (default: NAME.svg)")

    _add_generate(commands)


def _add_generate(commands: Any) -> None:
    c = _command(
        commands, "generate", "write the generated modules of the declared graphs, or check them",
        "  bondgraph generate              write all that vehicle_graphs declares\n"
        "  bondgraph generate driveline    write one of them\n"
        "  bondgraph generate sled.py      write that of a file of one's own\n"
        "  bondgraph generate --check      exit status 1 and a diff where a module has drifted from its graph",
    )  # fmt: skip
    c.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="declared graphs by name, any as FILE.py, FILE.py:name or module:name (default: all declared)",
    )
    c.add_argument("--check", action="store_true", help="compare only, write nothing")
    _add_exact(c)
    c.add_argument("--folder", default=FOLDER, help=f"folder of the modules (default: {FOLDER})")
    c.add_argument(
        "--graphs", default="vehicle_graphs", help="package that declares GENERATED (default: vehicle_graphs)"
    )


def _add_linearise(commands: Any) -> None:
    c = _command(
        commands, "linearise", "linear model of a graph at an operating point: matrices, modes, transfer functions",
        "  bondgraph linearise motor.json --transfer u_a omega --bode motor.png\n"
        "  bondgraph linearise vehicle_graphs.driveline:driveline --at engine_torque=30 --steady",
    )  # fmt: skip
    c.add_argument("graph", metavar="GRAPH", help=GRAPH_HELP)
    c.add_argument(
        "--at", action="append", default=[], metavar="NAME=VALUE",
        help="value of a state, an input or a parameter there (default: as declared)",
    )  # fmt: skip
    c.add_argument("--set", nargs="+", action="extend", dest="at", metavar="NAME=VALUE", help="the same, several")
    c.add_argument("--steady", action="store_true", help="look for the equilibrium near that point first")
    c.add_argument("--moving", nargs="+", default=[], metavar="STATE", help="states that may go on moving in it")
    c.add_argument(
        "--transfer", nargs=2, action="append", default=[], metavar=("INPUT", "OUTPUT"),
        help="print the transfer function between these, with poles and zeros (repeatable)",
    )  # fmt: skip
    c.add_argument("--bode", metavar="FILE", help="frequency response in dB, with margins: .png, .svg or .pdf")
    c.add_argument("--json", action="store_true", help="print matrices and modes as one JSON object instead of text")


def _add_simulate(commands: Any) -> None:
    c = _command(
        commands, "simulate", "simulate a graph over a table of inputs",
        "  bondgraph simulate motor.json --inputs steps.csv --until 2 --step 0.01 --set J=0.05 --out run.csv\n"
        "  bondgraph simulate vehicle_graphs.driveline:driveline --until 20 --set engine_torque=30 --plot run.png\n"
        "  bondgraph simulate vehicle_graphs.ranger:full --scenario full_throttle_launch --plot launch.png\n"
        "  bondgraph simulate engine.fmu --inputs drive.csv --set T_ambient=293 --out torque.csv\n"
        "  bondgraph simulate sled.py --until 20 --set force=100 --out - | head",
    )  # fmt: skip
    c.add_argument("graph", metavar="GRAPH", help=f"{GRAPH_HELP}; or an FMU, whose outputs are written")
    _add_exact(c)
    c.add_argument(
        "--inputs", metavar="FILE",
        help="log with a column per input: 'time [s],u_a [V]'; measured columns may stand beside them",
    )  # fmt: skip
    add_reading(c)
    add_fmu_units(c)
    add_map(c)
    add_window(c, until=False)
    add_between(c)
    add_start(c, "model")
    c.add_argument(
        "--scenario", metavar="NAME", help="manoeuvre declared beside the graph (a name that is none lists them)"
    )
    c.add_argument("--until", type=finite, metavar="T", help="end in s (default: the end of the inputs)")
    c.add_argument("--step", type=positive, metavar="DT", help="interval of the answer in s")
    add_set(c, "parameter, or constant input, in its unit")
    c.add_argument(
        "--initial",
        nargs="+",
        action="extend",
        default=[],
        metavar="STATE=VALUE",
        help="start value in its unit, or a JSON file",
    )
    c.add_argument("--rtol", type=positive, default=1e-9, help="relative tolerance (default: 1e-9)")
    c.add_argument("--atol", type=positive, help="absolute tolerance (default: relative to each state's size)")
    c.add_argument("--all", action="store_true", help="write the effort and flow of every bond too")
    c.add_argument(
        "--out", metavar="FILE",
        help="log to write: .csv, .csv.gz or .parquet; - prints CSV (default: a summary on a terminal, CSV to a pipe)",
    )  # fmt: skip
    c.add_argument("--plot", metavar="FILE", help="picture of states and outputs: .png, .svg or .pdf")


def _add_filter(commands: Any) -> None:
    c = _command(
        commands, "filter", "filter logs with a model: states with bands, innovations, consistency",
        "  bondgraph filter vehicle_graphs.driveline:driveline --data run.csv --smooth --out filtered\n"
        "  bondgraph filter vehicle_graphs.driveline:driveline --data run.csv --robust gate:0.9999\n"
        "  bondgraph filter loop/corrected_graph.json --data later.csv --found loop\n"
        "  bondgraph filter MODEL --data day.parquet --states csv.gz --rounded",
    )  # fmt: skip
    _add_data(c)
    add_strict(c)
    add_robust(c)
    c.add_argument(
        "--found", metavar="FOLDER",
        help="parameters and noise levels that bondgraph estimate or close-loop found, from the folder it wrote "
        "(default: parameters as declared, noise levels guessed from the logs)",
    )  # fmt: skip
    c.add_argument("--smooth", action="store_true", help="states given the whole log instead of the past only")
    c.add_argument(
        "--states", default="csv", choices=STATE_FORMS,
        help="kind of file of NAME_states, the table of all states with their deviations (default: csv)",
    )  # fmt: skip
    c.add_argument(
        "--rounded", action="store_true",
        help="leave out of that table the digits below a thousandth of a state's own deviation: about half the "
        "size, as csv.gz an eighth",
    )  # fmt: skip
    c.add_argument("--out", default="filtered", metavar="DIR", help="folder to write (default: filtered)")


def _add_run_commands(commands: Any) -> None:
    _add_simulate(commands)
    _add_filter(commands)
    _add_estimate(commands)
    _add_experiments(commands)


def _add_estimate(commands: Any) -> None:
    c = _command(
        commands, "estimate", "estimate parameters that make measured logs most likely",
        "  bondgraph estimate vehicle_graphs.driveline:driveline --data run1.csv run2.csv --free tau_grip,F_roll "
        "--out fit\n  bondgraph estimate MODEL --data run.csv --method pso --seed 3 --out fit   (Ctrl-C keeps the best)"
        "\n  bondgraph estimate MODEL --data run.csv --free m=800:1600 --prior m=1200+-50 --holdout other.csv --out fit"
        "\n  bondgraph estimate MODEL --data run.csv --out fit --resume",
    )  # fmt: skip
    _add_data(c)
    estimate_options(c)

    c = _command(
        commands, "profile", "estimate, then say how far each parameter can go before the logs forbid it",
        "  bondgraph profile sled.py --data run1.csv --free mass,drag\n"
        "  bondgraph profile sled.py --data run1.csv --free mass=50:400 drag --prior drag=12+-2 --of mass --until 20\n"
        "  bondgraph profile MODEL --data run.csv --estimate fit     (searched by bondgraph estimate --out fit)\n"
        "  bondgraph profile MODEL --data run.csv --out profile --resume     (Ctrl-C keeps finished profiles)",
    )  # fmt: skip
    _add_data(c)
    profile_options(c)


def _add_experiments(commands: Any) -> None:
    c = _command(
        commands, "sensitivity", "which parameters logs can tell, before anything is estimated",
        "  bondgraph sensitivity vehicle_graphs.driveline:driveline --data run.csv --free tau_grip,F_roll\n"
        "  bondgraph sensitivity MODEL --data run.csv --global sobol --response likelihood speed:last\n"
        "  bondgraph sensitivity MODEL --data run.csv --rates 40,20,10,5        which rate of samples is enough?",
    )  # fmt: skip
    _add_data(c)
    add_problem(c)
    add_knowledge(c)
    sensitivity_options(c)

    c = _command(
        commands, "design", "what planned manoeuvres would tell of parameters, and which tells rival models apart",
        "  bondgraph design vehicle_graphs.ranger:full --scenario full_throttle_launch brake --free T_pk,mu_b\n"
        "  bondgraph design sled.py --inputs slow.csv fast.csv --noise speed=0.02\n"
        "  bondgraph design sled.py --rival windy.py --data run.csv        which steps tell them apart soonest?",
    )  # fmt: skip
    design_options(c, GRAPH_HELP)


def _add_loop_commands(commands: Any) -> None:
    c = _command(
        commands, "close-loop", "find what a declared graph lacks, from measured logs, and add it",
        "  bondgraph close-loop vehicle_graphs.baja:launch --data run_1.csv run_4.csv --holdout run_2.csv --out loop\n"
        "  bondgraph close-loop GRAPH --data a.csv --map engine_rpm=engine_speed --effects my_effects --out loop",
    )  # fmt: skip
    c.add_argument("graph", metavar="GRAPH", help=GRAPH_HELP)
    c.add_argument("--data", nargs="+", required=True, metavar="FILE", help="training logs")
    c.add_argument(
        "--holdout", nargs="+", default=[], metavar="FILE", help="held-out logs: assessed, they decide nothing"
    )
    _add_given(c, add_across_gaps)
    add_start(c)
    c.add_argument("--out", default="loop", metavar="DIR", help="folder to write (default: loop)")
    c.add_argument(
        "--seed", type=seed, default=0, help="noted in the report; nothing here is drawn at random (default: 0)"
    )
    _add_loop(c)

    c = _command(
        commands, "demo", "the whole path: simulate a machine with an undeclared effect, find it, compare",
        "  bondgraph demo\n  bondgraph demo --seed 5 --out demo5",
    )  # fmt: skip
    c.add_argument("--seed", type=seed, default=1, help="picks the effect, the noise and the drives (default: 1)")
    c.add_argument(
        "--no-effect", action="store_true", help="simulate exactly the declared machine: nothing must be found"
    )
    c.add_argument("--out", default="demo", metavar="DIR", help="folder to write (default: demo)")
    c.add_argument("--module", default="vehicle_graphs.demo", help=argparse.SUPPRESS)
    _add_loop(c)


def _add_data(command: argparse.ArgumentParser) -> None:
    command.add_argument("model", metavar="MODEL", help=MODEL_HELP)
    command.add_argument("--data", nargs="+", required=True, metavar="FILE", help=LOGS_HELP)
    _add_given(command)
    add_start(command)


def _add_given(command: argparse.ArgumentParser, gaps: Callable[[argparse.ArgumentParser], None] = add_gaps) -> None:
    """Options on logs beside their names, with the one on jumps in time."""
    add_map(command)
    add_reading(command)
    add_window(command)
    gaps(command)
    add_between(command)
    add_set(command, "value of an input where the logs have no column of it, or of a parameter of a declared graph")


def _add_loop(command: argparse.ArgumentParser) -> None:
    add_problem(command)
    command.add_argument(
        "--effects", nargs="+", default=["bondgraph.effects"], metavar="EFFECT",
        help="effects to try: modules or files of effect functions, single ones as module:name, names of shipped ones "
        "(default: bondgraph.effects)",
    )  # fmt: skip
    command.add_argument(
        "--without", nargs="+", default=[], metavar="NAME", help="effects or sensor faults that are not to be tried"
    )
    command.add_argument(
        "--max-effects", type=count, default=3, metavar="N", help="effects to add at most (default: 3)"
    )
    command.add_argument(
        "--refits", type=count, default=12, metavar="N",
        help="candidates of a round that are refitted at most; the answer says where more were needed (default: 12)",
    )  # fmt: skip
    command.add_argument(
        "--minutes", type=positive, default=math.inf, metavar="N",
        help="time after which no round goes on; the answer is what was found by then, an error before the first round "
        "is over (default: as long as it takes)",
    )  # fmt: skip
    command.add_argument(
        "--level", type=share, default=0.01,
        help="chance of a false alarm in the first round; the k-th has that over k squared (default: 0.01)",
    )  # fmt: skip
    command.add_argument("--rate", type=positive, metavar="HZ", help="use every k-th sample, down to this rate")
    command.add_argument("--no-faults", action="store_true", help="do not try faults of sensors")
    command.add_argument(
        "--tables", action="store_true", help="add what no effect explains as a table whose points are parameters"
    )
    add_executor(command)
    command.add_argument("--resume", action="store_true", help="go on from the finished fits in --out")


def _add_exact(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--exact", action="store_true",
        help="switches jump, friction locks, impacts rebound, at events (default: their smooth forms)",
    )  # fmt: skip
