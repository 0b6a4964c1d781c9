"""Gauge of what logs tell only together: one of such parameters is held at its declared value.

Where all that is given and all that is measured are speeds, a mass, a stiffness and a damping have a common scale that
no log shows. A fit leaves them anywhere, on a bound too, and of a law beside them it tells a coefficient whose interval
holds zero. Declared values are what is known of the scale: the parameter with the narrowest bounds stays at its own,
and all else, with its interval, is told beside that. It is held only where it costs less than a parameter is worth by
Akaike's criterion: Akaike (1974), IEEE Transactions on Automatic Control 19(6).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.correct.models.failures import attempted
from bondgraph.data.log import FloatArray
from bondgraph.estimate.analysis.combinations import Combination, combinations
from bondgraph.estimate.fitted import Fit, standard_deviations
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.text import number

#: Condition index from which a direction is open to rounding: derivatives by differences are right to the sixth digit.
_OPEN = 1e6
#: Nats that a free parameter must be worth: Akaike's criterion has two of twice the likelihood.
_WORTH = 1.0
#: Standard deviation, as a share of the way from bound to bound, from which logs say next to nothing of a parameter:
#: bounds alone, with all between them alike, tell it as well (one over the root of twelve).
_UNKNOWN = 0.3
#: Logarithm of the largest factor by which a start moves, what rounding leaves of one: bounds are nearer.
_FURTHEST = -math.log(float(np.finfo(float).eps))


@dataclass(frozen=True)
class Held:
    """A parameter at its declared value, with what acts only together with it."""

    name: str
    value: str
    group: Combination

    def __str__(self) -> str:
        return (
            f"in these logs {self.group}: {self.name} is taken as declared, {self.value}, and the others, with their "
            "intervals, are told beside it - measure one of them, or drive so that they act apart"
        )


def unknown(fitted: Fit) -> tuple[str, ...]:
    """Names of the free parameters of a model of which the logs say next to nothing."""
    std, problem = fitted.std, fitted.problem
    spans = dict(zip(problem.names, problem.upper - problem.lower, strict=True))
    own = [one.name for one in problem.free if one.target.kind == "parameter"]
    return tuple(name for name in own if std[name] > _UNKNOWN * spans[name])


def told_together(fitted: Fit, little: Collection[str], least: int = 1) -> tuple[Combination, ...]:
    """Groups of free parameters of which the logs tell combinations alone; none where that cannot be computed.

    They are open to rounding, or have at least as many members of which the logs tell ``little``.
    """
    information = fitted.expansion.information

    def wanted(names: Sequence[str], condition: float) -> bool:
        return condition > _OPEN or len(set(names).intersection(little)) >= least

    found: tuple[Combination, ...] = attempted(
        lambda: combinations(fitted.problem, fitted.point, information, wanted), lambda why: ()
    )
    return tuple(one for one in found if one.together)


def with_gauge(fitted: Fit, refit: Callable[[EstimationProblem, FloatArray], Fit]) -> tuple[Fit, tuple[Held, ...]]:
    """The fit with one parameter held of each that logs tell only together, and these parameters.

    ``refit`` searches a problem from a point (n,).
    """
    held: list[Held] = []
    # a machine has one scale of its efforts to its flows, and starts say something of that alone
    while (found := _held(fitted, refit, 0 if held else _starts(fitted.problem))) is not None:
        fitted, one = found
        held.append(one)
    return fitted, tuple(held)


def _held(fitted: Fit, refit: Callable[[EstimationProblem, FloatArray], Fit], starts: int) -> tuple[Fit, Held] | None:
    """The fit with one more parameter held; None where the logs tell all of them, or more than its declared value.

    ``starts``: number of assumed starts that say something of it.
    """
    problem, model = fitted.problem, fitted.problem.filter_model.model
    little = set(_open(fitted, starts))
    for group in told_together(fitted, little):
        open_ = set(group.names) if group.condition > _OPEN else little.intersection(group.names)
        for one in sorted((one for one in problem.free if one.name in open_), key=_width):
            at = model.index("parameter", one.name)
            info, declared, value = model.parameters[at], float(model.theta()[at]), fitted.values[one.name]
            if not declared * value > 0.0:
                continue
            posed, start = _without(problem, one), _beside(fitted, one, declared)
            other = attempted(lambda p=posed, s=start: refit(p, s), lambda why: None)  # type: ignore[misc]
            worth = _WORTH + starts * abs(math.log(declared / value))
            if other is not None and other.nll < fitted.nll + worth:
                unit = f" {info.display_unit}" if info.display_unit not in ("", "1") else ""
                return other, Held(one.name, f"{number(float(info.shown(declared)))}{unit}", group)
    return None


def _open(fitted: Fit, starts: int) -> tuple[str, ...]:
    """Names of the free parameters whose scale logs tell no better than bounds do, and starts as they are assumed.

    A filter takes states to begin with given standard deviations, which do not move with the scale of a machine. Of
    that scale each of them tells as much as a sample tells of the standard deviation that it was drawn with: an
    information of two in its logarithm, and as many nats as the logarithm has moved.
    """
    problem, std = fitted.problem, standard_deviations(fitted.expansion)
    found = []
    for one, deviation, value in zip(problem.free, std, problem.values(fitted.point), strict=True):
        if one.target.kind != "parameter" or value == 0.0:
            continue
        relative = deviation / abs(value / one.slope(value))
        span = math.log(one.upper / one.lower) if one.lower > 0.0 else (one.upper - one.lower) / abs(value)
        if relative**-2 < (_UNKNOWN * span) ** -2 + 2.0 * starts:
            found.append(one.name)
    return tuple(found)


def _starts(problem: EstimationProblem) -> int:
    """Number of states whose starts are assumed, in all logs."""
    return len(problem.logs) * len(problem.filter_model.model.states)


def _without(problem: EstimationProblem, held: FreeParameter) -> EstimationProblem:
    return replace(problem, free=tuple(one for one in problem.free if one is not held))


def _width(parameter: FreeParameter) -> float:
    """Width of the bounds of a parameter, relative to its size."""
    return (parameter.upper - parameter.lower) / max(abs(parameter.upper), abs(parameter.lower))


def _beside(fitted: Fit, held: FreeParameter, declared: float) -> FloatArray:
    """Coordinates of the others (n - 1,) where one of them goes to its declared value, all in their logarithms."""
    problem, values = fitted.problem, fitted.problem.values(fitted.point)
    slopes = np.array([one.slope(value) for one, value in zip(problem.free, values, strict=True)])
    factor = np.where(values != 0.0, values / slopes, 1.0)  # derivative of a coordinate by the logarithm of its value
    relative = fitted.expansion.information * np.outer(factor, factor)
    own = np.array([one is held for one in problem.free])
    moves = -np.linalg.lstsq(relative[np.ix_(~own, ~own)], relative[np.ix_(~own, own)][:, 0])[0]
    shifts = np.clip(moves * math.log(declared / float(values[own][0])), -_FURTHEST, _FURTHEST)
    moved = values[~own] * np.exp(shifts)
    free = [one for one in problem.free if one is not held]
    inside = [min(max(float(x), one.lower), one.upper) for x, one in zip(moved, free, strict=True)]
    return np.array([one.coordinate(x) for x, one in zip(inside, free, strict=True)])
