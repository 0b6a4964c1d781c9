"""The monitor of the tyres: parameters that change nothing until they do, and what it finds on a few drives."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bondgraph.build import build
from bondgraph.filter.detector import Detection
from bondgraph.filter.filter_model import FilterModel
from vehicle_graphs import radius_monitor
from vehicle_graphs.radius_monitor import CHANGES, Watched, drive_key, main, monitor, result, row, watch
from vehicle_graphs.ranger import full, monitored


def test_radii_of_the_axles_are_those_of_the_vehicle_times_their_gains() -> None:
    model = build(full()).model
    x = model.x0(forward_velocity=8.0, rear_axle_speed=26.0, front_axle_speed=25.6, engine_speed=300.0)
    both = model.theta(r_d=0.3)
    gains = model.theta(radius_gain_f=0.3 / 0.315, radius_gain_r=0.3 / 0.315)
    np.testing.assert_allclose(
        model.rhs(0.0, x, model.u0(), both), model.rhs(0.0, x, model.u0(), gains), rtol=1e-12, atol=1e-12
    )
    front = model.theta(radius_gain_f=0.94)
    moved = model.rhs(0.0, x, model.u0(), front) - model.rhs(0.0, x, model.u0(), model.theta())
    names = model.names("state")
    assert moved[names.index("front_axle_speed")] > 0.0  # a smaller wheel is behind the road, which turns it faster
    assert moved[names.index("rear_axle_speed")] == 0.0


def test_the_front_axle_is_read_beside_what_the_whole_vehicle_reads() -> None:
    assert [one.name for one in monitored().outputs] == [*(one.name for one in full().outputs), "front_axle_speed"]


def watched(change: str, alarm: str = "", delay: float = np.nan) -> Watched:
    """A drive of 6 s whose tyres change after 3 s, if they do."""
    ends = 6.0 if np.isnan(delay) else 3.0 + delay
    time = np.arange(0.0, ends + 0.01, 0.025)
    evidence = {name: np.linspace(0.0, 20.0 if name == alarm else 2.0, time.size) for name in CHANGES}
    return Watched(Detection("drive", time, evidence, 17.3, alarm, 3.0 + delay), 3.0 if change else np.nan)


def test_what_was_watched_is_kept_bit_for_bit() -> None:
    for one in (watched("front", "front", 0.1), watched("", "", np.nan)):
        content = one.to_dict()
        again = Watched.from_dict(json.loads(json.dumps(content)))
        assert json.dumps(again.to_dict()) == json.dumps(content)
        assert again.detection.evidence["rear"].dtype == np.float64 and again.is_false == one.is_false


def test_counts_and_hours_are_those_of_the_drives() -> None:
    found = {
        "": [watched(""), watched("", "rear", -1.0)],
        "front": [watched("front", "front", 0.1), watched("front", "both", 0.2), watched("front")],
    }
    values = result(found)
    assert values["changes"]["front"]["alarms"] == {"front": 1, "both": 1, "none": 1}
    assert values["changes"]["front"]["named"]["hits"] == 1 and values["changes"]["nothing"]["named"] is None
    assert values["false_alarms"] == values["changes"]["nothing"]["false_alarms"] == 1
    # 6 s and 2 s without a change, and 3 s before each of three
    assert values["hours_without_change"] * 3600.0 == pytest.approx(17.0)
    np.testing.assert_allclose(values["changes"]["front"]["delays"], [0.1])


def test_the_key_of_a_drive_is_of_all_that_its_answer_depends_on(monkeypatch: pytest.MonkeyPatch) -> None:
    model = monitor()
    keys = {
        drive_key(model, 1, 8.0, ""), drive_key(model, 2, 8.0, ""), drive_key(model, 1, 9.0, ""),
        drive_key(model, 1, 8.0, "front"),
    }  # fmt: skip
    assert drive_key(monitor(), 1, 8.0, "") in keys and len(keys) == 4
    monkeypatch.setattr(radius_monitor, "FALSE_ALARM_EVERY", 1.0)
    assert drive_key(model, 1, 8.0, "") not in keys


def test_the_command_reports_and_goes_on_with_finished_drives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    taken: list[tuple[int, str]] = []

    def simulated(_: FilterModel, seed: int, seconds: float, change: str) -> Watched:
        taken.append((seed, change))
        if len(taken) == 3:
            raise KeyboardInterrupt
        return watched(change, change, 0.1 * (seed + 1) if change else np.nan)

    monkeypatch.setattr(radius_monitor, "watch", simulated)
    given = ["--runs", "2", "--seconds", "6", "--changes", "front", "rear", "--out", str(tmp_path / "out")]
    assert main(given) == 130
    assert f"the same command goes on with what is in {tmp_path / 'out'}" in capsys.readouterr().err
    assert taken == [(0, ""), (1, ""), (0, "front")]
    assert main(given) == 0
    assert taken[3:] == [(0, "front"), (1, "front"), (0, "rear"), (1, "rear")]
    assert "rear" in capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for part in ("front: named in 2/2 = 100 %", "No false alarm", "What was named", "Evidence along a drive: rear"):
        assert part in page
    assert json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))["changes"]["rear"]["drives"] == 2
    assert main([*given, "--runs", "3"]) == 0
    assert taken[7:] == [(2, ""), (2, "front"), (2, "rear")]


def test_without_a_folder_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(radius_monitor, "watch", lambda *_: watched(""))
    assert main(["--runs", "1", "--changes"]) == 0
    assert "nothing" in capsys.readouterr().out and list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_falling_radius_is_named_and_nothing_else() -> None:
    model = monitor()
    for change in ("", *CHANGES):
        found = [watch(model, seed, 8.0, change) for seed in (1, 2)]
        name, drives, named, false, *_ = row(change, found)
        assert (name, drives, false) == (change or "nothing", "2", "0")
        assert named == ("2" if change else "0")
        assert all(one.delay < 0.5 for one in found if change)
