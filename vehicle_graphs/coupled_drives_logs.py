"""Convert the coupled electric drives records to logs, training and held-out parts as published.

Usage: ``python -m vehicle_graphs.coupled_drives_logs FOLDER --out DIR``.

FOLDER holds ``uniform_low.csv`` and ``uniform_high.csv`` (columns ``t_s, u_V, y_ticks``, 500 samples at 50 Hz). Of
both the first 400 samples are for training and the last 100 for test (nonlinearbenchmark.org, loader
``nonlinear_benchmarks``).

- ``<record>_train.csv``: the first 400 samples.
- ``<record>_test.csv``: the whole input, and the output of the last 100 samples only. A simulation runs from the same
  standstill as the record and is compared where the test part begins; no sample of the test output is used for its
  initial state, of which the protocol allows the first few.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bondgraph.data.log import Log, LogChannel
from bondgraph.errors import DataError
from vehicle_graphs.measured_tables import read_table, run_importer

RECORDS = ("uniform_low", "uniform_high")
#: Samples for training and for test at the two ends of a record.
TRAINING, TEST = 400, 100


def read_records(folder: Path) -> dict[str, Log]:
    """Training and held-out logs of a folder by file name.

    Raises
    ------
    DataError
        If a file or column is missing, or a record does not have 500 samples.
    """
    logs = {}
    for record in RECORDS:
        columns = read_table(folder / f"{record}.csv", ("t_s", "u_V", "y_ticks"))
        for part, log in record_logs(record, columns["t_s"], columns["u_V"], columns["y_ticks"]).items():
            logs[f"{record}_{part}.csv"] = log
    return logs


def record_logs(name: str, time: np.ndarray, voltage: np.ndarray, rate: np.ndarray) -> dict[str, Log]:
    """Training and test part of one record.

    Raises
    ------
    DataError
        If it does not have 500 samples.
    """
    if time.size != TRAINING + TEST:
        raise DataError(
            f"{name}: {time.size} samples - the published split is into {TRAINING} and {TEST}", where=(name,)
        )
    late = np.where(np.arange(time.size) < TRAINING, np.nan, rate)
    parts = {"train": (slice(TRAINING), rate), "test": (slice(None), late)}
    return {
        part: Log(
            f"{name}_{part}",
            time[rows],
            {
                "voltage": LogChannel("voltage", "V", voltage[rows]),
                "pulse_rate": LogChannel("pulse_rate", "1/s", seen[rows]),
            },
        )
        for part, (rows, seen) in parts.items()
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input."""
    return run_importer(read_records, "vehicle_graphs.coupled_drives_logs", __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
