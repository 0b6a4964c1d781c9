"""A log in another unit is pointed out where process noise is large, and clean logs of random machines are not."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from bondgraph.build import build
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.problem import pose
from bondgraph.filter.filter_model import FilterModel
from bondgraph.report.estimation import write_estimate
from bondgraph.report.html import Provenance
from bondgraph.report.suspicions import unit_suspicions
from bondgraph.simulate.model import Model
from bondgraph.simulate.simulation import simulate

KMH = 3.6


@functools.cache
def sled() -> Model:
    """A sled that is pushed, and blown by a wind that no log holds."""
    g = BondGraph("sled")
    body = g.one_junction("body", TRANSLATION)
    g.effort_source("push", g.input("force", "N"), at=body)
    g.effort_source("wind", g.input("gust", "N", default=0.0), at=body)
    g.inertance("sled", g.parameter("mass", 80.0, "kg", "", (10.0, 400.0)), at=body, state="v")
    drag = g.parameter("drag", 12.0, "N s/m", "", (1.0, 200.0))
    g.resistance("runners", lambda v: drag * v, at=body)
    g.measure_flow("speed", body, "speed of the sled")
    return build(g).model


def driven(seed: int, gusts: float, unit: float = 1.0, samples: int = 600) -> MatchedLog:
    """A log of a sled whose parameters are declared 20 % off, in m/s times a unit.

    Gusts move the speed by a share of its rms; the sensor errs by 2 % of that.
    """
    model, chance = sled(), np.random.default_rng([seed, int(100 * gusts)])
    time = 0.1 * np.arange(samples)
    theta = {info.name: info.value * float(np.exp(0.2 * chance.standard_normal())) for info in model.parameters}
    pushed, blown = np.zeros((2, samples)), np.zeros((2, samples))
    rows = [model.names("input").index(name) for name in ("force", "gust")]
    hold = int(chance.integers(10, 60))
    pushed[rows[0]] = np.repeat(chance.uniform(-30.0, 100.0, samples // hold + 1), hold)[:samples]
    blown[rows[1]] = chance.standard_normal(samples)
    speed, drift = (simulate(model, time, u, theta, method="rk4", compiled=True).y[0] for u in (pushed, blown))
    size = float(np.sqrt(np.mean(speed**2)))
    speed = (
        speed + gusts * size / float(np.sqrt(np.mean(drift**2))) * drift + 0.02 * size * chance.standard_normal(samples)
    )
    return MatchedLog("run", time, pushed, unit * speed[np.newaxis])


def filtered_with(process_noise: float) -> FilterModel:
    return FilterModel(sled(), {"v": process_noise}, {"speed": 0.1}, {"v": 0.5})


def test_random_clean_machines_are_not_suspected() -> None:
    logs = (driven(seed, gusts) for gusts in (0.0, 0.35, 1.0) for seed in range(100))
    assert sum(bool(unit_suspicions(filtered_with(0.5), log)) for log in logs) <= 1  # of 300


def test_kilometres_per_hour_are_seen_through_gusts_of_a_third_of_the_signal() -> None:
    found = [unit_suspicions(filtered_with(0.5), driven(seed, 0.35, KMH)) for seed in range(40)]
    assert sum(any("km/h read as m/s" in one for one in each) for each in found) >= 16  # 7 of 40 before


def test_a_unit_is_pointed_out_where_process_noise_explains_the_log(tmp_path: Path) -> None:
    # silent: no channel was unexplained, and no parameter on a bound
    problem = pose(filtered_with(2.0), driven(0, 0.35, KMH), ["mass", "drag", "process(v)"])
    found = estimate(problem, Settings(method="gradient", starts=1, certify="none"))
    told = write_estimate(found, tmp_path, Provenance("test", 0, (), (), (), 1.0))
    assert found.misfits == () and found.at_bound == ()
    assert any("km/h read as m/s" in one for one in told.suspected)
