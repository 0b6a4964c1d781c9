"""A candidate with a zero coefficient leaves the model alone, or is refused."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.models.absent import absent_when_zero
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup


def geared_hub() -> BondGraph:
    """A wheel that drives a massless hub through a ratio which is zero while a clutch is open."""
    g = BondGraph("geared_hub")
    torque = g.input("torque", "N m")
    engaged = g.input("engaged", "1", "1 while the clutch is closed", hold=True)
    inertia = g.parameter("J", 1.0, "kg m^2", "", (0.1, 5.0))
    damper = g.parameter("damper", 3.0, "N s/m")
    reach = g.parameter("reach", 0.3, "m")
    wheel = g.one_junction("wheel", ROTATION)
    hub = g.one_junction("hub", TRANSLATION)
    g.effort_source("drive", torque, at=wheel)
    g.inertance("flywheel", inertia, at=wheel, state="omega")
    g.transformer("arm", reach * engaged, wheel, hub)
    g.resistance("damper", damper, at=hub)
    g.measure_flow("omega_measured", wheel)
    return g


@pytest.fixture(scope="module")
def hub_log() -> MatchedLog:
    time = np.arange(0.0, 6.0, 0.05)
    engaged = (np.sin(time) > 0).astype(float)
    omega = 2.0 + np.cumsum(0.05 * (np.cos(time) - 0.27 * engaged * 2.0))
    noise = 0.01 * np.random.default_rng(0).standard_normal(time.size)
    return MatchedLog("hub", time, np.array([np.cos(time), engaged]), (omega + noise)[np.newaxis])


def test_candidates_that_are_kept_change_nothing_while_absent(hub_log: MatchedLog) -> None:
    built = build(geared_hub())
    setup = filter_setup(built.model, built.driven, [hub_log])
    fitted = fit(EstimationProblem(setup.filter_model, (hub_log,), (*free_parameters(setup, ()), *setup.noise)), 3, 0.1)
    runs = fitted.runs([hub_log])
    functions = [effects.viscous_loss, effects.constant_effort, effects.added_inertia]
    found, _ = candidates(built, functions, places(built, [hub_log], runs, fitted.theta))
    kept, refused = absent_when_zero(built, found, [hub_log], runs)
    assert {(c.effect.name, c.place.label) for c in kept} >= {("viscous_loss", "wheel"), ("added_inertia", "wheel")}
    for candidate in kept:
        extended = build(candidate.apply(built.graph)).model
        for k in range(0, hub_log.time.size, 10):
            x, u = runs[0].filtered_mean[:1, k], hub_log.u[:, k]
            assert extended.rhs(0.0, x, u, extended.theta()) == pytest.approx(
                built.model.rhs(0.0, x, u, built.model.theta()), rel=1e-9
            )
    assert len(kept) + len(refused) == len(found)
    assert all("reaches zero" in no.why for no in refused)
