"""A second way in: candidates scored and refitted from the declared values, not from the fit without them.

With wide bounds a model that lacks something is fitted with parameters far from their truth, which stand in for it.
There the effect scores little or nothing, and from there its refit may end in the wrong place or at another optimum:
what is found would depend on how wide somebody declared the bounds. The declared values are where the one who declared
them thinks the machine is. Scores there take the free parameters out as everywhere, and refits from there that end
better than those from the fit count in their place.

The first round asks this: later ones begin at a fit that has the effects found so far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.correct.fits.fit import Fit, Report, expand, fit
from bondgraph.correct.fits.noise_starts import noisy_starts
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.models.failures import FAILURES
from bondgraph.correct.refits.decide import judge
from bondgraph.correct.refits.refit import (
    STRIDES,
    WORTH,
    Ground,
    abrupt,
    alike,
    along,
    at_optimum,
    coefficients,
    note,
    worth_quiet,
)
from bondgraph.correct.refits.runoff import CLOSE
from bondgraph.correct.refits.stiff_entrants import declared_point
from bondgraph.correct.refits.trials import Trial
from bondgraph.correct.scores.scoring import Scored, linearisation, score_candidates
from bondgraph.data.log import FloatArray
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings

#: Noise levels at declared values are where scores are taken and refits start, no result.
_TOLERANCE, _MOST_ITERATIONS = 0.5, 60
#: How far process noise, which stands in for what is missing, is lowered at starts, on its logarithmic scale.
_LOWERED = (0.0, 0.5, 1.0)
#: A refit is taken to this many nats, as those from the fit are.
_REFIT_TOLERANCE, _REFIT_ITERATIONS = 0.05, 25


@dataclass(frozen=True)
class Declared:
    """The model at its declared values, its noise levels fitted, and the scores of candidates there in their order."""

    fit: Fit
    scored: Scored


def declared_scores(ground: Ground, found: Sequence[Candidate]) -> Declared | None:
    """Scores of candidates at the declared values; None where the fit is as good as there, or the model diverges."""
    try:
        there = _at_declared_values(ground)
        if there is None or there.nll - ground.base.nll < ground.need:
            return None
        return Declared(there, score_candidates(linearisation(there, ground.train), found))
    except FAILURES:
        return None


def _at_declared_values(ground: Ground) -> Fit | None:
    """The declared values with noise levels that suit them, expanded in all that is free."""
    problem, point = ground.base.problem, declared_point(ground.base)
    moving = np.array([one.target.kind == "parameter" for one in problem.free])
    if not moving.any() or moving.all():
        return None
    values = dict(zip(problem.names, map(float, problem.values(point)), strict=True))
    rest = [replace(one, start=values[one.name]) for one, held in zip(problem.free, moving, strict=True) if not held]
    noise = fit(
        problem.filter_model, problem.logs, rest, _MOST_ITERATIONS, _TOLERANCE, noisy_starts(rest),
        journal=ground.journal,
    )  # fmt: skip
    point[~moving] = noise.point
    steps = GaussNewtonSettings().difference * (problem.upper - problem.lower)
    return Fit(problem, point, noise.nll, expand(problem, point, steps), noise.evaluations, SearchOutcome.CONVERGED)


def also_from_declared(
    trials: Sequence[Trial], declared: Declared | None, ground: Ground, most: int, report: Report
) -> list[Trial]:
    """The trials of vanishing candidates, the best of them refitted from the declared values too.

    Parameters
    ----------
    trials
        In the order of the scores, refitted from the fit without them where that was worth it.
    declared
        Scores at the declared values; None: nothing more is tried.
    ground
        What refits start from.
    most
        Most refits.
    report
        Told of each.
    """
    done = list(trials)
    if declared is None:
        return done
    groups = _worth_it(done, declared.scored, ground, most)
    for count, group in enumerate(groups):
        report("refit from the declared values", count, len(groups))
        try:
            own = build(done[group[0]].candidate.apply(ground.built.graph))
            fitted = _refit(done[group[0]], group[0], declared, own, ground)
        except FAILURES:
            continue
        before = done[group[0]].fit
        if before is None or fitted.nll < before.nll - _REFIT_TOLERANCE:
            note(done, group, fitted, own, ground)
    report("refit from the declared values", len(groups), len(groups))
    return _finished(done, [group[0] for group in groups], ground)


def _finished(trials: list[Trial], due: Sequence[int], ground: Ground) -> list[Trial]:
    """The trials, those near the best whose search ran out of iterations searched to the end.

    In coordinates as wide as bounds may be a search takes more of them; cut short, the wrong place was ahead.
    """
    best = min((trials[j].fit.nll for j in due if trials[j].fit is not None), default=np.inf)  # type: ignore[union-attr]
    for j in due:
        trial = trials[j]
        if trial.fit is None or trial.built is None or trial.fit.outcome.succeeded or trial.fit.nll > best + CLOSE:
            continue
        problem = trial.fit.problem
        try:
            fitted = fit(
                problem.filter_model, problem.logs, problem.free, _MOST_ITERATIONS, _REFIT_TOLERANCE,
                [trial.fit.point], journal=ground.journal,
            )  # fmt: skip
        except FAILURES:
            continue
        evidence = judge(ground.base, fitted, trial.candidate.effect, ground.tried)
        trials[j] = replace(trial, fit=fitted, evidence=evidence)
    return trials


def _worth_it(trials: Sequence[Trial], there: Scored, ground: Ground, most: int) -> list[list[int]]:
    """Groups of alike candidates that were refitted and gained, then those that promise most at the declared values."""
    best = max((trial.gain for trial in trials if trial.fit is not None), default=0.0)
    standing = [
        [j, *(k for k, other in enumerate(trials) if other.candidate.label in trial.stands_for)]
        for j, trial in sorted(enumerate(trials), key=lambda pair: -pair[1].gain)
        if trial.fit is not None and trial.gain >= max(WORTH * best, ground.need)
    ][:most]
    known = {j for group in standing for j in group}
    further = alike(trials, there.scores, worth_quiet(there.scores, ground.need))
    return standing + [group for group in further if not known.intersection(group)][:most]


def _refit(trial: Trial, index: int, declared: Declared, own: BuiltModel, ground: Ground) -> Fit:
    filter_model = replace(ground.base.problem.filter_model, model=own.model)
    free = coefficients(trial.candidate, filter_model, declared.scored.variants[index])
    found = declared.scored.scores
    shares = (*STRIDES, *abrupt(trial.candidate, found.steps[index]))
    process = np.array([one.target.kind == "process" for one in (*ground.base.problem.free, *free)])
    lowest = np.array([one.coordinate(one.lower) for one in (*ground.base.problem.free, *free)])
    starts: list[FloatArray] = []
    for share in shares:
        point = along(declared.fit, found, index, free, share)
        starts += [np.where(process, point + low * (lowest - point), point) for low in _LOWERED]
    return fit(
        filter_model, ground.train, (*at_optimum(ground.base), *free), _REFIT_ITERATIONS, _REFIT_TOLERANCE, starts,
        journal=ground.journal,
    )  # fmt: skip
