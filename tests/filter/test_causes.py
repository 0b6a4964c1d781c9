"""A filter that ends tells the law that ended it, and a model that cannot be filtered what it lacks."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from sympy import sqrt

from bondgraph.build import build
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC
from bondgraph.declare.graph import BondGraph
from bondgraph.errors import EstimationError, FilterError, ModelError
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import declared_free
from bondgraph.estimate.local import fit
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.runs import run
from bondgraph.report.estimation import write_estimate
from bondgraph.report.html import Provenance
from bondgraph.simulate.outcome import Outcome
from bondgraph.simulate.simulation import simulate


def tank() -> BondGraph:
    """A tank that runs out through a hole; its law ends where the tank is empty."""
    g = BondGraph("tank")
    inflow = g.input("inflow", "m^3/s", "pump")
    capacity = g.parameter("C", 1e-4, "m^3/Pa", "tank")
    c = g.parameter("c", 1e-5, "m^3/s/Pa^0.5", "hole", (1e-6, 1e-4))
    level = g.zero_junction("level", HYDRAULIC)
    g.flow_source("pump", inflow, at=level)
    g.compliance("store", 1 / capacity, at=level, initial=0.001)
    g.resistance("hole", flow=lambda p: c * sqrt(p), at=level)
    g.measure_effort("pressure", level, "gauge")
    return g


def emptied() -> tuple[FilterModel, MatchedLog]:
    model = build(tank()).model
    time = 0.5 * np.arange(200)
    u = np.full((1, time.size), 1e-6)
    y = simulate(model, time, u).raise_if_failed().y
    log = MatchedLog("emptied", time, u, y + 2.0 * np.random.default_rng(0).standard_normal(y.shape))
    return FilterModel(model, {"q_store": 1e-3}, {"pressure": 2.0}, {"q_store": 0.002}), log


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("method", ["rk4", "ros3p"])
def test_the_law_without_a_value_is_named_with_the_values_it_was_asked_at(compiled: bool, method: str) -> None:
    filter_model, log = emptied()
    filter_model = FilterModel(
        filter_model.model, filter_model.process_noise, filter_model.measurement_noise, filter_model.initial_std, 2,
        method=method,  # type: ignore[arg-type]
    )  # fmt: skip
    found = run(filter_model, log, compiled=compiled)
    assert found.outcome is Outcome.DIVERGED
    with pytest.raises(FilterError, match=r"emptied: a law has no value at a sigma point") as told:
        found.raise_if_failed()
    message = str(told.value)
    assert "Q_hole = c * np.sqrt(pressure_level) is nan" in message and "pressure_level = -" in message
    assert "q_store = -" in message and "substeps" not in message


def test_an_estimate_that_cannot_begin_tells_the_same() -> None:
    filter_model, log = emptied()
    with pytest.raises(EstimationError, match=r"tank, emptied: a law has no value .* np.sqrt\(pressure_level\)"):
        fit(EstimationProblem(filter_model, (log,), (declared_free("c", filter_model),)))


def test_a_state_that_runs_away_is_not_laid_to_a_law() -> None:
    filter_model, log = emptied()
    model = filter_model.model
    wild = FilterModel(model, {}, {"pressure": 2.0}, {"q_store": 1e-9})
    ended = run(wild, log, model.theta(c=-1e300))
    assert ended.outcome is Outcome.DIVERGED and "sigma point" not in ended.cause


def divider() -> BondGraph:
    """Two resistors, which store nothing."""
    g = BondGraph("divider")
    voltage = g.input("voltage", "V")
    loop = g.one_junction("loop", ELECTRICAL)
    g.effort_source("supply", voltage, at=loop)
    g.resistance("R", g.parameter("R", 2.0, "ohm", "", (1.0, 4.0)), at=loop)
    g.measure_flow("current", loop)
    return g


def test_a_model_without_states_is_told_that_a_filter_needs_some() -> None:
    model = build(divider()).model
    with pytest.raises(FilterError, match=r"divider: the model has no states.* - .*simulate, or declare a storage"):
        FilterModel(model, {}, {"current": 0.1}, {})


@pytest.mark.parametrize("method", ["adaptive", "rk4", "ros3p"])
def test_a_simulation_that_ends_names_the_law_and_its_values(method: str) -> None:
    # "the state grew without bound ... use more substeps": no substep gives the root of a negative level a value
    found = simulate(emptied()[0].model, np.arange(200.0), {"inflow": 0.0}, method=method, substeps=3)
    with pytest.raises(ModelError) as told:
        found.raise_if_failed()
    message = str(told.value)
    assert message.startswith("tank: a law has no value, after t = ") and "substeps" not in message
    assert "Q_hole = c * np.sqrt(pressure_level) is nan" in message and "pressure_level = -" in message
    assert "no value" in repr(found)


@pytest.mark.parametrize("method", ["gradient", "both"])
def test_an_estimate_without_a_finite_point_tells_log_values_and_law(method: str, tmp_path: Path) -> None:
    # "the model diverges at every point tried", under the heading "estimated"
    filter_model, log = emptied()
    found = estimate(pose(filter_model, log, ["c"]), Settings(method=method, starts=2))
    assert found.outcome is SearchOutcome.NO_FINITE_POINT
    assert found.end.startswith("failed: the likelihood has a finite value at no point tried; emptied, at c = 1e-05: a")
    assert "Q_hole = c * np.sqrt(pressure_level) is nan" in found.end and found.end in found.summary()
    told = write_estimate(found, tmp_path, Provenance("test", 0, (), (), (), 1.0))
    assert told.verdict == "not estimated" and found.end in told.explanation
    assert json.loads((tmp_path / "result.json").read_text())["outcome"] == found.end
