"""Candidates on stiff models made ready to be refitted: their models, what is free, and where they may start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.correct.fits.fit import Fit
from bondgraph.correct.fits.noise_starts import quiet_start
from bondgraph.correct.models.failures import FAILURES, reason
from bondgraph.correct.refits.refit import STRIDES, Ground, abrupt, along, at_optimum, coefficients, inside
from bondgraph.correct.refits.trials import Trial
from bondgraph.correct.scores.quiet import Quiet, quiet_starts
from bondgraph.correct.scores.score import Scores
from bondgraph.correct.scores.scoring import Scored
from bondgraph.data.log import FloatArray
from bondgraph.estimate.free import FreeParameter
from bondgraph.filter.compiled import CompiledFilter
from bondgraph.filter.filter_model import FilterModel

_Task = TypeVar("_Task")

#: What promises less than so many times the least gain that counts is near.
NEARBY = 10.0
#: Shares of the step of a score at which those near are tried: the filter of all logs is costly, and scores are right.
_NEAR_STRIDES = (1.0, 0.1)
#: Multiples of that step, and by how much (of a logarithm) lower process noise, at which a start is tried.
_MULTIPLES = (1.0, 4.0, 16.0)
_QUIETER = 2.0


@dataclass(frozen=True)
class Entrant:
    """A candidate with the model that it added its effect to, what is free there, and where it may start.

    ``beginning`` is where its heat begins (n,); None: it needs none.
    """

    group: tuple[int, ...]
    built: BuiltModel
    filter_model: FilterModel
    free: tuple[FreeParameter, ...]
    starts: tuple[FloatArray, ...]
    beginning: FloatArray | None


def entrant_of(trials: Sequence[Trial], group: Sequence[int], scored: Scored, ground: Ground) -> Entrant:
    """The first of a group of alike candidates, with starts where its score points, and others if it promises much."""
    index, base, found = group[0], ground.base, scored.scores
    candidate = trials[index].candidate
    built = build(candidate.apply(ground.built.graph))
    filter_model = replace(base.problem.filter_model, model=built.model)
    own = coefficients(candidate, filter_model, scored.variants[index])
    free = (*at_optimum(base), *own)
    near = trials[index].score_gain <= NEARBY * ground.need
    shares = (*(_NEAR_STRIDES if near else STRIDES), *abrupt(candidate, found.steps[index]))
    starts = [along(base, found, index, own, share) for share in shares]
    if near:
        return Entrant(tuple(group), built, filter_model, free, tuple(starts), None)
    starts += _afresh(base, own, found.steps[index])
    absent = [parameter.coordinate(parameter.start) for parameter in own]
    beginning = quiet_start(free, np.concatenate([declared_point(base), absent]))
    return Entrant(tuple(group), built, filter_model, free, tuple(starts), beginning)


def quiet_entrant(trials: Sequence[Trial], group: Sequence[int], quiet: Quiet, ground: Ground) -> Entrant:
    """A candidate that is searched from where the quiet fit points, and from little process noise."""
    index, base = group[0], ground.base
    built = build(trials[index].candidate.apply(ground.built.graph))
    filter_model = replace(base.problem.filter_model, model=built.model)
    own = coefficients(trials[index].candidate, filter_model, quiet.scored.variants[index])
    free = (*at_optimum(base), *own)
    starts = quiet_starts(base, quiet, index, own)
    beginning = quiet_start(free, np.concatenate([declared_point(base), [one.coordinate(one.start) for one in own]]))
    return Entrant(tuple(group), built, filter_model, free, tuple(starts), beginning)


def compiled_ones(entrants: Sequence[Entrant], done: list[Trial]) -> list[Entrant]:
    """Those whose filter could be compiled."""

    def compiled(one: Entrant) -> Entrant:
        CompiledFilter.of(one.filter_model)
        return one

    return each_made(compiled, entrants, lambda one, why: note_failure(one.group[0], why, done))


def each_made(
    action: Callable[[_Task], Entrant], tasks: Sequence[_Task], failed: Callable[[_Task, str], None]
) -> list[Entrant]:
    """What an action makes of some tasks, without those for which it fails, of which ``failed`` is told why."""
    kept = []
    for task in tasks:
        try:
            kept.append(action(task))
        except FAILURES as error:
            failed(task, reason(error))
    return kept


def entrants_of(groups: Sequence[list[int]], done: list[Trial], scored: Scored, ground: Ground) -> list[Entrant]:
    """The first of each group of alike candidates, to be refitted."""
    return each_made(
        lambda group: entrant_of(done, group, scored, ground),
        groups,
        lambda group, why: note_failure(group[0], why, done),
    )


def moved_there(entrant: Entrant, best: Trial, index: int, done: Sequence[Trial], found: Scores) -> Entrant:
    """An entrant that also starts where the same law ended at another place, its size as scores compare the two.

    ``index`` is that of the other trial. From there it needs no heat on the beginnings of the logs, where a search that
    knows nothing of the other may end far behind.
    """
    assert best.fit is not None
    own = done[entrant.group[0]].candidate.effect.parameters
    known = dict(best.fit.values)
    sizes = zip(found.steps[entrant.group[0]], found.steps[index], strict=False)
    ratios = [float(there / here) if here else 1.0 for there, here in sizes]
    for k, (name, other) in enumerate(zip(own, best.candidate.effect.parameters, strict=True)):
        known[name] = best.fit.values[other] * (ratios[k] if k < len(ratios) else 1.0)
    start = np.array([one.coordinate(float(np.clip(known[one.name], one.lower, one.upper))) for one in entrant.free])
    return replace(entrant, starts=(start, *entrant.starts), beginning=None)


def note_failure(index: int, why: str, done: list[Trial]) -> None:
    """Note that a candidate could not be refitted."""
    if done[index].fit is None:
        done[index] = replace(done[index], failed=why)


def _afresh(base: Fit, own: Sequence[FreeParameter], step: FloatArray) -> list[FloatArray]:
    """Starts that owe less to the fit without a candidate: its parameters or the declared ones, its noise or little.

    A model that lacks something drives its parameters to bounds and its noise up, and from there a long way leads back.
    Coefficients are tried at what their score points at and, since a large effect is underrated, at multiples of it.
    """
    problem = base.problem
    kinds = np.array([parameter.target.kind for parameter in problem.free])
    declared = declared_point(base)
    quiet = np.where(kinds == "process", np.clip(base.point - _QUIETER, problem.lower, problem.upper), 0.0)
    found = []
    for point in (base.point, declared):
        for levels in (point, np.where(kinds == "process", quiet, point)):
            for many in _MULTIPLES:
                reached = [inside(one, many * value) for one, value in zip(own, step, strict=False)]
                shapes = [parameter.coordinate(parameter.start) for parameter in own[step.size :]]
                found.append(np.concatenate([levels, reached, shapes]))
    return found


def declared_point(base: Fit) -> FloatArray:
    """The point of a fit with its parameters as declared."""
    model = base.problem.filter_model.model
    point = base.point.copy()
    for k, parameter in enumerate(base.problem.free):
        if parameter.target.kind == "parameter":
            value = model.parameters[model.index("parameter", parameter.target.name)].value
            point[k] = parameter.coordinate(float(np.clip(value, parameter.lower, parameter.upper)))
    return point
