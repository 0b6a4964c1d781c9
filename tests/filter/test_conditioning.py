"""A likelihood that rounding moves is told from one that it does not, and the steps are what makes it so."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.data.log import MatchedLog
from bondgraph.data.matching import match
from bondgraph.data.read import read_log
from bondgraph.errors import FilterError
from bondgraph.estimate.derivatives.exact import exact_expansion
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import pose
from bondgraph.filter import ukf
from bondgraph.filter.belief import Belief, PointFunction, Prediction, Update
from bondgraph.filter.conditioning import conditioning
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.gradient import Directions, InnovationTangents, innovation_tangents
from bondgraph.filter.likelihood import likelihood
from bondgraph.filter.samples import MeasuredLog, Samples
from bondgraph.filter.sigma_points import MerweScaled, lower_factor
from bondgraph.filter.ukf import Member
from bondgraph.simulate.model import Model
from bondgraph.simulate.outcome import Outcome
from vehicle_graphs.ranger_filters import NOISE

BOTH = pytest.mark.parametrize("compiled", [False, True])

#: A mass that a belt grips: the force saturates within 1 mm/s of slip.
GRIPPED = '''
"""A mass on a belt that moves."""
import numpy as np

NAME = "gripped"
FORMAT = "bondgraph-module/1"
STATES = (("v", "m/s", 0.0, "speed"),)
INPUTS = (("belt", "m/s", 0.0, "linear", None, "speed of the belt"),)
PARAMETERS = (("grip", "m/s^2", 5.0, 1.0, 20.0, "largest force of the belt over the mass"),)
OUTPUTS = (("speed", "m/s", "speed"),)


def rhs(t, x, u, theta):
    """dx/dt"""
    v = x[0]
    belt = u[0]
    grip = theta[0]
    dx0 = grip*np.tanh((belt - v)/1e-3)
    return _stack(x, (dx0,))


def output(t, x, u, theta):
    """y"""
    y0 = x[0]
    return _stack(x, (y0,))


def _stack(x, rows):
    stacked = np.empty((len(rows), *x.shape[1:]))
    for i, row in enumerate(rows):
        stacked[i] = row
    return stacked
'''


def gripped(substeps: int, **changes: object) -> tuple[FilterModel, MatchedLog]:
    time = np.arange(150) * 0.02
    belt = 0.3 * np.sin(3.0 * time)
    log = MatchedLog("belt", time, belt[None], (belt + 0.01 * np.random.default_rng(1).standard_normal(150))[None])
    noise = {"process_noise": {"v": 1e-6}, "measurement_noise": {"speed": 0.01}, "initial_std": {"v": 1e-3}}
    settings = {"method": "rk4", "noise_scheme": "sampled", "alpha": 1.0, **changes}
    return FilterModel(Model.from_text(GRIPPED), **noise, substeps=substeps, **settings), log  # type: ignore[arg-type]


def grip_tangents(filter_model: FilterModel, log: MeasuredLog) -> InnovationTangents:
    directions = Directions(np.ones((1, 1)), *(np.zeros((1, 1)) for _ in range(4)))
    (found,) = innovation_tangents(filter_model, [log], [Member.of(filter_model)], [directions])
    return found


@BOTH
def test_long_steps_make_a_value_of_rounding_and_short_ones_do_not(compiled: bool) -> None:
    found = {}
    for substeps in (4, 64):
        filter_model, log = gripped(substeps)
        found[substeps] = conditioning(filter_model, log, compiled=compiled)
        assert found[substeps].nll == likelihood(filter_model, log, compiled=compiled).nll[0]
    assert found[4].outcome is Outcome.ILL_CONDITIONED
    assert found[4].nats > 1.0
    assert "use more substeps" in str(found[4])
    assert (found[64].outcome, found[64].negligible) == (Outcome.OK, True)


def test_a_stiff_method_and_an_automatic_one_are_well_conditioned() -> None:
    for method in ("ros3p", "auto"):
        assert likelihood(*gripped(1, method=method)).conditioning.negligible


def test_a_likelihood_speaks_of_its_best_member() -> None:
    filter_model, log = gripped(64)
    grips = np.array([[0.2, 5.0, 20.0]])
    found = likelihood(filter_model, [log, log], grips)
    best = grips[:, int(np.argmin(found.nll))]
    assert found.conditioning == conditioning(filter_model, [log, log], best)


def test_a_filter_that_fails_at_every_twin_is_no_matter_of_rounding() -> None:
    filter_model, log = gripped(1)
    found = conditioning(filter_model, log, np.array([np.inf]))
    assert (found.nll, found.outcome) == (np.inf, Outcome.OK)


def test_what_is_wrong_with_the_numbers_is_told() -> None:
    filter_model, log = gripped(1)
    with pytest.raises(FilterError, match="one per log"):
        conditioning(filter_model, log, x0=[np.zeros(1), np.zeros(1)])


def test_derivatives_of_rounding_are_none() -> None:
    pytest.importorskip("numba")
    for substeps, outcome in ((4, Outcome.ILL_CONDITIONED), (64, Outcome.OK)):
        filter_model, log = gripped(substeps)
        found = grip_tangents(filter_model, log)
        assert found.outcome is outcome
        assert np.isfinite(found.d_values).all() == np.isfinite(found.values).all() == (outcome is Outcome.OK)
        problem = pose(filter_model, log, ["grip"])
        assert (exact_expansion(problem, problem.start) is None) == (outcome is not Outcome.OK)


def test_a_search_does_not_end_where_rounding_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = pose(*gripped(1), ["grip"])
    settings = Settings(method="gradient", starts=1)
    found = estimate(problem, settings)
    assert found.certification.continued > 0
    assert found.certification.conditioning is not None
    assert found.certification.conditioning.negligible
    assert found.problem.filter_model.substeps > 4
    monkeypatch.setattr(sys.modules[estimate.__module__], "_MOST_REFINEMENTS", 0)
    stopped = estimate(problem, settings)
    assert stopped.outcome is SearchOutcome.ILL_CONDITIONED
    assert not stopped.outcome.succeeded
    assert (stopped.certification.certified, stopped.certification.to_dict()["ill_conditioned"]) == (False, True)
    assert "rounding moves the likelihood by" in str(stopped.certification)
    assert np.isnan(stopped.std["grip"])  # derivatives are rounding errors, too


def drive_window(shared_data: Path, drive: int, first: int) -> tuple[FilterModel, MatchedLog]:
    """The vehicle at its declared parameters with the four graded steps that were usual, far from a fit."""
    model = Model.from_file(Path(__file__).resolve().parents[2] / "generated" / "ranger_full.py")
    log = match(read_log(shared_data / "ranger_logs" / f"drive_{drive}.csv"), model).rows(slice(first, first + 200))
    known = NOISE["ranger_full"].filter_model(model)
    return replace(known, method="ros3p", substeps=4, grading=2.5, noise_scheme="sampled"), log


@pytest.mark.slow
@pytest.mark.parametrize(
    ("drive", "first", "scheme", "floors"),
    [(1, 0, "sampled", True), (1, 0, "continuous", True), (2, 3600, "sampled", True), (2, 5200, "sampled", False)],
)
def test_windows_of_recorded_drives_are_told(
    shared_data: Path, drive: int, first: int, scheme: str, floors: bool
) -> None:
    """The value moves by hundreds of nats of 36 000 to 600 000, whether or not pivots are floored on the way."""
    filter_model, log = drive_window(shared_data, drive, first)
    filter_model = replace(filter_model, noise_scheme=scheme)
    found = conditioning(filter_model, log)
    assert found.outcome is Outcome.ILL_CONDITIONED
    assert found.nats > 100.0
    theta = filter_model.model.theta()
    twins = theta[:, np.newaxis] * (1.0 + np.finfo(np.float64).eps * np.arange(8))
    assert likelihood(filter_model, log, twins).floored_pivots.any() == floors
    finer = replace(filter_model, substeps=32, grading=1.0)
    steady = conditioning(finer, log)
    assert steady.nats < 1e-11 * abs(steady.nll)
    assert likelihood(replace(filter_model, method="auto"), log).conditioning.negligible
    outcomes = [vehicle_tangents(used, log).outcome for used in (filter_model, finer)]
    assert outcomes == [Outcome.ILL_CONDITIONED, Outcome.OK]


def vehicle_tangents(filter_model: FilterModel, log: MatchedLog) -> InnovationTangents:
    """Derivatives by two parameters of the engine and the CVT."""
    model = filter_model.model
    moves = np.zeros((len(model.parameters), 2))
    for column, name in enumerate(("T_pk", "m_fw")):
        moves[model.index("parameter", name), column] = 1.0
    sizes = [len(model.states)] * 3 + [len(model.outputs)]
    directions = Directions(moves, *(np.zeros((size, 2)) for size in sizes))
    return innovation_tangents(filter_model, [log], [Member.of(filter_model)], [directions])[0]


def root_of(*parts: np.ndarray) -> np.ndarray:
    """Lower factor of the sum of the squares of some parts, by Householder's reflections: no square is formed."""
    lower = np.linalg.qr(np.hstack(parts).T, mode="r").T
    return lower * np.where(np.diag(lower) < 0.0, -1.0, 1.0)


def root_predict(belief: Belief, move: PointFunction, noise: np.ndarray, points: MerweScaled) -> Prediction:
    """The prediction of the square-root form (van der Merwe and Wan 2001)."""
    moved = move(points.draw(belief.mean, belief.lower))
    mean, _, deviations = points.moments(moved)
    shift = (mean - moved[:, 0])[:, np.newaxis]
    parts = (np.sqrt(points.weight) * deviations[:, 1:], np.sqrt(points.correction) * shift)
    lower = root_of(*parts, lower_factor(noise).lower)
    after = Belief(mean, lower @ lower.T, lower)
    return Prediction(after, points.cross_cov(belief.lower, deviations), 0, Outcome.OK)


def root_update(
    belief: Belief, y: np.ndarray, see: PointFunction, noise: np.ndarray, points: MerweScaled, robust: object = None
) -> Update:
    """The update of the square-root form: odd and even parts of the outputs, their shift and the sensors' noise."""
    outputs = see(points.draw(belief.mean, belief.lower))
    mean, cov, deviations = points.moments(outputs)
    n, size = points.n, y.size
    above, below = deviations[:, 1 : n + 1], deviations[:, n + 1 :]
    even = (above + below) / (2.0 * points.spread)
    shift = np.sqrt(points.correction) * (mean - outputs[:, 0])[:, np.newaxis]
    top = np.hstack([(above - below) / (2.0 * points.spread), even, shift, np.linalg.cholesky(noise)])
    joint = root_of(np.vstack([top, np.hstack([belief.lower, np.zeros((n, top.shape[1] - n))])]))
    whitened = np.linalg.solve(joint[:size, :size], y - mean)
    lower = joint[size:, size : size + n]
    after = Belief(belief.mean + joint[size:, :size] @ whitened, lower @ lower.T, lower)
    scales = np.log(np.diag(joint)[:size])
    return Update(after, mean, cov + noise, y - mean, whitened, scales, joint[size:, :size], 0, Outcome.OK)


@pytest.mark.slow
@pytest.mark.parametrize(("drive", "first"), [(1, 0), (2, 5200)])
def test_a_square_root_form_moves_as_much(
    shared_data: Path, drive: int, first: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It keeps every direction and floors none: what multiplies rounding is the motion, not the factor."""
    filter_model, log = drive_window(shared_data, drive, first)
    samples, theta = Samples.of(filter_model, log), filter_model.model.theta()
    twins = [Member.of(filter_model, own) for own in (theta, np.nextafter(theta, np.inf))]
    monkeypatch.setattr(ukf, "predict", root_predict)
    monkeypatch.setattr(ukf, "update", root_update)
    runs = [ukf.reference_run(filter_model, samples, twin) for twin in twins]
    assert [run.floored_pivots for run in runs] == [0, 0]
    assert abs(runs[0].nll - runs[1].nll) > 1e-4 * abs(runs[0].nll)
