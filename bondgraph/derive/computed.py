"""What a derivation has computed so far: the values of variables, and the assignments with their names."""

from __future__ import annotations

from dataclasses import dataclass

from sympy import Expr, Symbol

from bondgraph.declare.quantities import symbol
from bondgraph.derive.algebra import algebra
from bondgraph.derive.causality import CausalGraph
from bondgraph.derive.definitions import Definition, Key, Law, Residual
from bondgraph.derive.equations import Assignment, ImplicitLoop
from bondgraph.derive.rules import bond_variables
from bondgraph.derive.size import is_long, is_small
from bondgraph.derive.zero import ZeroTest


@dataclass(frozen=True)
class Loop:
    """A solved algebraic loop: the elements on it, the variables that were torn, and how it was solved."""

    elements: tuple[str, ...]
    torn: tuple[str, ...]
    linear: bool
    of_rates: bool


class Computed:
    """Values of the variables computed so far, in order, as expressions in named symbols.

    Parameters
    ----------
    causal
        Graph with all strokes placed.
    smooth
        Whether switches, friction and impacts are taken as smooth laws.
    free
        Whether the efforts of elements with modes are inputs.
    """

    def __init__(self, causal: CausalGraph, smooth: bool = True, free: bool = False) -> None:
        self.causal = causal
        self.smooth = smooth
        with algebra(causal.graph.name):
            self.variables = bond_variables(causal, smooth, free)
        self.values: dict[Key, Expr] = {}
        self.assignments: list[Assignment | ImplicitLoop] = []
        self.loops: list[Loop] = []
        self.uses: dict[Key, int] = {}
        self.zero_test = ZeroTest()
        self.taken: dict[str, None] = dict.fromkeys([*causal.graph.quantities, "t", "x", "u", "theta"])
        for state in self.variables.states:
            self.values["x", state.symbol.name] = state.symbol
            self.taken[state.symbol.name] = None

    def assign(self, key: Key) -> None:
        """Give one variable its value; name it unless it is small or used once."""
        rule = self.variables.definition(key)
        if rule is None:
            return
        assert not isinstance(rule, Residual)
        self.values[key] = self.named(key, rule, rule.build(self.values))

    def named(self, key: Key, rule: Definition, value: Expr) -> Expr:
        """The value itself where it may be repeated, else the symbol of a new assignment."""
        if is_small(value):
            return value
        if self.uses.get(key, 0) <= 1 and not _is_physical(key, rule) and not is_long(value):
            return value
        return self.name(key, value)

    def name(self, key: Key, value: Expr) -> Symbol:
        """A new assignment under the variable's own name."""
        _, unit, meaning = self.label(key)
        target = self.symbol_of(key)
        self.assignments.append(Assignment(target, value, unit, meaning))
        self.zero_test.define(target, value)
        return target

    def symbol_of(self, key: Key) -> Symbol:
        """A new symbol for a variable; a named signal has its own name, any other gives way to declared names."""
        wanted = self.label(key)[0]
        if key[0] == "s":
            self.taken.pop(wanted, None)  # kept free for the signal itself
        return self.fresh(wanted)

    def assign_as(self, wanted: str, value: Expr, unit: str, meaning: str) -> Symbol:
        """A new assignment; the name gives way to declared ones."""
        target = self.fresh(wanted)
        self.assignments.append(Assignment(target, value, unit, meaning))
        self.zero_test.define(target, value)
        return target

    def mark(self) -> int:
        """Where the assignments end now, for :meth:`return_to`."""
        return len(self.assignments)

    def return_to(self, mark: int) -> None:
        """Take back assignments that turned out not to be needed."""
        for taken_back in self.assignments[mark:]:
            if isinstance(taken_back, Assignment):
                del self.taken[taken_back.symbol.name]
        if len(self.assignments) > mark:
            del self.assignments[mark:]
            self.zero_test = ZeroTest()
            for kept in self.assignments:
                if isinstance(kept, Assignment):
                    self.zero_test.define(kept.symbol, kept.expression)

    def fresh(self, wanted: str) -> Symbol:
        """A symbol whose name is not taken."""
        while wanted in self.taken:
            wanted += "_"
        self.taken[wanted] = None
        return symbol(wanted)

    def label(self, key: Key) -> tuple[str, str, str]:
        """Name, unit and meaning of a variable."""
        return self.variables.labels.get(key, ("value", "", ""))


def _is_physical(key: Key, rule: Definition) -> bool:
    """Named signals, and efforts and flows given by an element's law, keep their names: the physics stays readable."""
    if key[0] == "s":
        return True
    if not isinstance(rule, Law) or key[0] not in ("e", "f"):
        return False
    return bool(rule.arguments)
