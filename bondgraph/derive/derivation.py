"""Derivation: from a causal graph to explicit state equations, and to what impacts and locks do to the states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sympy import Expr

from bondgraph.declare.limits import NoValueError, check_numbers
from bondgraph.declare.quantities import symbol
from bondgraph.derive.causality import CausalGraph
from bondgraph.derive.continuous import ContinuousDerivation
from bondgraph.derive.equations import Assignment, Mode, StateEquations
from bondgraph.derive.impulse import with_resets
from bondgraph.errors import DerivationError
from bondgraph.text import inflected


def derive(causal: CausalGraph, bonds: bool = False, smooth: bool = True, *, signals: bool = False) -> StateEquations:
    """State equations of a causal graph.

    Parameters
    ----------
    causal
        Graph with all strokes placed.
    bonds
        Add the effort and flow of every bond to the outputs, named ``effort(a->b)`` and ``flow(a->b)``.
    signals
        Add the named signals after those (as ``signal(name)`` where an output has that name already).
    smooth
        Take every ``switch`` in a law as a smooth step of its declared width, and friction and impacts as smooth laws,
        as filters and gradients need it; else as jumps, locks and rebounds in discrete ``modes``, with ``events`` at
        the zeros of which a mode may end. Modes are held inputs of the equations.

    Raises
    ------
    DerivationError
        If a loop has no unique solution or a storage's equation cannot be made explicit; the elements are named.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> g = BondGraph("mass")
    >>> F, m = g.input("F", "N"), g.parameter("m", 2.0, "kg")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("push", F, at=body)
    >>> _ = g.inertance("mass", m, at=body)
    >>> derive(assign_causality(g)).derivatives
    (F/m,)
    """
    return Derivation(causal, smooth).equations(bonds, signals)


class Derivation(ContinuousDerivation):
    """The whole derivation of a causal graph; its equations, and how each variable was computed."""

    def with_resets(self, modes: Sequence[Mode]) -> tuple[Mode, ...]:
        """The modes with what impacts and locks do to the states."""
        return with_resets(self.causal, modes)


def check_closed(equations: StateEquations) -> None:
    """Raise DerivationError unless the equations use only states, inputs, parameters, ``t`` and assigned symbols.

    Nor may a number in them be infinite, undefined or complex.
    """
    known = {symbol("t"), *(s.symbol for s in equations.states), *(i.symbol for i in equations.inputs)}
    known |= {p.symbol for p in equations.parameters}
    for step in equations.assignments:
        if isinstance(step, Assignment):
            _check_known(equations, step.expression, known, step.symbol.name)
            known.add(step.symbol)
            continue
        inside = known | set(step.unknowns)
        for local in step.body:
            _check_known(equations, local.expression, inside, local.symbol.name)
            inside.add(local.symbol)
        for residual in step.residuals:
            _check_known(equations, residual, inside, step.name)
        known |= set(step.unknowns)
    for state, value in zip(equations.states, equations.derivatives, strict=True):
        _check_known(equations, value, known, f"d({state.symbol.name})/dt")
    for output in equations.outputs:
        _check_known(equations, output.expression, known, output.symbol.name)
    for event in equations.events:
        _check_known(equations, event, known, "an event")


def _check_known(equations: StateEquations, value: Expr, known: set[Any], where: str) -> None:
    try:
        check_numbers(value)
    except (NoValueError, OverflowError) as error:
        raise DerivationError(
            f"{equations.name}: the equation of {where} has no finite real value ({error} in {value}) - correct the "
            "laws that lead to it",
            where=(where,),
        ) from None
    foreign = sorted(str(used) for used in value.free_symbols - known)
    if foreign:
        raise DerivationError(
            f"{equations.name}: the equation of {where} uses {', '.join(foreign)}, which "
            f"{inflected(foreign, 'is', 'are')} neither a state, input nor parameter - please report this graph",
            where=(where,),
        )
