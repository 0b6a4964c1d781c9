"""Convert the Terps TR24 launch recordings to logs, one per run.

Usage: ``python -m vehicle_graphs.baja_logs FOLDER --out DIR``.

FOLDER holds ``runs_100hz.csv.gz`` (all runs, one below the other, time from the throttle hit) and ``runs.csv`` (one row
per run: tune, idle speed, time of lift-off). Every run becomes ``run<number>.csv`` with the columns ``throttle``,
``engine_speed``, ``wheel_speed`` and the tune under the names of the parameters of ``vehicle_graphs.baja``.

What is done to the data, and why:

- From the throttle hit (t = 0) to lift-off: throttle and brake were not recorded; full throttle is known only there.
- Every second row: the sensors deliver 50 values a second, which the file holds interpolated on a grid of 100.
- Engine speeds more than two counts (2 x 60 rpm) below idle are dropouts of the sensor: the throttle is open. They and
  their neighbours on the fine grid, which were interpolated from them, become empty cells.
- Nothing is smoothed or filled; the counts of 60 rpm stay.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import io
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bondgraph.data.log import Log, LogChannel
from bondgraph.data.write import write_log
from bondgraph.errors import BondGraphError, DataError, suggest

#: Columns of a table by name, as text.
Table = Mapping[str, Sequence[str]]

#: Resolution of the recorded engine speed.
ENGINE_COUNT_RPM = 60.0

#: Column of ``runs.csv`` -> parameter of the model and unit.
TUNE = {
    "primary_spring_N_per_m": ("primary_spring_rate", "N/m"),
    "flyweights_kg": ("flyweight_mass", "kg"),
    "secondary_spring_N_per_m": ("secondary_spring_rate", "N/m"),
    "torsion_spring_Nm_per_rad": ("torsion_spring_rate", "N m/rad"),
    "pretension_deg": ("torsion_spring_pretension", "deg"),
    "helix_deg": ("helix_angle", "deg"),
}
_RUN_COLUMNS = ("run", "duration_s", "idle_rpm", *TUNE)
_SAMPLE_COLUMNS = ("run", "t_s", "engine_rpm", "wheel_rpm")


def read_launches(folder: str | Path) -> tuple[Log, ...]:
    """The launches of a folder as logs, in the order of ``runs.csv``.

    Raises
    ------
    DataError
        If a file or column is missing, a run has no samples or no usable number.
    """
    folder = Path(folder)
    runs = _table(folder / "runs.csv", _RUN_COLUMNS)
    samples = _table(folder / "runs_100hz.csv.gz", _SAMPLE_COLUMNS)
    owner = np.array(samples["run"])
    columns = {name: _numbers(samples[name], name) for name in _SAMPLE_COLUMNS[1:]}
    logs = []
    for row, run in enumerate(runs["run"]):
        facts = {name: _number(runs[name][row], name, run) for name in _RUN_COLUMNS}
        logs.append(launch_log(f"run{run}", {name: column[owner == run] for name, column in columns.items()}, facts))
    return tuple(logs)


def launch_log(name: str, samples: Mapping[str, npt.NDArray[np.float64]], facts: Mapping[str, float]) -> Log:
    """One launch as a log.

    Parameters
    ----------
    name
        Name of the log.
    samples
        Columns ``t_s`` [s], ``engine_rpm`` and ``wheel_rpm`` on the fine grid.
    facts
        ``duration_s``, ``idle_rpm`` and the tune, as in ``runs.csv``.

    Raises
    ------
    DataError
        If nothing was sampled between throttle hit and lift-off.

    Examples
    --------
    >>> grid = {"t_s": [0.0, 0.01, 0.02], "engine_rpm": [2040.0, 2070, 2100], "wheel_rpm": [0.0, 0, 1]}
    >>> grid = {name: np.array(values) for name, values in grid.items()}
    >>> facts = {"duration_s": 5.0, "idle_rpm": 2040.0} | dict.fromkeys(TUNE, 1.0)
    >>> launch_log("run1", grid, facts).channel("engine_speed").values.tolist()
    [2040.0, 2100.0]
    """
    time, wheel = samples["t_s"], samples["wheel_rpm"]
    engine = without_dropouts(samples["engine_rpm"], time, facts["idle_rpm"])
    chosen = np.flatnonzero((time >= 0) & (time <= facts["duration_s"]))[::2]
    if chosen.size == 0:
        raise DataError(
            f"{name}: no samples between the throttle hit (0 s) and lift-off ({facts['duration_s']:g} s) - check t_s",
            where=(name, "t_s"),
        )
    signals = {
        "throttle": LogChannel("throttle", "1", np.ones(chosen.size)),
        "engine_speed": LogChannel("engine_speed", "rpm", engine[chosen]),
        "wheel_speed": LogChannel("wheel_speed", "rpm", wheel[chosen]),
    }
    tune = {
        parameter: LogChannel(parameter, unit, np.full(chosen.size, facts[column]))
        for column, (parameter, unit) in TUNE.items()
    }
    return Log(name, time[chosen], signals | tune)


def without_dropouts(
    engine_rpm: npt.NDArray[np.float64], time: npt.NDArray[np.float64], idle_rpm: float
) -> npt.NDArray[np.float64]:
    """Engine speed [rpm] with dropouts after the throttle hit, and the samples beside them, made NaN; shape (n,).

    Examples
    --------
    >>> without_dropouts(np.array([2040.0, 2100, 1200, 2160, 2200]), np.arange(5) / 100, 2040.0).tolist()
    [2040.0, nan, nan, nan, 2200.0]
    """
    low = (engine_rpm < idle_rpm - 2 * ENGINE_COUNT_RPM) & (time >= 0)
    beside = low.copy()
    beside[1:] |= low[:-1]
    beside[:-1] |= low[1:]
    return np.where(beside, np.nan, engine_rpm)


def write_launches(folder: str | Path, out: str | Path) -> tuple[Path, ...]:
    """Write every launch of ``folder`` as ``out/<name>.csv``; the files written, in the order of ``runs.csv``."""
    logs = read_launches(folder)
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    return tuple(write_log(out / f"{log.name}.csv", log) for log in logs)


def _table(path: Path, needed: Sequence[str]) -> Table:
    if not path.is_file():
        raise DataError(f"{path.name}: not found in {path.parent} - give the folder of the recordings", (str(path),))
    raw = path.read_bytes()
    rows = list(csv.reader(io.StringIO((gzip.decompress(raw) if path.suffix == ".gz" else raw).decode("utf-8"))))
    header, body = (rows[0], [row for row in rows[1:] if row]) if rows else ([], [])
    for name in needed:
        if name not in header:
            raise DataError(f"{path.name}: no column {name!r}{suggest(name, header)}", where=(path.name, name))
    uneven = next((line for line, row in enumerate(body, start=2) if len(row) != len(header)), None)
    if uneven is not None:
        raise DataError(f"{path.name}: row {uneven} does not have {len(header)} cells", where=(path.name,))
    return {name: [row[header.index(name)].strip() for row in body] for name in needed}


def _numbers(cells: Sequence[str], column: str) -> npt.NDArray[np.float64]:
    """A column of samples; an empty cell is a missing measurement."""
    values = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells):
        if cell:
            try:
                values[row] = float(cell)
            except ValueError:
                raise DataError(
                    f"runs_100hz.csv.gz: row {row + 2}: {column} is {cell!r} - a number is needed", where=(column,)
                ) from None
    return values


def _number(cell: str, column: str, run: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        number = float("nan")
    if not np.isfinite(number):
        raise DataError(
            f"runs.csv: run {run}: {column} is {cell!r} - a number is needed", where=("runs.csv", run, column)
        )
    return number


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input."""
    parser = argparse.ArgumentParser(
        prog="python -m vehicle_graphs.baja_logs", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("folder", type=Path, help="folder with runs_100hz.csv.gz and runs.csv")
    parser.add_argument("--out", type=Path, required=True, help="folder for the logs, made if absent")
    options = parser.parse_args(arguments)
    try:
        written = write_launches(options.folder, options.out)
    except BondGraphError as error:
        print(error, file=sys.stderr)
        return 2
    for path in written:
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
