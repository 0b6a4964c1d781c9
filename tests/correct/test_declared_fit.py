"""Where a loop begins: what the bounds of noise levels are worth is worth nothing to an effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.build import build
from bondgraph.correct.declared_fit import fit_declared
from bondgraph.correct.loop import LoopSettings
from bondgraph.data.log import MatchedLog
from bondgraph.estimate.local import no_report
from bondgraph.simulate.simulation import simulate
from tests.lift import TRUE, lift, lift_logs

#: Heat capacity, loss, interval between samples in s, and noise of the thermometer, of the plate below.
CAPACITY, LOSS, STEP, NOISE = 620.0, 2.0, 2.0, 0.05


def plate() -> bg.BondGraph:
    """A hot plate that loses heat to the room."""
    g = bg.BondGraph("plate")
    heat = g.input("heat", "W", "", hold=True)
    capacity = g.parameter("C", 700.0, "J/K", "", (100.0, 5000.0))
    loss = g.parameter("G", 2.6, "W/K", "", (0.1, 20.0))
    body = g.zero_junction("body", bg.THERMAL)
    g.flow_source("heater", heat, at=body)
    g.compliance("metal", lambda q: q / capacity, at=body)
    g.resistance("room", flow=lambda rise: loss * rise, at=body)
    g.measure_effort("rise", body)
    return g


def heated(seed: int) -> MatchedLog:
    """A log of the plate as it is declared, from rest."""
    rng, time = np.random.default_rng(seed), STEP * np.arange(1500)
    heat = np.repeat(rng.uniform(0.0, 400.0, 15), 100)[np.newaxis]
    run = simulate(build(plate()).model, time, heat, {"C": CAPACITY, "G": LOSS}, rtol=1e-9)
    return MatchedLog(f"run{seed}", time, heat, run.y + NOISE * rng.standard_normal(run.y.shape))


@pytest.fixture(scope="module")
def logs() -> list[MatchedLog]:
    return [heated(1), heated(2)]


def test_the_least_process_noise_is_worth_as_much_as_none(logs: list[MatchedLog]) -> None:
    free, none = (
        fit_declared(plate(), logs, [], LoopSettings(process_noise=noise), no_report).fit for noise in ("free", "none")
    )
    assert free.nll == pytest.approx(none.nll, abs=0.5)
    assert np.log(free.values["C"] / none.values["C"]) == pytest.approx(0.0, abs=0.3 * free.std["C"])


def test_counting_every_heat_otherwise_changes_nothing(logs: list[MatchedLog]) -> None:
    """With a bound in joule a larger capacity had less noise in its temperature: 2.3 times the heat gained 12 nats."""
    counted = [replace(log, u=2.3 * log.u) for log in logs]
    own, scaled = (fit_declared(plate(), several, [], LoopSettings(), no_report).fit for several in (logs, counted))
    assert scaled.nll == pytest.approx(own.nll, abs=0.5)
    assert scaled.values["C"] == pytest.approx(2.3 * own.values["C"], rel=1e-3)


@pytest.mark.parametrize("seed", [0, 4, 8])
def test_what_swings_is_fitted_at_its_own_period(seed: int) -> None:
    """The fit ended a thousand nats behind, at 640 kN/m with an interval of one percent, where 400 kN/m is true."""
    found = fit_declared(lift(), lift_logs(seed), [], LoopSettings(), no_report).fit
    for name, value in TRUE.items():
        assert abs(found.values[name] - value) < 4.0 * found.std[name], name
    assert found.std["k"] < 0.02 * TRUE["k"]
