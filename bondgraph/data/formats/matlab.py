"""MATLAB files: vectors beside a struct ``units``, or structs that hold them; v7.3 read by pymatreader."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.data.formats.table import Signal, Table, extra, merged
from bondgraph.data.header import Reading, convert_unit
from bondgraph.errors import DataError

#: Names under which structs of single signals hold values and units.
_VALUES, _UNITS = ("values", "data", "value"), ("unit", "units")


def read_mat(path: Path, reading: Reading) -> Table:
    """Variables of a MATLAB file.

    Either ``time``, one vector per signal, and ``units``, a struct of texts with the same names, or structs of these:
    one that holds all, one per group of signals with a ``time`` each (columns ``group.signal``), one per signal
    (``run.speed.values``, ``run.speed.unit``), or what Simulink writes as a structure with time.

    Raises
    ------
    DataError
        If there is no time, a unit is missing, or a variable is no vector.
    """
    variables = _variables(path)
    units = variables.pop("units", None)
    known = units if isinstance(units, dict) else None
    groups = [_Group(path, name, node, known, reading) for name, node in _with_time(variables, "", reading)]
    if not groups:
        if known is None and not reading.units:
            raise _no_units(path)
        raise DataError(
            f"{path.name}: variable 'time' is missing - name the one with the time with --time",
            where=(path.name, "time"),
        )
    if len(groups) == 1:
        return groups[0].table()
    return merged([signal for group in groups for signal in group.signals()])


def _variables(path: Path) -> dict[str, Any]:
    """The content of the file; structs are dictionaries, cell arrays of text are lists or arrays."""
    try:
        from scipy.io import loadmat  # loads sparse matrices, which no other format needs

        content: dict[str, Any] = loadmat(str(path), simplify_cells=True)
    except NotImplementedError:  # scipy's way to say that the file is v7.3, which is HDF5
        content = _in_order(extra("pymatreader", path, "matlab").read_mat(str(path)))
    except ValueError as error:
        raise DataError(f"{path.name}: this is not a readable MATLAB file ({error})", where=(path.name,)) from None
    return {name: value for name, value in content.items() if not name.startswith(("__", "#"))}


def _in_order(content: Any) -> Any:
    """Structs with their fields by name, in which order HDF5 keeps them and the library does not."""
    return {name: _in_order(content[name]) for name in sorted(content)} if isinstance(content, dict) else content


def _with_time(node: Mapping[str, Any], name: str, reading: Reading) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """The structs, the file itself among them, that hold a time."""
    if (reading.time or "time") in node:
        yield name, node
        return
    for key, value in node.items():
        if isinstance(value, dict):
            yield from _with_time(value, f"{name}.{key}" if name else key, reading)


def _no_units(path: Path) -> DataError:
    return DataError(
        f"{path.name}: variable 'units' is missing - save a struct with one unit per signal, such as "
        "units.engine_speed = 'rad/s', or give --units",
        where=(path.name, "units"),
    )


class _Group:
    """Signals that share a time."""

    def __init__(
        self, path: Path, name: str, node: Mapping[str, Any], units: Mapping[str, Any] | None, reading: Reading
    ) -> None:
        self._path, self._name, self._reading = path, name, reading
        own = node.get("units")
        within = units.get(name) if units and name else None
        self._units = next((one for one in (own, within, units) if isinstance(one, dict)), None)
        self._time_name = reading.time or "time"
        self._own_units: dict[str, str] = {}
        self._values = self._read(node)

    def _read(self, node: Mapping[str, Any]) -> dict[str, Any]:
        """Vectors by name, that of the time first."""
        values: dict[str, Any] = {self._time_name: node[self._time_name]}
        if "signals" in node and not isinstance(node["signals"], np.ndarray | str):  # as Simulink writes it
            self._own_units[self._time_name] = "s"
            listed = node["signals"] if isinstance(node["signals"], list) else [node["signals"]]
            for number, signal in enumerate(listed, start=1):
                values[str(signal.get("label") or f"signal{number}")] = signal["values"]
            return values
        for key, value in node.items():
            if key in (self._time_name, "units"):
                continue
            if isinstance(value, dict) and (inner := next((one for one in _VALUES if one in value), None)):
                values[key] = value[inner]
                unit = next((value[one] for one in _UNITS if one in value), None)
                if unit is not None:
                    self._own_units[key] = str(unit) if np.size(unit) else "1"
            elif not self._name or np.size(value) == np.size(values[self._time_name]):
                values[key] = value  # in a struct others are remarks: a date, a driver
        return values

    def _headers(self, several: bool) -> dict[str, str]:
        """Headers by name; without unit where the reading gives it."""
        if self._units is None and not self._own_units and not self._reading.units:
            raise _no_units(self._path)
        found = {}
        for name in self._values:
            label = f"{self._name}.{name}" if several else name
            unit = self._own_units.get(name) or (None if self._units is None else self._units.get(name))
            if unit is None and self._reading.unit(label, name == self._time_name) is None and self._units is not None:
                raise DataError(
                    f"{self._path.name}: struct 'units' has no field {name!r}", where=(self._path.name, name)
                )
            found[name] = label if unit is None else f"{label} [{unit}]"
        return found

    def table(self) -> Table:
        """The group as a table."""
        headers = self._headers(several=False)
        return Table(tuple((headers[name], values) for name, values in self._vectors().items()))

    def signals(self) -> list[Signal]:
        """The signals of one group among several, with their times in seconds."""
        headers, vectors = self._headers(several=bool(self._name)), self._vectors()
        time = vectors.pop(self._time_name)
        _, bracket, unit = headers[self._time_name].rstrip("]").partition(" [")
        given = self._reading.unit(self._time_name, is_time=True) or (unit if bracket else "")
        factor, offset = convert_unit("time", given, "s", self._path.name)
        seconds = np.asarray(time, dtype=np.float64) * factor + offset
        return [Signal(headers[name], seconds, values) for name, values in vectors.items()]

    def _vectors(self) -> dict[str, Any]:
        columns = {}
        for name, value in self._values.items():
            column = None if isinstance(value, str | dict) else _column(value)
            if column is None or column.ndim != 1:
                raise DataError(
                    f"{self._path.name}: variable {name!r} is no vector - save one value for each time, and nothing "
                    "else",
                    where=(self._path.name, name),
                )
            columns[name] = column
        length = len(columns[self._time_name])
        for name, column in columns.items():
            if len(column) != length:
                raise DataError(
                    f"{self._path.name}: variable {name!r} has {len(column)} values for {length} times",
                    where=(self._path.name, name),
                )
        return columns


def _column(value: Any) -> np.ndarray[Any, Any]:
    """Numbers, or the texts of a cell array, in which an empty text arrives as nothing."""
    if isinstance(value, list) or getattr(value, "dtype", np.dtype(float)).kind == "O":
        return np.array([str(cell) if np.size(cell) else "" for cell in value], dtype=np.str_)
    return np.atleast_1d(value)
