"""The correction of the Baja car's power balance by forward selection, step by step.

Usage, after ``python -m vehicle_graphs.baja_logs FOLDER --out LOGS``::

    python -m vehicle_graphs.baja_chain LOGS
    python -m vehicle_graphs.baja_chain LOGS --executor processes --out kept

The second fits on all cores and goes on where it stopped.
The choice is by errors on launches that a fit has not seen, among the effects of ``baja.EFFECTS``; ``bondgraph
close-loop`` tries all effects everywhere and decides by the likelihood. Prints after every step the error of free
simulation [rad/s] of the wheel speed on the training launches, on each of them when only the others were fitted, and on
the held-out launches, with the effects that were tried and rejected.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from bondgraph.data.log import Log
from bondgraph.data.read import read_log
from vehicle_graphs import baja
from vehicle_graphs.correction_chain import Machine, chain_command

#: Runs for training and held out: every tune is in training, or one of its neighbours is.
TRAINING, HELD_OUT = (1, 4, 5, 8, 11), (2, 6, 9, 13)
MACHINE = Machine(baja.declared, tuple(baja.EFFECTS))


def read_launches(folder: Path) -> tuple[list[Log], list[Log]]:
    """Launches for training, and held out."""
    train, test = ([read_log(folder / f"run{number}.csv") for number in runs] for runs in (TRAINING, HELD_OUT))
    return train, test


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input, 130 when interrupted."""
    return chain_command("baja_chain", __doc__, MACHINE, read_launches, arguments)


if __name__ == "__main__":
    sys.exit(main())
