"""Discrete modes of exactly derived models: sides of switches, friction that locks, impacts.

A mode is held between events, so that the equations are smooth wherever they are integrated: a switch stays on its side
until its argument has crossed zero, a locked clutch stays locked until the effort that keeps it so exceeds its
capacity. Each mode is a held input of the equations. What keeps an element locked is found in
:mod:`bondgraph.derive.locking`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from sympy import Expr, Integer, Piecewise, Symbol

from bondgraph.declare.expressions import to_text
from bondgraph.declare.functions import switch
from bondgraph.declare.quantities import Input, symbol
from bondgraph.derive.definitions import ZERO, Key, Law
from bondgraph.derive.equations import Assignment, ImplicitLoop, Mode, ModeKind, StateEquations, ZeroFunction

#: Values of the modes and the words for them.
LETTERS: dict[ModeKind, tuple[tuple[str, float], ...]] = {
    "switch": (("by value", 0.0), ("positive", 1.0), ("negative", -1.0)),
    "friction": (("locked", 0.0), ("forward", 1.0), ("backward", -1.0)),
    "impact": (("apart", 0.0), ("touching", 1.0)),
}


@dataclass(frozen=True)
class Draft:
    """A mode before the equations are known: its zero functions as laws, with unit and meaning."""

    kind: ModeKind
    element: str
    functions: tuple[tuple[Law, str, str], ...]


@dataclass
class ModeNotes:
    """The modes of one graph, noted while its laws are read; ``owner`` is whose law is being read.

    ``free`` takes the efforts of elements with modes as given from outside, under the names in ``efforts``.
    """

    free: bool = False
    owner: str = ""
    efforts: dict[str, Symbol] = field(default_factory=dict)
    drafts: dict[Symbol, Draft] = field(default_factory=dict)
    _sides: dict[Law, Symbol] = field(default_factory=dict)

    # ------------------------------------------------------------------ while laws are read

    def hold(self, expression: Expr, read: Callable[[Expr], Law], unused: Callable[[str], str]) -> Expr:
        """Switches as jumps that stay on the side on which they are held; by the value itself where they are not.

        ``read`` makes a law of what a switch looks at, ``unused`` a name that nothing else has.
        """
        for used in sorted(expression.atoms(switch), key=str):
            value = used.args[0]
            law = read(value)
            if law not in self._sides:
                side = symbol(unused(f"side_{self.owner or 'output'}"))
                self._sides[law] = side
                self.drafts[side] = Draft("switch", self.owner or "output", ((law, "", to_text(value)),))
            expression = expression.xreplace({used: held_jump(value, self._sides[law])})
        return expression

    # ------------------------------------------------------------------ when all are read

    def depends(self) -> list[Key]:
        """Keys that the zero functions use."""
        return [key for draft in self.drafts.values() for law, _, _ in draft.functions for key in law.depends]

    def inputs(self) -> list[Input]:
        """The held inputs by which the equations take their modes."""
        found = []
        for mode, draft in self.drafts.items():
            of = draft.element if draft.kind != "switch" else f"{draft.functions[0][2]} in {draft.element}"
            meaning = f"{'side' if draft.kind == 'switch' else 'mode'} of {of}"
            found.append(Input(mode.name, "1", meaning, 0.0, "hold", LETTERS[draft.kind]))
        return found

    def build(self, values: Mapping[Key, Expr]) -> list[Mode]:
        """The modes with their zero functions as expressions; how states jump is added later."""
        found = []
        for mode, draft in self.drafts.items():
            functions = tuple(ZeroFunction(law.build(values), unit, meaning) for law, unit, meaning in draft.functions)
            found.append(Mode(mode, draft.kind, draft.element, functions))
        return found


def held_jump(value: Expr, side: Symbol) -> Expr:
    """A switch held at one where ``side`` is positive, at zero where it is negative; by its value where it is zero.

    Examples
    --------
    >>> held_jump(Symbol("v"), Symbol("side")).subs(Symbol("side"), 0)
    Piecewise((1, v > 0), (0, True))
    """
    one, zero = Integer(1), Integer(0)
    return Piecewise((one, side > 0), (zero, side < 0), (one, value > 0), (zero, True))


def by_value(equations: StateEquations) -> StateEquations:
    """The same equations with every switch on the side of its value, not on one that is held: to read, or to evaluate.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> from bondgraph.derive.derivation import derive
    >>> g = BondGraph("braked")
    >>> body = g.one_junction("body")
    >>> _ = g.inertance("mass", 2, at=body, state="v")
    >>> _ = g.resistance("stop", lambda v: 3 * switch(v, 1), at=body)
    >>> by_value(derive(assign_causality(g), smooth=False)).assignments[0].expression
    3*Piecewise((1, v > 0), (0, True))
    """
    sides = {mode.symbol: ZERO for mode in equations.modes if mode.kind == "switch"}
    if not sides:
        return equations
    return replace(
        equations,
        inputs=tuple(signal for signal in equations.inputs if signal.symbol not in sides),
        assignments=tuple(_replaced(step, sides) for step in equations.assignments),
        derivatives=tuple(value.xreplace(sides) for value in equations.derivatives),
        outputs=tuple(replace(output, expression=output.expression.xreplace(sides)) for output in equations.outputs),
        modes=tuple(mode for mode in equations.modes if mode.symbol not in sides),
        events=tuple(event.xreplace(sides) for event in equations.events),
    )


def _replaced(step: Assignment | ImplicitLoop, values: Mapping[Symbol, Expr]) -> Assignment | ImplicitLoop:
    if isinstance(step, Assignment):
        return replace(step, expression=step.expression.xreplace(values))
    return replace(
        step,
        guesses=tuple(guess.xreplace(values) for guess in step.guesses),
        residuals=tuple(residual.xreplace(values) for residual in step.residuals),
        body=tuple(replace(local, expression=local.expression.xreplace(values)) for local in step.body),
    )


def modes_json(equations: StateEquations) -> list[dict[str, Any]]:
    """The modes as ``bondgraph equations --exact --json`` prints them."""
    return [
        {
            "name": mode.symbol.name, "kind": mode.kind, "element": mode.element, "values": dict(LETTERS[mode.kind]),
            "functions": [{"is": to_text(f.expression), "unit": f.unit, "meaning": f.meaning} for f in mode.functions],
        }
        for mode in equations.modes
    ]  # fmt: skip


def modes_text(equations: StateEquations) -> str:
    """The modes as a person reads them, empty where there are none."""
    lines = [
        f"  {mode.kind} {mode.element}: {function.meaning} = {to_text(function.expression)}"
        for mode in equations.modes
        for function in mode.functions
    ]
    return "\n".join(["", "events, where one of these passes zero", *lines]) if lines else ""
