"""Figures in HTML: pictures that a page holds itself, wide for a screen and narrow for a phone."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from html import escape

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from bondgraph.report.compact import compact_svg, svg_uri
from bondgraph.report.figures import NARROW, figure_style, laid_out
from bondgraph.report.thinning import MOST_POINTS

#: Letters of a title or a label that fit into the width of a phone beside the numbers of an axis.
_LETTERS = 42
#: Letters of what an axis counts below it, which leave room for names beside the rows of a picture.
_LETTERS_BELOW = 32
#: Letters of a name beside a row of a picture that leave it half of that width.
_LETTERS_BESIDE = 22
#: Height of a line of text over that of its letters, as matplotlib sets lines.
_LINE = 1.2


def figure_svg(figure: Figure) -> str:
    """The figure as SVG text, the same for the same figure."""
    buffer = io.StringIO()
    with figure_style(), laid_out(figure):
        figure.savefig(buffer, format="svg", dpi=180, metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def embed(figure: Figure, alternative: str, narrow: Figure | None = None) -> str:
    """An HTML element that holds the figure itself; ``alternative`` describes it for who cannot see it.

    Parameters
    ----------
    figure
        The figure.
    alternative
        What it shows, in words.
    narrow
        The same for a window of 640 pixels or less; None takes the figure drawn again at that width, so that its
        letters keep their size.

    The SVG goes in as a data URI, so that names inside one figure never meet those of another; it is written short
    (:mod:`bondgraph.report.compact`).
    """
    width = figure.get_size_inches()[0]
    image = image_of(figure, alternative)
    if narrow is None and width <= NARROW:
        return image
    small = _narrow(figure) if narrow is None else _uri(narrow)
    source = f'<source media="(max-width: 640px)" srcset="{small}" width="{round(NARROW * 96)}">'
    return f"<picture>{source}{image}</picture>"


def image_of(figure: Figure, alternative: str) -> str:
    """An HTML image at the figure's own size, where a phone scrolls it."""
    width = round(figure.get_size_inches()[0] * 96)
    return f'<img src="{_uri(figure)}" width="{width}" alt="{escape(alternative, quote=True)}">'


def _narrow(figure: Figure) -> str:
    """The figure at the width of a phone, long lines of text broken; the figure stays as it was."""
    width, height = figure.get_size_inches()
    found = figure.findobj(Text)
    lines = [one for one in found if isinstance(one, Text) and len(one.get_text()) > _LETTERS_BELOW]
    texts = [line.get_text() for line in lines]
    beside = [(axes, [label.get_text() for label in axes.get_yticklabels()]) for axes in figure.axes]
    named = [(axes, names) for axes, names in beside if max(map(len, names), default=0) > _LETTERS_BESIDE]
    figure.set_size_inches(NARROW, height + sum(_name_beside(axes, names) for axes, names in named))
    below = {axes.xaxis.label for axes in figure.axes}
    for line, text in zip(lines, texts, strict=True):
        line.set_text(_broken(text, _LETTERS_BELOW if line in below else _LETTERS))
    uri = _uri(figure)
    for line, text in zip(lines, texts, strict=True):
        line.set_text(text)
    for axes, names in named:
        axes.set_yticks(axes.get_yticks(), names)
    figure.set_size_inches(width, height)
    return uri


def _name_beside(axes: Axes, names: Sequence[str]) -> float:
    """Break the names beside the rows of a picture; the height in inches of the lines that this adds."""
    broken = [_broken(name, _LETTERS_BESIDE) for name in names]
    axes.set_yticks(axes.get_yticks(), broken)
    line = _LINE * float(axes.get_yticklabels()[0].get_fontsize()) / 72.0
    return line * sum(name.count("\n") for name in broken)


def _broken(text: str, letters: int) -> str:
    return "\n".join(textwrap.wrap(text, letters, break_long_words=False))


def _uri(figure: Figure) -> str:
    with _drawn_dots(figure):
        return svg_uri(compact_svg(figure_svg(figure)))


@contextmanager
def _drawn_dots(figure: Figure) -> Iterator[None]:
    """Dots of which a few hundred make a line as dots, which then take less of a page than a raster of them.

    Where many lie one over another, half seen through, a raster stays.
    """
    found = [
        one for one in figure.findobj(Line2D)
        if isinstance(one, Line2D) and one.get_rasterized() and one.get_alpha() is None
        and np.size(one.get_xdata()) <= MOST_POINTS
    ]  # fmt: skip
    for one in found:
        one.set_rasterized(False)
    try:
        yield
    finally:
        for one in found:
            one.set_rasterized(True)
