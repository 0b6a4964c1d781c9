"""Convert the published Silverbox record to logs.

Usage: ``python -m vehicle_graphs.silverbox_logs FOLDER --out DIR``.

FOLDER holds ``snls80mv.csv.gz``: columns ``V1, V2`` at 1e7/2^14 Hz, as published. The usual split: the *arrow head*,
noise whose amplitude grows, is the test (``arrow.csv.gz``); of the ten multisines that follow the first nine are for
training (``multisine_1.csv.gz`` to ``multisine_9.csv.gz``) and the last validates (``multisine_10.csv.gz``). The logs
have the columns ``force`` (V1) and ``displacement`` (V2), a volt as a newton and as a metre. The zero of each channel,
its mean over the quiet samples at the start, is taken off. ``training.csv.gz`` is the beginning of the first multisine,
short enough for a closed loop within minutes.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bondgraph.data.log import Log, LogChannel
from bondgraph.errors import DataError
from vehicle_graphs.measured_tables import FloatArray, read_table, run_importer

#: Sampling rate of the record [Hz].
RATE = 1e7 / 2**14
#: Samples before the first signal, and the arrow head's.
QUIET, ARROW = 100, (0, 40_495)
#: First sample of the multisines, samples of each with the quiet part after it, and how many there are.
FIRST, EACH, COUNT = 40_600, 8_700, 10
#: Samples of the short training log, some seven seconds.
SHORT = 4_096


def read_records(folder: Path) -> dict[str, Log]:
    """The parts of the record by file name.

    Raises
    ------
    DataError
        If the file or a column is missing, or the record is shorter than the published one.
    """
    columns = read_table(folder / "snls80mv.csv.gz", ("V1", "V2"))
    force, shown = (columns[name] - columns[name][:QUIET].mean() for name in ("V1", "V2"))
    if force.size < FIRST + COUNT * EACH:
        raise DataError(
            f"snls80mv.csv.gz: {force.size} samples, the published record has {FIRST + COUNT * EACH} and more - fetch "
            "it whole"
        )
    parts = {f"multisine_{k + 1}": (FIRST + k * EACH, FIRST + (k + 1) * EACH) for k in range(COUNT)}
    parts |= {"arrow": ARROW, "training": (FIRST, FIRST + SHORT)}
    return {f"{name}.csv.gz": part_log(name, force[slice(*part)], shown[slice(*part)]) for name, part in parts.items()}


def part_log(name: str, force: FloatArray, displacement: FloatArray) -> Log:
    """A part of the record as a log: force [V as N] and displacement [V as m], each (n,).

    Examples
    --------
    >>> bool(part_log("arrow", np.zeros(3), np.zeros(3)).time[1] == 1 / RATE)
    True
    """
    channels = {
        "force": LogChannel("force", "N", force),
        "displacement": LogChannel("displacement", "m", displacement),
    }
    return Log(name, np.arange(force.size) / RATE, channels)


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input."""
    return run_importer(read_records, "vehicle_graphs.silverbox_logs", __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
