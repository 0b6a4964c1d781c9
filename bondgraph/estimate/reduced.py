"""Problems with fewer free parameters: what another log, or a simulation without noise, can depend on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from bondgraph.estimate.free import Target, parse_target
from bondgraph.estimate.problem import EstimationProblem


def reduced(problem: EstimationProblem, keep: Callable[[Target], bool], **changes: Any) -> EstimationProblem:
    """The problem with some of its free and tied quantities, the others as its filter model declares them.

    Parameters
    ----------
    problem
        With ties and priors; those about quantities that are left out are left out, too.
    keep
        Which quantities stay. Free parameters that act through ties alone stay with their ties.
    changes
        Other fields of the new problem.

    Raises
    ------
    EstimationError
        If nothing that is free stays, or does not fit the changes.

    Examples
    --------
    >>> import numpy as np
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1})
    >>> log = bg.MatchedLog("swing", np.arange(9) * 0.05, np.zeros((1, 9)), np.zeros((1, 9)))
    >>> posed = bg.pose(swing, log, ["length", "std(deflection)"], ties={"damping": "0.1*length"})
    >>> silent = reduced(posed, lambda target: target.kind == "parameter")
    >>> silent.names, [tie.name for tie in silent.ties]
    (('length',), ['damping'])
    """
    ties = tuple(tie for tie in problem.ties if keep(parse_target(tie.name)))
    used = {name for tie in ties for name in tie.variables}
    free = tuple(one for one in problem.free if (one.name in used if problem.is_auxiliary(one) else keep(one.target)))
    known = {*(one.name for one in free), *(tie.name for tie in ties)}
    priors = tuple(prior for prior in problem.priors if known.issuperset(prior.names))
    return replace(problem, free=free, ties=ties, priors=priors, **changes)
