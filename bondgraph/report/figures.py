"""The look of all figures, and how they are saved.

Measurements are grey, the declared model orange, the corrected model blue, a found law magenta, in every figure.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from bondgraph.errors import OptionError
from bondgraph.files import write_bytes

MEASURED, BEFORE, AFTER, FOUND = "#8b95a1", "#d9772b", "#1f5fa8", "#c2185b"
LINES = ("#1f5fa8", "#d9772b", "#1b7a43", "#8e44ad", "#b3362b", "#007f8c")
BAND = "#e6e9ed"
WIDTH, PANEL_HEIGHT = 10.5, 1.9
#: Width on a phone: 374 pixels of 1/96 inch, in which letters keep their size.
NARROW = 3.9

_STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#8b95a1",
    "axes.labelcolor": "#1c2126",
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "xtick.color": "#5b636d",
    "ytick.color": "#5b636d",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "path.simplify_threshold": 0.4,
    "svg.hashsalt": "bondgraph",
    "figure.facecolor": "white",
}


@contextmanager
def figure_style() -> Iterator[None]:
    """The look of every figure of the reports, while it is drawn."""
    with matplotlib.rc_context(_STYLE):
        yield


@contextmanager
def laid_out(figure: Figure) -> Iterator[None]:
    """The figure with its layout made, to be saved.

    To find a layout, matplotlib would draw everything once more, which takes as long as drawing itself.
    """
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
    with matplotlib.rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
        figure.set_layout_engine(None)
    try:
        yield
    finally:
        figure.set_layout_engine(engine)


def save_figure(figure: Figure, path: Path, dpi: int = 150) -> None:
    """Write a figure; the ending of the name says how.

    Raises
    ------
    OptionError
        If the ending is none of a picture, or the folder does not exist.
    """
    known = figure.canvas.get_supported_filetypes()
    ending = path.suffix.lstrip(".").lower()
    if ending not in known:
        raise OptionError(f"{path}: no picture format .{ending} - use .png, .svg or .pdf", where=(str(path),))
    if not path.parent.is_dir():
        raise OptionError(f"{path}: the folder {path.parent} does not exist - create it first", where=(str(path),))
    write_bytes(path, picture(figure, ending, dpi=dpi))


def picture(figure: Figure, ending: str, **options: Any) -> bytes:
    """The figure as the content of a file with this ending; a writer that meets a full disk may leave half of it."""
    content = io.BytesIO()
    with laid_out(figure):
        figure.savefig(content, format=ending, **options)
    return content.getvalue()
