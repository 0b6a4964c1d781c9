"""The command line: parse, call, print. What the commands do lives in the rooms."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import shlex
import sys
from collections.abc import Sequence

from bondgraph.cli.folders import without_empty_folders
from bondgraph.cli.interruption import Asked, interruptible
from bondgraph.errors import BondGraphError, OptionError
from bondgraph.files import file_problem
from bondgraph.lazy import overwritten

#: Exit statuses: done, the answer is a failure, bad input; an interrupted command has that of its signal.
DONE, FAILED, BAD_INPUT = 0, 1, 2

#: Where each command lives; its module is imported when it is called, so that help comes at once.
COMMANDS = {
    "new": "daily",
    "inspect": "daily",
    "compare": "comparing",
    "completion": "daily",
    "report": "reports",
    "export": "exchange",
    "equations": "graphs",
    "evaluate": "graphs",
    "draw": "graphs",
    "linearise": "analysis",
    "generate": "graphs",
    "simulate": "runs",
    "filter": "runs",
    "estimate": "runs",
    "profile": "profiles",
    "sensitivity": "experiments",
    "design": "experiments",
    "close-loop": "loops",
    "effects": "dictionary",
    "demo": "loops",
    "docs": "documentation",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status.

    Examples
    --------
    >>> main(["equations", "there_is_no_such_file.json"])
    2
    """
    if problem := overwritten():
        print(f"bondgraph: {problem}", file=sys.stderr)
        return BAD_INPUT
    from bondgraph.cli.arguments import parser  # imports rooms, which an overwritten package does not allow

    with interruptible() as asked:
        try:
            given = list(sys.argv[1:] if arguments is None else arguments)
            options = parser().parse_args(given)
            options.command_line = shlex.join(["bondgraph", *given])
            return _run(options, asked)
        except KeyboardInterrupt:
            print("bondgraph: interrupted", file=sys.stderr)
            return asked.status


def _run(options: argparse.Namespace, asked: Asked) -> int:
    try:
        module = importlib.import_module(f"bondgraph.cli.{COMMANDS[options.command]}")
        status: int = getattr(module, options.command.replace("-", "_"))(options)
        sys.stdout.flush()
        return _interrupted(options, asked) if asked.signal else status
    except BondGraphError as error:
        return _refused(options, error)
    except BrokenPipeError:  # whoever reads the answer has seen enough of it
        _close_output()
        return DONE
    except OSError as error:
        if error.filename is None:
            _close_output()
        return _refused(options, file_problem(error))
    except MemoryError:
        return _refused(options, OptionError("there is not enough memory for this - give fewer or shorter logs"))
    except KeyboardInterrupt:
        return _interrupted(options, asked)


def _refused(options: argparse.Namespace, error: BondGraphError) -> int:
    without_empty_folders(options)
    if getattr(options, "json", False):
        answer = {"type": type(error).__name__, "message": error.message, "where": list(error.where)}
        print(json.dumps({"error": answer}))
    print(f"bondgraph {options.command}: {error.message}", file=sys.stderr)
    return BAD_INPUT


def _interrupted(options: argparse.Namespace, asked: Asked) -> int:
    """Say that a command was stopped, and how to go on where that is possible."""
    resume = f"; what is finished stands in {options.out} - go on with --resume" if "resume" in options else ""
    print(f"bondgraph {options.command}: interrupted{resume}", file=sys.stderr)
    return asked.status


def _close_output() -> None:
    """Take no more of the answer, which would be tried again at the end of the process."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
