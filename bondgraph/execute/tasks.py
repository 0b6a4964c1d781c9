"""Tasks given to an executor: their answers as they come or in order, and a second try where a worker died."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import Any, TypeVar

from bondgraph.errors import ExecutionError

_Answer = TypeVar("_Answer")

#: Exceptions that tell of a dead worker, by name, since their libraries are loaded only where they are used: of
#: :mod:`concurrent.futures`, pebble, and Dask, which has tried other workers by then.
_DEATHS = ("BrokenProcessPool", "ProcessExpired", "KilledWorker")


class WorkerDiedError(ExecutionError):
    """The worker of a task ended without an answer, and so did the one in which it was tried again."""


def as_done(
    executor: Executor | None,
    function: Callable[..., _Answer],
    tasks: Sequence[tuple[Any, ...]],
    died: Callable[[int, WorkerDiedError], _Answer] | None = None,
) -> Iterator[tuple[int, _Answer]]:
    """Answers of a function to tasks, each with the position of its task, as soon as they are there.

    Parameters
    ----------
    executor
        Any of :mod:`concurrent.futures`; None: one after the other in this process, each when it is asked for.
    function
        A function of a module, so that workers can import it.
    tasks
        Its arguments, of values that can be pickled.
    died
        The answer to a task whose workers died, by its position; None raises the error.

    Raises
    ------
    WorkerDiedError
        If two workers of one task died. What a task raises is raised here; tasks that have not begun are taken back.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> with ThreadPoolExecutor(2) as executor:
    ...     sorted(as_done(executor, pow, [(2, 3), (3, 2)]))
    [(0, 8), (1, 9)]
    """
    if executor is None:
        for position, task in enumerate(tasks):
            yield position, function(*task)
        return
    waiting: dict[Future[_Answer], int] = {executor.submit(function, *task): k for k, task in enumerate(tasks)}
    again: set[int] = set()
    try:
        while waiting:
            done, _ = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                position = waiting.pop(future)
                error = future.exception()
                if error is None:
                    yield position, future.result()
                elif type(error).__name__ not in _DEATHS:
                    raise error
                elif position not in again:
                    again.add(position)
                    waiting[executor.submit(function, *tasks[position])] = position
                else:
                    yield position, _dead(position, error, died)
    finally:
        for future in waiting:
            future.cancel()


def _dead(position: int, error: BaseException, died: Callable[[int, WorkerDiedError], _Answer] | None) -> _Answer:
    found = WorkerDiedError(
        f"task {position + 1}: its worker died twice without an answer, out of memory for example - take fewer"
        " workers, or machines with more memory",
        where=(str(position),),
    )
    if died is None:
        raise found from error
    return died(position, found)


def in_order(
    executor: Executor | None, function: Callable[..., _Answer], tasks: Sequence[tuple[Any, ...]]
) -> list[_Answer]:
    """Answers of a function to tasks, in the order of the tasks; arguments and errors as for :func:`as_done`.

    Examples
    --------
    >>> in_order(None, pow, [(2, 3), (3, 2)])
    [8, 9]
    """
    found = dict(as_done(executor, function, tasks))
    return [found[position] for position in range(len(tasks))]
