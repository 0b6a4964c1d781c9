"""Filtering with the parameters and the levels of noise that an estimate or a closed loop has found."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.cli import main
from bondgraph.report.found import found_values

SLED = """
import bondgraph as bg
g = bg.BondGraph("sled")
body = g.one_junction("body", bg.TRANSLATION)
g.effort_source("push", g.input("force", "N", hold=True), at=body)
g.inertance("mass", g.parameter("m", 176.0, "lb", "", (100.0, 300.0)), at=body, state="v")
g.resistance("drag", g.parameter("d", 12.0, "N s/m", "", (2.0, 40.0)), at=body)
g.measure_flow("speed", body, unit="km/h")
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "pushed.py").write_text(SLED, encoding="utf-8")
    model = bg.build(str(tmp_path / "pushed.py"))
    for name, seed in (("run1", 1), ("run2", 2)):
        chance = np.random.default_rng(seed)
        time, force = 0.1 * np.arange(300), np.repeat(chance.uniform(0.0, 200.0, 12), 25)
        shown = bg.simulate(model, time, {"force": force}, theta={"m": 60.0}).to_dataframe()
        shown["speed [km/h]"] += chance.normal(0.0, 0.4, time.size)
        bg.write_log(tmp_path / f"{name}.csv", bg.Log.from_dataframe(shown[["force [N]", "speed [km/h]"]]))
    return tmp_path


def filtered(folder: Path, *options: str) -> float:
    """Negative log-likelihood of the second log."""
    made = [str(folder / "pushed.py"), "--data", str(folder / "run2.csv"), "--out", str(folder / "states")]
    assert main(["filter", *made, *options]) == 0
    return float(json.loads((folder / "states" / "result.json").read_text(encoding="utf-8"))["run2"]["nll"])


def test_a_filter_has_the_parameters_and_the_noise_of_an_estimate(folder: Path) -> None:
    """Noise that was guessed from a log alone made a filter contradict the correction that it came with."""
    fit = folder / "fit"
    made = [str(folder / "pushed.py"), "--data", str(folder / "run1.csv"), "--out", str(fit), "--method", "gradient"]
    assert main(["estimate", *made]) == 0
    values = found_values(fit)
    assert values["m"] == pytest.approx(60.0 / 0.45359237, rel=0.05)  # as declared, in pounds
    log = bg.read_log(folder / "run2.csv")
    model = bg.build(str(folder / "pushed.py"))
    known = bg.estimate(model, bg.read_log(folder / "run1.csv"), settings=bg.Settings(method="gradient"))
    theta = {name: known.values[name] for name in ("m", "d")}
    own = bg.filter_log(known.filter_model, log, theta=theta)
    told = filtered(folder, "--found", str(fit))
    assert told == pytest.approx(own.nll, abs=0.5)  # the uncertainty of the start is that of each log
    heavier = filtered(folder, "--found", str(fit), "--set", "m=300")
    assert heavier > told + 20.0  # what is set by hand holds


@pytest.mark.parametrize("content", ["", "{}", '{"parameters": {}}', '{"parameters": 3}', '{"run1": {"nll": 1}}'])
def test_a_folder_without_a_result_is_refused(folder: Path, content: str, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "odd").mkdir()
    if content:
        (folder / "odd" / "result.json").write_text(content, encoding="utf-8")
    options = ["--data", str(folder / "run2.csv"), "--found", str(folder / "odd"), "--out", str(folder / "states")]
    assert main(["filter", str(folder / "pushed.py"), *options]) == 2
    assert "name the folder that bondgraph estimate or close-loop wrote" in capsys.readouterr().err
    assert not (folder / "states").exists()
