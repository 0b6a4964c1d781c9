"""The data of reports survive a file."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from bondgraph.report.html import ReportData, report_html
from bondgraph.report.saved import NAME, load_data, save_data
from bondgraph.report.series import Prediction
from tests.report.examples import coast_down_report


@pytest.mark.usefixtures("undrawn")
def test_every_part_of_a_report_reads_back(tmp_path: Path) -> None:
    data = coast_down_report()
    save_data(data, tmp_path / NAME)
    found = load_data(ReportData, tmp_path / NAME)
    assert report_html(found) == report_html(data)
    for field in fields(ReportData):
        value, back = getattr(data, field.name), getattr(found, field.name)
        assert type(back) is type(value), field.name
        if field.name not in ("series", "missing", "errors"):
            assert back == value, field.name
    np.testing.assert_array_equal(found.series[0].measured, data.series[0].measured)


def test_times_that_channels_share_are_kept_once(tmp_path: Path) -> None:
    """A day of samples is written in seconds, and not once for each of its channels."""
    time = np.linspace(0.0, 1.0, 1000)
    shared = (Prediction(one_step=time), Prediction(one_step=time.copy()), Prediction(one_step=-time))
    save_data(shared, tmp_path / NAME)
    with np.load(tmp_path / NAME) as content:
        assert sorted(content.files) == ["a0", "a1", "text"]
    first, second, third = load_data(tuple[Prediction, ...], tmp_path / NAME)
    np.testing.assert_array_equal(first.one_step, time)
    assert second.one_step is first.one_step
    np.testing.assert_array_equal(third.one_step, -time)
