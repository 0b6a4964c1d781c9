"""Reasons why candidates were not chosen: the hurdle that failed with its number, differences with the right sign."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.correct.constants import LEVEL
from bondgraph.correct.evidence.decide import choose
from bondgraph.correct.evidence.reasons import alternatives
from bondgraph.correct.evidence.trials import Evidence, Trial
from bondgraph.correct.models.candidates import candidates
from bondgraph.correct.scores.score import Scores
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale
from bondgraph.effects.sensors import sensor_scale
from bondgraph.estimate.fitted import Fit
from tests.correct.sled import built, fitted, pull, sled

#: The speed alone is measured.
LOG = replace(pull(sled(), 4), y=np.where([[True], [False]], pull(sled(), 4).y, np.nan))
SURE, NONE = Evidence(22.0, 1e-9, 1e-9, 15.0, 10), np.zeros(0)
SCORES = Scores(NONE, (), NONE, np.zeros((0, 0)), np.zeros((0, 0)), NONE)


def _pair() -> tuple[Trial, Trial]:
    """A law and a fault of the only sensor, both refitted and sure."""
    places = [Place(handle(sled(), "runner"), Scale(150.0, 4.0)), Place.sensor("speed", Scale(4.0, 4.0))]
    (drag, scale), _ = candidates(built(), [effects.quadratic_loss, sensor_scale], places)
    base = fitted([LOG])
    return Trial(drag, 20.0, fit=base, evidence=SURE), Trial(scale, 22.0, fit=base, evidence=SURE)


def _why(chosen: Trial | None, trial: Trial, *others: Trial) -> str:
    trials = [one for one in (chosen, trial, *others) if one is not None]
    label = (trial.candidate.effect.described, trial.candidate.place.label)
    return next(one.why for one in alternatives(chosen, trials, SCORES, LEVEL) if (one.name, one.junction) == label)


@pytest.mark.parametrize(("evidence", "words"), [
    (Evidence(22.0, 1e-9, 0.4, 15.0, 10), "its block-robust p = 0.4 is above 0.01 (p counts all 10 tried)"),
    (Evidence(22.0, 0.03, 1e-9, 15.0, 9), "its p = 0.03 by the likelihood ratio is above 0.01 (p counts all 9 tried)"),
    (Evidence(22.0, 1e-9, 1e-9, -1.5, 10), "its parameters cost 1.5 nats more than it gains (BIC)"),
])  # fmt: skip
def test_the_hurdle_that_fails_is_said_with_its_number(evidence: Evidence, words: str) -> None:
    law, _ = _pair()
    assert _why(None, replace(law, evidence=evidence)) == words
    less = replace(law, evidence=replace(SURE, delta_nll=10.0))
    fault = replace(_pair()[1], evidence=evidence)
    assert _why(less, fault, less) == f"it gains 12.0 nats more, but {words}"


def test_a_fault_of_the_only_sensor_that_passes_is_not_said_to_fail_a_test(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report said of a boiler's sensor: p = 3.9e-15 is above 0.01."""
    law, fault = _pair()
    less = replace(law, evidence=replace(SURE, delta_nll=10.0, bic_gain=8.0))
    assert choose([less, fault], LEVEL) is fault  # it explains more, and leaves nothing
    tiny = replace(law, evidence=replace(SURE, delta_nll=9.0, bic_gain=7.0))
    assert "unproven" not in _why(fault, tiny)
    monkeypatch.setattr("bondgraph.correct.evidence.decide.is_white", lambda *_: False)
    assert choose([less, fault], LEVEL) is less
    told = _why(less, fault)
    assert told.startswith("it gains 12.0 nats more and passes the tests, but a fault of the only sensor")
    assert told.endswith("nothing stays unexplained beside it: its innovations stay coloured")
    little = replace(law, evidence=replace(SURE, delta_nll=9.0, bic_gain=7.0))
    assert choose([little, fault], LEVEL) is None  # less than half of what the fault explains is no answer
    told = _why(None, little, fault)
    assert told.endswith("half of what the unproven sensor_scale at sensor speed does (22.0 nats)")
    doubted = replace(law, evidence=replace(SURE, p_robust=0.5))
    assert choose([doubted, fault], LEVEL) is None
    told = _why(None, fault, doubted)
    assert "no law explains as much: quadratic_loss at runner has 15.0 nats against 15.0" in told
    assert "above" not in told


def test_more_nats_are_never_a_negative_number_of_less() -> None:
    """A report promised -9.8 nats less, and -138.7 nats less in its place."""
    law, fault = _pair()
    promised = replace(fault, fit=None, evidence=None, score_gain=31.8)
    told = _why(law, promised)
    assert told.startswith("its score promises 9.8 nats more than quadratic_loss at runner, but a score is a promise")
    swapped = replace(fault, evidence=replace(SURE, delta_nll=10.0), instead=(law.candidate.label, -138.7))
    assert _why(law, swapped) == (
        "in its place it would do as well (138.7 nats more, from the fit with the other), although refitted, it gains "
        "12.0 nats less than quadratic_loss at runner from a start of its own"
    )


def test_a_law_that_bends_is_told_from_another_by_its_own_refit_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A coil whose constant fades was said to do as well as a polynomial of its stroke, though its refit had not."""
    law, fault = _pair()
    behind = replace(
        fault, fit=None, evidence=None, score_gain=12.0, remark="given up", instead=(law.candidate.label, 0.9)
    )
    assert "in its place it would do as well" in _why(law, behind)
    monkeypatch.setattr(type(law.candidate), "parts_from", lambda self, other: True)
    assert _why(law, behind) == "its score promises 10.0 nats less than quadratic_loss at runner; given up"


def test_a_refit_that_ends_with_nothing_of_its_candidate_says_so() -> None:
    law, _ = _pair()
    assert law.fit is not None
    (name,) = law.candidate.effect.coefficients
    rest = cast(Fit, SimpleNamespace(values={name: 0.0}, problem=law.fit.problem))
    gone = replace(law, fit=rest, evidence=replace(SURE, p_robust=1.0))
    assert _why(None, gone) == "nothing is left of it: its refit ends with zero for it, and other parameters gain that"
