"""Logs with gaps: the longest interval decides how finely the free model is integrated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.correct.fits.assess import assess
from bondgraph.declare.editing import with_values
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from tests.correct.sled import NOISE, build, pull, sled


def test_a_gap_does_not_let_the_free_simulation_diverge() -> None:
    """The steps of a median interval were taken over the gap too: speeds of 1e42 were printed as an error."""
    light = with_values(sled(), {"m_sled": 4.0, "c_guide": 52.0})
    whole, own = pull(light, 2), build(light)
    setup = filter_setup(own.model, own.driven, [whole])
    found = fit(EstimationProblem(setup.filter_model, (whole,), (*free_parameters(setup, ()), *setup.noise)))
    kept = np.r_[0:100, 140:400]
    gap = replace(whole, time=whole.time[kept], u=whole.u[:, kept], y=whole.y[:, kept])
    (log,) = assess(found, [gap]).logs
    for name, noise in NOISE.items():
        late = slice(150, None)  # the inputs inside the gap are not known
        row = own.model.names("output").index(name)
        error = np.sqrt(np.mean((log.simulated.y[row, late] - gap.y[row, late]) ** 2))
        assert error < 2.0 * noise


def test_a_simulation_that_diverges_is_an_outcome_and_no_figure() -> None:
    light = with_values(sled(), {"m_sled": 4.0, "c_guide": 52.0})
    log, own = pull(light, 2), build(light)
    setup = filter_setup(own.model, own.driven, [log])
    found = fit(EstimationProblem(setup.filter_model, (log,), (*free_parameters(setup, ()), *setup.noise)))
    mass = own.model.index("parameter", "m_sled")
    model = found.problem.filter_model.model
    weightless = replace(log, theta_overrides={"m_sled": 1e-4})
    assert model.theta()[mass] == 4.0
    channels = assess(found, [weightless]).logs[0].channels
    assert all(np.isinf(error.simulation_rmse) for error in channels.values())
