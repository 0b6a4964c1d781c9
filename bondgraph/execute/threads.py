"""Threads of this process, for compiled code that computes side by side."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_Task = TypeVar("_Task")
_Answer = TypeVar("_Answer")


def in_threads(threads: int, action: Callable[[_Task], _Answer], tasks: Sequence[_Task]) -> list[_Answer]:
    """Answers of an action to some tasks, in their order.

    Examples
    --------
    >>> in_threads(2, abs, [-1, -2, -3])
    [1, 2, 3]
    """
    if threads == 1 or len(tasks) < 2:
        return [action(task) for task in tasks]
    with ThreadPoolExecutor(min(threads, len(tasks))) as executor:
        return list(executor.map(action, tasks))


def thread_count(threads: int | None) -> int:
    """At least one; None: one per available core."""
    return available_cores() if threads is None else max(1, threads)


def available_cores() -> int:
    """Cores this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not every system lets a process be pinned
        return os.cpu_count() or 1
