"""Processes of this machine: each replaced after some tasks, and when it dies, by pebble.

Reference: pebble (Cafasso), https://pebble.readthedocs.io. The pool of the standard library that replaces its processes
may end up with none of them and wait for ever (CPython issue 115634; seen with Python 3.11), and one that dies takes
all tasks with it.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from multiprocessing import current_process, get_context, parent_process
from typing import Any, ParamSpec, TypeVar

from pebble import ProcessPool
from pebble.pool.process import PoolManager

from bondgraph.errors import ExecutionError

#: What is usually wrong where processes cannot begin: each reads the script that began them.
_GUARD = "put what a script does under if __name__ == '__main__':, or use threads"
_P = ParamSpec("_P")
_T = TypeVar("_T")


class _Manager(PoolManager):
    """Bookkeeping of a pool that reads what a process has written before it looks for the task with which it died.

    Pebble 5.2 reads messages in one thread and looks for the dead in another. A process that takes a task and dies at
    once may be looked for before its word that it took the task is read: the pool is given up then, or, where others
    are at work, the task is waited for for ever.
    """

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._reading = threading.RLock()

    def process_next_message(self, timeout: float) -> None:
        """Wait for a message, and handle it while nobody looks for the dead."""
        channel = self.worker_manager.pool_channel
        if channel is None or channel.poll(timeout):
            with self._reading:
                super().process_next_message(0.0)  # none, if the other thread has read it meanwhile

    def handle_worker_expiration(self, expiration: tuple[int, int]) -> None:
        """Read what is written, by the dead too, and then tell the task of a process that it died."""
        channel = self.worker_manager.pool_channel
        with self._reading:
            while channel is not None and channel.poll(0.0):
                super().process_next_message(0.0)
            super().handle_worker_expiration(expiration)


class _Pool(ProcessPool):
    def __init__(self, count: int, renewed: int) -> None:
        spawn = get_context("spawn")
        super().__init__(count, renewed, initializer=_end_with_parent, context=spawn)
        self._pool_manager = _Manager(self._context, spawn)


class ProcessExecutor(Executor):
    """So many processes side by side.

    A process that ends by itself, as when the system is out of memory, is replaced, and the others go on; the future of
    its task raises :class:`pebble.ProcessExpired`. If this process is killed, the others end with it.

    Parameters
    ----------
    count
        Processes.
    renewed
        Tasks after which a process is replaced; 0: never.

    Raises
    ------
    ExecutionError
        If a script begins processes whenever it is read, so that its workers would too.

    Examples
    --------
    >>> with ProcessExecutor(2) as executor:
    ...     sorted(executor.map(abs, [-1, -2, -3]))
    [1, 2, 3]
    """

    def __init__(self, count: int, renewed: int = 0) -> None:
        if getattr(current_process(), "_inheriting", False):  # as multiprocessing asks it
            raise ExecutionError(f"processes: this one is itself a worker that begins - {_GUARD}", where=("processes",))
        self._pool = _Pool(count, renewed)

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Have a task done by the next process that is free.

        Raises
        ------
        ExecutionError
            If no process can begin, or the executor is shut down.
        """
        try:
            return self._pool.schedule(fn, args=args, kwargs=kwargs)
        except RuntimeError as error:
            raise ExecutionError(f"processes: they cannot begin ({error}) - {_GUARD}", where=("processes",)) from None

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; with ``cancel_futures`` those that run are ended too."""
        if cancel_futures:
            self._pool.stop()  # type: ignore[no-untyped-call]
        else:
            self._pool.close()  # type: ignore[no-untyped-call]
        if wait or cancel_futures:  # pebble ends processes while it is joined
            self._pool.join()


def _end_with_parent() -> None:
    """End this process when the one that began it is gone; it would go on with its task, and then wait for ever."""
    parent = parent_process()
    assert parent is not None  # this is a process of a pool

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, name="parent", daemon=True).start()
