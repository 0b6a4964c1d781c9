"""Regimes in a report: where a law acts, with the level that was estimated."""

from __future__ import annotations

from bondgraph.correct.evidence.trials import Added
from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.places.regimes import Regime, level_name, regime_of, width_name
from bondgraph.correct.result import intervals
from bondgraph.declare.effect import Effect
from bondgraph.estimate.fitted import Fit
from bondgraph.report.numbers import shown, with_ends


def named(added: Added, fitted: Fit) -> str:
    """Label of an effect; of a law with a regime with the level of a fit."""
    candidate, regime = added.trial.candidate, regime_of(added.trial.candidate.function)
    if regime is None:
        return candidate.label
    value = fitted.values[level_name(candidate.effect)]
    return f"{candidate.effect.name} at {candidate.place.label} where {_where(regime, value)}"


def regime_sentences(closed: ClosedLoop) -> list[str]:
    """A sentence for every added law that acts in a regime."""
    return [sentence for added in closed.added if (sentence := _sentence(added, closed.corrected))]


def _sentence(added: Added, fitted: Fit) -> str:
    effect, regime = added.trial.candidate.effect, regime_of(added.trial.candidate.function)
    if regime is None:
        return ""
    name = level_name(effect)
    level = with_ends(fitted.values[name], intervals(fitted)[name], regime.unit)
    within = f"{regime.quantity} is {regime.side} {level}"
    about = f"it comes and goes within {_valued(regime, _width(effect, fitted))} on both sides of that"
    ends = f"the logs cover {shown(regime.span[0])} to {shown(regime.span[1])}"
    return f"Regime: {effect.name} at {added.trial.candidate.place.label} acts where {within}; {about}; {ends}."


def _width(effect: Effect, fitted: Fit) -> float:
    model = fitted.problem.filter_model.model
    return float(fitted.theta[model.index("parameter", width_name(effect))])


def _where(regime: Regime, level: float) -> str:
    return f"{regime.quantity} is {regime.side} {_valued(regime, level)}"


def _valued(regime: Regime, value: float) -> str:
    unit = "" if regime.unit in ("", "1") else f" {regime.unit}"
    return f"{shown(value)}{unit}"
