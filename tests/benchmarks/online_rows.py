"""Streams of the vehicle: what a sample costs one by one, against the same samples filtered as a log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import likelihood
from bondgraph.filter.online import OnlineFilter
from tests.benchmarks.cases import Case
from tests.benchmarks.timing import side_by_side

#: Samples per second of the drives.
_RATE = 40.0


def online(case: Case, rounds: int) -> list[dict[str, object]]:
    """CPU time per sample of a log and of a stream, their ratio, and how many times faster than 40 Hz the stream is."""
    models = {
        "Runge-Kutta, 25 steps": case.filter_model,
        "ROS3P, 12 graded steps": replace(case.filter_model, method="ros3p", substeps=12, grading=1.35),
    }
    rows: list[dict[str, object]] = []
    for name, model in models.items():
        size = case.log.time.size
        seconds = side_by_side(
            {
                "log": (lambda m=model: likelihood(m, case.log, x0=case.x0, threads=1), size),
                "stream": (_stream(model, case), size),
            },
            rounds,
        )
        rows.append(
            {
                "method": name,
                "ns_per_sample_of_log": 1e9 * seconds["log"],
                "ns_per_sample_of_stream": 1e9 * seconds["stream"],
                "ratio": seconds["stream"] / seconds["log"],
                "times_real_time": 1.0 / (_RATE * seconds["stream"]),
            }
        )
    return rows


def _stream(model: FilterModel, case: Case) -> Callable[[], None]:
    stream = OnlineFilter(model, interval=float(np.median(np.diff(case.log.time))), x0=case.x0)
    empty, log = stream.state, case.log

    def run() -> None:
        stream.restore(empty)
        for k, t in enumerate(log.time):
            stream.step(t, log.u[:, k], log.y[:, k])

    return run
