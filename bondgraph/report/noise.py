"""What a report says of the noise that drives a model."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.otherwise import INDIFFERENT
from bondgraph.filter.filter_model import FilterModel
from bondgraph.text import few


def idle(fitted: Fit) -> list[str]:
    """States whose process noise is worth so little that all of it together tells nothing apart.

    Noise at its lower bound is none; a level with a wide interval may be hardly more.
    """
    problem = fitted.problem
    levels = [k for k, one in enumerate(problem.free) if one.target.kind == "process"]
    if not levels:
        return []
    quiet = np.repeat(fitted.point[:, np.newaxis], len(levels), axis=1)
    quiet[levels, np.arange(len(levels))] = problem.lower[levels]
    order = np.argsort(np.nan_to_num(problem.nll(quiet), nan=np.inf), kind="stable")
    together = np.repeat(fitted.point[:, np.newaxis], len(levels), axis=1)
    for count, k in enumerate(order):  # one more in each
        together[levels[k], count:] = problem.lower[levels[k]]
    lost = problem.nll(together) - fitted.nll
    enough = int(np.argmax(np.append(~(lost < INDIFFERENT), True)))
    return [problem.free[levels[k]].target.name for k in sorted(order[:enough])]


def noise_sentence(filter_model: FilterModel, idle: Collection[str] = ()) -> str:
    """Sentence on the states that process noise drives; ``idle`` are those whose noise is too little to matter.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> noise_sentence(FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {}))
    'Process noise drives rate'
    >>> noise_sentence(FilterModel(pendulum(), {}, {"deflection": 0.05}, {}))
    'Process noise drives no state: the model is taken as exact'
    >>> noise_sentence(FilterModel(pendulum(), {"rate": 1e-9}, {"deflection": 0.05}, {}), ["rate"])
    'Process noise drives no state noticeably'
    >>> noise_sentence(FilterModel(pendulum(), {"angle": 0.2, "rate": 1e-9}, {"deflection": 0.05}, {}), ["rate"])
    'Process noise drives angle; that of rate is too little to matter'
    """
    driven = ", ".join(name for name in filter_model.process_noise if name not in idle)
    if idle:
        little = f"{driven}; that of {few(list(idle))} is too little to matter"
        return f"Process noise drives {little if driven else 'no state noticeably'}"
    return f"Process noise drives {driven or 'no state: the model is taken as exact'}"
