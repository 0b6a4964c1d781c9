"""Given constants as rivals of a law: a number that is declared without bounds is known to some percent only.

Masses are read from data sheets, lengths from drawings. A constant that is two to five percent off colours the errors
of a long log by more than chance, and some law of the dictionary follows that colour: of a sled whose given mass is 3 %
off an added inertia, or a scale of its speed sensor, gained 545 nats in 4000 samples and passed every test. So the fit
without a law is looked for once more with the given constants free, each a Gaussian around its declared value; what the
law does better than these, or what it gains beside them, must pass. What the constants keep in their posteriors is
their price (Laplace's approximation): MacKay (1992), Neural Computation 4(3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.correct.constants import INDIFFERENT, OPTIMISM, TOLERANCE
from bondgraph.correct.evidence.bounds import value_text
from bondgraph.correct.evidence.certified import with_steps
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import judge
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.fits.starts import posterior_width
from bondgraph.correct.scores.score import solve
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit
from bondgraph.estimate.searches import expand
from bondgraph.estimate.solvers.gauss_newton import GaussNewtonSettings
from bondgraph.text import few, inflected

_ITERATIONS, _TOLERANCE = 40, 0.05
_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Given:
    """Constants that might be otherwise, with the nats that a step of them promises beyond the free parameters'."""

    constants: tuple[FreeParameter, ...]
    promise: float


def beside_given(trial: Trial, context: Context) -> Trial:
    """The trial; not passing, and with what is told of it, where given constants explain as much.

    Of stiff models all pass: their fits are costly.
    """
    if trial.fit is None or trial.evidence is None or context.base.problem.filter_model.is_stiff:
        return trial
    worth = trial.evidence.bic_gain
    base = with_steps(context.base, trial.fit.problem.filter_model, context.journal)
    told = explained_by_given(base, max(worth - INDIFFERENT, INDIFFERENT), context.journal)
    if told is None:
        return trial
    known, constants, _ = told
    both = _with_free(trial.fit, constants, context.journal)
    if judge(known, both, trial.candidate.effect, trial.evidence.tried, trial.gate is not None).accepted(context.level):
        return trial
    moved, names = moved_text(known, constants), [one.name for one in constants]
    return replace(
        trial, evidence=replace(trial.evidence, p_robust=1.0), given=moved,
        remark=f"{moved} {inflected(names, 'explains', 'explain')} {base.nll - known.nll:.1f} nats without it",
    )  # fmt: skip


def explained_by_given(
    base: Fit, least: float, journal: Journal
) -> tuple[Fit, tuple[FreeParameter, ...], float] | None:
    """A fit with given constants free that explain so many nats, these, and the nats after their price; None without.

    A constant that ends on its bound is off by more than a constant may be, and explains nothing.
    """
    given = promising(base)
    if not given.constants or OPTIMISM["smooth"] * given.promise < least:
        return None
    known, constants = with_fewest_free(base, given.constants, journal)
    explained = base.nll - known.nll - posterior_width(known, constants)
    return None if explained < least or any(known.held[-len(constants) :]) else (known, constants, explained)


def with_fewest_free(
    base: Fit, constants: Sequence[FreeParameter], journal: Journal
) -> tuple[Fit, tuple[FreeParameter, ...]]:
    """The fit with given constants free, and these: as few as explain as much as all of them do, and one at least."""
    known, kept = _with_free(base, constants, journal), list(constants)
    while len(kept) > 1 and (spare := needless_constant(known, kept)) is not None:
        kept.remove(spare)
        known = _with_free(base, kept, journal)
    return known, tuple(kept)


def needless_constant(fitted: Fit, constants: Sequence[FreeParameter]) -> FreeParameter | None:
    """The free constant that is nearest to its given value, in standard errors, if that is within chance."""
    std, values = fitted.std, fitted.values
    worth = [0.5 * ((values[one.name] - one.start) / max(std[one.name], _TINY)) ** 2 for one in constants]
    least = int(np.argmin(worth)) if constants else 0
    return constants[least] if constants and worth[least] < INDIFFERENT else None


def promising(base: Fit) -> Given:
    """The given constants of a fitted model each of which might explain something, and what they promise together."""
    constants = given_constants(base)
    if not constants:
        return Given((), 0.0)
    problem = replace(base.problem, free=(*at_optimum(base), *constants))
    point = np.concatenate([base.point, [one.coordinate(one.start) for one in constants]])
    steps = GaussNewtonSettings().difference * (problem.upper - problem.lower)
    expansion = expand(problem, point, steps)
    own = np.flatnonzero(~base.held)
    first = base.point.size

    def promised(rows: Sequence[int]) -> float:
        moving = [*own, *rows]
        gradient = expansion.gradient[moving, np.newaxis]
        return 0.5 * float(gradient[:, 0] @ solve(expansion.information[np.ix_(moving, moving)], gradient)[:, 0])

    alone = promised(())
    rows = [
        row for row in range(first, point.size) if OPTIMISM["smooth"] * (promised([row]) - alone) > INDIFFERENT
    ]  # fmt: skip
    together = promised(rows) - alone if rows else 0.0
    return Given(tuple(constants[row - first] for row in rows), together)


def given_constants(base: Fit) -> tuple[FreeParameter, ...]:
    """Parameters of a model that are not free in a fit, each with what is left open of it, two standard deviations.

    That is its declared tolerance, or ten percent. A parameter that is zero says that something is absent, one that is
    exact is no rival of a law, and one that the filter follows is no constant.
    """
    problem = base.problem
    known = {*problem.names, *problem.filter_model.appended}
    found = []
    for info, value in zip(problem.filter_model.model.parameters, base.theta, strict=True):
        share = TOLERANCE if info.tolerance is None else info.tolerance
        if info.name in known or not value * share or not np.isfinite(value):
            continue
        middle, reach = float(value), share * abs(float(value))
        found.append(FreeParameter(info.name, middle - reach, middle + reach, middle, middle, 0.5 * reach))
    return tuple(found)


def _with_free(fitted: Fit, constants: Sequence[FreeParameter], journal: Journal) -> Fit:
    """The fit with constants free, from where it is."""
    problem = replace(fitted.problem, free=(*at_optimum(fitted), *constants))
    return fit(problem, _ITERATIONS, _TOLERANCE, journal=journal)


def moved_text(fitted: Fit, constants: Sequence[FreeParameter]) -> str:
    """Words on the values of constants that were given, each with its change."""
    percent = {one.name: 100.0 * (fitted.values[one.name] / one.start - 1.0) for one in constants}
    return few([f"{name} = {value_text(fitted, name)} ({change:+.2g} %)" for name, change in percent.items()])
