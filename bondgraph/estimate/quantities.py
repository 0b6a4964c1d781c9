"""Quantities behind free parameters: in which unit each is shown."""

from __future__ import annotations

from bondgraph.coherent import Displayed
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.joint import Problem
from bondgraph.simulate.quantities import ParameterInfo


def quantity_of(problem: Problem, parameter: FreeParameter) -> Displayed:
    """The parameter, output or state of the model to which a free parameter belongs, in whose unit it is shown.

    One that acts through ties alone belongs to none, and is a plain number.
    """
    parts = [part for part in problem.parts if parameter.name in part.names and not part.is_auxiliary(parameter)]
    if not parts:
        return ParameterInfo(parameter.name, "1", parameter.start, None, None, "")
    model, target = parts[0].filter_model.model, parameter.target
    if target.kind == "parameter":
        return model.parameters[model.index("parameter", target.name)]
    if target.kind == "std":
        return model.outputs[model.index("output", target.name)]
    if target.name in parts[0].filter_model.appended:
        return model.parameters[model.index("parameter", target.name)]
    return model.states[model.index("state", target.name)]


def unit_of(problem: Problem, parameter: FreeParameter) -> str:
    """Unit in which a free parameter is shown."""
    unit = quantity_of(problem, parameter).display_unit
    if parameter.target.kind != "process":
        return unit
    return f"({unit})/s^0.5" if unit != "1" else "1/s^0.5"
