"""Threads that are kept from call to call: order, nesting, failures, and processes that were forked."""

from __future__ import annotations

import os
import threading
import time

import pytest

from bondgraph.execute.threads import in_threads


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_answers_stand_in_the_order_of_their_tasks(threads: int) -> None:
    def slow_first(k: int) -> int:
        time.sleep(0.01 if k == 0 else 0.0)
        return k * k

    assert in_threads(threads, slow_first, range(7)) == [k * k for k in range(7)]
    assert in_threads(threads, slow_first, []) == []


def test_two_tasks_are_worked_at_at_the_same_time() -> None:
    together = threading.Barrier(2, timeout=20.0)
    in_threads(2, lambda _: together.wait(), range(2))  # a barrier that one alone never passes


@pytest.mark.parametrize("threads", [2, 40])
def test_calls_within_calls_wait_for_no_thread(threads: int) -> None:
    """A caller waited for threads that had not begun, since all of them were callers that waited."""

    def slow(k: int) -> int:
        time.sleep(0.001)
        return k

    def inner(k: int) -> int:
        return k + sum(in_threads(threads, slow, range(40)))

    assert in_threads(threads, inner, range(40)) == [780 + k for k in range(40)]


def test_no_more_threads_work_than_were_asked_for() -> None:
    seen: set[int] = set()

    def work(_: int) -> None:
        seen.add(threading.get_ident())
        time.sleep(0.002)

    in_threads(3, work, range(30))
    assert 1 < len(seen) <= 3 and threading.get_ident() in seen


def test_the_first_failure_is_raised_and_the_threads_go_on_working() -> None:
    done: list[int] = []

    def work(k: int) -> None:
        if k in (3, 5):
            raise ValueError(f"task {k}")
        time.sleep(0.001)
        done.append(k)

    with pytest.raises(ValueError, match="task 3"):
        in_threads(2, work, range(1000))
    assert len(done) < 500  # of 998: those behind it were left out
    assert in_threads(2, abs, [-1, -2]) == [1, 2]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own() -> None:
    in_threads(2, abs, [-1, -2])
    child = os.fork()
    if child == 0:
        os._exit(0 if in_threads(2, abs, [-1, -2]) == [1, 2] else 1)
    assert os.waitpid(child, 0)[1] == 0
