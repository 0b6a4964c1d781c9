"""Drawing primitives and their two outputs: SVG text and a matplotlib figure.

Coordinates are pixels with y downwards. A picture is a tuple of primitives, so that both outputs show the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal
from xml.sax.saxutils import escape, quoteattr

from bondgraph.report.diagram.geometry import Box, Path
from bondgraph.report.diagram.text import plain, text_width

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FONTS = "Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif"


@dataclass(frozen=True)
class Line:
    """A polyline; ``dash`` are lengths of strokes and gaps, ``radius`` rounds its corners."""

    points: Path
    colour: str
    width: float = 1.5
    dash: tuple[float, ...] = ()
    radius: float = 0.0
    role: str = ""


@dataclass(frozen=True)
class Polygon:
    """A filled polygon without outline."""

    points: Path
    colour: str
    role: str = ""


@dataclass(frozen=True)
class Rectangle:
    """A rectangle with rounded corners; ``tooltip`` is shown by SVG viewers."""

    box: Box
    fill: str
    outline: str
    width: float = 1.0
    radius: float = 6.0
    dash: tuple[float, ...] = ()
    role: str = ""
    tooltip: str = ""


@dataclass(frozen=True)
class Lead:
    """A bold word before a centred text, in a size and colour of its own."""

    text: str
    size: float
    colour: str


@dataclass(frozen=True)
class Text:
    """One line of text; ``y`` is its base line."""

    x: float
    y: float
    text: str
    size: float
    colour: str
    anchor: Literal["start", "middle", "end"] = "start"
    bold: bool = False
    italic: bool = False
    role: str = ""
    lead: Lead | None = None


Primitive = Line | Polygon | Rectangle | Text


@dataclass(frozen=True)
class Picture:
    """Primitives from back to front on a white ground."""

    width: float
    height: float
    title: str
    primitives: tuple[Primitive, ...]


def _n(value: float) -> str:
    """A coordinate with at most two decimals."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def svg_text(picture: Picture) -> str:
    """The picture as an SVG document.

    Examples
    --------
    >>> svg_text(Picture(10, 10, "empty", ())).splitlines()[1]
    '<title>empty</title>'
    """
    width, height = _n(picture.width), _n(picture.height)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
        f'role="img" font-family="{FONTS}">'
    )
    body = "\n".join(_svg(primitive) for primitive in picture.primitives)
    ground = f'<rect width="{width}" height="{height}" fill="#ffffff"/>'
    return f"{head}\n<title>{escape(picture.title)}</title>\n{ground}\n{body}\n</svg>\n"


def _svg(primitive: Primitive) -> str:
    role = f" class={quoteattr(primitive.role)}" if primitive.role else ""
    if isinstance(primitive, Line):
        return (
            f'<path{role} d="{_path_data(primitive.points, primitive.radius)}" fill="none" stroke="{primitive.colour}" '
            f'stroke-width="{_n(primitive.width)}"{_dash(primitive.dash)} stroke-linecap="round" '
            f'stroke-linejoin="round"/>'
        )
    if isinstance(primitive, Polygon):
        points = " ".join(f"{_n(x)},{_n(y)}" for x, y in primitive.points)
        return f'<polygon{role} points="{points}" fill="{primitive.colour}"/>'
    if isinstance(primitive, Rectangle):
        box = primitive.box
        tooltip = f"<title>{escape(primitive.tooltip)}</title>" if primitive.tooltip else ""
        return (
            f'<rect{role} x="{_n(box.left)}" y="{_n(box.top)}" width="{_n(box.width)}" height="{_n(box.height)}" '
            f'rx="{_n(primitive.radius)}" fill="{primitive.fill}" stroke="{primitive.outline}" '
            f'stroke-width="{_n(primitive.width)}"{_dash(primitive.dash)}>{tooltip}</rect>'
        )
    weight = ' font-weight="bold"' if primitive.bold else ""
    style = ' font-style="italic"' if primitive.italic else ""
    return (
        f'<text{role} x="{_n(primitive.x)}" y="{_n(primitive.y)}" font-size="{_n(primitive.size)}" '
        f'fill="{primitive.colour}" text-anchor="{primitive.anchor}"{weight}{style} xml:space="preserve">'
        f"{_lead(primitive)}{escape(primitive.text)}</text>"
    )


def _lead(text: Text) -> str:
    if text.lead is None:
        return ""
    look = f'font-size="{_n(text.lead.size)}" fill="{text.lead.colour}" font-weight="bold"'
    return f"<tspan {look}>{escape(text.lead.text)}</tspan> "


def _dash(dash: Sequence[float]) -> str:
    return f' stroke-dasharray="{" ".join(_n(length) for length in dash)}"' if dash else ""


def _path_data(points: Path, radius: float) -> str:
    """SVG path commands of a polyline whose corners are rounded."""
    commands = [f"M{_n(points[0][0])} {_n(points[0][1])}"]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        r = min(radius, _length(before, corner) / 2, _length(corner, after) / 2)
        if r > 0:
            start, end = _towards(corner, before, r), _towards(corner, after, r)
            commands.append(f"L{_n(start[0])} {_n(start[1])}Q{_n(corner[0])} {_n(corner[1])} {_n(end[0])} {_n(end[1])}")
        else:
            commands.append(f"L{_n(corner[0])} {_n(corner[1])}")
    commands.append(f"L{_n(points[-1][0])} {_n(points[-1][1])}")
    return "".join(commands)


def _length(a: tuple[float, float], b: tuple[float, float]) -> float:
    return float(((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2) ** 0.5)


def _towards(start: tuple[float, float], end: tuple[float, float], distance: float) -> tuple[float, float]:
    share = distance / (_length(start, end) or 1.0)
    return start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])


def figure(picture: Picture) -> Figure:
    """The picture as a matplotlib figure of the same size (one pixel is 1/96 inch), for PNG and PDF."""
    from matplotlib.figure import Figure

    made = Figure(figsize=(picture.width / 96, picture.height / 96), facecolor="white")
    axes = made.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0, picture.width)
    axes.set_ylim(picture.height, 0)
    axes.set_axis_off()
    for order, primitive in enumerate(picture.primitives):
        _paint(axes, primitive, order)
    return made


def _paint(axes: Axes, primitive: Primitive, order: int) -> None:
    from matplotlib import patches
    from matplotlib.lines import Line2D

    points = 72 / 96  # matplotlib measures widths and fonts in points
    if isinstance(primitive, Line):
        dashes = tuple(length / primitive.width for length in primitive.dash)
        axes.add_line(
            Line2D(
                [x for x, _ in primitive.points], [y for _, y in primitive.points],
                color=primitive.colour, linewidth=primitive.width * points, zorder=order,
                linestyle=(0, dashes) if dashes else "-", solid_capstyle="round", solid_joinstyle="round",
            )
        )  # fmt: skip
    elif isinstance(primitive, Polygon):
        axes.add_patch(patches.Polygon(list(primitive.points), closed=True, color=primitive.colour, lw=0, zorder=order))
    elif isinstance(primitive, Rectangle):
        box, radius = primitive.box, primitive.radius
        axes.add_patch(
            patches.FancyBboxPatch(
                (box.left + radius, box.top + radius), box.width - 2 * radius, box.height - 2 * radius,
                boxstyle=f"Round,pad={radius},rounding_size={radius}",
                facecolor=primitive.fill, edgecolor=primitive.outline, linewidth=primitive.width * points, zorder=order,
                linestyle=(0, primitive.dash) if primitive.dash else "-",
            )
        )  # fmt: skip
    else:
        for text in _without_lead(primitive):
            aligned = {"start": "left", "middle": "center", "end": "right"}[text.anchor]
            axes.text(
                text.x, text.y, plain(text.text), fontsize=text.size * points,
                color=text.colour, ha=aligned, va="baseline", zorder=order, family="sans-serif",
                fontweight="bold" if text.bold else "normal", fontstyle="italic" if text.italic else "normal",
            )  # fmt: skip


def _without_lead(text: Text) -> list[Text]:
    """A text with a lead, centred, as two texts side by side."""
    lead = text.lead
    if lead is None:
        return [text]
    width = text_width(lead.text + " ", lead.size, bold=True)
    start = text.x - (width + text_width(text.text, text.size)) / 2
    return [
        Text(start, text.y, lead.text, lead.size, lead.colour, bold=True),
        Text(start + width, text.y, text.text, text.size, text.colour),
    ]
