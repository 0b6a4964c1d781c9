"""Algebraic loops: torn, solved in closed form where they are linear, left to a Newton iteration where they are not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sympy import Add, Expr, Symbol

from bondgraph.derive.definitions import ONE, ZERO, Key, Rate, Residual
from bondgraph.derive.equations import Assignment, ImplicitLoop
from bondgraph.derive.linear import is_zero, solve_linear
from bondgraph.derive.order import tear
from bondgraph.errors import DerivationError

if TYPE_CHECKING:
    from bondgraph.derive.derivation import Derivation

#: Intermediate results of a loop with more operations than this get a name.
_LONG = 12


@dataclass(frozen=True)
class Loop:
    """A solved algebraic loop: the elements on it, the variables that were torn, and how it was solved."""

    elements: tuple[str, ...]
    torn: tuple[str, ...]
    linear: bool
    of_rates: bool


class LoopSolver:
    """Solves one strongly connected component of the definitions."""

    def __init__(self, derivation: Derivation, members: list[Key]) -> None:
        self.derivation = derivation
        self.members = members
        self.inside = set(members)
        self.rules = {key: derivation.variables.definition(key) for key in members}
        implicit = [key for key in members if isinstance(self.rules[key], Residual)]
        self.torn, self.order = tear(members, self._within, implicit)
        self.elements = self._elements()

    def _within(self, key: Key) -> list[Key]:
        rule = self.rules[key]
        return [] if rule is None else [used for used in rule.depends if used in self.inside]

    def solve(self) -> None:
        """Give every member a value."""
        linear = self._linear_system()
        of_rates = any(key[0] == "d" for key in self.members)
        if linear is None:
            self._newton()
        else:
            self._closed_form(*linear)
        for key in self._remaining():
            self.derivation.assign(key)
        names = tuple(self.derivation.label(key)[0] for key in self.torn)
        self.derivation.loops.append(Loop(self.elements, names, linear is not None, of_rates))

    def _remaining(self) -> list[Key]:
        return [key for key in self.order if key not in self.derivation.values]

    # ------------------------------------------------------------------ linear loops

    def _linear_system(self) -> tuple[list[list[Expr]], list[Expr]] | None:
        """Matrix and right-hand side of the torn variables, or None where the loop is not linear."""
        if any(isinstance(self.rules[key], Residual) for key in self.torn):
            return None
        coefficients: dict[Key, dict[Key, Expr]] = {key: {key: ONE} for key in self.torn}
        constants: dict[Key, Expr] = dict.fromkeys(self.torn, ZERO)
        symbols = {key: Symbol(f"__loop_{i}", real=True) for i, key in enumerate(self.members)}
        for key in self.order:
            row = self._affine(key, coefficients, constants, symbols)
            if row is None:
                return None
            coefficients[key], constants[key] = row
        matrix, right = [], []
        for key in self.torn:
            row = self._affine(key, coefficients, constants, symbols)
            if row is None:
                return None
            matrix.append([(ONE if other == key else ZERO) - row[0].get(other, ZERO) for other in self.torn])
            right.append(row[1])
        return matrix, right

    def _affine(
        self,
        key: Key,
        coefficients: dict[Key, dict[Key, Expr]],
        constants: dict[Key, Expr],
        symbols: dict[Key, Symbol],
    ) -> tuple[dict[Key, Expr], Expr] | None:
        """Coefficients of the torn variables in a member's value, and its value where they are zero."""
        rule = self.rules[key]
        assert rule is not None and not isinstance(rule, Residual)
        if isinstance(rule, Rate) and any(used in self.inside and used[0] != "d" for used in rule.depends):
            return None  # a rate whose slopes are taken at variables of the same loop
        open_values = {**self.derivation.values, **symbols}
        loop_symbols = set(symbols.values())
        row: dict[Key, Expr] = {}
        for used, partial in rule.partials(open_values):
            if used not in self.inside:
                continue
            if partial.free_symbols & loop_symbols:
                return None
            for torn, inner in coefficients[used].items():
                row[torn] = Add(row.get(torn, ZERO), partial * inner)
        constant = rule.build({**self.derivation.values, **{k: constants[k] for k in self.inside if k in constants}})
        return {torn: self._shorten(value, key) for torn, value in row.items() if value != 0}, self._shorten(
            constant, key
        )

    def _shorten(self, value: Expr, key: Key) -> Expr:
        if _operations(value) <= _LONG:
            return value
        name, _, meaning = self.derivation.label(key)
        return self.derivation.assign_as(f"{name}_part", value, "", f"part of {meaning}")

    def _closed_form(self, matrix: list[list[Expr]], right: list[Expr]) -> None:
        def name_it(value: Expr, hint: str) -> Expr:
            if _operations(value) <= _LONG:
                return value
            return self.derivation.assign_as(f"loop_{hint}", value, "", f"loop of {', '.join(self.elements)}")

        if len(right) == 1 and is_zero(matrix[0][0]):
            raise self._undetermined([0])
        for key, value in zip(self.torn, solve_linear(matrix, right, name_it, self._undetermined), strict=True):
            rule = self.rules[key]
            assert rule is not None
            self.derivation.values[key] = self.derivation.named(key, rule, value)

    def _undetermined(self, columns: list[int]) -> DerivationError:
        names = ", ".join(self.derivation.label(self.torn[column])[0] for column in columns)
        graph = self.derivation.causal.graph
        indices = [index for index in range(len(graph.bonds)) if self.inside & self._keys_of(index)]
        bonds = [f"bond {graph.bonds[index]}" for index in indices]
        signals = [f"signal {key[1]}" for key in self.members if key[0] == "s"]
        through = ", ".join([*self.elements, *signals, *bonds])
        return DerivationError(
            f"{graph.name}: the algebraic loop through {through} does not determine {names}: its gain is exactly one, "
            "so the equations leave a variable free - add a resistance or storage on the loop, or remove the redundant "
            "bond or signal",
            where=(*self.elements, *signals, *bonds),
        )

    def _keys_of(self, bond: int) -> set[Key]:
        read = self.derivation.variables
        keys = {read.effort(bond), read.flow(bond)}
        return keys | {("d", key) for key in keys}

    # ------------------------------------------------------------------ nonlinear loops

    def _newton(self) -> None:
        derivation = self.derivation
        unknowns = [derivation.fresh(derivation.label(key)[0]) for key in self.torn]
        values = {**derivation.values, **dict(zip(self.torn, unknowns, strict=True))}
        body: list[Assignment] = []
        for key in self.order:
            rule = self.rules[key]
            assert rule is not None and not isinstance(rule, Residual)
            value = rule.build(values)
            name, unit, meaning = derivation.label(key)
            if _operations(value) > 1 and self._uses_inside(key) > 1:
                local = derivation.fresh(f"{name}_in_loop")
                body.append(Assignment(local, value, unit, meaning))
                value = local
            values[key] = value
        residuals = []
        for key, unknown in zip(self.torn, unknowns, strict=True):
            rule = self.rules[key]
            assert rule is not None
            is_residual = isinstance(rule, Residual)
            residuals.append(rule.residual(unknown, values) if is_residual else rule.build(values) - unknown)  # type: ignore[union-attr]
        labels = [derivation.label(key) for key in self.torn]
        derivation.assignments.append(
            ImplicitLoop(
                "_".join(str(unknown) for unknown in unknowns[:2]),
                tuple(unknowns),
                (ZERO,) * len(unknowns),
                tuple(residuals),
                tuple(unit for _, unit, _ in labels),
                tuple(body),
                f"loop of {', '.join(self.elements)}" if self.elements else "implicit law",
            )
        )
        derivation.values.update(zip(self.torn, unknowns, strict=True))

    def _uses_inside(self, key: Key) -> int:
        return sum(key in self._within(other) for other in self.members)

    def _elements(self) -> tuple[str, ...]:
        """Elements whose laws are on the loop, in order of declaration."""
        variables = self.derivation.variables
        found: dict[str, None] = {}
        for node in self.derivation.causal.graph.nodes.values():
            if node.kind in ("R", "C", "I"):
                for port in variables.ports(node):
                    keys = (variables.effort(port.bond), variables.flow(port.bond), ("q", node.name, port.number))
                    on_loop = [key for key in keys if key in self.inside or ("d", key) in self.inside]
                    state = variables.state_of(node.name, port.number) if node.kind != "R" else None
                    rate = state is not None and ("d", ("x", state.symbol.name)) in self.inside
                    if len(on_loop) >= 2 or rate:
                        found[node.name] = None
        return tuple(found)


def _operations(value: Expr) -> int:
    """Nodes of an expression, counted until it is clearly long."""
    count, stack = 0, [value]
    while stack and count <= _LONG:
        item = stack.pop()
        count += 1
        stack.extend(item.args)
    return count
