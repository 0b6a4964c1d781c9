"""Reports of the chains: what a chain found, in the toolkit's own page, and going on from kept fits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from bondgraph.build import build
from bondgraph.data.log import Log, LogChannel
from bondgraph.estimate.journal import Journal
from bondgraph.report.html import rewrite_report
from bondgraph.simulate.simulation import simulate
from vehicle_graphs import coupled_drives, emps, emps_chain, emps_logs, i3, i3_chain
from vehicle_graphs.chain_reports import Command
from vehicle_graphs.correction_chain import Machine, chain_command, forward_selection, selection_report
from vehicle_graphs.coupled_drives_logs import record_logs
from vehicle_graphs.kept_fits import fit_key


def _records(_: Path) -> tuple[list[Log], list[Log]]:
    """Two records of drives whose counter ignores the direction, and a third one held out."""
    chance = np.random.default_rng(0)
    model = build(coupled_drives.declared(("absolute_counter",))).model
    logs = []
    for name in ("one", "two", "three"):
        voltage = np.repeat(chance.uniform(-2.0, 2.0, 25), 20)
        time = np.arange(voltage.size) * 0.02
        run = simulate(model, time, voltage[np.newaxis], {"torque_per_volt": 3e-4}, method="rk4", substeps=8)
        rate = run.output("pulse_rate") + 0.02 * chance.standard_normal(time.size)
        logs.append(record_logs(name, time, voltage, rate)["train"])
    return logs[:2], logs[2:]


def test_a_forward_selection_writes_the_report_of_what_it_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = Machine(coupled_drives.declared, ("absolute_counter", "counter_bias"), coupled_drives.possible)
    arguments = ["logs", "--out", str(tmp_path)]
    assert chain_command("coupled_drives_chain", "A chain.", machine, _records, arguments) == 0
    assert f"report: {tmp_path / 'report.html'}" in capsys.readouterr().out
    page = (tmp_path / "report.html").read_text(encoding="utf-8").replace("<wbr>", "")
    assert "Added one by one: absolute_counter." in page and "python -m vehicle_graphs.coupled_drives_chain" in page
    for part in ("Error before and after", "Every decision", "Parameters", "The bond graph", "How this was made"):
        assert f"<h2>{part}</h2>" in page
    assert "counter_bias" in page and "error on unseen training logs" in page and 'class="tag">held out' in page
    noted = (tmp_path / "fits.json").read_bytes()
    assert chain_command("coupled_drives_chain", "A chain.", machine, _records, arguments) == 0
    assert (tmp_path / "fits.json").read_bytes() == noted
    again = rewrite_report(tmp_path).read_text(encoding="utf-8").replace("<wbr>", "")
    assert again.count("absolute_counter") > 1


def test_the_report_of_a_selection_holds_the_truth(tmp_path: Path) -> None:
    machine = Machine(coupled_drives.declared, ("absolute_counter",), coupled_drives.possible)
    logs = _records(tmp_path)
    steps = forward_selection(machine, *logs)
    data = selection_report("drives", machine, steps, logs, Command("coupled_drives_chain", ["logs"]).made(*logs))
    assert [(one.log, one.held_out) for one in data.errors] == [
        ("one_train", False), ("two_train", False), ("three_train", True),
    ]  # fmt: skip
    for row in data.errors:
        assert row.simulation_before > 0.1 and row.simulation_after == pytest.approx(0.02, rel=0.15)
    torque = next(one for one in data.parameters if one.name == "torque_per_volt")
    assert torque.ci95[0] < 3e-4 < torque.ci95[1] and torque.ci95[1] - torque.ci95[0] < 0.05 * 3e-4
    assert [one.what for one in data.history] == ["absolute_counter"]


def _trips(count: int, seed: int) -> list[Log]:
    """Trips of a car with air drag, at 10 Hz: speeds of all sizes, the torque that each needs for its acceleration."""
    model = build(i3.declared(("air_drag",))).model
    truth = model.theta(mass=1400.0, rolling_coefficient=0.011, c_quadratic_loss_body=0.4)
    chance, logs = np.random.default_rng(seed), []
    for number in range(count):
        time = np.arange(600) / 10.0
        speed, torque = chance.uniform(2.0, 35.0, 600), chance.uniform(-40.0, 150.0, 600)
        inputs = np.array([torque, np.zeros(600), np.full(600, 290.0), np.ones(600)])
        reading = model.output(0.0, speed[np.newaxis], inputs, truth)[1] + 0.05 * chance.standard_normal(600)
        columns = {info.name: (info.unit, row) for info, row in zip(model.inputs, inputs, strict=True)}
        columns |= {info.name: (info.unit, row) for info, row in zip(model.outputs, (speed, reading), strict=True)}
        channels = {name: LogChannel(name, unit, row) for name, (unit, row) in columns.items()}
        logs.append(Log(f"trip{number}", time, channels))
    return logs


def test_a_regression_chain_goes_on_and_its_intervals_hold_the_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    train, holdout = _trips(10, 0), _trips(2, 1)
    monkeypatch.setattr(i3, "EFFECTS", {name: i3.EFFECTS[name] for name in ("air_drag", "gear_loss")})
    steps, tried = i3_chain.chain(train, holdout, i3_chain.Bench(folder=tmp_path))
    assert [step.effects for step in steps] == [(), ("air_drag",)]
    assert [one.effects[-1] for one in tried] == ["gear_loss"]
    truth = {"mass": 1400.0, "rolling_coefficient": 0.011, "c_quadratic_loss_body": 0.4}
    for name, value in truth.items():
        low, high = steps[-1].ci95[name]
        assert low < value < high and high - low < 0.5 * value
    capsys.readouterr()

    def refused(*_: object) -> None:
        raise AssertionError("it was fitted before")

    monkeypatch.setattr(i3_chain, "balance", refused)
    again, _ = i3_chain.chain(train, holdout, i3_chain.Bench(folder=tmp_path))
    assert [(one.effects, one.values, one.std) for one in again] == [
        (one.effects, one.values, one.std) for one in steps
    ]
    sections = {section.title: section for section in i3_chain.report_sections(steps, tried, train, holdout)}
    assert [row[:2] for row in sections["Error before and after"].rows] == [
        ["as declared", "training"], ["as declared", "held out"], ["air_drag", "training"], ["air_drag", "held out"],
    ]  # fmt: skip
    assert [row[0] for row in sections["Parameters"].rows] == list(truth)


def test_the_carriage_goes_on_where_it_stopped_and_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = build(emps.declared(("coulomb_loss",))).model
    time = np.arange(4000) / 1000
    voltage = 3.0 * np.sin(2.0 * np.pi * time / 1.3)
    theta = {"mass": 95.0, "viscous_friction": 200.0, "c_coulomb_loss_carriage": 20.0}
    run = simulate(model, time, voltage[np.newaxis], theta, method="rk4", substeps=2)
    fast = emps_logs.record_log("train", time, run.output("position"), voltage)
    logs = {"train": fast, "test": fast}
    found = {(): {"mass": 90.0, "viscous_friction": 240.0}, ("coulomb_loss",): theta}
    fitted: list[tuple[str, ...]] = []

    class Made:
        def __init__(self, values: dict[str, float]) -> None:
            self.values = values

    def one_step_fit(built: object, log: object, start: object) -> Made:
        names = ("coulomb_loss",) if "c_coulomb_loss_carriage" in built.model.names("parameter") else ()  # type: ignore[attr-defined]
        fitted.append(names)
        return Made(found[names])

    monkeypatch.setattr(emps_chain, "one_step_fit", one_step_fit)
    monkeypatch.setattr(emps_chain, "free_run_fit", one_step_fit)
    monkeypatch.setattr(emps_chain, "intervals", lambda fit: {"mass": (fit.values["mass"] - 1, fit.values["mass"] + 1)})
    monkeypatch.setattr(emps_chain, "held", lambda fit: ())

    def steps() -> list[emps_chain.ChainStep]:
        first = emps_chain.chain_step((), fast, {}, Journal(tmp_path))
        return [first, emps_chain.chain_step(("coulomb_loss",), fast, first.one_step, Journal(tmp_path))]

    told = steps()
    assert len(fitted) == 4 and steps() == told and len(fitted) == 4
    data = emps_chain.emps_report(told, logs, Command("emps_chain", ["logs"]).made([fast], [fast]))
    before, after = data.errors[0].simulation_before, data.errors[0].simulation_after
    assert after < 1e-4 < 1e-3 < before and data.errors[0].channel == "position"
    mass = next(one for one in data.parameters if one.name == "mass")
    assert (mass.before, mass.after, mass.ci95) == (90.0, 95.0, (94.0, 96.0))
    assert data.added and "open-loop position, train" in data.history[0].why


def test_a_fit_is_known_by_all_that_it_depends_on() -> None:
    def log(name: str, values: Sequence[float]) -> Log:
        column = LogChannel("v", "m/s", np.array(values))
        return Log(name, np.arange(2.0), {"v": column})

    keys = {
        fit_key("x", {}, [log("run", [1.0, 2.0])]), fit_key("y", {}, [log("run", [1.0, 2.0])]),
        fit_key("x", {"m": 1.0}, [log("run", [1.0, 2.0])]), fit_key("x", {}, [log("run", [1.0, 2.5])]),
        fit_key("x", {}, [log("other", [1.0, 2.0])]), fit_key("x", {}, []),
    }  # fmt: skip
    assert len(keys) == 6 and fit_key("x", {}, [log("run", [1.0, 2.0])]) in keys
