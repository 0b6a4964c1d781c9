"""What is to be simulated: the arguments of the public functions, checked and brought into one form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import FloatArray
from bondgraph.data.band_limited import is_even
from bondgraph.data.given import GivenLog, as_read, is_table
from bondgraph.data.log import Log, MatchedLog
from bondgraph.data.matching import match_recorded
from bondgraph.errors import ModelError, OptionError, require_kind
from bondgraph.simulate.inputs import InputSignal, limited_rows
from bondgraph.simulate.model import Model
from bondgraph.text import inflected

#: Inputs as a signal, by name, as an array (n_u, n), or None for the defaults.
GivenInputs = InputSignal | Mapping[str, float | str | npt.ArrayLike] | npt.ArrayLike | None

#: The same, or as a log holds them.
Inputs = GivenLog | GivenInputs

#: A vector by name (the rest as declared), as an array, or None for the declared values.
Vector = Mapping[str, float] | npt.ArrayLike | None


@dataclass(frozen=True)
class Task:
    """A model with its inputs over ``times`` (n,), parameters and initial state (rows, or rows x members)."""

    model: Model
    times: FloatArray
    signal: InputSignal
    theta: FloatArray
    x0: FloatArray

    @classmethod
    def of(cls, model: Model, time: npt.ArrayLike | None, inputs: Inputs, theta: Vector, x0: Vector) -> Task:
        """Check the arguments of a simulation.

        Raises
        ------
        ModelError
            If times do not increase, a name is unknown or a shape does not fit.
        """
        require_kind("simulate", model, Model, "model")
        if isinstance(time, Log | MatchedLog) and inputs is None:
            raise OptionError("simulate: a log was given as times - give it by name, inputs=log", where=("time",))
        if isinstance(inputs, str | Path) or is_table(inputs):
            inputs = as_read(inputs, "inputs")
        if isinstance(inputs, Log | MatchedLog):
            time = inputs.time if time is None else time
            inputs, known = _recorded(model, inputs)
            theta = {**known, **(theta or {})} if theta is None or isinstance(theta, Mapping) else theta
        if time is None:
            raise ModelError(
                f"{model.name}: no times are given - give time, or inputs as a log, whose times are taken",
                where=(model.name, "time"),
            )
        times = np.array(time, dtype=np.float64)
        if times.ndim != 1 or times.size == 0 or not np.isfinite(times).all() or np.any(np.diff(times) <= 0):
            raise ModelError(f"{model.name}: times must be a vector of finite, increasing numbers", where=(model.name,))
        signal = as_signal(model, times, inputs)
        parameters = as_vector(model, "parameter", theta)
        if x0 is None or isinstance(x0, Mapping):
            return cls(model, times, signal, parameters, model.x0(parameters, **(x0 or {})))
        return cls(model, times, signal, parameters, as_vector(model, "state", x0))


def _recorded(model: Model, log: Log | MatchedLog) -> tuple[InputSignal, Mapping[str, float]]:
    """The inputs in a log, and the parameters that it knows."""
    u, known = (log.u, log.theta_overrides) if isinstance(log, MatchedLog) else match_recorded(log, model)
    limited = [model.names("input")[row] for row in limited_rows(model)]
    if limited and not is_even(log.time):
        raise ModelError(
            f"{log.name}: input {limited[0]!r} is band limited, which its samples tell only at even times - resample "
            "the log, or declare the input linear",
            where=(log.name, *limited),
        )
    return InputSignal.of_table(model, log.time, u), known


def as_signal(
    model: Model,
    times: FloatArray,
    inputs: InputSignal | Mapping[str, float | str | npt.ArrayLike] | npt.ArrayLike | None,
) -> InputSignal:
    """Inputs in any of the accepted forms as a signal.

    Raises
    ------
    ModelError
        If a name is unknown or the number of inputs does not fit.
    """
    if isinstance(inputs, InputSignal):
        signal = inputs
    elif inputs is None or isinstance(inputs, Mapping):
        signal = InputSignal.of(model, times, **(inputs or {}))
    else:
        signal = InputSignal.of_table(model, times, np.array(inputs, dtype=np.float64))
    if signal.hold.size != len(model.inputs):
        raise ModelError(
            f"{model.name}: {signal.hold.size} inputs were given, the model has {len(model.inputs)}"
            f" ({', '.join(model.names('input'))})",
            where=(model.name,),
        )
    return signal


def as_vector(model: Model, kind: Literal["parameter", "state"], values: Vector) -> FloatArray:
    """Parameters or initial states in any of the accepted forms, shape (rows,) or (rows, members).

    Raises
    ------
    ModelError
        If a name is unknown or the number of rows does not fit.
    """
    build = model.theta if kind == "parameter" else model.x0
    if values is None or isinstance(values, Mapping):
        return build(**(values or {}))
    vector = np.array(values, dtype=np.float64)
    size = len(model.names(kind))
    if vector.ndim not in (1, 2) or vector.shape[0] != size:
        raise ModelError(
            f"{model.name}: {kind} values of shape {vector.shape} were given, {size} rows are needed"
            f" ({', '.join(model.names(kind))})",
            where=(model.name,),
        )
    return vector


def refuse_modes(model: Model) -> None:
    """Raise ModelError for a model with modes, whose events only an adaptive method locates."""
    if model.modes:
        raise refusal(model, "fixed steps do not locate events")


def refusal(model: Model, why: str) -> ModelError:
    """The error for a model with modes where its events cannot be located."""
    elements = list(dict.fromkeys(mode.element or mode.input for mode in model.modes))
    change = inflected(elements, "changes its", "change their")
    return ModelError(
        f"{model.name}: {', '.join(elements)} {change} modes at events, and {why}"
        " - derive the graph smooth, or simulate it with an adaptive method",
        where=(model.name, *elements),
    )
