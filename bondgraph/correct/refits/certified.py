"""Is a fit of a loop free of its integration steps? The filter with every step halved says how far it would move.

Where it would move noticeably, the fit goes on with the halved steps from where it is.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Self

import numpy as np

from bondgraph.correct.fits.fit import Fit, expand, fit, restricted
from bondgraph.correct.fits.journal import Journal
from bondgraph.correct.refits.refit import at_optimum
from bondgraph.correct.scores.score import solve
from bondgraph.data.log import FloatArray
from bondgraph.errors import EstimationError
from bondgraph.estimate.certify import NEGLIGIBLE_SHIFT, Check, check, check_of
from bondgraph.estimate.exact import compile_exact
from bondgraph.estimate.free import Kind
from bondgraph.estimate.objective import Expansion, Objective
from bondgraph.estimate.problem import EstimationProblem, FilterLikelihood

#: How often steps are halved for a fit that its steps move: enough for a smoothed dry friction that explicit steps
#: follow, but do not resolve. Stiff models have their steps from a study of their own, and their fits are costly.
_MOST_HALVINGS = 4
#: A fit that still promises 0.005 nats lies a tenth of a standard deviation off by that alone.
_ITERATIONS, _TOLERANCE = 20, 1e-3
#: The share of a negligible shift up to which it may be told without derivatives with halved steps.
_SURE = 0.5
#: Free numbers that are levels of noises.
_LEVELS: tuple[Kind, ...] = ("process", "std")


class Certifications:
    """Checks of the fits of a loop, those of stiff models in a thread of their own while the loop goes on.

    They take as long as the derivation of candidates and their scores, which leave all cores but one idle.
    """

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(1)
        self._begun: list[tuple[Fit, Future[Check]]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.shutdown(wait=False, cancel_futures=True)

    def begin(self, fitted: Fit) -> None:
        """Look at a fit of which the result will probably be asked for; nothing where that is quick."""
        if not fitted.problem.filter_model.is_stiff:
            return
        problem = replace(fitted.problem, likelihood=FilterLikelihood(threads=1))
        compile_exact(_with_known_noise(fitted)[0])
        self._begun.append((fitted, self._executor.submit(certify, replace(fitted, problem=problem))))

    def refined(self, fitted: Fit, journal: Journal | None = None) -> tuple[Fit, Check]:
        """As :func:`refined`, with the check that was begun."""
        return refined(fitted, journal, next((task.result() for one, task in self._begun if one is fitted), None))


def refined(fitted: Fit, journal: Journal | None = None, known: Check | None = None) -> tuple[Fit, Check]:
    """The fit with steps so short that halving them moves it no more, if few halvings do that, and its last check.

    A fit that its steps do not move is returned as it is, and so is that of a stiff model. ``known`` is the check of
    the fit as it is.
    """
    found = known or certify(fitted)
    for _ in range(_MOST_HALVINGS):
        problem = fitted.problem
        if found.shift <= NEGLIGIBLE_SHIFT or problem.filter_model.is_stiff:
            break
        finer = problem.filter_model.with_halved_steps()
        try:
            fitted = fit(finer, problem.logs, at_optimum(fitted), _ITERATIONS, _TOLERANCE, journal=journal)
        except EstimationError:
            break
        found = certify(fitted)
    return fitted, found


def certify(fitted: Fit) -> Check:
    """What halved integration steps would change at a fit.

    One value of the likelihood tells the innovations that they would leave, and with the derivatives that the fit has
    these make a gradient. Derivatives with halved steps cost ten times as much (on two fits of a vehicle they found
    shifts of 0.08 and 0.02 standard deviations, innovations alone 0.02 and 0.02); they are formed where innovations
    alone move something by more than half of what is negligible, see :func:`bondgraph.estimate.certify.check`.

    Noise levels stay where they are: they are no result, and half of what is free. What rests on a bound is not
    expected to move.
    """
    free = ~fitted.held
    covariance = np.zeros((free.size, free.size))
    information = restricted(fitted.expansion, free).information
    covariance[np.ix_(free, free)] = solve(information, np.eye(information.shape[0]))
    known, own = _with_known_noise(fitted)
    covariance = covariance[np.ix_(own, own)]
    found = _by_innovations(fitted, own, covariance)
    if found.shift <= _SURE * NEGLIGIBLE_SHIFT:
        return found
    finer = known.filter_model.with_halved_steps()
    at_optimum = not known.filter_model.is_stiff
    return check(known, fitted.point[own], covariance, finer, _expansions, converged=at_optimum)


def _by_innovations(fitted: Fit, own: list[int], covariance: FloatArray) -> Check:
    """What the innovations with halved steps say with the derivatives that the fit has."""
    finer = fitted.problem.filter_model.with_halved_steps()
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
    return (expand(objective, points[:, 0], steps[:, 0]),)


def doubts(which: str, found: Check) -> list[str]:
    """What to say where steps do matter: nothing, or one sentence about the ``which`` model."""
    if found.shift <= NEGLIGIBLE_SHIFT:
        return []
    return [
        f"the {which} model is not certified: with every integration step halved, {found.parameter} would move by "
        f"{found.shift:.2g} standard deviations (likelihood {found.nats:+.3g} nats)"
    ]
