"""Reads MATLAB, MDF and HDF5 files in a process of its own: their libraries may end it, or hang, at a damaged file."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.data.formats.hdf5 import read_hdf5 as _read_hdf5
from bondgraph.data.formats.matlab import read_mat as _read_mat
from bondgraph.data.formats.mdf import read_mdf as _read_mdf
from bondgraph.data.formats.table import Reader, Table, read_whole
from bondgraph.data.header import Reading
from bondgraph.errors import DataError

_READERS: dict[str, Reader] = {".mat": _read_mat, ".mf4": _read_mdf, ".h5": _read_hdf5}
#: Seconds after which a library hangs: a file of the largest size that is read takes a few minutes at most.
_LONGEST = 600.0
_READ = "import sys; from bondgraph.data.apart import serve; sys.exit(serve(*sys.argv[1:]))"
_REFUSED = 3


def read_mat(path: Path, reading: Reading) -> Table:
    """Variables of a MATLAB file, see :func:`bondgraph.data.formats.matlab.read_mat`."""
    return _read(".mat", path, reading, _LONGEST)


def read_mdf(path: Path, reading: Reading) -> Table:
    """Channels of an MDF file, see :func:`bondgraph.data.formats.mdf.read_mdf`."""
    return _read(".mf4", path, reading, _LONGEST)


def read_hdf5(path: Path, reading: Reading) -> Table:
    """Data sets of an HDF5 file, see :func:`bondgraph.data.formats.hdf5.read_hdf5`."""
    return _read(".h5", path, reading, _LONGEST)


def _read(kind: str, path: Path, reading: Reading, longest: float) -> Table:
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "table.npz"
        # -P: what lies in the working folder, perhaps beside the log, is no module
        command = [sys.executable, "-P", "-c", _READ, kind, str(path.absolute()), str(table)]
        command.append(json.dumps({"units": dict(reading.units), "time": reading.time}))
        own, places = str(Path(__file__).parents[2]), [*filter(None, sys.path)]
        if own not in places:  # else in the order of this process: libraries may lie beside this package
            places.insert(0, own)
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(places)}
        try:
            run = subprocess.run(command, env=environment, capture_output=True, timeout=longest, check=False)
        except subprocess.TimeoutExpired:
            raise _damaged(path, f"reading it took more than {longest:g} s") from None
        if run.returncode == _REFUSED:
            message, where = json.loads(run.stdout)
            raise DataError(message, where)
        if run.returncode != 0:
            raise _damaged(path, f"reading it ended with status {run.returncode}")
        with np.load(table, allow_pickle=False) as columns:
            content = tuple((str(title), columns[str(k)]) for k, title in enumerate(columns["titles"]))
            return Table(content, is_merged=bool(columns["is_merged"]))


def _damaged(path: Path, problem: str) -> DataError:
    return DataError(
        f"{path.name}: this is not a readable file ({problem}) - it is damaged, or of another kind; write it again",
        where=(path.name,),
    )


def serve(kind: str, path: str, target: str, reading: str) -> int:
    """Read a file and keep its columns; what is wrong with it goes to standard output."""
    try:
        table = read_whole(_READERS[kind], Path(path), kind, Reading(**json.loads(reading)))
    except DataError as error:
        print(json.dumps([error.message, error.where]))
        return _REFUSED
    columns = {str(index): _plain(column) for index, (_, column) in enumerate(table.columns)}
    titles = np.array([title for title, _ in table.columns], dtype=np.str_)
    np.savez(target, titles=titles, is_merged=np.array(table.is_merged), **columns)  # type: ignore[arg-type]
    return 0


def _plain(column: Any) -> np.ndarray[Any, Any]:
    """A column as numbers or as text, which need no pickles."""
    array = np.asarray(column)
    return array if array.dtype.kind in "fiubcU" else np.array([str(cell) for cell in array], dtype=np.str_)
