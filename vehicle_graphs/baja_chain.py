"""The correction of the Baja car's power balance by forward selection, step by step.

Usage, after ``python -m vehicle_graphs.baja_logs FOLDER --out LOGS``::

    python -m vehicle_graphs.baja_chain LOGS

The choice is by errors on launches that a fit has not seen, among the effects of ``baja.EFFECTS``; ``bondgraph
close-loop`` tries all effects everywhere and decides by the likelihood. Prints after every step the error of free
simulation [rad/s] of the wheel speed on the training launches, on each of them when only the others were fitted, and on
the held-out launches, with the effects that were tried and rejected.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from bondgraph.data.read import read_log
from bondgraph.errors import BondGraphError
from vehicle_graphs import baja
from vehicle_graphs.correction_chain import Machine, forward_selection, table

#: Runs for training and held out: every tune is in training, or one of its neighbours is.
TRAINING, HELD_OUT = (1, 4, 5, 8, 11), (2, 6, 9, 13)
MACHINE = Machine(baja.declared, tuple(baja.EFFECTS))


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input."""
    parser = argparse.ArgumentParser(
        prog="python -m vehicle_graphs.baja_chain", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("logs", type=Path, help="folder written by vehicle_graphs.baja_logs")
    options = parser.parse_args(arguments)
    try:
        train, test = (
            [read_log(options.logs / f"run{number}.csv") for number in runs] for runs in (TRAINING, HELD_OUT)
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
