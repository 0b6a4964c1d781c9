"""A page of an analysis: an answer on top, then sections of text, a table and a picture, in one HTML file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bondgraph.files import write_text
from bondgraph.report.embedding import embed, image_of
from bondgraph.report.figures import figure_style
from bondgraph.report.html import Provenance, without_folders
from bondgraph.report.words import Words


@dataclass(frozen=True)
class Section:
    """A part of a page; what is empty is left out.

    Parameters
    ----------
    title
        Heading.
    text
        Paragraphs.
    header, rows
        Table, its first column flush left.
    figure
        Picture, described by the title to who cannot see it.
    scrolls
        Whether the picture keeps its size on a phone, which scrolls it; others are drawn again at that width.
    """

    title: str
    text: Sequence[str] = ()
    header: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    figure: Figure | None = field(default=None, compare=False)
    scrolls: bool = False

    @property
    def picture(self) -> Markup | str:
        """The picture as an element of HTML."""
        if self.figure is None:
            return ""
        return Markup((image_of if self.scrolls else embed)(self.figure, self.title))


def page_html(
    title: str, subtitle: str, answer: Sequence[str], sections: Sequence[Section], made: Provenance | None = None
) -> str:
    """The page as text of one file that needs nothing else.

    Examples
    --------
    >>> page = page_html("sled", "Sensitivities", ["free mass"], [Section("Ranking", header=["a"], rows=[["1"]])])
    >>> "free mass" in page and "http" not in page
    True
    """
    environment = Environment(
        loader=PackageLoader("bondgraph.report", "templates"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    page = environment.get_template("page.html.jinja").render(
        title=title, subtitle=subtitle, answer=list(answer), sections=list(sections), made=made,
        command=without_folders(made.command) if made else "", explained=Words(),
    )  # fmt: skip
    return page + "\n"


def write_page(
    path: Path,
    title: str,
    subtitle: str,
    answer: Sequence[str],
    sections: Sequence[Section],
    made: Provenance | None = None,
) -> None:
    """Write a page to a file; arguments as for :func:`page_html`."""
    write_text(path, page_html(title, subtitle, answer, sections, made))


def drawn(plot: Callable[[Axes | None], Axes], width: float = 7.5, height: float = 4.0) -> Figure:
    """The figure of a result's ``plot(ax)`` in the look of the reports, of a width and a height in inches.

    Examples
    --------
    >>> drawn(lambda ax: ax, 4.0, 3.0).get_size_inches().tolist()
    [4.0, 3.0]
    """
    with figure_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        plot(figure.subplots())
    return figure
