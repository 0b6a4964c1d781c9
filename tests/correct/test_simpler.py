"""Simpler laws at the end of a loop: what takes the place of a law with more coefficients, and what does not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from bondgraph import effects
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.transfer import Transfer
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.places.probes import probes, signals
from bondgraph.correct.progress import Progress
from bondgraph.correct.round import Round, RoundSettings
from bondgraph.correct.scores.scoring import linearisation
from bondgraph.correct.search.refit import refit_from
from bondgraph.correct.shapes.forms import joined
from bondgraph.correct.simpler import in_one_law, in_simpler_laws
from bondgraph.data.log import MatchedLog
from bondgraph.declare.effect import Effect, EffectFunction, Place
from bondgraph.declare.graph import BondGraph
from tests.correct.sled import added, built, fitted, pull, sled

FRICTION = 12.0


def _added(
    log: MatchedLog, chosen: EffectFunction, *others: EffectFunction, transfer: Transfer | None = None
) -> Progress:
    """The state after a law was added at the runner, and others refitted there, at the end of the loop."""
    base = fitted([log])
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "runner"]
    context = Context(built(), base, (log,), 10, 0.01, 5.0)

    def refitted(function: EffectFunction) -> Trial:
        (made,), _ = candidates(built(), [function], where)
        return refit_from(Trial(made, 0.0), [FRICTION], context)

    law, *rest = [refitted(one) for one in (chosen, *others)]
    rest = [replace(one, transfer=transfer) for one in rest]
    assert law.built is not None and law.fit is not None
    state = Progress(sled(), law.built, law.fit, (log,), (law,))
    return in_simpler_laws(state, [SimpleNamespace(trials=(law, *rest), chosen=law)], RoundSettings())  # type: ignore[list-item]


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


def test_a_simpler_law_that_was_refused_since_it_does_not_transfer_does_not() -> None:
    """Of a mixer whose grease warms a spring to the frame came in so, at a shaft that had turned 360 times."""
    log = pull(added(effects.coulomb_loss, "runner", FRICTION), 5)
    refused = Transfer(("first", "second"), (9.0, -5.0), 13.0, 7.0, 0.4)
    state = _added(log, effects.stribeck_loss, effects.coulomb_loss, transfer=refused)
    assert [one.candidate.label for one in state.added] == ["stribeck_loss at runner"] and not state.history


def test_a_simpler_law_that_explains_less_does_not() -> None:
    log = pull(added(effects.coulomb_loss, "runner", FRICTION), 5)
    state = _added(log, effects.stribeck_loss, effects.viscous_loss, effects.quadratic_loss)
    assert [one.candidate.label for one in state.added] == ["stribeck_loss at runner"] and not state.history


def _summed(log: MatchedLog, *functions: EffectFunction) -> tuple[Progress, Round]:
    """The state after laws were added at the runner one by one, and a round that saw what they leave."""
    own, base, laws = built(), fitted([log]), list[Trial]()
    for function in functions:
        where = [one for one in places(own, [log], base.runs([log]), base.theta) if one.label == "runner"]
        (made,), _ = candidates(own, [function], where)
        law = refit_from(Trial(made, 0.0), [1.0], Context(own, base, (log,), 10, 0.01, 5.0))
        assert law.built is not None and law.fit is not None
        own, base, laws = law.built, law.fit, [*laws, law]
    linear = linearisation(base, [log])
    where = places(own, [log], linear.runs, base.theta_of(own.model))
    turn = SimpleNamespace(
        trials=(), linear=linear, probed=probes(own, linear, where), signals=signals(own, linear, where), located=(),
        chosen=None,
    )  # fmt: skip
    return Progress(sled(), own, base, (log,), tuple(laws)), turn  # type: ignore[return-value]


def _sum(log: MatchedLog, *functions: EffectFunction) -> Progress:
    """The state after laws were added at the runner one by one, as the sum that they are, at the end of the loop."""
    state, turn = _summed(log, *functions)
    return in_simpler_laws(replace(state, added=(joined(*state.added),)), [turn], RoundSettings())


def _drag(power: float) -> EffectFunction:
    """A drag with a power of the speed, as no effect of the library writes it."""

    def drag(g: BondGraph, at: Place) -> Effect | None:
        c = g.parameter("c_drag", 0.0, "N", "", (0.0, 100.0))
        one = g.parameter("one", 1.0, "m/s")
        g.resistance("drag", lambda v: c * (v / one) * ((v / one) ** 2 + 1e-6) ** (0.5 * (power - 1.0)), at=at.junction)
        return Effect("drag", "drag", "", (c.name,))

    return drag


def test_a_law_that_draws_the_curve_of_a_sum_takes_its_place() -> None:
    """A leak with the power 1.35 of the pressure was left as an overflow and a straight leak, "one law of own form"."""
    state = _sum(pull(added(_drag(1.5), "runner", 12.0), 5), effects.quadratic_loss, effects.stribeck_loss)
    (law,) = state.added
    assert law.candidate.label == "formula_power_of_flow_of_runner at runner"
    assert not law.forms and law.simplifies == "quadratic_loss at runner"
    assert state.fit.values["exponent_power_runner"] == pytest.approx(1.5, abs=0.1)
    assert [one.action for one in state.history] == ["simplified"]


def test_a_sum_that_no_single_law_draws_stays_a_sum() -> None:
    drawn = added(effects.coulomb_loss, "runner", FRICTION, added(_drag(2.0), "runner", 6.0))
    state = _sum(pull(drawn, 5), effects.quadratic_loss, effects.coulomb_loss)
    assert len(state.added) == 1 and len(state.added[0].forms) == 2 and not state.history


def test_one_law_takes_the_place_of_a_law_and_of_what_completes_it() -> None:
    """The power 1.75 of a hose's flow was left as its square and a dead zone of the pump."""
    state, turn = _summed(
        pull(added(_drag(1.5), "runner", 12.0), 5),
        effects.quadratic_loss,
        effects.stribeck_loss,
        effects.constant_effort,
    )
    first, second, constant = state.laws
    reduced = in_one_law(state, [turn], RoundSettings(), {second.candidate.label: first.candidate.label})
    (law,) = reduced.added
    assert law.candidate.label == "formula_power_of_flow_of_runner at runner"
    assert reduced.fit.values["exponent_power_runner"] == pytest.approx(1.5, abs=0.1)
    assert not {*second.candidate.effect.parameters, *constant.candidate.effect.parameters} & set(reduced.fit.values)
    (told,) = reduced.history
    assert told.action == "simplified" and told.what == first.candidate.label
    assert f"takes the place of {second.candidate.label}, {constant.candidate.label} too" in told.why


def _rivalled(log: MatchedLog, first: EffectFunction, rival: EffectFunction, later: bool = True) -> Progress:
    """The state with a law and dry friction beside it at the end of a loop, whose first round refitted a rival too."""
    state, _ = _summed(log, first, effects.coulomb_loss)
    base = fitted([log])
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "runner"]
    (made,), _ = candidates(built(), [rival], where)
    other = refit_from(Trial(made, 0.0), [5.0], Context(built(), base, (log,), 10, 0.01, 5.0))
    law, friction = state.added
    turns = [SimpleNamespace(trials=(law, other), chosen=law), SimpleNamespace(trials=(), chosen=friction)]
    return in_simpler_laws(state, turns[: 1 + later], RoundSettings())  # type: ignore[arg-type]


def test_a_rival_that_does_better_beside_what_was_found_later_takes_the_place_of_a_law() -> None:
    """A lag of a heater was left as the answer for that of a thermometer, chosen while a second loss was unknown."""
    log = pull(added(effects.coulomb_loss, "runner", FRICTION, added(effects.quadratic_loss, "runner", 8.0)), 5)
    state = _rivalled(log, effects.rolling_speed_loss, effects.quadratic_loss)
    law, friction = state.added
    assert law.candidate.label == "quadratic_loss at runner" and law.simplifies == "rolling_speed_loss at runner"
    assert friction.candidate.label == "coulomb_loss at runner"
    (told,) = state.history
    assert told.action == "replaced" and "does better beside what was found later" in told.why
    assert state.fit.values[law.candidate.effect.coefficients[0]] == pytest.approx(8.0, rel=0.05)


def test_a_rival_is_not_asked_where_nothing_was_found_later_or_it_does_no_better() -> None:
    log = pull(added(effects.coulomb_loss, "runner", FRICTION, added(effects.quadratic_loss, "runner", 8.0)), 5)
    assert not _rivalled(log, effects.rolling_speed_loss, effects.quadratic_loss, later=False).history
    assert not _rivalled(log, effects.quadratic_loss, effects.rolling_speed_loss).history


def test_laws_that_complete_nothing_stay() -> None:
    state, turn = _summed(pull(added(_drag(1.5), "runner", 12.0), 5), effects.quadratic_loss, effects.stribeck_loss)
    assert in_one_law(state, [turn], RoundSettings(), {}) is state


def test_a_rival_that_does_as_well_is_named_with_the_law() -> None:
    """A drag of the drum and one of the sled are the same behind a rope."""
    log = pull(added(effects.coulomb_loss, "runner", FRICTION, added(effects.quadratic_loss, "runner", 8.0)), 5)
    state, _ = _summed(log, effects.quadratic_loss, effects.coulomb_loss)
    base = fitted([log])
    where = [one for one in places(built(), [log], base.runs([log]), base.theta) if one.label == "drum"]
    (made,), _ = candidates(built(), [effects.quadratic_loss], where)
    other = refit_from(Trial(made, 0.0), [0.1], Context(built(), base, (log,), 10, 0.01, 5.0))
    law, friction = state.added
    turns = [SimpleNamespace(trials=(law, other), chosen=law), SimpleNamespace(trials=(), chosen=friction)]
    done = in_simpler_laws(state, turns, RoundSettings())  # type: ignore[arg-type]
    assert [one.candidate.label for one in done.added] == ["quadratic_loss at runner", "coulomb_loss at runner"]
    assert done.added[0].rivals == ("quadratic_loss at drum",) and not done.history
