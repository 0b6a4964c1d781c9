"""A second look at what passed: would less have done as well, and does the free simulation need it too.

Two things can make a candidate look better than it is. The fit without it may rest in another optimum of the noise
levels, which the refit has left by chance; so the model without it is fitted once more from where the refit ended. And
a filter whose innovations stay coloured is no model of the noise: it takes the colour of a sensor for motion, and then
the estimates of physical parameters are off by more than any scatter tells, as regressions on noisy regressors are.
Errors of the free simulation do not feed the noise back, so that their least squares stay consistent whatever its
colour: Ljung (1999), System Identification, section 8.4. There, with the process noise at its lower bound, the
coefficient must be clear of zero as well, and what it gains more than such noise gives anyway.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from bondgraph.correct.constants import LONGEST_MEMORY
from bondgraph.correct.evidence.certified import with_steps
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import channel_shares, gauge_p_value, judge, robust_p_value, robust_ratio_p_value
from bondgraph.correct.evidence.transfer import transfer
from bondgraph.correct.evidence.trials import Evidence, Trial
from bondgraph.correct.fits.assess import gain_p_value
from bondgraph.correct.fits.integrals import integrating
from bondgraph.correct.fits.whiteness import whiteness
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.scores.quiet import annealed_fit, quiet_fit
from bondgraph.errors import EstimationError
from bondgraph.estimate.derivatives.linearised import is_linearised
from bondgraph.estimate.excerpt import excerpt
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.local import fit

_TOLERANCE, _MOST_ITERATIONS = 0.05, 40
#: A search on the beginnings of long logs ends where a step promises less than so many nats.
_ROUGH = 2.0


def confirmed(trial: Trial, context: Context) -> Trial:
    """The trial with its evidence after a second look.

    A trial that stands by its white channels alone is left as it is on stiff models, whose fits are costly. Neither the
    variance of a refit nor that of a score tells enough otherwise: in noise of another colour dry friction of a strut
    was 30 and more standard deviations from zero, where its scores said p = 1 once and 0.006 once. A storage must gain
    all along the logs there, since its free simulation misses one that is there beside something else: a soft shaft in
    coloured noise gained 17 to 27 nats, one to 1.5 standard errors of their sum, where a true one gained 578, 4.5 of
    them.
    """
    if trial.fit is None or trial.evidence is None:
        return trial
    candidate = trial.candidate
    if context.base.problem.filter_model.is_stiff:
        if is_clear(trial.fit, trial.evidence, candidate, context.level):
            return trial
        if candidate.effect.adds_state and not candidate.followed:
            along = gain_p_value(context.base.own_runs, trial.fit.own_runs)
            return replace(trial, evidence=replace(trial.evidence, p_robust=max(trial.evidence.p_robust, along)))
    base = _from_there(context.base, trial.fit, context)
    evidence = judge(base, trial.fit, trial.candidate.effect, trial.evidence.tried, trial.gate is not None)
    return replace(trial, evidence=_in_free_simulation(trial.fit, trial, evidence, context))


def transferred(trial: Trial, context: Context) -> Trial:
    """The trial with how it transfers to data that it was not estimated from; an event, which is no law, has none."""
    if trial.fit is None or trial.gate is not None:
        return trial
    base = with_steps(context.base, trial.fit.problem.filter_model, context.journal)
    return replace(trial, transfer=transfer(base, trial.fit, trial.candidate.effect))


def _from_there(base: Fit, refit: Fit, context: Context) -> Fit:
    """The fit without the effect, or a better one that is found from where the refit with it ended."""
    known = refit.values
    free = [
        replace(one, start=min(max(known[one.name], one.lower), one.upper)) if one.name in known else one
        for one in at_optimum(base)
    ]
    problem, journal = base.problem, context.journal
    part = excerpt(problem) if is_linearised(problem) else None
    try:
        if part is not None:
            begun = fit(replace(problem, logs=part.logs, free=tuple(free)), _MOST_ITERATIONS, _ROUGH, journal=journal)
            if begun.nll > float(part.nll(base.point[:, np.newaxis])[0]):
                return base  # it explains the beginnings of long logs less well already
            free = list(at_optimum(begun))
        other = fit(replace(problem, free=tuple(free)), _MOST_ITERATIONS, _TOLERANCE, journal=journal)
    except EstimationError:
        return base
    return other if other.nll < base.nll else base


def is_clear(refit: Fit, evidence: Evidence, candidate: Candidate, level: float) -> bool:
    """Whether a candidate stands by the channels alone whose innovations could be white.

    Coloured ones may say what they like: what they tell of its coefficients does not count.
    """
    names = candidate.effect.coefficients
    told, tests = channel_shares(refit, names), whiteness(refit, refit.problem.logs)
    coloured = sum(told[test.channel] for test in tests if test.p_value * len(tests) < level)
    p_value = robust_p_value(refit, names, candidate.effect.shapes, share=max(0.0, 1.0 - coloured))
    return p_value * evidence.tried < level


def _in_free_simulation(refit: Fit, trial: Trial, evidence: Evidence, context: Context) -> Evidence:
    """The evidence; where the innovations stay coloured with the p-value that the free simulation gives.

    The fit without the candidate is looked for in two ways, so that it is not blamed for a wrong optimum; that with it
    in the second way only where it does not pass as it is.
    """
    driven = any(one.target.kind == "process" for one in refit.problem.free)
    if not driven or is_clear(refit, evidence, trial.candidate, context.level):
        return evidence
    walking, stake = integrating(context.base), evidence.delta_nll
    still = context.quiet or quiet_fit(context.base, context.train, context.journal)
    without = _quietest(context.base, still, context, 0.0)
    quiet = quiet_fit(refit, refit.problem.logs, context.journal, walking, stake)
    p_value = _p_value(quiet, without, trial) * evidence.tried
    if p_value > context.level:
        p_value = _p_value(_quietest(refit, quiet, context, stake), without, trial) * evidence.tried
    return replace(evidence, p_robust=max(evidence.p_robust, min(1.0, p_value)))


def _p_value(quiet: Fit | None, without: Fit | None, trial: Trial) -> float:
    """The p-value of a candidate by the quiet fits with and without it; 1 where no simulation with it stays near."""
    if quiet is None:
        return 1.0
    effect = trial.candidate.effect
    p_value = robust_p_value(quiet, effect.coefficients, effect.shapes, uneven=True)
    if without is not None:
        gain = without.nll - quiet.nll
        p_value = min(p_value, gauge_p_value(gain, quiet, effect.coefficients, effect.shapes))
        p_value = max(p_value, robust_ratio_p_value(gain, quiet, effect.coefficients))
        if effect.adds_state or trial.gate is not None:
            p_value = max(p_value, _deflated(gain, quiet))
    return p_value


def _quietest(loud: Fit, quiet: Fit | None, context: Context, stake: float) -> Fit | None:
    """The likelier of a quiet fit and the one that lowering the process noise of a fit by steps leads to."""
    annealed = annealed_fit(loud, loud.problem.logs, context.journal, integrating(context.base), stake)
    return min((one for one in (quiet, annealed) if one is not None), key=lambda one: one.nll, default=None)


def _deflated(gain: float, quiet: Fit) -> float:
    """P-value of a gain, in nats, in the free simulation, less what noise as coloured as its errors gains anyway.

    A storage has no zero from which the scatter of its coefficient could tell it apart; one that acts in part of the
    data rests on few blocks of time, whose scatter tells too little of noise that wanders. Quadratic forms in values
    with the correlation a from sample to sample are larger by (1 + a) / (1 - a) at most, in slow directions.
    """
    tests = whiteness(quiet, quiet.problem.logs)
    colour = min(max((test.first_correlation for test in tests), default=0.0), LONGEST_MEMORY)
    inflation = (1.0 + max(colour, 0.0)) / (1.0 - max(colour, 0.0))
    return float(stats.chi2.sf(2.0 * max(gain, 0.0) / inflation, 1))
