"""Regimes of laws: which law acts where a signal is above or below a level, or between or outside of two.

A law that acts in a part of the operating space leaves a residual that is uneven over a signal. The scores of a law by
sample are at hand: weighed by how far a gate is open they are, to the memory of the filter, the score of the law with
that gate. So all gates in all signals cost sums, and only what stands out is made a candidate of its own, scored and
refitted like any other. Two places give rise to regimes: the scores of the declared model, also of laws that a free
parameter hides where they act everywhere, and each fit that leads the search, for the laws at its place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bondgraph.correct.constants import FREE_TAKE, INDIFFERENT, OPTIMISM
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import Candidate, Variant, candidates
from bondgraph.correct.places.probes import Signal, is_switch, signals
from bondgraph.correct.places.regimes import Regime, Side, in_regime, tried
from bondgraph.correct.places.unexplained import distinct
from bondgraph.correct.scores.score import best_step, solve
from bondgraph.correct.scores.scoring import Linearisation, Scored, linearisation, score_candidates
from bondgraph.correct.search.incumbents import Prediction, predicted_by_scores, predicted_by_swap
from bondgraph.correct.search.swap import columns_in_place
from bondgraph.data.log import FloatArray
from bondgraph.declare.effect import Place
from bondgraph.estimate.objective import Expansion

#: Gated laws that are made at a time. A convention: each costs a score and may cost a refit.
_MOST = 3
#: A gate has at least this share of what the logs tell of its law on either side: as for a change in time, Andrews
#: (1993), Econometrica 61(4), who recommends 15 % of the samples; of the information a law has less on its quiet side.
_TRIM = 0.05
#: Widths of gates that are tried, as multiples of the finest: 2, 6 and 18 % of the range of a signal, between which one
#: that is freed later finds its way. A convention.
_WIDTHS = (1.0, 3.0, 9.0)
#: Kinds of gates in one signal: above, below, between and outside, with each width.
_SIDES = 4 * len(_WIDTHS)
#: Gated laws that promise this share of the best one's gain are made too.
_NEAR = 0.8


@dataclass(frozen=True)
class Gateable:
    """A law with its responses (n_terms,) along the logs, which may get a gate."""

    candidate: Candidate
    variant: Variant
    response: FloatArray


@dataclass(frozen=True)
class Option:
    """A law with a regime, and the gain in nats that sums of its scores promise, less what a second level costs."""

    law: Gateable
    regime: Regime
    gain: float


@dataclass(frozen=True)
class Gated:
    """A gated law as a candidate: its trial, what is predicted of it, and how many were tried beside the others."""

    trial: Trial
    prediction: Prediction
    tested: int


def gated_by_scores(linear: Linearisation, known: Scored, where: Sequence[Place], context: Context) -> list[Gated]:
    """Gated laws that promise clearly more than every law that acts everywhere, by the scores of the declared model."""
    best = float(known.scores.gain.max(initial=0.0))
    if best * OPTIMISM["smooth"] < context.required:
        return []  # no law is worth a refit
    laws = [
        Gateable(candidate, variant, column[:, 0])
        for candidate, variant, column in zip(known.candidates, known.variants, known.columns, strict=True)
        if _may_be_gated(candidate)
    ]
    seen = distinct([one for one in signals(context.built, linear, where) if one.name not in ("time", *context.formed)])
    options = _options(linear, laws, seen, context)
    made = _made(options, max(best, context.required) + _margin(laws, seen, context), context)
    if not made:
        return []
    scored = score_candidates(linear, made)
    predictions = predicted_by_scores(context.base, linear, scored, context)
    steps = [tuple(map(float, one)) for one in scored.scores.steps[: len(made)]]
    return _gated(made, predictions, steps, _SIDES * len(laws) * len(seen))


def gated_in_place(best: Trial, known: Scored, where: Sequence[Place], context: Context) -> list[Gated]:
    """Gated laws that promise clearly more than the fit that leads, in its place."""
    fitted, own = best.fit, best.candidate
    if fitted is None or best.built is None or own.effect.adds_state or own.effect.channel:
        return []
    pairs = [
        (candidate, variant)
        for candidate, variant in zip(known.candidates, known.variants, strict=True)
        if candidate.place.label == own.place.label and _may_be_gated(candidate)
    ]
    shared = context.base.point.size
    if not pairs or fitted.held[shared:].any():
        return []
    linear = linearisation(fitted, fitted.problem.logs)
    columns = columns_in_place(linear, *map(list, zip(*pairs, strict=True)))
    laws = [Gateable(*pair, column) for pair, column in zip(pairs, columns.T, strict=True)]
    seen = distinct([one for one in signals(best.built, linear, where) if one.name not in ("time", *context.formed)])
    without, beaten = without_effect(linear, shared, len(own.effect.coefficients))
    margin = INDIFFERENT if own.effect.regime else _margin(laws, seen, context)
    made = _made(_options(without, laws, seen, context), beaten + margin, context)
    if not made:
        return []
    # a gated law has one variant, that of its level
    predictions = predicted_by_swap(best, made, [one.variants[0] for one in made], context)
    return _gated(made, predictions, [()] * len(made), _SIDES * len(laws) * len(seen))


def _gated(
    made: Sequence[Candidate],
    predictions: Sequence[Prediction | None],
    steps: Sequence[tuple[float, ...]],
    tested: int,
) -> list[Gated]:
    return [
        Gated(Trial(one, told.gain, step), told, tested)
        for one, told, step in zip(made, predictions, steps, strict=True)
        if told is not None
    ]


def _may_be_gated(candidate: Candidate) -> bool:
    """True for a loss of one coefficient at a junction; a source with a gate is a step, which formulas offer."""
    effect, place = candidate.effect, candidate.place
    return effect.dissipative and place.bond is None and len(effect.parameters) == 1 and not effect.amplitudes


def _margin(laws: Sequence[Gateable], seen: Sequence[Signal], context: Context) -> float:
    """Nats beyond a law without a gate: the penalty for the level, and for how many gates were tried."""
    return _level_price(context) + math.log(max(_SIDES * len(laws) * len(seen), 1))


def _level_price(context: Context) -> float:
    """Nats that a level of a gate must be worth."""
    measured = sum(int(np.isfinite(log.y).sum()) for log in context.train)
    return INDIFFERENT + 0.5 * math.log(max(measured, 2))


def without_effect(linear: Linearisation, shared: int, coefficients: int) -> tuple[Linearisation, float]:
    """The linearisation with the effect of its fit taken out, and what that one gains there, in nats."""
    fitted = linear.base
    kept = np.flatnonzero(~fitted.held)
    own = 1 + np.flatnonzero(kept >= shared)
    common = np.concatenate([[0], 1 + np.flatnonzero(kept < shared)])
    law = linear.free[:, own[:coefficients]]
    free = linear.free[:, common].copy()
    free[:, 0] -= law @ fitted.point[kept[own[:coefficients] - 1]]
    without = replace(linear, free=free, scales=linear.scales[:, common])
    _, gain, _ = best_step(without.projected(law), list(range(coefficients)), np.zeros(coefficients, dtype=bool))
    return without, gain


def _options(linear: Linearisation, laws: Sequence[Gateable], seen: Sequence[Signal], context: Context) -> list[Option]:
    """The best levels of every law in every signal on every side, the most promising first."""
    bare, price = linear.expansion(np.zeros((linear.free.shape[0], 0))), _level_price(context)
    spread = linear.free[:, 1:] + linear.free[:, :1] * linear.scales[:, 1:]
    timed = linear.times.sample >= 0
    gates = []
    for signal in seen:
        regime, levels = tried(signal)
        values = np.concatenate(signal.values)
        cells = np.searchsorted(levels, values)
        widths = regime.width * np.array(_WIDTHS[:1] if is_switch(signal) else _WIDTHS)
        gates.append((regime, _gates(widths, levels, values, cells), cells[linear.times.sample[timed]]))
    found = []
    for law in laws:
        response = law.response[:, np.newaxis]
        pieces = np.concatenate([response * linear.free[:, :1], response**2, response * spread], axis=1)[timed]
        one_sided = bool(law.candidate.lower[0] >= 0.0)
        for regime, sides, cells in gates:
            sums = np.array([np.bincount(cells, weights=one, minlength=sides[0].opened.shape[1]) for one in pieces.T])
            for one in sides:
                if not one.level.size:
                    continue
                inside = sums @ one.opened.T
                inside[1] = sums[1] @ (one.opened**2).T
                gain = _gains(bare, inside, float(sums[1].sum()), one_sided)
                k = int(np.argmax(gain))
                two = price if one.upper.size else 0.0
                found.append(Option(law, one.regime(regime, k), float(gain[k]) - two))
    return sorted(found, key=lambda one: -one.gain)


@dataclass(frozen=True)
class _Gates:
    """Gates on one side: what they leave open (gates, n + 1) between levels, these (gates,), and their widths."""

    side: Side
    opened: FloatArray
    level: FloatArray
    upper: FloatArray
    width: FloatArray

    def that_shut(self) -> _Gates:
        """The gates that are shut somewhere, at least as far as a width beyond their level."""
        shut = self.opened.min(axis=1) <= 0.5 * (1.0 + np.tanh(-1.0))
        upper = self.upper[shut] if self.upper.size else self.upper
        return _Gates(self.side, self.opened[shut], self.level[shut], upper, self.width[shut])

    def regime(self, like: Regime, k: int) -> Regime:
        upper = float(self.upper[k]) if self.upper.size else None
        return replace(like, side=self.side, level=float(self.level[k]), width=float(self.width[k]), upper=upper)


def _gates(kinds: FloatArray, levels: FloatArray, values: FloatArray, cells: NDArray[np.int_]) -> list[_Gates]:
    """All gates in a signal of these values, which lie in cells between levels (n,); each with every width."""
    count = np.bincount(cells, minlength=levels.size + 1)
    centres = np.bincount(cells, weights=values, minlength=levels.size + 1) / np.maximum(count, 1)
    widths, level = np.repeat(kinds, levels.size), np.tile(levels, kinds.size)
    past = 0.5 * (1.0 + np.tanh((centres - level[:, np.newaxis]) / widths[:, np.newaxis]))
    none = np.zeros(0)
    found = [_Gates("below", 1.0 - past, level, none, widths), _Gates("above", past, level, none, widths)]
    low, high = np.triu_indices(levels.size, 1)
    if low.size:
        shift = levels.size * np.arange(kinds.size)[:, np.newaxis]
        low, high = (low + shift).ravel(), (high + shift).ravel()
        between, ends = past[low] * (1.0 - past[high]), (level[low], level[high], widths[low])
        found += [_Gates("between", between, *ends), _Gates("outside", 1.0 - between, *ends)]
    return [one.that_shut() for one in found]


def _gains(bare: Expansion, inside: FloatArray, whole: float, one_sided: bool) -> FloatArray:
    """Gains (levels,) of a law that acts inside gates, the free coordinates of an expansion taken out.

    ``inside`` (2 + free, levels): its score, its information and what it shares with the free coordinates; ``whole``
    is its information everywhere.
    """
    share = solve(bare.information, inside[2:])
    told = inside[1] - np.einsum("ij,ij->j", inside[2:], share)
    score = -(inside[0] - share.T @ bare.gradient)
    usable = (inside[1] > _TRIM * whole) & (inside[1] < (1.0 - _TRIM) * whole) & (told > FREE_TAKE * inside[1])
    if one_sided:
        usable &= score > 0.0
    gain: FloatArray = np.where(usable, 0.5 * score**2 / np.where(usable, told, 1.0), 0.0)
    return gain


def _made(options: Sequence[Option], beat: float, context: Context) -> list[Candidate]:
    """Candidates of the most promising options, those that promise more than is to be beaten."""
    found: list[Candidate] = []
    for one in options:
        if one.gain < max(beat, _NEAR * options[0].gain) or len(found) == _MOST:
            break
        made, _ = candidates(
            context.built, [in_regime(one.law.candidate.function, one.regime)], [one.law.candidate.place]
        )
        found += made
    return found
