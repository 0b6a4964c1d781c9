"""Continuation in process noise: arrives where a plain search does not, and changes nothing but the way."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.cli import main
from bondgraph.data.log import Log, LogChannel, MatchedLog
from bondgraph.data.write import write_log
from bondgraph.errors import OptionError
from bondgraph.estimate.checkpoint import FILE
from bondgraph.estimate.continuation import SCALES, way
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.objective import SearchOutcome, TraceRow
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.solvers.particle_swarm import SwarmSettings
from bondgraph.filter.draw import draw_logs
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.example import PENDULUM, pendulum

PLAIN = Settings(method="gradient", starts=1, certify="none")
CONTINUED = replace(PLAIN, continuation="process-noise")
GRAVITY = 9.81


@pytest.fixture(scope="module")
def swing() -> FilterModel:
    return FilterModel(pendulum(), {}, {"deflection": 0.02}, {"angle": 0.02, "rate": 0.02}, substeps=2)


@pytest.fixture(scope="module")
def log(swing: FilterModel) -> MatchedLog:
    """Fifteen periods without drag: who is a tenth off in gravity is out of step long before the end."""
    time = np.arange(600) * 0.05
    pattern = MatchedLog("swing", time, np.zeros((1, 600)), np.zeros((1, 600)), {"damping": 0.0})
    return draw_logs(swing, pattern, 1, seed=1).logs[0]


def swinging(swing: FilterModel, log: MatchedLog, start: float, **prior: float) -> EstimationProblem:
    return pose(swing, log, [FreeParameter("gravity", 5.0, 20.0, start, **prior)], initial=({"angle": 0.5},))


@pytest.mark.parametrize("start", [6.0, 7.5, 11.5, 16.0])
def test_it_arrives_where_the_plain_search_ends_elsewhere(swing: FilterModel, log: MatchedLog, start: float) -> None:
    problem = swinging(swing, log, start)
    plain, continued = estimate(problem, PLAIN), estimate(problem, CONTINUED)
    assert abs(plain.values["gravity"] - GRAVITY) > 1.0 and plain.way == ()
    assert continued.outcome is SearchOutcome.CONVERGED
    assert continued.values["gravity"] == pytest.approx(GRAVITY, abs=3.0 * continued.std["gravity"])
    assert continued.nll < plain.nll - 1e4
    scales = [stage.scale for stage in continued.way]
    assert scales[0] == 1.0 and scales == sorted(scales, reverse=True) and set(scales) < set(SCALES)


def test_the_end_is_that_of_the_declared_problem(swing: FilterModel, log: MatchedLog) -> None:
    near, far = swinging(swing, log, 9.7), swinging(swing, log, 12.0)
    plain, continued = estimate(near, PLAIN), estimate(far, CONTINUED)
    assert continued.nll == pytest.approx(plain.nll, abs=1e-6)
    assert continued.std["gravity"] == pytest.approx(plain.std["gravity"], rel=1e-3)
    assert continued.filter_model.process_noise == {}
    assert {row.stage for row in continued.trace} == {"gauss-newton"}
    written = continued.to_dict()
    assert written["continuation"][0]["scale"] == 1.0 and plain.to_dict()["continuation"] == []
    spent = sum(stage.evaluations for stage in continued.way)
    assert continued.trace[0].evaluations > spent > 0


def test_at_the_optimum_there_is_nothing_to_lead_through(swing: FilterModel, log: MatchedLog) -> None:
    optimum = estimate(swinging(swing, log, 9.8), PLAIN).values["gravity"]
    assert estimate(swinging(swing, log, optimum), CONTINUED).way == ()


def test_noise_stands_for_what_the_parameters_leave_open(swing: FilterModel, log: MatchedLog) -> None:
    ((angle, rate),) = way(swinging(swing, log, 9.81)).noise
    # A rate goes astray by d(gravity) sin(angle) / length in a second; gravity is uniform within 15 m/s^2.
    deflection = np.sqrt(np.mean(log.y**2))
    assert rate == pytest.approx(15.0 / np.sqrt(12.0) * deflection * np.sqrt(0.05), rel=0.1)
    assert angle == pytest.approx(0.5 * 0.05 * rate, rel=0.1)
    known = way(swinging(swing, log, 9.81, prior_mean=9.81, prior_std=0.1))
    assert known.noise[0][1] == pytest.approx(rate * 0.1 * np.sqrt(12.0) / 15.0, rel=0.05)
    assert known.at(0.0) is known.problem
    assert known.at(0.5).filter_model.process_noise["rate"] == pytest.approx(0.5 * known.noise[0][1])


def test_what_moves_no_state_adds_no_noise(swing: FilterModel, log: MatchedLog) -> None:
    level = pose(swing, log, ["std(deflection)", "x0(angle)"], initial=({"angle": 0.5},))
    assert way(level).noise[0].tolist() == [0.0, 0.0]


def test_many_starts_come_together(swing: FilterModel, log: MatchedLog) -> None:
    swarm = SwarmSettings(members=6, iterations=1)
    for settings in (replace(CONTINUED, starts=4), replace(CONTINUED, method="both", swarm=swarm)):
        found = estimate(swinging(swing, log, 6.0), settings)
        assert found.values["gravity"] == pytest.approx(GRAVITY, abs=3.0 * found.std["gravity"])
        assert sum(optimum.starts for optimum in found.optima) < 4


class Interruption:
    """Ctrl-C at one iteration of one stage."""

    def __init__(self, stage: str, iteration: int) -> None:
        self.at = (stage, iteration)

    def __call__(self, row: TraceRow) -> None:
        if (row.stage, row.iteration) == self.at:
            raise KeyboardInterrupt


@pytest.mark.parametrize("stage", ["continuation 1", "continuation 2", "gauss-newton"])
def test_it_goes_on_where_it_was_interrupted(swing: FilterModel, log: MatchedLog, tmp_path: Path, stage: str) -> None:
    problem = swinging(swing, log, 12.0)
    whole = estimate(problem, CONTINUED)
    cut = estimate(problem, CONTINUED, folder=tmp_path, progress=Interruption(stage, 1))
    assert cut.outcome is SearchOutcome.INTERRUPTED and np.isfinite(cut.nll)
    assert (tmp_path / FILE).is_file()
    resumed = estimate(problem, CONTINUED, folder=tmp_path, resume=True)
    assert resumed.point.tolist() == whole.point.tolist()
    assert (resumed.way, resumed.evaluations) == (whole.way, whole.evaluations)


def test_settings_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(OptionError, match=r"continuation 'noise' is not known.* - choose none, process-noise"):
        Settings(continuation="noise")  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="pso alone has none"):
        Settings(method="pso", continuation="process-noise")


def test_the_command_leads_there(log: MatchedLog, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = tmp_path / "swing.py"
    bounded = PENDULUM.replace('9.81, None, None, "standard value"', '12.0, 5.0, 20.0, "to be found"')
    model.write_text(bounded.replace('"1/s", 0.1, 0.0, 2.0', '"1/s", 0.0, None, None'), encoding="utf-8")
    channels = {"deflection": LogChannel("deflection", "m", log.y[0])}
    data = write_log(tmp_path / "run.csv", Log("run", log.time, channels))
    command = ["estimate", str(model), "--data", str(data), "--free", "gravity", "--process-noise", "none"]
    command += ["--start", "model", "--method", "gradient", "--continuation", "process-noise", "--set", "drive=0"]
    assert main([*command, "--out", str(tmp_path / "fit")]) == 0
    assert "converged" in capsys.readouterr().out
    written = json.loads((tmp_path / "fit" / "result.json").read_text(encoding="utf-8"))
    assert written["parameters"]["gravity"]["value"] == pytest.approx(GRAVITY, rel=1e-3)
    assert written["continuation"][0]["evaluations"] > 0
