"""Pictures of what is missing: the missing effort or flow at a place against what it depends on, the law through it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import sympy

from bondgraph.build import BuiltModel, build
from bondgraph.correct.evidence.trials import Added
from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.models.failures import FAILURES
from bondgraph.correct.places.missing import missing_effort
from bondgraph.correct.places.probes import variable_of
from bondgraph.correct.places.unexplained import Unexplained
from bondgraph.correct.progress import rebuilt
from bondgraph.correct.result import form_text, intervals, own_curve
from bondgraph.correct.shapes.formula import Formula, formula_of
from bondgraph.data.log import FloatArray
from bondgraph.declare.functions import numeric
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.report.formulas import round_of
from bondgraph.report.series import MissingEffort
from bondgraph.report.words import law_title

_POINTS = 200


def missing_efforts(closed: ClosedLoop) -> tuple[MissingEffort, ...]:
    """A picture for every added effect whose law is a curve over the flow there, and of what no law explains."""
    pictures = [_picture(closed, added) for added in closed.added]
    pictures += [_unexplained(closed, one) for one in closed.unexplained]
    return tuple(picture for picture in pictures if picture is not None)


def _unexplained(closed: ClosedLoop, one: Unexplained) -> MissingEffort | None:
    """The unknown at its place against the signal it depends on, with the estimated shape and its band."""
    if one.place.output:
        return None
    turn = closed.rounds[-1]
    logs = [log.log for log in closed.corrected_train.logs]
    signal = next((signal for signal in turn.signals if signal.name == one.signal), None)
    if signal is None:
        return None
    try:
        found = missing_effort(closed.corrected_built, closed.corrected, logs, one.place)
    except FAILURES:
        return None
    unit = f" [{one.signal_unit}]" if one.signal_unit else ""
    aside = f", less what {' and '.join(one.taken)} can take" if one.taken else ""
    return MissingEffort(
        title=f"unexplained {one.variable} at {one.place.label}",
        x_label=f"{one.signal}{unit}",
        y_label=f"missing {one.variable} [{found.effort_unit}]",
        x=np.concatenate(signal.values),
        missing=found.effort,
        law_x=one.knots,
        law=one.values,
        law_text=f"shape without a law{aside}",
        lower=one.values - 1.96 * one.std,
        upper=one.values + 1.96 * one.std,
    )


def _picture(closed: ClosedLoop, added: Added) -> MissingEffort | None:
    candidate = added.trial.candidate
    if added.trial.forms:
        return _own_form(closed, added)
    formula = formula_of(candidate.function)
    if formula is not None:
        return _formula(closed, added, formula)
    if candidate.place.bond is not None or candidate.place.junction.kind != "1":
        return None
    try:
        return _with_law(closed, added)
    except FAILURES:
        return None


def _with_law(closed: ClosedLoop, added: Added) -> MissingEffort | None:
    """The missing effort over the flow, or the displacement of the storage that a law changes, and the law through it.

    Of an element that is declared the law is what the effect adds to it.
    """
    candidate, graph, base = added.trial.candidate, closed.corrected_graph, _without(closed, added)
    element = candidate.effect.element
    values = {parameter.name: parameter.value for parameter in graph.flatten().parameters}
    own = "displacement" if graph.flatten().nodes[element].kind == "C" else "flow"
    if law_curve(graph, element, values, np.zeros(1), own) is None:
        return None
    signal = next((one for one in closed.rounds[-1].signals if one.name == f"displacement of {element}"), None)
    if own == "displacement" and signal is None:
        return None
    found = missing_effort(base, closed.corrected, [log.log for log in closed.nominal_train.logs], candidate.place)
    x, label, unit = found.flow, f"flow of {found.junction}", found.flow_unit
    if own == "displacement" and signal is not None:
        x, label, unit = np.concatenate(signal.values), signal.name, signal.unit
    span = np.linspace(float(np.nanmin(x)), float(np.nanmax(x)), _POINTS)
    declared = np.zeros(span.size)
    if element in base.graph.flatten().nodes:
        known = law_curve(base.graph, element, values, span, own)
        declared = declared if known is None else known
    name = added.coefficients[0]
    ends = intervals(closed.corrected)[name]
    curves = [law_curve(graph, element, values | {name: end}, span, own) for end in (values[name], *ends)]
    law, lower, upper = (np.full(span.size, np.nan) if curve is None else curve - declared for curve in curves)
    return MissingEffort(
        title=f"{candidate.effect.name} at {candidate.place.label}",
        x_label=f"{label} [{unit}]" if unit else label,
        y_label=f"missing effort [{found.effort_unit}]",
        x=x,
        missing=found.effort,
        law_x=span,
        law=law,
        law_text=candidate.effect.law,
        lower=np.minimum(lower, upper),
        upper=np.maximum(lower, upper),
    )


def _without(closed: ClosedLoop, added: Added) -> BuiltModel:
    """The declared model with all added laws but one: what is missing is that law alone, and none of the others."""
    others = [one.trial for one in closed.added if one is not added]
    return build(rebuilt(closed.nominal_built.graph, others)[0]) if others else closed.nominal_built


def _own_form(closed: ClosedLoop, added: Added) -> MissingEffort | None:
    """What is missing against the signal of a law with a form of its own, and the sum of its parts through it."""
    place, text, found = added.trial.candidate.place, form_text(added, closed), own_curve(added, closed, _POINTS)
    if found is None or text is None:
        return None
    signal, span, law = found
    logs = [log.log for log in closed.nominal_train.logs]
    try:
        missing = missing_effort(_without(closed, added), closed.corrected, logs, place)
    except FAILURES:
        return None
    variable = variable_of(place)
    return MissingEffort(
        title=f"{law_title(added.trial.candidate.effect.name)} at {place.label} in a form of its own",
        x_label=f"{signal.name} [{signal.unit}]" if signal.unit else signal.name,
        y_label=f"missing {variable} [{missing.effort_unit}]",
        x=np.concatenate(signal.values),
        missing=missing.effort,
        law_x=span,
        law=law,
        law_text=text,
        lower=law,
        upper=law,
    )


def _formula(closed: ClosedLoop, added: Added, formula: Formula) -> MissingEffort | None:
    """What is missing against the signal of a formula of one signal, and the formula through it."""
    turn = round_of(closed, added)
    signal = None if turn is None else next((one for one in turn.signals if (one.name,) == formula.signals), None)
    if signal is None:
        return None
    logs = [log.log for log in closed.nominal_train.logs]
    try:
        found = missing_effort(_without(closed, added), closed.corrected, logs, formula.place)
    except FAILURES:
        return None
    together, values = np.concatenate(signal.values), closed.corrected.values
    span = np.linspace(float(together.min()), float(together.max()), _POINTS)
    name = added.coefficients[0]
    curves = [formula.curve(values | {name: end}, span) for end in (values[name], *intervals(closed.corrected)[name])]
    unit = f" [{signal.unit}]" if signal.unit else ""
    return MissingEffort(
        title=f"formula at {formula.place.label}",
        x_label=f"{signal.name}{unit}",
        y_label=f"missing {formula.variable} [{found.effort_unit}]",
        x=together,
        missing=found.effort,
        law_x=span,
        law=curves[0],
        law_text=formula.text(values, intervals(closed.corrected)),
        lower=np.minimum(curves[1], curves[2]),
        upper=np.maximum(curves[1], curves[2]),
    )


def law_curve(
    graph: BondGraph, element: str, values: Mapping[str, float], at: FloatArray, own: str = "flow"
) -> FloatArray | None:
    """The effort of an element at given flows, or displacements, shape (n,); None where it is no function of these.

    Examples
    --------
    >>> g = BondGraph("sled")
    >>> body = g.one_junction("body")
    >>> _ = g.inertance("mass", g.parameter("m", 80.0, "kg"), at=body)
    >>> _ = g.resistance("runners", g.parameter("c", 2.0, "N s/m"), at=body)
    >>> law_curve(g, "runners", {"c": 2.0}, np.array([1.0, 2.0])).tolist()
    [2.0, 4.0]
    """
    node = graph.flatten().nodes[element]
    kinds = ("R", "Se") if own == "flow" else ("C",)
    law = node.law("effort") if node.kind in kinds and node.ports == 1 else None
    if law is None:
        return None
    known = law.xreplace({symbol(name): sympy.Float(value) for name, value in values.items()})
    if not known.free_symbols <= {symbol(own)}:
        return None
    evaluated = numeric([symbol(own)], -known if node.kind == "Se" else known)(at)
    curve: FloatArray = np.broadcast_to(np.asarray(evaluated, dtype=np.float64), at.shape).copy()
    return curve
