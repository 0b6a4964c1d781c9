"""Executors by the text of an option: ``serial``, ``threads``, ``processes:4``, ``dask://host:8786``."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager

from bondgraph.errors import OptionError, suggest
from bondgraph.execute.threads import available_cores

KINDS = ("serial", "threads", "processes", "dask")

_HELP = (
    "who computes what can be computed side by side: serial (this process, the default), threads[:N], processes[:N] "
    "(N: one per core unless given), or the workers of a Dask cluster, dask://HOST:PORT; answers are the same"
)

_LOCAL = re.compile(r"(serial|threads|processes)(?::(\d+))?")
_CLUSTER = re.compile(r"dask://([^/\s:]+:\d+)/?")


def add_executor(command: argparse.ArgumentParser) -> None:
    """The option ``--executor`` of a command, for :func:`open_executor`."""
    command.add_argument("--executor", type=_option, default="serial", metavar="WHO", help=_HELP)


def _option(text: str) -> str:
    try:
        return check_executor(text)
    except OptionError as error:
        raise argparse.ArgumentTypeError(error.message) from None


def check_executor(text: str) -> str:
    """The text of an executor as it is.

    Raises
    ------
    OptionError
        If it names none.
    """
    local = _LOCAL.fullmatch(text)
    if _CLUSTER.fullmatch(text) or (local and local[2] != "0" and (local[2] is None or local[1] != "serial")):
        return text
    kind = re.split(r"\W", text)[0]
    raise OptionError(
        f"{text!r}: there is no such executor{'' if kind in KINDS else suggest(kind, KINDS)}"
        " - give serial, threads, threads:N, processes, processes:N or dask://HOST:PORT",
        where=("executor", text),
    )


@contextmanager
def open_executor(given: str | Executor | None = "serial", renewed: int = 0) -> Iterator[Executor | None]:
    """The executor of a text, open while its context is; None for ``serial``: tasks are done where they are made.

    An exception takes back what has not begun, ends processes, and waits for nothing.

    Parameters
    ----------
    given
        ``"serial"``, ``"threads"``, ``"threads:8"``, ``"processes"``, ``"processes:4"``, ``"dask://host:8786"``; an
        executor of one's own is taken as it is and stays open.
    renewed
        Tasks after which one of the processes is replaced, for tasks that leave much in memory; 0: never.

    Raises
    ------
    OptionError
        If it names no executor, or its library is not installed.
    ExecutionError
        If a cluster does not answer or has no workers.

    Examples
    --------
    >>> from bondgraph.execute import in_order
    >>> with open_executor("threads:2") as executor:
    ...     in_order(executor, pow, [(2, 3), (3, 2)])
    [8, 9]
    """
    if not isinstance(given, str):
        yield given
        return
    kind, _, rest = check_executor(given).partition(":")
    if kind == "serial":
        yield None
    elif kind == "dask":
        from bondgraph.execute.cluster import cluster_executor  # here: an optional library

        with cluster_executor(rest.strip("/")) as cluster:
            yield cluster
    else:
        with _ended(_local(kind, int(rest) if rest else available_cores(), renewed)) as executor:
            yield executor


def _local(kind: str, count: int, renewed: int) -> Executor:
    if kind == "threads":
        return ThreadPoolExecutor(count, thread_name_prefix="tasks")
    from bondgraph.execute.processes import ProcessExecutor  # here: not everybody needs processes

    return ProcessExecutor(count, renewed)


@contextmanager
def _ended(executor: Executor) -> Iterator[Executor]:
    try:
        yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        raise
    executor.shutdown()
