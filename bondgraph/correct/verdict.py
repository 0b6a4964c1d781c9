"""The verdict of a loop: one of six, by what was added, what stays unexplained, and what the logs say of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

from bondgraph.correct.confirmation import Confirmation
from bondgraph.correct.evidence.decide import passing, preferred_gain
from bondgraph.correct.evidence.trials import Added, Trial
from bondgraph.correct.fits.whiteness import Whiteness
from bondgraph.correct.places.unexplained import Unexplained
from bondgraph.correct.round import Round
from bondgraph.correct.search.disturbances import Disturbance
from bondgraph.filter.misfit import p_text

Verdict: TypeAlias = Literal[
    "effect found", "effect not confirmed", "disturbance", "sensor fault suspected", "unexplained residual",
    "no missing effect",
]  # fmt: skip


def unproven(rounds: Sequence[Round], level: float) -> Trial | None:
    """What passes the tests of the last round and was not chosen: a fault of the only sensor, or less than it explains.

    Something is missing then, whatever the innovations look like: of a flow meter that cuts off small flows these were
    white, and a dead zone of the sensor gained 440 nats.
    """
    if not rounds or rounds[-1].chosen is not None:
        return None
    return max(passing(rounds[-1].trials, level), key=preferred_gain, default=None)


def verdict(
    added: Sequence[Added],
    random: Sequence[Disturbance],
    left: Sequence[Unexplained],
    residual: Sequence[Whiteness],
    level: float,
    reason: str,
    logs: Confirmation | None,
    doubted: Trial | None,
) -> tuple[Verdict, str]:
    """The verdict, and the reason why the search ended with the channels that stay coloured."""
    coloured = [test for test in residual if test.p_value * len(residual) < level]
    why = f"{reason}; {_coloured(coloured, len(residual))}" if coloured else reason
    named = [one for one in added if one.trial.candidate.effect.name != "table"]
    if named and logs is not None and logs.contradictions:
        return "effect not confirmed", why
    if named and all(one.trial.candidate.effect.channel for one in named):
        return "sensor fault suspected", why
    if named:
        return "effect found", why
    if random and not left:
        return "disturbance", why
    if coloured or left or added or random or doubted is not None:
        return "unexplained residual", why
    return "no missing effect", why


def _coloured(coloured: Sequence[Whiteness], tested: int) -> str:
    chance = p_text(min(one.p_value for one in coloured) * tested)
    return f"the innovations of {', '.join(one.channel for one in coloured)} stay coloured ({chance})"
