"""Results are the same bits whatever else runs, however many threads do, and whatever the process did before."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from bondgraph.build import build
from bondgraph.compile.lanes.load import load_lanes, load_tangents
from bondgraph.correct.loop import ClosedLoop, LoopSettings, close_loop
from bondgraph.estimate.likelihoods import FilterLikelihood
from bondgraph.estimate.local import fit, no_report
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.simulate.model import Model
from tests.correct import sled, winch

#: What a process may have asked of a model before: compiled equations, tangents of one or two parameters, a Jacobian.
ASKED: dict[str, Callable[[Model], object]] = {
    "lanes": lambda model: load_lanes(model, True),
    "tangents": lambda model: load_tangents(model, (2, 4), "ros3p"),
    "other tangents": lambda model: load_tangents(model, (2,), "ros3p"),
    "jacobian": lambda model: model.jacobian_x(0.0, model.x0(), model.u0(), model.theta()),
}


@pytest.mark.parametrize("order", list(itertools.permutations(ASKED, 2)), ids="-".join)
def test_compiled_text_does_not_depend_on_what_was_asked_before(order: tuple[str, ...]) -> None:
    # printed of a tape that had grown, the lanes of this winch had three texts and its tangents five
    def texts(before: tuple[str, ...]) -> tuple[str, str]:
        load_lanes.cache_clear()
        load_tangents.cache_clear()
        model = build(winch.winch()).model
        for name in before:
            ASKED[name](model)
        return load_lanes(model, True).text, load_tangents(model, (2, 4), "ros3p").text

    assert texts(order) == texts(())


def test_a_jacobian_asked_for_by_many_threads_is_the_same() -> None:
    model = build(winch.winch()).model
    expected = model.jacobian_x(0.0, model.x0() + 0.3, model.u0(), model.theta())
    other, found, gate = build(winch.winch()).model, dict[int, np.ndarray](), threading.Barrier(6)

    def ask(k: int) -> None:
        gate.wait()
        found[k] = other.jacobian_x(0.0, other.x0() + 0.3, other.u0(), other.theta())

    threads = [threading.Thread(target=ask, args=(k,)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(found[k], expected) for k in range(6))


_LONG_SUMS = """
import hashlib
import numpy as np
from bondgraph.correct.fits.times import Times
from bondgraph.correct.scores.scoring import Linearisation
from bondgraph.filter.whiteness import ljung_box
rng = np.random.default_rng(0)
free, columns = rng.standard_normal((30_001, 3)), rng.standard_normal((30_001, 16))
scores = Linearisation(None, None, (), (), free, 0.1 * free, Times(*[np.zeros(1, dtype=int)] * 3)).each_alone(columns)
found = b"".join(values.tobytes() for values in scores) + repr(ljung_box(free[:, 0])).encode()
print(hashlib.sha256(found).hexdigest())
"""


@pytest.mark.slow
def test_the_threads_of_a_blas_change_no_bit() -> None:
    # scores of candidates and whiteness were summed over samples by a BLAS, in as many parts as it had threads
    def digest(threads: int) -> str:
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": str(threads), "PYTHONPATH": os.getcwd()}
        command = [sys.executable, "-c", _LONG_SUMS]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout

    assert digest(1) == digest(2)


@contextmanager
def busy(threads: int) -> Iterator[None]:
    """Other work beside: threads that keep the processor, its BLAS, and the heap."""
    over = threading.Event()

    def burn(seed: int) -> None:
        rng = np.random.default_rng(seed)
        kept: list[np.ndarray] = []
        while not over.is_set():
            size = int(rng.integers(2, 80))
            kept = [*kept[-50:], np.linalg.qr(rng.random((size, size)))[0]]

    workers = [threading.Thread(target=burn, args=(seed,)) for seed in range(threads)]
    for worker in workers:
        worker.start()
    try:
        yield
    finally:
        over.set()
        for worker in workers:
            worker.join()


def _estimate(threads: int | None) -> bytes:
    """Where an estimate of the winch ends, and all that it is told by."""
    base = winch.fitted(0.3)
    found = fit(base.problem)
    point = np.repeat(found.point[:, np.newaxis], 9, axis=1) + 1e-3 * np.arange(9)
    problem = EstimationProblem(
        base.problem.filter_model, base.problem.logs, base.problem.free, likelihood=FilterLikelihood(threads=threads)
    )
    return b"".join(a.tobytes() for a in (found.point, found.expansion.information, problem.nll(point)))


def _loop() -> tuple[object, ...]:
    """What a loop of the sled says, to the last bit."""
    logs = [sled.pull(sled.added(sled.FUNCTIONS[1], "runner", 2.0), 1, name="run")]
    found: ClosedLoop = close_loop(sled.sled(), logs, [], sled.FUNCTIONS, LoopSettings(max_effects=1), no_report)
    gains = [(one.candidate.label, one.gain) for turn in found.rounds for one in turn.trials]
    return found.verdict, found.history, gains, found.corrected.nll, found.corrected.point.tobytes()


@pytest.mark.slow
def test_the_same_estimate_and_the_same_loop_are_the_same_bits_on_a_busy_machine() -> None:
    estimate, loop = _estimate(None), _loop()
    for turn in range(20):
        with busy(turn % 5):
            assert _estimate((None, 1, 2, 3, 5)[turn % 5]) == estimate
            assert _loop() == loop


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="a process cannot be pinned here")
def test_the_number_of_cores_changes_no_bit() -> None:
    cores = os.sched_getaffinity(0)
    estimate, loop = _estimate(None), _loop()
    try:
        os.sched_setaffinity(0, {min(cores)})
        assert _estimate(None) == estimate
        assert _loop() == loop
    finally:
        os.sched_setaffinity(0, cores)
