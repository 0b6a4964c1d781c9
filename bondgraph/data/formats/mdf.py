"""ASAM MDF files, versions 3 and 4, read by asammdf."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.data.formats.table import Signal, Table, extra, merged
from bondgraph.data.header import UNKNOWN_UNIT, Reading, is_unit
from bondgraph.errors import DataError


def read_mdf(path: Path, _: Reading) -> Table:
    """Channels of an MDF file; where sensors have their own times, cells of the others stay empty.

    A channel that stands in two groups is one column where both agree, else ``name`` and ``name@group``, groups counted
    from zero as in other tools.
    """
    mdf = extra("asammdf", path, "mdf")
    kept: dict[str, Signal] = {}
    with mdf.MDF(str(path)) as file:
        for group, signal in _channels(file):
            own = _signal(signal)
            if own.header in kept and _agree(kept[own.header], own):
                continue
            labels = {header.rpartition(" [")[0] for header in kept}
            if _label(signal) in labels:
                own = Signal(_header(f"{_label(signal)}@{group}", signal.unit), own.time, own.values)
            kept[own.header] = own
    if not kept:
        raise DataError(f"{path.name}: the file has no channel with samples", where=(path.name,))
    return merged(list(kept.values()))


def _channels(file: Any) -> Iterator[tuple[int, Any]]:
    """The channels that hold samples, each with the number of its group."""
    for group in file.virtual_groups:
        places = [
            (None, index, channel)
            for index, channels in file.included_channels(group)[group].items()
            for channel in channels
        ]
        for signal in file.select(places, copy_master=True):
            if len(signal.timestamps) and np.ndim(signal.samples) == 1 and signal.samples.dtype.names is None:
                yield group, signal


def _label(signal: Any) -> str:
    """The name of a channel with parentheses for brackets, which would enclose a unit."""
    return str(signal.name).replace("[", "(").replace("]", ")")


def _header(label: str, unit: str) -> str:
    return f"{label} [{(unit or '1') if is_unit(unit or '1') else UNKNOWN_UNIT}]"


def _signal(signal: Any) -> Signal:
    times = np.asarray(signal.timestamps, dtype=np.float64)
    return Signal(_header(_label(signal), signal.unit), times, signal.samples)


def _agree(first: Signal, second: Signal) -> bool:
    """Whether two records of a signal have the same times and values."""
    return np.array_equal(first.time, second.time) and np.array_equal(first.values, second.values)
