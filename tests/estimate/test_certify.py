"""Certification: a step that moves the estimate is seen and mended, one that does not is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.errors import OptionError
from bondgraph.estimate.certify import NEGLIGIBLE_SHIFT, Certification, Check, finer_problems
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.solvers.particle_swarm import SwarmSettings
from bondgraph.filter.draw import draw_logs
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.planning import plan_steps
from bondgraph.simulate.model import Model
from bondgraph.simulate.stiff import step_lengths
from tests.module_text import STACK

OSCILLATOR = (
    '''"""An oscillator of 2 Hz, measured so well that the error of a long step matters."""
import numpy as np

NAME = "oscillator"
FORMAT = "bondgraph-module/1"
STATES = (("q", "m", 1.0, "deflection"), ("v", "m/s", 0.0, "speed"))
INPUTS = ()
PARAMETERS = (("k", "1/s^2", 150.0, 100.0, 200.0, "rate"), ("d", "1/s", 0.4, 0.0, 4.0, "damping"))
OUTPUTS = (("deflection", "m", "deflection"),)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    return _stack(x, (x[1], -theta[0]*x[0] - theta[1]*x[1]))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    return _stack(x, (x[0],))
'''
    + STACK
)

TRUTH = {"k": 156.0, "d": 0.5}


def problem(substeps: int) -> EstimationProblem:
    model = Model.from_text(OSCILLATOR)
    exact = FilterModel(
        model, {"v": 0.01}, {"deflection": 0.002}, {"q": 0.01, "v": 0.01}, substeps=16, noise_scheme="sampled"
    )
    time = np.arange(120) * 0.05
    pattern = MatchedLog("ring", time, np.zeros((0, 120)), np.zeros((1, 120)))
    log = draw_logs(exact, pattern, 1, seed=5, theta=model.theta(**TRUTH)).logs[0]
    return pose(replace(exact, substeps=substeps), log, ["k", "d"], initial="model")


def solved(substeps: int, **settings: object) -> object:
    return estimate(problem(substeps), Settings(method="gradient", starts=1, **settings))


def test_a_fine_step_is_certified_as_it_is() -> None:
    found = solved(8)
    assert found.certification.certified and found.certification.continued == 0
    (check,) = found.certification.checks
    assert check.substeps == 16 and check.shift < NEGLIGIBLE_SHIFT
    assert found.to_dict()["discretisation"]["certified"] is True


def test_a_long_step_is_seen_and_the_search_goes_on_with_finer_ones() -> None:
    left = solved(1, certify="none")
    assert not left.certification.certified and left.certification.checks == ()
    assert abs(left.values["d"] - TRUTH["d"]) > 4.0 * left.std["d"]
    mended = solved(1)
    assert mended.certification.certified and mended.certification.continued >= 1
    assert mended.certification.substeps == mended.problem.filter_model.substeps > 1
    assert abs(mended.values["d"] - TRUTH["d"]) < 3.0 * mended.std["d"]
    assert mended.evaluations > left.evaluations and mended.trace[-1].evaluations > left.trace[-1].evaluations


def test_the_shift_that_is_foretold_is_the_one_that_happens() -> None:
    coarse = solved(2, certify="step")
    if coarse.certification.continued:
        coarse = solved(4)
    (check,) = coarse.certification.checks
    finer = solved(check.substeps, certify="none")
    moved = (finer.values[check.parameter] - coarse.values[check.parameter]) / coarse.std[check.parameter]
    assert abs(moved) == pytest.approx(check.shift, rel=0.1, abs=1e-3)
    assert coarse.nll - finer.nll == pytest.approx(check.nats, abs=0.02)


def test_steps_planned_too_loosely_are_planned_again_where_the_search_ended() -> None:
    plain = problem(8)
    stiff = replace(plain.filter_model, method="ros3p")
    loose = plan_steps(stiff, plain.logs, methods=["ros3p"], tolerance=10.0)
    found = estimate(replace(plain, filter_model=loose), Settings(method="gradient", starts=1))
    assert found.certification.certified and found.certification.continued >= 1
    plan = found.problem.filter_model.plan
    assert plan is not None and plan.mean_substeps > loose.plan.mean_substeps
    assert plan != loose.plan.halved()
    reference = solved(8)
    for name, value in reference.values.items():
        assert abs(found.values[name] - value) < 0.2 * reference.std[name]


def test_an_end_that_is_no_optimum_has_its_discretisation_error_too() -> None:
    swarm = SwarmSettings(members=8, iterations=2)
    fine = estimate(problem(16), Settings(method="pso", swarm=swarm))
    coarse = estimate(problem(1), Settings(method="pso", swarm=swarm))
    assert fine.outcome is coarse.outcome is SearchOutcome.ITERATION_LIMIT
    (good,), (bad,) = fine.certification.checks, coarse.certification.checks
    assert good.shift < NEGLIGIBLE_SHIFT < bad.shift
    finer = replace(coarse.problem, filter_model=coarse.problem.filter_model.with_halved_steps())
    difference = coarse.nll - float(finer.nll(coarse.point[:, np.newaxis])[0])
    assert bad.nats == pytest.approx(difference, rel=1e-9)
    assert coarse.certification.continued == 0


def test_finer_steps_are_finer_everywhere_in_an_interval_also_where_they_are_graded() -> None:
    graded = replace(problem(16), filter_model=replace(problem(16).filter_model, method="ros3p", grading=1.35))
    (finer,) = finer_problems(graded, np.array([156.0, 0.5]), "step")
    used = (graded.filter_model, finer.parts[0].filter_model)
    before, after = (step_lengths(0.05, f.substeps, f.grading) for f in used)
    assert after.reshape(16, 2).sum(axis=1) == pytest.approx(before, rel=1e-12)
    assert (after.max() / before.max()) < 0.55


def test_it_reads_as_a_sentence() -> None:
    check = Check("rk4", 8, -0.02, 0.31, "mass")
    text = str(Certification("rk4", 4, (check,), 2))
    assert text.startswith("rk4 with 4 substeps: not certified")
    assert "mass moves by 0.31 standard deviations" in text


def test_a_depth_that_does_not_exist_is_refused() -> None:
    with pytest.raises(OptionError, match="certify 'deep' is not known"):
        Settings(certify="deep")  # type: ignore[arg-type]
