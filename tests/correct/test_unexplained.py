"""What fits no known effect is said to be unexplained, with its shape; effects that act in part of the data."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from sympy import exp

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.loop import ClosedLoop, LoopSettings, close_loop
from bondgraph.correct.places.probes import Probe, Signal
from bondgraph.correct.places.unexplained import Spline, unexplained
from bondgraph.correct.result import result_json
from bondgraph.correct.scores.gates import Constancy, Gate, constancy, gate_samples, gates
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.estimate.fitted import at_optimum
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.report.missing import missing_efforts
from bondgraph.simulate.simulation import simulate
from tests.correct.sled import FUNCTIONS, NOISE, added, fitted, pull, sled

#: Its nearest relatives are offered, and none of them is it.
OFFERED: tuple[EffectFunction, ...] = (*FUNCTIONS, effects.coulomb_loss)
HEIGHT, MIDDLE, WIDTH = 30.0, 22.0, 8.0


def swing(g: BondGraph, at: Place) -> Effect | None:
    """A load that drives below a torque and brakes above it: no effect of the dictionary, and no loss with a gate."""
    height = g.parameter("height", 0.0, "N", "", (0.0, 50.0))
    middle, width = g.parameter("middle", MIDDLE, "N m"), g.parameter("width", WIDTH, "N m")
    past = (symbol("torque") - middle) / width
    g.effort_source("swing", -height * past * exp(-(past**2)), at=at.junction)
    return Effect("swing", "swing", "", ("height",))


def logs() -> list[MatchedLog]:
    true = added(swing, "runner", HEIGHT)
    return [pull(true, 5, name="first"), pull(true, 105, name="second")]


@pytest.fixture(scope="module")
def journal(tmp_path_factory: pytest.TempPathFactory) -> Journal:
    """Finished fits, which loops with the same logs and laws share."""
    return Journal(tmp_path_factory.mktemp("fits"))


@pytest.fixture(scope="module")
def closed(journal: Journal) -> ClosedLoop:
    return close_loop(sled(), logs(), [], OFFERED, LoopSettings(journal=journal))


def truth(torque: np.ndarray) -> np.ndarray:
    past = (torque - MIDDLE) / WIDTH
    return HEIGHT * past * np.exp(-(past**2))


def test_a_residual_outside_the_dictionary_is_unexplained_and_near_relatives_are_withdrawn(closed: ClosedLoop) -> None:
    assert (closed.verdict, closed.added) == ("unexplained residual", ())
    (found,) = closed.unexplained
    assert found.signal == "torque" and {found.place.label, *found.like} == {"drum", "runner"}
    assert not closed.disturbances  # one beside the torque is withdrawn: the function explains more than it
    assert {step.action for step in closed.history} <= {"added", "not constant", "disturbance", "withdrawn", "stopped"}


def test_its_shape_is_that_of_the_truth(closed: ClosedLoop) -> None:
    (found,) = closed.unexplained
    assert abs(found.knots[int(np.argmax(found.values))] - MIDDLE - WIDTH / np.sqrt(2.0)) < WIDTH
    assert np.corrcoef(found.values, truth(found.knots))[0, 1] > 0.8
    (entry,) = result_json(closed)["unexplained"]
    assert entry["as_function_of"] == "torque" and entry["shape"]["unit_at"] == "N m"
    assert all(low < value < high for low, value, high in zip(
        entry["shape"]["lower"], entry["shape"]["values"], entry["shape"]["upper"], strict=True
    ))  # fmt: skip
    (picture,) = missing_efforts(closed)
    assert picture.x_label == "torque [N m]" and picture.x.shape == picture.missing.shape == (800,)


def test_on_request_it_is_added_as_a_table(closed: ClosedLoop, journal: Journal) -> None:
    tabled = close_loop(sled(), logs(), [], OFFERED, LoopSettings(tables=True, journal=journal))
    assert tabled.verdict == "unexplained residual"
    (table,) = tabled.added
    assert table.trial.candidate.effect.name == "table" and len(table.coefficients) > 4
    assert tabled.corrected.nll < closed.corrected.nll - 20.0
    assert f"table_{table.trial.candidate.place.label}" in tabled.corrected_graph.nodes


def test_a_constant_is_a_function_of_no_signal() -> None:
    """A condenser that began at 5 V was "an unknown effort as a function of time", beside the right law."""
    place = Place(handle(sled(), "runner"), Scale(150.0, 4.0))
    probe = cast(Probe, SimpleNamespace(place=place, variable="effort"))
    signal, at = Signal("time", "s", (np.arange(5.0),)), np.arange(5.0)
    function = Spline(probe, signal, at, 5.0 + 0.01 * at, np.full(5, 0.1), 300.0, 1e-30)
    assert unexplained([function], 1000, 0.01) is None
    assert unexplained([replace(function, values=5.0 + at)], 1000, 0.01) is not None
    assert unexplained([replace(function, values=0.1 * (at - 2.0))], 1000, 0.01) is not None


def changing(when: float, name: str = "second") -> MatchedLog:
    """A log of a sled whose guide becomes rougher at a time, from 12 to 14.5 N s/m."""
    calm = pull(sled(), 103, name=name)
    smooth, rough = (build(with_values(sled(), {"c_guide": value})).model for value in (12.0, 14.5))
    k = int(np.searchsorted(calm.time, when))
    first = simulate(smooth, calm.time[: k + 1], calm.u[:, : k + 1], rtol=1e-8).raise_if_failed()
    last = simulate(rough, calm.time[k:], calm.u[:, k:], x0=first.x[:, -1], rtol=1e-8).raise_if_failed()
    noise = np.array([[NOISE[one]] for one in smooth.names("output")])
    y = np.concatenate([first.y[:, :-1], last.y], axis=1)
    return replace(calm, y=y + noise * np.random.default_rng(8).standard_normal(y.shape))


def test_a_coefficient_that_changes_within_a_log_is_told_from_one_that_does_not() -> None:
    same = [pull(sled(), 3, name="first"), pull(sled(), 103, name="second")]
    rough = [same[0], changing(20.0)]
    other = [same[0], pull(sled(), 103, name="second", c_guide=14.5)]
    found = []
    for train in (same, rough, other):
        base = fitted(train)
        again = fit(EstimationProblem(base.problem.filter_model, tuple(train), tuple(at_optimum(base))))
        found.append(constancy(again, "c_guide"))
    assert found[0].p_value > 0.05
    assert found[1].p_value < 1e-3
    assert (found[1].log, found[1].time) == ("second", pytest.approx(20.0, abs=3.0))
    assert found[1].after - found[1].before == pytest.approx(np.log(14.5 / 12.0), rel=0.3)  # 12 is declared
    assert not found[1].switches
    assert found[2].p_value > 0.05  # logs differ, but nothing happens in either: they are independent


def test_a_coefficient_that_is_small_on_one_side_may_be_absent_there() -> None:
    def found(before: float, after: float) -> bool:
        return Constancy(1e-9, "run", 10.0, before, after).switches

    assert found(0.1, 1.0) and found(-2.0, 0.2) and found(-1.0, 1.0)
    assert not found(0.8, 1.0) and not found(-1.0, -0.6) and not found(0.0, 0.0)


def test_gates_are_spread_over_all_logs_and_lie_inside_them() -> None:
    train = [pull(sled(), 1, name="first"), pull(sled(), 2, samples=200, name="second")]
    points, samples = gates(train), gate_samples(train)
    assert len(points) == sum(map(len, samples)) and {name for name, _ in points} == {"first", "second"}
    assert all(0 <= k < log.time.size - 1 for log, own in zip(train, samples, strict=True) for k in own)
    times = Gate("from", "second", 7.0).times(train)
    assert times["first"] > 1e5 and times["second"] == 7.0
    assert Gate("until", "first", 7.0).times(train)["second"] < -1e5
