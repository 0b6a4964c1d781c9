"""Closing the loop on small machines of every domain, whose truth has laws of other forms than the dictionary's."""

from __future__ import annotations

import pytest

import bondgraph as bg
from tests.effects.machines.first import MACHINES


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_the_law_is_found_at_its_place(name: str) -> None:
    machine = MACHINES[name]
    found = bg.close_loop(machine.graph(), [machine.log(seed) for seed in (1, 2)], [machine.log(9)])
    assert found.verdict == "effect found"
    law, *further = found.added
    assert law.trial.candidate.label in machine.laws
    # what the dictionary's form leaves of another one may come as a formula: of a sinh the fifth power after the cube
    assert all(one.trial.candidate.effect.formula for one in further)
    assert {one.trial.candidate.place.label for one in further} <= {law.trial.candidate.place.label}
    before, after = found.nominal_holdout.nll, found.corrected_holdout.nll
    assert after < before - 10.0


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(MACHINES) - {"buffer"}))  # without its stop it is the leaf
def test_nothing_is_claimed_of_a_machine_that_lacks_nothing(name: str) -> None:
    machine = MACHINES[name]
    found = bg.close_loop(machine.graph(), [machine.log(seed, effect=False) for seed in (1, 2)], [])
    assert (found.verdict, found.added) == ("no missing effect", ())
