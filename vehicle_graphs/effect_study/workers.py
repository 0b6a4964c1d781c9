"""Processes that take cases side by side, each replaced after some of them."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from typing import Any, ParamSpec, TypeVar

_P = ParamSpec("_P")
_T = TypeVar("_T")

#: A worker is replaced after so many cases: what it compiled for each stays in its memory (50 to 300 MB a case).
_RENEWED = 10


class ProcessDiedError(RuntimeError):
    """The process of a task ended without an answer, and so did the one in which it was tried again."""


class RenewedProcesses(Executor):
    """So many processes, each replaced after so many tasks.

    A process that ends by itself, as when the system is out of memory, is replaced too, and its task is tried once
    more; if that ends likewise, the task's future raises :class:`ProcessDiedError` and the others go on. If this
    process is killed, the others end with it.

    A pool of :class:`~concurrent.futures.ProcessPoolExecutor` that replaces its processes (``max_tasks_per_child``) may
    end up with none of them and wait for ever (CPython issue 115634; seen with Python 3.11). So here every thread has a
    pool of a single process, and takes another when its tasks are done.

    Parameters
    ----------
    count
        Processes side by side.
    renewed
        Tasks after which a process is replaced.

    Examples
    --------
    >>> with RenewedProcesses(2, renewed=1) as executor:
    ...     sorted(executor.map(abs, [-1, -2, -3]))
    [1, 2, 3]
    """

    def __init__(self, count: int, renewed: int = _RENEWED) -> None:
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="cases")
        self._renewed = renewed
        self._own = threading.local()
        self._pools: list[ProcessPoolExecutor] = []
        self._closed = threading.Lock()
        self._over = False

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Have a task done by the next process that is free."""
        return self._threads.submit(self._done, fn, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; wait for those that run, or not."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        with self._closed:
            self._over = True
            for pool in self._pools:
                pool.shutdown(wait, cancel_futures=cancel_futures)

    def _done(self, task: Callable[..., _T], given: tuple[Any, ...], named: dict[str, Any]) -> _T:
        for _ in range(2):
            try:
                return self._process().submit(task, *given, **named).result()
            except BrokenProcessPool as error:
                self._own.left = 0
                died = error
        raise ProcessDiedError(
            "its process died twice without an answer, out of memory for example - take fewer workers, and remove what "
            "is kept of this task to try it again"
        ) from died

    def _process(self) -> ProcessPoolExecutor:
        """The process of this thread, a new one if the last has done its tasks."""
        own = self._own
        if getattr(own, "left", 0) == 0:
            with self._closed:
                if self._over:
                    raise RuntimeError("no new process after shutdown")
                if hasattr(own, "pool"):
                    own.pool.shutdown()
                    self._pools.remove(own.pool)
                own.pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_end_with_parent)
                self._pools.append(own.pool)
            own.left = self._renewed
        own.left -= 1
        pool: ProcessPoolExecutor = own.pool
        return pool


def _end_with_parent() -> None:
    """End this process when the one that began it is gone; it would go on with its task, and then wait for ever."""
    parent = parent_process()
    assert parent is not None  # this is a process of a pool

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, name="parent", daemon=True).start()


@contextmanager
def workers(count: int) -> Iterator[Executor | None]:
    """An executor of so many processes; none for a single one, whose cases are taken in this process.

    An interruption takes back what has not begun and waits for nothing.
    """
    if count <= 1:
        yield None
        return
    executor = RenewedProcesses(count)
    try:
        yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        raise
    executor.shutdown()
