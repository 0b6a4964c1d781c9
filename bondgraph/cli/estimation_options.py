"""Options of the commands that estimate: what is free, what is known of it, how it is searched."""

from __future__ import annotations

import argparse

from bondgraph.cli.numbers import count, positive, seed, share
from bondgraph.execute.executors import add_executor

#: Methods of an estimation, as :mod:`bondgraph.estimate.methods` knows them.
METHODS = (
    "both", "gradient", "pso", "shade", "de", "cma", "pso+gradient", "shade+gradient", "de+gradient", "cma+gradient",
)  # fmt: skip


def estimate_options(command: argparse.ArgumentParser) -> None:
    """Options of ``bondgraph estimate`` beside its model and its logs."""
    add_problem(command)
    add_knowledge(command)
    command.add_argument(
        "--holdout", nargs="+", default=[], metavar="FILE",
        help="held-out logs, with their likelihood and errors before and after: looked at, they decide nothing",
    )  # fmt: skip
    _add_search(command)
    command.add_argument(
        "--profile", nargs="*", metavar="NAME",
        help="95 %% intervals by the profile likelihood, with a picture, of these parameters (none: all that the logs "
        "tell); bondgraph profile says more of them",
    )  # fmt: skip
    add_strict(command)
    add_robust(command)
    add_executor(command)
    command.add_argument("--out", default="estimate", metavar="DIR", help="folder to write (default: estimate)")
    command.add_argument("--resume", action="store_true", help="go on from the checkpoint in --out")


def profile_options(command: argparse.ArgumentParser) -> None:
    """Options of ``bondgraph profile`` beside its model and its logs."""
    add_problem(command)
    add_knowledge(command)
    command.add_argument(
        "--of", nargs="+", default=[], metavar="NAME",
        help="free parameters whose profiles are asked, also std(output) and the like (default: all that are free)",
    )  # fmt: skip
    command.add_argument(
        "--estimate", metavar="DIR",
        help="folder of a finished bondgraph estimate of the same logs and options, whose search is not done again",
    )  # fmt: skip
    command.add_argument("--level", type=share, default=0.95, help="coverage of the intervals (default: 0.95)")
    _add_search(command)
    add_robust(command)
    add_executor(command)
    command.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    command.add_argument("--out", default="profile", metavar="DIR", help="folder to write (default: profile)")
    command.add_argument(
        "--resume", action="store_true", help="go on from the search and the finished profiles in --out"
    )


def _add_search(command: argparse.ArgumentParser) -> None:
    """How the estimate is searched and looked at again."""
    command.add_argument(
        "--starts", type=count, default=4, metavar="N", help="gradient searches side by side (default: 4)"
    )
    command.add_argument(
        "--method", default="both", choices=METHODS,
        help="a short swarm whose best points start gradient searches and, where these do not meet at one optimum and "
        "the model is cheap, L-SHADE for a deeper one (both, the default), gradient searches from the declared values "
        "and points spread over the bounds (gradient), or a swarm (pso), L-SHADE (shade), scipy's differential "
        "evolution (de) or CMA-ES (cma) alone, each also with gradient searches after it",
    )  # fmt: skip
    command.add_argument(
        "--certify", default="step", choices=("step", "full", "none"),
        help="look at the result again with halved integration steps, or fully also with the classical Runge-Kutta "
        "method, and go on with finer ones where it moves (default: step)",
    )  # fmt: skip
    command.add_argument(
        "--continuation", default="none", choices=("none", "process-noise"),
        help="lead the gradient searches through filters with more process noise, where the start is so far away that "
        "the likelihood is rugged there (default: none)",
    )  # fmt: skip
    command.add_argument("--seed", type=seed, default=0, help="seed of all random numbers of the search (default: 0)")


def add_strict(command: argparse.ArgumentParser) -> None:
    """Add ``--strict``: an exit status that says that the model does not explain the logs."""
    command.add_argument(
        "--strict", action="store_true",
        help="exit status 1 where the model does not explain the logs: its innovations are coloured, or larger than "
        "the filter expects",
    )  # fmt: skip


def add_robust(command: argparse.ArgumentParser) -> None:
    """Add ``--robust``: how outliers of sensors are weighed."""
    command.add_argument(
        "--robust", metavar="LOSS",
        help="sensors that now and then read something else (default: Gaussian; one reading of 20 sigma in a hundred "
        "doubles an estimated noise). student[:DEGREES], heavy tails, 4 degrees of freedom unless given: for outliers "
        "of any size and unknown noise levels; huber[:SIGMA], straight beyond 1.345 sigma: for outliers of a few sigma "
        "(one of 20 in a hundred still raises an estimated noise by a fifth); gate[:PROBABILITY]: readings that a good "
        "one passes with probability 0.999 are used and the others are not, for noise levels that are known roughly. "
        "Outliers are judged channel by channel",
    )  # fmt: skip


def add_problem(command: argparse.ArgumentParser) -> None:
    """Add ``--free`` and ``--process-noise``: what is estimated."""
    command.add_argument(
        "--free", nargs="+", default=[], metavar="NAME",
        help="parameters to estimate, also std(output), process(state), x0(state); m=800:1600 within other bounds than "
        "declared (default: all with bounds; loops take names alone)",
    )  # fmt: skip
    command.add_argument(
        "--process-noise", default="free", choices=("free", "none"),
        help="estimate the noise that drives the states, or take the model as exact (default: free)",
    )  # fmt: skip


def add_knowledge(command: argparse.ArgumentParser) -> None:
    """Add ``--prior``, ``--tie`` and ``--rate``: what is known beside the logs, and how many samples are used."""
    command.add_argument(
        "--prior", action="append", default=[], metavar="NAME=DISTRIBUTION",
        help="what is known of a parameter: m=1200+-50 normal, k=1e5*/1.5 lognormal, eta=0.8:0.95 uniform (repeatable)",
    )  # fmt: skip
    command.add_argument(
        "--tie", action="append", default=[], metavar="NAME=EXPRESSION",
        help="parameter that follows from free ones, in coherent SI: k_r=1.2*k_f (repeatable)",
    )  # fmt: skip
    command.add_argument("--rate", type=positive, metavar="HZ", help="use every k-th sample, down to this rate")
