"""The members of an algebraic loop: which are torn, in which order the others follow, and how they do where linear."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import MutableMapping

from sympy import Add, Expr, Symbol

from bondgraph.derive.computed import Computed
from bondgraph.derive.definitions import ZERO, Constrained, Key, Rate, Residual
from bondgraph.derive.order import tear
from bondgraph.derive.size import is_long

#: Intermediate results of a loop with more operations than this get a name.
LONG = 12


class LoopMembers:
    """One strongly connected component of the definitions, torn."""

    def __init__(self, derivation: Computed, members: list[Key]) -> None:
        self.derivation = derivation
        self.members = members
        self.inside = set(members)
        self.rules = {key: derivation.variables.definition(key) for key in members}
        self.stand_ins = {key: Symbol(f"__loop_{i}", real=True) for i, key in enumerate(members)}
        self.open_values = ChainMap({**self.stand_ins}, derivation.values)
        self.loop_symbols = set(self.stand_ins.values())
        implicit = [key for key in members if isinstance(self.rules[key], Residual | Constrained)]
        self.torn, self.order = tear(members, self.within, implicit, self._nonlinear_arguments())
        self.elements = self._elements()
        self.signals = [key[1] for key in members if key[0] == "s"]

    def within(self, key: Key) -> list[Key]:
        """Members on which another depends directly."""
        rule = self.rules[key]
        return [] if rule is None else [used for used in rule.depends if used in self.inside]

    def _nonlinear_arguments(self) -> set[Key]:
        """Members on which others depend nonlinearly.

        Guessing these is better than guessing what follows from them: the residual then contains the law itself, whose
        slope tells Newton's method where to go, and not the law of a law's argument.
        """
        found: dict[Key, None] = {}
        for rule in self.rules.values():
            if rule is None or isinstance(rule, Residual | Rate | Constrained):
                continue
            for used, partial in rule.partials(self.open_values):
                if used in self.inside and not partial.free_symbols.isdisjoint(self.loop_symbols):
                    found[used] = None
        return set(found)

    def _elements(self) -> tuple[str, ...]:
        """Elements whose laws are on the loop, in order of declaration."""
        read = self.derivation.variables
        counts: dict[str, int] = {}
        for key in self.members:
            rate = key[0] == "d"
            if rate and key[1][0] == "x":
                name = read.state_elements.get(key[1][1])
                counts.update({name: 2} if name else {})
                continue
            for name in read.elements_of(key[1] if rate else key):
                counts[name] = counts.get(name, 0) + 1
        alone = len(self.members) == 1
        nodes = read.positions
        most = 1 if alone or max(counts.values(), default=0) < 2 else 2  # a loop of signals passes each element once
        return tuple(sorted((name for name, count in counts.items() if count >= most), key=nodes.__getitem__))

    def affine(
        self, key: Key, coefficients: dict[Key, dict[Key, Expr]], constants: MutableMapping[Key, Expr]
    ) -> tuple[dict[Key, Expr], Expr] | None:
        """Coefficients of the torn variables in a member's value, and its value where they are zero."""
        rule = self.rules[key]
        assert rule is not None and not isinstance(rule, Residual)
        if isinstance(rule, Rate) and any(used in self.inside and used[0] != "d" for used in rule.depends):
            return None  # a rate whose slopes are taken at variables of the same loop
        row: dict[Key, Expr] = {}
        for used, partial in rule.partials(self.open_values):
            if used not in self.inside:
                continue
            if not partial.free_symbols.isdisjoint(self.loop_symbols):
                return None
            for torn, inner in coefficients[used].items():
                row[torn] = Add(row.get(torn, ZERO), partial * inner)
        shortened = {torn: self._shorten(value, key) for torn, value in row.items() if value != 0}
        return shortened, self._shorten(rule.build(constants), key)

    def _shorten(self, value: Expr, key: Key) -> Expr:
        if not is_long(value, LONG):
            return value
        name, _, meaning = self.derivation.label(key)
        return self.derivation.assign_as(f"{name}_part", value, "", f"part of {meaning}")
