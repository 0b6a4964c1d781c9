"""Choices of causality: what else could be independent, and what each choice costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import Derivation
from bondgraph.derive.equations import ImplicitLoop
from bondgraph.errors import BondGraphError


@dataclass(frozen=True)
class Alternative:
    """One assignment of causality: what was asked for and what came of it.

    ``independent`` is what :func:`assign_causality` was given; ``states`` the independent storages it led to and
    ``dependent`` the others; ``loops`` the elements of each algebraic loop, of which ``implicit`` need an iteration;
    ``operations`` the size of the equations; ``refused`` the reason where there are none.
    """

    independent: tuple[str, ...]
    states: tuple[str, ...]
    dependent: tuple[str, ...]
    loops: tuple[tuple[str, ...], ...]
    implicit: int
    operations: int
    refused: str = ""


def compare(graph: BondGraph, choices: Sequence[Sequence[str]]) -> tuple[Alternative, ...]:
    """What each choice of preferred independent storages leads to, in the order of the choices."""
    return tuple(_outcome(graph, tuple(choice)) for choice in choices)


def alternatives(graph: BondGraph) -> tuple[Alternative, ...]:
    """The default assignment, then for each dependent storage the one in which it is independent instead.

    Examples
    --------
    >>> g = BondGraph("two_masses")
    >>> a = g.one_junction("a")
    >>> _ = g.inertance("m_1", 1.0, at=a)
    >>> _ = g.inertance("m_2", 2.0, at=a)
    >>> [(choice.states, choice.dependent) for choice in alternatives(g)]
    [(('m_1',), ('m_2',)), (('m_2',), ('m_1',))]
    """
    default = _outcome(graph, ())
    return (default, *compare(graph, [(name,) for name in dict.fromkeys(default.dependent)]))


def _outcome(graph: BondGraph, independent: tuple[str, ...]) -> Alternative:
    try:
        derivation = Derivation(assign_causality(graph, independent))
        equations = derivation.equations()
    except BondGraphError as error:
        return Alternative(independent, (), (), (), 0, 0, error.message)
    dependent = [name for name, _ in derivation.causal.derivative]
    states = [state.element for state in equations.states if state.element]
    implicit = [step for step in equations.assignments if isinstance(step, ImplicitLoop)]
    operations = sum(value.count_ops() for value in equations.derivatives)
    for step in equations.assignments:
        values = step.residuals if isinstance(step, ImplicitLoop) else (step.expression,)
        operations += sum(value.count_ops() for value in values)
    return Alternative(
        independent,
        tuple(dict.fromkeys(states)),
        tuple(dict.fromkeys(dependent)),
        tuple(loop.elements for loop in derivation.loops if not loop.of_rates),
        len(implicit),
        int(operations),
    )
