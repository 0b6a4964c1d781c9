"""Fits of a loop looked at with halved integration steps: what is resolved is certified, what is not is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.correct.fits.fit import expand, fit
from bondgraph.correct.fits.setup import filter_setup
from bondgraph.correct.loop import free_parameters
from bondgraph.correct.models.build import build
from bondgraph.correct.refits import certified
from bondgraph.correct.refits.certified import Certifications, certify, doubts, refined
from bondgraph.declare.editing import with_values
from bondgraph.estimate.certify import NEGLIGIBLE_SHIFT, check
from tests.correct.sled import fitted, pull, sled
from tests.correct.test_stiff import drawn, setup_of


def test_a_resolved_fit_is_certified() -> None:
    found = certify(fitted([pull(sled(), 2)]))
    assert found.shift <= NEGLIGIBLE_SHIFT
    assert doubts("declared", found) == []


def test_steps_that_are_too_long_are_told() -> None:
    log = drawn(0.0)
    setup = setup_of(log)
    fine = fit(setup.filter_model, [log], (*free_parameters(setup, ()), *setup.noise))
    coarse = replace(setup.filter_model, method="ros2", substeps=1, grading=1.0)
    problem = replace(fine.problem, filter_model=coarse)
    expansion = expand(problem, fine.point, np.full(fine.point.size, 1e-5))
    found = certify(replace(fine, problem=problem, expansion=expansion))
    assert found.shift > NEGLIGIBLE_SHIFT and abs(found.nats) > 1.0
    (said,) = doubts("declared", found)
    assert said.startswith(
        f"the declared model is not certified: with every integration step halved, {found.parameter}"
    )


def test_innovations_alone_are_believed_only_where_they_say_little(monkeypatch: pytest.MonkeyPatch) -> None:
    resolved = fitted([pull(sled(), 2)])
    by_innovations = certify(resolved)
    asked: list[int] = []

    def counting(*args: object, **settings: object) -> object:
        asked.append(1)
        return check(*args, **settings)  # type: ignore[arg-type]

    monkeypatch.setattr(certified, "check", counting)
    certify(resolved)
    assert not asked
    monkeypatch.setattr(certified, "_SURE", 0.0)
    by_derivatives = certify(resolved)
    assert asked
    assert by_derivatives.shift <= NEGLIGIBLE_SHIFT
    assert by_innovations.nats == pytest.approx(by_derivatives.nats, abs=1e-6)


def test_a_fit_goes_on_with_shorter_steps_where_its_steps_move_it() -> None:
    # samples 1.3 time constants apart: one step between two of them is stable, and off
    light = with_values(sled(), {"m_sled": 4.0, "c_guide": 52.0})
    log, own = pull(light, 2), build(light)
    setup = filter_setup(own.model, own.driven, [log])
    free = (*free_parameters(setup, ()), *setup.noise)
    coarse = fit(replace(setup.filter_model, substeps=1), [log], free)
    assert certify(coarse).shift > NEGLIGIBLE_SHIFT
    fine, found = refined(coarse)
    assert found.shift <= NEGLIGIBLE_SHIFT and fine.problem.filter_model.substeps > 1
    assert abs(fine.values["c_guide"] - 52.0) < 3.0 * fine.std["c_guide"] * fine.values["c_guide"]
    again, _ = refined(fine)
    assert again is fine


def test_a_check_beside_the_loop_is_the_same() -> None:
    log = drawn(0.0)
    setup = setup_of(log)
    stiff = fit(setup.filter_model, [log], (*free_parameters(setup, ()), *setup.noise))
    with Certifications() as checks:
        checks.begin(stiff)
        again, found = checks.refined(stiff)
    assert again is stiff and found == certify(stiff)
    assert not found.parameter.startswith(("std", "process"))
    plain = fitted([pull(sled(), 2)])
    with Certifications() as checks:
        checks.begin(plain)
        assert checks.refined(plain) == refined(plain)
