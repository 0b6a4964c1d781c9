"""Verdicts: what passes its tests and is not believed is still missing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from bondgraph import effects
from bondgraph.correct.constants import LEVEL
from bondgraph.correct.evidence.trials import Evidence, Trial
from bondgraph.correct.models.candidates import candidates
from bondgraph.correct.verdict import unproven, verdict
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale
from tests.correct.sled import built, fitted, pull, sled

BASE = fitted([pull(sled(), 4)])
(DRAG,), _ = candidates(built(), [effects.quadratic_loss], [Place(handle(sled(), "runner"), Scale(150.0, 4.0))])
SURE, DOUBTED = Evidence(440.0, 1e-99, 1e-99, 430.0, 28), Evidence(440.0, 1e-99, 0.3, 430.0, 28)


def rounds(chosen: Trial | None, *evidence: Evidence) -> list[Any]:
    trials = tuple(Trial(DRAG, one.delta_nll, fit=BASE, evidence=one) for one in evidence)
    return [SimpleNamespace(trials=trials, chosen=chosen)]


def test_what_passes_in_the_last_round_and_was_not_chosen_is_unproven() -> None:
    found = unproven(rounds(None, DOUBTED, SURE), LEVEL)
    assert found is not None and found.evidence is SURE
    assert unproven(rounds(None, DOUBTED), LEVEL) is None
    assert unproven(rounds(found, SURE), LEVEL) is None
    assert unproven([], LEVEL) is None


@pytest.mark.parametrize("white", [True, False])
def test_nothing_is_called_complete_beside_it(white: bool) -> None:
    """Of a flow meter that cuts off small flows the report said "no missing effect", beside 440 nats."""
    tests = (SimpleNamespace(channel="flow", p_value=0.4 if white else 1e-9),)
    told = [verdict((), (), (), cast(Any, tests), LEVEL, "the end", None, one) for one in (None, Trial(DRAG, 1.0))]
    assert [name for name, _ in told] == [
        "no missing effect" if white else "unexplained residual",
        "unexplained residual",
    ]
    assert all(("flow stay coloured (p = 1e-09)" in why) != white for _, why in told)
