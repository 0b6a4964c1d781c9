"""Degrees of freedom of a Student t, from logs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Unpack

import numpy.typing as npt

from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import likelihood
from bondgraph.filter.members import MemberValues
from bondgraph.filter.robust import Robust
from bondgraph.filter.samples import MeasuredLog

#: Degrees between which they are looked for: the mean of fewer does not settle, more are a Gaussian.
_FEWEST, _MOST = 1.5, 100.0
#: Digits of the logarithm of the degrees; its own uncertainty in a log of a thousand samples is ten times that.
_CLOSE = 0.02


def with_likeliest_degrees(
    filter_model: FilterModel,
    logs: MeasuredLog | Sequence[MeasuredLog],
    theta: npt.ArrayLike | None = None,
    *,
    compiled: bool = True,
    **values: Unpack[MemberValues],
) -> FilterModel:
    """The filter model with a Student t of as many degrees of freedom as make logs most likely.

    Other numbers are held. They hardly depend on the degrees, since a Gaussian core keeps its width: an estimation with
    four degrees, this, and an estimation with what it finds are an estimation of all.

    Parameters
    ----------
    filter_model, logs, theta, compiled
        As for :func:`bondgraph.filter.likelihood.likelihood`, of one member.
    **values
        Other numbers of the member, see :class:`bondgraph.filter.members.MemberValues`.

    Raises
    ------
    FilterError, ModelError
        If logs or shapes do not fit the model.

    Examples
    --------
    >>> import numpy as np
    >>> from bondgraph.data.log import MatchedLog
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1})
    >>> time = np.arange(60) * 0.05
    >>> noise = 0.05 * np.random.default_rng(1).standard_t(2.0, (1, 60))
    >>> log = MatchedLog("swing", time, np.zeros((1, 60)), noise)
    >>> with_likeliest_degrees(swing, log, compiled=False).robust.value < 6.0
    True
    """
    from scipy.optimize import minimize_scalar  # here: only those who look for degrees load it

    def with_degrees(logarithm: float) -> FilterModel:
        return replace(filter_model, robust=Robust("student", math.exp(logarithm)))

    def cost(logarithm: float) -> float:
        return float(likelihood(with_degrees(logarithm), logs, theta, compiled=compiled, **values).nll[0])

    bounds = (math.log(_FEWEST), math.log(_MOST))
    found = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": _CLOSE})
    return with_degrees(float(found.x))
