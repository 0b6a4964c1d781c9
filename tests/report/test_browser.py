"""Reports in a browser at the widths of a phone, half a screen and a screen: nothing overflows or is complained of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.cli import main
from bondgraph.report.html import write_report
from tests.report.browser import CHROMIUM, SCHEMES, WIDTHS, Seen, look
from tests.report.examples import coast_down_report

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium or chrome, which is no package of Python"),
]


def _good(seen: Seen) -> None:
    where = f"{seen.width} pixels, {seen.scheme}"
    assert (seen.page, seen.outside) == (seen.width, ()), where
    assert seen.faint == (), where
    assert seen.complaints == (), where
    assert [width for width in seen.pictures if not 0 < width <= seen.width] == [], where


@pytest.fixture(scope="module")
def sled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the machine that ``bondgraph new`` begins, and its logs."""
    folder = tmp_path_factory.mktemp("sled")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["new", "sled"]) == 0
    return folder / "sled"


def test_a_closed_loop_is_read_at_every_width_and_in_the_dark(tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    write_report(coast_down_report(), page)
    seen = look(page)
    assert [(one.width, one.scheme) for one in seen] == [(w, s) for w in WIDTHS for s in SCHEMES]
    for one in seen:
        _good(one)


@pytest.mark.parametrize(
    "command",
    [
        ["filter", "--smooth"],
        ["estimate", "--free", "mass", "drag", "--profile"],
        ["sensitivity"],
    ],
    ids=lambda command: command[0],
)
def test_the_report_of_a_command_is_read_at_every_width_and_in_the_dark(
    sled: Path, tmp_path: Path, command: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(sled)
    assert main([command[0], "sled.py", "--data", "run1.csv", *command[1:], "--out", str(tmp_path / "out")]) == 0
    for one in look(tmp_path / "out" / "report.html"):
        _good(one)


def test_long_names_and_many_logs_do_not_overflow(tmp_path: Path) -> None:
    data = coast_down_report()
    name = "velocity_of_the_body_in_the_frame_of_the_road_at_the_left_rear_wheel"
    errors = tuple(replace(row, channel=name, log="a_log_with_a_name_that_has_no_end_" * 3) for row in data.errors)
    parameters = tuple(replace(row, name=name, meaning="m" * 120) for row in data.parameters)
    command = None if data.made is None else replace(data.made, command="bondgraph close-loop " + "x" * 400)
    page = tmp_path / "report.html"
    notes = ("n" * 200,)
    write_report(replace(data, errors=errors, parameters=parameters, made=command, notes=notes, title=name), page)
    for one in look(page):
        _good(one)


def test_errors_of_a_vehicle_are_read_without_scrolling(tmp_path: Path) -> None:
    """The table of errors ran out of its place on half a screen, where channels had names such as those of a car."""
    data = coast_down_report()
    names = {"velocity": ("longitudinal_acceleration", "m/s^2"), "wheel_speed": ("rear_left_wheel_speed", "rad/s")}
    errors = tuple(
        replace(
            row, channel=names[row.channel][0], unit=names[row.channel][1], log="mixed_cycle_recorded_1",
            simulation_before=1e4 * row.simulation_before, simulation_ci95=(0.0491, 0.0532),
            one_step_ci95=(0.0491, 0.0532),
        )
        for row in data.errors
    )  # fmt: skip
    page = tmp_path / "report.html"
    write_report(replace(data, errors=errors, series=()), page)
    for one in look(page, (400, 660, 800, 1000, 1600), ["light"]):
        _good(one)
        assert one.scrolled == (), one.width


def test_what_overflows_fails_or_is_faint_is_found(tmp_path: Path) -> None:
    page = tmp_path / "bad.html"
    page.write_text(
        '<!DOCTYPE html><body style="margin: 0"><p class="wide" style="width: 900px">wide</p>'
        '<p class="pale" style="color: #ccc">pale</p><img src="missing.png"><script>undefined_name()</script></body>'
    )
    (seen,) = look(page, [400], ["light"])
    assert seen.page == 900 and seen.outside == ("p.wide: wide",)
    assert [text.partition(" ")[2] for text in seen.faint] == ["pale: pale"]
    assert len(seen.complaints) >= 2
    assert np.any(["Uncaught" in text for text in seen.complaints])
