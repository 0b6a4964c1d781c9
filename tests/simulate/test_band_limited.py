"""Band-limited inputs: simulated, filtered and estimated as the sum of sinc functions that their samples tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lsim

import bondgraph as bg
from bondgraph.arrays import FloatArray
from bondgraph.data.band_limited import PIECES, finer, finer_times
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import with_inputs_between
from bondgraph.declare.files import read_graph, write_graph
from bondgraph.declare.quantities import Interpolation
from bondgraph.errors import DeclarationError, FilterError, ModelError
from bondgraph.filter.noise_nodes import continuous_nodes, finer_nodes
from bondgraph.filter.runs import run
from bondgraph.filter.samples import Samples
from bondgraph.simulate import InputSignal

#: Angular frequencies of the drive, up to 0.3 of the sampling rate of one per second.
FREQUENCIES = (0.7, 1.3, 1.9)
MASS, STIFFNESS, DAMPING = 1.0, 1.2, 0.4


def shaker(between: Interpolation) -> bg.BondGraph:
    g = bg.BondGraph("shaker")
    force = g.input("force", "N", between=between)
    body = g.one_junction("body")
    g.effort_source("drive", force, at=body)
    g.inertance("mass", g.parameter("m", MASS, "kg"), at=body, state="v")
    g.compliance("spring", lambda x: g.parameter("k", STIFFNESS, "N/m") * x, at=body, state="x")
    g.resistance("damper", g.parameter("c", DAMPING, "N s/m", bounds=(0.0, 2.0)), at=body)
    g.measure_displacement("way", "spring", "deflection", "m")
    return g


def force(time: FloatArray) -> FloatArray:
    return np.sum([np.sin(w * time + k) for k, w in enumerate(FREQUENCIES)], axis=0)


def exact(time: FloatArray) -> FloatArray:
    """The deflection from rest, by scipy on a grid on which the drive is straight between its points."""
    fine = np.linspace(time[0], time[-1], 400 * (time.size - 1) + 1)
    numbers = ([1.0], [MASS, DAMPING, STIFFNESS])
    return lsim(numbers, force(fine), fine)[1][::400]


TIME = np.arange(121.0)
BOTH: tuple[Interpolation, ...] = ("linear", "band limited")


def test_a_simulation_follows_the_drive_between_its_samples() -> None:
    errors = {}
    for between in BOTH:
        model = bg.build(shaker(between)).model
        found = bg.simulate(model, TIME, {"force": force(TIME)}, method="rk4", substeps=8).output("way")
        errors[between] = float(np.std(found - exact(TIME)))
    assert errors["band limited"] < 0.03 * np.std(exact(TIME))
    assert errors["linear"] > 8.0 * errors["band limited"]


def test_the_filter_predicts_what_the_simulation_shows() -> None:
    model = bg.build(shaker("band limited")).model
    log = MatchedLog("run", TIME, force(TIME)[np.newaxis], np.full((1, TIME.size), np.nan))
    log.y[0, 0] = 0.0
    filter_model = bg.FilterModel(model, {"v": 1e-9}, {"way": 1e-3}, {"v": 1e-9, "x": 1e-9}, substeps=4)
    filtered = run(filter_model, log)
    simulated = bg.simulate(model, TIME, log, method="rk4", substeps=1)
    np.testing.assert_allclose(filtered.predicted_mean, simulated.x, rtol=0, atol=1e-6)
    nodes = Samples.of(filter_model, log)
    assert nodes.time.size == (TIME.size - 1) * PIECES + 1
    np.testing.assert_allclose(nodes.u_left[0], finer(log.u[0])[:-1], rtol=0, atol=1e-12)


def test_an_estimate_takes_no_error_of_interpolation_for_damping() -> None:
    found = {}
    for between in BOTH:
        model = bg.build(shaker(between)).model
        y = exact(TIME)[np.newaxis] + 1e-3 * np.random.default_rng(1).standard_normal((1, TIME.size))
        log = MatchedLog("run", TIME, force(TIME)[np.newaxis], y)
        filter_model = bg.FilterModel(model, {}, {"way": 1e-3}, {"v": 1e-6, "x": 1e-6}, substeps=8)
        found[between] = bg.estimate(filter_model, [log], free=["c"]).values["c"]
    assert found["band limited"] == pytest.approx(DAMPING, rel=0.03)
    assert abs(found["linear"] - DAMPING) > 5.0 * abs(found["band limited"] - DAMPING)


@settings(max_examples=40, deadline=None)
@given(values=st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=90), pieces=st.integers(1, 6), slope=st.floats(-9, 9))
def test_samples_keep_their_values_and_a_line_stays_one(values: list[float], pieces: int, slope: float) -> None:
    given_values = np.array(values)
    between = finer(given_values, pieces)
    assert between.size == (len(values) - 1) * pieces + 1
    assert np.array_equal(between[::pieces], given_values)
    line = slope * np.arange(float(len(values)))
    np.testing.assert_allclose(finer(line, pieces), finer_times(line, pieces), rtol=0, atol=1e-2 * abs(slope) + 1e-12)


@settings(max_examples=30, deadline=None)
@given(
    gaps=st.lists(st.sampled_from([1.0, 1.0, 1.0, 3.0]), min_size=1, max_size=8),
    steps=st.integers(0, 3), grading=st.sampled_from([1.0, 0.5]), pieces=st.integers(2, 5),
)  # fmt: skip
def test_further_nodes_leave_the_noise_as_it_was(gaps: list[float], steps: int, grading: float, pieces: int) -> None:
    time = np.concatenate([[0.0], np.cumsum(gaps)])
    before = continuous_nodes(time, steps, grading)
    after = finer_nodes(before, time, pieces)
    np.testing.assert_array_equal(after.time[after.sample], time)
    assert np.all(np.diff(after.time) > 0.0)
    assert after.share.sum() == pytest.approx(before.share.sum())
    at = np.searchsorted(after.time, before.time)
    np.testing.assert_array_equal(after.time[at], before.time)
    np.testing.assert_allclose(after.end[at[1:] - 1], before.end)
    np.testing.assert_allclose(after.start[at[:-1]], before.start)
    assert after.end.sum() + after.start.sum() == pytest.approx(before.end.sum() + before.start.sum())


def test_uneven_samples_tell_no_band_limited_input() -> None:
    model = bg.build(shaker("band limited")).model
    time = np.append(TIME[:50], TIME[50:] + 0.5)
    log = MatchedLog("run", time, force(time)[np.newaxis], np.zeros((1, time.size)))
    with pytest.raises(FilterError, match="input 'force' is band limited, which its samples tell only at even times"):
        run(bg.FilterModel(model, {}, {"way": 1e-3}, {"v": 1.0}), log)
    with pytest.raises(ModelError, match="input 'force' is band limited"):
        bg.simulate(model, inputs=log)


def test_a_drawn_course_stays_straight_between_its_corners() -> None:
    model = bg.build(shaker("band limited")).model
    signal = InputSignal.of(model, [0.0, 1.0, 3.0], force=[0.0, 1.0, 0.0])
    assert signal.at([0.5, 2.0])[0].tolist() == [0.5, 0.5]


def test_the_declaration_is_kept_in_files_and_modules(tmp_path: Path) -> None:
    graph = shaker("band limited")
    write_graph(graph, tmp_path / "shaker.json")
    assert read_graph(tmp_path / "shaker.json").inputs == graph.inputs
    assert bg.build(graph).model.inputs[0].interpolation == "band limited"
    with pytest.raises(DeclarationError, match="between='cubic' - use 'linear', 'hold', 'band limited'"):
        bg.BondGraph("g").input("u", "1", between="cubic")  # type: ignore[arg-type]
    with pytest.raises(DeclarationError, match="is held between samples, as codes always are"):
        bg.BondGraph("g").input("u", "1", between="linear", hold=True)


def test_inputs_of_a_declared_graph_may_run_another_way() -> None:
    graph = shaker("linear")
    changed = with_inputs_between(graph, force="band limited")
    assert changed == shaker("band limited") and graph.inputs[0].interpolation == "linear"
    with pytest.raises(DeclarationError, match="no input 'forse'; did you mean 'force'"):
        with_inputs_between(graph, forse="linear")
    whole = bg.BondGraph("whole")
    whole.include("left", graph)
    assert [one.interpolation for one in whole.flatten().inputs] == ["linear"]
    (name,) = (one.name for one in whole.flatten().inputs)
    other = with_inputs_between(whole, **{name: "band limited"})
    assert [one.interpolation for one in other.flatten().inputs] == ["band limited"]
    assert [one.interpolation for one in whole.flatten().inputs] == ["linear"]
    coded = bg.BondGraph("g")
    coded.input("gear", "1", letters={"H": 1.0})
    with pytest.raises(DeclarationError, match="input gear cannot be 'linear' between samples - use 'hold'"):
        with_inputs_between(coded, gear="linear")
