"""The thesis' experiment: its logs, its resumption, its answer, and in the slow tests a small real run."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.errors import DataError
from bondgraph.estimate.recovery import Trial
from bondgraph.execute import open_executor
from vehicle_graphs import thesis
from vehicle_graphs.thesis import COAST_DOWN, DRIVELINE, VARIANTS, Study, Variant, draw_truth, main, run_study

#: The trial that an interrupted study has finished.
FIRST = ("coast_down", 0)


def made_up(variant: Variant, repetition: int, error: float = 0.0) -> Trial:
    """A trial whose estimates miss the truth by chance, and by an error in standard deviations on top."""
    rng = np.random.default_rng(repetition)
    truth = dict.fromkeys(variant.free, 1.0)
    values = {name: 1.0 + 0.1 * (rng.standard_normal() + error) for name in variant.free}
    intervals = {name: (value - 0.196, value + 0.196) for name, value in values.items()}
    return Trial(truth, values, dict.fromkeys(variant.free, 0.1), intervals, 1.0, 10, 0.1)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Made-up trials in place of simulations and estimations; the list says which were asked for."""
    asked: list[tuple[str, int]] = []

    def estimated(_: Study, variant: Variant, repetition: int) -> Trial:
        asked.append((variant.graph, repetition))
        return made_up(variant, repetition, 3.0 if "quasi" in variant.graph else 0.0)

    monkeypatch.setattr(Study, "_estimated", estimated)
    return asked


def test_true_values_surround_the_nominal_ones() -> None:
    model = thesis._model("coast_down")
    drawn = [draw_truth(model, COAST_DOWN, np.random.default_rng(seed)) for seed in range(40)]
    for name in COAST_DOWN:
        parameter = model.parameters[model.index("parameter", name)]
        values = np.array([truth[name] for truth in drawn])
        assert parameter.lower < values.min() < parameter.value < values.max() < parameter.upper


def test_the_runs_excite_what_is_estimated() -> None:
    rolling, braked = thesis.coast_downs(thesis._model("coast_down"), np.random.default_rng(1), short=False)
    row = thesis._model("coast_down").index("input", "brake")
    assert not rolling.u[row].any() and 0.05 < braked.u[row].max() < 0.6
    assert 0.02 < np.mean(braked.u[row] > 0.01) < 0.5


def test_every_drive_lifts_the_throttle_once() -> None:
    model = thesis._model("full")
    throttle, brake = (model.index("input", name) for name in ("throttle", "brake"))
    for seed in range(10):
        (drive,) = thesis.drives(model, np.random.default_rng(seed), short=False)
        assert drive.u[throttle].max() > 0.3 and drive.u[throttle, drive.time > 0.5].min() < 0.01
        assert not np.any((drive.u[brake] > 0.0) & (drive.u[throttle] > 0.05))


def test_the_search_fits_the_stage() -> None:
    coasting, driving = VARIANTS[0], VARIANTS[2]
    assert Study(Path())._settings(coasting).continuation == "none"
    assert Study(Path())._settings(driving).continuation == "process-noise"
    swarm = Study(Path(), method="pso")._settings(driving)
    assert swarm.method == "pso" and swarm.swarm.members * (1 + swarm.swarm.iterations) == 8080


@pytest.mark.rendered
def test_a_study_goes_on_where_it_stopped(tmp_path: Path, quick: list[tuple[str, int]]) -> None:
    run_study(Study(tmp_path, repetitions=3), ["coast-down"])
    assert len(quick) == 6
    found = run_study(Study(tmp_path, repetitions=5), ["coast-down"])
    assert quick[6:] == [(graph, n) for graph in ("coast_down", "coast_down_quasi_static") for n in (3, 4)]
    assert found["quasi-static suspension"].coverage < 0.5 < found["dynamic suspension"].coverage
    written = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert written["dynamic suspension"]["parameters"][0]["name"] == "f_r"
    assert (tmp_path / "recovery.png").stat().st_size > 10_000


def test_workers_finish_a_study_that_was_interrupted(
    tmp_path: Path, quick: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: Study, variant: Variant, repetition: int) -> Trial:
        if repetition == 1:
            raise KeyboardInterrupt
        return made_up(variant, repetition)

    options = ["--out", str(tmp_path), "--repetitions", "4"]
    with monkeypatch.context() as patched:
        patched.setattr(Study, "_estimated", interrupted)
        assert main(options) == 130
    assert "the same command goes on" in capsys.readouterr().err
    assert main([*options, "--executor", "threads:3"]) == 0
    assert sorted(quick) == [
        (graph, n) for graph in ("coast_down", "coast_down_quasi_static") for n in range(4) if (graph, n) != FIRST
    ]
    together = run_study(Study(tmp_path, repetitions=4), ["coast-down"])
    assert together == run_study(Study(tmp_path / "alone", repetitions=4), ["coast-down"])


def test_trials_of_another_study_are_not_mixed_in(tmp_path: Path, quick: list[tuple[str, int]]) -> None:
    study = Study(tmp_path, repetitions=2)
    run_study(study, ["coast-down"])
    with pytest.raises(DataError, match="take another folder or remove this one"):
        run_study(replace(study, seed=1), ["coast-down"])
    assert len(quick) == 4


def test_the_command_prints_a_table_per_variant(
    tmp_path: Path, quick: list[tuple[str, int]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--out", str(tmp_path), "--repetitions", "12", "--stage", "both"]) == 0
    text = capsys.readouterr().out
    assert [f"{variant.name}, 12 repetitions" in text for variant in VARIANTS] == [True] * 3
    quasi_static = text.split("quasi-static suspension")[1].split("full model")[0]
    assert quasi_static.count("biased") == len(COAST_DOWN)
    assert all(name in text for name in DRIVELINE) and len(DRIVELINE) == 8
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<h2>Quasi-static suspension</h2>" in page and page.count(">biased<") == text.count("biased")
    assert main(["--out", str(tmp_path), "--repetitions", "12", "--seed", "4"]) == 2
    assert "take another folder" in capsys.readouterr().err


@pytest.mark.slow
def test_a_short_study_recovers_what_short_runs_tell(tmp_path: Path) -> None:
    """Six seconds of rolling: the wheel radius and the brakes are found, and no interval is absurd."""
    found = run_study(Study(tmp_path, repetitions=3, short=True), ["coast-down"])["dynamic suspension"]
    assert not found.failures
    assert abs(found.parameter("r_d").mean_error) < 5e-4
    assert abs(found.parameter("brake_gain").mean_error) < 0.05
    assert found.coverage > 0.6


@pytest.mark.slow
def test_repetitions_in_processes_are_those_of_one_process(tmp_path: Path) -> None:
    due = [(VARIANTS[0], repetition) for repetition in range(3)]
    with open_executor("processes:2") as executor:
        there = Study(tmp_path / "there", short=True).trials(due, executor=executor)
    here = Study(tmp_path / "here", short=True).trials(due)
    untimed = [{one: replace(trial, seconds=0.0, cpu=None) for one, trial in found.items()} for found in (there, here)]
    assert untimed[0] == untimed[1] and len(there) == 3


@pytest.mark.slow
def test_a_short_drive_tells_the_driveline_from_nominal_values(tmp_path: Path) -> None:
    """Eight parameters, up to 12 % off: the likelihood of the truth is reached, and no step size matters."""
    trial = Study(tmp_path, short=True).trial(VARIANTS[2], 0)
    assert not trial.failure
    assert trial.nll_at_truth is not None and trial.nll_at_truth - 15.0 < trial.nll < trial.nll_at_truth
    assert trial.shift is not None and trial.shift < 0.1
    for name, truth in trial.truth.items():
        assert abs(trial.values[name] - truth) < 4.0 * trial.std[name] or np.isnan(trial.std[name])
    assert trial.std["T_pk"] < 0.01 * trial.truth["T_pk"]
