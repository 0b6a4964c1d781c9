"""The worth of a gate: what a law that acts in part of the operating space must show beside the usual tests.

A gated law must

- be off somewhere in the logs: one that only grows with a signal is a product, and acts everywhere;
- be worth more than an unknown function of the signal of its gate: what comes on gradually is no law with a gate;
- be worth more than the law that acts everywhere together with one term of the library in that signal, which has as
  many parameters. Of a drive that loses more one way than the other dry friction that ended just below its top speed
  gained 3800 nats on dry friction, and that with a drag in proportion to the magnitude of the speed 290 more;
- predict the folds that are left out better than the best law without a gate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bondgraph.correct.evidence.certified import with_steps
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.transfer import transfer
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import candidates
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.places.probes import FUNCTION_KNOTS, hats, is_switch, knots, probes, shaped, signals
from bondgraph.correct.places.regimes import everywhere, level_names, regime_of, width_of
from bondgraph.correct.scores.score import best_step
from bondgraph.correct.scores.scoring import Linearisation, linearisation
from bondgraph.correct.search.refit import refit_from
from bondgraph.correct.search.regimes import without_effect
from bondgraph.correct.search.widths import with_free_widths
from bondgraph.correct.shapes.offered import Residual, best_term
from bondgraph.declare.effect import Place


def earned(trial: Trial, trials: Sequence[Trial], where: Sequence[Place], context: Context) -> Trial:
    """A gated trial after the tests of its gate: that of its shape, and its transfer against the best law without one.

    Where it fails it is not chosen, and says why.
    """
    assert trial.fit is not None and trial.evidence is not None  # it would be chosen
    remark = _against(trial, where, context)
    if remark:
        doubted = replace(trial.evidence, p_robust=1.0)
        return replace(trial, evidence=doubted, remark=f"{trial.remark}; {remark}" if trial.remark else remark)
    plain = [one for one in trials if not one.candidate.effect.regime and one.gate is None and one.fit is not None]
    rival = max(plain, key=lambda one: one.gain, default=None)
    if rival is None or rival.fit is None:
        return trial
    fit = with_steps(rival.fit, trial.fit.problem.filter_model, context.journal)
    told = transfer(fit, trial.fit, trial.candidate.effect)
    return trial if told.passes else replace(trial, transfer=told)


def in_its_signal(trial: Trial, where: Sequence[Place], context: Context) -> Trial | None:
    """The best term of the library in the signal of a gate, refitted in the place of the gated law; None if none is.

    A thermostat that opens slowly was a loss above a level, refused since a ramp explains more, and the ramp that
    explains 700 nats was not offered itself.
    """
    regime, place = regime_of(trial.candidate.function), trial.candidate.place
    linear = linearisation(context.base, context.train)
    known = signals(context.built, linear, where)
    signal = next((one for one in known if regime is not None and one.name == regime.signal), None)
    if signal is None or is_switch(signal):
        return None
    left = Residual(context.built, linear, probes(context.built, linear, [place]), known, ())
    return best_term(place, signal, left, context)


def _against(trial: Trial, where: Sequence[Place], context: Context) -> str:
    """Objection to a gate, whatever it gains; empty if there is none."""
    assert trial.fit is not None and trial.built is not None  # it was refitted
    regime = regime_of(trial.candidate.function)
    assert regime is not None  # it has a gate
    names = level_names(trial.candidate.effect, regime)
    if trial.fit.held[[trial.fit.problem.names.index(name) for name in names]].any():
        return "its level rests on an end of what the logs cover"
    if not regime.shuts([trial.fit.values[name] for name in names], width_of(trial.candidate.effect, trial.fit)):
        return "it is off nowhere in the logs"
    linear = linearisation(trial.fit, trial.fit.problem.logs)
    if _function_is_better(trial, linear, where, context):
        return "an unknown function of the signal of its gate explains more"
    return attempted(lambda: _sum_is_better(trial, where, context), lambda why: "")


def _sum_is_better(trial: Trial, where: Sequence[Place], context: Context) -> str:
    """The law without its gate and one term in the signal of that, where these explain more; else empty."""
    effect, regime, place = trial.candidate.effect, regime_of(trial.candidate.function), trial.candidate.place
    assert trial.fit is not None and trial.evidence is not None and regime is not None  # a law with a gate, refitted
    found, _ = candidates(context.built, [everywhere(trial.candidate.function)], [place])
    if not found:
        return ""
    plain = refit_from(Trial(found[0], 0.0), [trial.fit.values[name] for name in effect.coefficients], context)
    if plain.candidate.effect.widths and not effect.widths:  # those of the gated law are fitted
        plain = with_free_widths(plain, context)
    assert plain.fit is not None and plain.built is not None and plain.evidence is not None  # it was refitted
    linear = linearisation(plain.fit, context.train)
    again = replace(context, built=plain.built, base=plain.fit, quiet=None)
    probed, known = probes(plain.built, linear, [place]), signals(plain.built, linear, where)
    left = Residual(plain.built, linear, probed, known, ())
    signal = next((one for one in known if one.name == regime.signal), None)
    if signal is None or is_switch(signal):
        return ""
    term = best_term(place, signal, left, again)
    if term is None or term.evidence is None:
        return ""
    together = plain.evidence.bic_gain + term.evidence.bic_gain
    if together < trial.evidence.bic_gain:
        return ""
    return f"{plain.candidate.effect.name} everywhere and {term.candidate.effect.name} explain more"


def _function_is_better(trial: Trial, linear: Linearisation, where: Sequence[Place], context: Context) -> bool:
    """True where a free function of the signal of a gate at its place is worth more than the gated law.

    As of formulas: what leaves a part of what a free function explains is no law of the shape.
    """
    regime, effect = regime_of(trial.candidate.function), trial.candidate.effect
    assert regime is not None and trial.built is not None  # it has one, and was refitted
    signal = next((one for one in signals(trial.built, linear, where) if one.name == regime.signal), None)
    if signal is None or is_switch(signal):
        return False
    at = knots(signal, FUNCTION_KNOTS, beyond=0.0)
    without, gain = without_effect(linear, context.base.point.size, len(effect.coefficients))
    half = 0.5 * math.log(max(sum(int(np.isfinite(log.y).sum()) for log in context.train), 2))
    for probe in probes(trial.built, linear, [trial.candidate.place]):
        changes = [shaped(one, hats(values, at)) for one, values in zip(probe.changes, signal.values, strict=True)]
        projected = without.projected(without.columns(changes))
        _, free, _ = best_step(replace(projected, times=None), list(range(at.size)), np.zeros(at.size, dtype=bool))
        if free - half * at.size > gain - half * len(effect.parameters):
            return True
    return False
