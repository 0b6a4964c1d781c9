"""The command line: parse, call, print. What the commands do lives in the rooms."""

from __future__ import annotations

import importlib
import json
import os
import shlex
import sys
from collections.abc import Sequence

from bondgraph.cli.arguments import parser
from bondgraph.errors import BondGraphError

#: Exit statuses: done, the answer is a failure, bad input.
DONE, FAILED, BAD_INPUT = 0, 1, 2

#: Where each command lives; its module is imported when it is called, so that help comes at once.
COMMANDS = {
    "equations": "graphs",
    "evaluate": "graphs",
    "draw": "graphs",
    "linearise": "analysis",
    "generate": "graphs",
    "simulate": "runs",
    "filter": "runs",
    "estimate": "runs",
    "sensitivity": "runs",
    "close-loop": "loops",
    "demo": "loops",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status.

    Examples
    --------
    >>> main(["equations", "there_is_no_such_file.json"])
    2
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser().parse_args(given)
    options.command_line = shlex.join(["bondgraph", *given])
    module = importlib.import_module(f"bondgraph.cli.{COMMANDS[options.command]}")
    try:
        status: int = getattr(module, options.command.replace("-", "_"))(options)
        sys.stdout.flush()
        return status
    except BondGraphError as error:
        if getattr(options, "json", False):
            answer = {"type": type(error).__name__, "message": error.message, "where": list(error.where)}
            print(json.dumps({"error": answer}))
        print(f"bondgraph {options.command}: {error.message}", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:  # whoever reads the answer has seen enough of it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except KeyboardInterrupt:
        print(f"bondgraph {options.command}: interrupted", file=sys.stderr)
        return FAILED
