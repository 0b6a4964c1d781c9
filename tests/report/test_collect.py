"""Values of the other rooms taken over into the report, on a pendulum whose drag the declared model lacks."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import ROTATION
from bondgraph.declare.effect import Effect, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.runs import run
from bondgraph.report.collect import (
    Runs,
    added_nodes,
    channel_series,
    found_effect,
    parameter_changes,
    state_bands,
    versions,
)
from bondgraph.report.embedding import figure_svg
from bondgraph.report.plots import state_figure
from bondgraph.report.series import channel_errors, rmse
from bondgraph.simulate.example import pendulum
from bondgraph.simulate.simulation import simulate

NOISE = 0.01


@pytest.fixture(scope="module")
def log() -> MatchedLog:
    time = np.arange(200) * 0.05
    truth = simulate(pendulum(), time, theta={"damping": 0.4})
    measured = truth.y + NOISE * np.random.default_rng(5).standard_normal(truth.y.shape)
    measured[0, ::7] = np.nan
    return MatchedLog("swing", time, truth.u, measured)


def runs(log: MatchedLog, damping: float) -> Runs:
    model = pendulum()
    theta = model.theta(damping=damping)
    swing = FilterModel(model, {"rate": 0.05}, {"deflection": NOISE}, {"angle": 0.05, "rate": 0.05}, substeps=2)
    return Runs(run(swing, log, theta, compiled=False), simulate(model, log.time, theta=theta))


def test_errors_of_the_series_are_those_of_the_runs(log: MatchedLog) -> None:
    before, after = runs(log, 0.0), runs(log, 0.4)
    (series,) = channel_series(pendulum(), log, before, after, {"deflection": NOISE}, held_out=True)
    (error,) = channel_errors([series])
    assert before.filtered is not None and before.simulated is not None
    told = before.filtered.innovation[0, 2:]  # the first sample is missing, the second is given by the prior
    assert error.one_step_before == pytest.approx(rmse(told))
    assert error.simulation_before == pytest.approx(rmse(log.y[0] - before.simulated.output("deflection")))
    assert error.simulation_after == pytest.approx(NOISE, rel=0.2)
    assert error.simulation_after < 0.2 * error.simulation_before
    assert error.samples == int(np.isfinite(log.y).sum())
    assert (error.held_out, error.noise_std) == (True, NOISE)


def test_what_an_unknown_start_leaves_is_no_error_of_the_model(log: MatchedLog) -> None:
    model = pendulum()
    lost = {"angle": 0.01, "rate": 4.0}  # one sensor and two states: only the second measurement tells the rate
    begun = FilterModel(model, {"rate": 0.05}, {"deflection": NOISE}, lost, substeps=2)
    theta = model.theta(damping=0.4)
    filtered = run(begun, log, theta, x0=model.x0() + np.array([0.0, 4.0]), compiled=False)
    (error,) = channel_errors(channel_series(model, log, Runs(filtered)))
    assert abs(filtered.innovation[0, 1]) > 10.0 * NOISE
    assert error.one_step_before < 3.0 * NOISE


def test_channels_that_were_not_measured_are_left_out(log: MatchedLog) -> None:
    empty = dataclasses.replace(log, y=np.full_like(log.y, np.nan))
    assert channel_series(pendulum(), empty, Runs()) == ()


def test_bands_of_the_filtered_states_hold_the_truth(log: MatchedLog) -> None:
    filtered = runs(log, 0.4).filtered
    assert filtered is not None
    bands = {band.name: band for band in state_bands(filtered)}
    truth = simulate(pendulum(), log.time, theta={"damping": 0.4})
    inside = np.abs(truth.state("angle") - bands["angle"].mean) < 1.96 * bands["angle"].std
    assert inside.mean() > 0.85
    assert (bands["rate"].unit, np.isnan(bands["rate"].measured).all()) == ("rad/s", True)
    figure = state_figure(list(bands.values()), "swing")
    assert [axes.get_ylabel() for axes in figure.axes] == ["angle\n[rad]", "rate\n[rad/s]"]
    assert "svg" in figure_svg(figure)


def test_only_parameters_of_the_model_become_rows() -> None:
    rows = parameter_changes(
        pendulum(),
        {"damping": 0.1, "length": 1.0},
        {"noise(deflection)": 0.01, "damping": 0.41, "length": 1.02},
        {"damping": (0.38, 0.44)},
        at_bound=("length",),
    )
    assert [(row.name, row.before, row.after, row.at_bound) for row in rows] == [
        ("length", 1.0, 1.02, True),
        ("damping", 0.1, 0.41, False),
    ]
    assert rows[1].ci95 == (0.38, 0.44)
    (new,) = parameter_changes(pendulum(), {}, {"length": 1.02}, {})  # the coefficient of a law that was not there
    assert np.isnan(new.before)
    assert np.isnan(rows[0].ci95).all()


def test_an_effect_takes_units_and_values_from_the_corrected_model() -> None:
    g = BondGraph("g")
    shaft = g.one_junction("shaft", ROTATION)
    effect = Effect("viscous loss", "shaft_viscous", "b·omega", ("damping",))
    found = found_effect(effect, Place(shaft, Scale(1.0, 1.0)), pendulum(), {"damping": 0.4}, {"damping": (0.3, 0.5)})
    assert found.junction == "shaft"
    (coefficient,) = found.coefficients
    assert (coefficient.name, coefficient.value, coefficient.unit, coefficient.ci95) == (
        "damping",
        0.4,
        "1/s",
        (0.3, 0.5),
    )


def test_added_nodes_are_found_inside_parts_as_well() -> None:
    def car(with_drag: bool) -> BondGraph:
        wheel = BondGraph("wheel")
        hub = wheel.one_junction("hub", ROTATION)
        wheel.inertance("disc", 2.0, at=hub)
        if with_drag:
            wheel.resistance("drag", 0.1, at=hub)
        g = BondGraph("car")
        g.include("front", wheel, {"hub": "hub"})
        return g

    assert added_nodes(car(False), car(True)) == {"front.drag"}
    assert added_nodes(car(True), car(True)) == frozenset()


def test_versions_name_the_toolkit_first() -> None:
    found = versions()
    assert [name for name, _ in found] == ["bondgraph", "Python", "numpy", "scipy", "sympy", "numba"]
    assert all(version[0].isdigit() for _, version in found)
