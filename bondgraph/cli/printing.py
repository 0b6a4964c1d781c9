"""Text for people at a terminal: wrapped at words, long lists cut to a sentence that says where the whole is.

Where the output is no terminal, lines stay as they are, for programs that read them.
"""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
from typing import TextIO

#: Names written out of a list in one line; beyond twice as many it is cut.
_NAMES = 10
#: Signs of which rules and columns of tables are made: lines that have one are not wrapped.
_TABLE = re.compile(r"[─━│┃╭╰]|\S {3,}\S")


def say(text: str, file: TextIO | None = None, whole: str = "") -> None:
    """Print lines; ``whole`` names the file that holds all names of a list that is cut."""
    stream = file or sys.stdout
    if not stream.isatty():
        print(text, file=stream)
        return
    width = shutil.get_terminal_size().columns
    print("\n".join(for_terminal(line, width, whole) for line in text.split("\n")), file=stream)


def for_terminal(line: str, width: int, whole: str = "") -> str:
    r"""A line wrapped at words to a width, continued at its own indentation; its list of names cut.

    Examples
    --------
    >>> print(for_terminal("  note: the speed of the body is not measured before 5 s", 30))
      note: the speed of the body
        is not measured before 5 s
    >>> for_terminal("not used: " + ", ".join(f"c{k}" for k in range(100)), 200, "report.html")
    'not used: c0, c1, c2, c3, c4, c5, c6, c7, c8, c9 and 90 more (all in report.html)'
    """
    if _TABLE.search(line.strip()):
        return line
    cut = _cut(line, whole)
    indent = cut[: len(cut) - len(cut.lstrip())]
    if len(cut) <= width:
        return cut
    return textwrap.fill(
        cut.strip(), max(width, 20), initial_indent=indent, subsequent_indent=f"{indent}  ", break_long_words=False,
        break_on_hyphens=False,
    )  # fmt: skip


def _cut(line: str, whole: str) -> str:
    """A line whose last list of names is long, with the first of them and the number of the others."""
    head, colon, listed = line.rpartition(": ")
    names = listed.split(", ")
    if not colon or len(names) <= 2 * _NAMES or any(" " in name.strip() and len(name) > 60 for name in names):
        return line
    where = f" (all in {whole})" if whole else ""
    return f"{head}: {', '.join(names[:_NAMES])} and {len(names) - _NAMES} more{where}"
