"""Regimes in a report: where a law acts, with the level that was estimated."""

from __future__ import annotations

from bondgraph.correct.evidence.trials import Added
from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.places.regimes import Regime, level_names, regime_of, width_of
from bondgraph.correct.result import intervals
from bondgraph.estimate.fitted import Fit
from bondgraph.report.numbers import shown, with_ends


def named(added: Added, fitted: Fit) -> str:
    """Label of an effect; of a law with a regime with the level of a fit."""
    candidate, regime = added.trial.candidate, regime_of(added.trial.candidate.function)
    if regime is None:
        return candidate.label
    levels = [_valued(regime, fitted.values[name]) for name in level_names(candidate.effect, regime)]
    return f"{candidate.effect.name} at {candidate.place.label} where {regime.told(*levels)}"


def regime_sentences(closed: ClosedLoop) -> list[str]:
    """A sentence for every added law that acts in a regime."""
    return [sentence for added in closed.added if (sentence := _sentence(added, closed.corrected))]


def _sentence(added: Added, fitted: Fit) -> str:
    effect, regime = added.trial.candidate.effect, regime_of(added.trial.candidate.function)
    if regime is None:
        return ""
    names = level_names(effect, regime)
    within = regime.told(*(with_ends(fitted.values[name], intervals(fitted)[name], regime.unit) for name in names))
    each = "that" if len(names) == 1 else "each"
    about = f"it comes and goes within {_valued(regime, width_of(effect, fitted))} on both sides of {each}"
    ends = f"the logs cover {shown(regime.span[0])} to {_valued(regime, regime.span[1])}"
    return f"Regime: {effect.name} at {added.trial.candidate.place.label} acts where {within}; {about}; {ends}."


def _valued(regime: Regime, value: float) -> str:
    unit = "" if regime.unit in ("", "1") else f" {regime.unit}"
    return f"{shown(value)}{unit}"
