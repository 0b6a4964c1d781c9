"""Values of the decisions: candidates with their scores and refits, what speaks for them, what could have been seen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from bondgraph.build import BuiltModel
from bondgraph.correct.evidence.transfer import Transfer
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.scores.gates import Gate
from bondgraph.estimate.fitted import Fit
from bondgraph.text import number


@dataclass(frozen=True)
class Evidence:
    """What speaks for one refitted candidate.

    ``delta_nll``: gain of log-likelihood in nats; ``p_value`` and ``p_robust``: of the likelihood ratio and of the
    coefficient with block-sandwich variance, both times the number tried; ``bic_gain``: gain after the penalty, nats.
    """

    delta_nll: float
    p_value: float
    p_robust: float
    bic_gain: float
    tried: int

    def accepted(self, level: float) -> bool:
        """Whether all three hurdles are passed."""
        return self.p_value < level and self.p_robust < level and self.bic_gain > 0.0


@dataclass(frozen=True, repr=False)
class Trial:
    """A candidate with its score, and its refit if it came that far.

    ``score_p`` is the p-value of the score, corrected for the number of candidates. ``stands_for`` names the candidates
    whose response is the same to rounding, of which this one was refitted. ``gate``: it acts in part of the data only.
    ``transfer``: how it predicts data that it was not estimated from, known of what would be chosen.
    ``instead``: another that was refitted, and how many nats less this one would gain in its place, told there.
    ``simplifies``: the law of more coefficients whose place it took at the end, if it did. ``rivals``: laws that do as
    well in its place beside what was found after it. ``words_for``: the law that a formula says in other words.
    ``small``: how little it moves the sensors, where that is too little for a name. ``given``: the given constants that
    explain as much, with the values they would have, if there are any.
    ``remark``: sizes that were left out, if any. ``failed``: why its score, its refit or a second look at that could
    not be made, if so; it cannot be chosen on what is missing then.
    """

    candidate: Candidate
    score_gain: float
    step: tuple[float, ...] = ()
    built: BuiltModel | None = None
    fit: Fit | None = None
    evidence: Evidence | None = None
    score_p: float = 1.0
    stands_for: tuple[str, ...] = ()
    gate: Gate | None = None
    instead: tuple[str, float] | None = None
    remark: str = ""
    failed: str = ""
    transfer: Transfer | None = None
    forms: tuple[Trial, ...] = ()
    completes: str = ""
    simplifies: str = ""
    words_for: str = ""
    rivals: tuple[str, ...] = ()
    small: str = ""
    given: str = ""

    @property
    def transfers(self) -> bool:
        """Whether nothing is known against its transfer to data that it was not estimated from."""
        return self.transfer is None or self.transfer.passes

    def __repr__(self) -> str:
        how = "scored" if self.evidence is None else "refitted"
        return f"<Trial {self.candidate.label}: {how}, gain {number(self.gain)} nats, p = {number(self.p_value)}>"

    @property
    def gain(self) -> float:
        """Likelihood gain in nats: of the refit, else as the score predicts it."""
        return self.score_gain if self.evidence is None else self.evidence.delta_nll

    @property
    def p_value(self) -> float:
        """The larger of both p-values of the refit, else that of the score; corrected for the number tried."""
        return self.score_p if self.evidence is None else max(self.evidence.p_value, self.evidence.p_robust)

    def attempted(self, action: Callable[[], Trial]) -> Trial:
        """The trial that an action makes of this one, or this one with the reason why that could not be done."""
        return attempted(action, lambda why: replace(self, failed=why))


@dataclass(frozen=True)
class Alternative:
    """A candidate that was not chosen, and why; of one that the data do not tell from the chosen, what would."""

    name: str
    junction: str
    delta_nll: float
    indistinguishable: bool
    why: str
    separate: str = ""


@dataclass(frozen=True)
class Detectable:
    """How large a missing effect must be to be found with logs such as these.

    At ``size`` of its coefficient it is found about nine times in ten, with the same excitation and noise. ``size`` is
    infinite where free parameters take all of its response (``taken``), or where it would have to be larger than all
    else at its place.
    """

    effect: str
    junction: str
    coefficient: str
    size: float
    unit: str
    taken: bool = False


@dataclass(frozen=True)
class Added:
    """An effect that was added, its coefficients estimated anew, and the law whose form it ``completes``, if one."""

    trial: Trial
    coefficients: tuple[str, ...]
    completes: str = ""
    simplifies: str = ""

    @classmethod
    def of(cls, trial: Trial, completes: Mapping[str, str]) -> Added:
        """The effect of a trial; ``completes`` are labels of laws by those that complete them."""
        return cls(trial, trial.candidate.effect.parameters, completes.get(trial.candidate.label, ""))
