"""Typical sizes of inputs that vary, by which laws that follow them are scaled, and which of them are commands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bondgraph.data.log import MatchedLog
from bondgraph.simulate.late import given_rows
from bondgraph.simulate.model import Model
from bondgraph.simulate.quantities import InputInfo

#: An input varies whose larger values are so many times its smaller ones: a power of one that varies by less, such as
#: a temperature around, is a straight line. A convention.
_VARIED = 1.2
#: Positions of a lever or a switch at most: a gear box with seven gears, neutral and reverse. A convention.
_POSITIONS = 9


def typical_inputs(model: Model, train: Sequence[MatchedLog]) -> dict[str, float]:
    """Typical sizes of the inputs that vary in training logs: the geometric mean of what is not zero.

    Levers and switches are none (see :func:`graded_inputs`), nor are inputs of which some samples follow from others.
    """
    found, graded = {}, graded_inputs(model, train)
    for row, info in enumerate(model.inputs[known] for known in given_rows(model)):
        sizes = np.abs(np.concatenate([log.u[row] for log in train]))
        low, high = np.percentile(sizes, (10.0, 90.0))
        lever = _may_be_lever(info) and info.name not in graded
        if high > _VARIED * max(low, 0.0) and high > 0.0 and not lever and not info.rate_of:
            found[info.name] = float(np.exp(np.log(sizes[sizes > 0.0]).mean()))
    return found


def graded_inputs(model: Model, train: Sequence[MatchedLog]) -> frozenset[str]:
    """Names of the inputs without a unit, held between samples, that take more values than a lever has positions.

    A lever or a switch chooses among a few states of a machine; the travel of a valve and a duty cycle are commands.
    """
    rows = [(row, model.inputs[known]) for row, known in enumerate(given_rows(model))]
    held = [(row, info) for row, info in rows if _may_be_lever(info)]
    values = {info.name: np.unique(np.concatenate([log.u[row] for log in train])) for row, info in held}
    return frozenset(name for name, each in values.items() if each.size > _POSITIONS)


def _may_be_lever(info: InputInfo) -> bool:
    """True for an input without a unit that is held between samples."""
    return info.interpolation == "hold" and info.unit in ("", "1")
