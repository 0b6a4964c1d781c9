"""Which parameters to free, to fix, to measure: the order of pivoted QR, a law with one ratio too many, and tables."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import qr

from bondgraph.estimate.analysis.ranking import _successive, rank_parameters
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.problem import pose
from tests.estimate.linear import ExactLikelihood, lag, simulated

LOGS = (simulated("run1", 1, {}, 60), simulated("run2", 2, {}, 60, x0=1.0))


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_the_successive_choice_is_qr_with_column_pivoting(seed: int) -> None:
    columns = np.random.default_rng(seed).normal(size=(30, 6)) * 10.0 ** np.linspace(1.0, 3.0, 6)
    chosen, order = _successive(columns.T @ columns)
    assert chosen == qr(columns, mode="r", pivoting=True)[1].tolist()
    assert order == chosen


def test_of_three_parameters_that_act_as_two_ratios_one_is_to_be_measured() -> None:
    """The acceleration is (gain u - drag v)/mass; the colour acts on nothing."""
    problem = pose(lag(), LOGS, ["mass", "drag", "gain", "colour"], likelihood=ExactLikelihood())
    found = rank_parameters(problem)
    assert len(found.named("free")) == 2 and len(found.named("measure")) == 1
    assert found.named("fix") == ("colour",)
    measured = next(one for one in found.parameters if one.advice == "measure")
    assert measured.partner[0] in found.named("free") and abs(measured.partner[1]) > 0.5
    (group,) = found.combinations
    assert group.names == ("mass", "drag", "gain") and group.law == "product"
    assert {*group.known} == {"mass/gain", "drag/gain"} or len(group.known) == 2


def test_a_parameter_weighed_before_is_told_less_by_the_logs() -> None:
    weighed = FreeParameter("mass", 0.5, 8.0, 2.0, prior_mean=2.0, prior_std=1e-4)
    found = rank_parameters(pose(lag(), LOGS, [weighed, "drag"], likelihood=ExactLikelihood()))
    row = next(one for one in found.parameters if one.name == "mass")
    assert row.advice == "fix" and row.prior_std == pytest.approx(1e-4)
    assert row.std_alone > 10.0 * row.prior_std  # what the logs alone say of it


def test_the_standard_deviation_if_freed_is_that_of_a_problem_with_nothing_else_free() -> None:
    found = rank_parameters(pose(lag(), LOGS, ["mass", "drag", "colour"], likelihood=ExactLikelihood()))
    alone = rank_parameters(pose(lag(), LOGS, ["mass", "drag"], likelihood=ExactLikelihood()))
    freed = {one.name: one.std_freed for one in found.parameters}
    joint = {one.name: one.std_joint for one in alone.parameters}
    assert freed["mass"] == pytest.approx(joint["mass"], rel=1e-6)
    assert freed["drag"] == pytest.approx(joint["drag"], rel=1e-6)


def test_tables_pictures_and_json_hold_every_parameter() -> None:
    found = rank_parameters(
        pose(lag(), LOGS, ["mass", "drag", "colour"], likelihood=ExactLikelihood()), None, central_differences
    )
    assert list(found.to_dataframe().index) == [one.name for one in found.parameters]
    written = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert written["ranking"]["colour"]["advice"] == "fix" and written["ranking"]["colour"]["std_joint"] is None
    assert len(found.plot().get_yticks()) == 3
    assert "fix colour" in found.summary() and "nan" not in found.summary()
