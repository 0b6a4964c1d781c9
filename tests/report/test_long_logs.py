"""Reports of logs of a day: what is cut for memory changes no number that is reported."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.data import write
from bondgraph.data.log import Log, LogChannel, MatchedLog
from bondgraph.data.read import read_log
from bondgraph.data.write import csv_text, write_log
from bondgraph.errors import DataError
from bondgraph.estimate import setup
from bondgraph.estimate.setup import filter_setup
from bondgraph.filter import bands
from bondgraph.filter.filter_model import FilterModel
from bondgraph.report import comparison
from bondgraph.report.comparison import compare_logs, comparison_text, write_comparison
from bondgraph.report.filtering import filter_logs
from bondgraph.simulate.example import pendulum
from bondgraph.simulate.simulation import simulate


@functools.cache
def swing(samples: int = 400) -> MatchedLog:
    time = 0.05 * np.arange(samples)
    u = 0.5 * np.sin(0.7 * time)[np.newaxis]
    clean = simulate(pendulum(), time, u, {"length": 1.1}, {"angle": 0.4}).y
    return MatchedLog("swing", time, u, clean + 0.01 * np.random.default_rng(0).standard_normal(clean.shape))


@pytest.mark.usefixtures("undrawn")
def test_a_filter_report_is_the_same_in_parts_and_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texts = []
    for folder, part in ((tmp_path / "whole", 10**6), (tmp_path / "parts", 16)):
        monkeypatch.setattr(bands, "PART", part)
        filter_logs(pendulum(), ("rate",), [swing()], folder)
        texts.append([(folder / name).read_bytes() for name in ("swing_states.csv", "result.json", "swing_states.png")])
    assert texts[0] == texts[1]


def test_a_log_is_written_some_rows_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    time = 0.1 * np.arange(10)
    gears = LogChannel("gear", "text", np.array(["H", ""] * 5))
    log = Log("run", time, {"v": LogChannel("v", "m/s", np.where(time > 0.45, np.nan, time / 3.0)), "gear": gears})
    whole = csv_text(log)
    names = ("run.csv", "run.csv.gz")
    before = [write_log(tmp_path / name, log).read_bytes() for name in names]
    monkeypatch.setattr(write, "_ROWS", 3)
    assert csv_text(log) == whole and whole.count("\n") == 11
    assert [write_log(tmp_path / name, log).read_bytes() for name in names] == before
    for name in names:
        again = read_log(tmp_path / name)
        np.testing.assert_array_equal(again.channel("v").values, log.channel("v").values)
        assert again.channel("gear").values.tolist() == gears.values.tolist()


def test_a_file_whose_rows_cannot_be_written_leaves_what_stood_there(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("older")
    broken = Log("run", np.arange(3.0), {"v": LogChannel("v", "m/s", np.array([1.0, 2.0, 3.0]))})
    object.__setattr__(broken.channels["v"], "values", np.array([1.0, object(), 2.0], dtype=object))
    with pytest.raises((TypeError, ValueError, DataError)):
        write_log(path, broken)
    assert path.read_text() == "older" and list(tmp_path.iterdir()) == [path]


def test_steps_of_a_long_log_are_those_of_its_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    log = swing(2000)
    whole = filter_setup(pendulum(), ("rate",), [log])
    monkeypatch.setattr(setup, "_PIECES", 4)
    monkeypatch.setattr(setup, "_PIECE", 100)
    seen: list[int] = []
    own = setup.resolved

    def resolved(filter_model: FilterModel, logs: list[MatchedLog]) -> FilterModel:
        seen.extend(len(one) for one in logs)
        return own(filter_model, logs)

    monkeypatch.setattr(setup, "resolved", resolved)
    pieces = filter_setup(pendulum(), ("rate",), [log])
    assert seen == [100] * 4
    assert pieces.filter_model == whole.filter_model and pieces.noise == whole.noise
    short = replace(log, time=log.time[:300], u=log.u[:, :300], y=log.y[:, :300])
    seen.clear()
    filter_setup(pendulum(), ("rate",), [short])
    assert seen == [300]


def test_a_long_log_is_compared_by_fixed_steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    exact = compare_logs(pendulum(), [swing()])
    monkeypatch.setattr(comparison, "_LONG", 100)
    quick = compare_logs(pendulum(), [swing()])
    (one,), (other,) = exact.runs[0].errors, quick.runs[0].errors
    assert other.rms == pytest.approx(one.rms, rel=1e-3) and other.fit == pytest.approx(one.fit, rel=1e-3)
    assert exact.runs[0].steps == "" and "of rk4 between samples" in comparison_text(quick)
    write_comparison(quick, tmp_path)
    assert "of rk4 between samples" in (tmp_path / "result.json").read_text()
