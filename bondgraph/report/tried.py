"""Rows of what was tried in each round: what was chosen with what became of it, then the others with their reasons."""

from __future__ import annotations

from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.loop import ClosedLoop
from bondgraph.report.series import Tried

#: Alternatives shown per round; all stand in result.json.
_MOST_ALTERNATIVES = 10


def tried(closed: ClosedLoop) -> list[Tried]:
    """The rows of all rounds."""
    rows = []
    kept = {added.trial.candidate.label: "added" for added in closed.added}
    for added in closed.added:
        said = f"a part of the form of {added.trial.candidate.label}"
        kept |= {one.candidate.label: said for one in added.trial.forms[1:]}
    for turn in closed.rounds:
        if turn.chosen is not None:
            chosen = turn.chosen.candidate
            stays = chosen.label in kept
            done = kept.get(chosen.label) or _became(turn.chosen, closed)
            rows.append(Tried(chosen.effect.described, chosen.place.label, turn.chosen.gain, done, chosen=stays))
        rows += [
            Tried(
                other.name, other.junction, other.delta_nll, other.why,
                indistinguishable=other.indistinguishable, separate=other.separate,
            )
            for other in turn.alternatives[:_MOST_ALTERNATIVES]
        ]  # fmt: skip
    return rows


def _became(chosen: Trial, closed: ClosedLoop) -> str:
    """Fate of an effect that the corrected declaration does not have."""
    label = chosen.candidate.label
    event = next((one.trial for one in closed.events if one.trial.candidate.label == label), None)
    if event is not None:
        return f"an event: it acts {event.gate}, and time is no law, so that the corrected declaration does not have it"
    actions = {one.action for one in closed.history if one.what == label}
    if "event" in actions:
        return "taken for an event, taken out again later"
    if "simplified" in actions:
        return "added; a simpler law took its place"
    if "replaced" in actions:
        return "added; another law took its place"
    if actions & {"added", "dropped", "withdrawn"}:
        return "added, taken out again later"
    return "it passes the tests, but a disturbance explains more"
