"""Words for formulas: the name of the law in other words, and which parameters had stood in for it."""

from __future__ import annotations

from collections.abc import Mapping

from bondgraph.correct.shapes.formula import Formula
from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC, ROTATION, TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.estimate.fitted import Fit
from bondgraph.text import number

#: A parameter that moves by more than so many of its standard errors when a formula comes had stood in for it.
_MOVED = 2.0
#: What a term is called in a domain: by the variable that it is a function of, and by its kind.
_MECHANICAL = {
    ("own", "line"): "viscous friction", ("own", "signed_square"): "quadratic loss", ("own", "cube"): "cubic loss",
    ("own", "sign"): "dry friction", ("own", "saturation"): "dry friction", ("displacement", "line"): "stiffness",
    ("displacement", "cube"): "hardening spring", ("displacement", "ramp_above"): "end stop",
}  # fmt: skip
_ELECTRICAL = {("own", "line"): "resistance", ("displacement", "line"): "elastance"}
_HYDRAULIC = {("own", "line"): "laminar loss", ("own", "signed_square"): "turbulent loss"}
_ROTATING = _MECHANICAL | {("displacement", "sine"): "weight of a lever"}
_NAMES = {TRANSLATION: _MECHANICAL, ROTATION: _ROTATING, ELECTRICAL: _ELECTRICAL, HYDRAULIC: _HYDRAULIC}
#: The same where a flow is lost to an effort, at a 0-junction.
_FLOWS = {("own", "line"): "leakage", ("own", "signed_square"): "slip"}


def other_words(formula: Formula, values: Mapping[str, float]) -> str:
    """The name of a formula of one term among the known laws; empty where it has none, or brings in energy.

    Examples
    --------
    >>> import numpy as np
    >>> from bondgraph.correct.places.probes import Signal
    >>> from bondgraph.correct.shapes.library import library
    >>> from bondgraph.declare.effect import Place, Scale
    >>> from bondgraph.declare.graph import Handle
    >>> speed = Signal("flow of body", "m/s", (np.array([-2.0, 1.0, 2.0]),))
    >>> term = next(one for one in library([speed], speed) if one.kind.name == "signed_square")
    >>> found = Formula(Place(Handle("body", "1", TRANSLATION), Scale(1.0, 2.0)), "effort", "N", (term,), (4.0,))
    >>> other_words(found, {found.coefficients()[0].name: 0.3}), found.text()
    ('quadratic loss', 'effort = c*x*|x|, x the speed of body')
    """
    if len(formula.terms) != 1 or len(formula.signals) != 1:
        return ""
    if not values[formula.coefficients()[0].name] > 0.0:
        return ""
    variable = "own" if formula.is_own else formula.signals[0].partition(" of ")[0]
    domain = formula.place.domain
    known = _FLOWS if formula.variable == "flow" else {} if domain is None else _NAMES.get(domain, {})
    return known.get((variable, formula.terms[0].kind.name), "")


def moved_parameters(before: Fit, after: Fit, graph: BondGraph) -> list[tuple[str, str, str]]:
    """Parameters of the machine that had stood in for a law before it was there: each with its value after and before.

    Parameters
    ----------
    before, after
        Fits without the law and with it.
    graph
        The declared graph; its elements are named with the parameters that their laws have.
    """
    found = []
    model, values = before.problem.filter_model.model, after.values
    declared = {one.name for one in graph.flatten().parameters}
    for parameter in before.problem.free:
        name = parameter.name
        if parameter.target.kind != "parameter" or name not in values or name not in declared:
            continue
        slope, error = parameter.slope(before.values[name]), before.std[name]
        moved = before.values[name] - values[name]
        if abs(moved) > _MOVED * error * abs(slope):
            info = model.parameters[model.index("parameter", name)]
            now = f"{number(info.shown(values[name]))} {info.display_unit}".strip()
            found.append((f"{name}{_element(graph, name)}", now, number(info.shown(before.values[name]))))
    return found


def _element(graph: BondGraph, parameter: str) -> str:
    """The elements whose laws have a parameter, in brackets."""
    own = symbol(parameter)
    names = [
        node.name for node in graph.flatten().nodes.values() if any(own in law.free_symbols for _, law in node.laws)
    ]
    return f" ({', '.join(names)})" if names else ""
