"""What a closed loop said, compared with the truth that it did not know."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from bondgraph.correct.evidence.trials import Added
from bondgraph.correct.fits.assess import Assessment
from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.result import intervals
from vehicle_graphs.effect_study.generate import Drawn
from vehicle_graphs.effect_study.machine import Kind

#: What was said of an effect: its name and place; another that the data do not tell from it, with it in the group;
#: another at its place; another elsewhere; that something unknown is left; nothing.
Answer = Literal["exact", "group", "place", "wrong", "unexplained", "none", "failed"]


@dataclass(frozen=True)
class Hit:
    """One true effect and what was said of it.

    ``found`` is the effect that stands for it, ``group`` all that the loop does not tell apart from that, itself
    included; ``coefficients`` the true ones and, where the effect was named exactly, the estimates with their 95 %
    intervals.
    """

    label: str
    answer: Answer
    found: str = ""
    coefficients: dict[str, dict[str, Any]] = field(default_factory=dict)
    group: tuple[str, ...] = ()

    @property
    def is_right(self) -> bool:
        """Whether place and effect are right, or their group."""
        return self.answer in ("exact", "group")

    @property
    def place_right(self) -> bool:
        """Whether the place is right, or its group."""
        return self.answer in ("exact", "group", "place")

    @property
    def covered(self) -> bool | None:
        """Whether the interval of the first coefficient holds the truth; None where another effect was named."""
        held = [one["low"] <= one["true"] <= one["high"] for one in self.coefficients.values() if "low" in one]
        return held[0] if held else None


@dataclass(frozen=True)
class Outcome:
    """One case and everything that is kept of it.

    ``found``: all effects that were named; ``extra``: those that stand for nothing true. ``unexplained``: the place of
    what was left, ``unexplained_right``: whether that is the place of a true effect. ``shown``, ``left``, ``promise``
    as in :class:`vehicle_graphs.effect_study.generate.Drawn`. ``before`` and ``after`` on the held-out log: the
    negative log-likelihood, and by output the error of free simulation over the sensor's noise. ``failure``: what
    stopped the loop.
    """

    family: str
    subject: str
    size: float
    seed: int
    hits: tuple[Hit, ...]
    verdict: str = ""
    reason: str = ""
    found: tuple[str, ...] = ()
    extra: tuple[str, ...] = ()
    unexplained: str = ""
    unexplained_right: bool = False
    shown: dict[str, float] = field(default_factory=dict)
    left: dict[str, float] = field(default_factory=dict)
    promise: float = 0.0
    before: dict[str, float] = field(default_factory=dict)
    after: dict[str, float] = field(default_factory=dict)
    tried: int = 0
    seconds: float = 0.0
    processor_seconds: float = 0.0
    failure: str = ""

    @property
    def is_right(self) -> bool:
        """Whether all true effects were found, or their groups, and nothing else was named."""
        return not self.failure and not self.extra and all(hit.is_right for hit in self.hits)

    @property
    def largest_left(self) -> float:
        """What there is to be found, in the output that shows it most."""
        return max(self.left.values(), default=0.0)

    @property
    def largest_shown(self) -> float:
        """What the effect does, in the output that shows it most."""
        return max(self.shown.values(), default=0.0)

    @classmethod
    def read(cls, kept: dict[str, Any]) -> Outcome:
        """The outcome of what was written to a file."""
        values = {name: tuple(kept[name]) for name in ("found", "extra")}
        hits = tuple(Hit(**(hit | {"group": tuple(hit.get("group", ()))})) for hit in kept["hits"])
        return cls(**(kept | values | {"hits": hits}))

    def written(self) -> dict[str, Any]:
        """The outcome for a file."""
        return dataclasses.asdict(self)


def compare(outcome: Outcome, closed: ClosedLoop, drawn: Drawn) -> Outcome:
    """The outcome with what was said of every true effect, what was said beside, and the errors on the held-out log."""
    hits, left = _matched(closed, drawn)
    labels = [_label(added) for added in left]
    missing: Answer = "wrong" if left else ("unexplained" if closed.verdict == "unexplained residual" else "none")
    for kind in drawn.truth.kinds:
        hits.setdefault(kind.label, Hit(kind.label, missing, labels[0] if labels else "", _true(kind, drawn)))
    stands_for_one = any(not hit.place_right for hit in hits.values())
    rest = closed.unexplained
    near = {place for kind in drawn.truth.kinds for place in (kind.where, *closed.structure.like(kind.where))}
    return replace(
        outcome,
        hits=tuple(hits[kind.label] for kind in drawn.truth.kinds),
        verdict=closed.verdict,
        reason=closed.reason,
        found=tuple(map(_label, (*closed.added, *closed.events))),
        extra=tuple(labels[1:] if stands_for_one else labels),
        unexplained=rest[0].place.label if rest else "",
        unexplained_right=bool(rest) and bool({rest[0].place.label, *rest[0].like} & near),
        before=_held_out(closed.nominal_holdout, drawn.noise),
        after=_held_out(closed.corrected_holdout, drawn.noise),
        tried=closed.rounds[0].tried if closed.rounds else 0,
    )


def _matched(closed: ClosedLoop, drawn: Drawn) -> tuple[dict[str, Hit], list[Added]]:
    """True effects with the added one that stands for each, the best matches first; and what is left of the added.

    Events count as added: of an effect that acts in part of the data an event is the right answer.
    """
    left, hits = [*closed.added, *closed.events], dict[str, Hit]()
    for wanted in ("exact", "group", "place"):
        for kind in drawn.truth.kinds:
            for added in left if kind.label not in hits else ():
                if _answer(closed, added, kind) == wanted:
                    hits[kind.label] = _hit(closed, added, kind, wanted, drawn)
                    left.remove(added)
                    break
    return hits, left


def _label(added: Added) -> str:
    return added.trial.candidate.label


def _answer(closed: ClosedLoop, added: Added, kind: Kind) -> Answer:
    """How well an added effect stands for a true one."""
    label, place = _label(added), added.trial.candidate.place.label
    if label == kind.label:
        return "exact"
    alike = _group(closed, added)
    if kind.label in alike:
        return "group"
    near = {place, *closed.structure.like(place), *(other.partition(" at ")[2] for other in alike)}
    return "place" if kind.where in near else "wrong"


def _group(closed: ClosedLoop, added: Added) -> set[str]:
    """All that the loop does not tell apart from an effect that it added, by label."""
    label = _label(added)
    return {
        other
        for turn in closed.rounds
        if turn.chosen is not None and turn.chosen.candidate.label == label
        for other in (
            label,
            *turn.chosen.stands_for,
            *(f"{one.name} at {one.junction}" for one in turn.alternatives if one.indistinguishable),
        )
    }


def _true(kind: Kind, drawn: Drawn) -> dict[str, dict[str, Any]]:
    return {name: {"true": value} for name, value in drawn.truth.values[kind.label].items()}


def _hit(closed: ClosedLoop, added: Added, kind: Kind, answer: Answer, drawn: Drawn) -> Hit:
    coefficients = _true(kind, drawn)
    if answer == "exact":
        fitted = closed.corrected if added.trial.gate is None else closed.eventful or closed.corrected
        ends = intervals(fitted)
        for name, known in coefficients.items():
            if name in ends:
                value = fitted.values[name]
                known |= {"estimate": value, "low": float(ends[name][0]), "high": float(ends[name][1])}
    return Hit(kind.label, answer, _label(added), coefficients, tuple(sorted(_group(closed, added))))


def _held_out(assessment: Assessment, noise: Mapping[str, float]) -> dict[str, float]:
    """Negative log-likelihood of held-out logs, and errors of free simulation over the true noise of the sensors."""
    errors = {name: one.simulation_rmse / noise[name] for name, one in assessment.channels.items() if name in noise}
    return {"nll": assessment.nll, **errors}
