"""Free parameters: what an estimation may move, by name, within bounds.

A name is that of a model parameter, or ``std(output)`` for the standard deviation of a measured output,
``process(state)`` for that of the noise that drives a state or a followed parameter, ``x0(state)`` for an initial state
shared by all logs, or ``x0(state, log)`` for that of one log. ``parameter(log)`` is a parameter in one log of a joint
problem, such as a payload (:mod:`bondgraph.estimate.joint`). ``x0_std(state)`` is the uncertainty of an initial state;
``corr(output, output)``, ``process_corr(state, state)`` and ``x0_corr(state, state)`` are correlations of two noises.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError, suggest
from bondgraph.estimate.noise_bounds import process_bounds, sensor_bounds, sensor_rounding
from bondgraph.estimate.objective import FloatArray
from bondgraph.estimate.transforms import TRANSFORMS, Scale, Transform
from bondgraph.filter.filter_model import FilterModel
from bondgraph.text import few

Kind = Literal["parameter", "std", "process", "x0", "x0_std", "corr", "process_corr", "x0_corr"]

_CALL = re.compile(r"^(std|process_corr|process|x0_std|x0_corr|x0|corr)\((.+)\)$")
_OF_LOG = re.compile(r"^(\w+)\((.+)\)$")

#: Which names each kind takes, and the word for them.
_NAMED: dict[Kind, tuple[Literal["state", "parameter", "output"], str]] = {
    "parameter": ("parameter", "parameter"), "std": ("output", "output"), "process": ("state", "state"),
    "x0": ("state", "state"), "x0_std": ("state", "state"), "corr": ("output", "output"),
    "process_corr": ("state", "state"), "x0_corr": ("state", "state"),
}  # fmt: skip

#: Correlations are searched up to here: beyond, two noises are one, and their covariance has no inverse.
_CORRELATED = 0.999

#: Bounds that span more than this factor, all above zero, are searched on a logarithmic scale.
_WIDE = 20.0
#: Noise levels are searched within this factor of their declared value where no log bounds them, and down to it where
#: the log's own bound is higher.
_NOISE_SPAN = 100.0
#: Initial states are searched within this many of the filter's initial standard deviations.
_INITIAL_SPAN = 6.0


@dataclass(frozen=True)
class Target:
    """What a name stands for: a kind, the parameter, output or state, and the log if it is for one only.

    ``other`` is the second of two that are correlated.
    """

    kind: Kind
    name: str
    log: str | None = None
    other: str | None = None


def parse_target(name: str) -> Target:
    """What the name of a free parameter stands for.

    Examples
    --------
    >>> parse_target("std(speed)"), parse_target("x0(speed, run7)").log
    (Target(kind='std', name='speed', log=None, other=None), 'run7')
    >>> parse_target("mass(run7)")
    Target(kind='parameter', name='mass', log='run7', other=None)
    """
    match = _CALL.match(name.strip())
    if match is None:
        own = _OF_LOG.match(name.strip())
        return Target("parameter", name.strip()) if own is None else Target("parameter", own[1], own[2].strip())
    kind, inner = match.groups()
    if kind == "x0":
        state, _, log = inner.partition(",")
        return Target("x0", state.strip(), log.strip() or None)
    if kind.endswith("corr"):
        first, _, second = inner.partition(",")
        return Target(kind, first.strip(), None, second.strip())  # type: ignore[arg-type]
    return Target(kind, inner.strip())  # type: ignore[arg-type]


@dataclass(frozen=True)
class FreeParameter:
    """One quantity to estimate, in the unit of the model.

    Parameters
    ----------
    name
        See the module's first lines.
    lower, upper
        Bounds; the estimate never leaves them.
    start
        Where a search starts.
    prior_mean, prior_std
        Gaussian knowledge from elsewhere (a data sheet); both or neither.
    scale
        ``"log"`` searches the logarithm, for quantities known to an order of magnitude; bounds must be positive.
        ``"logit"`` searches the logit of the share of the way between the bounds, for efficiencies and shares.
    widens
        The bounds only scale a search, but for one at zero: a search that ends on one goes on beyond it.

    Raises
    ------
    EstimationError
        If the numbers contradict each other.

    Examples
    --------
    >>> FreeParameter("mass", 200.0, 320.0, 260.0).coordinate(300.0)
    300.0
    """

    name: str
    lower: float
    upper: float
    start: float
    prior_mean: float | None = None
    prior_std: float | None = None
    scale: Scale = "linear"
    widens: bool = False

    def __post_init__(self) -> None:
        def require(condition: bool, problem: str) -> None:
            if not condition:
                raise EstimationError(f"free parameter {self.name!r}: {problem}", where=(self.name,))

        bounds = f"{self.lower:.6g} to {self.upper:.6g}"
        finite = math.isfinite(self.lower) and math.isfinite(self.upper)
        require(finite and self.lower < self.upper, f"bounds {bounds} must be two finite numbers, the lower first")
        inside = self.lower <= self.start <= self.upper
        require(inside, f"start {self.start:.6g} lies outside its bounds {bounds} - move either")
        require(self.scale in TRANSFORMS, f"scale {self.scale!r} is none of {', '.join(TRANSFORMS)}")
        require(self.scale != "log" or self.lower > 0.0, f"a logarithmic scale needs bounds above zero, not {bounds}")
        both = (self.prior_mean is None) == (self.prior_std is None)
        require(both, "a prior needs both its mean and its standard deviation")
        require(self.prior_std is None or self.prior_std > 0.0, f"prior_std {self.prior_std} must be above zero")

    @cached_property
    def target(self) -> Target:
        """What the name stands for."""
        return parse_target(self.name)

    @property
    def transform(self) -> Transform:
        """Between values and coordinates."""
        return TRANSFORMS[self.scale]

    def coordinate(self, value: float) -> float:
        """The coordinate that searches move: the value, its logarithm or its logit."""
        return self.transform.coordinate(value, self.lower, self.upper)

    def slope(self, value: float) -> float:
        """Derivative of the value with respect to its coordinate."""
        return self.transform.slope(value, self.lower, self.upper)

    def bend(self, value: float) -> float:
        """Second derivative of the value with respect to its coordinate."""
        return self.transform.bend(value, self.lower, self.upper)

    def wider(self, factor: float) -> FreeParameter:
        """The same with bounds further from zero by a factor; zero and a positive lower bound stay.

        Examples
        --------
        >>> loss = FreeParameter("loss", 0.0, 0.1, 0.1, widens=True).wider(10.0)
        >>> loss.lower, loss.upper, loss.start
        (0.0, 1.0, 0.1)
        """
        return replace(self, lower=min(factor * self.lower, self.lower), upper=max(factor * self.upper, self.upper))

    def values(self, coordinates: FloatArray) -> FloatArray:
        """Values at coordinates of any shape; the coordinate of a bound gives that bound to the last digit."""
        return self.transform.values(coordinates, self.lower, self.upper)


def declared_free(
    name: str,
    filter_model: FilterModel,
    start: float | None = None,
    logs: Sequence[MatchedLog] = (),
    theta: FloatArray | None = None,
) -> FreeParameter:
    """A free parameter with the bounds that the model declares, a noise level with those that logs show.

    Parameters
    ----------
    name
        See the module's first lines.
    filter_model
        Declares bounds and values of parameters, noise levels and initial uncertainties; initial states are searched
        within six standard deviations.
    start
        Where to start instead of the declared value.
    logs
        Matched logs, whose range bounds noise levels, see :mod:`bondgraph.estimate.noise_bounds`; without them a level
        is searched within a factor of 100.
    theta
        Parameters, shape (n_theta,), at which the model shows its states; None: the declared ones. The coefficient of
        an added effect is declared as zero, so that no sensor shows the effect's own state there.

    Raises
    ------
    EstimationError
        If there is no such quantity, or nothing bounds it.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1})
    >>> level = declared_free("std(deflection)", swing)
    >>> level.lower, level.start, level.upper, level.scale
    (0.0002, 0.02, 2.0, 'log')
    """
    target = parse_target(name)
    require_known(target, name, filter_model)
    if target.kind == "parameter":
        return _declared_parameter(name, filter_model, start)
    if target.kind == "x0":
        return _declared_initial(name, target, filter_model, start)
    if target.other is not None:
        return _declared_correlation(name, target, filter_model, start)
    shown = _shown_bounds(target, filter_model, logs, filter_model.model.theta() if theta is None else theta)
    level = _declared_level(name, target, filter_model, start, shown)
    if target.kind != "std" or not logs:
        return level
    rounding = sensor_rounding(logs, filter_model.model.index("output", target.name))
    return replace(level, lower=max(level.lower, min(level.start, rounding)))


def _declared_level(
    name: str, target: Target, filter_model: FilterModel, start: float | None, shown: tuple[float, float] | None
) -> FreeParameter:
    groups = {
        "std": filter_model.measurement_noise, "process": {**filter_model.process_noise, **filter_model.appended},
        "x0_std": filter_model.initial_std,
    }  # fmt: skip
    level = groups[target.kind].get(target.name, 0.0) if start is None else start
    if level <= 0.0 and shown is None:
        raise EstimationError(
            f"free parameter {name!r}: the filter model declares no such noise, and no log bounds it"
            " - declare its level, or give a FreeParameter with bounds",
            where=(name,),
        )
    lower, upper = shown or (level / _NOISE_SPAN, level * _NOISE_SPAN)
    if level <= 0.0:
        level = math.sqrt(lower * upper)
    lower = min(lower, level / _NOISE_SPAN)
    return FreeParameter(name, lower, max(upper, level), level, scale="log")


def _shown_bounds(
    target: Target, filter_model: FilterModel, logs: Sequence[MatchedLog], theta: FloatArray
) -> tuple[float, float] | None:
    model = filter_model.model
    if not logs or target.kind == "x0_std" or target.name in filter_model.appended:
        return None
    if target.kind == "std":
        return sensor_bounds(logs, model.index("output", target.name))
    return process_bounds(model, logs, theta, model.index("state", target.name))


def _declared_correlation(name: str, target: Target, filter_model: FilterModel, start: float | None) -> FreeParameter:
    declared = {
        "corr": filter_model.measurement_correlation, "process_corr": filter_model.process_correlation,
        "x0_corr": filter_model.initial_correlation,
    }[target.kind]  # fmt: skip
    pairs = ((target.name, target.other or ""), (target.other or "", target.name))
    value = next((declared[pair] for pair in pairs if pair in declared), 0.0) if start is None else start
    return FreeParameter(name, -_CORRELATED, _CORRELATED, value)


def _declared_parameter(name: str, filter_model: FilterModel, start: float | None) -> FreeParameter:
    model = filter_model.model
    info = model.parameters[model.index("parameter", name.strip())]
    if info.lower is None or info.upper is None:
        bounded = [other.name for other in model.parameters if other.lower is not None]
        raise EstimationError(
            f"free parameter {name!r}: {model.name} declares no bounds for it, so it counts as measured and stays fixed"
            f" - free it within bounds, --free {info.name}=LOWER:UPPER, declare them, or free one of {few(bounded)}",
            where=(name,),
        )
    scale: Scale = "log" if info.lower > 0.0 and info.upper / info.lower > _WIDE else "linear"
    return FreeParameter(info.name, info.lower, info.upper, info.value if start is None else start, scale=scale)


def _declared_initial(name: str, target: Target, filter_model: FilterModel, start: float | None) -> FreeParameter:
    model = filter_model.model
    reach = _INITIAL_SPAN * filter_model.initial_std.get(target.name, 0.0)
    if reach <= 0.0:
        raise EstimationError(
            f"free parameter {name!r}: the filter model gives this state no initial uncertainty, so nothing bounds it"
            " - declare its initial_std, or give a FreeParameter with bounds",
            where=(name,),
        )
    middle = model.states[model.index("state", target.name)].initial if start is None else start
    return FreeParameter(name, middle - reach, middle + reach, middle)


def require_known(target: Target, name: str, filter_model: FilterModel) -> None:
    """Refuse a name that the model does not have.

    Raises
    ------
    EstimationError
        With the closest name there is.
    """
    model = filter_model.model
    kind, word = _NAMED[target.kind]
    # a parameter that is followed as a state has the noises of one
    followed = target.kind in ("process", "x0_std", "process_corr", "x0_corr")
    known = filter_model.state_names if followed else model.names(kind)
    for part in (target.name, *(() if target.other is None else (target.other,))):
        if part not in known:
            raise EstimationError(
                f"free parameter {name!r}: {model.name} has no {word} {part!r}{suggest(part, known)}"
                f" - it has {', '.join(known)}",
                where=(name,),
            )
    if target.name == target.other:
        raise EstimationError(f"free parameter {name!r}: names {target.name!r} twice - name two", where=(name,))
