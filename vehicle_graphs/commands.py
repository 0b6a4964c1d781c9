"""What the commands of the examples have in common: their help, who computes, and how they end.

    python -m vehicle_graphs.NAME --help

says what a command does; ``--executor`` is that of the toolkit's own commands. Bad input ends with its sentence and
status 2, an interruption with 130 and what is finished kept, where the command keeps something.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable

from bondgraph.errors import BondGraphError
from bondgraph.execute.executors import add_executor


def command_parser(name: str, doc: str | None, executor: bool = True) -> argparse.ArgumentParser:
    """The parser of a command that is a module of this package; its docstring is the help."""
    parser = argparse.ArgumentParser(
        prog=f"python -m vehicle_graphs.{name}", description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    if executor:
        add_executor(parser)
    return parser


def importable_main(name: str) -> int:
    """The status of a command whose tasks are functions of its own module, which workers import by its name.

    The module that Python runs is called ``__main__``, and that of a worker is another.
    """
    status: int = importlib.import_module(f"vehicle_graphs.{name}").main()
    return status


def run_command(work: Callable[[], None], kept: str = "") -> int:
    """Do the work of a command; its exit status.

    Parameters
    ----------
    work
        All that may be refused or interrupted.
    kept
        How the command goes on after an interruption, if it does.

    Examples
    --------
    >>> run_command(lambda: None)
    0
    """
    try:
        work()
    except KeyboardInterrupt:
        print(f"stopped{'; ' if kept else ''}{kept}", file=sys.stderr)
        return 130
    except (BondGraphError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0
