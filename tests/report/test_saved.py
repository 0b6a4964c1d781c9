"""The data of reports survive a file."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from bondgraph.report.html import ReportData, report_html
from bondgraph.report.saved import NAME, load_data, save_data
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
