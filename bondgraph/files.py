"""Files that are written whole or not at all, and names that may become names of files."""

from __future__ import annotations

import errno
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from bondgraph.errors import OptionError

#: File systems keep names of 255 bytes; what is written adds endings such as ``_states.csv``.
_LONGEST_NAME = 200


def write_bytes(path: Path, content: bytes | Iterable[bytes]) -> None:
    """Write a file, whole or piece by piece, beside its place and put it there in one step.

    A reader finds the old one or the whole new one.

    Raises
    ------
    OSError
        That names ``path``, where it cannot be written (a full disk, a folder in its place); what stood there stays.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_bytes(Path(folder) / "run.csv", b"time [s]")
    ...     [(path.name, path.read_text()) for path in Path(folder).iterdir()]
    [('run.csv', 'time [s]')]
    """
    write_whole(path, lambda file: file.writelines([content] if isinstance(content, bytes) else content))


def write_whole(path: Path, write: Callable[[BinaryIO], None]) -> None:
    """Write a file by a function that is given it, open for bytes, as :func:`write_bytes` does.

    Raises
    ------
    OSError
        That names ``path``, where it cannot be written; what stood there stays.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_whole(Path(folder) / "run.csv", lambda file: file.writelines([b"time [s]"]))
    ...     (Path(folder) / "run.csv").read_text()
    'time [s]'
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with partial.open("wb") as file:
            write(file)
        os.replace(partial, path)
    except OSError as error:
        error.filename, error.filename2 = str(path), None
        raise
    finally:
        partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    r"""Write a file of UTF-8 text, with the ends of lines as they are, in one step."""
    write_bytes(path, text.encode())


def write_json(path: Path, value: Mapping[str, Any]) -> None:
    """Write JSON in one step, so that a crash never leaves half a result.

    Raises
    ------
    OSError
        If the file cannot be written.
    ValueError
        If a number is not finite, for which JSON has no word.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_json(Path(folder) / "result.json", {"mass": 80.0})
    ...     print((Path(folder) / "result.json").read_text())
    {
     "mass": 80.0
    }
    """
    write_text(path, json.dumps(value, indent=1, allow_nan=False) + "\n")


def finite(value: Any) -> Any:
    """The same value with null for numbers that JSON cannot write.

    Examples
    --------
    >>> finite({"rms": float("nan"), "samples": [400]})
    {'rms': None, 'samples': [400]}
    """
    if isinstance(value, dict):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def output_folder(path: Path) -> Path:
    """The folder itself, made where it is missing, before any work is done for it.

    Raises
    ------
    OptionError
        If it is a file, or nothing can be written there.
    """
    if path.exists() and not path.is_dir():
        raise OptionError(f"{path}: is a file, not a folder - name another folder", where=(str(path),))
    try:
        path.mkdir(parents=True, exist_ok=True)
        write_bytes(path / ".writable", b"1")
        (path / ".writable").unlink()
    except OSError as error:
        raise OptionError(
            f"{path}: nothing can be written to this folder ({error.strerror}) - name another folder",
            where=(str(path),),
        ) from None
    return path


def output_file(path: Path) -> Path:
    """The path itself, if a file can be written there, before any work is done for it.

    Raises
    ------
    OptionError
        If its folder does not exist, or it is a folder itself.
    """
    if not path.parent.is_dir():
        raise OptionError(f"{path}: the folder {path.parent} does not exist - create it first", where=(str(path),))
    if path.is_dir():
        raise OptionError(f"{path}: is a folder - name a file in it", where=(str(path),))
    return path


def file_problem(error: OSError) -> OptionError:
    """What the system says of a file, in the form of all messages.

    Examples
    --------
    >>> file_problem(FileNotFoundError(errno.ENOENT, "No such file or directory", "runs/a.csv")).message
    'runs/a.csv: No such file or directory - check the path'
    """
    name = "the answer" if error.filename is None else os.fsdecode(error.filename)
    return OptionError(f"{name}: {error.strerror or error} - {_TODO.get(error.errno or 0, 'check the path')}", (name,))


_TODO = {
    errno.ENOSPC: "make room, or write to another disk",
    errno.EDQUOT: "make room, or write to another disk",
    errno.EFBIG: "make room, or write to another disk",
    errno.EROFS: "write to another disk",
    errno.EACCES: "name a place where you may read and write",
    errno.EPERM: "name a place where you may read and write",
    errno.EISDIR: "name a file, not a folder",
}


def check_name(name: str, refused: Callable[[str], Exception]) -> None:
    """Refuse a name that could lead a file out of its folder; ``refused`` makes the error from what is wrong.

    Graphs, logs and effects give their names to files that are written.

    Examples
    --------
    >>> check_name("run 7", OptionError)
    >>> check_name("../../x", OptionError)
    Traceback (most recent call last):
        ...
    bondgraph.errors.OptionError: name '../../x' holds '/' - use letters, digits and underscores
    """
    todo = "use letters, digits and underscores"
    wrong = next((letter for letter in name if letter in _SEPARATORS or not letter.isprintable()), None)
    if wrong is not None:
        raise refused(f"name {_cut(name)!r} holds {wrong!r} - {todo}")
    if not name.strip(". "):
        raise refused(f"name {name!r} has no letters - {todo}")
    if len(name.encode()) > _LONGEST_NAME:
        raise refused(f"name {_cut(name)!r} has {len(name)} letters - use at most {_LONGEST_NAME}")


_SEPARATORS = {"/", os.sep, os.altsep or os.sep}


def _cut(name: str) -> str:
    return name if len(name) <= 60 else name[:60] + "..."
