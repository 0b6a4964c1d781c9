"""What a user gives an on-line filter: options, numbers and starts, inputs and measurements by name or as vectors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from bondgraph.arrays import BoolArray, FloatArray
from bondgraph.errors import FilterError, require_kind, suggest
from bondgraph.filter.adaptive import AdaptiveNoise
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.ukf import Member
from bondgraph.simulate.model import Model

if TYPE_CHECKING:
    from bondgraph.simulate.task import Vector


def check_options(
    filter_model: FilterModel, interval: float | None, history: float, adaptive: AdaptiveNoise | None
) -> None:
    """Refuse options of an on-line filter that cannot be met.

    Raises
    ------
    FilterError, OptionError
        With what to give instead.
    """
    require_kind("OnlineFilter", filter_model, FilterModel, "filter model")
    name = filter_model.model.name

    def require(condition: bool, problem: str, *where: str) -> None:
        if not condition:
            raise FilterError(f"{name}: {problem}", where=(name, *where))

    require(
        filter_model.method != "auto",
        "method 'auto' chooses along logs - choose one with choose_method(filter_model, logs) first", "method",
    )  # fmt: skip
    require(
        interval is None or (math.isfinite(interval) and interval > 0.0),
        f"interval is {interval!r} s - give a positive time", "interval",
    )  # fmt: skip
    require(math.isfinite(history) and history >= 0.0, f"history is {history!r} s - give a time from zero", "history")
    if adaptive is not None:
        require(interval is not None, "adaptive needs the interval between samples - give it", "interval")
        require(filter_model.robust is None, "adaptive with robust: outliers would be noise - choose one", "adaptive")
        require(
            not filter_model.measurement_correlation, "adaptive noises are independent - declare no correlation",
            "measurement_correlation",
        )  # fmt: skip


def given_member(filter_model: FilterModel, theta: Vector, x0: Vector) -> Member:
    """The numbers of a filter, with parameters and mean initial states by name or as vectors; None: declared.

    Raises
    ------
    FilterError, ModelError
        If a shape does not fit, or a name is unknown.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1})
    >>> given_member(swing, {"length": 2.0}, [0.1, 0.0]).theta[0]
    np.float64(2.0)
    """
    model = filter_model.model
    parameters = model.theta(**theta) if isinstance(theta, Mapping) else theta
    known = model.theta() if parameters is None else _vector(parameters)
    start = model.x0(known, **x0) if isinstance(x0, Mapping) else x0
    member = Member.of(filter_model, *(None if one is None else _vector(one) for one in (parameters, start)))
    _sized(member.theta, len(model.parameters), f"{model.name}: theta")
    _sized(member.x0, len(model.states), f"{model.name}: x0")
    return member


def given_inputs(model: Model, given: Vector, kept: FloatArray | None) -> FloatArray:
    """Inputs (n_u,) with those given in the place of those kept (n_u,), None: defaults.

    Raises
    ------
    FilterError, ModelError
        If a name is unknown, a shape does not fit, a value is not finite, or an input that is late is not given.
    """
    found = model.u0() if kept is None else kept.copy()
    if isinstance(given, Mapping):
        late = next((one for one in model.inputs if one.late_of and one.name not in given), None)
        if late is not None:
            raise FilterError(
                f"{model.name}: input {late.name!r} is {late.late_of!r} of {late.late_by:g} s before, which a filter "
                "on line does not remember - give it with every sample",
                where=(model.name, late.name),
            )
        for name, value in given.items():
            found[model.index("input", name)] = model.input_value(name, value)
    elif given is not None:
        found = _sized(_vector(given), found.size, f"{model.name}: u")
    finite = np.isfinite(found)
    if not finite.all():
        name = model.names("input")[int(np.argmin(finite))]
        raise FilterError(f"{model.name}: input {name!r} has no finite value - give one", where=(model.name, name))
    return found


def given_outputs(model: Model, noise_std: FloatArray, given: Vector) -> FloatArray:
    """Measurements (n_y,), NaN where missing, of sensors with standard deviations (n_y,).

    Raises
    ------
    FilterError
        If a name is unknown, a shape does not fit, a value is no number or infinite, or a channel is measured whose
        noise is not declared.
    """
    found = np.full(noise_std.size, np.nan)
    if isinstance(given, Mapping):
        names = model.names("output")
        for name, value in given.items():
            if name not in names:
                raise FilterError(
                    f"{model.name}: no output {name!r}{suggest(name, names)} - it has {', '.join(names)}",
                    where=(model.name, name),
                )
            found[names.index(name)] = _vector(value)
    elif given is not None:
        found = _sized(_vector(given), found.size, f"{model.name}: y")
    # one look at what is nearly always right: of a small model half of a sample's time went into looking
    infinite = np.isinf(found)
    wrong = infinite | (np.isnan(noise_std) & ~np.isnan(found))
    if wrong.any():
        raise _refused_output(model, found, infinite if infinite.any() else wrong)
    return found


def _refused_output(model: Model, found: FloatArray, wrong: BoolArray) -> FilterError:
    """The error of the first of the measurements (n_y,) that are wrong, to be raised."""
    row = int(np.argmax(wrong))
    name = model.names("output")[row]
    if np.isinf(found[row]):
        what = f"is {found[row]} - give a finite number, or NaN where it is missing"
    else:
        what = "is measured but measurement_noise does not name it - name it, or leave the channel out"
    return FilterError(f"{model.name}: output {name!r} {what}", where=(model.name, name))


def _sized(vector: FloatArray, size: int, what: str) -> FloatArray:
    if vector.shape != (size,):
        raise FilterError(
            f"{what} has shape {vector.shape}, not ({size},) - give one number each, or a mapping of names"
        )
    return vector


def _vector(given: object) -> FloatArray:
    try:
        return np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise FilterError(f"on-line filter: {given!r} is no number, or no vector of them - give numbers") from None
