"""Is a fit of a loop free of its integration steps? The filter with every step halved says what they are worth.

Steps that are too long shift innovations by something that follows the states as an effect would: on a log of an
exactly declared fan a loss of its motor gained 18 nats, of which shorter steps left nothing. So steps are certified
before anything is scored, and what is chosen is judged with steps that resolve its own model.

What effects could gain at most by making up for the steps (:func:`bondgraph.estimate.longer_steps.step_gain`), and how
far estimates would move, must be negligible: a tenth of what an effect must gain at least, and of a standard deviation.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bondgraph.correct.models.shaping_filters import is_memory
from bondgraph.correct.scores.score import solve
from bondgraph.data.log import FloatArray
from bondgraph.errors import EstimationError
from bondgraph.estimate.certify import NEGLIGIBLE_SHIFT, Check, check, check_of
from bondgraph.estimate.fitted import Fit, restricted
from bondgraph.estimate.free import Kind
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import refitted
from bondgraph.estimate.longer_steps import step_gain
from bondgraph.estimate.objective import Expansion, Objective, Terms
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.searches import expand
from bondgraph.filter.filter_model import FilterModel

#: How often steps are halved for a fit that they move: enough for a smoothed dry friction that explicit steps follow,
#: but do not resolve. A stiff method resolves what is smooth with its first steps, and at a kink no steps do.
_MOST_HALVINGS, _MOST_STIFF_HALVINGS = 4, 2
#: Share of what an effect must gain at least that it may gain by making up for the steps. It must gain the penalty for
#: one coefficient: Schwarz (1978), Annals of Statistics 6(2).
_UNNOTICED = 0.1
#: The share of a negligible shift up to which it may be told without derivatives with halved steps.
_SURE = 0.5
#: Free numbers that are levels of noises.
_LEVELS: tuple[Kind, ...] = ("process", "std")


def refined(fitted: Fit, journal: Journal | None = None, least: int | None = None) -> tuple[Fit, Check]:
    """The fit with steps so short that halving them changes it no more, if few halvings do that, and its last check.

    A fit that its steps do not disturb is returned as it is, and halving ends where steps alone move nothing any more:
    what more nodes of process noise would change is said by the check, and no steps mend it. A search that crept along
    a ridge is finished then, so that what is left of it is not taken for something else. ``least`` as for
    :func:`resolving`.
    """
    most = _most(fitted, least)
    fitted = with_steps(fitted, resolving(fitted, least), journal)
    found = certify(fitted)
    while found.shift > NEGLIGIBLE_SHIFT and fitted.problem.filter_model.substeps < most and _moved_by_steps(fitted):
        before = fitted
        fitted = with_steps(fitted, fitted.problem.filter_model.with_halved_steps(), journal)
        if fitted is before:
            break
        found = certify(fitted)
    if found.shift > NEGLIGIBLE_SHIFT and not fitted.problem.filter_model.is_stiff:
        finished = _finished(fitted, journal)
        return (fitted, found) if finished is fitted else (finished, certify(finished))
    return fitted, found


def resolving(fitted: Fit, least: int | None = None) -> FilterModel:
    """The filter of a fit, its steps halved until no effect could gain noticeably by making up for them.

    ``least`` are the steps from which halvings are counted, those with which a loop began; None, and where a model
    with an effect takes a stiff method instead: those of the fit. Explicit steps that a law made shorter than that
    allows (its width was found with steps of its own) are not halved again.
    """
    problem, seen = fitted.problem, _seen(fitted)
    used, most, negligible = problem.filter_model, _most(fitted, least), unnoticed(problem)
    while used.substeps < most:
        finer = used.with_halved_steps()
        again = replace(problem, filter_model=finer).terms(fitted.point[:, np.newaxis])
        if not step_gain(seen, again) > negligible:
            break
        used, seen = finer, again
    return used


def unnoticed(problem: EstimationProblem) -> float:
    """Nats that an effect may gain at most by making up for what is no physics: so few change no decision."""
    measured = sum(int(np.isfinite(log.y).sum()) for log in problem.logs)
    return _UNNOTICED * 0.5 * math.log(max(measured, 2))


def with_steps(fitted: Fit, filter_model: FilterModel, journal: Journal | None = None) -> Fit:
    """The fit with other integration steps, from where it is; as it is if these are its own, or lead nowhere."""
    used = fitted.problem.filter_model
    filter_model = _on_nodes_of(used, filter_model)
    key = filter_model.steps
    if filter_model is used or (used.method == filter_model.method and used.steps == key):
        return fitted
    finer = used.with_steps_of(filter_model)
    known = fitted.with_other_steps
    if key not in known:  # every candidate that is judged with finer steps asks for the fit without it
        try:
            known[key] = refitted(fitted, finer, journal)
        except EstimationError:
            known[key] = fitted
    return known[key]


def _on_nodes_of(used: FilterModel, filter_model: FilterModel) -> FilterModel:
    """The filter with the nodes of process noise of one that is not stiff, which other steps leave as they are.

    With more nodes a fit of a car with a trailer ended in an optimum that is 180 nats worse.
    """
    if used.is_stiff:
        return filter_model
    return replace(filter_model, noise_nodes=used.noise_nodes, noise_reach=used.noise_reach)


def _moved_by_steps(fitted: Fit) -> bool:
    """True where halved steps move an estimate noticeably without more nodes of process noise beside them.

    Nodes cut an interval into pieces of one step at least, each of which is halved.
    """
    used = fitted.problem.filter_model
    if used.is_stiff:
        return True
    pieces = replace(used, substeps=max(used.substeps, used.noise_nodes + 1))
    return certify(fitted, _on_nodes_of(used, pieces.with_halved_steps())).shift > NEGLIGIBLE_SHIFT


def _finished(fitted: Fit, journal: Journal | None) -> Fit:
    """The fit where its search leads that is begun anew from its end; as it is where that leads nowhere."""
    try:
        again = refitted(fitted, fitted.problem.filter_model, journal)
    except EstimationError:
        return fitted
    return again if again.nll < fitted.nll else fitted


def _most(fitted: Fit, least: int | None) -> int:
    """The most steps that halvings may lead to."""
    used = fitted.problem.filter_model
    halvings = _MOST_STIFF_HALVINGS if used.is_stiff else _MOST_HALVINGS
    if least is None or (used.is_stiff and used.substeps > least << halvings):
        return used.substeps << halvings
    return max(least << halvings, used.substeps)


def _seen(fitted: Fit) -> Terms:
    """The terms of the likelihood at the fit, (n_terms, 1)."""
    known = fitted.expansion.terms
    return fitted.problem.terms(fitted.point[:, np.newaxis]) if known is None else known.members(np.array([0]))


def certify(fitted: Fit, finer: FilterModel | None = None) -> Check:
    """Changes of a fit by halved integration steps, or by those of another filter.

    One value of the likelihood tells the innovations that they would leave, and with the derivatives that the fit has
    these make a gradient. Derivatives with halved steps cost ten times as much (on two fits of a vehicle they found
    shifts of 0.08 and 0.02 standard deviations, innovations alone 0.02 and 0.02); they are formed where innovations
    alone move something by more than half of what is negligible, see :func:`bondgraph.estimate.certify.check`.

    Levels and times of noise stay where they are: they are no result, and half of what is free. What rests on a bound
    is not expected to move.
    """
    free = ~fitted.held
    covariance = np.zeros((free.size, free.size))
    information = restricted(fitted.expansion, free).information
    covariance[np.ix_(free, free)] = solve(information, np.eye(information.shape[0]))
    known, own = _with_known_noise(fitted)
    covariance = covariance[np.ix_(own, own)]
    times = [k for k, one in enumerate(known.free) if is_memory(one.target.name)]
    covariance[times] = covariance[:, times] = 0.0
    finer = finer or fitted.problem.filter_model.with_halved_steps()
    found = _by_innovations(fitted, finer, own, covariance)
    if found.shift <= _SURE * NEGLIGIBLE_SHIFT:
        return found
    finer = known.filter_model.with_steps_of(finer)
    at_optimum = not known.filter_model.is_stiff
    return check(known, fitted.point[own], covariance, finer, _expansions, converged=at_optimum)


def _by_innovations(fitted: Fit, finer: FilterModel, own: list[int], covariance: FloatArray) -> Check:
    """Changes by the innovations with finer steps, and the derivatives that the fit has."""
    problem, known = replace(fitted.problem, filter_model=finer), fitted.expansion
    with np.errstate(invalid="ignore"):  # of a filter that fails nothing is a number
        around = known.around(problem.terms(fitted.point[:, np.newaxis]))
        moved = covariance @ (known.gradient - around.gradient)[own]
    low, high = (bound[own] - fitted.point[own] for bound in (problem.lower, problem.upper))
    return check_of(
        finer, [problem.names[k] for k in own], np.clip(moved, low, high), covariance, known.sum - around.sum
    )


def _with_known_noise(fitted: Fit) -> tuple[EstimationProblem, list[int]]:
    """The problem of a fit with its noise levels held at their estimates, and which coordinates are left."""
    problem, values = fitted.problem, fitted.values
    own = [k for k, one in enumerate(problem.free) if one.target.kind not in _LEVELS]
    if not own:
        return problem, list(range(len(problem.free)))
    held = {kind: {p.target.name: values[p.name] for p in problem.free if p.target.kind == kind} for kind in _LEVELS}
    filter_model = replace(
        problem.filter_model,
        process_noise={**problem.filter_model.process_noise, **held["process"]},
        measurement_noise={**problem.filter_model.measurement_noise, **held["std"]},
    )
    return replace(problem, filter_model=filter_model, free=tuple(problem.free[k] for k in own)), own


def _expansions(objective: Objective, points: FloatArray, steps: FloatArray) -> tuple[Expansion, ...]:
    """Expansions at one point.

    Exact ones of a stiff model, too: by its linearised filter steps that are far too long move hardly anything.
    """
    return (expand(objective, points[:, 0], steps[:, 0]),)


def doubts(which: str, found: Check) -> list[str]:
    """What to say where steps do matter: nothing, or one sentence about the ``which`` model."""
    if found.shift <= NEGLIGIBLE_SHIFT:
        return []
    if found.shift < 1.0:
        advice = "count that as a part of its uncertainty"
    else:
        advice = "do not rely on its value: give logs with more samples a second, or declare no part that is as fast"
    return [
        f"the {which} model is not certified: with every integration step halved, {found.parameter} would move by "
        f"{found.shift:.2g} standard deviations (likelihood {found.nats:+.3g} nats) - {advice}"
    ]
