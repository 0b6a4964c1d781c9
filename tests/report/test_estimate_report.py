"""The report of an estimate: curves before and after begin where their parameters say, by log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.data.log import MatchedLog
from bondgraph.report.estimation import estimate_report
from bondgraph.report.html import Provenance

_MADE = Provenance("test", 0, (), (), (), 1.0)
_QUICK = bg.Settings(method="gradient", starts=1, certify="none")


def _plate() -> bg.Model:
    """A hot plate whose state is its heat: a temperature is that over a free capacity."""
    g = bg.BondGraph("plate")
    capacity = g.parameter("C", 1200.0, "J/K", "", (100.0, 5000.0))
    loss = g.parameter("G", 2.0, "W/K", "", (0.1, 20.0))
    body = g.zero_junction("body", bg.THERMAL)
    g.flow_source("heater", g.input("heat", "W", hold=True), at=body)
    g.compliance("metal", lambda q: q / capacity, at=body, state="q")
    g.resistance("room", flow=lambda rise: loss * rise, at=body)
    g.measure_effort("rise", body)
    return bg.build(g).model


def _log(name: str, begins: float) -> MatchedLog:
    rng, time = np.random.default_rng(1), 0.5 * np.arange(400)
    heat = np.repeat(rng.uniform(0.0, 400.0, 8), 50)[np.newaxis]
    run = bg.simulate(_plate(), time, heat, {"C": 700.0, "G": 2.6}, {"q": 700.0 * begins})
    return MatchedLog(name, time, heat, np.asarray(run.y + 0.05 * rng.standard_normal(run.y.shape)))


def test_both_curves_begin_at_what_was_measured() -> None:
    """The one before began at the heat of the estimate over the declared capacity: 58 % of the temperature."""
    found = bg.estimate(_plate(), [_log("cool", 20.0), _log("hot", 60.0)], settings=_QUICK)
    for series in estimate_report(found, _MADE).series:
        assert series.before is not None and series.after is not None
        for prediction in (series.before, series.after):
            assert prediction.simulated is not None
            assert prediction.simulated[0] == pytest.approx(series.measured[0], abs=0.3)


def test_starts_that_are_given_for_each_log_are_reported() -> None:
    logs = [_log("cool", 20.0), _log("hot", 60.0)]
    starts = tuple({"q": 700.0 * begins} for begins in (20.0, 60.0))
    problem = bg.pose(_plate(), logs, ["C", "G"])
    found = bg.estimate(replace(problem, initial=starts), settings=_QUICK)
    assert len(estimate_report(found, _MADE).series) == 2
