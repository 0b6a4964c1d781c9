"""The correction of the coupled drives by forward selection, step by step.

Usage, after ``python -m vehicle_graphs.coupled_drives_logs FOLDER --out LOGS``::

    python -m vehicle_graphs.coupled_drives_chain LOGS
    python -m vehicle_graphs.coupled_drives_chain LOGS --executor processes --out kept

The second fits on all cores and goes on where it stopped.
Prints after every step the error of free simulation (pulses per second) on both training records, on each of them when
only the other one was fitted, and on the two held-out parts, with the effects that were tried and rejected.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from bondgraph.data.log import Log
from bondgraph.data.read import read_log
from vehicle_graphs import coupled_drives
from vehicle_graphs.correction_chain import Machine, chain_command
from vehicle_graphs.coupled_drives_logs import RECORDS

MACHINE = Machine(coupled_drives.declared, tuple(coupled_drives.EFFECTS), coupled_drives.possible)


def read_parts(folder: Path) -> tuple[list[Log], list[Log]]:
    """Training parts of the records, and held-out ones."""
    train, test = ([read_log(folder / f"{name}_{part}.csv") for name in RECORDS] for part in ("train", "test"))
    return train, test


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input, 130 when interrupted."""
    return chain_command("coupled_drives_chain", __doc__, MACHINE, read_parts, arguments)


if __name__ == "__main__":
    sys.exit(main())
