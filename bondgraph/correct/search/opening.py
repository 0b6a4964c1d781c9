"""The opening of a search: every candidate with what the first incumbents predict of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.fits.whiteness import is_white
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.scores.gates import gate_samples
from bondgraph.correct.scores.quiet import is_driven, quiet_scores
from bondgraph.correct.scores.scoring import Linearisation, Scored, score_candidates
from bondgraph.correct.search.events import Event, events
from bondgraph.correct.search.groups import alike
from bondgraph.correct.search.incumbents import (
    Prediction,
    predicted_by_scores,
    scaled,
    scored_at_declared_values,
)
from bondgraph.correct.search.regimes import gated_by_scores
from bondgraph.correct.search.search import Entry, Search, add_gated
from bondgraph.correct.search.storages import TrialSize, trial_size
from bondgraph.declare.effect import Place
from bondgraph.estimate.local import Report
from bondgraph.execute.threads import in_threads

#: Storages that are looked at side by side, whatever the machine, and events of each fit that may be refitted.
_ABREAST, _EVENTS = 2, 2


@dataclass(frozen=True)
class Scoring:
    """Candidates without a zero and those with one, scored on the linearised fit of the declared model.

    ``trials`` are those of the scored candidates, in their order; ``stateful`` bring a state of their own; ``where``
    are the places of the graph.
    """

    linear: Linearisation
    scored: Scored
    trials: tuple[Trial, ...]
    stateful: tuple[Candidate, ...]
    where: tuple[Place, ...] = ()


def opened(given: Scoring, context: Context, named: bool, report: Report) -> Search:
    """The search with everything that is known before the first refit.

    Parameters
    ----------
    given
        Scores at the fit of the declared model.
    context
        What all refits share.
    named
        Whether an effect was found before: then the fit has the effects found so far, and the declared values matter no
        more.
    report
        Called with a stage and its progress.
    """
    search = Search([Entry(trial) for trial in given.trials], given.scored, context, where=given.where)
    told = [(given.scored, predicted_by_scores(context.base, given.linear, given.scored, context))]
    if not named and not context.base.problem.filter_model.is_stiff:  # of stiff ones every search begins there too
        told.append((given.scored, scored_at_declared_values(context, given.scored.candidates)))
    _predict(search, told)
    _add_storages(search, given, named, report)
    _add_events(search, events(given.linear, given.scored, context, _EVENTS), 1.0)
    add_gated(search, gated_by_scores(given.linear, given.scored, given.where, context))
    return search


def look_beneath_noise(search: Search, given: Scoring, report: Report) -> None:
    """Add what a fit with little process noise predicts, and what it says of the candidates with a state.

    That fit ranks candidates by what noise stands in for; how much of that they keep once noise is free again it cannot
    say. So its best counts as much as the best of the other, or as what passes the tests.
    """
    context = search.context
    report("look beneath the process noise", 0, 1)
    quiet = quiet_scores(
        context.base, context.train, given.scored.candidates, context.journal, gate_samples(context.train)
    )
    report("look beneath the process noise", 1, 1)
    if quiet is None:
        return
    search.context = replace(context, quiet=quiet.fit)
    best = max((one.trial.gain for one in search.entries if one.trial.gate is None), default=0.0)
    own = predicted_by_scores(quiet.fit, quiet.linear, quiet.scored, context)
    followed = [k for k, one in enumerate(search.entries) if _is_followed(one)]
    other = quiet.of([search.entries[k].trial.candidate for k in followed])
    late = predicted_by_scores(quiet.fit, quiet.linear, other.scored, context)
    told = scaled([*own, *late], max(best, context.required))
    _predict(search, [(quiet.scored, told[: len(own)])])
    for k, one in zip(followed, told[len(own) :], strict=True):
        if one is not None:
            search.entries[k].pending.append(one)
    silent = events(quiet.linear, quiet.scored, context, _EVENTS)
    most = max((one.trial.score_gain for one in silent), default=1.0)
    loudest = max((one.trial.score_gain for one in search.entries if one.trial.gate is not None), default=0.0)
    _add_events(search, silent, max(best, context.required, loudest) / most)


def is_driven_still(search: Search) -> bool:
    """True where the leader of the search, or the fit without any candidate, needs noise that drives a state."""
    best = search.best
    leads = search.context.base if best is None or best.fit is None else best.fit
    return is_driven(leads, search.context.required)


def _is_followed(entry: Entry) -> bool:
    return entry.trial.candidate.effect.adds_state and entry.trial.candidate.followed and entry.trial.gate is None


def _predict(search: Search, told: Sequence[tuple[Scored, Sequence[Prediction | None]]]) -> None:
    """Note predictions at the first of each group of equals: of those that no fit has told apart.

    A fit far from the truth, or one whose noise is held low, may see two places as one that another fit tells apart.
    """
    groups = [alike(search.trials, scored.scores, 0.0) for scored, _ in told]
    search.groups += [{j: k for k, group in enumerate(every) for j in group} for every in groups]
    for j, entry in enumerate(search.entries):
        entry.twins = tuple(k for k in entry.twins if search.are_equal(j, k))
    first = {k: j for j, one in enumerate(search.entries) for k in (j, *one.twins) if one.twins}
    for group in (group for every in groups for group in every):
        for j in (k for k in group if k not in first):
            first[j] = next((k for k in group if first.get(k) == k and search.are_equal(k, j)), j)
            if first[j] != j:
                search.entries[first[j]].twins += (j,)
    for (_, predictions), every in zip(told, groups, strict=True):
        for j in dict.fromkeys(first[k] for group in every for k in group):
            own = predictions[j]
            if own is not None:
                search.entries[j].pending.append(own)


def _add_storages(search: Search, given: Scoring, named: bool, report: Report) -> None:
    """Entries of candidates with a state: lags and late sensors by their scores, others by trial sizes.

    A sensor that comes late can explain coloured noise by its memory; its score is that of the mean alone.
    """
    context = search.context
    followed = [one for one in given.stateful if one.followed]
    scored = score_candidates(given.linear, followed)
    chances = [min(1.0, float(p) * context.tried) for p in scored.scores.p_value]
    trials = [
        Trial(one, float(scored.scores.gain[k]), tuple(map(float, scored.scores.steps[k])), score_p=chances[k])
        for k, one in enumerate(followed)
    ]
    for trial, one in zip(trials, predicted_by_scores(context.base, given.linear, scored, context), strict=True):
        loud = one is not None and trial.score_p <= context.level
        search.entries.append(Entry(trial, [one] if loud and one is not None else []))
    search.entries.extend(_sized(given, context, named, report))


def _sized(given: Scoring, context: Context, named: bool, report: Report) -> list[Entry]:
    """Entries of storages at the size that suits the logs best.

    Of a stiff model only as long as no effect is named, and where innovations are not white: each has to be compiled.
    """
    due = [one for one in given.stateful if not one.followed]
    stiff = context.base.problem.filter_model.is_stiff
    if not due or (stiff and (named or is_white(context.base, context.level))):
        return [Entry(Trial(one, 0.0)) for one in due]
    found: dict[int, TrialSize] = {}

    def work(k: int) -> None:
        trial = Trial(due[k], 0.0)
        found[k] = attempted(
            lambda: trial_size(trial, context), lambda why: TrialSize(replace(trial, failed=why), None)
        )

    report("look at storages", 0, len(due))
    in_threads(_ABREAST, work, range(len(due)))
    report("look at storages", len(due), len(due))
    sized: Mapping[int, TrialSize] = found
    return [
        Entry(one.trial, [] if one.start is None else [Prediction(one.trial.score_gain, (one.start,))])
        for one in (sized[k] for k in range(len(due)))
    ]


def _add_events(search: Search, found: Sequence[Event], scale: float) -> None:
    """Entries of what acts in part of a log, each after the same law throughout; their gains count ``scale`` times.

    A fit far from the truth may show an effect in a part of the data alone.
    """
    known = {(one.trial.candidate.label, one.trial.gate) for one in search.entries}
    for event in found:
        if (event.trial.candidate.label, event.trial.gate) in known:
            continue
        start = np.concatenate([search.context.base.point, [event.step]])
        told = Prediction(scale * event.trial.score_gain, (start,))
        search.entries.append(Entry(event.trial, [told], tried=event.tried))
        search.entries[event.throughout].pending.append(told)
