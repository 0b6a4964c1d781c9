"""The folder in which compiled models are kept between runs."""

from __future__ import annotations

import functools
import os
import tempfile
from pathlib import Path

import platformdirs

from bondgraph.errors import OptionError

#: Environment variable that names another folder.
CACHE_VARIABLE = "BONDGRAPH_CACHE_DIR"


def cache_folder() -> Path:
    """``$BONDGRAPH_CACHE_DIR``, else the user's cache folder, made if missing.

    Where the user's folder cannot be written, a temporary one serves, and models are compiled in every run.

    Raises
    ------
    OptionError
        If the variable names a folder that cannot be used.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    folder = Path(chosen) if chosen else Path(platformdirs.user_cache_dir("bondgraph", appauthor=False)) / "compiled"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        usable = os.access(folder, os.W_OK)
    except OSError:
        usable = False
    if not usable and chosen:
        raise OptionError(f"{CACHE_VARIABLE}={chosen}: the folder cannot be written - name another one")
    return folder if usable else _temporary_folder()


@functools.cache
def _temporary_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="bondgraph-"))


def store(name: str, text: str) -> Path:
    """A file of the cache folder with this text.

    A file that has it is left alone, since numba trusts its machine code by the time of the file; any other is replaced
    in one step, so that programs running side by side see the whole file or none.
    """
    path = cache_folder() / name
    content = text.encode()
    if not path.is_file() or path.read_bytes() != content:
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{name}", delete=False) as file:
            file.write(content)
        os.replace(file.name, path)
    return path
