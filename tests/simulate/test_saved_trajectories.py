"""Trajectories go to files whole and come back the same; what saves also loads, in every room."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.documentation.reference import ROOMS, exported_names
from bondgraph.errors import OptionError
from bondgraph.simulate.batch import simulate_batch
from bondgraph.simulate.example import pendulum
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.trajectory import BatchTrajectory, Trajectory
from tests.estimate.test_saved import SWING, log, same


def block(smooth: bool) -> bg.Model:
    """A block that a dry floor stops, declared in pounds."""
    g = bg.BondGraph("block")
    body = g.one_junction("body", bg.TRANSLATION)
    g.inertance("mass", g.parameter("mass", 176.0, "lb"), at=body, initial=2.0, state="v")
    width = g.parameter("width", 0.01, "m/s")
    bg.friction(g, "floor", g.parameter("F_floor", 30.0, "N"), width=width, at=body)
    g.measure_flow("speed", body)
    return bg.build(g, smooth=smooth)


def overflowing() -> Trajectory:
    """A run that ends before its last time."""
    g = bg.BondGraph("runaway")
    body = g.one_junction("body", bg.TRANSLATION)
    g.inertance("mass", 1.0, at=body, initial=2.0, state="v")
    g.resistance("push", lambda v: -(v**3), at=body)
    return bg.simulate(bg.build(g), np.linspace(0.0, 1.0, 21))


RUNS: dict[str, Callable[[], Trajectory]] = {
    "smooth": lambda: bg.simulate(block(smooth=True), np.linspace(0.0, 8.0, 81)),
    "with events": lambda: bg.simulate(block(smooth=False), np.linspace(0.0, 8.0, 81)),
    "ended": overflowing,
}


@pytest.mark.parametrize("name", RUNS)
def test_a_trajectory_comes_back_with_its_model(name: str, tmp_path: Path) -> None:
    run = RUNS[name]()
    again = Trajectory.load(run.save(tmp_path / "run.npz"))
    assert same(again, run) and again.model.text == run.model.text
    assert again.summary() == run.summary() and again.end == run.end and again.events == run.events
    assert (name == "with events") == bool(run.events) and (name == "ended") == (run.outcome is not Outcome.OK)
    further = bg.simulate(again.model, run.time)
    assert np.array_equal(further.x, run.x, equal_nan=True)


def test_a_batch_comes_back(tmp_path: Path) -> None:
    members = np.array([pendulum().theta(length=one) for one in (0.8, 1.0, 1.3)]).T
    batch = simulate_batch(pendulum(), np.linspace(0.0, 1.0, 11), theta=members)
    assert batch.x.shape == (2, 11, 3)
    assert same(BatchTrajectory.load(batch.save(tmp_path / "batch.npz")), batch)


def test_smoothed_bands_come_back(tmp_path: Path) -> None:
    bands = bg.filter_log(SWING, log(), keep="smoothed")
    assert same(type(bands).load(bands.save(tmp_path / "bands.npz")), bands)


def test_a_log_of_a_trajectory_is_no_trajectory(tmp_path: Path) -> None:
    run = RUNS["smooth"]()
    path = run.save(tmp_path / "run.csv")
    np.testing.assert_allclose(bg.read_log(path).channels["v"].values, run.x[0])
    with pytest.raises(OptionError, match=r"run\.csv: no \.npz file, and a log holds no model - read a log by"):
        Trajectory.load(path)
    with pytest.raises(OptionError, match="holds a BatchTrajectory, no Trajectory"):
        Trajectory.load(simulate_batch(pendulum(), np.linspace(0.0, 1.0, 5)).save(tmp_path / "batch.npz"))


def test_whatever_saves_loads() -> None:
    """``Trajectory`` saved to a log and had no ``load``."""
    saving = {
        f"{room}.{name}"
        for room in ROOMS
        for name in exported_names(room)
        if inspect.isclass(kind := getattr(importlib.import_module(f"bondgraph.{room}"), name))
        and hasattr(kind, "save")
        and not hasattr(kind, "load")
    }
    assert not saving
