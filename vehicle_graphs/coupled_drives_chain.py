"""The correction of the coupled drives by forward selection, step by step.

Usage, after ``python -m vehicle_graphs.coupled_drives_logs FOLDER --out LOGS``::

    python -m vehicle_graphs.coupled_drives_chain LOGS

Prints after every step the error of free simulation (pulses per second) on both training records, on each of them when
only the other one was fitted, and on the two held-out parts, with the effects that were tried and rejected.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from bondgraph.data.read import read_log
from bondgraph.errors import BondGraphError
from vehicle_graphs import coupled_drives
from vehicle_graphs.correction_chain import Machine, forward_selection, table
from vehicle_graphs.coupled_drives_logs import RECORDS

MACHINE = Machine(coupled_drives.declared, tuple(coupled_drives.EFFECTS), coupled_drives.possible)


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input."""
    parser = argparse.ArgumentParser(
        prog="python -m vehicle_graphs.coupled_drives_chain", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("logs", type=Path, help="folder written by vehicle_graphs.coupled_drives_logs")
    options = parser.parse_args(arguments)
    try:
        train, test = (
            [read_log(options.logs / f"{name}_{part}.csv") for name in RECORDS] for part in ("train", "test")
        )
        steps = forward_selection(MACHINE, train, test, lambda step: print(table([step]), flush=True))
    except BondGraphError as error:
        print(error, file=sys.stderr)
        return 2
    print("the chain, with what was tried after its last step:")
    print(table(steps))
    return 0


if __name__ == "__main__":
    sys.exit(main())
