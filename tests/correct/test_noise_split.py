"""Noise of states and noise of sensors: a fit that silenced its sensors is looked for again from the quiet side."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from bondgraph.correct.evidence.noise_split import from_quiet_side
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.searches import expand
from tests.correct.sled import fitted, pull, sled


@functools.cache
def silenced() -> Fit:
    """The sled with sensors that are next to perfect and noise that drives it, the rest as likely as it can be."""
    problem = fitted([pull(sled(), 1)]).problem
    free = [replace(one, lower=1e-4 * one.lower) if one.target.kind == "std" else one for one in problem.free]
    perfect = {one.target.name: one.lower for one in free if one.target.kind == "std"}
    noisy = replace(problem.filter_model, measurement_noise=perfect)
    rest = [one for one in problem.free if one.target.kind != "std"]
    driven = fit(EstimationProblem(noisy, problem.logs, tuple(rest), problem.initial))
    problem = replace(problem, free=tuple(free))
    values = {**driven.values, **{one.name: one.lower for one in free if one.target.kind == "std"}}
    point = np.array([one.coordinate(values[one.name]) for one in free])
    expansion = expand(problem, point, 1e-6 * (problem.upper - problem.lower))
    return Fit(problem, point, driven.nll, expansion, driven.evaluations, driven.outcome)


def test_sensors_next_to_perfect_tell_a_search_nothing_and_the_quiet_side_frees_them() -> None:
    best = fitted([pull(sled(), 1)])
    trapped = silenced()
    kinds = np.array([one.target.kind for one in trapped.problem.free])
    assert np.any(np.diag(trapped.expansion.information)[kinds == "std"] < 1.0)
    assert trapped.nll > best.nll + 100.0
    found = from_quiet_side(trapped)
    assert found is not None
    assert found.nll == pytest.approx(best.nll, abs=0.1)
    assert found.values["c_guide"] == pytest.approx(best.values["c_guide"], rel=0.01)


def test_a_fit_whose_sensors_are_noisy_is_left_alone() -> None:
    assert from_quiet_side(fitted([pull(sled(), 1)])) is None
