"""Widths: how sharply a law changes its sign is no part of what tells two laws apart.

Dry friction is smoothed around standstill over a width that its author chose. Where a machine changes over more
sharply, a law with more coefficients makes up for it: of a drive whose dry friction changed its sign over an eighth of
our width Stribeck friction was found, with p = 5e-29. So before a law with widths is chosen, it, those that do as well
and the simpler ones at its place are fitted with their widths free, each counted as one more parameter; of those that
do as well then the simplest is taken. A formula, whose width is fitted, is chosen only where a known law at its place
does worse at any width: a valve that opens over a tenth of our width was told as a function of another signal. An
exponent that differs from case to case is freed in the same way, that of convection between 5/4 and 4/3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bondgraph.correct.constants import INDIFFERENT, MOSTLY
from bondgraph.correct.evidence.certified import resolving, with_steps
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import judge
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.search.refit import refit_from
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.simulate.quantities import ParameterInfo

#: Shares of the declared width at which a search with a free width begins: what changes over more sharply is the rule.
_SHARES = (1.0, 0.3, 0.1, 3.0)
#: A width without bounds of its own is searched within these shares of the declared one.
_NARROWEST, _WIDEST = 1e-2, 10.0
_ITERATIONS, _TOLERANCE = 30, 0.05
#: Steps are made to resolve a width so often: each time it may have become narrower.
_ROUNDS = 3


def is_due(best: Trial, trials: Sequence[Trial], context: Context) -> bool:
    """True where widths are freed before a trial is chosen; of a stiff model where a simpler law may do as well.

    Before a formula is chosen, those of the known law at its place that comes nearest are.
    """
    if best.gate is not None or best.fit is None:
        return False
    if not best.candidate.effect.widths:
        return bool(_known(best, trials))
    return bool(_simpler(best, trials)) or not context.base.problem.filter_model.is_stiff


def at_any_width(best: Trial, trials: Sequence[Trial], context: Context) -> list[Trial]:
    """The trials, the best, its equals and the simpler ones at its place with free widths where these explain more.

    Of those that gain as much, to a few nats beyond their number of parameters, the simpler one is left as the best.
    Of a formula, the law of the dictionary that comes nearest to it.
    """
    done = list(trials)
    others = [*_simpler(best, trials), *_equals(best, trials)] if best.candidate.effect.widths else _known(best, trials)
    due = [k for k, one in enumerate(done) if one is best or any(one is other for other in others)]
    for k in due:
        if not done[k].candidate.effect.widths:
            continue
        freed = attempted(lambda one=done[k]: with_free_widths(one, context), lambda why: None)  # type: ignore[misc]
        if freed is not None and _worth(freed) > _worth(done[k]):
            done[k] = freed
    if not best.candidate.effect.widths:  # a known law is preferred to a formula in any case
        return done
    simplest = max(
        due, key=lambda k: (_worth(done[k]) > max(_worth(done[j]) for j in due) - INDIFFERENT, -_size(done[k]))
    )
    if _size(done[simplest]) < max(_size(done[k]) for k in due):
        label = done[simplest].candidate.label
        for k in due:
            if k != simplest and _worth(done[k]) > _worth(done[simplest]) - INDIFFERENT:
                done[k] = _behind(done[k], done[simplest], f"{label} does as well with a width of its own")
    return done


def _simpler(best: Trial, trials: Sequence[Trial]) -> list[Trial]:
    """Laws with widths and fewer parameters at the place of the best that promise something."""
    return [
        one
        for one in trials
        if one.candidate.place.label == best.candidate.place.label
        and one.gate is None
        and one.candidate.effect.widths
        and not one.candidate.effect.adds_state
        and len(one.candidate.effect.parameters) < len(best.candidate.effect.parameters)
        and (one.fit is not None or any(one.step))
    ]


def _equals(best: Trial, trials: Sequence[Trial]) -> list[Trial]:
    """Laws with widths at the place of the best that do as well."""
    return [one for one in _beside(best, trials) if _worth(one) > _worth(best) - INDIFFERENT]


def _beside(best: Trial, trials: Sequence[Trial]) -> list[Trial]:
    """Laws with widths at the place of the best, and in its regime, that were refitted."""
    own = best.candidate
    return [
        one
        for one in trials
        if (one.candidate.place.label, one.candidate.effect.regime) == (own.place.label, own.effect.regime)
        and one.gate is None
        and one.fit is not None
        and one.candidate.effect.widths
    ]


def _known(best: Trial, trials: Sequence[Trial]) -> list[Trial]:
    """The best law with a width at the place of a formula, if it explains most of what that does; none else."""
    if not best.candidate.effect.formula:
        return []
    laws = [one for one in _beside(best, trials) if not one.candidate.effect.formula]
    nearest = max(laws, key=_worth, default=None)
    return [] if nearest is None or _worth(nearest) <= MOSTLY * _worth(best) else [nearest]


def with_free_widths(trial: Trial, context: Context) -> Trial:
    """The trial refitted with its widths free, its steps short enough for the width that is found."""
    if trial.fit is None:
        trial = refit_from(trial, trial.step, context)
    assert trial.fit is not None and trial.built is not None  # it was refitted
    effect = trial.candidate.effect
    model = trial.built.model
    own = [_searched(model.parameters[model.index("parameter", name)]) for name in effect.widths]
    filter_model = replace(trial.fit.problem.filter_model, model=model)
    starts = [np.concatenate([trial.fit.point, [_begun(one, share) for one in own]]) for share in _SHARES]
    free = (*at_optimum(trial.fit), *own)
    problem = EstimationProblem(filter_model, context.train, free, context.base.problem.initial)
    fitted = fit(problem, _ITERATIONS, _TOLERANCE, starts, journal=context.journal)
    fitted = _resolved(fitted, context.base.problem.filter_model.substeps, context)
    base = with_steps(context.base, fitted.problem.filter_model, context.journal)
    effect = replace(effect, shapes=(*effect.shapes, *effect.widths), widths=())
    evidence = judge(base, fitted, effect, context.tried if trial.evidence is None else trial.evidence.tried)
    widths = ", ".join(f"{one.name} = {fitted.values[one.name]:.3g} instead of {one.start:.3g}" for one in own)
    remark = f"with {widths}"
    return replace(
        trial, candidate=replace(trial.candidate, effect=effect), fit=fitted, evidence=evidence,
        remark=f"{trial.remark}; {remark}" if trial.remark else remark,
    )  # fmt: skip


def _searched(width: ParameterInfo) -> FreeParameter:
    """A width as a free parameter, within its declared bounds if it has some."""
    lower = _NARROWEST * width.value if width.lower is None else width.lower
    upper = _WIDEST * width.value if width.upper is None else width.upper
    return FreeParameter(width.name, lower, upper, width.value, scale="log")


def _begun(width: FreeParameter, share: float) -> float:
    """The coordinate of a share of a width, inside its bounds."""
    return width.coordinate(min(max(share * width.start, width.lower), width.upper))


def _resolved(fitted: Fit, least: int, context: Context) -> Fit:
    """The fit with steps that resolve the width it ends with; ``least`` are those from which halvings are counted."""
    for _ in range(_ROUNDS):
        steps = resolving(fitted, least)
        if steps is fitted.problem.filter_model:
            break
        fitted = with_steps(fitted, steps, context.journal)
    return fitted


def _worth(trial: Trial) -> float:
    """Nats that a trial gains beyond the penalty for its parameters."""
    return -np.inf if trial.evidence is None else trial.evidence.bic_gain


def _size(trial: Trial) -> int:
    return len(trial.candidate.effect.parameters)


def _behind(trial: Trial, simplest: Trial, why: str) -> Trial:
    """The trial with less worth than the simplest, which explains as much."""
    assert trial.evidence is not None and simplest.evidence is not None  # both were fitted
    less = replace(trial.evidence, bic_gain=min(trial.evidence.bic_gain, simplest.evidence.bic_gain - INDIFFERENT))
    return replace(trial, evidence=less, remark=f"{trial.remark}; {why}" if trial.remark else why)
