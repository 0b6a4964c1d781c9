"""The second look at steps: a candidate that passed is judged again with steps that resolve its own model too."""

from __future__ import annotations

from dataclasses import replace

from bondgraph.correct.evidence.certified import resolving, with_steps
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.decide import judge
from bondgraph.correct.evidence.trials import Trial


def resolved(trial: Trial, context: Context) -> Trial:
    """The trial with its gain at steps that resolve it, against the fit without it at the same steps.

    The fit without it is certified before anything is scored; an effect may make a model faster (a soft shaft, dry
    friction), or have gained by making up for steps that were not short enough for it.
    """
    if trial.fit is None or trial.evidence is None:
        return trial
    steps = resolving(trial.fit, context.substeps)
    if steps is trial.fit.problem.filter_model:
        return trial
    fitted, base = (with_steps(one, steps, context.journal) for one in (trial.fit, context.base))
    evidence = judge(base, fitted, trial.candidate.effect, trial.evidence.tried, trial.gate is not None)
    sure = replace(evidence, p_robust=max(evidence.p_robust, trial.evidence.p_robust))
    said = f"with {steps.substeps} integration steps between samples it gains {sure.delta_nll:.1f} nats instead of"
    remark = f"{said} {trial.evidence.delta_nll:.1f}"
    return replace(trial, fit=fitted, evidence=sure, remark=f"{trial.remark}; {remark}" if trial.remark else remark)
