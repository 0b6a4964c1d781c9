"""Events: effects that act in part of one log, and whether a coefficient changes within one.

Logs are independent of each other: nobody knows what happened between two of them, so that an event ends with the log
in which it happens. A coefficient that is the same throughout a log has scores whose running sum is a Brownian bridge;
its largest weighted square tells whether it changed, without a guess when. Reference: Andrews (1993), Econometrica
61(4), for the test and its distribution; Hansen (1997), J. Business Econ. Statist. 15(1).

A gated candidate is a candidate whose coefficients are multiplied by a switch of time, which one log has inside it and
no other ever reaches.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from bondgraph.correct.fits.times import summed
from bondgraph.correct.models.candidates import Candidate, Variant
from bondgraph.correct.scores.score import SAME, Projected, best_step, score_pieces, solve
from bondgraph.correct.scores.scoring import Linearisation, Scored, candidate_change
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.declare.editing import share_effort
from bondgraph.declare.effect import Effect, EffectFunction, Place
from bondgraph.declare.elements import STORAGES
from bondgraph.declare.functions import switch
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import replace_symbols
from bondgraph.estimate.fitted import Fit, restricted
from bondgraph.execute.threads import available_cores, in_threads
from bondgraph.filter.linear.recursion import decay

When = Literal["from", "until"]

#: A change is looked for where at least this share of the information lies on either side.
_TRIM = 0.1
#: Blocks of time into which a log is cut, and fewest that tell of a change: ten sums of four.
_BLOCKS, _FEWEST = 160, 40
#: A coefficient with less than this share of its size elsewhere may be absent there.
_ABSENT = 0.4
#: Gates that are tried, evenly over all training time.
_GATES = 14
#: Switching times that are tried between neighbouring gates once a gated candidate stands out.
_FINER = 30
#: Candidates with this share of the best one's gain, less so many nats, are about as good with the same gate; so many
#: of them count, those of one response but for rounding together.
_NEAR, _CLOSE, _MOST_PEERS = 0.9, 6.0, 4
#: Candidates of the same response, each with its step.
Peer = tuple[tuple[int, float], ...]
#: Far away in time, s: an effect that is off throughout a log.
_FAR = 1e6


@dataclass(frozen=True)
class Gate:
    """A point in time, as log and seconds in it; ``when``: in this log the effect acts from it, or until it."""

    when: When
    log: str
    time: float

    def __str__(self) -> str:
        return f"{self.when} {self.time:.4g} s of {self.log}"

    def times(self, logs: Sequence[MatchedLog]) -> dict[str, float]:
        """The switching time as each log sees it, by name of the log; in others than its own nothing acts."""
        return {log.name: self.time if log.name == self.log else self.never for log in logs}

    @property
    def never(self) -> float:
        """A switching time with which nothing acts in a log, s."""
        return _FAR if self.when == "from" else -_FAR

    def acts(self, time: FloatArray, log: str, logs: Sequence[MatchedLog]) -> FloatArray:
        """One where the effect acts at times of a log, zero where it does not."""
        past = time > self.times(logs)[log]
        return np.where(past if self.when == "from" else ~past, 1.0, 0.0)


def gated(function: EffectFunction, gate: Gate, logs: Sequence[MatchedLog]) -> EffectFunction:
    """The effect function whose effect acts from or until a time; the time is a parameter that each log knows."""
    width = 0.5 * float(np.median(np.diff(logs[0].time)))
    only = gate.time if len(logs) == 1 else gate.never

    def extended(g: BondGraph, at: Place) -> Effect | None:
        declared = set(g.nodes)
        effect = function(g, at)
        if effect is None or effect.adds_state:
            return None
        own = g.parameter(gate_name(effect), only, "s", f"time {gate.when} which {effect.element} acts")
        soft = g.parameter(f"width_{gate_name(effect)}", width, "s", "time in which it changes over")
        past = switch(symbol("t") - own, soft)
        on = past if gate.when == "from" else 1 - past
        if effect.element in g.nodes and g.nodes[effect.element].kind in STORAGES and effect.element not in declared:
            share_effort(g, effect.element, on)
        else:
            replace_symbols(g, {name: symbol(name) * on for name in effect.coefficients})
        return replace(effect, law=f"{effect.law}, {gate.when} {gate.time:.4g} s of {gate.log}")

    extended.__name__ = function.__name__
    extended.__dict__.update(function.__dict__)
    return extended


def gate_name(effect: Effect) -> str:
    """The parameter that holds the switching time of an effect."""
    return f"switch_{effect.coefficients[0]}"


def with_gate(logs: Sequence[MatchedLog], effect: Effect, gate: Gate) -> tuple[MatchedLog, ...]:
    """The logs, each knowing when the effect switches."""
    times = gate.times(logs)
    return tuple(
        replace(log, theta_overrides={**log.theta_overrides, gate_name(effect): times[log.name]}) for log in logs
    )


def gates(logs: Sequence[MatchedLog]) -> tuple[tuple[str, float], ...]:
    """Evenly spaced points over the time of all logs."""
    lengths = np.array([log.time[-1] - log.time[0] for log in logs])
    ends = np.cumsum(lengths)
    found = []
    for share in np.linspace(0.0, 1.0, _GATES + 2)[1:-1]:
        at = share * ends[-1]
        k = int(np.searchsorted(ends, at, side="right"))
        start = ends[k] - lengths[k]
        found.append((logs[k].name, float(logs[k].time[0] + at - start)))
    return tuple(found)


@dataclass(frozen=True)
class Constancy:
    """Whether a coefficient is the same throughout: the p-value, and where it most likely changes.

    ``before`` and ``after`` are what the scores say that its coordinate is on either side of that.
    """

    p_value: float
    log: str
    time: float
    before: float = 0.0
    after: float = 0.0

    @property
    def switches(self) -> bool:
        """Whether the coefficient could be zero on one side: small beside the other, or of the other sign."""
        small, large = sorted((self.before, self.after), key=abs)
        return small / large < _ABSENT if large != 0.0 else False


def constancy(fitted: Fit, coefficient: str) -> Constancy:
    """The largest weighted square of the running sums of scores of a fitted coefficient within logs.

    Everything else is taken out. Logs that are too short to be cut into blocks of time tell nothing of it; the p-value
    counts all that do.
    """
    logs = fitted.problem.logs
    sums, told = _by_block(fitted, coefficient)
    value = float(fitted.point[fitted.problem.names.index(coefficient)])
    found = [_changes(log, value, *part) for log, *part in zip(logs, sums, told, strict=True)]
    known = [one for one in found if one is not None]
    if not known:
        return Constancy(1.0, logs[0].name, float(logs[0].time[0]))
    best = min(known, key=lambda one: one.p_value)
    return replace(best, p_value=min(1.0, best.p_value * len(known)))


def _by_block(fitted: Fit, coefficient: str) -> tuple[list[FloatArray], list[FloatArray]]:
    """Scores of a coefficient summed over the blocks of each log, and what these tell of it; all else taken out."""
    free = ~fitted.held
    index = int(np.flatnonzero(np.flatnonzero(free) == fitted.problem.names.index(coefficient))[0])
    expansion = restricted(fitted.expansion, free)
    others = [k for k in range(int(free.sum())) if k != index]
    follow = solve(expansion.information[np.ix_(others, others)], expansion.information[others, index][:, np.newaxis])
    blocks, counts = _fine_blocks(fitted)
    timed, total = blocks >= 0, sum(counts)
    pieces = summed(score_pieces(expansion)[timed], blocks[timed], total)
    assert expansion.terms is not None
    slope = expansion.terms.innovations[:, 1 + index] - expansion.terms.innovations[:, 1:][:, others] @ follow[:, 0]
    told = np.bincount(blocks[timed], weights=slope[timed] ** 2, minlength=total)
    edges = np.cumsum(counts)[:-1]
    return np.split(pieces[:, index] - pieces[:, others] @ follow[:, 0], edges), np.split(told, edges)


def _changes(log: MatchedLog, value: float, sums: FloatArray, told: FloatArray) -> Constancy | None:
    """Whether and where a coefficient changes within a log, by its scores and what they tell in blocks of time."""
    whole = float(told.sum())
    share = np.cumsum(told) / max(whole, np.finfo(float).tiny)
    inside = np.flatnonzero((share > _TRIM) & (share < 1.0 - _TRIM))
    if sums.size < _FEWEST or not inside.size:
        return None
    left = sums - sums.sum() * told / whole
    statistic = np.cumsum(left)[inside] ** 2 / (_long_run(left) * share[inside] * (1.0 - share[inside]))
    best = int(np.argmax(statistic))
    at = int(inside[best])
    time = float(log.time[0] + (at + 1) * (log.time[-1] - log.time[0]) / sums.size)
    early, late = (float(part.sum()) for part in (told[: at + 1], told[at + 1 :]))
    before, after = value - float(sums[: at + 1].sum()) / early, value - float(sums[at + 1 :].sum()) / late
    return Constancy(_andrews(float(statistic[best])), log.name, time, before, after)


def _long_run(sums: FloatArray) -> float:
    """Sum of squares of neighbouring blocks taken by fours: the scatter that a running sum has under coloured noise."""
    by_four = np.add.reduceat(sums, np.arange(0, sums.size, 4))
    return float(max(np.sum(by_four**2), np.finfo(float).tiny))


def _fine_blocks(fitted: Fit) -> tuple[np.ndarray, list[int]]:
    """The block of time of each term, of which priors have none (-1), and how many there are in each log."""
    pieces: list[np.ndarray] = []
    counts: list[int] = []
    for log in fitted.problem.logs:
        count = min(_BLOCKS, log.time.size // 2)
        share = (log.time - log.time[0]) / (log.time[-1] - log.time[0])
        pieces += [sum(counts) + np.minimum((share * count).astype(np.int64), count - 1)] * log.y.shape[0]
        counts.append(count)
    priors = sum(parameter.prior_mean is not None for parameter in fitted.problem.free)
    return np.concatenate([*pieces, np.full(priors, -1)]), counts


@functools.cache
def _bridges() -> FloatArray:
    """The statistic's distribution when nothing changes, by simulated Brownian bridges; sorted."""
    rng = np.random.default_rng(7)
    share = np.linspace(0.0, 1.0, 161)[1:]
    walks = np.cumsum(rng.standard_normal((20000, share.size)), axis=1) / np.sqrt(share.size)
    bridges = walks - walks[:, -1:] * share
    inside = (share > _TRIM) & (share < 1.0 - _TRIM)
    found: FloatArray = np.sort((bridges[:, inside] ** 2 / (share * (1.0 - share))[inside]).max(axis=1))
    return found


def _andrews(statistic: float) -> float:
    """P-value of the largest weighted square; beyond the simulated range the tail falls as that of a chi-square."""
    known = _bridges()
    above = float(np.mean(known >= statistic))
    if above > 2e-3:
        return above
    edge = float(known[int(0.998 * known.size)])
    return 2e-3 * float(np.exp(-0.5 * (statistic - edge)))


@dataclass(frozen=True)
class Gated:
    """The gated candidate that scores best: which, when, its gain in nats, its step, and how many were tried.

    ``peers``: the candidates that score about as well with the same gate, those of the same response together.
    """

    index: int
    gate: Gate
    gain: float
    step: float
    p_value: float
    tested: int
    peers: tuple[Peer, ...] = ()


def gate_samples(logs: Sequence[MatchedLog]) -> list[list[int]]:
    """The samples of each log just before the gates that lie in it."""
    found: list[list[int]] = [[] for _ in logs]
    names = [log.name for log in logs]
    for name, time in gates(logs):
        k = names.index(name)
        found[k].append(int(np.searchsorted(logs[k].time, time)) - 1)
    return found


def best_gated(linear: Linearisation, scored: Scored) -> Gated | None:
    """Score all candidates of one coefficient as acting from, or until, each of some times.

    ``scored`` must hold the states at the samples of :func:`gate_samples`.
    """
    found = scored.candidates
    usable = [j for j, one in enumerate(found) if len(one.effect.parameters) == 1 and not one.effect.channel]
    if not usable:
        return None
    logs = [log.path.log for log in linear.logs]
    whole = np.concatenate([scored.columns[j] for j in usable], axis=1)
    one_sided = np.array([found[j].lower[0] >= 0.0 for j in usable])
    points = gates(logs)
    gains: dict[tuple[int, When], FloatArray] = {}

    def act(number: int) -> None:
        after = _after(linear, whole, scored, usable, number)
        before = _within(linear, whole, points[number][0]) - after
        responses: tuple[tuple[When, FloatArray], ...] = (("from", after), ("until", before))
        for when, response in responses:
            score, told = linear.each_alone(response)
            gain = 0.5 * score**2 / np.where(told > 0.0, told, np.inf)
            gain[one_sided & (score < 0.0)] = 0.0
            gains[number, when] = gain

    in_threads(available_cores(), act, range(len(points)))
    tops = {key: _simplest(gain, [found[j] for j in usable]) for key, gain in gains.items()}
    number, when = max(sorted(gains), key=lambda key: gains[key][tops[key]])
    gate, gain, top = Gate(when, *points[number]), gains[number, when], tops[number, when]
    after = _after(linear, whole, scored, usable, number)
    projected = linear.projected(after if when == "from" else _within(linear, whole, gate.log) - after)
    step, own, p_value = best_step(projected, [top], one_sided[[top]])
    near = _peers(projected, gain, top, usable, found)
    return Gated(usable[top], gate, own, float(step[0]), p_value, 2 * len(points) * len(usable), near)


def _peers(
    projected: Projected, gain: FloatArray, top: int, usable: Sequence[int], found: Sequence[Candidate]
) -> tuple[Peer, ...]:
    """Candidates nearly as good as the best, those of one response together; the best of each place before others.

    Where a law acts is told less by scores than which of them acts there is told by a refit.
    """
    told = np.diag(projected.information)
    size = np.sqrt(np.where(projected.seen & (told > 0.0), told, 1.0))  # what is not seen gains nothing either
    alike = projected.information / np.outer(size, size)
    near = [int(k) for k in np.argsort(-gain, kind="stable") if gain[k] >= _NEAR * gain[top] - _CLOSE and k != top]
    groups: list[list[int]] = [[top]]
    for k in near:
        group = next((group for group in groups if abs(alike[group[0], k]) > SAME), None)
        if group is None:
            groups.append([k])
        else:
            group.append(k)
    first, further, seen = list[list[int]](), list[list[int]](), set[str]()
    for group in groups:
        own = {found[usable[k]].place.label for k in group}
        (further if own & seen else first).append(group)
        seen |= own
    steps = projected.score / size**2
    return tuple(tuple((usable[k], float(steps[k])) for k in group) for group in (first + further)[:_MOST_PEERS])


def _simplest(gain: FloatArray, candidates: Sequence[Candidate]) -> int:
    """Of the candidates that score within a nat of the best, one without a memory of its own, the first of them."""
    near = [int(j) for j in np.flatnonzero(gain >= gain.max() - 1.0)]
    return min(near, key=lambda j: (len(candidates[j].model.states), j))


def refined(linear: Linearisation, best: Gated, candidate: Candidate, variant: Variant) -> Gated:
    """The same gated candidate with its switching time found anew between the neighbouring gates."""
    logs = [log.path.log for log in linear.logs]
    names = [log.name for log in logs]
    own = names.index(best.gate.log)
    total = sum(float(log.time[-1] - log.time[0]) for log in logs)
    reach = total / (_GATES + 1)
    time = logs[own].time
    inside = np.flatnonzero(np.abs(time - best.gate.time) < reach)
    inside = inside[(inside > 0) & (inside < time.size - 1)]
    samples = [int(k) for k in inside[:: max(1, inside.size // _FINER)]]
    changes = [candidate_change(log.path, candidate, variant) for log in linear.logs]
    whole, states = linear.columns_and_states(changes, [samples if k == own else () for k in range(len(logs))])
    whole = _within(linear, whole, best.gate.log)
    for place, sample in enumerate(samples):
        after = _tail(linear, whole, own, sample, states[own][place])
        response = after if best.gate.when == "from" else whole - after
        step, gain, p_value = best_step(linear.projected(response), [0], candidate.lower >= 0.0)
        if gain > best.gain:
            gate = Gate(best.gate.when, best.gate.log, float(time[sample + 1]))
            best = replace(best, gate=gate, gain=gain, step=float(step[0]), p_value=p_value)
    return best


def _rows(linear: Linearisation, own: int) -> slice:
    """Where the terms of a log stand among those of all."""
    first, end = (sum(log.slope.shape[0] * log.slope.shape[1] for log in linear.logs[:k]) for k in (own, own + 1))
    return slice(first, end)


def _within(linear: Linearisation, whole: FloatArray, log: str) -> FloatArray:
    """Responses of changes that act in one log only."""
    rows = _rows(linear, [one.path.log.name for one in linear.logs].index(log))
    found = np.zeros_like(whole)
    found[rows] = whole[rows]
    return found


def _tail(linear: Linearisation, whole: FloatArray, own: int, sample: int, state: FloatArray) -> FloatArray:
    """Responses of changes that act only after a sample of one log, in that log."""
    log, rows = linear.logs[own], _rows(linear, own)
    outputs, count = log.slope.shape[1], log.slope.shape[0]
    late = np.tile(np.arange(count) > sample, outputs)
    after = np.zeros_like(whole)
    after[rows] = np.where(late[:, np.newaxis], whole[rows] - decay(log, sample) @ state, 0.0)
    return after


def _after(linear: Linearisation, whole: FloatArray, scored: Scored, usable: Sequence[int], number: int) -> FloatArray:
    """Responses of candidates that act from a gate on: what they do from then on, less what went before it leaves."""
    samples = gate_samples([log.path.log for log in linear.logs])
    own = next(k for k in range(len(samples)) if number < sum(map(len, samples[: k + 1])))
    place = number - sum(map(len, samples[:own]))
    return _tail(linear, whole, own, samples[own][place], scored.states[own][place][:, usable])
