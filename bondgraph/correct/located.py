"""Where the residual points to: the best candidate of every place, before anything is decided."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scipy import stats

from bondgraph.correct.loop import Round


@dataclass(frozen=True)
class LocatedAt:
    """One place: the p-value of its best candidate, corrected for all tried, and its share of the best place's gain."""

    junction: str
    variable: Literal["effort", "flow"]
    p_value: float
    share: float


def located(turn: Round) -> tuple[LocatedAt, ...]:
    """Places by how much of the residual their best candidate explains, best first.

    The variable is the one that is missing there: an effort at a 1-junction, a flow at a 0-junction or on a bond that
    would have to give way.
    """
    best: dict[str, tuple[float, Literal["effort", "flow"]]] = {}
    for trial in turn.trials:
        place = trial.candidate.place
        variable: Literal["effort", "flow"] = "effort" if place.bond is None and place.junction.kind == "1" else "flow"
        if trial.gain > best.get(place.label, (0.0, variable))[0]:
            best[place.label] = (trial.gain, variable)
    largest = max((gain for gain, _ in best.values()), default=1.0)
    tried = max(len(turn.trials), 1)
    places = [
        LocatedAt(label, variable, min(1.0, tried * float(stats.chi2.sf(2.0 * gain, 1))), gain / largest)
        for label, (gain, variable) in best.items()
    ]
    return tuple(sorted(places, key=lambda place: -place.share))
