"""Joint problems: shared, tied and per-log parameters of several filter models, against sums and differences."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.errors import BondGraphError, EstimationError
from bondgraph.estimate.analysis.ranking import rank_parameters
from bondgraph.estimate.analysis.rates import rate_table
from bondgraph.estimate.analysis.screening import likelihood_response, problem_bounds
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.derivatives.exact import exact_expansion
from bondgraph.estimate.estimation import Settings, estimate
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.handover import is_shortened, without_noise_levels
from bondgraph.estimate.joint import JointProblem, pose_joint
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.priors import Normal
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.sensitivities import sensitivity
from bondgraph.estimate.solvers.particle_swarm import SwarmSettings
from bondgraph.estimate.ties import Tie
from bondgraph.report.estimation import estimate_report
from bondgraph.report.html import Provenance
from tests.estimate.linear import ExactLikelihood, lag, simulated

ONE = Settings(method="gradient", starts=1)
TRUTH = {"mass": 2.6, "drag": 2.2, "process": 0.15, "speed": 0.08}
LOGS = [simulated("run1", 3, TRUTH), simulated("run2", 4, TRUTH, x0=1.0), simulated("run3", 5, TRUTH)]


def two_models(**changes: object) -> JointProblem:
    """One lag filtered by two models that differ in their steps and what noise they know."""
    first = pose(lag(substeps=2), LOGS[:2], ["mass", "drag", "std(speed)"])
    second = pose(lag(substeps=3, process_noise={"v": 0.15}), LOGS[2], ["drag", "mass", "gain"])
    return pose_joint([first, second], **changes)  # type: ignore[arg-type]


def test_one_model_in_two_parts_is_one_problem() -> None:
    """The same filter over the same logs: the sum of the parts, coordinate by coordinate."""
    whole = pose(lag(), LOGS, ["mass", "drag"], likelihood=ExactLikelihood())
    parts = [pose(lag(), logs, ["drag", "mass"], likelihood=ExactLikelihood()) for logs in (LOGS[:1], LOGS[1:])]
    joint = pose_joint(parts, priors=[Normal("mass", 2.5, 0.2)])
    assert joint.names == ("drag", "mass")
    points = np.array([np.log([2.0, 2.5]), [2.2, 2.7]])
    prior = 0.5 * ((points[1] - 2.5) / 0.2) ** 2
    np.testing.assert_allclose(joint.nll(points), whole.nll(points[::-1]) + prior, rtol=1e-12)
    fit, expected = estimate(joint, ONE), estimate(replace(whole, priors=(Normal("mass", 2.5, 0.2),)), ONE)
    for name in joint.names:
        assert fit.values[name] == pytest.approx(expected.values[name], rel=1e-5)
        assert fit.std[name] == pytest.approx(expected.std[name], rel=1e-3)


def test_derivatives_through_parts_ties_and_priors_are_exact() -> None:
    ties = {"load": "0.1*mass**2 + sqrt(drag)"}
    joint = two_models(ties=ties, priors=[Normal("load", 2.0, 0.3), Normal("mass", 2.0, 0.5)])
    point = joint.start * 1.02
    found = exact_expansion(joint, point)
    (expected,) = central_differences(joint, point[:, np.newaxis], np.full((joint.start.size, 1), 1e-5))
    assert found is not None
    np.testing.assert_allclose(found.gradient, expected.gradient, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.information, expected.information, rtol=1e-6, atol=1e-5)


def test_a_tie_is_the_same_as_its_value() -> None:
    problem = pose(lag(), LOGS, ["mass"], likelihood=ExactLikelihood(), ties={"drag": "0.8*mass"})
    fixed = pose(lag(), LOGS, ["mass", "drag"], likelihood=ExactLikelihood())
    np.testing.assert_array_equal(problem.nll(np.array([[2.5]])), fixed.nll(np.array([[2.5], [np.log(2.0)]])))


def test_a_common_factor_that_no_model_has_acts_through_its_ties() -> None:
    factor = FreeParameter("factor", 0.5, 2.0, 1.0)
    problem = pose(lag(), LOGS, [factor], ties={"mass": "2*factor", "drag": "3*factor"})
    plain = pose(lag(), LOGS, ["mass", "drag"])
    found = problem.nll(np.array([[1.1]]))
    np.testing.assert_allclose(found, plain.nll(np.array([[2.2], [np.log(3.3)]])), rtol=1e-12)
    fit = estimate(problem, ONE)
    assert fit.outcome is SearchOutcome.CONVERGED and "factor" in fit.summary()


def test_a_parameter_per_log_is_estimated_in_each() -> None:
    """Payloads: separate problems know the same of each log where nothing else is shared."""
    known = ["load"]
    free = [FreeParameter("load", 0.0, 5.0, 0.5)]
    logs = [simulated("empty", 7, TRUTH | {"load": 0.2}), simulated("laden", 8, TRUTH | {"load": 1.8})]
    joint = pose_joint([pose(lag(), logs, free)], per_log=known)
    assert joint.names == ("load(empty)", "load(laden)")
    fit = estimate(joint, ONE)
    for log in logs:
        alone = estimate(pose(lag(), log, free), ONE)
        assert fit.values[f"load({log.name})"] == pytest.approx(alone.values["load"], rel=1e-5, abs=1e-5)
    shared = pose_joint([pose(lag(), logs, ["mass", *free])], per_log=known)
    assert shared.names == ("mass", "load(empty)", "load(laden)")


def test_every_search_takes_joint_problems_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    joint = two_models()
    settings = Settings(starts=2, swarm=SwarmSettings(members=8, iterations=3), certify="full")
    whole = estimate(joint, settings)
    assert whole.outcome.succeeded and whole.certification.checks
    assert [part.problem.name for part in whole.parts] == ["lag", "lag"] and len(whole.runs) == 3
    assert whole.parts[1].filter_model.process_noise == {"v": 0.15}

    class StopError(Exception):
        pass

    def stop(row: object) -> None:
        if row.stage == "gauss-newton" and row.iteration == 2:  # type: ignore[attr-defined]
            raise StopError

    with pytest.raises(StopError):
        estimate(joint, settings, progress=stop, folder=tmp_path)
    again = estimate(joint, settings, folder=tmp_path, resume=True)
    np.testing.assert_array_equal(again.point, whole.point)
    with pytest.raises(EstimationError, match="belongs to another estimation"):
        estimate(replace(joint, priors=(Normal("mass", 2.0, 0.5),)), settings, folder=tmp_path, resume=True)
    assert json.dumps(whole.to_dict())
    with pytest.raises(EstimationError, match="take one of its parts"):
        whole.filter_model  # noqa: B018


def test_a_joint_estimate_has_a_report() -> None:
    fit = estimate(two_models(), ONE)
    data = estimate_report(fit, Provenance("", None, "", (), (), 0.0))
    assert {series.log for series in data.series} == {"run1", "run2", "run3"}
    assert [change.name for change in data.parameters] == ["mass", "drag", "gain"]


def test_the_swarm_leaves_levels_of_noise_alone_in_every_part() -> None:
    joint = two_models()
    part = without_noise_levels(joint)
    assert part.names == ("mass", "drag", "gain") and not is_shortened(joint, part)
    whole = np.concatenate([part.start[:2], [joint.start[2]], part.start[2:]])[:, np.newaxis]
    # a level that is free goes through its logarithm, which rounds by the machine's own library
    np.testing.assert_allclose(part.nll(part.start[:, np.newaxis]), joint.nll(whole), rtol=1e-12)


def problem(**changes: object) -> EstimationProblem:
    return pose(lag(), LOGS, ["mass"], **changes)  # type: ignore[arg-type]


REFUSED = {
    "unknown tied": (lambda: problem(ties={"drga": "mass"}), "lag has no parameter 'drga'; did you mean 'drag'"),
    "unknown variable": (lambda: problem(ties={"drag": "2*masss"}), "there is no one parameter 'masss'; did you mean"),
    "tied and free": (lambda: problem(ties={"mass": "2*mass"}), "free or tied besides its tie"),
    "not a number": (lambda: problem(ties={"drag": "open('x')"}), "tie drag = open"),
    "a call": (lambda: problem(ties={"drag": "mass.real"}), "holds something else"),
    "no text": (lambda: problem(ties={"drag": "2*"}), "cannot be read"),
    "constant": (lambda: Tie("drag", "2.0"), "names no parameter"),
    "nothing free": (lambda: problem(ties={"drag": "2*gain"}), "none of its parameters is free"),
    "per log": (lambda: pose_joint([problem()], per_log=["gain"]), "per_log: 'gain' is not a free parameter"),
    "log by hand": (lambda: pose(lag(), LOGS, [FreeParameter("mass(run1)", 1.0, 3.0, 2.0)]), "pose_joint takes it"),
    "bounds apart": (
        lambda: pose_joint([problem(), pose(lag(), simulated("run9", 1, {}), [FreeParameter("mass", 9.0, 10.0, 9.5)])]),
        "its bounds leave nothing in common",
    ),
    "logs of one name": (lambda: pose_joint([problem(), problem()]), "two logs are called 'run1'"),
    "tie of a split one": (
        lambda: pose_joint([problem()], per_log=["mass"], ties={"drag": "2*mass"}),
        "there is no one parameter 'mass'",
    ),
}


@pytest.mark.parametrize("case", REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_posed_is_refused(case: tuple) -> None:
    with pytest.raises(EstimationError, match=case[1]):
        case[0]()


def test_sensitivities_of_one_model_in_two_parts_are_those_of_one_problem() -> None:
    """A joint problem was refused: its parts have outputs of their own."""
    priors = [Normal("mass", 2.5, 0.2)]
    whole = pose(lag(), LOGS, ["drag", "mass"], priors=priors)
    joint = pose_joint([pose(lag(), logs, ["drag", "mass"]) for logs in (LOGS[:1], LOGS[1:])], priors=priors)
    for verb in (sensitivity, rank_parameters):
        found, expected = (verb(one).to_dataframe() for one in (joint, whole))
        for name in expected.columns:
            if expected[name].dtype.kind == "f":
                np.testing.assert_allclose(found[name], expected[name], rtol=1e-6)
            else:
                assert list(found[name]) == list(expected[name])
    assert sensitivity(joint).outputs == ("speed", "speed_rpm", "prior")
    slower, expected_rates = rate_table(joint, [5.0, 2.0]), rate_table(whole, [5.0, 2.0])
    for one, other in zip(slower.rows, expected_rates.rows, strict=True):
        assert (one.samples, one.work, one.method) == (other.samples, other.work, other.method)
        np.testing.assert_allclose(one.std, other.std, rtol=1e-6)


def test_sensitivities_of_two_models_add_their_information() -> None:
    joint = two_models()
    found = sensitivity(joint)
    assert found.names == joint.names and set(found.to_dict()["parameters"]["gain"]["share"]) == {"speed", "speed_rpm"}
    alone = [sensitivity(part) for part in joint.parts]
    for name in ("mass", "drag"):
        parts = sum(one.std_alone[one.names.index(name)] ** -2 for one in alone)
        assert found.std_alone[found.names.index(name)] ** -2 == pytest.approx(parts, rel=1e-6)
    assert "gain" in found.summary() and likelihood_response(joint)(joint.start[:, np.newaxis]).shape == (1,)
    assert set(problem_bounds(joint)) == set(joint.names)


def test_one_prior_and_one_tie_and_one_name_need_no_list() -> None:
    known, tie = Normal("mass", 2.5, 0.2), Tie("load", "0.1*mass")
    part = pose(lag(), LOGS[:2], ["mass"], ties=tie, priors=known)
    assert (part.priors, part.ties) == ((known,), (tie,))
    joint = pose_joint(pose(lag(), LOGS[:2], ["mass"]), per_log="mass", priors=Normal("mass(run1)", 2.5, 0.2))
    assert joint.names == ("mass(run1)", "mass(run2)")
    assert len(joint.priors) == 1


@pytest.mark.parametrize(("wrong", "message"), [
    (lambda: pose_joint([]), "there is no problem - give those of bg.pose"),
    (lambda: pose_joint([lag()]), "FilterModel was given where a posed problem is expected"),
    (lambda: pose(lag(), LOGS, ["mass"], priors=[("mass", 2.0)]), "tuple was given where a prior is expected - give"),
    (lambda: pose(lag(), LOGS, ["mass"], ties=["load=2*mass"]), "str was given where a tie is expected - give expr"),
    (lambda: pose(lag(), LOGS, ["mass"], ties={"load": 2.0}), "float was given where a tie is expected"),
    (lambda: pose(lag(), LOGS, ["mass"], ties={"load": "2*(mass"}), r"cannot be read \('\(' was never closed\) -"),
])  # fmt: skip
def test_things_of_another_kind_are_refused(wrong: Callable[[], object], message: str) -> None:
    with pytest.raises(BondGraphError, match=message):
        wrong()
