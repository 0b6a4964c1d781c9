"""How a loop with default options answers small machines, each with its effect and without."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import bondgraph as bg
from bondgraph.correct.evidence.trials import Added
from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.result import result_json
from bondgraph.correct.shapes.formula import formula_of
from tests.effects.machines.electrical import ELECTRICAL
from tests.effects.machines.hydraulic import HYDRAULIC
from tests.effects.machines.machine import Machine
from tests.effects.machines.mechanical import MECHANICAL
from tests.effects.machines.mixed import MIXED
from tests.effects.machines.thermal import THERMAL

KINDS = {
    "electrical": ELECTRICAL, "hydraulic": HYDRAULIC, "thermal": THERMAL, "mechanical": MECHANICAL, "mixed": MIXED,
}  # fmt: skip
#: Verdicts that name something.
CLAIMS = ("effect found", "effect not confirmed", "sensor fault suspected", "disturbance")
#: Seeds of the logs for training, and of that held out.
TRAIN, HELD_OUT = (1, 2), 9


@dataclass(frozen=True)
class Answer:
    """The loop's answer to a machine: ``right``, or ``wrong`` where it named something else; else it said nothing.

    ``strict``: it is right without laws that the loop itself says to complete another.
    """

    machine: str
    effect: bool
    verdict: str
    named: tuple[str, ...]
    sizes: tuple[str, ...]
    seconds: float
    right: bool
    wrong: bool
    strict: bool


def asked(name: str, machine: Machine, effect: bool) -> Answer:
    """The answer of a loop with default options to a machine with its effect, or without."""
    logs = [machine.log(seed, effect) for seed in TRAIN]
    held_out = [machine.log(HELD_OUT, effect)]
    start = time.process_time()
    closed = bg.close_loop(machine.graph(), logs, held_out)
    seconds = time.process_time() - start
    right = is_right(machine, closed) if effect else closed.verdict == "no missing effect" and not closed.added
    strict = right if not effect else is_right(machine, closed, strict=True)
    claimed = bool(closed.added) or closed.verdict in CLAIMS
    named = tuple(f"{'+ ' if one.completes else ''}{one.trial.candidate.label}" for one in closed.added)
    return Answer(
        name, effect, closed.verdict, named, tuple(_sizes(closed)), seconds, right, claimed and not right, strict
    )


def is_right(machine: Machine, closed: ClosedLoop, strict: bool = False) -> bool:
    """Whether the law or an equivalent formula is found at its place or in its group, and nothing wrong beside it.

    The first effect must be a right one, or one that the data do not tell from a right one. Further ones may only be
    formulas at the same place, or right ones, or, unless the rule is ``strict``, laws that the loop itself says to
    complete the form of the first.
    """
    if closed.verdict != "effect found" or not closed.added:
        return False
    first, *further = closed.added
    if not (is_answer(machine, first) or is_in_group(machine, first, result_json(closed))):
        return False
    return all(is_answer(machine, one) or _completes(one, first, strict) for one in further)


def is_answer(machine: Machine, added: Added) -> bool:
    """True for an effect that is a right answer."""
    candidate = added.trial.candidate
    formula = formula_of(candidate.function)
    if formula is None:
        return candidate.label in machine.laws
    return candidate.place.label in machine.places and set(formula.signals) <= machine.signals


def is_in_group(machine: Machine, added: Added, result: Mapping[str, Any]) -> bool:
    """True where the result names a right answer among those that the sensors do not tell from what was found."""
    told = [one for one in result["alternatives"] if one["indistinguishable"] and one["round"] == 1]
    if machine.laws & {f"{one['name']} at {one['junction']}" for one in told}:
        return True
    formula = formula_of(added.trial.candidate.function)
    if formula is None or not set(formula.signals) <= machine.signals:
        return False
    return any(one["name"] == formula.name and one["junction"] in machine.places for one in told)


def _completes(added: Added, first: Added, strict: bool) -> bool:
    candidate = added.trial.candidate
    if not strict and added.completes == first.trial.candidate.label:
        return True
    return candidate.effect.formula and candidate.place.label == first.trial.candidate.place.label


def _sizes(closed: ClosedLoop) -> Iterator[str]:
    infos = {info.name: info for info in closed.corrected.problem.filter_model.model.parameters}
    for added in closed.added:
        for name in added.coefficients:
            info = infos[name]
            yield f"{info.shown(closed.corrected.values[name]):.3g} {info.display_unit}".strip()
