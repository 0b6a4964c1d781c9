"""Which candidates of a stiff model are worth a search of their own: few, that differ in what they would explain."""

from __future__ import annotations

from collections.abc import Sequence

from bondgraph.correct.refits.refit import WORTH, Ground, alike, worth_quiet
from bondgraph.correct.refits.trials import Trial
from bondgraph.correct.scores.score import Scores
from bondgraph.declare.effect import Effect

#: Responses more alike than this explain much the same.
_ALIKE = 0.9
#: So many of those that are best with little process noise are searched, and one that switches.
_MOST_QUIET = 2
#: By how much the score of a law that switches may be too small: of dry friction of a vehicle's sheave sevenfold.
_UNDERRATED = 7.0


def attainable(promise: float, effect: Effect) -> float:
    """What an effect may gain, in nats, whose score promises so many: scores underrate what is large."""
    return promise * (_UNDERRATED if effect.amplitudes else 1.0 / WORTH)


def varied(trials: Sequence[Trial], found: Scores, ground: Ground) -> list[list[int]]:
    """Groups that differ in what they would explain, the best first; see :func:`bondgraph.correct.refits.refit.alike`.

    Of responses that are much alike one smooth law is taken, of the fewest parameters, and one that switches: for a
    search each stands for the others, which may be exchanged for it afterwards.
    """
    clusters: list[list[list[int]]] = []
    for group in alike(trials, found, 0.5 * ground.need):
        near = (c for c in clusters if abs(found.correlation[c[0][0], group[0]]) > _ALIKE)
        cluster = next(near, None)
        if cluster is not None:
            cluster.append(group)
        else:
            clusters.append([group])
    best = max((trials[cluster[0][0]].score_gain for cluster in clusters), default=0.0)
    kept: list[list[int]] = []
    for cluster in clusters:
        for switches, least in ((False, WORTH * best), (True, WORTH * best / _UNDERRATED)):
            own = [
                group
                for group in cluster
                if bool(trials[group[0]].candidate.effect.amplitudes) is switches
                and trials[group[0]].score_gain >= least
            ]
            kept += sorted(own, key=lambda group: len(trials[group[0]].candidate.effect.parameters))[:1]
    return kept


def picked_quiet(trials: Sequence[Trial], found: Scores, ground: Ground) -> list[list[int]]:
    """Groups of candidates without a refit that are best with little process noise, and the best one that switches.

    Scores underrate what switches there too: dry friction of a vehicle's sheave had 122 nats where a constant force had
    195, and gained 963 where that gained less than a sensor that comes late, 257.
    """
    unknown = [
        group
        for group in alike(trials, found, WORTH * worth_quiet(found, ground.need))
        if all(trials[j].fit is None for j in group)
    ]
    least = worth_quiet(found, ground.need)
    best = [group for group in unknown if found.gain[group[0]] >= least][:_MOST_QUIET]
    switching = [group for group in unknown if trials[group[0]].candidate.effect.amplitudes]
    return best + [group for group in switching[:1] if group not in best]


def simpler_law(leader: int, done: Sequence[Trial], found: Scores, ground: Ground) -> int | None:
    """The best by its score of the laws at the leader's place that need fewer parameters; None where there is none.

    Of a law that is another with a further term both promise the same, and which of them it is takes both refits.
    """
    best = done[leader].candidate
    rivals = [
        j
        for j, trial in enumerate(done)
        if trial.candidate.place.label == best.place.label
        and len(trial.candidate.effect.parameters) < len(best.effect.parameters)
        and found.gain[j] > 0.5 * ground.need
    ]
    if any(done[j].evidence is not None for j in rivals):
        return None
    return max(rivals, key=lambda j: float(found.gain[j]), default=None)
