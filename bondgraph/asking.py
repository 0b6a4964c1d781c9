"""The verb of the front door that asks what logs can say about parameters, before anything is estimated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypedDict, Unpack, overload

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.data.given import GivenLog
from bondgraph.errors import OptionError, require_kind
from bondgraph.estimate.derivatives.exact import derivatives
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.initial import Initial
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.likelihoods import LikelihoodFunction
from bondgraph.estimate.objective import Expand
from bondgraph.estimate.priors import Prior
from bondgraph.estimate.sensitivities import Sensitivity
from bondgraph.estimate.sensitivities import sensitivity as problem_sensitivity
from bondgraph.estimate.ties import Tie
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.robust import Robust
from bondgraph.simulate.model import Model
from bondgraph.verbs import pose


class Posed(TypedDict, total=False):
    """Keywords of a problem beside its model, logs and free parameters, see :func:`bondgraph.verbs.pose`."""

    initial: Initial
    likelihood: LikelihoodFunction | None
    ties: Mapping[str, str] | Tie | Sequence[Tie]
    priors: Prior | Sequence[Prior]
    process_noise: str
    columns: Mapping[str, str] | None
    constants: Mapping[str, float | str] | None
    robust: Robust | str | None


@overload
def sensitivity(model: Problem, point: FloatArray | None, /, *, jacobian: Expand = derivatives) -> Sensitivity: ...


@overload
def sensitivity(model: Problem, *, point: FloatArray | None = None, jacobian: Expand = derivatives) -> Sensitivity: ...


@overload
def sensitivity(
    model: Model | FilterModel,
    logs: GivenLog | Sequence[GivenLog],
    free: str | Sequence[str | FreeParameter] = (),
    *,
    point: FloatArray | None = None,
    jacobian: Expand = derivatives,
    **posed: Unpack[Posed],
) -> Sensitivity: ...


def sensitivity(
    model: Model | FilterModel | Problem,
    logs: Any = (),
    free: str | Sequence[str | FreeParameter] = (),
    *,
    point: FloatArray | None = None,
    jacobian: Expand = derivatives,
    **posed: Unpack[Posed],
) -> Sensitivity:
    """Information of logs about parameters, before anything is estimated.

    Parameters
    ----------
    model, logs, free
        As for :func:`bondgraph.verbs.estimate`: a model or filter model with its logs, or a posed problem alone. The
        times, inputs and gaps of the logs count, and where the model stands.
    point
        Coordinates of the problem, shape (n,), which may follow a posed problem directly; None: where searches start.
    jacobian
        Gives the information and the terms it comes from; by default exact derivatives where they repay.
    **posed
        What else :func:`bondgraph.verbs.pose` takes: ``ties``, ``priors``, ``columns``, ``constants`` and so on.

    Raises
    ------
    BondGraphError
        If a log does not fit the model, a name is unknown, or the model diverges there.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> time = np.arange(100) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 100)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> list(bg.sensitivity(pendulum(), log, ["length"], process_noise="none").to_dict()["parameters"])
    ['length', 'std(deflection)']
    """
    if not isinstance(model, Problem):
        require_kind("sensitivity", model, (Model, FilterModel), "model")
        return problem_sensitivity(pose(model, logs, free, **posed), point, jacobian)
    where = logs if isinstance(logs, np.ndarray) else None
    if free or posed or (where is None and logs is not None and len(logs)):
        raise OptionError(
            "sensitivity: a posed problem has its own logs, free parameters, ties and priors - give it alone"
        )
    return problem_sensitivity(model, where if point is None else point, jacobian)
