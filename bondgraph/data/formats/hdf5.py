"""HDF5 files, read by h5py: data sets with their units as attributes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.data.formats.table import Signal, Table, check_size, extra, merged
from bondgraph.data.header import UNKNOWN_UNIT, Reading, convert_unit, is_unit
from bondgraph.errors import DataError

#: Attributes under which programs write the unit of a data set.
_UNITS = ("unit", "units", "Unit", "Units")


def read_hdf5(path: Path, reading: Reading) -> Table:
    """Vectors of an HDF5 file: in each group the data set ``time`` and others of its length, or a table with fields.

    Columns of groups are called ``group.signal`` where there are several. A data set without a unit may be read, and
    needs one when a model uses it.

    Raises
    ------
    DataError
        If no group holds a time with a unit.
    """
    h5py = extra("h5py", path, "hdf5")
    wanted = reading.time or "time"
    with h5py.File(path, "r") as file:
        groups: dict[str, dict[str, tuple[Any, str]]] = {}

        def visit(name: str, node: Any) -> None:
            if not isinstance(node, h5py.Dataset) or node.ndim != 1:
                return
            check_size(node.size * node.dtype.itemsize, path)
            if node.dtype.names:
                groups[name] = {field: (node[field], "") for field in node.dtype.names}
            else:
                group, _, label = name.rpartition("/")
                groups.setdefault(group, {})[label] = (_values(node), _unit(node))

        file.visititems(visit)
    timed = {name: group for name, group in groups.items() if wanted in group}
    if not timed:
        found = sorted(f"{name}/{label}".lstrip("/") for name, group in groups.items() for label in group)
        raise DataError(
            f"{path.name}: no data set is called {wanted!r} - name the one with the time with --time; there are "
            f"{', '.join(found) or 'none that are vectors'}",
            where=(path.name, wanted),
        )
    several = len(timed) > 1
    signals = []
    for name, group in timed.items():
        time = _seconds(*group.pop(wanted), reading, path.name)
        prefix = f"{name.replace('/', '.')}." if several else ""
        signals += [
            Signal(f"{prefix}{label} [{unit if unit and is_unit(unit) else UNKNOWN_UNIT}]", time, values)
            for label, (values, unit) in group.items()
            if len(values) == len(time)
        ]
    if not signals:
        raise DataError(f"{path.name}: no data set has as many values as times", where=(path.name,))
    return merged(signals)


def _values(node: Any) -> np.ndarray[Any, Any]:
    values = node.asstr()[()] if node.dtype.kind in "OS" else node[()]
    return np.asarray(values)


def _unit(node: Any) -> str:
    written = next((node.attrs[name] for name in _UNITS if name in node.attrs), "")
    return written.decode() if isinstance(written, bytes) else str(written)


def _seconds(values: Any, unit: str, reading: Reading, where: str) -> np.ndarray[Any, Any]:
    given = reading.unit(reading.time or "time", is_time=True) or unit
    if not given:
        raise DataError(
            f"{where}: data set 'time' has no attribute 'unit' - give --units time=s, or write it into the file",
            where=(where, "time"),
        )
    factor, offset = convert_unit("time", given, "s", where)
    return np.asarray(values, dtype=np.float64) * factor + offset
