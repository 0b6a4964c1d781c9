"""Laws that complete the form of another one, and are told from no effect of their own.

A law of a dictionary has a form, and what is missing has its own: a drop of 1.6 V at a slip ring nears its level more
slowly than a tanh does. With small noise the rest passes every test, as a second law at the same place. Of a sum of
functions of one signal at one place the logs tell the sum alone. So such a law stays in the model, which predicts
better with it, but it is no further finding: it completes the first, or acts beside it. So does what acts at a junction
that another law brought with it, a loss in series to a leak; so does a bias of the only sensor, which bends the law of
a lamp's radiation.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.places.unexplained import Spline, contained
from bondgraph.correct.scores.scoring import Linearisation
from bondgraph.correct.shapes.formula import formula_of
from bondgraph.declare.elements import own_variables
from bondgraph.declare.expressions import signal_name
from bondgraph.declare.graph import BondGraph


def completions(
    laws: Sequence[Trial], declared: BondGraph, graph: BondGraph, linear: Linearisation, tried: Sequence[Spline]
) -> Mapping[str, str]:
    """Labels of laws by those that complete them.

    Parameters
    ----------
    laws
        What was added, in its order.
    declared, graph
        The graph without them, and with all of them.
    linear, tried
        Its fit, linearised, and the free functions that were tried beside it.
    """
    found: dict[str, str] = {}
    firsts: list[tuple[Trial, frozenset[str]]] = []
    brought = graph.flatten().nodes.keys() - declared.flatten().nodes.keys()
    for k, law in enumerate(laws):
        whole = next((one for one in laws[:k] if _is_inside(law, one, brought, graph)), None)
        own = arguments(law, graph)
        effect = law.candidate.effect
        bends = bool(effect.channel) and not effect.adds_state and law.gate is None  # what a sensor shows
        if whole is None and (own is not None or bends):
            whole = next((one for one, known in firsts if _completes(law, own, one, known, linear, tried)), None)
        if whole is not None:
            found[law.candidate.label] = whole.candidate.label
        elif own:
            firsts.append((law, own))
    return found


def _is_inside(law: Trial, first: Trial, brought: Collection[str], graph: BondGraph) -> bool:
    """True for a law at a junction that another law brought for its element: the path of a leak."""
    junction, element = law.candidate.place.junction.name, first.candidate.effect.element
    ends = ({bond.source, bond.target} for bond in graph.flatten().bonds)
    return junction in brought and {junction, element} in ends


def _completes(
    law: Trial,
    own: frozenset[str] | None,
    first: Trial,
    known: frozenset[str],
    linear: Linearisation,
    tried: Sequence[Spline],
) -> bool:
    place = first.candidate.place.label
    if law.candidate.place.label == place and own is not None and own <= known:
        return True
    functions = [one for one in tried if one.probe.place.label == place and one.signal.name in known]
    return any(contained(linear, one, law.candidate.effect.coefficients) for one in functions)


def stored_signals(laws: Sequence[Trial], graph: BondGraph) -> frozenset[str]:
    """Names of the signals of laws that store: their own, and what the elements hold.

    Such a law takes no form of its own from a formula. The form of a ceramic condenser was told as a resistance of the
    line where the voltage lies between two levels.
    """
    flat, found = graph.flatten(), set[str]()
    for law in laws:
        node = flat.nodes.get(law.candidate.effect.element)
        if node is not None and node.kind in ("C", "I"):
            held = "displacement" if node.kind == "C" else "momentum"
            found |= {f"{held} of {node.name}", *(arguments(law, graph) or ())}
    return frozenset(found)


def arguments(law: Trial, graph: BondGraph) -> frozenset[str] | None:
    """Names of the signals that a law is a function of; None of one with a memory, of a sensor, or in part of the logs.

    The momentum of an element stands for the flow at its place, the displacement of one at a 0-junction for the effort.
    """
    effect, place = law.candidate.effect, law.candidate.place
    if effect.adds_state or effect.channel or law.gate is not None or place.bond is not None:
        return None
    formula = formula_of(law.candidate.function)
    if formula is not None:
        return frozenset(formula.signals)
    flat = graph.flatten()
    node = flat.nodes.get(effect.element)
    if node is None:
        return None
    common = f"{'flow' if place.junction.kind == '1' else 'effort'} of {place.label}"
    known = {parameter.symbol for parameter in flat.parameters}
    found = set[str]()
    for given, expression in node.laws:
        for used in expression.free_symbols - known:
            if used.name in (own_variables(node, given) or ()):
                stretched = place.junction.kind == "1" and node.kind == "C"
                found.add(f"displacement of {node.name}" if stretched else common)
            else:
                read = signal_name(used)
                found.add(used.name if read is None else f"{read.variable} of {read.node}")
    return frozenset(found)
