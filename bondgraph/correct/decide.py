"""Decisions: which candidate, if any, the training logs ask for, and which others they cannot tell from it.

A candidate must pass three hurdles, all corrected for the number of candidates tried (Bonferroni): the likelihood ratio
test; a test of its coefficient with the block-sandwich variance, which coloured noise does not deceive; and the Bayesian
information criterion. Held-out logs take no part.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from bondgraph.correct.build import BuiltModel
from bondgraph.correct.candidates import Candidate
from bondgraph.correct.fit import Fit, time_blocks
from bondgraph.correct.score import Scores, robust_variance
from bondgraph.data.log import MatchedLog

#: Blocks of the sandwich variance over all training logs: enough for its distribution, long enough to be independent.
_BLOCKS = 40
#: Candidates whose likelihoods differ by less than this many nats are not told apart by the data.
CLOSE = 3.0
#: Responses correlated above this, free parameters projected out, are the same to these sensors.
ALIKE = 0.99


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


@dataclass(frozen=True)
class Trial:
    """A candidate with its score, and its refit if it came that far."""

    candidate: Candidate
    score_gain: float
    step: float
    built: BuiltModel | None = None
    fit: Fit | None = None
    evidence: Evidence | None = None

    @property
    def gain(self) -> float:
        """Likelihood gain in nats: of the refit, else as the score predicts it."""
        return self.score_gain if self.evidence is None else self.evidence.delta_nll


@dataclass(frozen=True)
class Alternative:
    """A candidate that was not chosen, and why."""

    name: str
    junction: str
    delta_nll: float
    indistinguishable: bool
    why: str


def judge(base: Fit, refit: Fit, coefficients: Sequence[str], tried: int) -> Evidence:
    """Evidence of a refit against the fit without the candidate's coefficients."""
    gain = base.nll - refit.nll
    count = len(coefficients)
    measured = int(sum(np.isfinite(log.y).sum() for log in refit.problem.logs))
    ratio = float(stats.chi2.sf(2.0 * max(gain, 0.0), count))
    total = sum(float(log.time[-1] - log.time[0]) for log in refit.problem.logs)
    blocks = time_blocks(refit.problem, max(total / _BLOCKS, 1e-9))
    variance = robust_variance(refit.expansion, blocks)
    robust = 1.0
    for name in coefficients:
        index = refit.problem.names.index(name)
        value = float(refit.problem.values(refit.point)[index])
        std = math.sqrt(max(variance[index, index], 0.0))
        distance = abs(value) / std if std > 0.0 else 0.0
        robust = min(robust, 2.0 * float(stats.t.sf(distance, max(int(blocks.max()), 2))))
    penalty = 0.5 * count * math.log(max(measured, 2)) + math.log(max(tried, 1))
    return Evidence(gain, min(1.0, ratio * tried), min(1.0, robust * tried), gain - penalty, tried)


def hurdle(logs: Sequence[MatchedLog], tried: int, level: float) -> float:
    """The likelihood gain in nats that one coefficient needs to pass the ratio test and the information criterion."""
    measured = sum(int(np.isfinite(log.y).sum()) for log in logs)
    ratio = 0.5 * float(stats.chi2.isf(level / max(tried, 1), 1))
    return max(ratio, 0.5 * math.log(max(measured, 2)) + math.log(max(tried, 1)))


def choose(trials: Sequence[Trial], level: float) -> Trial | None:
    """The refitted candidate with the largest penalised gain among those that pass, or None."""
    passed = [trial for trial in trials if trial.evidence is not None and trial.evidence.accepted(level)]
    return max(passed, key=lambda trial: trial.evidence.bic_gain, default=None)  # type: ignore[union-attr]


def alternatives(
    chosen: Trial | None, trials: Sequence[Trial], found: Scores, level: float, most: int = 12
) -> list[Alternative]:
    """The other candidates, best first, each with the reason it was not chosen."""
    ranked = sorted((t for t in trials if t is not chosen), key=lambda t: -t.gain)
    order = {trial.candidate.label: index for index, trial in enumerate(trials)}
    listed = []
    for trial in ranked:
        close, why = _why_not(chosen, trial, found, order, level)
        if close or len(listed) < most:
            place = trial.candidate.place.label
            listed.append(Alternative(trial.candidate.effect.name, place, trial.gain, close, why))
    return listed


def _why_not(
    chosen: Trial | None, trial: Trial, found: Scores, order: dict[str, int], level: float
) -> tuple[bool, str]:
    if chosen is None:
        if trial.evidence is None:
            return False, f"its score promises {trial.score_gain:.1f} nats, too little to be refitted"
        return False, f"p = {max(trial.evidence.p_value, trial.evidence.p_robust):.2g}, above {level:g}"
    a, b = order[chosen.candidate.label], order[trial.candidate.label]
    size = found.correlation.shape[0]
    alike = abs(float(found.correlation[a, b])) if a < size and b < size else 0.0
    if alike > ALIKE:
        return True, f"its response is the same to these sensors (correlation {alike:.4f})"
    short = chosen.gain - trial.gain
    if trial.evidence is not None and abs(short) < CLOSE:
        return True, f"its likelihood is within {abs(short):.1f} nats, which these data do not tell apart"
    kind = "refitted, it gains" if trial.evidence is not None else "its score promises"
    return False, f"{kind} {short:.1f} nats less than {chosen.candidate.label}"
