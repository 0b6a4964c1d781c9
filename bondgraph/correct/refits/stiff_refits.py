"""Refits of candidates on stiff models, whose filters take longest: heats on a part of the logs, then the whole.

A stiff model that lacks something is fitted far from its truth, and a local search from there ends far from it too. So
what promises much is searched anew, from little process noise (``quiet_start``), on the
beginnings of the logs; those that gain most there go on to the whole, first the best of them, then those that this
does not beat clearly on the beginnings. What promises little is near, and starts where its score points; what promises
less than must be gained is refitted only where its law is not smooth, which scores underrate. At last the fit with the
best of them says which others would do as well in its place (:mod:`.exchange`); those are refitted from there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from bondgraph.correct.fits.excerpts import excerpt
from bondgraph.correct.fits.fit import WITHIN_REACH, Fit, Report, fit
from bondgraph.correct.models.failures import FAILURES, reason
from bondgraph.correct.refits.decide import CLOSE, choose
from bondgraph.correct.refits.exchange import exchanges
from bondgraph.correct.refits.refit import (
    Ground,
    alike,
    note,
)
from bondgraph.correct.refits.stiff_entrants import (
    Entrant,
    compiled_ones,
    each_made,
    entrant_of,
    entrants_of,
    moved_there,
    note_failure,
    quiet_entrant,
)
from bondgraph.correct.refits.stiff_picks import attainable, picked_quiet, simpler_law, varied
from bondgraph.correct.refits.trials import Trial
from bondgraph.correct.scores.quiet import Quiet
from bondgraph.correct.scores.scoring import Scored
from bondgraph.estimate.exact import compile_exact
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.filter.compiled import in_threads

_Task = TypeVar("_Task")

#: At most so many candidates are searched from anywhere else than the end of the best of them.
_MOST = 4
#: Heats end where a further step promises less than so many nats; after them few steps are left.
_ROUGH, _ROUGH_ITERATIONS = 2.0, 30
_TOLERANCE, _MOST_ITERATIONS = 0.05, 12
#: Those that gain this share of the best in their heat go on; but not those that the best fit to the whole logs so far
#: beats on their beginnings by more than must be gained, and so many nats that a heat may leave to exact derivatives.
_AHEAD, _UNFINISHED = 0.6, 60.0
#: So many times the best is exchanged for others, as far as they seem to lose less than this share of what it gains; of
#: what loses much expansions are right to a factor of two only (a winch: 89 nats said, 50 lost), so refits decide.
_EXCHANGES, _ACCURATE = 3, 0.1
#: The same law at another place is exchanged though it seems to lose up to this share (a vehicle's creep in the tyre
#: instead of in what it pushes: half of 251 nats said, and it gained); it is searched if its score is this share.
_SAME_LAW = 0.6
#: Side by side, whatever the machine, so that results do not depend on it.
ABREAST = 2


def refit_stiff(
    trials: Sequence[Trial], scored: Scored, ground: Ground, most: int, report: Report, ahead: float = 0.0
) -> list[Trial]:
    """The trials of vanishing candidates on a stiff model, the best of them refitted.

    Parameters
    ----------
    trials
        In the order of the scores.
    scored
        Scores of the same candidates.
    ground
        What to start from.
    most
        Most refits.
    report
        Told of each.
    ahead
        What another candidate has gained by its refit; those are left out that cannot reach it, however underrated.
    """
    done = list(trials)
    groups = [
        group
        for group in varied(trials, scored.scores, ground)
        if (done[group[0]].score_gain > ground.need or done[group[0]].candidate.effect.amplitudes)
        and attainable(done[group[0]].score_gain, done[group[0]].candidate.effect) >= ahead
    ]
    _refit(entrants_of(groups[: min(_MOST, most)], done, scored, ground), done, ground, report)
    _exchange(done, scored, ground)
    _elsewhere(done, scored, ground, report)
    refitted = [j for j, trial in enumerate(done) if trial.fit is not None]
    if refitted:
        leader = min(refitted, key=lambda j: _nll(done[j]))
        simpler = simpler_law(leader, done, scored.scores, ground)
        if simpler is not None:
            _refit(entrants_of([[simpler]], done, scored, ground), done, ground, report)
    return done


def refit_quiet(trials: Sequence[Trial], scored: Scored, quiet: Quiet, ground: Ground, report: Report) -> list[Trial]:
    """The trials, and refits of those that are best with the process noise held low, as far as they have none.

    Parameters
    ----------
    trials, scored, ground, report
        As for :func:`refit_stiff`, some of them refitted.
    quiet
        Scores of the same candidates on the quiet fit.
    """
    done = list(trials)
    before = choose(done, ground.level)
    entrants = each_made(
        lambda group: quiet_entrant(done, group, quiet, ground),
        picked_quiet(done, quiet.scored.scores, ground),
        lambda group, why: note_failure(group[0], why, done),
    )
    _refit(entrants, done, ground, report, -0.5 * ground.need)
    if choose(done, ground.level) is not before:
        _exchange(done, scored, ground)
        _elsewhere(done, scored, ground, report)
    return done


def _refit(
    entrants: Sequence[Entrant], done: list[Trial], ground: Ground, report: Report, reach: float = WITHIN_REACH
) -> None:
    """Heats, then refits of those that are ahead, noted in the trials; what needs no heat is refitted as it is.

    They are finished where they end behind the best so far by less than ``reach``.
    """
    if not entrants:
        return
    entrants = compiled_ones(entrants, done)  # before threads start
    report("refit the best candidates", 0, len(entrants))
    near = [one for one in entrants if one.beginning is None]
    ahead = _ahead([one for one in entrants if one.beginning is not None], done, ground)
    report("refit the best candidates", len(entrants) - len(near) - len(ahead), len(entrants))
    for due in (ahead[:1], [*((one, -np.inf) for one in near), *ahead[1:]]):
        best = choose(done, ground.level)
        lead = ground.base if best is None or best.fit is None else best.fit
        least = _on_beginnings(lead) + ground.need + _UNFINISHED
        for one, fitted in _whole([one for one, reached in due if reached < least], done, ground, lead.nll, reach):
            note(done, one.group, fitted, one.built, ground)
    report("refit the best candidates", len(entrants), len(entrants))


def _ahead(entrants: Sequence[Entrant], done: list[Trial], ground: Ground) -> list[tuple[Entrant, float]]:
    """Those that go on to the whole logs from where their heat ended, with what they reached there, the best first."""
    if not entrants:
        return []
    parts = [_part(one, ground) for one in entrants]

    def heat(k: int) -> Fit:
        one, part = entrants[k], parts[k]
        return fit(
            one.filter_model, part.logs, one.free, _ROUGH_ITERATIONS, _ROUGH, one.starts, journal=ground.journal,
            first=one.beginning,
        )  # fmt: skip

    found = _abreast(heat, range(len(entrants)), lambda k, why: note_failure(entrants[k].group[0], why, done))
    best = min(np.inf if one is None else one.nll for one in found)
    problem = replace(ground.base.problem, logs=parts[0].logs)
    gained = float(problem.nll(ground.base.point[:, np.newaxis])[0]) - best
    kept = [
        (replace(one, starts=(heated.point,)), heated.nll)
        for one, heated in zip(entrants, found, strict=True)
        if heated is not None and heated.nll <= best + (1.0 - _AHEAD) * max(gained, 0.0)
    ]
    return sorted(kept, key=lambda pair: pair[1])


def _again(entrants: Sequence[Entrant], best: Fit, done: list[Trial], ground: Ground) -> None:
    """Refits from the given starts, noted in the trials where they are better than what is there."""
    entrants = _not_behind(entrants, best, done, ground)
    for one, fitted in _whole(entrants, done, ground, best.nll):
        if fitted.nll < _nll(done[one.group[0]]):
            note(done, one.group, fitted, one.built, ground)


def _exchange(done: list[Trial], scored: Scored, ground: Ground) -> None:
    """Refit what would do as well in the place of the best, from where that one ended; again if it is better."""
    groups = alike(done, scored.scores, 0.5 * ground.need)
    tried: set[int] = set()
    for _ in range(_EXCHANGES):
        best = choose(done, ground.level)
        if best is None or best.fit is None:
            return
        lead, others = best.fit, [group for group in groups if done[group[0]] is not best and group[0] not in tried]
        found = exchanges(
            best, [done[group[0]].candidate for group in others], [scored.variants[group[0]] for group in others],
            ground.train, ground.base.point.size,
        )  # fmt: skip
        gained = ground.base.nll - lead.nll
        due, margin = [], max(CLOSE, _ACCURATE * gained)
        for group, one in zip(others, found, strict=True):
            if one is None:
                continue
            for j in group:
                done[j] = replace(done[j], instead=(best.candidate.label, one.loss))
            same = any(done[j].candidate.function is best.candidate.function for j in group)
            if one.loss < (_SAME_LAW * gained if same else margin) and (
                _nll(done[group[0]]) > lead.nll + max(one.loss, 0.0) + _ROUGH
            ):
                due.append((one, group))
        due = sorted(due, key=lambda pair: pair[0].loss)[:ABREAST]
        entrants = each_made(
            lambda pair: replace(entrant_of(done, pair[1], scored, ground), starts=pair[0].starts),
            due,
            lambda pair, why: note_failure(pair[1][0], why, done),
        )
        _again(entrants, lead, done, ground)
        tried |= {group[0] for _, group in due}
        if not due:
            return


def _elsewhere(done: list[Trial], scored: Scored, ground: Ground, report: Report) -> None:
    """Refit the law that did best at other places where its score promises about as much, searched anew.

    Of what is far an exchange knows nothing: creep of a vehicle's tyre in place of that of what it pushes was to lose
    3300 nats where all that was gained were 814.
    """
    best = choose(done, ground.level)
    if best is None:
        return
    groups = [
        group
        for group in alike(done, scored.scores, 0.5 * ground.need)
        if all(done[j].fit is None for j in group)
        and done[group[0]].candidate.function is best.candidate.function
        and done[group[0]].score_gain >= _SAME_LAW * best.score_gain
    ]
    entrants = entrants_of(groups[:ABREAST], done, scored, ground)
    index = next(k for k, trial in enumerate(done) if trial is best)
    _refit([moved_there(one, best, index, done, scored.scores) for one in entrants], done, ground, report)


def _not_behind(entrants: Sequence[Entrant], best: Fit, done: list[Trial], ground: Ground) -> list[Entrant]:
    """Those that are not clearly behind the best fit on the beginnings of the logs, from where they ended there.

    What explains these clearly worse is told apart.
    """
    entrants = compiled_ones(entrants, done)
    part = excerpt(best.problem)
    if part is None:
        return list(entrants)
    reached = _on_beginnings(best)

    def heat(one: Entrant) -> Fit:
        return fit(
            one.filter_model, part.logs, one.free, _ROUGH_ITERATIONS, _ROUGH, one.starts, reached, ground.journal
        )

    def failed(one: Entrant, why: str) -> None:
        note_failure(one.group[0], why, done)

    return [
        replace(one, starts=(heated.point, *one.starts))
        for one, heated in zip(entrants, _abreast(heat, entrants, failed), strict=True)
        if heated is not None and heated.nll < reached + ground.need + _UNFINISHED
    ]


def _on_beginnings(best: Fit) -> float:
    """The negative log-likelihood of the beginnings of the logs at the optimum of them all."""
    part = excerpt(best.problem) or best.problem
    return float(part.nll(best.point[:, np.newaxis])[0])


def _whole(
    entrants: Sequence[Entrant], done: list[Trial], ground: Ground, beat: float, reach: float = WITHIN_REACH
) -> list[tuple[Entrant, Fit]]:
    """Fits to the whole logs, given up where they will clearly not be better than ``beat``; not those that diverge."""

    def compiled(one: Entrant) -> Entrant:
        compile_exact(EstimationProblem(one.filter_model, ground.train, one.free))
        return one

    def failed(one: Entrant, why: str) -> None:
        note_failure(one.group[0], why, done)

    entrants = each_made(compiled, entrants, failed)

    def whole(one: Entrant) -> Fit:
        return fit(
            one.filter_model, ground.train, one.free, _MOST_ITERATIONS, _TOLERANCE, one.starts, beat, ground.journal,
            reach=reach,
        )  # fmt: skip

    found = _abreast(whole, entrants, failed)
    return [(one, fitted) for one, fitted in zip(entrants, found, strict=True) if fitted is not None]


def _nll(trial: Trial) -> float:
    return np.inf if trial.fit is None else trial.fit.nll


def _part(one: Entrant, ground: Ground) -> EstimationProblem:
    """The beginnings of long logs."""
    problem = EstimationProblem(one.filter_model, ground.train, one.free)
    return excerpt(problem) or problem


def _abreast(
    action: Callable[[_Task], Fit], tasks: Sequence[_Task], failed: Callable[[_Task, str], None]
) -> list[Fit | None]:
    """Fits side by side; None for one that could not be made, of which ``failed`` is told why."""
    found: list[Fit | None] = [None] * len(tasks)
    why: dict[int, str] = {}

    def work(k: int) -> None:
        try:
            found[k] = action(tasks[k])
        except FAILURES as error:
            why[k] = reason(error)

    in_threads(ABREAST, work, range(len(tasks)))
    for k in sorted(why):
        failed(tasks[k], why[k])
    return found
