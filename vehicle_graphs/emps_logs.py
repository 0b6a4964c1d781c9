"""Convert the records of the electro-mechanical positioning system (EMPS) to logs.

Usage: ``python -m vehicle_graphs.emps_logs FOLDER --out DIR``.

FOLDER holds ``train.csv.gz`` (trajectory without disturbance, for training) and ``test.csv.gz`` (the same with pulses
added to the controller output, held out), columns ``t_s, q_m, u_V`` at 1 kHz, as published. The logs ``train.csv.gz``
and ``test.csv.gz`` have the columns ``voltage`` (controller output, pulses included) and ``position``; nothing is
filtered. ``train_slow.csv`` and ``test_slow.csv`` hold every fifth position and the mean of the five voltages from
there on, which carry the same impulse: enough for a machine whose fastest time constant is half a second, at a fifth
of the cost.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from bondgraph.data.log import Log, LogChannel
from vehicle_graphs.measured_tables import FloatArray, read_table, run_importer

RECORDS = ("train", "test")
#: Samples of the published records for one of the slow logs.
EVERY = 5


def read_records(folder: Path) -> dict[str, Log]:
    """Training and held-out log of a folder by file name.

    Raises
    ------
    DataError
        If a file or column is missing or time does not increase.
    """
    logs = {}
    for record in RECORDS:
        columns = read_table(folder / f"{record}.csv.gz", ("t_s", "q_m", "u_V"))
        logs[f"{record}.csv.gz"] = record_log(record, columns["t_s"], columns["q_m"], columns["u_V"])
        logs[f"{record}_slow.csv"] = slow(logs[f"{record}.csv.gz"])
    return logs


def record_log(name: str, time: FloatArray, position: FloatArray, voltage: FloatArray) -> Log:
    """A record as a log: time [s], position [m] and output of the controller [V], each (n,)."""
    channels = {
        "voltage": LogChannel("voltage", "V", voltage),
        "position": LogChannel("position", "m", position),
    }
    return Log(name, time, channels)


def slow(log: Log) -> Log:
    """A log at a fifth of its rate, the voltage averaged until the next kept sample.

    Examples
    --------
    >>> import numpy as np
    >>> rise = LogChannel("voltage", "V", np.arange(12.0))
    >>> log = slow(Log("train", np.arange(12) / 1000, {"voltage": rise, "position": rise}))
    >>> log.channel("voltage").values.tolist(), log.channel("position").values.tolist()
    ([2.0, 7.0], [0.0, 5.0])
    """
    kept = len(log) // EVERY * EVERY
    voltage = log.channel("voltage").numbers[:kept].reshape(-1, EVERY).mean(axis=1)
    position = log.channel("position").numbers[:kept:EVERY]
    return record_log(f"{log.name}_slow", log.time[:kept:EVERY], position, voltage)


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input."""
    return run_importer(read_records, "vehicle_graphs.emps_logs", __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
