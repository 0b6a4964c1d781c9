"""Forms: a law of another form than the dictionary's is one law, not two.

A drop of 1.6 V at a slip ring nears its level more slowly than a tanh does. What the dictionary's form leaves of it
passes every test as a second law of the same current at the same place. But of a sum of functions of one signal at one
place the logs tell the sum alone: so both are reported as one law, under the name of the first, in a form of its own,
with how far that departs from the name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import sympy
from sympy import Expr, Symbol

from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import placed
from bondgraph.correct.places.probes import Signal, argument
from bondgraph.correct.places.regimes import in_words
from bondgraph.correct.shapes.completions import arguments
from bondgraph.correct.shapes.formula import formula_of
from bondgraph.correct.shapes.law_text import Intervals, letters_beside, with_numbers
from bondgraph.data.log import FloatArray
from bondgraph.declare.effect import Effect, EffectFunction, Place
from bondgraph.declare.elements import own_variables
from bondgraph.declare.expressions import signal_name
from bondgraph.declare.functions import numeric
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.declare.validation import node_domains
from bondgraph.simulate.model import Model


def own_form(first: Trial, further: Trial, graph: BondGraph) -> bool:
    """True for a law of the signals of another one at its place, and no others: their sum is one law.

    ``graph`` has both. What acts in a regime and what acts everywhere stay two: each is told for itself.
    """
    if first.candidate.place.label != further.candidate.place.label:
        return False
    if first.candidate.effect.regime or further.candidate.effect.regime:
        return False
    known, own = arguments(first, graph), arguments(further, graph)
    return bool(known) and own is not None and known is not None and own <= known


def joined(first: Trial, further: Trial) -> Trial:
    """The first law in a form of its own, which the further one completes; ``further`` was refitted beside it."""
    whole = as_one((*(first.forms or (first,)), further), further.candidate.model)
    return replace(whole, built=further.built, fit=further.fit)


def as_one(laws: tuple[Trial, ...], model: Model) -> Trial:
    """The sum of laws as one, under the name of the first, in a model that has them all; a single one as it is."""
    first = laws[0]
    if len(laws) == 1:
        return first
    effect = _joined_effects([one.candidate.effect for one in laws])
    function = _joined_functions([one.candidate.function for one in laws], effect)
    passive = all(one.candidate.passive for one in laws)
    candidate = replace(first.candidate, function=function, effect=effect, model=model, passive=passive)
    return replace(first, candidate=candidate, forms=laws)


def _joined_effects(effects: Sequence[Effect]) -> Effect:
    """The effect of all of them, under the name of the first; a part may be negative where the whole is a loss."""
    return replace(
        effects[0],
        coefficients=tuple(name for one in effects for name in one.coefficients),
        shapes=tuple(name for one in effects for name in one.shapes),
        widths=tuple(name for one in effects for name in one.widths),
        grids=tuple(grid for one in effects for grid in one.grids),
        dissipative=all(one.dissipative for one in effects),
    )


def _joined_functions(functions: Sequence[EffectFunction], effect: Effect) -> EffectFunction:
    def declared(g: BondGraph, at: Place) -> Effect | None:
        made = [function(g, placed(g, at)) for function in functions]
        return None if any(one is None for one in made) else effect

    declared.__name__ = functions[0].__name__
    declared.__dict__.update(functions[0].__dict__)
    return declared


def whole_law(law: Trial, graph: BondGraph, read: bool = False) -> tuple[str, Expr] | None:
    """The variable that a law gives (effort, flow, displacement), and its expression in signals, summed over its parts.

    None where a part has no element of its own, or the parts do not give the same. ``read``: formulas as a person reads
    them.
    """
    gives, found = "", sympy.Integer(0)
    flat, place = graph.flatten(), law.candidate.place
    common = argument(f"{'flow' if place.junction.kind == '1' else 'effort'} of {place.label}")
    parts = {one.candidate.effect.element: one for one in law.forms or (law,)}  # two may revise one element
    for element, one in parts.items():
        node = flat.nodes.get(element)
        if node is None or len(node.laws) != 1 or (gives and node.laws[0][0] != gives):
            return None
        gives, expression = node.laws[0]
        used = {one.name for one in expression.free_symbols} & set(own_variables(node, gives) or ())
        if used - {common.name.partition("(")[0]}:
            return None  # it is of a state of its own
        law_there = expression.xreplace({symbol(name): common for name in used})
        formula = formula_of(one.candidate.function) if read else None
        if formula is not None:
            found += formula.law({name: symbol(name) for name in one.candidate.effect.parameters}, read=True)
            continue
        found += -law_there if node.kind in ("Se", "Sf") else law_there
    return gives, found


def whole_text(law: Trial, graph: BondGraph, values: Mapping[str, float], ends: Intervals) -> str | None:
    """The sum of a law's parts as a person reads it; None where they do not give the same.

    ``values`` are those of all parameters of the graph, ``ends`` the intervals of those that were estimated.
    """
    found = whole_law(law, graph, read=True)
    if found is None:
        return None
    gives, whole = found
    place = law.candidate.place
    names = sorted((one for one in whole.free_symbols if one.name not in values), key=str)
    free = letters_beside(one.name for one in names)
    if len(names) > len(free):
        return None
    letters = dict(zip(names, free, strict=False))
    words = " and ".join(f"{letter.name} the {_worded(one, graph)}" for one, letter in letters.items())
    units = {} if place.domain is None else {"effort": place.domain.effort_unit, "flow": place.domain.flow_unit}
    text = with_numbers(whole.xreplace(letters), values, ends)
    return f"{gives} = {text}{f'  [{units[gives]}]' if units.get(gives) else ''}, {words}"


def _worded(one: Symbol, graph: BondGraph) -> str:
    """The name that people read of a signal."""
    read = signal_name(one)
    if read is None:
        return str(one.name)
    domain = node_domains(graph).get(read.node)
    units = {} if domain is None else {"effort": domain.effort_unit, "flow": domain.flow_unit}
    return in_words(f"{read.variable} of {read.node}", units.get(read.variable, ""))


def departure(law: Trial, graph: BondGraph, values: Mapping[str, float], known: Sequence[Signal]) -> float | None:
    """How far a form of its own is from the nearest multiple of the law it is named after, as a share of its size.

    Over what the logs visit; None where it is no function of one signal. Where a law revises an element, what is
    declared there is no part of it.
    """
    signal = only_signal(law, graph, known)
    if signal is None or not law.forms:
        return None
    at = np.concatenate(signal.values)
    whole, named = (_added(one, graph, values, signal, at) for one in (law, replace(law.forms[0], forms=())))
    if whole is None or named is None:
        return None
    size, inner, own = float(whole @ whole), float(whole @ named), float(named @ named)
    return float(np.sqrt(max(1.0 - inner**2 / (own * size), 0.0))) if size > 0.0 and own > 0.0 else None


def _added(
    law: Trial, graph: BondGraph, values: Mapping[str, float], signal: Signal, at: FloatArray
) -> FloatArray | None:
    """Addition of a law to the declared one (n,) at values of its only signal (n,); None where it has no curve."""
    absent = dict.fromkeys(law.candidate.effect.coefficients, 0.0)
    whole, declared = (curve(law, graph, known, signal, at) for known in (values, {**values, **absent}))
    return None if whole is None or declared is None else whole - declared


def revises(law: Trial, graph: BondGraph, values: Mapping[str, float]) -> bool:
    """True for a law of which a part is declared, since it revises an element."""
    found = whole_law(law, graph)
    if found is None:
        return False
    absent = dict.fromkeys(law.candidate.effect.coefficients, 0.0)
    known = {symbol(name): sympy.Float(value) for name, value in {**values, **absent}.items()}
    return bool(found[1].xreplace(known) != 0)


def only_signal(law: Trial, graph: BondGraph, known: Sequence[Signal]) -> Signal | None:
    """The signal that a law is a function of; None where there are several, or it is none of those that are known."""
    own = arguments(law, graph)
    return None if own is None else next((one for one in known if own == {one.name}), None)


def curve(
    law: Trial, graph: BondGraph, values: Mapping[str, float], signal: Signal, at: FloatArray
) -> FloatArray | None:
    """A law, summed over its parts, at values of its only signal, both (n,); None where it has no curve."""
    found = whole_law(law, graph)
    if found is None:
        return None
    plain = found[1].xreplace({symbol(name): sympy.Float(value) for name, value in values.items()})
    if not plain.free_symbols <= argument(signal.name).free_symbols:
        return None
    drawn = numeric([argument(signal.name)], plain)(at)
    return np.broadcast_to(np.asarray(drawn, dtype=np.float64), at.shape).copy()
