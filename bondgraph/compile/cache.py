"""The folder in which compiled models are kept between runs."""

from __future__ import annotations

import functools
import hashlib
import os
import stat
import tempfile
import warnings
from pathlib import Path

import platformdirs

from bondgraph.errors import OptionError
from bondgraph.files import write_bytes

#: Environment variable that names another folder.
CACHE_VARIABLE = "BONDGRAPH_CACHE_DIR"


def cache_folder() -> Path:
    """``$BONDGRAPH_CACHE_DIR``, else the user's cache folder, made if missing.

    Where the user's folder cannot be written, a temporary one serves, and models are compiled in every run.

    Raises
    ------
    OptionError
        If the variable names a folder that cannot be used, or somebody else may write to the folder: what is loaded
        from it is run.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    folder = Path(chosen) if chosen else Path(platformdirs.user_cache_dir("bondgraph", appauthor=False)) / "compiled"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        (folder / _MACHINE_CODE).mkdir(exist_ok=True, mode=0o700)
        usable = os.access(folder, os.W_OK)
    except OSError:
        usable = False
    if not usable and chosen:
        raise OptionError(f"{CACHE_VARIABLE}={chosen}: the folder cannot be written - name another one")
    if not usable:
        return _temporary_folder()
    for part in (folder, folder / _MACHINE_CODE):
        _require_own(part)
    return folder


#: The folder that numba makes beside sources.
_MACHINE_CODE = "__pycache__"


def _require_own(folder: Path) -> None:
    """Refuse a folder that another user owns or may write, where the system knows users."""
    if os.name != "posix":
        return
    found = folder.stat()
    if found.st_uid != os.geteuid():
        problem = "belongs to another user"
    elif found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        problem = "can be written by other users"
    else:
        return
    raise OptionError(
        f"{folder}: this folder of compiled models {problem}, and what stands there is run - make it yours alone"
        f" (chmod go-w), or name another one in {CACHE_VARIABLE}",
        where=(str(folder), CACHE_VARIABLE),
    )


@functools.cache
def _temporary_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="bondgraph-"))


def store(name: str, text: str) -> Path | None:
    """A file with this text in the cache folder, else in a temporary one, None where no disk takes it.

    A file that has it is left alone, since numba trusts its machine code by the time of the file; any other is replaced
    in one step, so that programs running side by side see the whole file or none.
    """
    content = text.encode()
    for folder in (cache_folder, _temporary_folder):
        try:
            path = folder() / name
            if not path.is_file() or path.read_bytes() != content:
                write_bytes(path, content)
            return path
        except OSError:
            continue
    return None


def keep(name: str, content: bytes) -> None:
    """Keep machine code in the cache folder under a seal; where no disk takes it, that is said once."""
    folder = cache_folder() / _MACHINE_CODE
    try:
        folder.mkdir(exist_ok=True, mode=0o700)
        write_bytes(folder / name, content + seal(content))
    except OSError as error:
        say_not_kept(str(folder), error)


def kept(name: str) -> bytes | None:
    """Machine code that was kept under a name; None where there is none, or it is damaged."""
    path = cache_folder() / _MACHINE_CODE / name
    return path.read_bytes()[: -hashlib.sha256().digest_size] if is_whole(path) else None


def seal(content: bytes) -> bytes:
    """The digest that stands at the end of kept machine code."""
    return hashlib.sha256(content).digest()


def is_whole(path: Path) -> bool:
    """True for a sealed file as it was written, False for a damaged or missing one."""
    try:
        content = path.read_bytes()
    except OSError:
        return False
    size = hashlib.sha256().digest_size
    return seal(content[:-size]) == content[-size:]


_said: set[str] = set()


def say_not_kept(folder: str, error: OSError) -> None:
    """Say once that machine code is not kept."""
    if not _said:
        _said.add(folder)
        warnings.warn(
            f"{folder}: compiled models cannot be kept there ({error.strerror}), so that every run compiles them anew"
            " - make room, or name another folder in BONDGRAPH_CACHE_DIR",
            stacklevel=2,
        )
