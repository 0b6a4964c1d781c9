"""Reads MATLAB and MDF files in a process of its own: at a damaged file their libraries may end the process or hang."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.data import formats
from bondgraph.errors import DataError

_READERS = {".mat": formats.read_mat, ".mf4": formats.read_mdf}
#: Seconds after which a library hangs: a file of the largest size that is read takes a few minutes at most.
_LONGEST = 600.0
_READ = "import sys; from bondgraph.data.apart import serve; sys.exit(serve(*sys.argv[1:]))"
_REFUSED = 3


def read_mat(path: Path) -> formats.Table:
    """Variables of a MATLAB file, see :func:`bondgraph.data.formats.read_mat`."""
    return _read(".mat", path, _LONGEST)


def read_mdf(path: Path) -> formats.Table:
    """Channels of an MDF file, see :func:`bondgraph.data.formats.read_mdf`."""
    return _read(".mf4", path, _LONGEST)


def _read(kind: str, path: Path, longest: float) -> formats.Table:
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "table.npz"
        # -P: what lies in the working folder, perhaps beside the log, is no module
        command = [sys.executable, "-P", "-c", _READ, kind, str(path.absolute()), str(table)]
        places = [str(Path(__file__).parents[2]), *filter(None, sys.path)]
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
            return [(str(title), columns[str(index)]) for index, title in enumerate(columns["titles"])]


def _damaged(path: Path, problem: str) -> DataError:
    return DataError(
        f"{path.name}: this is not a readable file ({problem}) - it is damaged, or of another kind; write it again",
        where=(path.name,),
    )


def serve(kind: str, path: str, target: str) -> int:
    """Read a file and keep its columns; what is wrong with it goes to standard output."""
    try:
        table = formats.read_whole(_READERS[kind], Path(path), kind)
    except DataError as error:
        print(json.dumps([error.message, error.where]))
        return _REFUSED
    columns = {str(index): _plain(column) for index, (_, column) in enumerate(table)}
    np.savez(target, titles=np.array([title for title, _ in table], dtype=np.str_), **columns)  # type: ignore[arg-type]
    return 0


def _plain(column: Any) -> np.ndarray[Any, Any]:
    """A column as numbers or as text, which need no pickles."""
    array = np.asarray(column)
    return array if array.dtype.kind in "fiubcU" else np.array([str(cell) for cell in array], dtype=np.str_)
