"""Values that an estimate or a closed loop has found, read from its folder: parameters, and levels of noise."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from bondgraph.coherent import Displayed
from bondgraph.errors import DataError
from bondgraph.estimate.free import parse_target
from bondgraph.filter.filter_model import FilterModel

_FILE = "result.json"


def found_values(folder: Path) -> dict[str, float]:
    """Parameters and levels of noise by name, in the units in which they are shown.

    Raises
    ------
    DataError
        If the folder holds no result of an estimate or of a closed loop.
    """
    path = folder / _FILE
    try:
        result: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        known = result.get("corrected", result)
        values = {name: float(one["value"]) for name, one in known["parameters"].items()}
        if not values:
            raise KeyError("parameters")
    except FileNotFoundError:
        raise DataError(
            f"{path}: there is no such file - name the folder that bondgraph estimate or close-loop wrote",
            where=(str(folder),),
        ) from None
    except (json.JSONDecodeError, KeyError, TypeError, ValueError, AttributeError):
        raise DataError(
            f"{path}: this is no result of an estimate or of a closed loop - name the folder that bondgraph estimate "
            "or close-loop wrote",
            where=(str(folder),),
        ) from None
    return values


def set_by(values: Mapping[str, float], names: tuple[str, ...]) -> list[str]:
    """Assignments ``name=value`` of those of the names that were found.

    Examples
    --------
    >>> set_by({"mass": 95.5, "std(speed)": 0.02}, ("mass", "drag"))
    ['mass=95.5']
    """
    return [f"{name}={value!r}" for name, value in values.items() if name in names]


def with_found_noise(filter_model: FilterModel, values: Mapping[str, float]) -> FilterModel:
    """The filter model with the levels of noise that were found, in coherent SI.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {})
    >>> with_found_noise(swing, {"process(rate)": 0.3}).process_noise
    {'rate': 0.3}
    """
    model = filter_model.model
    measurement, process = dict(filter_model.measurement_noise), dict(filter_model.process_noise)
    for name, value in values.items():
        target = parse_target(name)
        if target.kind == "std" and target.name in model.names("output"):
            measurement[target.name] = _coherent(model.outputs[model.index("output", target.name)], value)
        if target.kind == "process" and target.name in model.names("state"):
            process[target.name] = _coherent(model.states[model.index("state", target.name)], value)
    return replace(filter_model, measurement_noise=measurement, process_noise=process)


def _coherent(shown: Displayed, size: float) -> float:
    """A difference that is shown in a unit, in coherent SI."""
    return size / (shown.shown(1.0) - shown.shown(0.0))
