"""Algebraic loops: torn, solved in closed form where they are linear, left to a Newton iteration where they are not."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping, Sequence

from sympy import Expr, Symbol

from bondgraph.derive.computed import Loop
from bondgraph.derive.definitions import ONE, ZERO, Constrained, Key, Residual
from bondgraph.derive.equations import Assignment, ImplicitLoop
from bondgraph.derive.laws import solve_for
from bondgraph.derive.linear import solve_linear
from bondgraph.derive.locking import solve_constrained
from bondgraph.derive.loop_members import LONG, LoopMembers
from bondgraph.derive.piecewise import solve_piecewise
from bondgraph.derive.size import is_long
from bondgraph.errors import DerivationError


class LoopSolver(LoopMembers):
    """Solves one strongly connected component of the definitions."""

    def solve(self) -> None:
        """Give every member a value."""
        if any(isinstance(rule, Constrained) for rule in self.rules.values()):
            solve_constrained(self)
            for key in self._remaining():
                self.derivation.assign(key)
            return
        mark = self.derivation.mark()
        linear = self._linear_system()
        of_rates = all(key[0] == "d" for key in self.torn)
        if linear is None:
            self.derivation.return_to(mark)
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
        constants = ChainMap(dict.fromkeys(self.torn, ZERO), self.derivation.values)
        for key in self.order:
            row = self.affine(key, coefficients, constants)
            if row is None:
                return None
            coefficients[key], constants[key] = row
        matrix, right = [], []
        for key in self.torn:
            row = self.affine(key, coefficients, constants)
            if row is None:
                return None
            matrix.append([(ONE if other == key else ZERO) - row[0].get(other, ZERO) for other in self.torn])
            right.append(row[1])
        return matrix, right

    def _closed_form(self, matrix: list[list[Expr]], right: list[Expr]) -> None:
        def name_it(value: Expr, hint: str) -> Expr:
            if not is_long(value, LONG):
                return value
            return self.derivation.assign_as(f"loop_{hint}", value, "", f"loop of {', '.join(self.elements)}")

        is_zero = self.derivation.zero_test.is_zero
        for key, value in zip(
            self.torn, solve_linear(matrix, right, name_it, self._undetermined, is_zero), strict=True
        ):
            rule = self.rules[key]
            assert rule is not None
            self.derivation.values[key] = self.derivation.named(key, rule, value)

    def _undetermined(self, columns: list[int]) -> DerivationError:
        names = ", ".join(self.derivation.label(self.torn[column])[0] for column in columns)
        graph = self.derivation.causal.graph
        indices = [index for index in range(len(graph.bonds)) if self.inside & self._keys_of(index)]
        bonds = [f"bond {graph.bonds[index]}" for index in indices]
        signals = [f"signal {name}" for name in self.signals]
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
        unknowns = [derivation.symbol_of(key) for key in self.torn]
        values = ChainMap(dict(zip(self.torn, unknowns, strict=True)), derivation.values)
        body: list[Assignment] = []
        for key in self.order:
            rule = self.rules[key]
            assert rule is not None and not isinstance(rule, Residual)
            value = rule.build(values)
            name, unit, meaning = derivation.label(key)
            if is_long(value, 1) and self._uses_inside(key) > 1:
                local = derivation.fresh(f"{name}_in_loop")
                body.append(Assignment(local, value, unit, meaning))
                value = local
            values[key] = value
        residuals = [self._residual(key, unknown, values) for key, unknown in zip(self.torn, unknowns, strict=True)]
        solved = self._without_iteration(body, residuals[0], unknowns[0]) if len(residuals) == 1 else None
        if solved is not None:
            derivation.assignments.append(Assignment(unknowns[0], solved, *derivation.label(self.torn[0])[1:]))
            derivation.values[self.torn[0]] = unknowns[0]
            return
        labels = [derivation.label(key) for key in self.torn]
        derivation.assignments.append(
            ImplicitLoop(
                "_".join(str(unknown) for unknown in unknowns[:2]),
                tuple(unknowns),
                tuple(self._guess(key) for key in self.torn),
                tuple(residuals),
                tuple(unit for _, unit, _ in labels),
                tuple(body),
                f"{'loop' if len(self.members) > 1 else 'law'} of {', '.join([*self.elements, *self.signals])}",
            )
        )
        derivation.values.update(zip(self.torn, unknowns, strict=True))

    def _without_iteration(self, body: Sequence[Assignment], residual: Expr, unknown: Symbol) -> Expr | None:
        """The root of a residual that is rational of the first degree, or straight between kinks."""
        inside: dict[Expr, Expr] = {}
        for local in body:
            inside[local.symbol] = local.expression.xreplace(inside)
        whole = residual.xreplace(inside)
        if is_long(whole, 4 * LONG):
            return None
        solved = solve_for(whole, unknown) if not is_long(whole, 2 * LONG) else None
        return solved if solved is not None else solve_piecewise(whole + unknown, unknown, self._name_part)

    def _name_part(self, value: Expr, hint: str) -> Expr:
        if value.is_Atom:
            return value
        elements = ", ".join([*self.elements, *self.signals])
        return self.derivation.assign_as(
            f"{self.derivation.label(self.torn[0])[0]}_{hint}", value, "", f"loop of {elements}"
        )

    def _residual(self, key: Key, unknown: Symbol, values: Mapping[Key, Expr]) -> Expr:
        rule = self.rules[key]
        assert rule is not None
        return rule.residual(unknown, values) if isinstance(rule, Residual) else rule.build(values) - unknown

    def _guess(self, key: Key) -> Expr:
        """Where Newton's method starts: the declared start value of the element, one for a modulus, else zero."""
        rule = self.rules[key]
        if key[0] == "m":
            return ONE
        return rule.guess if isinstance(rule, Residual) else ZERO

    def _uses_inside(self, key: Key) -> int:
        return sum(key in self.within(other) for other in self.members)
