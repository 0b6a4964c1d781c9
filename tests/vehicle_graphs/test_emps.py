"""EMPS: the declared carriage, the importer, force and open-loop errors on the measured records."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from bondgraph import effects
from bondgraph.build import build
from bondgraph.data.log import Log
from bondgraph.data.matching import match
from bondgraph.data.read import read_log
from bondgraph.declare.effect import effect_functions
from bondgraph.errors import DataError, OptionError
from bondgraph.simulate.simulation import simulate
from vehicle_graphs import emps, emps_chain, emps_logs, machine_effects

RECORDINGS = ("measured", "emps")


def test_start_settles_at_the_speed_of_viscous_friction() -> None:
    time = np.linspace(0.0, 5.0, 501)
    run = simulate(build(emps.start()).model, time, {"voltage": 2.0}, {"mass": 90.0, "viscous_friction": 200.0})
    assert run.state("v_carriage")[-1] == pytest.approx(2.0 * 35.15065 / 200.0, rel=1e-4)
    assert_allclose(np.gradient(run.output("position"), time)[1:-1], run.state("v_carriage")[1:-1], atol=5e-5)


def test_power_of_the_drive_goes_into_motion_and_friction() -> None:
    model = build(emps.declared(("coulomb_loss", "direction_dependent_drag"))).model
    theta = {"mass": 95.0, "viscous_friction": 200.0, "c_coulomb_loss_carriage": 20.0}
    theta["c_direction_dependent_drag_carriage"] = -40.0
    time = np.linspace(0.0, 1.0, 2001)
    run = simulate(model, time, {"voltage": 4.0}, theta, rtol=1e-10)
    v, width = run.state("v_carriage"), model.theta()[model.index("parameter", "w_coulomb_loss_carriage")]
    losses = 160.0 * v**2 + 20.0 * np.tanh(v / width) * v
    balance = 4.0 * 35.15065 * v - losses
    stored = 95.0 * v**2 / 2
    assert_allclose(stored[1:], np.cumsum(np.diff(time) * (balance[1:] + balance[:-1]) / 2), atol=1e-4)


def test_all_effects_of_the_chain_are_offered_by_the_modules_of_effects() -> None:
    offered = {function.__name__ for module in (effects, machine_effects) for function in effect_functions(module)}
    assert set(emps.EFFECTS) <= offered and set(emps.CHOSEN) <= set(emps.EFFECTS)
    assert len(emps.EFFECTS) == 12
    with pytest.raises(OptionError, match="did you mean 'coulomb_loss'"):
        emps.declared(["coulomb_los"])


def test_added_effects_vanish_at_their_declared_coefficients() -> None:
    plain, extended = build(emps.start()).model, build(emps.declared(emps.CHOSEN)).model
    states = np.array([[0.05, -0.1], [0.1, 0.2]])[[plain.index("state", name) for name in extended.names("state")]]
    inputs = np.array([1.5])
    assert_allclose(
        extended.rhs(3.0, states, inputs, extended.theta()), plain.rhs(3.0, states, inputs, plain.theta()), atol=1e-12
    )


# ---------------------------------------------------------------------- importer


def write_record(folder: Path, name: str, samples: int = 23) -> None:
    time = np.arange(samples) / 1000
    rows = pd.DataFrame({"t_s": time, "q_ref_m": time, "q_m": time / 10, "u_V": np.arange(samples) % 5, "force_N": 0.0})
    rows.to_csv(folder / f"{name}.csv.gz", index=False)


def test_importer_keeps_all_and_thins_with_the_same_impulse(tmp_path: Path) -> None:
    for name in emps_logs.RECORDS:
        write_record(tmp_path, name)
    assert emps_logs.main([str(tmp_path), "--out", str(tmp_path / "logs")]) == 0
    fast = read_log(tmp_path / "logs" / "train.csv.gz")
    slow = read_log(tmp_path / "logs" / "test_slow.csv")
    assert len(fast) == 23 and len(slow) == 4
    assert_allclose(slow.channel("voltage").numbers, 2.0)
    assert_allclose(slow.channel("position").numbers, np.arange(4) * 0.0005, atol=1e-12)
    assert match(fast, build(emps.start()).model).unmatched == ()


def test_importer_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert emps_logs.main([str(tmp_path), "--out", str(tmp_path / "logs")]) == 2
    assert "train.csv.gz: not found" in capsys.readouterr().err
    for name in emps_logs.RECORDS:
        write_record(tmp_path, name)
    (tmp_path / "test.csv.gz").write_bytes(b"no archive")
    with pytest.raises(DataError, match=r"test.csv.gz: is not a readable table"):
        emps_logs.read_records(tmp_path)


# ---------------------------------------------------------------------- errors


def simulated_record() -> Log:
    """Two seconds of a carriage with known parameters, driven to and fro."""
    model = build(emps.declared(("coulomb_loss",))).model
    time = np.arange(4000) / 1000
    voltage = 3.0 * np.sin(2 * np.pi * time / 1.3)
    theta = {"mass": 95.0, "viscous_friction": 200.0, "c_coulomb_loss_carriage": 20.0}
    run = simulate(model, time, voltage[np.newaxis], theta, method="rk4", substeps=2)
    return emps_logs.record_log("train", time, run.output("position"), voltage)


def test_errors_of_the_true_model_are_small_and_of_a_wrong_one_are_not() -> None:
    model, log = build(emps.declared(("coulomb_loss",))).model, simulated_record()
    truth = {"mass": 95.0, "viscous_friction": 200.0, "c_coulomb_loss_carriage": 20.0}
    right = emps_chain.errors(model, truth, log)
    wrong = emps_chain.errors(model, truth | {"mass": 100.0}, log)
    assert right.position < 0.05 and right.held_share < 1.0
    assert wrong.position > 1.0 and wrong.held_share > 2.0


def measured(folder: Path) -> dict[str, Log]:
    return emps_logs.read_records(folder.joinpath(*RECORDINGS))


def test_published_parameters_give_the_published_force_error(shared_data: Path) -> None:
    # Janot, Gautier, Brunot (2019): 4.083 % and 2.184 N on training, 5.982 % and 3.404 N on test
    model, logs = build(emps.declared(("coulomb_loss", "constant_effort"))).model, measured(shared_data)
    values = {"mass": 95.109, "viscous_friction": 203.5, "c_coulomb_loss_carriage": 20.39}
    values["load_constant_effort_carriage"] = -3.165
    share, std = emps_chain.force_error(model, values, match(logs["train.csv.gz"], model))
    assert share == pytest.approx(4.083, abs=0.15) and std == pytest.approx(2.184, abs=0.06)
    share, std = emps_chain.force_error(model, values, match(logs["test.csv.gz"], model))
    assert share == pytest.approx(5.982, abs=0.15) and std == pytest.approx(3.404, abs=0.06)


@pytest.mark.parametrize(
    ("friction", "train", "test"),
    [
        ({"viscous_friction": 203.5, "c_coulomb_loss_carriage": 20.39, "load_constant_effort_carriage": -3.165},
         5.4, 8.4),
        # 166.71 and 240.42 N s/m, 20.14 and 20.63 N by direction
        ({"viscous_friction": 203.565, "c_coulomb_loss_carriage": 20.385, "load_constant_effort_carriage": -0.245,
          "c_direction_dependent_drag_carriage": -36.855}, 2.9, 12.2),
    ],
)  # fmt: skip
def test_published_parameters_in_open_loop(
    shared_data: Path, friction: dict[str, float], train: float, test: float
) -> None:
    model = build(emps.declared(("coulomb_loss", "direction_dependent_drag", "constant_effort"))).model
    logs, values = measured(shared_data), {"mass": 95.109} | friction
    found = [
        emps_chain.position_error(model, values, match(logs[f"{part}.csv.gz"], model)) for part in emps_logs.RECORDS
    ]
    assert found == pytest.approx([train, test], abs=0.15)


def test_corrected_carriage_has_the_errors_that_are_claimed(shared_data: Path) -> None:
    model, logs = build(emps.corrected()).model, measured(shared_data)
    held_out = emps_chain.errors(model, emps.ESTIMATED, logs["test.csv.gz"])
    assert held_out.force_share < 5.5 and held_out.held_share < 3.45 and held_out.position < 5.4
    free = emps_chain.errors(model, emps.ESTIMATED_IN_FREE_SIMULATION, logs["test.csv.gz"])
    assert free.position < 5.2
    assert emps_chain.errors(model, emps.ESTIMATED_IN_FREE_SIMULATION, logs["train.csv.gz"]).position < 0.6


@pytest.mark.slow
def test_fits_on_the_training_record_give_the_estimates(shared_data: Path) -> None:
    built = build(emps.declared(emps.CHOSEN))
    log = match(measured(shared_data)["train_slow.csv"], built.model)
    one_step = emps_chain.one_step_fit(built, log, emps.ESTIMATED).values
    for name, value in emps.ESTIMATED.items():
        assert one_step[name] == pytest.approx(value, rel=0.02)
    free = emps_chain.free_simulation_fit(built, log, one_step)
    for name, value in emps.ESTIMATED_IN_FREE_SIMULATION.items():
        assert free[name] == pytest.approx(value, rel=0.05)
