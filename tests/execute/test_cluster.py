"""A real Dask cluster of two worker processes, one of which is killed while an estimation runs."""

from __future__ import annotations

import os
import signal
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.objective import TraceRow
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.solvers.particle_swarm import SwarmSettings
from bondgraph.execute import in_order, open_executor
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.example import pendulum

distributed = pytest.importorskip("distributed")


@dataclass
class Cluster:
    """A scheduler's address and the processes of its workers."""

    address: str
    workers: list[int]


@pytest.fixture
def cluster() -> Iterator[Cluster]:
    """Two workers of one thread each, whose nannies begin a new one where one dies."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of ports and versions, on some machines
        with (
            distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as local,
            distributed.Client(local, set_as_default=False) as client,
        ):
            yield Cluster(local.scheduler_address.replace("tcp", "dask"), list(client.run(os.getpid).values()))


def _problem() -> EstimationProblem:
    swing = FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
    time = np.arange(300) * 0.05
    noise = np.random.default_rng(1).normal(0.0, 0.05, time.size)
    log = MatchedLog("swing", time, np.zeros((1, 300)), (0.45 * np.cos(3.1 * time) + noise)[np.newaxis])
    return pose(swing, log, ["length", "damping", "std(deflection)"])


def _die_once(mark: Path, number: int) -> float:
    """The sine of a number; the first time that it is asked for its process ends before it can tell."""
    if number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return float(np.sin(number))


@pytest.mark.slow
def test_a_worker_that_is_killed_changes_no_bit(cluster: Cluster, tmp_path: Path) -> None:
    problem, settings = _problem(), Settings(method="both", starts=3, swarm=SwarmSettings(members=40, iterations=12))
    alone = estimate(problem, settings)
    rows: list[TraceRow] = []

    def progress(row: TraceRow) -> None:
        rows.append(row)
        if len(rows) == 4:
            os.kill(cluster.workers[0], signal.SIGKILL)

    with open_executor(cluster.address) as executor:
        assert executor is not None
        assert executor.submit(os.getpid).result() in cluster.workers
        together = estimate(problem, settings, progress=progress, executor=executor)
        seen = _processes(executor)
        numbers = in_order(executor, _die_once, [(tmp_path / "mark", k) for k in range(8)])
    assert cluster.workers[0] not in seen
    assert together.point.tolist() == alone.point.tolist() and together.nll == alone.nll
    assert together.trace == alone.trace and together.std == alone.std
    assert replace(together, seconds=0.0).to_dict() == replace(alone, seconds=0.0).to_dict()
    assert numbers == [float(np.sin(k)) for k in range(8)] and (tmp_path / "mark").exists()


def _processes(executor: Executor) -> set[int]:
    return set(in_order(executor, os.getpid, [()] * 8))
