"""Swaps: what the fit with one candidate says a fit with another in its place would reach.

Scores at the fit without any effect rank candidates roughly: that fit hides what it lacks in its noise and in
parameters far from their truth. At the fit with one of them in place, noise and parameters are about right, whichever
of several neighbours is the true one. There the quadratic expansion in the parameters, the coefficients found, and
those of another candidate tells what taking the ones to zero costs and what freeing the other gains: one linearisation
for all of them. Sequential replacement: Miller (2002), Subset Selection in Regression, section 3.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from bondgraph.correct.constants import FREE_TAKE
from bondgraph.correct.evidence.context import coefficients, inside
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import Candidate, Variant
from bondgraph.correct.scores.score import best_step, project, solve
from bondgraph.correct.scores.scoring import Linearisation, linearisation
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.estimate.objective import Expansion
from bondgraph.estimate.solvers.steps import promised_gain
from bondgraph.estimate.symmetric import scaled_eigen
from bondgraph.filter.linear.response import Change, Path, model_change, together

#: Shares of the way to where the expansion puts the parameters at which a refit looks for its start.
_STRIDES = (1.0, 0.5, 0.0)
#: Directions of which the data tell less than this share of the most are rounding.
_TOLD = 1e-12
#: Candidates whose responses are formed at once; changes no number.
_ABREAST = 8


@dataclass(frozen=True)
class Swap:
    """One candidate in the place of an effect that was found.

    ``loss`` is by how many nats its fit would be worse, ``starts`` are points, each (n,), from which to refit it.
    """

    loss: float
    starts: tuple[FloatArray, ...]


def swaps(
    found: Trial, others: Sequence[Candidate], variants: Sequence[Variant], train: Sequence[MatchedLog], shared: int
) -> list[Swap | None]:
    """What each of some candidates would do in the place of a refitted one; None where nothing can be said.

    Parameters
    ----------
    found
        The refitted candidate; nothing can be said without a refit, with its coefficients on a bound, or where it
        brings a state (a deflection) that the others have no place for.
    others, variants
        The candidates, which bring no storage of their own, and how each is tried.
    train
        The logs of the refit.
    shared
        How many of its free coordinates come first that the others have too; its own coefficients and shapes follow.
    """
    fitted = found.fit
    if fitted is None or found.candidate.effect.adds_state or fitted.held[shared:].any() or not others:
        return [None] * len(others)
    states = set(fitted.problem.filter_model.model.names("state"))
    if not all(states <= set(one.model.names("state")) for one in others):
        return [None] * len(others)
    linear = linearisation(fitted, train)
    expansion = linear.expansion(columns_in_place(linear, others, variants))
    problem, kept = fitted.problem, np.flatnonzero(~fitted.held)
    common = np.flatnonzero(kept < shared)
    own = np.flatnonzero(kept >= shared)[: len(found.candidate.effect.coefficients)]
    away = -fitted.point[kept[own]]
    gradient = expansion.gradient + expansion.information[:, own] @ away
    lanes = np.arange(kept.size, expansion.gradient.size)
    rows = np.concatenate([common, lanes])
    moved = Expansion(gradient[rows], expansion.information[np.ix_(rows, rows)], 1)
    projected = project(moved, common.size)
    told = np.diag(projected.information) > FREE_TAKE * np.diag(moved.information)[common.size :]
    back = -solve(moved.information[: common.size, : common.size], moved.gradient[: common.size, np.newaxis])[:, 0]
    removal = 0.5 * float(away @ (expansion.gradient[own] + gradient[own]))
    low, high = (bound[kept[common]] - fitted.point[kept[common]] for bound in (problem.lower, problem.upper))
    results: list[Swap | None] = []
    first = 0
    for one, how in zip(others, variants, strict=True):
        mine = np.arange(first, first + len(one.effect.coefficients))
        first += mine.size
        if not told[mine].any():  # free parameters take what it could explain: its step would be one of rounding
            results.append(None)
            continue
        both = np.concatenate([np.arange(common.size), common.size + mine])
        there = Expansion(moved.gradient[both], moved.information[np.ix_(both, both)], 1)
        step, _, _ = best_step(projected, list(mine), one.lower >= 0.0)
        move = np.concatenate([back + projected.share[:, mine] @ step, step])
        if np.any((move[: common.size] < low) | (move[: common.size] > high)):
            least = np.where(one.lower >= 0.0, 0.0, -np.inf)
            move = _inside(there, np.append(low, least), np.append(high, np.full(mine.size, np.inf)))
        shift = np.zeros(shared)
        shift[kept[common]] = move[: common.size]
        free = coefficients(one, replace(problem.filter_model, model=one.model), how)
        reached = [inside(parameter, value) for parameter, value in zip(free, move[common.size :], strict=False)]
        shapes = [parameter.coordinate(parameter.start) for parameter in free[mine.size :]]
        ends = [np.concatenate([fitted.point[:shared] + share * shift, reached, shapes]) for share in _STRIDES]
        results.append(Swap(removal - promised_gain(there, move), tuple(ends)))
    return results


def _inside(expansion: Expansion, low: FloatArray, high: FloatArray) -> FloatArray:
    """The best move (n,) of a quadratic between bounds.

    A machine all of whose masses, losses and drives go to nothing leaves no error in the linear expansion, and what
    helps it there would take the place of any law.
    """
    found = scaled_eigen(expansion.information)
    told = found.values > _TOLD * found.largest
    roots, turned = np.sqrt(found.values[told]), found.vectors[:, told].T
    right = -(turned @ (found.scale * expansion.gradient)) / roots
    scale = np.where(found.scale > 0.0, found.scale, 1.0)
    move: FloatArray = scale * lsq_linear(roots[:, np.newaxis] * turned, right, (low / scale, high / scale)).x
    return move


def columns_in_place(linear: Linearisation, others: Sequence[Candidate], variants: Sequence[Variant]) -> FloatArray:
    """Responses (n_terms, lanes) to all coefficients of candidates in the place of an effect of the linearised model.

    All of them do nothing where their coefficients are zero.
    """
    model, paths = others[0].model, [log.path for log in linear.logs]
    absent = [model_change(path, model, model.theta(**path.parameters(model)), 1.0) for path in paths]
    firsts = range(0, len(others), _ABREAST)

    def some(part: int, log: int) -> Change:
        own = range(firsts[part], min(firsts[part] + _ABREAST, len(others)))
        return together([_change(paths[log], others[k], variants[k], absent[log]) for k in own])

    sizes = [len(one.effect.coefficients) for one in others]
    return linear.responses([sum(sizes[first : first + _ABREAST]) for first in firsts], some)[0]


def _change(path: Path, candidate: Candidate, variant: Variant, absent: Change) -> Change:
    """The changes by the coefficients of a candidate along the path of a model that has another effect, a lane each.

    ``absent``: the change by taking the other effect out, which is in that by each candidate and none of its own.
    """
    known = path.parameters(candidate.model) | dict(variant.shapes)
    lanes = []
    for name, size in zip(candidate.effect.coefficients, variant.sizes, strict=True):
        there = model_change(path, candidate.model, candidate.model.theta(**known | {name: size}), size)
        lanes.append(
            Change(
                there.start - absent.start / size, there.end - absent.end / size, there.outputs - absent.outputs / size
            )
        )
    return together(lanes)
