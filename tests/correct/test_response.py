"""The linearised filter: its responses are those of the filter itself, whatever is changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from bondgraph import effects
from bondgraph.build import build
from bondgraph.compile.machine_code import has_numba
from bondgraph.correct.evidence.context import coefficients
from bondgraph.correct.models.candidates import Candidate, candidates, places
from bondgraph.correct.places.located import locate
from bondgraph.correct.places.probes import hats, probes, signals
from bondgraph.correct.places.structure import structure
from bondgraph.correct.scores.gates import best_gated, gate_samples
from bondgraph.correct.scores.scoring import Linearisation, linearisation, score_candidates
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import copy, handle
from bondgraph.effects.sensors import SENSOR_FAULTS
from bondgraph.estimate.derivatives.differences import central_differences
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.filter.linear.exponentials import phi
from bondgraph.filter.linear.recursion import _carried, _in_numpy
from bondgraph.filter.linear.response import Change, own_states
from tests.correct.sled import FUNCTIONS, added, built, fitted, pull, sled


@pytest.fixture(scope="module")
def logs() -> list[MatchedLog]:
    """Two logs, one with missing measurements."""
    first, second = pull(sled(), 1, name="first", c_guide=15.0), pull(sled(), 2, name="second", c_guide=15.0)
    y = second.y.copy()
    y[0, ::7] = np.nan
    return [first, replace(second, y=y)]


@pytest.fixture(scope="module")
def linear(logs: list[MatchedLog]) -> Linearisation:
    return linearisation(fitted(logs), logs)


@pytest.fixture(scope="module")
def offered(linear: Linearisation, logs: list[MatchedLog]) -> list[Candidate]:
    where = places(built(), logs, linear.base.runs(logs), linear.base.theta)
    found, _ = candidates(built(), (*FUNCTIONS, *SENSOR_FAULTS[:3]), where)
    return found


def test_responses_are_those_of_the_filter(
    linear: Linearisation, offered: list[Candidate], logs: list[MatchedLog]
) -> None:
    scored = score_candidates(linear, offered)
    for one, column in zip(offered, scored.columns, strict=True):
        with_it = replace(linear.base.problem.filter_model, model=one.model)
        problem = EstimationProblem(with_it, tuple(logs), (*linear.base.problem.free, coefficients(one, with_it)[0]))
        point = np.append(linear.base.point, 0.0)
        steps = 1e-5 * (problem.upper - problem.lower)
        (expansion,) = central_differences(problem, point[:, np.newaxis], steps[:, np.newaxis])
        assert expansion.terms is not None
        truth = expansion.terms.innovations[:, -1]
        error = np.abs(column[:, 0] - truth).max() / np.abs(truth).max()
        changes_gains = one.effect.name in ("added_inertia", "sensor_scale")  # which the linearised filter holds
        assert error < (5e-3 if changes_gains else 5e-4), one.label


@pytest.mark.skipif(not has_numba(), reason="compiled kernels need numba")
@pytest.mark.parametrize("first", [0, 700])
def test_the_compiled_recursion_is_the_formulas(linear: Linearisation, first: int) -> None:
    log, random = linear.logs[0], np.random.default_rng(4)
    outputs, count = log.whitened.shape
    size, lanes = log.slope.shape[2], 5
    start, end = random.standard_normal((2, size, count - 1, lanes))
    start[-1] = end[-1] = 0.0  # a state of which the rate is not shifted
    change = Change(start, end, random.standard_normal((outputs, count, lanes)))
    moved, at = random.standard_normal((size, lanes)), [first, first + 3]
    plain, compiled = np.zeros((outputs, count, lanes)), np.zeros((outputs, count, lanes + 3))
    states = _in_numpy(log, change, first, moved.copy(), at, plain)
    again = _carried(log, change, first, moved.copy(), at, compiled, 2)
    np.testing.assert_allclose(compiled[:, :, 2 : 2 + lanes], plain, rtol=1e-9, atol=1e-9 * np.abs(plain).max())
    np.testing.assert_allclose(again, states, rtol=1e-9, atol=1e-9 * np.abs(states).max())
    assert not compiled[:, :, :2].any() and not compiled[:, :, 2 + lanes :].any()


@pytest.mark.parametrize("size", [1e-3, 0.3, 20.0])
def test_the_integrals_of_the_exponential_are_those_of_an_augmented_matrix(size: float) -> None:
    a = size * (np.random.default_rng(2).standard_normal((3, 4, 4)) - 2.0 * np.eye(4))
    whole, first, second = phi(a)
    for k in range(3):
        wide = np.zeros((12, 12))
        wide[:4, :4], wide[:4, 4:8], wide[4:8, 8:] = a[k], np.eye(4), np.eye(4)
        exact = expm(wide)[:4]
        found = np.concatenate([whole[k], first[k], second[k]], axis=1)
        assert np.abs(found - exact).max() < 1e-9 * np.abs(exact).max()


def test_a_state_of_a_law_is_carried_along_alone_as_beside_another(linear: Linearisation) -> None:
    alone = added(effects.viscoelastic_drag, "runner", 2.0)
    both = copy(alone)
    both.integral("way", handle(both, "runner").flow, "m", "another state of its own")
    found = []
    for graph in (alone, both):
        model = build(graph).model
        own = [name for name in model.names("state") if name not in built().model.names("state")]
        carried = own_states(linear.logs[0].path, model, model.theta())
        found.append(carried[own.index("follows_viscoelastic_drag_runner") if len(own) > 1 else 0])
    assert np.ptp(found[0]) > 0.0
    assert found[0] == pytest.approx(found[1], rel=1e-12, abs=1e-14)


def test_a_gated_response_is_that_of_an_effect_that_begins_there(
    linear: Linearisation, offered: list[Candidate], logs: list[MatchedLog]
) -> None:
    """An effect that is there in the second log only is best explained as acting from its beginning."""
    on = added(effects.quadratic_loss, "runner", 0.4)
    parted = [pull(sled(), 1, name="first"), pull(on, 2, name="second")]
    here = linearisation(fitted(parted), parted)
    scored = score_candidates(here, offered, gate_samples(parted))
    best = best_gated(here, scored)
    assert best is not None and best.gate.when == "from"
    seconds = best.gate.time + (40.0 if best.gate.log == "second" else 0.0)
    assert seconds == pytest.approx(40.0, abs=6.0)
    assert best.gain > max(scored.scores.gain)
    peers = [[offered[k].label for k, _ in peer] for peer in best.peers]
    assert {"quadratic_loss at runner", "quadratic_loss at drum"} <= set(peers[0])  # tied rigidly to each other
    assert best.index in {k for k, _ in best.peers[0]}


def test_structure_tells_what_sensors_can_tell_apart(linear: Linearisation, logs: list[MatchedLog]) -> None:
    where = places(built(), logs, linear.base.runs(logs), linear.base.theta)
    told = structure(built(), where, logs, np.array([4.0]))
    assert told.classes == (("drum", "runner"),) and told.invisible == ()
    assert told.like("drum") == ("runner",) and told.like("sensor speed") == ()
    blind = [replace(log, y=np.where([[True], [False]], log.y, np.nan)) for log in logs]
    alone = structure(built(), where, blind, np.array([4.0]))  # one sensor: everything shows in the same way
    assert alone.classes == (("drum", "runner", "sensor speed"),)


def test_places_with_nothing_missing_explain_nothing(linear: Linearisation, logs: list[MatchedLog]) -> None:
    where = places(built(), logs, linear.base.runs(logs), linear.base.theta)
    found = locate(linear, probes(built(), linear, where), signals(built(), linear, where))
    assert {(one.junction, one.variable) for one in found} == {
        ("drum", "effort"), ("runner", "effort"), ("speed", "sensor"), ("force", "sensor")
    }  # fmt: skip
    assert min(one.p_value for one in found) > 0.01


def test_hats_are_a_partition_of_unity() -> None:
    at = np.array([0.0, 1.0, 1.5, 4.0])
    values = np.random.default_rng(0).uniform(-1.0, 6.0, 50)
    shapes = hats(values, at)
    assert shapes.shape == (4, 50) and (shapes >= 0.0).all()
    np.testing.assert_allclose(shapes.sum(axis=0), 1.0)
    np.testing.assert_allclose(at @ shapes, np.clip(values, 0.0, 4.0))
