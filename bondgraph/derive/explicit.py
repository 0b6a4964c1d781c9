"""Explicit equations: derivatives and outputs in states, inputs and parameters alone; what ``equations`` prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy
from sympy import Expr, Symbol

from bondgraph.declare.expressions import to_text
from bondgraph.declare.sympy_text import to_sympy_text
from bondgraph.derive.causality import bond_labels
from bondgraph.derive.derivation import Derivation
from bondgraph.derive.equations import Assignment, StateEquations

#: Expressions of more parts than this are printed in pieces: written out, a chain of loops grows exponentially.
_MOST_PARTS = 120_000
#: In pieces, an intermediate result of more parts than this that is used more than once keeps its name.
_LONG_PIECE = 500
#: What decides between branches is written out up to so many parts.
_LONG_CONDITION = 30


@dataclass(frozen=True)
class ImplicitEquations:
    """Unknowns and the residuals that vanish at them: a nonlinear loop, or a result too long to be written out."""

    unknowns: tuple[Symbol, ...]
    residuals: tuple[Expr, ...]


@dataclass(frozen=True)
class ExplicitEquations:
    """Derivatives and outputs with all assignments substituted; nonlinear loops keep their unknowns.

    Where that would not fit on any page, intermediate results that are used often keep their names too, and
    ``implicit`` says what they are, in order of computation.
    """

    derivatives: tuple[tuple[Symbol, Expr], ...]
    outputs: tuple[tuple[Symbol, Expr], ...]
    implicit: tuple[ImplicitEquations, ...]


def explicit(equations: StateEquations) -> ExplicitEquations:
    """Substitute all assignments.

    Expressions grow where intermediate results are used often; generated code keeps the assignments instead.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> from bondgraph.derive.derivation import derive
    >>> g = BondGraph("sliding")
    >>> m, b = g.parameter("m", 2.0, "kg"), g.parameter("b", 0.1, "N s/m")
    >>> body = g.one_junction("body")
    >>> _ = g.inertance("mass", m, at=body)
    >>> _ = g.resistance("film", b, at=body)
    >>> explicit(derive(assign_causality(g))).derivatives
    ((f_mass, -b*f_mass/m),)
    """
    results = [*equations.derivatives, *(output.expression for output in equations.outputs)]
    kept = _pieces(equations, results) | _in_conditions(equations, results)
    known: dict[Symbol, Expr] = {}
    loops = []
    for step in equations.assignments:
        if isinstance(step, Assignment):
            value = step.expression.xreplace(known)
            if step.symbol in kept:
                loops.append(ImplicitEquations((step.symbol,), (step.symbol - value,)))
            else:
                known[step.symbol] = value
            continue
        inside = dict(known)
        for local in step.body:
            inside[local.symbol] = local.expression.xreplace(inside)
        loops.append(ImplicitEquations(step.unknowns, tuple(r.xreplace(inside) for r in step.residuals)))
    states = (state.symbol for state in equations.states)
    return ExplicitEquations(
        tuple((state, value.xreplace(known)) for state, value in zip(states, equations.derivatives, strict=True)),
        tuple((output.symbol, output.expression.xreplace(known)) for output in equations.outputs),
        tuple(loops),
    )


def _in_conditions(equations: StateEquations, results: Sequence[Expr]) -> set[Symbol]:
    """Assigned symbols that decide between branches and are no short expressions: these keep their names.

    A condition written out with other branches in it cannot be read, and sympy tries to decide it for minutes.
    """
    steps = [step for step in equations.assignments if isinstance(step, Assignment)]
    deciding: set[Any] = set()
    for value in (*(step.expression for step in steps), *results):
        for choice in value.atoms(sympy.Piecewise):
            deciding.update(*(condition.free_symbols for _, condition in choice.args))
    written_out: dict[Expr, int] = {}
    kept = set()
    for step in steps:
        size = _parts(step.expression, written_out)
        if step.symbol in deciding and size > _LONG_CONDITION:
            kept.add(step.symbol)
            size = 1
        written_out[step.symbol] = size
    return kept


def _pieces(equations: StateEquations, results: Sequence[Expr]) -> set[Symbol]:
    """Assigned symbols that keep their names: none, unless the results would be too long without."""
    steps = [step for step in equations.assignments if isinstance(step, Assignment)]
    written_out: dict[Expr, int] = {}
    for step in steps:
        written_out[step.symbol] = _parts(step.expression, written_out)
    if sum(_parts(value, written_out) for value in results) <= _MOST_PARTS:
        return set()
    uses: dict[Expr, int] = {}
    for value in (*(step.expression for step in steps), *results):
        for node in sympy.preorder_traversal(value):
            uses[node] = uses.get(node, 0) + node.is_Symbol
    kept: dict[Symbol, None] = {}
    in_pieces: dict[Expr, int] = {}
    for step in steps:
        size = _parts(step.expression, in_pieces)
        if size > _LONG_PIECE and uses.get(step.symbol, 0) > 1:
            kept[step.symbol] = None
        else:
            in_pieces[step.symbol] = size
    return set(kept)


def _parts(value: Expr, sizes: Mapping[Expr, int]) -> int:
    """How many parts an expression has once the symbols with a size are written out."""
    found: dict[Expr, int] = {}

    def parts(node: Expr) -> int:
        if node.is_Symbol:
            return sizes.get(node, 1)
        if node not in found:
            found[node] = 1 + sum(map(parts, node.args))
        return found[node]

    return parts(value)


def equations_json(derivation: Derivation, equations: StateEquations) -> dict[str, Any]:
    """What ``bondgraph equations --json`` prints."""
    causal = derivation.causal
    found = explicit(equations)
    strokes = zip(causal.graph.bonds, causal.strokes, bond_labels(causal), causal.reasons, strict=True)
    return {
        "name": equations.name,
        "states": [
            {
                "name": state.symbol.name, "element": state.element, "variable": state.variable, "unit": state.unit,
            }
            for state in equations.states
        ],
        "inputs": [declared.name for declared in equations.inputs],
        "parameters": {parameter.name: parameter.value for parameter in equations.parameters},
        "derivatives": {state.name: to_sympy_text(value) for state, value in found.derivatives},
        "implicit": [
            {
                "unknowns": [unknown.name for unknown in loop.unknowns],
                "residuals": [to_sympy_text(r) for r in loop.residuals],
            }
            for loop in found.implicit
        ],
        "outputs": {output.name: to_sympy_text(value) for output, value in found.outputs},
        "causality": {
            "bonds": [
                {"source": bond.source, "target": bond.target, "stroke": stroke, "bond": label, "why": reason.text}
                for bond, stroke, label, reason in strokes
            ],
            "derivative": [
                name if causal.graph.nodes[name].ports == 1 else f"{name}.{port}" for name, port in causal.derivative
            ],
            "loops": [list(loop.elements) for loop in derivation.loops if loop.elements and not loop.of_rates],
        },
    }  # fmt: skip


def equations_text(derivation: Derivation, equations: StateEquations) -> str:
    """Causality and equations as a person reads them."""
    causal = derivation.causal
    found = explicit(equations)
    units = {state.symbol: state.unit for state in equations.states}
    lines = [f"{equations.name}: {len(equations.states)} states, {len(causal.graph.bonds)} bonds", "", "causality"]
    for label, stroke, reason in zip(bond_labels(causal), causal.strokes, causal.reasons, strict=True):
        lines.append(f"  {label:<32} stroke at {stroke:<7} {reason.text}")
    for name, port in causal.derivative:
        lines.append(f"  {name} (port {port}) is in derivative causality: it follows from the independent storages")
    for loop in derivation.loops:
        if not loop.of_rates and loop.elements:
            how = "solved in closed form" if loop.linear else "solved by Newton iteration"
            lines.append(f"  algebraic loop through {', '.join(loop.elements)}, {how}")
    lines += ["", "equations"]
    for step in equations.assignments:
        if isinstance(step, Assignment):
            lines.append(f"  {step.symbol} = {to_text(step.expression)}")
        else:
            unknowns = ", ".join(str(unknown) for unknown in step.unknowns)
            lines += [f"  {unknowns} from  {to_text(residual)} = 0" for residual in step.residuals]
    for state, value in zip(equations.states, equations.derivatives, strict=True):
        unit = f"   [{units[state.symbol]}/s]" if units[state.symbol] else ""
        lines.append(f"  d({state.symbol})/dt = {to_text(value)}{unit}")
    if found.outputs:
        lines += ["", "outputs"] + [f"  {output} = {to_text(value)}" for output, value in found.outputs]
    return "\n".join(lines)
