"""Executors: what each gives, who does the tasks, and what happens when one of them dies."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest
from pebble.pool.channel import Channel

from bondgraph.cli import main
from bondgraph.errors import ExecutionError, OptionError
from bondgraph.execute import Shared, as_done, in_order, open_executor
from bondgraph.execute.processes import ProcessExecutor
from bondgraph.execute.tasks import WorkerDiedError


@pytest.fixture(autouse=True)
def deadline() -> Iterator[None]:
    """A test that hangs on its processes is ended."""
    before = signal.signal(signal.SIGALRM, lambda *_: pytest.fail("the workers hang"))
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def _slow_first(number: int) -> int:
    time.sleep(0.2 if number == 0 else 0.0)
    return number


def test_answers_come_as_they_are_done_and_are_put_in_order() -> None:
    tasks = [(0,), (1,), (2,)]
    with ThreadPoolExecutor(2) as executor:
        assert [position for position, _ in as_done(executor, _slow_first, tasks)][-1] == 0
        assert in_order(executor, _slow_first, tasks) == [0, 1, 2]
    assert in_order(None, _slow_first, tasks) == [0, 1, 2]


def test_nothing_is_done_here_before_it_is_asked_for() -> None:
    seen: list[int] = []
    answers = as_done(None, seen.append, [(1,), (2,)])
    assert seen == []
    next(answers)
    assert seen == [1]


def test_an_error_of_a_task_is_raised_and_what_has_not_begun_is_taken_back() -> None:
    with ThreadPoolExecutor(1) as executor, pytest.raises(ValueError, match="math"):
        in_order(executor, _fails_or_waits, [(True,), *[(False,)] * 100])


def _fails_or_waits(fails: bool) -> None:
    if fails:
        raise ValueError("math")
    time.sleep(10.0)  # a hundred of these would meet the deadline, and the one that may have begun does not


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("proceses", "did you mean 'processes'"),
        ("processes:0", "no such executor"),
        ("serial:2", "no such executor"),
        ("threads:many", "no such executor"),
        ("dask://nowhere", "dask://HOST:PORT"),
        ("", "give serial, threads"),
    ],
)
def test_what_is_no_executor_is_refused(text: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(OptionError, match=said), open_executor(text):
        pass
    with pytest.raises(SystemExit) as ended:
        main(["estimate", "sled.py", "--data", "run.csv", "--executor", text])
    assert ended.value.code == 2 and "no such executor" in capsys.readouterr().err


def test_an_executor_of_ones_own_stays_open() -> None:
    with ThreadPoolExecutor(1) as own:
        with open_executor(own) as executor:
            assert executor is own
        assert own.submit(abs, -1).result() == 1
    with open_executor("serial") as nobody, open_executor(None) as neither:
        assert nobody is None and neither is None


def test_a_shared_value_is_opened_once() -> None:
    shared = Shared.of({"log": [1.0]})
    there = pickle.loads(pickle.dumps(shared))
    assert there.open() == {"log": [1.0]} and there.open() is shared.open()
    first = shared.open()
    for k in range(30):  # what is asked for again stays, what is not makes room
        assert Shared.of(k).open() == k and shared.open() is first
    for k in range(30):
        Shared.of(k).open()
    assert shared.open() == first and shared.open() is not first


def test_processes_are_replaced_as_often_as_it_takes() -> None:
    with ProcessExecutor(1, renewed=2) as executor:
        seen = in_order(executor, os.getpid, [()] * 5)
    assert seen[0] == seen[1] and seen[2] == seen[3] and len({*seen[::2], os.getpid()}) == 4


def _die_once(mark: Path) -> str:
    if not mark.exists():
        mark.touch()
        os._exit(1)
    return "lived"


def _die_or(answer: str) -> str:
    if not answer:
        os._exit(1)
    return answer


def test_a_process_that_dies_is_replaced_and_its_task_tried_once_more(tmp_path: Path) -> None:
    with open_executor("processes:1") as executor:
        assert in_order(executor, _die_once, [(tmp_path / "mark",)]) == ["lived"]
        answers = as_done(executor, _die_or, [("a",), ("",), ("c",)], lambda k, error: f"{k}: {error}"[:30])
        assert dict(answers) == {0: "a", 1: "1: task 2: its worker died twi", 2: "c"}
        with pytest.raises(WorkerDiedError, match="died twice"):
            in_order(executor, _die_or, [("",)])


@pytest.mark.parametrize("count", [1, 2])
def test_a_process_that_dies_before_its_word_is_read_is_replaced(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    read = Channel.recv

    def slowly(channel: Channel) -> object:
        time.sleep(0.3)  # three times as long as the pool takes between looks for the dead
        return read(channel)

    monkeypatch.setattr(Channel, "recv", slowly)
    with open_executor(f"processes:{count}") as executor:
        answers = dict(as_done(executor, _die_or, [("",), ("a",)], lambda k, _: f"{k} died"))
        assert answers == {0: "0 died", 1: "a"}
        assert in_order(executor, _die_or, [("b",)]) == ["b"]


def _note_and_wait(mark: Path) -> None:
    mark.write_text(str(os.getpid()), encoding="utf-8")
    time.sleep(250.0)


def _hold(mark: Path) -> None:
    with ProcessExecutor(1) as executor:
        executor.submit(_note_and_wait, mark).result()


def _ended(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    return False


def _noted(mark: Path) -> int:
    while not mark.exists() or not mark.read_text(encoding="utf-8"):
        time.sleep(0.05)
    return int(mark.read_text(encoding="utf-8"))


def test_processes_end_with_the_one_that_began_them(tmp_path: Path) -> None:
    mark = tmp_path / "worker"
    holder = get_context("spawn").Process(target=_hold, args=(mark,))
    holder.start()
    worker = _noted(mark)
    assert not _ended(worker)
    holder.kill()
    holder.join()
    while not _ended(worker):  # until the deadline
        time.sleep(0.05)


def test_an_interruption_ends_processes_and_waits_for_nothing(tmp_path: Path) -> None:
    mark = tmp_path / "worker"
    with pytest.raises(KeyboardInterrupt), open_executor("processes:1") as executor:
        assert executor is not None
        executor.submit(_note_and_wait, mark)
        worker = _noted(mark)
        raise KeyboardInterrupt
    while not _ended(worker):
        time.sleep(0.05)


def test_a_script_that_its_workers_would_run_again_is_told(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import os\nfrom bondgraph.execute import in_order, open_executor\n"
        "with open_executor('processes:1') as executor:\n    print(in_order(executor, os.getpid, [()]))\n"
    )
    ended = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=50)
    assert ended.returncode != 0 and ended.stdout == ""
    assert "put what a script does under if __name__ == '__main__':" in ended.stderr.splitlines()[-1]


def test_nothing_is_taken_after_shutdown() -> None:
    executor = ProcessExecutor(1)
    executor.shutdown()
    with pytest.raises(ExecutionError, match="cannot begin"):
        executor.submit(os.getpid)


def test_a_cluster_that_does_not_answer_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("bondgraph.execute.cluster._PATIENCE", 0.5)
    with pytest.raises(ExecutionError, match="no scheduler answers"), open_executor("dask://127.0.0.1:1"):
        pass
