"""Checks of a generated module when it is loaded: its tables, and that its functions run.

They are given the :class:`bondgraph.simulate.model.Model` that calls them, whose module they cannot import.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bondgraph.data.band_limited import BAND_LIMITED
from bondgraph.errors import ModelError

#: The tables of which each names its rows.
_KINDS = ("state", "input", "parameter", "output")


def check_rows(model: Any, source: str) -> None:
    """Names are used once, numbers finite, bounds and interpolation meaningful."""

    def require(condition: bool, name: str, problem: str) -> None:
        if not condition:
            raise ModelError(f"{source}: {name!r}: {problem} - regenerate the module", where=(source, name))

    for kind in _KINDS:
        names = model.names(kind)
        for name in names:
            require(isinstance(name, str) and bool(name.strip()), str(name), f"cannot be the name of the {kind}")
            require(names.count(name) == 1, name, f"names two {kind}s")
    for state in model.states:
        require(_is_finite(state.initial), state.name, f"initial value {state.initial!r} is not a finite number")
    for start in model.starts:
        coded = [one.name for one in model.inputs if one.letters]
        signals = {*model.names("input"), *model.names("output")}.difference(coded)
        require(start.state in model.names("state"), start.state, "is said to start at a signal but is no state")
        require(start.signal in signals, start.signal, f"is where {start.state} starts but no numeric input or output")
        require(_is_finite(start.factor), start.state, f"starts at {start.factor!r} times {start.signal}")
    for name in model.parameter_starts:
        require(name in model.names("state"), name, "is said to start where parameters say but is no state")
    for held in (*(mode.input for mode in model.modes), *(row.mode for row in model.event_rows)):
        require(held in model.names("input"), held, "is said to hold a mode but is no input")
    for place, signal in enumerate(model.inputs):
        require(_is_finite(signal.default), signal.name, f"default {signal.default!r} is not a finite number")
        between = (
            f"interpolation {signal.interpolation!r} is neither 'linear' nor 'hold' nor 'band limited', nor the rate "
            "of an earlier input"
        )
        ways = ("linear", "hold", BAND_LIMITED)
        known = signal.rate_of in model.names("input")[:place] or signal.interpolation in ways
        require(known, signal.name, between)
    for parameter in model.parameters:
        require(_is_finite(parameter.value), parameter.name, f"value {parameter.value!r} is not a finite number")
        bounds = (parameter.lower, parameter.upper)
        both = bounds == (None, None) or (_is_finite(bounds[0]) and _is_finite(bounds[1]))
        require(both, parameter.name, f"bounds {bounds} must be two numbers or both None")
        if parameter.lower is not None and parameter.upper is not None:
            require(parameter.lower < parameter.upper, parameter.name, f"bounds {bounds} are not in order")


def _is_finite(value: object) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def check_shapes(model: Any, source: str) -> None:
    """The functions run and give one row per state and per output, for one state and for a batch."""
    x, u, theta = model.x0(), model.u0(), model.theta()
    functions = [("rhs", model.rhs, len(model.states)), ("output", model.output, len(model.outputs))]
    functions += [("events", model.events, len(model.event_rows))] if model.modes else []
    functions += [("start", model._start, len(model.states))] if model._start else []
    for name, function, expected_rows in functions:
        for state in (x, np.repeat(x[:, np.newaxis], 2, axis=1)):
            expected = (expected_rows, *state.shape[1:])
            try:
                shape = np.shape(function(0.0, state, u, theta))
            except Exception as error:  # any failure of the text's own functions is reported as the module's
                raise ModelError(
                    f"{source}: {name} fails at the declared values: {type(error).__name__}: {error}"
                    " - regenerate the module",
                    where=(source, name),
                ) from error
            if shape != expected:
                raise ModelError(
                    f"{source}: {name} gives shape {shape} for a state of shape {state.shape}, not {expected}"
                    " - regenerate the module",
                    where=(source, name),
                )
