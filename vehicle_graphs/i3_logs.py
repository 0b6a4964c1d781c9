"""Convert the BMW i3 road trips to logs, one per trip.

Usage: ``python -m vehicle_graphs.i3_logs FOLDER --out DIR``.

FOLDER holds ``trips.csv.gz`` (all trips one below the other at 10 Hz: ``trip, t_s, v_kmh, elevation_m,
motor_torque_Nm, ax_mps2, ambient_C, throttle_pct``). The trips have no published split; here those whose number is a
multiple of four, in both seasons, are held out: ``train_<trip>.csv.gz`` and ``test_<trip>.csv.gz``.

What is done to the data, and why:

- Stretches longer than ``LONGEST_LINE`` in which speed, torque and acceleration all run along straight lines while
  the car moves are a gap of the recording that was filled afterwards; the trip is cut there, and the parts become
  logs of their own.
- The map's elevation comes in steps of a metre: it is smoothed over ``MAP_WINDOW`` of distance before its slope is
  taken.
- Nothing else is smoothed or filled.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from bondgraph.data.log import Log, LogChannel
from bondgraph.errors import DataError
from vehicle_graphs.measured_tables import FloatArray, read_table, run_importer

COLUMNS = ("t_s", "v_kmh", "elevation_m", "motor_torque_Nm", "ax_mps2", "ambient_C", "throttle_pct")
#: Longest stretch of straight lines that is taken as driving [s].
LONGEST_LINE = 2.5
#: Steps in which the channels were recorded; interpolated values lie within two of them of a line.
STEPS = {"v_kmh": 0.01, "motor_torque_Nm": 0.01, "ax_mps2": 0.01}
#: Length over which the map's elevation is smoothed, and step in which it is worked out [m].
MAP_WINDOW, MAP_STEP = 150.0, 10.0
#: Shortest part of a trip that becomes a log [s].
SHORTEST_PART = 60.0


def read_trips(folder: Path) -> dict[str, Log]:
    """Logs of all trips of a folder by file name.

    Raises
    ------
    DataError
        If the file or a column is missing, or a trip's name does not end in its number.
    """
    columns = read_table(folder / "trips.csv.gz", COLUMNS, ("trip",))
    names, first = np.unique(columns["trip"], return_index=True)
    logs: dict[str, Log] = {}
    for name in names[np.argsort(first)]:
        rows = columns["trip"] == name
        trip = {column: columns[column][rows] for column in COLUMNS}
        part = "test" if number(str(name)) % 4 == 0 else "train"
        for log in trip_logs(str(name), trip):
            logs[f"{part}_{log.name}.csv.gz"] = log
    return logs


def number(trip: str) -> int:
    """The number of a trip.

    Raises
    ------
    DataError
        If its name has none.

    Examples
    --------
    >>> number("B07")
    7
    """
    digits = trip.lstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    if not digits.isdigit():
        raise DataError(f"trips.csv.gz: trip {trip!r} - a letter for the season and a number are needed", (trip,))
    return int(digits)


def trip_logs(name: str, trip: Mapping[str, FloatArray]) -> list[Log]:
    """The parts of a trip between its filled gaps, as logs; ``trip`` holds the columns ``COLUMNS``."""
    cut = filled(trip)
    edges = np.flatnonzero(np.diff(np.concatenate([[1], cut.astype(int), [1]])))
    parts = [slice(first, last) for first, last in zip(edges[::2], edges[1::2], strict=True)]
    time, kelvin = trip["t_s"], 273.15
    parts = [part for part in parts if time[part][-1] - time[part][0] >= SHORTEST_PART]
    grade = sine_of_grade(time, trip["v_kmh"] / 3.6, trip["elevation_m"])
    logs = []
    for count, part in enumerate(parts, start=1):
        signals = {
            "motor_torque": ("N m", trip["motor_torque_Nm"]),
            "sin_grade": ("1", grade),
            "ambient": ("K", trip["ambient_C"] + kelvin),
            "pedal": ("1", trip["throttle_pct"] / 100.0),
            "speed": ("km/h", trip["v_kmh"]),
            "acceleration": ("m/s^2", trip["ax_mps2"]),
        }
        channels = {key: LogChannel(key, unit, values[part]) for key, (unit, values) in signals.items()}
        logs.append(Log(name if len(parts) == 1 else f"{name}_{count}", time[part], channels))
    return logs


def filled(trip: Mapping[str, FloatArray]) -> np.ndarray:
    """Which samples lie in a gap that was filled by straight lines, shape (n,).

    Examples
    --------
    >>> line = np.linspace(0.0, 30.0, 100)
    >>> trip = {"t_s": np.arange(100) / 10, "v_kmh": line, "motor_torque_Nm": line, "ax_mps2": line}
    >>> int(filled(trip).sum())
    100
    """
    time = trip["t_s"]
    straight = np.ones(max(time.size - 2, 0), dtype=bool)
    for column, step in STEPS.items():
        straight &= np.abs(np.diff(trip[column], 2)) <= 2.05 * step
    inside = np.concatenate([[False], straight, [False]])
    edges = np.flatnonzero(np.diff(inside.astype(int)))
    cut = np.zeros(time.size, dtype=bool)
    for before, last in zip(edges[::2], edges[1::2], strict=True):
        stretch = slice(before, last + 2)
        if time[last] - time[before] > LONGEST_LINE and np.ptp(trip["v_kmh"][stretch]) > 1.0:
            cut[stretch] = True
    return cut


def sine_of_grade(time: FloatArray, speed: FloatArray, elevation: FloatArray) -> FloatArray:
    """Sine of the road's inclination at each sample, from elevation [m] over the distance driven at ``speed`` [m/s].

    Examples
    --------
    >>> time = np.arange(0.0, 100.0, 0.1)
    >>> speed = np.full(1000, 20.0)
    >>> bool(abs(sine_of_grade(time, speed, np.floor(0.05 * 20.0 * time))[500] - 0.05) < 0.003)
    True
    """
    distance = np.concatenate([[0.0], np.cumsum(np.diff(time) * (speed[1:] + speed[:-1]) / 2)])
    if distance[-1] < 2 * MAP_STEP:
        return np.zeros(time.size)
    moved, kept = np.unique(distance, return_index=True)
    along = np.arange(0.0, distance[-1], MAP_STEP)
    height = np.interp(along, moved, elevation[kept])
    half = round(MAP_WINDOW / MAP_STEP)
    weights = np.hanning(2 * half + 1)
    smooth = (
        np.convolve(np.pad(height, half, mode="reflect", reflect_type="odd"), weights / weights.sum(), "valid")
        if height.size > half
        else height
    )
    sine: FloatArray = np.interp(distance, along, np.clip(np.gradient(smooth, MAP_STEP), -0.2, 0.2))
    return sine


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; 0 when done, 2 with a message for bad input."""
    return run_importer(read_trips, "vehicle_graphs.i3_logs", __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
