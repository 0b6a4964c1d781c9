"""Simpler laws at the end of a loop: what takes the place of a law with more coefficients, and what does not."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from bondgraph import effects
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.progress import Progress
from bondgraph.correct.round import RoundSettings
from bondgraph.correct.search.refit import refit_from
from bondgraph.correct.simpler import in_simpler_laws
from bondgraph.data.log import MatchedLog
from bondgraph.declare.effect import EffectFunction
from tests.correct.sled import added, built, fitted, pull, sled

FRICTION = 12.0


def _added(log: MatchedLog, chosen: EffectFunction, *others: EffectFunction) -> Progress:
    """The state after a law was added at the runner, and others refitted there, at the end of the loop."""
    base = fitted([log])
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "runner"]
    context = Context(built(), base, (log,), 10, 0.01, 5.0)

    def refitted(function: EffectFunction) -> Trial:
        (made,), _ = candidates(built(), [function], where)
        return refit_from(Trial(made, 0.0), [FRICTION], context)

    law, *rest = [refitted(one) for one in (chosen, *others)]
    assert law.built is not None and law.fit is not None
    state = Progress(sled(), law.built, law.fit, (log,), (law,))
    return in_simpler_laws(state, [SimpleNamespace(trials=(law, *rest))], RoundSettings())  # type: ignore[list-item]


def test_a_simpler_law_that_does_as_well_takes_the_place_of_a_law() -> None:
    """Stribeck friction with a rise of next to nothing was left as the answer for dry friction."""
    log = pull(added(effects.coulomb_loss, "runner", FRICTION), 5)
    state = _added(log, effects.stribeck_loss, effects.viscous_loss, effects.coulomb_loss)
    (law,) = state.added
    assert law.candidate.label == "coulomb_loss at runner" and law.simplifies == "stribeck_loss at runner"
    assert state.fit.values[law.candidate.effect.coefficients[0]] == pytest.approx(FRICTION, rel=0.02)
    assert law.evidence is not None and law.evidence.delta_nll > 100.0 and law.fit is state.fit
    assert [one.action for one in state.history] == ["simplified"] and "parameters fewer" in state.history[0].why
    assert "rise_stribeck_loss_runner" not in state.built.model.names("parameter")


def test_a_simpler_law_that_explains_less_does_not() -> None:
    log = pull(added(effects.coulomb_loss, "runner", FRICTION), 5)
    state = _added(log, effects.stribeck_loss, effects.viscous_loss, effects.quadratic_loss)
    assert [one.candidate.label for one in state.added] == ["stribeck_loss at runner"] and not state.history
