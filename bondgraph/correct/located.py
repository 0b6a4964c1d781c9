"""Where a residual comes from: the places of a graph, each with the best that any candidate there explains."""

from __future__ import annotations

from dataclasses import dataclass

from bondgraph.correct.loop import Round
from bondgraph.correct.trials import Trial


@dataclass(frozen=True)
class LocatedAt:
    """One place and how well what is missing there explains the residual.

    ``variable`` is what would be missing: an ``"effort"`` at a 1-junction, a ``"flow"`` at a 0-junction or on a bond.
    ``p_value`` is that of the best candidate there, corrected for all candidates of the round; ``share`` its likelihood
    gain over the largest of any place, so that places which explain the residual equally well all have 1.
    """

    junction: str
    variable: str
    p_value: float
    share: float


def located(turn: Round) -> tuple[LocatedAt, ...]:
    """The places of a round, the most likely first.

    Places where no candidate gains anything come last, with a share of 0 and a p-value of 1.
    """
    best: dict[str, Trial] = {}
    for trial in turn.trials:
        label = trial.candidate.place.label
        if label not in best or trial.gain > best[label].gain:
            best[label] = trial
    largest = max((trial.gain for trial in best.values()), default=0.0)
    found = [
        LocatedAt(label, _variable(trial), trial.p_value, max(trial.gain, 0.0) / largest if largest > 0.0 else 0.0)
        for label, trial in best.items()
    ]
    return tuple(sorted(found, key=lambda place: (-place.share, place.p_value)))


def _variable(trial: Trial) -> str:
    place = trial.candidate.place
    return "effort" if place.bond is None and place.junction.kind == "1" else "flow"
