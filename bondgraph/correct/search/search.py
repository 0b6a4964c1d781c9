"""The search: candidates are refitted in the order of what finished fits predict of them, until none can matter.

incumbents = the fit of the declared model, the same with little process noise, the declared values
while the best bound is near the best gain: refit it from all that incumbents predict; if it leads, it is an incumbent

A bound is what incumbents predict times an optimism: the upper quantile of what fits of its class achieved over what
was predicted of them in this search. So a class of which predictions are poor (laws that are not smooth, storages) is
searched more widely, as far as this search shows that it must be. What is left when the refits are spent is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bondgraph.compile.machine_code import has_numba
from bondgraph.correct.constants import INDIFFERENT, OPTIMISM, UPPER
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import choose
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.scores.scoring import Scored
from bondgraph.correct.search.events import context_in_part
from bondgraph.correct.search.incumbents import Prediction, predicted_by_swap, predicted_in_its_place
from bondgraph.correct.search.refit import Prepared, begun, looked_closer, prepared, refit
from bondgraph.correct.search.regimes import Gated, gated_in_place
from bondgraph.data.log import FloatArray
from bondgraph.declare.effect import Place
from bondgraph.estimate.derivatives.exact import compile_exact
from bondgraph.estimate.local import Report
from bondgraph.execute.threads import in_threads
from bondgraph.filter.compiled import CompiledFilter

#: Candidates of stiff models that are refitted at once, whatever the machine, so that results do not depend on it.
_ABREAST = 2
#: Candidates of which a part of the logs tells which is refitted first, where none leads. A convention.
_RACED = 4
#: Responses less alike than this do not take each other's place.
_STRANGE = 0.2


@dataclass
class Entry:
    """A candidate of the search: its trial, what incumbents predict since its last refit, and its equals.

    ``twins`` are positions of the candidates whose response is the same to rounding; ``tried`` how many it was picked
    from, None: as many as the round tried. ``decided``: second looks have decided on it, and it is refitted no more.
    ``ready``: what its refit begins with, or why there is none, if that was found before.
    """

    trial: Trial
    pending: list[Prediction] = field(default_factory=list)
    twins: tuple[int, ...] = ()
    tried: int | None = None
    decided: bool = False
    ready: Prepared | str | None = None

    @property
    def kind(self) -> str:
        """The class of which predictions are comparable.

        A law that switches holds or frees the machine; what a sensor shows wrongly moves nothing in it.
        """
        effect = self.trial.candidate.effect
        if self.trial.gate is not None:
            return "event"
        if effect.regime:
            return "regime"
        switches = bool(effect.amplitudes) and not effect.channel
        return "storage" if effect.adds_state else "switching" if switches else "smooth"

    def predict(self, one: Prediction) -> None:
        """Note what another incumbent predicts; a refit begins anew where that is more than all before."""
        if one.gain > self.predicted:
            self.ready = None
        self.pending.append(one)

    @property
    def predicted(self) -> float:
        """The largest gain that is predicted, in nats."""
        return max((one.gain for one in self.pending), default=0.0)

    @property
    def is_blind(self) -> bool:
        """True where the largest gain is no prediction."""
        return max(self.pending, key=lambda one: one.gain).blind if self.pending else False

    @property
    def starts(self) -> list[FloatArray]:
        """Points from which a refit may start, those of the most promising prediction first."""
        ranked = sorted(self.pending, key=lambda one: -one.gain)
        return [start for one in ranked for start in one.starts]


@dataclass
class Search:
    """State of a search: its candidates, and how right predictions have been.

    ``ratios`` are achieved over predicted gains, by class; ``spent`` counts refits; ``groups`` are the numbers of
    groups of equal responses, by candidate, as each fit sees them; ``where`` are the places of the graph; ``beside``
    are trials that were refitted elsewhere, formulas, with which candidates are compared.
    """

    entries: list[Entry]
    scored: Scored
    context: Context
    ratios: dict[str, list[float]] = field(default_factory=lambda: {kind: [x] for kind, x in OPTIMISM.items()})
    spent: int = 0
    groups: list[dict[int, int]] = field(default_factory=list)
    where: tuple[Place, ...] = ()
    beside: Sequence[Trial] = ()

    def are_equal(self, j: int, k: int) -> bool:
        """True for two candidates that are in one group wherever both have a response."""
        return all(own[j] == own[k] for own in self.groups if j in own and k in own)

    @property
    def trials(self) -> list[Trial]:
        """All trials, in the order of the entries."""
        return [one.trial for one in self.entries]

    @property
    def best(self) -> Trial | None:
        """The trial that would be chosen now."""
        return choose([*self.trials, *self.beside], self.context.level)

    def bound(self, entry: Entry) -> float:
        """Nats that a refit may gain; of one that was refitted, what an incumbent predicts beyond that."""
        if not entry.pending or entry.trial.failed or entry.decided:
            return 0.0
        if entry.trial.evidence is not None:
            beyond = entry.predicted - entry.trial.gain
            return entry.predicted if beyond > INDIFFERENT else 0.0
        return self.optimism(entry.kind) * entry.predicted

    def optimism(self, kind: str) -> float:
        """The factor on predictions of a class."""
        return float(np.quantile(self.ratios[kind], UPPER))


def searched(search: Search, most: int, report: Report) -> list[Trial]:
    """The trials, those refitted that could be the best, ``most`` of them at most."""
    abreast = _ABREAST if search.context.base.problem.filter_model.is_stiff else 1
    leader = search.best
    while search.spent < most:
        due = _due(search)
        if abreast > 1 and search.best is None:
            due = _raced(search, due)
        due = due[: min(abreast, most - search.spent)]
        if not due:
            break
        report("refit the best candidates", search.spent, most)
        _refit(search, due)
        best = search.best
        if best is not None and best is not leader:
            leader = best
            _renew(search, best)
    report("refit the best candidates", search.spent, search.spent)
    return _grouped(search, leader)


def _raced(search: Search, due: Sequence[int]) -> list[int]:
    """Positions of the candidates that are due, of which the first begin together on the beginnings of long logs.

    What is behind there waits for what leads, which may spare it the rest: a wrong law of a stiff model is searched to
    the end of its ridge else, which took eight times as long as the right one on a vehicle.
    """
    first = list(due[:_RACED])
    for j in first:  # compiled before threads start
        entry = search.entries[j]
        entry.ready = entry.ready or _prepared(entry.trial, _context(search, entry.trial))

    def work(j: int) -> None:
        entry, ready = search.entries[j], search.entries[j].ready
        if isinstance(ready, Prepared):
            entry.ready = _begun(entry, ready, _context(search, entry.trial))

    in_threads(_ABREAST, work, first)
    made = {j: search.entries[j].ready for j in first}
    ends = {j: one.begun.nll for j, one in made.items() if isinstance(one, Prepared) and one.begun is not None}
    if len(ends) < len(first):  # short logs, or one that diverges: its refit tells why
        return list(due)
    best = min(ends.values(), default=0.0)
    return [j for j in sorted(first, key=lambda j: ends[j]) if ends[j] <= best + search.context.required]


def _begun(entry: Entry, ready: Prepared, context: Context) -> Prepared | str:
    def make() -> Prepared | str:
        return begun(ready, entry.trial, entry.starts, context)

    return attempted(make, lambda why: why)


def left_out(search: Search) -> list[str]:
    """Candidates that might have been the best, had there been refits left."""
    return [search.entries[j].trial.candidate.label for j in _due(search)]


def _due(search: Search) -> list[int]:
    """Positions of the candidates whose bound is near the best gain, the best first."""
    best = search.best
    least = max(search.context.required, -np.inf if best is None else best.gain - INDIFFERENT)
    bounds = [search.bound(one) for one in search.entries]
    return sorted((j for j, bound in enumerate(bounds) if bound >= least), key=lambda j: (-bounds[j], j))


def _refit(search: Search, due: Sequence[int]) -> None:
    """Refit some candidates from all that is predicted of them, and learn how right that was."""
    best = search.best
    lead = None if best is None else best.fit
    contexts = [_context(search, search.entries[j].trial) for j in due]
    made = [
        search.entries[j].ready or _prepared(search.entries[j].trial, one) for j, one in zip(due, contexts, strict=True)
    ]
    found: dict[int, Trial] = {}

    def work(k: int) -> None:
        entry, ready = search.entries[due[k]], made[k]
        trial = entry.trial
        if isinstance(ready, str):
            found[due[k]] = failed(trial, ready)
            return
        found[due[k]] = attempted(  # it may diverge wherever it starts
            lambda: looked_closer(
                refit(trial, entry.starts, contexts[k], lead, ready, entry.tried, entry.predicted),
                contexts[k], lead, entry.tried,
            ),
            lambda why: failed(trial, why),
        )  # fmt: skip

    def failed(trial: Trial, why: str) -> Trial:
        return trial if trial.fit is not None else replace(trial, failed=why)

    in_threads(len(due), work, range(len(due)))
    for j in due:  # not in the order in which threads ended
        entry, trial = search.entries[j], found[j]
        predicted, blind, entry.pending, entry.ready = entry.predicted, entry.is_blind, [], None
        search.spent += 1
        before = entry.trial = replace(entry.trial, instead=None)  # a refit has tried what was said of it there
        trial = replace(trial, instead=None)
        if trial.evidence is None or (before.evidence is not None and before.gain >= trial.gain):
            entry.trial = trial if before.evidence is None else before
            continue
        if before.evidence is None and not blind:
            search.ratios[entry.kind].append(max(trial.gain, 0.0) / predicted)
        named = tuple(search.entries[k].trial.candidate.label for k in entry.twins) or trial.stands_for
        entry.trial = replace(trial, stands_for=named)
        for k in entry.twins:
            twin = search.entries[k]
            if twin.trial.fit is None:
                twin.trial, twin.pending = replace(twin.trial, evidence=trial.evidence), []


def _context(search: Search, trial: Trial) -> Context:
    """The context of a refit, whose logs know when an event acts."""
    return search.context if trial.gate is None else context_in_part(trial.candidate, trial.gate, search.context)


def _prepared(trial: Trial, context: Context) -> Prepared | str:
    """The model and the problem of a refit, compiled before threads start, or why there is none.

    Compiling parses Python text, which CPython 3.11 cannot do in two threads at once.
    """

    def make() -> Prepared | str:
        ready = prepared(trial, context)
        if has_numba():
            CompiledFilter.of(ready.problem.filter_model)
            if ready.problem.filter_model.is_stiff:
                compile_exact(ready.problem)
        return ready

    return attempted(make, lambda why: why)


def _renew(search: Search, best: Trial) -> None:
    """Note predictions of the fit with the best candidate in it, for others in its place."""
    if best.gate is not None:  # it is no law, and takes no law's place
        return
    others = _comparable(search, best)
    told = predicted_by_swap(
        best, [search.scored.candidates[j] for j in others], [search.scored.variants[j] for j in others], search.context
    )  # fmt: skip
    for j, one in zip(others, told, strict=True):
        if one is None:
            continue
        entry = search.entries[j]
        entry.trial = replace(entry.trial, instead=(best.candidate.label, best.gain - one.gain))
        if entry.trial is not best:
            entry.predict(one)
    _renew_storages(search, best)
    add_gated(
        search, attempted(lambda: gated_in_place(best, search.scored, search.where, search.context), lambda _: [])
    )


def _renew_storages(search: Search, best: Trial) -> None:
    """Note what the fit with a storage predicts of others at its place, each of which is refitted.

    Their sizes were tried at the fit without them, which may lie far from the truth. A fountain's drive that turned up
    slowly had driven the resistance of its pipe to a bound and the inertia to twice its value: there a limit of the
    rate promised 3 nats of the 893 that it gained from the declared values, and a lag won with 437.
    """
    if not best.candidate.effect.adds_state:
        return
    place = best.candidate.place.label
    for entry in search.entries:
        other = entry.trial
        same = other.candidate.place.label == place and other.candidate.label != best.candidate.label
        if not (same and other.candidate.effect.adds_state and other.gate is None and other.fit is None):
            continue
        told = attempted(lambda one=other: predicted_in_its_place(best, one, search.context), lambda _: None)  # type: ignore[misc]
        if told is not None:
            entry.predict(told)
        if not search.context.base.problem.filter_model.is_stiff:  # else such a fit is costly
            entry.predict(Prediction(best.gain, (), blind=True))


def add_gated(search: Search, found: Sequence[Gated]) -> None:
    """Entries of laws with a regime, or what is predicted of those that the search has."""
    known = {one.trial.candidate.label: one for one in search.entries}
    for one in found:
        own = known.get(one.trial.candidate.label)
        if own is None:
            search.entries.append(Entry(one.trial, [one.prediction], tried=search.context.tried + one.tested))
        elif own.trial.fit is None:
            own.predict(one.prediction)


def _comparable(search: Search, best: Trial) -> list[int]:
    """Candidates that may take the place of the best: each that stands for its equals, and explains something alike."""
    labels = [one.label for one in search.scored.candidates]
    own = labels.index(best.candidate.label) if best.candidate.label in labels else None
    twins = {k for one in search.entries for k in one.twins}
    alike = search.scored.scores.correlation
    return [
        j
        for j in range(len(labels))
        if j not in twins
        and search.entries[j].trial is not best
        and (own is None or abs(float(alike[own, j])) > _STRANGE)
    ]


def _grouped(search: Search, leader: Trial | None) -> list[Trial]:
    """The trials; what is told in the place of another than the best says nothing."""
    label = None if leader is None else leader.candidate.label
    return [
        one if one.instead is None or one.instead[0] == label else replace(one, instead=None) for one in search.trials
    ]
