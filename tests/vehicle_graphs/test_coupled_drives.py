"""Coupled electric drives: graphs, counter laws, energy, the importer, and errors on the measured records."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from bondgraph.build import build
from bondgraph.data.log import Log
from bondgraph.data.matching import match
from bondgraph.data.read import read_log
from bondgraph.declare.graph import BondGraph
from bondgraph.errors import DataError, OptionError
from bondgraph.execute import open_executor
from bondgraph.simulate.simulation import simulate
from vehicle_graphs import correction_chain, coupled_drives, coupled_drives_logs
from vehicle_graphs.correction_chain import Bench, Machine, forward_selection, holdout_errors, table, tried

RECORDINGS = ("measured", "coupled_drives")


def simulated(graph: BondGraph, voltage: np.ndarray, **theta: float) -> np.ndarray:
    """Reading of the counter at 50 Hz from standstill."""
    time = np.arange(voltage.size) * 0.02
    run = simulate(build(graph).model, time, voltage[np.newaxis], theta, method="rk4", substeps=8)
    return run.output("pulse_rate")


def test_start_is_a_first_order_lag() -> None:
    rate = simulated(coupled_drives.start(), np.full(200, 2.0), torque_per_volt=3e-4, drive_drag=6e-4)
    time = np.arange(200) * 0.02
    assert_allclose(rate, 2.0 * 0.5 * (1 - np.exp(-6.0 * time)), atol=1e-6)


def test_rigid_pulley_leaves_one_state_and_adds_its_inertia() -> None:
    voltage = np.repeat([1.5, -0.7, 0.4], 50)
    model = build(coupled_drives.rigid()).model
    assert model.names("state") == ("omega_drives",)
    heavier = {"torque_per_volt": 4e-4 / 1.02, "drive_drag": 5e-4 / 1.02}
    assert_allclose(
        simulated(coupled_drives.rigid(), voltage), simulated(coupled_drives.start(), voltage, **heavier), atol=1e-9
    )


def test_counter_does_not_see_the_direction() -> None:
    voltage = np.repeat([1.5, -0.7, 0.4, -2.0], 50)
    for counter in ("absolute_counter", "squaring_counter"):
        graph = coupled_drives.declared((counter, "belt"))
        assert_allclose(simulated(graph, voltage), simulated(graph, -voltage), atol=1e-9)
        assert simulated(graph, voltage).min() >= 0.0


@pytest.mark.parametrize("name", [name for name in coupled_drives.EFFECTS if name not in ("belt", "absolute_counter")])
def test_every_effect_derives_on_top_of_the_belt(name: str) -> None:
    model = build(coupled_drives.declared(("belt", name))).model
    assert set(model.names("state")) >= {"omega_drives", "belt_stretch", "omega_pulley"}
    assert model.names("output") == ("pulse_rate",)


@pytest.mark.parametrize("names", [("cubic_drag",), ("absolute_counter", "squaring_counter"), ("belts",)])
def test_impossible_effects_are_refused(names: tuple[str, ...]) -> None:
    with pytest.raises(OptionError, match=r"cannot be declared together|did you mean 'belt'"):
        coupled_drives.declared(names)


def test_energy_of_free_drives_only_falls() -> None:
    model = build(coupled_drives.declared(("belt", "cubic_drag", "dry_friction"))).model
    theta = model.theta(pulley_cubic_drag=3.0, drive_friction=5e-5)
    start = {"omega_drives": 2.0, "omega_pulley": -3.0, "belt_stretch": 0.1}
    run = simulate(model, np.linspace(0.0, 2.0, 401), None, theta, start, rtol=1e-9)
    inertia = coupled_drives.DRIVE_INERTIA
    share, frequency = (theta[model.index("parameter", name)] for name in ("pulley_share", "belt_frequency"))
    drives, stretch, pulley = (run.state(name) for name in ("omega_drives", "belt_stretch", "omega_pulley"))
    energy = inertia * (drives**2 + share * (pulley**2 + frequency**2 * stretch**2)) / 2
    assert np.all(np.diff(energy) < 0) and energy[-1] < 0.2 * energy[0]


# ---------------------------------------------------------------------- importer


def write_records(folder: Path, samples: int = 500) -> None:
    for number, record in enumerate(coupled_drives_logs.RECORDS):
        time = np.arange(samples) * 0.02
        rows = pd.DataFrame({"t_s": time, "u_V": np.sin(time) + number, "y_ticks": np.arange(samples) / 100})
        rows.to_csv(folder / f"{record}.csv", index=False)


def test_importer_splits_as_published(tmp_path: Path) -> None:
    write_records(tmp_path)
    assert coupled_drives_logs.main([str(tmp_path), "--out", str(tmp_path / "logs")]) == 0
    train = read_log(tmp_path / "logs" / "uniform_high_train.csv")
    test = read_log(tmp_path / "logs" / "uniform_high_test.csv")
    assert len(train) == 400 and train.channel("pulse_rate").values[-1] == pytest.approx(3.99)
    assert len(test) == 500 and test.channel("pulse_rate").missing.sum() == 400
    assert test.channel("pulse_rate").values[400] == pytest.approx(4.0)
    assert not test.channel("voltage").missing.any()


def test_importer_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert coupled_drives_logs.main([str(tmp_path), "--out", str(tmp_path / "logs")]) == 2
    assert "uniform_low.csv: not found" in capsys.readouterr().err
    write_records(tmp_path, samples=450)
    with pytest.raises(DataError, match="450 samples - the published split is into 400 and 100"):
        coupled_drives_logs.read_records(tmp_path)
    (tmp_path / "uniform_low.csv").write_text("t_s,u_V,y_ticks\n0.0,1.0,x\n")
    with pytest.raises(DataError, match="row 2: y_ticks is 'x'"):
        coupled_drives_logs.read_records(tmp_path)
    (tmp_path / "uniform_low.csv").write_text("t_s,u_v,y_ticks\n0.0,1.0,2.0\n")
    with pytest.raises(DataError, match="no column 'u_V'; did you mean 'u_v'"):
        coupled_drives_logs.read_records(tmp_path)


# ---------------------------------------------------------------------- the chain


def simulated_records() -> list[Log]:
    """Two records of drives whose counter ignores the direction."""
    rng = np.random.default_rng(0)
    logs = []
    for name in ("one", "two"):
        voltage = np.repeat(rng.uniform(-2.0, 2.0, 25), 20)
        rate = simulated(coupled_drives.declared(("absolute_counter",)), voltage, torque_per_volt=3e-4)
        noisy = rate + 0.02 * rng.standard_normal(500)
        logs.append(coupled_drives_logs.record_logs(name, np.arange(500) * 0.02, voltage, noisy)["train"])
    return logs


def test_chain_finds_a_counter_that_ignores_the_direction_and_then_stops() -> None:
    effects = ("absolute_counter", "counter_bias")
    machine = Machine(coupled_drives.declared, effects, coupled_drives.possible)
    logs = simulated_records()
    steps = forward_selection(machine, logs, logs[:1])
    assert [step.chosen.effects for step in steps] == [(), ("absolute_counter",)]
    assert steps[1].chosen.values["torque_per_volt"] == pytest.approx(3e-4, rel=0.02)
    assert steps[1].chosen.unseen == pytest.approx(0.02, rel=0.1)
    assert "not counter_bias" in table(steps)


@pytest.mark.slow
def test_a_chain_keeps_finished_fits_and_goes_on_in_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, logs = Machine(coupled_drives.declared, ("absolute_counter", "counter_bias")), simulated_records()
    sets = [("absolute_counter",), ("counter_bias",)]
    first = Bench(folder=tmp_path).tried(machine, sets[:1], logs, {})
    assert len(list(tmp_path.iterdir())) == 1
    with open_executor("processes:2") as executor:
        there = Bench(executor, tmp_path).tried(machine, sets, logs, {})
    assert there[0] == first[0] and there[1] == tried(machine, sets[1], logs, {})

    def refused(*_: object) -> None:
        raise AssertionError("it was fitted before")

    monkeypatch.setattr(correction_chain, "tried", refused)
    assert Bench(folder=tmp_path).tried(machine, sets, logs, {}) == there
    with pytest.raises(AssertionError, match="fitted before"):
        Bench(folder=tmp_path).tried(machine, sets, logs[:1], {})


# ---------------------------------------------------------------------- measured records


def measured(folder: Path, graph: BondGraph, part: str, **theta: float) -> list[float]:
    """Root mean square errors of free simulation [1/s] on both records."""
    model = build(graph).model
    errors = []
    for name, log in coupled_drives_logs.read_records(folder).items():
        if name.endswith(f"_{part}.csv"):
            seen = match(log, model)
            run = simulate(model, seen.time, seen.u, theta, method="rk4", substeps=8)
            errors.append(float(np.sqrt(np.nanmean((run.y[0] - seen.y[0]) ** 2))))
    return errors


def test_corrected_drives_are_better_than_published_models(shared_data: Path) -> None:
    folder = shared_data.joinpath(*RECORDINGS)
    # best published test errors 0.115 and 0.074 (Champneys et al. 2024, arXiv 2405.10779); here 0.0795 and 0.0660
    low, high = measured(folder, coupled_drives.corrected(), "test")
    assert low < 0.085 and high < 0.071
    assert_allclose(measured(folder, coupled_drives.corrected(), "train"), [0.0781, 0.0962], atol=2e-3)
    first_order = {"torque_per_volt": 3.384e-4, "drive_drag": 3.713e-4}
    assert_allclose(measured(folder, coupled_drives.start(), "test", **first_order), [0.250, 0.388], atol=5e-3)


@pytest.mark.slow
def test_estimates_follow_from_the_training_records(shared_data: Path) -> None:
    logs = coupled_drives_logs.read_records(shared_data.joinpath(*RECORDINGS))
    train = [log for name, log in logs.items() if "train" in name]
    machine = Machine(coupled_drives.declared, tuple(coupled_drives.EFFECTS), coupled_drives.possible)
    fitted = tried(machine, coupled_drives.CHOSEN, train, coupled_drives.ESTIMATED)
    for name, value in coupled_drives.ESTIMATED.items():
        assert fitted.values[name] == pytest.approx(value, rel=0.05, abs=0.02)
    held_out = holdout_errors(machine, fitted, [log for name, log in logs.items() if "test" in name])
    assert max(held_out.values()) < 0.085
