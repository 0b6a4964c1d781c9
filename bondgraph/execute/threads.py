"""Threads of this process, for compiled code that computes side by side."""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

_Task = TypeVar("_Task")
_Answer = TypeVar("_Answer")


def in_threads(threads: int, action: Callable[[_Task], _Answer], tasks: Sequence[_Task]) -> list[_Answer]:
    """Answers of an action to some tasks, in their order.

    The caller is one of the threads and takes tasks like the others. So actions may ask for threads themselves, and no
    call waits for a thread that is busy elsewhere. The others are kept for the next call with as many threads: to begin
    one takes longer than a kernel with a short log.

    Raises
    ------
    Exception
        Failure of the first task that fails. Tasks behind it may have been left out.

    Examples
    --------
    >>> in_threads(2, abs, [-1, -2, -3])
    [1, 2, 3]
    >>> in_threads(2, lambda k: sum(in_threads(2, abs, range(-k, 0))), range(5))
    [0, 1, 3, 6, 10]
    """
    if threads == 1 or len(tasks) < 2:
        return [action(task) for task in tasks]
    left = iter(range(len(tasks)))
    answers: dict[int, _Answer] = {}
    failures: dict[int, BaseException] = {}
    lock = threading.Lock()

    def work() -> None:
        while True:
            with lock:
                k = None if failures else next(left, None)
            if k is None:
                return
            try:
                answers[k] = action(tasks[k])
            except BaseException as failure:
                failures[k] = failure

    others = [_others(threads - 1).submit(work) for _ in range(min(threads, len(tasks)) - 1)]
    work()
    wait([other for other in others if not other.cancel()])  # nothing is left for one that has not begun
    if failures:
        raise failures[min(failures)]
    return [answers[k] for k in range(len(tasks))]


@functools.cache
def _others(count: int) -> ThreadPoolExecutor:
    """Threads that stand ready in this process beside a caller; each begins when it is first needed."""
    return ThreadPoolExecutor(count, thread_name_prefix="bondgraph")


if hasattr(os, "register_at_fork"):  # a forked process has none of these threads
    os.register_at_fork(after_in_child=_others.cache_clear)


def thread_count(threads: int | None) -> int:
    """At least one; None: one per available core."""
    return available_cores() if threads is None else max(1, threads)


def available_cores() -> int:
    """Cores this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not every system lets a process be pinned
        return os.cpu_count() or 1
