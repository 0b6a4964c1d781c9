"""CPU time to a first likelihood of the vehicle: the first time on a machine, and every later start."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.benchmarks.cases import RANGER

_FIRST = """
import sys
import numpy as np
from bondgraph.data.log import MatchedLog
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import likelihood
from bondgraph.simulate.model import Model
model = Model.from_file(sys.argv[1])
filtered = FilterModel(model, {}, {"engine_speed": 2.0}, {"engine_speed": 3.0}, method=sys.argv[2])
y = np.full((len(model.outputs), 5), np.nan)
y[0] = 125.0
log = MatchedLog("start", np.arange(5) * 0.001, np.repeat(model.u0()[:, None], 5, axis=1), y)
print(likelihood(filtered, log).nll[0])
"""


def start() -> dict[str, float]:
    """CPU seconds of a process that computes one likelihood, with an empty and with a filled cache."""
    found: dict[str, float] = {}
    for method in ("rk4", "ros3p"):
        with tempfile.TemporaryDirectory() as folder:
            for when in ("cold", "warm"):
                found[f"cpu_s: {when} start, {method}"] = _seconds(method, folder)
    return found


def _seconds(method: str, folder: str) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-c", _FIRST, str(RANGER), method]
    environment = {**os.environ, "BONDGRAPH_CACHE_DIR": folder, "OMP_NUM_THREADS": "1"}
    subprocess.run(command, env=environment, cwd=Path(__file__).resolve().parents[2], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
