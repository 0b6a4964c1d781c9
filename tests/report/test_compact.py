"""Figures in few letters: every line runs through the same points, and a browser draws the same picture."""

from __future__ import annotations

import io
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from bondgraph.report.compact import compact_svg
from bondgraph.report.embedding import embed, figure_svg
from bondgraph.report.figures import AFTER
from bondgraph.report.plots import by_log, missing_effort_figure, prediction_figure, residual_figure
from tests.report.browser import CHROMIUM, look
from tests.report.examples import coast_down_series, missing_drag

_ARGUMENTS = {"M": "xy", "L": "xy", "H": "x", "V": "y", "Q": "xyxy", "C": "xyxyxy", "Z": ""}


def points(data: str) -> list[tuple[float, float]]:
    """The points of a path by the grammar of SVG 1.1, section 8.3: ends and control points, in absolute coordinates."""
    words = re.findall(r"[A-Za-z]|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", data)
    x = y = begun_x = begun_y = 0.0
    found, letter, place = [], "", 0
    while place < len(words):
        if words[place].isalpha():
            letter, place = words[place], place + 1
        elif letter in "Mm":
            letter = "L" if letter == "M" else "l"
        axes = _ARGUMENTS[letter.upper()]
        from_x, from_y = (x, y) if letter.islower() else (0.0, 0.0)
        for axis in axes:
            value, place = float(words[place]), place + 1
            x, y = (from_x + value, y) if axis == "x" else (x, from_y + value)
            if axis == axes[-1]:
                found.append((x, y))
        if letter in "Mm":
            begun_x, begun_y = x, y
        if letter in "Zz":
            x, y = begun_x, begun_y
    return found


def drawn(svg: str) -> list[np.ndarray]:
    """The points of all paths, those of shared ones wherever they are used, the longest paths first."""
    root = ElementTree.fromstring(svg)
    named = {one.get("id"): one for one in root.iter() if one.get("id") and one.tag.endswith("path")}
    shared = {one.get("href", "")[1:] for one in root.iter() if one.tag.endswith("use")} & named.keys()
    found = [np.array(points(one.get("d", ""))) for one in root.iter() if one.tag.endswith("path")
             and one.get("id") not in shared]  # fmt: skip
    for use in root.iter():
        one = named.get(use.get("href", "")[1:]) if use.tag.endswith("use") else None
        if one is not None and "transform" not in one.attrib:
            place = (float(use.get("x", 0.0)), float(use.get("y", 0.0)))
            found.append(np.array(points(one.get("d", ""))) + place)
    return sorted(found, key=len, reverse=True)


def test_lines_run_through_the_same_points() -> None:
    figure = residual_figure(by_log(coast_down_series(samples=2400))["coast_down_1"])
    whole = figure_svg(figure)
    short = compact_svg(whole)
    assert len(short) < 0.5 * len(whole)
    before = [line for line in drawn(whole) if len(line) > 100]
    after = [line for line in drawn(short) if len(line) > 100]
    assert len(before) == len(after) == 8
    for line in before:
        nearest = min(np.abs(line - other).max() for other in after if len(other) == len(line))
        assert nearest < 0.0101


def test_dots_in_two_panels_are_written_once() -> None:
    series = by_log(coast_down_series(samples=800))["coast_down_1"]
    (wide, *_) = embed(prediction_figure(series), "", prediction_figure(series, narrow=True)).split("<img ")[1:]
    assert "image/png" not in wide and len(re.findall(r"h0m|v0m", wide)) == sum(
        int(np.isfinite(one.measured).sum()) - 1 for one in series
    )


def test_what_is_half_seen_through_stays_a_raster() -> None:
    figure = missing_effort_figure(missing_drag())
    assert "image/png" in embed(figure, "", figure)
    assert any(line.get_rasterized() for line in figure.axes[0].get_lines())


def test_a_writer_of_another_form_is_left_as_it_is() -> None:
    arc = '<svg xmlns="http://www.w3.org/2000/svg"><path d="M 0 0 A 5 5 0 0 1 10 10"/></svg>'
    assert 'd="M 0 0 A 5 5 0 0 1 10 10"' in compact_svg(arc)
    with pytest.raises(ElementTree.ParseError):
        compact_svg("<svg>")


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium or chrome, which is no package of Python")
def test_a_browser_draws_the_same(tmp_path: Path) -> None:
    series = by_log(coast_down_series(samples=2400))["coast_down_1"]
    edges = Figure(figsize=(6.0, 3.0))
    edges.subplots().plot([0.0, 1.0, 2.0], [1e-9, -3.0, 5.5], "o--", color=AFTER, alpha=0.5, label="a & b < c")
    edges.axes[0].legend()
    for place, figure in enumerate((prediction_figure(series), residual_figure(series), edges)):
        shots = []
        for name, text in (("whole", figure_svg(figure)), ("short", compact_svg(figure_svg(figure)))):
            page = tmp_path / f"{name}_{place}.html"
            (tmp_path / f"{name}_{place}.svg").write_text(text, encoding="utf-8")
            page.write_text(f'<!DOCTYPE html><body style="margin: 0"><img src="{name}_{place}.svg"></body>')
            (seen,) = look(page, [1100], ["light"], pictures=True)
            shots.append(imread(io.BytesIO(seen.png))[..., :3])
        assert shots[0].shape == shots[1].shape and shots[0].min() < 0.5
        assert np.abs(shots[0] - shots[1]).max() < 0.25 and np.abs(shots[0] - shots[1]).mean() < 1e-3
