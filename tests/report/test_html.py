"""The report page: complete, self-contained, with the right numbers, and free of machine facts."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from bondgraph.report.html import Provenance, ReportData, report_html, without_folders, write_report
from bondgraph.report.series import (
    ChannelError,
    ChannelSeries,
    FilteredLog,
    Power,
    Prediction,
    StateBand,
    Tried,
    channel_errors,
)
from bondgraph.report.tables import power_table, text_of
from tests.report.examples import coast_down_report

VOID = {"source", "wbr", "meta", "input", "img", "br", "hr", "link"}


class Reader(HTMLParser):
    """Checks nesting and collects references, tables and text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []
        self.rows: list[list[str]] = []
        self.text: list[str] = []
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.references += [
            value or "" for name, value in attrs if name in ("src", "srcset", "href", "xlink:href", "action")
        ]
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [
            value or "" for name, value in attrs if name in ("src", "srcset", "href", "xlink:href", "action")
        ]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)
        if self.rows and any(tag in self.open for tag in ("td", "th")):
            self.rows[-1][-1] += data


@pytest.fixture(scope="module")
def page() -> str:
    return report_html(coast_down_report())


def test_the_page_is_well_nested_and_needs_nothing_else(page: str) -> None:
    reader = Reader(page)
    assert reader.references
    assert all(reference.startswith("data:image/svg+xml,") for reference in reader.references)
    without_data = re.sub(r'src(set)?="data:[^"]*"', "", page)
    assert not re.search(r"https?:|url\(|@import|<script|<link", without_data)


def test_every_part_is_there(page: str) -> None:
    text = " ".join("".join(Reader(page).text).split())
    for expected in (
        "Effect found",
        "A force growing with the square of the speed is missing at the body",
        "F = c_drag·v·|v|",
        "1290 nats",
        "Residuals of coast_down_1",
        "added to the declared model",
        "largest gain, confirmed by the block-wise variance",
        "indistinguishable",
        "at its bound",
        "The road was taken as level",
        "numpy",
    ):
        assert expected in text


def test_tables_hold_the_right_numbers(page: str) -> None:
    rows = [[" ".join(cell.split()) for cell in row] for row in Reader(page).rows]
    assert ["c_drag", "0.559", "[0.518, 0.599]", "kg/m"] in rows
    assert ["m_load", "260.0", "258.7", "[255.9, 261.5]", "kg", "vehicle with driver"] in rows
    assert ["load", "effort", "< 0.0001", "98 %"] in rows
    (velocity,) = (row for row in rows if row[:2] == ["velocity [m/s]", "coast_down_2"])
    error = next(e for e in coast_down_report().errors if e.channel == "velocity" and e.held_out)
    assert float(velocity[2]) == pytest.approx(error.simulation_before, rel=0.005)
    assert float(velocity[3].partition(" [")[0]) == pytest.approx(error.simulation_after, rel=0.005)
    assert velocity[4] == "−98 %"
    assert float(velocity[8]) == pytest.approx(0.05)


def test_the_page_says_nothing_of_the_machine_it_was_made_on(page: str) -> None:
    assert "/home" not in page and "/data/" not in page
    assert "bondgraph close-loop coast.py:car --data=coast_down_1.csv --holdout coast_down_2.csv" in page


@pytest.mark.usefixtures("undrawn")  # that a figure is rendered to the same text is tested with the figures
def test_the_same_data_give_the_same_page() -> None:
    assert report_html(coast_down_report()) == report_html(coast_down_report())


def test_parts_without_data_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(ReportData("car", "no missing effect", "All channels are white."), path)
    text = path.read_text(encoding="utf-8")
    assert "No missing effect" in text
    assert "<h2>" not in text and "<table" not in text and "<img" not in text
    Reader(text)


def test_names_from_outside_are_escaped() -> None:
    data = ReportData(
        "<script>alert(1)</script>",
        "unexplained residual",
        "a < b & c",
        errors=(ChannelError("run<1>", "v", "m/s", False, 1.0, 0.5, 2.0, 0.7),),
        alternatives=(Tried("<b>bold</b>", "x", 1.0, "5 < 6"),),
        made=Provenance("bondgraph close-loop car.py --set 'a<b'"),
    )
    text = report_html(data)
    assert "<script" not in text and "<b>" not in text and "run<1>" not in text
    assert "&lt;script&gt;" in text
    Reader(text)


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("bondgraph demo --seed 3 --out /tmp/x/demo", "bondgraph demo --seed 3 --out demo"),
        (r"bondgraph estimate C:\cars\model.py --data run.csv", "bondgraph estimate model.py --data run.csv"),
        ("bondgraph generate vehicle_graphs.baja:launch", "bondgraph generate vehicle_graphs.baja:launch"),
        ("bondgraph simulate cars/a.json --until 5", "bondgraph simulate cars/a.json --until 5"),
    ],
)
def test_commands_lose_absolute_folders(command: str, expected: str) -> None:
    assert without_folders(command) == expected


def test_a_filter_says_one_error_per_kind_and_shows_states_and_innovations() -> None:
    time = np.linspace(0.0, 1.0, 40)
    one = ChannelSeries("run", "v", "m/s", time, time, Prediction(one_step=time + 0.5), noise_std=0.1)
    band = StateBand("v", "m/s", time, time, 0.01 + 0.0 * time, time)
    data = ReportData(
        "car", "filtered", "NIS 1.1", errors=channel_errors([one]), series=(one,),
        filtered=(FilteredLog("run", (band,), (band,)),), subtitle="The model as a filter.",
    )  # fmt: skip
    text = report_html(data)
    rows = [[" ".join(cell.split()) for cell in row] for row in Reader(text).rows]
    assert rows[-2:] == [["channel", "log", "error", "sensor noise"], ["v [m/s]", "run", "0.500", "0.100"]]
    assert "The model as a filter." in text and "Error before" not in text
    assert text.count("<h2>States and innovations</h2>") == 1
    assert "<b>NIS</b>: square of the innovation" in text


def test_a_column_without_numbers_is_left_out_and_a_long_table_of_sizes_folded() -> None:
    """An estimate has no one-step error before it, and its table needed scrolling at 900 pixels for two of dashes."""
    row = ChannelError("run", "v", "m/s", False, math.nan, 0.2, 3.0, 0.3, noise_std=0.1)
    power = [Power(f"loss_{k}", f"part_{k % 3}", 1.0 + k, "N") for k in range(20)]
    hidden = [Power("blind", "part_0", math.inf, "N")]
    page = report_html(ReportData("car", "estimated", "One.\nTwo.", errors=(row,), power=(*hidden, *power)))
    rows = [[" ".join(cell.split()) for cell in one] for one in Reader(page).rows]
    assert ["channel", "log", "before", "after", "change", "after", "sensor noise"] in rows
    assert "<p>One.</p>" in page and "<p>Two.</p>" in page
    folded = page[page.index("<summary>11 more</summary>") :]
    assert "undetectable" in folded and "loss_<wbr>0<" not in folded
    assert text_of(power_table([*hidden, *power])).count("loss_") == 10
    assert "11 more in the report" in text_of(power_table([*hidden, *power]))


@pytest.mark.slow
def test_options_and_deviations_are_not_broken_between_lines() -> None:
    """On a phone a line ended with "--" and the next began with "refits"."""
    notes = ("grant more with --refits 24, or leave <others> out with --without: 47.1 ± 6.33 nats.",)
    page = report_html(replace(coast_down_report(), notes=notes))
    (note,) = re.findall(r'<p class="small">(grant.*)</p>', page)
    assert re.findall(r'<span class="whole">(.*?)</span>', note) == ["--refits", "--without", "47.1 ± 6.33"]
    assert re.sub(r"</?span[^>]*>", "", note) == notes[0].replace("<others>", "&lt;others&gt;")
    assert ".whole { white-space: nowrap; }" in page and '<tr class="groups"><th></th>' in page


def test_a_long_log_is_cut_into_stretches_that_show_every_sample() -> None:
    time = np.arange(2400.0)
    one = ChannelSeries("run", "v", "m/s", time, np.sin(time), Prediction(simulated=np.cos(time)))
    text = report_html(ReportData("car", "filtered", "", series=(one,)))
    assert [title for title in re.findall("<h3>([^<]*)</h3>", text) if "to" in title] == [
        "0 to 799 s", "800 to 1599 s", "1600 to 2399 s",
    ]  # fmt: skip
    short = replace(one, time=time[:900], measured=one.measured[:900], before=Prediction(simulated=np.cos(time[:900])))
    assert "stretches" not in report_html(ReportData("car", "filtered", "", series=(short,)))
