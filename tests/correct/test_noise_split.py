"""Noise of states and noise of sensors: a fit that silenced its sensors is looked for again from the quiet side."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from bondgraph.correct.evidence.noise_split import from_quiet_side
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.local import fit
from bondgraph.estimate.objective import SearchOutcome
from tests.correct.sled import fitted, pull, sled


@functools.cache
def silenced() -> Fit:
    """The sled's fit begun with a sensor that is next to perfect: it ends there."""
    problem = fitted([pull(sled(), 1)]).problem
    free = [replace(one, lower=1e-4 * one.lower) if one.target.kind == "std" else one for one in problem.free]
    problem = replace(problem, free=tuple(free))
    kinds = np.array([one.target.kind for one in problem.free])
    start = np.where(kinds == "std", problem.lower, problem.start)
    start = np.where(kinds == "process", 0.2 * problem.lower + 0.8 * problem.upper, start)
    return fit(problem.filter_model, problem.logs, problem.free, starts=[start])


def test_a_sensor_on_its_bound_holds_a_search_and_the_quiet_side_frees_it() -> None:
    best = fitted([pull(sled(), 1)])
    trapped = silenced()
    kinds = np.array([one.target.kind for one in trapped.problem.free])
    assert np.any((trapped.point == trapped.problem.lower) & (kinds == "std"))
    assert trapped.outcome is SearchOutcome.CONVERGED and trapped.nll > best.nll + 100.0
    found = from_quiet_side(trapped)
    assert found is not None
    assert found.nll == pytest.approx(best.nll, abs=0.1)
    assert found.values["c_guide"] == pytest.approx(best.values["c_guide"], rel=0.01)


def test_a_fit_whose_sensors_are_noisy_is_left_alone() -> None:
    assert from_quiet_side(fitted([pull(sled(), 1)])) is None
