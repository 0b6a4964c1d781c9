"""Bounds of parameters as rivals of a law: a parameter beyond its declared bound may explain as much.

Bounds are what somebody took for possible. Of a sled whose guide was declared to rub with 2 N s/m at least, and rubs
with half of that, a constant push gained 470 nats and passed every test: it only made that bound smaller beside the
rest. So the fit without a law is looked for once more with wider bounds where its parameters rest on them, and what a
law gains beyond that must pass the tests.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bondgraph.correct.constants import OPTIMISM
from bondgraph.correct.evidence.certified import with_steps
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import judge
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.scores.score import solve
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.local import fit
from bondgraph.text import few, number

#: Factor by which a bound moves: beyond an order of magnitude it was not merely chosen too narrow. A convention.
_FURTHER = 10.0
_ITERATIONS, _TOLERANCE = 40, 0.05


def beyond_bounds(trial: Trial, context: Context) -> Trial:
    """The trial; not passing, and with a remark, where parameters beyond their declared bounds explain as much."""
    if trial.fit is None or trial.evidence is None or trial.gate is not None:
        return trial
    freed = _freed(context.base)
    if not freed or OPTIMISM["smooth"] * _promised(context.base, freed) < trial.evidence.delta_nll:
        return trial
    base = _with_bounds(with_steps(context.base, trial.fit.problem.filter_model, context.journal), freed, context)
    if _passes(base, trial.fit, trial, context):
        return trial
    if _passes(base, _with_bounds(trial.fit, freed, context), trial, context):
        return trial
    moved = few([f"{name} = {value_text(base, name)}" for name in freed])
    gained = context.base.nll - base.nll
    return replace(
        trial, evidence=replace(trial.evidence, p_robust=1.0),
        remark=f"{moved}, beyond the declared bounds, {'explains' if len(freed) == 1 else 'explain'} {gained:.1f} nats "
        "without it",
    )  # fmt: skip


def _freed(base: Fit) -> dict[str, FreeParameter]:
    """The parameters of a model that rest on bounds beyond which there is something, with wider bounds, by name."""
    return {
        one.name: wider
        for one, rests in zip(at_optimum(base), base.held, strict=True)
        if rests and one.target.kind == "parameter"
        for wider in (_wider(one),)
        if wider is not None
    }


def _wider(one: FreeParameter) -> FreeParameter | None:
    """A parameter with the bound that it starts at moved; none beyond zero, where it would change its sign."""
    at_upper = one.upper - one.start < one.start - one.lower
    bound = one.upper if at_upper else one.lower
    if bound == 0.0:
        return None
    moved = bound * _FURTHER if (bound > 0.0) == at_upper else bound / _FURTHER
    return replace(one, upper=moved) if at_upper else replace(one, lower=moved)


def _promised(base: Fit, freed: dict[str, FreeParameter]) -> float:
    """Nats that a step of all parameters promises with these free, by the quadratic expansion of the fit."""
    moving = ~base.held | np.isin(base.problem.names, list(freed))
    gradient = base.expansion.gradient[moving, np.newaxis]
    return 0.5 * float(gradient[:, 0] @ solve(base.expansion.information[np.ix_(moving, moving)], gradient)[:, 0])


def _with_bounds(fitted: Fit, freed: dict[str, FreeParameter], context: Context) -> Fit:
    """The fit with wider bounds of some parameters, from where it is."""
    free = tuple(replace(freed[one.name], start=one.start) if one.name in freed else one for one in at_optimum(fitted))
    found = fit(replace(fitted.problem, free=free), _ITERATIONS, _TOLERANCE, journal=context.journal)
    return found if found.nll < fitted.nll else fitted


def _passes(base: Fit, refit: Fit, trial: Trial, context: Context) -> bool:
    assert trial.evidence is not None  # it was judged
    return judge(base, refit, trial.candidate.effect, trial.evidence.tried).accepted(context.level)


def value_text(fitted: Fit, name: str) -> str:
    """The value of a parameter in the unit in which it was declared."""
    model = fitted.problem.filter_model.model
    info = model.parameters[model.index("parameter", name)]
    unit = "" if info.display_unit in ("", "1") else f" {info.display_unit}"
    return f"{number(info.shown(fitted.values[name]))}{unit}"
