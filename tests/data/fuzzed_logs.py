"""Logs of every format with bytes spoiled at random."""

from __future__ import annotations

import functools
import gzip
import io
import random
import tempfile
from pathlib import Path

import numpy as np
import scipy.io

from bondgraph.data.log import Log, LogChannel
from bondgraph.data.read import read_log
from bondgraph.data.write import csv_text, write_log

FORMATS = (".csv", ".csv.gz", ".mat", ".v73.mat", ".parquet", ".mf4")
_CELLS = (
    b"", b"nan", b"inf", b"-inf", b"1e999", b"\x00", b"a,b", b'"', b"x" * 5000, b"9" * 400, b"1_0", "٣".encode(), b"\r",
    b"[rpm]", b"time [s]", b"9**9**9**9", b"[9**9**9**9]", b"[degC**2/dB]", b"\xff\xfe", b"true", b"0x10", b";",
)  # fmt: skip


def log(rows: int = 60) -> Log:
    """A log with numbers, gaps and codes."""
    time = np.arange(rows) * 0.1
    speed = np.where(np.arange(rows) % 7 == 3, np.nan, np.sin(time))
    gear = np.array(["H", "", "L"] * (rows // 3), dtype=np.str_)
    channels = (LogChannel("speed", "rpm", speed), LogChannel("gear", "text", gear), LogChannel("u", "V", time))
    return Log("run", time, {channel.name: channel for channel in channels})


@functools.cache
def content(kind: str) -> bytes:
    """The bytes of a valid file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"run{kind}"
        writer = {".mat": _write_mat, ".v73.mat": _write_mat73, ".mf4": _write_mdf}.get(kind)
        writer(path) if writer else write_log(path, log())
        return path.read_bytes()


def _columns() -> dict[str, np.ndarray]:
    return {"time": log().time, "speed": log().channel("speed").values, "u": log().channel("u").values}


def _write_mat(path: Path) -> None:
    gear = np.array(log().channel("gear").values, dtype=object)
    units = {"time": "s", "speed": "rpm", "u": "V", "gear": "text"}
    scipy.io.savemat(path, {**_columns(), "gear": gear, "units": units}, do_compression=True)


def _write_mat73(path: Path) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in _columns().items():
            file.create_dataset(name, data=values[np.newaxis], compression="gzip")
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        for name, unit in {"time": "s", "speed": "rpm", "u": "V"}.items():
            file[f"units/{name}"] = np.array([[ord(letter)] for letter in unit], dtype=np.uint16)
            file[f"units/{name}"].attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(116) + b" " * 8 + b"\x00\x02IM")


def _write_mdf(path: Path) -> None:
    import asammdf

    with asammdf.MDF(version="4.10") as file:
        for name, values in list(_columns().items())[1:]:
            file.append([asammdf.Signal(values, log().time, unit="V", name=name)])
        file.save(path)


def spoiled(kind: str, draw: random.Random) -> tuple[str, bytes]:
    """The kind of a file, and its bytes changed in some places."""
    raw = bytearray(content(kind))
    if kind == ".csv.gz" and draw.random() < 0.5:  # the text inside, then packed again
        return kind, gzip.compress(_changed(bytearray(csv_text(log()).encode()), draw, text=True))
    return kind, _changed(raw, draw, text=kind == ".csv")


def _changed(raw: bytearray, draw: random.Random, text: bool) -> bytes:
    for _ in range(draw.choice((1, 1, 2, 5, 40))):
        place, size = draw.randrange(len(raw) or 1), draw.choice((1, 1, 4, 8, 64))
        how = draw.randrange(8)
        if how == 0:
            del raw[place:]
        elif how == 1:
            del raw[place : place + size]
        elif how == 2:
            raw[place : place + size] = draw.randbytes(size)
        elif how == 3:
            raw[place:place] = raw[place : place + size] * draw.choice((1, 2, 50))
        elif how == 4:
            raw[place : place + size] = draw.choice((b"\x00", b"\xff", b"\x7f")) * size
        elif how == 5 and text:
            cells = bytes(raw).split(b",")
            cells[draw.randrange(len(cells))] = draw.choice(_CELLS)
            raw = bytearray(b",".join(cells))
        elif raw:
            raw[place % len(raw)] ^= 1 << draw.randrange(8)
    return bytes(raw)


def read(given: tuple[str, bytes]) -> None:
    """Read a file with these bytes."""
    kind, raw = given
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"run{kind}"
        path.write_bytes(raw)
        found = read_log(path)
    assert found.time.size == len(found)
    assert all(channel.values.shape == found.time.shape for channel in found.channels.values())


def gzip_bomb(size: int) -> bytes:
    """A small file of zeros that is large when unpacked."""
    packed = io.BytesIO()
    with gzip.open(packed, "wb") as file:
        for _ in range(size >> 20):
            file.write(bytes(1 << 20))
    return packed.getvalue()
