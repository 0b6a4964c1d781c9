"""Runs a script as a fresh interpreter would, in a process forked from a clean one that has imported the toolkit.

An interpreter spends seconds on imports before it does anything; a fork of one that has imported and done nothing else
has the same state at once. Environment variables that Python itself reads when it starts have no effect.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
import traceback
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from subprocess import CompletedProcess

_FORKS = "forkserver" in multiprocessing.get_all_start_methods()
_CONTEXT = multiprocessing.get_context("forkserver" if _FORKS else "spawn")
if _FORKS:
    _CONTEXT.set_forkserver_preload(
        ["numba", "matplotlib.figure", "bondgraph.cli.graphs", "bondgraph.cli.runs", "bondgraph.cli.numbers"]
    )


def run_forked(
    code: str, arguments: Sequence[str] = (), *, cwd: Path, environment: Mapping[str, str] | None = None,
    stdout: Path | None = None,
) -> CompletedProcess[str]:  # fmt: skip
    """As ``subprocess.run([sys.executable, "-c", code, *arguments], ...)`` with output captured, or sent to a file."""
    (out, out_end), (err, err_end) = _CONTEXT.Pipe(False), _CONTEXT.Pipe(False)
    given = (code, list(arguments), str(cwd), dict(environment or os.environ), stdout, out_end, err_end)
    process = _CONTEXT.Process(target=_serve, args=given)
    process.start()
    out_end.close()
    err_end.close()
    texts = ["", ""]

    def read(position: int, pipe: Connection) -> None:
        with os.fdopen(os.dup(pipe.fileno()), encoding="utf-8") as stream:
            texts[position] = stream.read()

    readers = [threading.Thread(target=read, args=one) for one in enumerate((out, err))]
    for reader in readers:
        reader.start()
    for reader in readers:
        reader.join()
    process.join()
    out.close()
    err.close()
    return CompletedProcess(list(arguments), process.exitcode or 0, *texts)


def _serve(
    code: str,
    arguments: Sequence[str],
    cwd: str,
    environment: Mapping[str, str],
    stdout: Path | None,
    out: Connection,
    err: Connection,
) -> None:
    target = out.fileno() if stdout is None else os.open(stdout, os.O_WRONLY)
    os.dup2(target, 1)
    os.dup2(err.fileno(), 2)
    out.close()
    err.close()
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = ["-c", *arguments]
    sys.path.insert(0, cwd)
    status = 0
    try:
        exec(compile(code, "<string>", "exec"), {"__name__": "__main__"})
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else 1
    except BaseException:
        traceback.print_exc()
        status = 1
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            status = 120  # as an interpreter ends that cannot say its last words
    os._exit(status)
