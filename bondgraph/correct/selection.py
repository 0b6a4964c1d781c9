"""The selection of a round: second looks at what would be chosen, and the search again behind what they strike out.

A search compares candidates with the best that it has refitted. Costlier looks come after it: shorter steps, transfer,
other bounds. Where they strike the best out, the others were compared with no answer, and the search goes on. Of a
crank an eccentric sensor led with 1137 nats and was struck out; the crank's ratio, which gains 10400, had never been
refitted.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from bondgraph.correct.evidence.bounds import beyond_bounds
from bondgraph.correct.evidence.confirm import confirmed, transferred
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import choose
from bondgraph.correct.evidence.given import beside_given
from bondgraph.correct.evidence.noise_split import split_again
from bondgraph.correct.evidence.resolved import resolved
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.gate_worth import earned, in_its_signal
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.search.search import Search, left_out, searched
from bondgraph.correct.search.widths import at_any_width, is_due
from bondgraph.correct.shapes.offered import Residual
from bondgraph.correct.shapes.relatives import with_relatives
from bondgraph.correct.small_rests import weighed
from bondgraph.estimate.local import Report


@dataclass
class Selection:
    """The trials of a round, those of its search first, and what second looks have found out.

    ``left`` is the residual, with the laws that the model has beside its declaration: what is small beside them is not
    chosen. A second look may find a better fit without any candidate. Then all gains fall by as much, ``lost`` nats in
    all: candidates that are compared must be judged against the same fit.
    """

    search: Search
    trials: list[Trial]
    left: Residual
    report: Report
    lost: float = 0.0
    _looked: set[int] = field(default_factory=set)
    _weighed: set[int] = field(default_factory=set)
    _widened: set[int] = field(default_factory=set)
    _gated: set[int] = field(default_factory=set)
    _entries: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._entries = list(range(len(self.search.entries)))

    @property
    def _context(self) -> Context:
        return self.search.context

    def chosen(self, most: int) -> Trial | None:
        """The trial that stays the best after second looks, or None; ``trials`` are all of them as they are then.

        ``most`` are the refits of the search at most; relatives of what leads are refitted beside them.
        """
        while True:
            self.trials = with_relatives(self.trials, self.left, self._context, self.report)
            best = self.looked_at()
            if not self._searched_on(most):
                return best

    def looked_at(self) -> Trial | None:
        """The trial that stays the best of those that were refitted, after a second look at each that would be."""
        while (best := choose(self.trials, self._context.level)) is not None:
            index = next(k for k, trial in enumerate(self.trials) if trial is best)
            if index in self._looked:
                break
            if index not in self._weighed:
                self._weighed.add(index)
                self.trials[index] = weighed(best, self.left.laws, self._context.base)
            elif index not in self._widened and is_due(best, self.trials, self._context):
                self._widened.add(index)
                self._widen(best)
            elif best.candidate.effect.regime and index not in self._gated:
                self._gated.add(index)
                self._earn(index)
            else:
                self._looked.add(index)
                self._look_again(index)
        return best

    def _widen(self, best: Trial) -> None:
        """Free the widths of what would be chosen, and of what may take its place."""
        self.report(f"free the width of {best.candidate.label}", 0, 1)
        freed = at_any_width(best, self.trials, self._context)
        self.trials = [
            new if new.fit is old.fit else _less(new, self.lost) for old, new in zip(self.trials, freed, strict=True)
        ]

    def _earn(self, index: int) -> None:
        """Test the gate of a trial; where these tests fail it is not chosen, and a term in its signal is tried."""
        best, trials, where, context = self.trials[index], self.trials, self.search.where, self._context
        gated = attempted(lambda: earned(best, trials, where, context), lambda why: _doubted(best, why))
        trials[index] = gated
        if gated.evidence is None or gated.evidence.accepted(context.level):
            return
        told = attempted(lambda: in_its_signal(gated, where, context), lambda why: None)
        if told is not None and all(one.candidate.label != told.candidate.label for one in trials):
            trials.append(told)

    def _look_again(self, index: int) -> None:
        """Look again at a trial that would be chosen, its noise, steps and transfer; its losses are those of all."""
        best, context, lost = self.trials[index], self._context, self.lost
        self.report(f"look again at {best.candidate.label}", 0, 1)
        sure, further = attempted(lambda: _looked_at(best, context, lost), lambda why: (_doubted(best, why), 0.0))
        self.report(f"look again at {best.candidate.label}", 1, 1)
        self.trials, self.lost = [_less(trial, further) for trial in self.trials], lost + further
        for k, trial in enumerate(self.trials):
            if trial.candidate.label in sure.stands_for and trial.gate == sure.gate and trial.fit is None:
                self.trials[k] = replace(trial, evidence=sure.evidence, transfer=sure.transfer)
        self.trials[index] = sure

    def _searched_on(self, most: int) -> bool:
        """Search on where something may be the best now; True where anything was refitted."""
        search = self.search
        known, decided = set(self._entries), self._looked | self._gated
        for entry, at in zip(search.entries, self._entries, strict=True):
            entry.trial, entry.decided = self.trials[at], at in decided
        search.beside = [one for k, one in enumerate(self.trials) if k not in known]
        if search.spent >= most or not left_out(search):
            return False
        before = search.trials
        after = searched(search, most, self.report)
        for at, old, new in zip(self._entries, before, after, strict=False):
            self.trials[at] = new if new.evidence is old.evidence else _less(new, self.lost)
        for new in after[len(before) :]:  # laws with a regime that the search has added
            self._entries.append(len(self.trials))
            self.trials.append(_less(new, self.lost))
        return True


def _less(trial: Trial, nats: float) -> Trial:
    """The trial with so much less gain."""
    known = trial.evidence
    if known is None or not nats:
        return trial
    return replace(
        trial, evidence=replace(known, delta_nll=known.delta_nll - nats, bic_gain=known.bic_gain - nats)
    )  # fmt: skip


def _doubted(trial: Trial, why: str) -> Trial:
    """A trial of which a look failed, and why: it is not chosen."""
    assert trial.evidence is not None  # it would be chosen
    return replace(trial, evidence=replace(trial.evidence, p_robust=1.0), failed=why)


def _looked_at(best: Trial, context: Context, lost: float) -> tuple[Trial, float]:
    """The trial after costlier looks, as long as it passes, and the nats that all gains lose by them.

    Its noise is split anew first, and its steps resolve it.
    """
    sure, further = resolved(split_again(best, context), context), 0.0
    sure = sure if sure is best else _less(sure, lost)
    for look_again in (confirmed, transferred, beyond_bounds, beside_given):
        before = sure.evidence
        if before is None or not before.accepted(context.level):
            break
        sure = look_again(sure, context)
        if sure.evidence is not None and sure.evidence.delta_nll > before.delta_nll:  # another look found a better fit
            sure = _less(sure, sure.evidence.delta_nll - before.delta_nll)
        elif sure.evidence is not None:
            further += before.delta_nll - sure.evidence.delta_nll
    return sure, further
