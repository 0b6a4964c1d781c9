"""Taking out what was added: effects that act on one another."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct import progress
from bondgraph.correct.evidence.context import coefficients
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.loop import LoopSettings, close_loop
from bondgraph.correct.models.candidates import candidates
from bondgraph.correct.models.shaping_filters import DISTURBANCE
from bondgraph.correct.progress import Progress, standing, without
from bondgraph.correct.rest import Rest
from bondgraph.correct.round import RoundSettings
from bondgraph.correct.shapes.forms import joined
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale
from bondgraph.errors import EstimationError
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from tests.correct.sled import added, built, fitted, pull, sled


def test_a_wind_on_a_drag_that_is_withdrawn_goes_with_it() -> None:
    """The headwind acts on the drag of the round before; without it: "no parameter 'w_headwind_...'"."""
    log = pull(added(effects.quadratic_loss, "runner", 3.0), 1)
    base = fitted([log])
    at = Place(handle(sled(), "runner"), Scale(150.0, 4.0))
    (drag,), _ = candidates(built(), [effects.quadratic_loss], [at])
    with_drag = build(drag.apply(sled()))
    (wind,), _ = candidates(with_drag, [effects.headwind], [at])
    both = build(wind.apply(with_drag.graph))
    model = base.problem.filter_model.__class__(
        both.model, base.problem.filter_model.process_noise, base.problem.filter_model.measurement_noise,
        base.problem.filter_model.initial_std,
    )  # fmt: skip
    free = (*at_optimum(base), *coefficients(drag, model), *coefficients(wind, model))
    state = Progress(
        sled(), both, fit(EstimationProblem(model, (log,), tuple(free))), (log,), (Trial(drag, 9.0), Trial(wind, 9.0))
    )
    left = without(state, 0, "dropped", "p = 0.5", 2, RoundSettings())
    assert left.added == () and left.built.model.names("parameter") == built().model.names("parameter")
    assert [(one.action, one.what) for one in left.history] == [
        ("dropped", "quadratic_loss at runner"), ("dropped", "headwind at runner"),
    ]  # fmt: skip
    assert left.history[1].why == "has nothing to act on without quadratic_loss at runner"
    alone = without(state, 1, "dropped", "p = 0.5", 2, RoundSettings())
    assert [one.candidate.label for one in alone.added] == ["quadratic_loss at runner"]
    assert alone.fit.nll == pytest.approx(state.fit.nll, abs=20.0)


def test_what_was_found_beside_something_has_to_stand_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scale of a sensor that was found beside a disturbance stayed when the disturbance was withdrawn."""
    log = pull(added(effects.quadratic_loss, "runner", 3.0), 1)
    at = Place(handle(sled(), "runner"), Scale(150.0, 4.0))
    state = Progress(sled(), built(), fitted([log]), (log,))
    for function in (effects.quadratic_loss, effects.constant_effort):
        (one,), _ = candidates(state.built, [function], [at])
        own = build(one.apply(state.built.graph))
        model = replace(state.fit.problem.filter_model, model=own.model)
        free = (*at_optimum(state.fit), *coefficients(one, model))
        state = replace(
            state,
            built=own,
            fit=fit(EstimationProblem(model, (log,), tuple(free))),
            added=(*state.added, Trial(one, 9.0)),
        )
    assert (
        standing(state, [], "without a wind", 2, RoundSettings()).added == state.added[:1]
    )  # there is no constant load
    monkeypatch.setattr("bondgraph.correct.progress.doubt", lambda fitted, effect: 1e-9)
    assert standing(state, [], "without a wind", 2, RoundSettings()) is state


def test_a_part_without_which_a_law_has_no_value_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """A round ended where an exponential without its other half had no value at a sigma point."""
    log = pull(added(effects.quadratic_loss, "runner", 3.0), 1)
    at = Place(handle(sled(), "runner"), Scale(150.0, 4.0))
    state = Progress(sled(), built(), fitted([log]), (log,))
    for function in (effects.quadratic_loss, effects.constant_effort):
        (one,), _ = candidates(state.built, [function], [at])
        own = build(one.apply(state.built.graph))
        state = replace(state, built=own, added=(*state.added, Trial(one, 9.0, built=own)))
    whole = replace(state, added=(joined(*state.added),))

    def diverging(*args: object, **settings: object) -> Fit:
        raise EstimationError("a law has no value at a sigma point")

    monkeypatch.setattr(progress, "fit", diverging)
    assert progress._in_fewer_parts(whole, 0, 2, RoundSettings()) is whole


def test_an_effect_that_is_withdrawn_at_the_end_makes_room_for_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """With --max-effects 1 the loop ended without any effect, though the second one passed."""
    train = [pull(added(effects.quadratic_loss, "runner", 3.0), 1)]
    rested: list[int] = []

    def needless_once(state: Progress, rounds: object, settings: RoundSettings, tables: bool) -> Rest:
        rested.append(len(state.added))
        if len(rested) == 1:
            return Rest(without(state, 0, "withdrawn", "needless", 1, settings), ())
        return Rest(state, ())

    monkeypatch.setattr("bondgraph.correct.loop.settle", needless_once)
    functions = [effects.quadratic_loss, effects.constant_effort]
    closed = close_loop(sled(), train, [], functions, LoopSettings(max_effects=1, faults=False))
    assert rested == [1, 1] and len(closed.added) == 1
    assert [one.action for one in closed.history] == ["added", "withdrawn", "added", "stopped"]
    assert closed.reason.startswith("the limit of 1 effect was reached (--max-effects 2 looks for more)")


@pytest.mark.slow
def test_nothing_is_tested_again_where_shorter_steps_withdraw_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last of what was added was looked for where nothing was left."""
    truth = added(effects.quadratic_loss, "runner", 3.0)

    def withdrawing(state: Progress, number: int, settings: RoundSettings) -> Progress:
        return without(state, len(state.added) - 1, "withdrawn", "judged with shorter steps", number, settings)

    monkeypatch.setattr("bondgraph.correct.progress.certified", withdrawing)
    closed = close_loop(sled(), [pull(truth, 4)], [], (effects.quadratic_loss,), LoopSettings(faults=False))
    assert closed.added == ()
    assert [one.action for one in closed.history[:2]] == ["added", "withdrawn"]


def test_a_rhythm_beside_a_needless_disturbance_is_asked_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hose that gives way left a disturbance that went, and a rhythm beside it of 0.014 N m that stayed."""

    def trial(name: str, kind: str = DISTURBANCE) -> SimpleNamespace:
        return SimpleNamespace(candidate=SimpleNamespace(label=name, effect=SimpleNamespace(kind=kind)))

    first, second, law = trial("disturbance at shaft"), trial("rhythm at shaft"), trial("node_volume at port", "")

    def fewer(state: SimpleNamespace, index: int, *rest: object) -> SimpleNamespace:
        left = tuple(one for k, one in enumerate(state.added) if k != index)
        return SimpleNamespace(added=left, fit=SimpleNamespace(nll=state.fit.nll + 1.0), train=state.train)

    monkeypatch.setattr(progress, "without", fewer)
    log = SimpleNamespace(y=np.zeros((1, 500)))
    state = SimpleNamespace(added=(first, second, law), fit=SimpleNamespace(nll=0.0), train=(log,))
    done = progress._without_needless_disturbance(state, law, 2, RoundSettings())  # type: ignore[arg-type]
    assert done.added == (law,)
