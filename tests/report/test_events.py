"""Marks of events in pictures."""

from __future__ import annotations

import numpy as np

from bondgraph.report.events import events_text, mark_events
from bondgraph.report.plots import launch_figure
from bondgraph.simulate.example import pendulum
from bondgraph.simulate.simulation import simulate
from tests.simulate.machines import ball, engagement, exact


def dotted(axes):
    return [line.get_xdata()[0] for line in axes.lines if line.get_linestyle() == ":"]


def test_every_panel_has_a_line_at_each_event_and_the_first_says_what_happened():
    found = simulate(exact(engagement()), np.linspace(0.0, 2.0, 21))
    figure = launch_figure(found)
    mark_events(figure, found)
    assert all(dotted(axes) == [found.events[0].time] for axes in figure.axes)
    assert [text.get_text() for text in figure.axes[0].texts] == ["plates locks"]


def test_lines_that_could_not_be_told_apart_are_left_out():
    found = simulate(exact(ball()), np.linspace(0.0, 5.0, 51))
    figure = launch_figure(found)
    mark_events(figure, found)
    lines = np.array(dotted(figure.axes[0]))
    assert len(found.events) > 60 > lines.size > 15
    assert np.diff(lines).min() >= 0.004 * 5.0
    assert not figure.axes[0].texts


def test_a_smooth_model_has_nothing_to_mark():
    found = simulate(pendulum(), np.linspace(0.0, 1.0, 5))
    figure = launch_figure(found)
    mark_events(figure, found)
    assert [dotted(axes) for axes in figure.axes] == [[]] * len(figure.axes)
    assert events_text(found) == "no events"
