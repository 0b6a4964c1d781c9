"""What would do as well in the place of the best, throughout and in part of the data, told at its refit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.refits.decide import CLOSE, alternatives, choose
from bondgraph.correct.refits.exchange import Exchange, exchanges
from bondgraph.correct.refits.gated_refits import refit_in_part
from bondgraph.correct.refits.refit import Ground, refit_alone
from bondgraph.correct.refits.rivals import rivals
from bondgraph.correct.refits.trials import Trial
from bondgraph.correct.scores.gates import Gate, _peers, best_gated, gate_samples, gated
from bondgraph.correct.scores.scoring import Scored, linearisation, score_candidates
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import handle, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.simulate.simulation import simulate
from tests.correct.test_stiff import cubic_loss
from tests.correct.test_stiff import rivals as drags
from tests.correct.winch import NOISE, built, drawn, fitted_to, winch

SWITCH = 11.0


def test_what_scores_passed_over_is_refitted_where_the_best_says_it_gains_more() -> None:
    (drag, cubic), scored, ground = drags()
    found = rivals([drag, refit_alone(cubic, cubic.step, ground)], scored, ground)
    best = choose(found, ground.level)
    assert best is found[0] and best.gain > found[1].gain + CLOSE
    # from the cubic law's end the search may come to a better optimum, and may leave about a nat of it
    assert best.gain > refit_alone(drag, drag.step, ground).gain - 2.0


def test_what_does_worse_in_its_place_is_left_alone() -> None:
    (drag, cubic), scored, ground = drags()
    there = refit_alone(drag, drag.step, ground)
    assert rivals([there, cubic], scored, ground) == [there, cubic]
    assert rivals([drag, cubic], scored, ground) == [drag, cubic]  # nothing was refitted


def squared_loss(g: BondGraph, at: Place) -> Effect | None:
    """Drag with the second power of the speed, by another name."""
    c = g.parameter("c_squared", 0.0, "N m s^2", "drag", (0.0, 1.0))
    g.resistance("squared", lambda w: c * w * abs(w), at=at.junction)
    return Effect("squared_loss", "squared", "effort = c*flow*|flow|", ("c_squared",))


def test_what_does_as_well_in_its_place_is_not_told_apart_whatever_scores_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("bondgraph.correct.refits.rivals._MORE", 3.0)  # what promises less is not worth a refit
    _, _, ground = drags()
    where = places(built(), ground.train, ground.base.runs(ground.train), ground.base.theta)
    drum = [one for one in where if one.label == "drum"]
    found, _ = candidates(built(), [effects.quadratic_loss, squared_loss], drum)
    scored = score_candidates(linearisation(ground.base, ground.train), found)
    silent, strange = (
        replace(scored, scores=replace(scored.scores, correlation=np.array([[1.0, known], [known, 1.0]])))
        for known in (0.3, 0.1)
    )
    drag, same = (Trial(one, 0.0) for one in found)
    there = refit_alone(drag, [0.2], ground)
    done = rivals([there, same], silent, ground)
    assert done == [there, replace(same, instead=done[1].instead)]
    assert done[1].instead is not None and done[1].instead[0] == "quadratic_loss at drum"
    assert abs(done[1].instead[1]) < 3.0  # of 520 nats
    (other,) = alternatives(there, done, silent.scores, ground.level)
    assert other.indistinguishable and "in its place it would do as well" in other.why
    (other,) = alternatives(there, [there, same], silent.scores, ground.level)
    assert not other.indistinguishable
    assert rivals([there, same], strange, ground) == [there, same]  # they have nothing in common


def test_what_was_refitted_and_ended_somewhat_behind_is_asked_once_more(monkeypatch: pytest.MonkeyPatch) -> None:
    _, _, ground = drags()
    where = places(built(), ground.train, ground.base.runs(ground.train), ground.base.theta)
    drum = [one for one in where if one.label == "drum"]
    found, _ = candidates(built(), [effects.quadratic_loss, squared_loss], drum)
    scored = score_candidates(linearisation(ground.base, ground.train), found)
    there, same = (refit_alone(Trial(one, 0.0), [0.2], ground) for one in found)

    def behind(nats: float, told: float) -> Trial:
        """As if its search had ended early."""
        known = same.evidence
        assert known is not None
        less = replace(known, delta_nll=known.delta_nll - nats, bic_gain=known.bic_gain - nats)
        return replace(same, evidence=less, instead=(there.candidate.label, told))

    again = rivals([there, behind(6.0, 9.0)], scored, ground)[1]
    assert again.gain == pytest.approx(same.gain, abs=2.0)  # it promised to be better, and was searched once more
    monkeypatch.setattr("bondgraph.correct.refits.rivals._MORE", 3.0)  # what promises less is not worth a refit
    done = rivals([there, behind(6.0, 9.0)], scored, ground)  # what was told before its refit counts no more
    assert done[1].instead is not None and abs(done[1].instead[1]) < 3.0
    (other,) = alternatives(there, done, scored.scores, ground.level)
    assert other.indistinguishable and "in its place it would do as well" in other.why
    done = rivals([there, behind(60.0, 0.0)], scored, ground)  # no search ends so far behind
    assert done[1].instead is None
    (other,) = alternatives(there, done, scored.scores, ground.level)
    assert not other.indistinguishable and "60.0 nats less" in other.why


def late(function: EffectFunction, size: float) -> MatchedLog:
    """The winch with a loss of its drum from a time on."""
    calm = drawn(0.0)
    graph = winch()
    place = Place(handle(graph, "drum"), Scale(5.0, 20.0))
    effect = gated(function, Gate("from", "run", SWITCH), [calm])(graph, place)
    assert effect is not None
    graph = with_values(graph, {effect.coefficients[0]: size, "c": 0.3})
    run = simulate(build(graph).model, calm.time, calm.u, rtol=1e-8).raise_if_failed()
    return MatchedLog("run", calm.time, calm.u, run.y + NOISE * np.random.default_rng(4).standard_normal(run.y.shape))


@pytest.fixture(scope="module")
def part() -> tuple[Ground, Scored]:
    """Drag from a time on, scored throughout."""
    log = late(effects.quadratic_loss, 0.005)
    base = fitted_to(log)
    where = places(built(), [log], base.runs([log]), base.theta)
    found, _ = candidates(built(), [effects.quadratic_loss, cubic_loss, effects.viscous_loss], where[:2])
    scored = score_candidates(linearisation(base, [log]), found, gate_samples([log]))
    return Ground(built(), base, (log,), len(found), 0.01, 10.0), scored


def test_a_refit_in_part_tells_what_another_would_gain_in_that_part(part: tuple[Ground, Scored]) -> None:
    ground, scored = part
    order = [one.label for one in scored.candidates]
    true, other = (order.index(f"{law} at drum") for law in ("quadratic_loss", "viscous_loss"))
    gate = Gate("from", "run", SWITCH)
    fits = {}
    for j, size in ((true, 0.005), (other, 0.05)):
        (fits[j],) = refit_in_part(Trial(scored.candidates[j], 0.0, (size,), gate=gate), ground, 100, 0.0)
    really = fits[true].gain - fits[other].gain
    assert really > CLOSE
    there = fits[other]
    assert there.fit is not None
    told, throughout = (
        exchanges(
            one, [scored.candidates[true]], [scored.variants[true]], there.fit.problem.logs, ground.base.point.size
        )[0]
        for one in (there, replace(there, gate=None))
    )
    assert told is not None and throughout is not None
    # far from the optimum of the other fit the expansion tells the direction and a good part of the gain
    assert -1.5 * really < told.loss < -0.3 * really
    assert throughout.loss > 0.0  # it does not act before
    done = rivals([there], scored, ground)
    best = choose(done, ground.level)
    assert best is not None and best.gate == gate and best.gain == pytest.approx(fits[true].gain, abs=CLOSE)
    others = alternatives(best, done, scored.scores, 0.01)
    assert others and all(one.why.startswith(f"acting {gate}, ") for one in others)
    group = {best.candidate.label, *(f"{one.name} at {one.junction}" for one in others if one.indistinguishable)}
    assert "quadratic_loss at drum" in group and "viscous_loss at drum" not in group  # the motor turns with the drum


def test_its_law_at_another_place_is_refitted_though_it_seems_to_lose_some_nats_in_that_part(
    part: tuple[Ground, Scored], monkeypatch: pytest.MonkeyPatch
) -> None:
    ground, scored = part
    order = [one.label for one in scored.candidates]
    gate = Gate("from", "run", SWITCH)
    motor = Trial(scored.candidates[order.index("cubic_loss at motor")], 0.0, (0.0002,), gate=gate)
    (there,) = refit_in_part(motor, ground, 100, 0.0)
    for loss, also in ((5.0, {"cubic_loss at drum"}), (20.0, set())):

        def told(*asked: Any, nats: float = loss) -> list[Exchange | None]:
            """As if an expansion said that everything lost so much."""
            return [None if one is None else replace(one, loss=nats) for one in exchanges(*asked)]

        monkeypatch.setattr("bondgraph.correct.refits.rivals.exchanges", told)
        refitted = [one for one in rivals([there], scored, ground) if one.evidence is not None]
        assert {one.candidate.label for one in refitted} == {"cubic_loss at motor"} | also
        assert all(one.gain == pytest.approx(there.gain, abs=CLOSE) for one in refitted)


def test_each_place_has_one_that_acts_in_part_before_another_has_two(part: tuple[Ground, Scored]) -> None:
    ground, scored = part
    linear = linearisation(ground.base, ground.train)
    best = best_gated(linear, scored)
    assert best is not None and best.peers[0][0][0] == best.index
    order = [one.label for one in scored.candidates]
    gains = {"quadratic_loss at drum": 500.0, "cubic_loss at drum": 499.0, "quadratic_loss at motor": 490.0}
    near = np.array([gains.get(label, 0.0) for label in order])
    projected = linear.projected(np.concatenate(scored.columns, axis=1))
    projected = replace(projected, information=np.diag(np.diag(projected.information)))  # the coupling ties both places
    found = _peers(projected, near, int(near.argmax()), range(len(order)), scored.candidates)
    assert [order[peer[0][0]] for peer in found] == [
        "quadratic_loss at drum", "quadratic_loss at motor", "cubic_loss at drum",
    ]  # fmt: skip


def test_a_gate_acts_in_its_own_log_only() -> None:
    """Independent logs are not taken one after the other: what began in one is not there in the next."""
    first = drawn(0.0)
    logs = [first, replace(first, name="later")]
    time = np.array([0.0, 11.0, 11.05, 20.0])
    assert list(Gate("from", "run", 11.0).acts(time, "run", logs)) == [0.0, 0.0, 1.0, 1.0]
    assert list(Gate("until", "run", 11.0).acts(time, "run", logs)) == [1.0, 1.0, 0.0, 0.0]
    for when in ("from", "until"):
        assert list(Gate(when, "run", 11.0).acts(time, "later", logs)) == [0.0] * 4  # type: ignore[arg-type]
        assert list(Gate(when, "later", 11.0).acts(time, "run", logs)) == [0.0] * 4  # type: ignore[arg-type]
