"""The recorded runs of the Ranger: found parameters make the filter consistent, and the command goes all the way."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path

import pytest

from bondgraph.build import build
from bondgraph.declare.editing import with_values
from bondgraph.errors import DataError
from bondgraph.estimate.initial import initial_states
from bondgraph.filter.consistency import Consistency, consistency
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.runs import run
from vehicle_graphs import ranger
from vehicle_graphs.ranger_filters import NOISE
from vehicle_graphs.ranger_recorded import main, read_runs
from vehicle_graphs.thesis import COAST_DOWN, DRIVELINE

#: What ``python -m vehicle_graphs.ranger_recorded`` finds from the recorded runs, and the random walk of the road.
FOUND = {
    "f_r": 0.042474, "CdA": 1.6182, "brake_gain": 0.9019, "th_off": 0.014872, "r_d": 0.29902, "spring_gain": 1.0468,
    "T_pk": 66.037, "T_f0": 4.8084, "k_u": 4.1968, "m_fw": 0.16305, "F_p0": 167.85, "k_p": 23572.0, "r_h": 0.049207,
    "mu_b": 0.45846,
}  # fmt: skip
ROAD = 0.0113


def full_filter(values: dict[str, float]) -> FilterModel:
    declared = NOISE["ranger_full"].filter_model(build(with_values(ranger.full(), values)).model)
    return replace(declared, process_noise={"inclination": ROAD})


def on_drive(shared_data: Path, values: dict[str, float], start: float, end: float) -> Consistency:
    """Consistency on a part of the first drive, from a standstill."""
    filter_model = full_filter(values)
    log = read_runs(shared_data / "ranger_logs", "drive_1.csv", filter_model)[0]
    part = log.rows((log.time >= start) & (log.time < end))
    model = filter_model.model
    (x0,) = initial_states(model, [part], model.theta(), "settled")
    return consistency(run(filter_model, part, x0=x0).raise_if_failed())


@pytest.mark.slow
def test_a_drive_is_consistent_with_what_was_found(shared_data: Path) -> None:
    """Within the bands widened to three standard deviations, on half a minute that no estimate has seen."""
    found = on_drive(shared_data, FOUND, 36.75, 66.0)
    for channel in found.channels:
        assert abs(channel.nis_mean - 1.0) < 3.0 / 1.96 * (channel.nis_band[1] - 1.0), channel
    half = {name: value for name, value in FOUND.items() if name in COAST_DOWN}
    assert on_drive(shared_data, half, 36.75, 45.0).nis_mean > 10.0
    assert set(FOUND) == {*COAST_DOWN, *DRIVELINE}


@pytest.mark.slow
@pytest.mark.rendered
def test_the_command_goes_through_all_stages(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A few seconds of a coast-down and of a start at full throttle tell something already."""
    for name in ("coast_down_1.csv", "drive_2.csv"):
        with (shared_data / "ranger_logs" / name).open(encoding="utf-8") as lines:
            (tmp_path / name).write_text("".join(itertools.islice(lines, 1 + 40 * 8)), encoding="utf-8")
    assert main([str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "process(inclination)" in told and "drive_2: NIS" in told
    written = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert written["coasting"]["parameters"]["r_d"]["value"] == pytest.approx(FOUND["r_d"], rel=0.01)
    assert written["driving"]["parameters"]["T_pk"]["value"] == pytest.approx(FOUND["T_pk"], rel=0.02)
    assert written["driving"]["continuation"][0]["scale"] == 1.0
    assert (tmp_path / "out" / "drive_2.png").stat().st_size > 50_000
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "<h2>Coast-downs</h2>" in page and "<h2>drive_2</h2>" in page and "process(inclination)" in page
    assert (tmp_path / "out" / "coast-downs" / "report.html").is_file()
    assert main([str(tmp_path), "--out", str(tmp_path / "out"), "--resume"]) == 0
    again = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    for stage in ("coasting", "driving"):
        assert again[stage]["parameters"] == written[stage]["parameters"]
        assert again[stage]["evaluations"] == written[stage]["evaluations"]


def test_a_folder_without_runs_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DataError, match="give the folder of the recorded runs"):
        read_runs(tmp_path, "drive_*.csv", full_filter({}))
    assert main([str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "holds no coast_down_*.csv" in capsys.readouterr().err
