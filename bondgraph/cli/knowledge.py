"""Options on parameters: which are free within which bounds, what is known of them, what ties them."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from bondgraph.cli.values import names
from bondgraph.coherent import Displayed
from bondgraph.data.log import MatchedLog
from bondgraph.errors import OptionError, suggest
from bondgraph.estimate.declared import declared_problem
from bondgraph.estimate.free import FreeParameter, Target, parse_target
from bondgraph.estimate.priors import LogNormal, Normal, Prior, Uniform
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.estimate.ties import Tie
from bondgraph.filter.filter_model import FilterModel
from bondgraph.simulate.model import Model
from bondgraph.text import few

#: Bounds above zero that span more than this factor are searched on a logarithmic scale, as declared ones are.
_WIDE = 20.0

_NUMBER = r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*"
_RANGE = re.compile(f"^{_NUMBER}:{_NUMBER}$")
_NORMAL = re.compile(rf"^{_NUMBER}\+-{_NUMBER}$")
_LOGNORMAL = re.compile(rf"^{_NUMBER}\*/{_NUMBER}$")


def posed(
    options: argparse.Namespace,
    model: Model,
    driven: Sequence[str],
    logs: Sequence[MatchedLog],
    known: FilterModel | None = None,
) -> EstimationProblem:
    """The estimation problem that the options of a command pose; noises from the logs, or those of a known filter.

    Raises
    ------
    OptionError
        If an option cannot be read.
    EstimationError
        If what it says does not fit the model or the logs.
    """
    ties = [read_tie(text) for text in options.tie]
    tied = [tie.name for tie in ties]
    free = [free_parameter(text, model) for text in names(options.free)]
    if not free and (tied or known is not None):
        free = [one.name for one in model.parameters if one.lower is not None and one.name not in tied]
    priors = [read_prior(text, model) for text in options.prior]
    if known is not None:
        return pose(known, logs, free, options.start, ties=ties, priors=priors)
    problem = declared_problem(model, driven, logs, free, options.process_noise, options.start)
    return replace(problem, ties=tuple(ties), priors=tuple(priors)) if ties or priors else problem


def free_parameter(text: str, model: Model) -> str | FreeParameter:
    """A name, or ``name=lower:upper`` in the unit in which it is shown.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> found = free_parameter("length=0.5:2", pendulum())
    >>> found.lower, found.start, found.upper
    (0.5, 1.0, 2.0)
    """
    name, equals, bounds = (part.strip() for part in text.partition("="))
    if not equals:
        return name
    found = _RANGE.match(bounds)
    if found is None:
        raise OptionError(f"--free {text}: write it as name or name=lower:upper, m=800:1600", where=("--free", text))
    target = parse_target(name)
    coherent = _quantity(target, name, model, "--free").coherent
    lower, upper = (coherent(float(end)) for end in found.groups())
    wide = lower > 0.0 and upper / lower > _WIDE
    middle = math.sqrt(lower * upper) if wide else 0.5 * (lower + upper)
    start = model.parameters[model.index("parameter", target.name)].value if target.kind == "parameter" else middle
    start = start if lower <= start <= upper else middle
    return FreeParameter(name, lower, upper, start, scale="log" if wide else "linear")


def read_prior(text: str, model: Model) -> Prior:
    """A distribution in the unit in which a parameter is shown.

    ``m=1200+-50`` is normal with a standard deviation, ``k=1e5*/1.5`` lognormal with a median and the factor of one
    standard deviation, ``eta=0.8:0.95`` uniform.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> read_prior("length=1.2+-0.1", pendulum())
    Normal(name='length', mean=1.2, std=0.1)
    """
    name, _, said = (part.strip() for part in text.partition("="))
    for pattern, make in _DISTRIBUTIONS:
        found = pattern.match(said)
        if found is not None:
            quantity = _quantity(parse_target(name), name, model, "--prior")
            return make(name, float(found[1]), float(found[2]), quantity)
    raise OptionError(
        f"--prior {text}: write it as name=mean+-std, name=median*/factor or name=lower:upper, m=1200+-50",
        where=("--prior", text),
    )


def _lognormal(name: str, median: float, factor: float, shown: Displayed) -> Prior:
    if not factor > 1.0:
        raise OptionError(f"--prior {name}: the factor {factor:g} must be above one", where=("--prior", name))
    return LogNormal(name, shown.coherent(median), math.log(factor))


#: Forms of a prior, with what makes it of name, both numbers and the quantity in whose unit they are.
_DISTRIBUTIONS: tuple[tuple[re.Pattern[str], Callable[[str, float, float, Displayed], Prior]], ...] = (
    (_NORMAL, lambda name, a, b, shown: Normal(name, shown.coherent(a), shown.coherent(b))),
    (_LOGNORMAL, _lognormal),
    (_RANGE, lambda name, a, b, shown: Uniform(name, shown.coherent(a), shown.coherent(b))),
)


def read_tie(text: str) -> Tie:
    """A tie, ``k_r=1.2*k_f``, in coherent SI.

    Examples
    --------
    >>> read_tie("k_r = 1.2*k_f")
    Tie(name='k_r', expression='1.2*k_f')
    """
    name, equals, expression = (part.strip() for part in text.partition("="))
    if not equals or not name or not expression:
        raise OptionError(f"--tie {text}: write it as name=expression, k_r=1.2*k_f", where=("--tie", text))
    return Tie(name, expression)


def _quantity(target: Target, name: str, model: Model, option: str) -> Displayed:
    kind, infos = (
        ("parameter", model.parameters) if target.kind == "parameter"
        else ("output", model.outputs) if target.kind == "std" else ("state", model.states)
    )  # fmt: skip
    known: dict[str, Displayed] = {one.name: one for one in infos}
    if target.name not in known:
        raise OptionError(
            f"{option} {name}: {model.name} has no {kind} {target.name!r}{suggest(target.name, tuple(known))}"
            f" - it has {few(tuple(known))}",
            where=(option, name),
        )
    return known[target.name]


def with_values(logs: Sequence[MatchedLog], model: Model, given: dict[str, float | str]) -> list[MatchedLog]:
    """Logs that know the values of ``--set`` for parameters of a generated module.

    Raises
    ------
    OptionError
        If a value is a letter.
    """
    values = {}
    for info in (one for one in model.parameters if one.name in given):
        value = given[info.name]
        if not isinstance(value, float) or not np.isfinite(value):
            raise OptionError(f"--set {info.name}={value}: a parameter needs a number", where=("--set", info.name))
        values[info.name] = info.coherent(value)
    return [replace(log, theta_overrides={**values, **log.theta_overrides}) for log in logs]
