"""Events: candidates that act in part of one log only, from a time on or until it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bondgraph.correct.constants import CHANCE, INDIFFERENT
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import Candidate, candidates
from bondgraph.correct.scores.gates import Gate, Gated, Peer, best_gated, gated, refined, with_gate
from bondgraph.correct.scores.scoring import Linearisation, Scored
from bondgraph.correct.search.groups import remoteness


@dataclass(frozen=True)
class Event:
    """A candidate that acts in part of one log, not yet refitted: its trial, the candidate it was made of, its step."""

    trial: Trial
    throughout: int
    step: float
    tried: int


def events(linear: Linearisation, known: Scored, context: Context, most: int) -> list[Event]:
    """The best candidates that act in part of the data, if they promise clearly more than those that act throughout.

    ``known`` are scores on the fit that is linearised; of those about as good as the best ``most`` are given.
    """
    best = best_gated(linear, known)
    if best is None:
        return []
    throughout = float(known.scores.gain.max(initial=0.0))
    margin = INDIFFERENT + float(np.log(best.tested / max(len(known.candidates), 1)))  # so many more were tried
    if best.gain < max(throughout + margin, context.required) or best.p_value * best.tested > CHANCE:
        return []
    best = refined(linear, best, known.candidates[best.index], known.variants[best.index])
    made = [_event(best, peer, known, context) for peer in best.peers[:most]]
    return [one for one in made if one is not None]


def _event(best: Gated, peer: Peer, known: Scored, context: Context) -> Event | None:
    """One of the candidates that act in part of the data; None where its graph is refused."""
    index, step = min(peer, key=lambda one: (*remoteness(known.candidates[one[0]], (one[1],)), one[0]))
    step = best.step if index == best.index else step
    made = in_part(known.candidates[index], best.gate, context)
    if made is None:
        return None
    twins = tuple(known.candidates[k].label for k, _ in peer if k != index)
    chance = min(1.0, best.p_value * best.tested)
    trial = Trial(made, best.gain, (step,), score_p=chance, stands_for=twins, gate=best.gate)
    return Event(trial, index, step, best.tested)


def in_part(candidate: Candidate, gate: Gate, context: Context) -> Candidate | None:
    """The candidate made to act in the part of a gate; None where its graph is refused."""
    function = gated(candidate.function, gate, context.train)
    made, _ = candidates(context.built, [function], [candidate.place])
    return made[0] if made else None


def context_in_part(made: Candidate, gate: Gate, context: Context) -> Context:
    """The context with logs that know when a candidate acts."""
    return replace(context, train=with_gate(context.train, made.effect, gate))
