"""Typical sizes of inputs that vary: what a law that follows one of them is scaled by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.simulate.late import given_rows
from bondgraph.simulate.model import Model

#: An input varies whose larger values are so many times its smaller ones: a power of one that varies by less, such as
#: a temperature around, is a straight line. A convention.
_VARIED = 1.2


def typical_inputs(model: Model, train: Sequence[MatchedLog]) -> dict[str, float]:
    """Typical sizes of the inputs that vary in training logs: the geometric mean of what is not zero.

    Levers and switches, without a unit and held between samples, are none, nor are inputs of which some samples follow
    from others.
    """
    found = {}
    for row, info in enumerate(model.inputs[known] for known in given_rows(model)):
        sizes = np.abs(np.concatenate([log.u[row] for log in train]))
        low, high = np.percentile(sizes, (10.0, 90.0))
        lever = info.interpolation == "hold" and info.unit in ("", "1")
        if high > _VARIED * max(low, 0.0) and high > 0.0 and not lever and not info.rate_of:
            found[info.name] = float(np.exp(np.log(sizes[sizes > 0.0]).mean()))
    return found
