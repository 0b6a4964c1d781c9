"""How sharply a law changes its sign does not decide which law it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Evidence, Trial
from bondgraph.correct.loop import ClosedLoop, LoopSettings, close_loop
from bondgraph.correct.round import one_round
from bondgraph.correct.search.widths import _begun, _searched, at_any_width, is_due
from bondgraph.declare.effect import EffectFunction
from bondgraph.simulate.quantities import ParameterInfo
from tests.correct import sled
from tests.correct.drive import DRAG, FRICTION, WIDTH, drive, turned

LAWS: tuple[EffectFunction, ...] = (
    effects.viscous_loss, effects.coulomb_loss, effects.stribeck_loss, effects.quadratic_loss,
)  # fmt: skip
WITHOUT_FAULTS = LoopSettings(faults=False)


def closed_on(**truth: float) -> ClosedLoop:
    logs = [turned(seed, samples=600, **truth) for seed in (1, 2)]  # type: ignore[arg-type]
    return close_loop(drive(), logs, [turned(9, samples=600, **truth)], LAWS, WITHOUT_FAULTS)  # type: ignore[arg-type]


@pytest.mark.slow
def test_dry_friction_of_another_width_is_dry_friction() -> None:
    """Before: "Stribeck friction", 1.06 N m more at standstill, p = 5e-29, a sensor without noise."""
    found = closed_on()
    assert found.verdict == "effect found"
    assert [one.trial.candidate.label for one in found.added] == ["coulomb_loss at table"]
    values, std = found.corrected.values, found.corrected.std
    assert found.added[0].coefficients == ("c_coulomb_loss_table", "w_coulomb_loss_table")
    assert values["c_coulomb_loss_table"] == pytest.approx(FRICTION, abs=4.0 * std["c_coulomb_loss_table"])
    assert values["w_coulomb_loss_table"] == pytest.approx(WIDTH, rel=4.0 * std["w_coulomb_loss_table"])
    assert values["drag"] == pytest.approx(DRAG, rel=0.01) and std["w_coulomb_loss_table"] < 0.1
    assert values["std(speed)"] == pytest.approx(0.02, rel=0.1)
    (declared,) = [one for one in found.corrected_graph.parameters if one.name == "w_coulomb_loss_table"]
    assert declared.value == values["w_coulomb_loss_table"]


@pytest.mark.slow
def test_nothing_is_claimed_of_a_drive_without_friction() -> None:
    """Before its steps were certified first: "effect found", 17 nats, all of them discretisation."""
    found = closed_on(friction=0.0)
    assert (found.verdict, found.added, found.events) == ("no missing effect", (), ())


@pytest.mark.slow
def test_friction_that_rises_towards_standstill_is_still_found_as_such() -> None:
    found = closed_on(rise=0.6)
    assert [one.trial.candidate.label for one in found.added] == ["stribeck_loss at table"]
    values, std = found.corrected.values, found.corrected.std
    assert values["rise_stribeck_loss_table"] == pytest.approx(0.6, abs=4.0 * std["rise_stribeck_loss_table"])


@pytest.fixture(scope="module")
def rubbed() -> tuple[Context, list[Trial]]:
    """A sled that never stands still, with the dry friction of the dictionary, and what was tried of it."""
    train = [sled.pull(sled.added(effects.coulomb_loss, "runner", 3.0), seed, name=f"run{seed}") for seed in (1, 2)]
    base = sled.fitted(train)
    turn = one_round(sled.built(), base, train, (effects.coulomb_loss, effects.stribeck_loss))
    return Context(sled.built(), base, tuple(train), turn.tried, 0.01, 10.0), list(turn.trials)


def test_a_width_that_the_logs_do_not_ask_for_stays(rubbed: tuple[Context, list[Trial]]) -> None:
    context, trials = rubbed
    best = max((one for one in trials if one.fit is not None), key=lambda one: one.gain)
    assert is_due(best, trials, context)
    done = at_any_width(best, trials, context)
    assert all("instead of" not in one.remark for one in done)
    assert all("w_" not in name for one in done for name in one.candidate.effect.parameters)


def test_of_two_that_do_as_well_the_simpler_is_left_as_the_best(rubbed: tuple[Context, list[Trial]]) -> None:
    context, trials = rubbed
    simple = next(one for one in trials if one.candidate.effect.name == "coulomb_loss" and one.fit is not None)
    place = simple.candidate.place.label
    complex_ = next(
        one for one in trials if one.candidate.label == f"stribeck_loss at {place}" and one.candidate.effect.widths
    )
    assert simple.evidence is not None
    worth = simple.evidence.bic_gain
    seems = Evidence(simple.gain + 12.0, 0.0, 0.0, worth + 1.0, context.tried)
    fancy = replace(complex_, fit=simple.fit, built=simple.built, evidence=seems)
    trials = [simple, fancy]
    done = at_any_width(fancy, trials, context)
    assert done[0].evidence is not None and done[1].evidence is not None
    assert done[0].evidence.bic_gain > done[1].evidence.bic_gain
    assert "does as well" in done[1].remark


def test_an_exponent_is_searched_within_its_bounds_and_a_width_within_shares_of_it() -> None:
    power = ParameterInfo("n", "1", 1.25, 1.1, 1.4, "power")
    found = _searched(power)
    assert (found.lower, found.upper, found.start) == (1.1, 1.4, 1.25)
    begun = found.values(np.array([_begun(found, share) for share in (0.1, 1.0, 3.0)]))
    np.testing.assert_allclose(begun, [1.1, 1.25, 1.4])
    width = _searched(ParameterInfo("w", "rad/s", 0.5, None, None, "width"))
    assert (width.lower, width.upper) == (0.005, 5.0)
