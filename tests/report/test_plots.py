"""Figures show the numbers they are given, stay readable, and come out the same every time."""

from __future__ import annotations

from dataclasses import replace
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

from bondgraph.estimate.objective import TraceRow
from bondgraph.report import embedding
from bondgraph.report.embedding import embed, figure_svg
from bondgraph.report.figures import NARROW, figure_style
from bondgraph.report.plots import (
    AFTER,
    BEFORE,
    FOUND,
    MEASURED,
    by_log,
    innovation_figure,
    launch_figure,
    missing_effort_figure,
    prediction_figure,
    residual_figure,
    state_figure,
    trace_figure,
)
from bondgraph.report.series import ChannelSeries, Prediction, StateBand
from bondgraph.report.thinning import thinned, with_gaps
from bondgraph.simulate.example import PENDULUM
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate
from tests.report.examples import coast_down_series, missing_drag


def lines(axes: object, colour: str) -> list[np.ndarray]:
    return [np.asarray(line.get_ydata()) for line in axes.get_lines() if line.get_color() == colour]  # type: ignore[attr-defined]


def pictures(element: str) -> list[str]:
    """The SVG texts in an element of HTML."""
    return [unquote(part.split('"')[0]) for part in element.split("data:image/svg+xml,")[1:]]


def test_predictions_are_drawn_over_the_measurements_of_each_channel() -> None:
    series = by_log(coast_down_series(samples=300))["coast_down_1"]
    panels = prediction_figure(series).axes
    assert [axes.get_title(loc="left") for axes in panels[:2]] == ["free simulation", "one step ahead"]
    for one, (left, right) in zip(series, (panels[0:2], panels[2:4]), strict=True):
        assert one.after is not None
        measured = one.measured[np.isfinite(one.measured)]
        for axes, kind in ((left, "simulated"), (right, "one_step")):
            np.testing.assert_array_equal(lines(axes, MEASURED)[0], measured)
            np.testing.assert_array_equal(lines(axes, BEFORE)[0], getattr(one.before, kind))
            np.testing.assert_array_equal(lines(axes, AFTER)[0], getattr(one.after, kind))
        assert left.get_ylabel() == f"{one.channel}\n[{one.unit}]"


def test_residuals_are_measured_minus_predicted_and_break_at_gaps() -> None:
    series = by_log(coast_down_series(samples=300))["coast_down_1"]
    axes = residual_figure(series).axes[2]
    wheel = series[1]
    assert wheel.before.simulated is not None
    drawn = lines(axes, BEFORE)[0]
    expected = wheel.measured - wheel.before.simulated
    np.testing.assert_allclose(drawn[np.isfinite(drawn)], expected[np.isfinite(expected)])
    assert np.isnan(drawn).sum() == 1


def test_a_simulation_that_runs_away_does_not_flatten_the_measurements() -> None:
    time = np.linspace(0.0, 1.0, 50)
    series = ChannelSeries("run", "v", "m/s", time, np.sin(time), Prediction(simulated=1e6 * time))
    low, high = prediction_figure([series]).axes[0].get_ylim()
    assert high - low < 5.0


def test_only_the_kinds_of_prediction_that_exist_get_a_column() -> None:
    time = np.linspace(0.0, 1.0, 50)
    series = ChannelSeries("run", "v", "m/s", time, time, Prediction(simulated=time))
    assert len(prediction_figure([series]).axes) == 1


def test_a_launch_has_a_panel_per_unit_and_each_quantity_once() -> None:
    model = Model.from_text(PENDULUM)
    figure = launch_figure(simulate(model, np.linspace(0.0, 2.0, 50)))
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["angle\n[rad]", "rate\n[rad/s]", "deflection\n[m]", "drive\n[rad/s^2]"]
    chosen = launch_figure(simulate(model, np.linspace(0.0, 2.0, 50)), ["rate"])
    assert [axes.get_ylabel() for axes in chosen.axes] == ["rate\n[rad/s]"]


def test_the_found_law_runs_through_the_missing_effort() -> None:
    found = missing_drag()
    axes = missing_effort_figure(found).axes[0]
    np.testing.assert_array_equal(lines(axes, FOUND)[0], found.law)
    assert (axes.get_xlabel(), axes.get_ylabel()) == (found.x_label, found.y_label)
    medians = axes.containers[0].lines[0]
    x, y = np.asarray(medians.get_xdata()), np.asarray(medians.get_ydata())
    np.testing.assert_allclose(y, np.interp(x, found.law_x, found.law), atol=12.0)


@pytest.mark.parametrize("narrow", [False, True])
@pytest.mark.parametrize("law", ["tau = 2·omega", "-0.023·omega_shaft·|omega_shaft| + 1.2·tanh(omega) " * 4, "x" * 150])
def test_a_law_of_any_length_stays_in_its_figure_and_leaves_the_axes_their_width(law: str, narrow: bool) -> None:
    figure = missing_effort_figure(replace(missing_drag(), law_text=law), narrow)
    figure.draw_without_rendering()
    page, (legend,), axes = figure.bbox, figure.legends, figure.axes[0]
    box = legend.get_window_extent()
    assert page.x0 <= box.x0 and box.x1 <= page.x1 and page.y0 <= box.y0
    assert box.y1 <= axes.get_tightbbox().y0 and axes.bbox.width > 0.7 * page.width


def test_a_trace_falls_by_stage() -> None:
    rows = [TraceRow("swarm", i, 10 * i, 100.0 - i, ()) for i in range(5)] + [TraceRow("gradient", 0, 60, 90.0, ())]
    axes = trace_figure(rows).axes[0]
    assert axes.get_legend_handles_labels()[1] == ["swarm", "gradient"]
    np.testing.assert_allclose(np.asarray(axes.get_lines()[0].get_ydata()), [10.0, 9.0, 8.0, 7.0, 6.0])


def test_thinning_keeps_extremes_and_gaps() -> None:
    time = np.arange(50000.0)
    values = np.sin(time / 900)
    values[31234] = 9.0
    values[20000:20500] = np.nan
    shown_time, shown = thinned(time, values)
    assert shown.size <= 2000
    assert np.nanmax(shown) == 9.0 and shown_time[int(np.nanargmax(shown))] == 31234.0
    assert np.isnan(shown[(shown_time > 20000) & (shown_time < 20500)]).all()
    assert (np.diff(shown_time) > 0).all()


@pytest.mark.parametrize("size", [1001, 1337, 5000])
def test_thinning_keeps_of_each_stretch_what_it_says(size: int) -> None:
    chance = np.random.default_rng(size)
    values = chance.integers(-5, 5, size).astype(float)
    values[chance.random(size) < 0.3] = np.nan
    values[chance.random(size) < 0.02] = np.inf
    values[40:60] = np.nan
    kept: set[int] = set()
    for stretch in np.array_split(np.arange(size), 500):
        part = values[stretch]
        if np.isfinite(part).any():
            kept |= {int(stretch[np.nanargmin(part)]), int(stretch[np.nanargmax(part)]), *stretch[np.isnan(part)][:1]}
        else:
            kept.add(int(stretch[0]))
    np.testing.assert_array_equal(thinned(np.arange(float(size)), values)[0], sorted(kept))


def test_gaps_are_found_among_irregular_samples() -> None:
    time = np.array([0.0, 0.1, 0.21, 0.3, 2.0, 2.1])
    shown_time, shown = with_gaps(time, np.ones(6))
    assert list(np.isnan(shown)) == [False] * 4 + [True] + [False] * 2
    assert (np.diff(shown_time) >= 0).all()


def test_embedded_figures_are_whole_images_and_repeatable() -> None:
    series = by_log(coast_down_series(samples=80))["coast_down_1"]
    first, second = (embed(prediction_figure(series), 'a "quoted" text') for _ in range(2))
    assert first == second
    assert 'alt="a &quot;quoted&quot; text"' in first
    root = ElementTree.fromstring(pictures(first)[0])
    assert root.tag.endswith("svg")


def test_on_a_phone_panels_stand_below_each_other_and_letters_keep_their_size() -> None:
    series = by_log(coast_down_series(samples=80))["coast_down_1"]
    narrow = prediction_figure(series, narrow=True)
    assert narrow.get_size_inches()[0] == NARROW
    assert len({round(axes.get_subplotspec().colspan.start) for axes in narrow.axes}) == 1
    assert [axes.get_title(loc="left") for axes in narrow.axes] == ["free simulation", "one step ahead"] * len(series)
    figure = residual_figure(series)
    before = figure.get_size_inches().tolist()
    widths = [ElementTree.fromstring(text).get("width") for text in pictures(embed(figure, "residuals"))]
    assert widths == [f"{NARROW * 72:g}pt", f"{before[0] * 72:g}pt"]
    assert figure.get_size_inches().tolist() == before


def test_long_lines_are_broken_on_a_phone_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    figure = missing_effort_figure(replace(missing_drag(), x_label="speed " * 12))
    monkeypatch.setattr(embedding, "compact_svg", str)  # which leaves out what the letters spell
    narrow, wide = pictures(embed(figure, "missing"))
    assert narrow.count("<!-- speed") == 3 and wide.count("<!-- speed") == 1
    assert figure.axes[0].get_xlabel() == "speed " * 12


def test_innovations_are_dots_in_their_band_and_counted() -> None:
    time = np.arange(40.0)
    measured = np.where(time < 30, 1.0, 3.0)
    measured[5] = np.nan
    band = StateBand("v", "m/s", time, np.zeros(40), np.ones(40), measured)
    (axes,) = innovation_figure([band], "run").axes
    assert axes.get_title(loc="right") == "74 % within the 95 % band"  # 29 of 39
    np.testing.assert_array_equal(lines(axes, AFTER)[0], measured[np.isfinite(measured)])
    edges = [line for line in lines(axes, MEASURED) if len(line) == 40]
    np.testing.assert_allclose(edges, [np.full(40, -1.96), np.full(40, 1.96)])


def test_a_filter_that_knows_little_at_first_does_not_press_the_rest_into_a_line() -> None:
    """One sample with a band of 15 in 400 with a band of 0.2: the innovations were one line."""
    time = np.arange(400.0)
    std = np.where(time == 1.0, 7.5, 0.1)
    measured = np.where(time == 300.0, 1.0, -0.1)
    (axes,) = innovation_figure([StateBand("T", "K", time, np.zeros(400), std, measured)]).axes
    low, high = axes.get_ylim()
    assert -0.4 < low < -0.196 and 1.0 < high < 1.2, "all innovations, and the band where it has settled"
    edges = [line for line in lines(axes, MEASURED) if len(line) == 400]
    assert max(map(np.max, edges)) == pytest.approx(1.96 * 7.5), "the band itself is what it was"
    (axes,) = state_figure([StateBand("T", "K", time, 300.0 + 0.01 * time, 10.0 * std, np.full(400, np.nan))]).axes
    assert 297.0 < axes.get_ylim()[0] < 298.1 and 305.9 < axes.get_ylim()[1] < 307.0


def test_long_names_beside_rows_are_broken_on_a_phone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The names of planned steps ran out of the picture, and matplotlib warned that it had no axes left."""
    name = "steps of force every 12 s, the other inputs at rest: 1.71 nats"
    with figure_style():
        figure = Figure(figsize=(8.0, 2.4), layout="constrained")
        axes = figure.subplots()
        axes.barh(range(3), [1.0, 2.0, 3.0])
        axes.set_yticks(range(3), [name, "run1", name])
    monkeypatch.setattr(embedding, "compact_svg", str)  # which leaves out what the letters spell
    narrow, wide = pictures(embed(figure, "nats"))
    assert f"<!-- {name} -->" in wide and "<!-- steps of force every -->" in narrow and "<!-- run1 -->" in narrow
    wide_height, narrow_height = (float(ElementTree.fromstring(text).attrib["height"][:-2]) for text in (wide, narrow))
    assert narrow_height > wide_height
    assert [label.get_text() for label in axes.get_yticklabels()] == [name, "run1", name]
    assert figure.get_size_inches().tolist() == [8.0, 2.4]


def test_a_band_narrower_than_a_line_is_told_by_its_width() -> None:
    time = np.arange(10.0)
    (axes,) = state_figure([StateBand("v", "m/s", time, 100.0 * time, np.full(10, 0.01), time)]).axes
    assert axes.get_title(loc="right") == "95 % band: ± 0.0196 m/s"
    unknown = StateBand("v", "m/s", time, time, np.full(10, np.nan), np.full(10, np.nan))
    assert "svg" in figure_svg(state_figure([unknown])) and "svg" in figure_svg(innovation_figure([unknown]))


def test_figures_leave_the_global_style_alone() -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    figure_svg(missing_effort_figure(missing_drag()))
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("values", [np.zeros(0), np.full(4, np.nan)])
def test_empty_channels_are_drawn_empty(values: np.ndarray) -> None:
    time = np.arange(float(values.size))
    series = ChannelSeries("run", "v", "m/s", time, values, Prediction(simulated=values), Prediction(simulated=values))
    assert "svg" in figure_svg(prediction_figure([series]))
    assert "svg" in figure_svg(residual_figure([series]))
