"""Efforts of elements that hold their flows at zero: found from the equations, in closed form, all at once.

    d(flow)/dt = 0,        where  d(flow)/dt = a + sum of B_j effort_j  over all elements with modes,

is a small linear system, the same for all combinations of locked and slipping elements (Pfeiffer and Glocker 1996,
Multibody Dynamics with Unilateral Contacts, chapter 3, for the theory of such systems). Elements on one flow, such as
a brake and a bearing on one shaft, share what holds it in proportion to what each can hold.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping

from sympy import Abs, Add, Dummy, Expr, Float, Mul, Piecewise, Rational

from bondgraph.derive.definitions import ONE, ZERO, Constrained, Key, Residual
from bondgraph.derive.linear import quotient, solve_linear
from bondgraph.derive.loop_members import LONG, LoopMembers
from bondgraph.derive.size import is_long
from bondgraph.errors import DerivationError
from bondgraph.text import inflected

#: A pivot below this is zero.
_NO_PIVOT = Float(1e-12)

#: Coefficients of the efforts, and a constant.
_Row = tuple[list[Expr], Expr]


def solve_constrained(loop: LoopMembers) -> None:
    """Give the members of a loop through constrained efforts their values.

    Raises
    ------
    DerivationError
        If an effort acts on its own flow nonlinearly or not at all.
    """
    system = _ConstrainedSystem(loop)
    derivation = loop.derivation
    for key, value in zip(system.held, system.solve(), strict=True):
        derivation.values[key] = derivation.name(key, value)
    efforts = [derivation.values[key] for key in system.held]
    for key, (row, constant) in zip(system.rest, system.rest_rows, strict=True):
        rule = loop.rules[key]
        assert rule is not None
        value = Add(constant, *(a * effort for a, effort in zip(row, efforts, strict=True)))
        derivation.values[key] = derivation.named(key, rule, value)


class _ConstrainedSystem:
    """Rates of the flows as ``constant + row * efforts``, and the efforts that follow from the modes."""

    def __init__(self, loop: LoopMembers) -> None:
        self.loop, self.derivation = loop, loop.derivation
        self.held = [key for key in loop.torn if isinstance(loop.rules[key], Constrained)]
        self.rest = [key for key in loop.torn if key not in self.held]
        self.rules = [rule for key in self.held if isinstance(rule := loop.rules[key], Constrained)]
        self.names = [rule.element for rule in self.rules]
        self.coefficients: dict[Key, dict[Key, Expr]] = {key: {key: ONE} for key in loop.torn}
        self.constants = ChainMap(dict.fromkeys(loop.torn, ZERO), self.derivation.values)
        if any(isinstance(loop.rules[key], Residual) for key in loop.torn):
            raise self._nonlinear()
        for key in loop.order:
            self.coefficients[key], self.constants[key] = self._affine(key)
        self.rest_rows = self._eliminate()

    def _affine(self, key: Key) -> tuple[dict[Key, Expr], Expr]:
        row = self.loop.affine(key, self.coefficients, self.constants)
        if row is None:
            raise self._nonlinear()
        return row

    def _nonlinear(self) -> DerivationError:
        acts = inflected(self.names, "its effort acts on its own flow", "their efforts act on their own flows")
        return DerivationError(
            f"{', '.join(self.names)}: {acts} through a nonlinear algebraic loop, so what keeps "
            f"{inflected(self.names, 'it', 'them')} locked has no closed form"
            " - put an inertance at the junction, or derive the graph smooth",
            where=tuple(self.names),
        )

    def _name(self, value: Expr, hint: str) -> Expr:
        if not is_long(value, LONG):
            return value
        return self.derivation.assign_as(f"lock_{hint}", value, "", f"constraint of {', '.join(self.names)}")

    def _eliminate(self) -> list[tuple[list[Expr], Expr]]:
        """The other torn variables of the loop (rates of dependent storages) by the efforts: row and constant."""
        if not self.rest:
            return []
        rows = [self._affine(key) for key in self.rest]
        matrix = [
            [(ONE if a == b else ZERO) - row.get(b, ZERO) for b in self.rest]
            for a, (row, _) in zip(self.rest, rows, strict=True)
        ]
        columns = []
        for right in [*([row.get(held, ZERO) for row, _ in rows] for held in self.held), [c for _, c in rows]]:
            is_zero = self.derivation.zero_test.is_zero
            copy = [[*line] for line in matrix]
            columns.append(solve_linear(copy, right, self._name, lambda _: self._nonlinear(), is_zero))
        return [([column[i] for column in columns[:-1]], columns[-1][i]) for i in range(len(self.rest))]

    def _by_efforts(self, row: dict[Key, Expr], constant: Expr) -> tuple[list[Expr], Expr]:
        """A row over all torn variables as one over the efforts."""
        found = [row.get(held, ZERO) for held in self.held]
        for key, (inner, inner_constant) in zip(self.rest, self.rest_rows, strict=True):
            if (factor := row.get(key, ZERO)) != 0:
                found = [Add(a, factor * b) for a, b in zip(found, inner, strict=True)]
                constant = Add(constant, factor * inner_constant)
        return found, constant

    def solve(self) -> list[Expr]:
        """The efforts."""
        rates = [self._by_efforts(*self._row_of(rule.rate)) for rule in self.rules]
        for i, rule in enumerate(self.rules):
            if self.derivation.zero_test.is_zero(rates[i][0][i]):
                raise rule.refusal()
        slips = [self._slip(rule) for rule in self.rules]
        if len(self.rules) == 1:
            (row, constant), (slip_row, slip) = rates[0], slips[0]
            locked, free = quotient(constant, -row[0]), slip / (ONE - slip_row[0])
            return [Piecewise((locked, self.rules[0].constrained), (free, True))]
        matrix, right = self._joint(rates, slips)
        if not self._are_determined([row for row, _ in rates]):
            return self._solve_where_determined(matrix, right)
        # no pivot vanishes, whatever is locked: the gains are those of a mass matrix
        return solve_linear(matrix, right, self._name, lambda _: _SingularError(), lambda value: value == 0)

    def _row_of(self, key: Key) -> tuple[dict[Key, Expr], Expr]:
        return self.coefficients[key], self.constants[key]

    def _slip(self, rule: Constrained) -> tuple[list[Expr], Expr]:
        """The effort of a slipping element, which may depend on the other efforts (a normal force)."""
        key: Key = ("slip", rule.element)
        self.loop.rules[key] = rule.slip
        return self._by_efforts(*self._affine(key))

    def _joint(self, rates: list[_Row], slips: list[_Row]) -> tuple[list[list[Expr]], list[Expr]]:
        """One equation per element: its flow stays, where it is locked; its effort is the slipping one elsewhere.

        The first is divided by the element's own gain, so that both have the unit of an effort and the diagonal is one.
        """
        locked = [
            self.derivation.assign_as(
                f"locked_{rule.element}", Piecewise((ONE, rule.constrained), (ZERO, True)), "1",
                f"one while the flow of {rule.element} is held at zero",
            )
            for rule in self.rules
        ]  # fmt: skip
        matrix, right = [], []
        for i, (slip_row, slip) in enumerate(slips):
            row, constant = rates[i]
            line = [ZERO if rate == 0 else quotient(-rate, -row[i]) for rate in row]
            line[i] = ONE
            constant = quotient(constant, -row[i])
            before = [g for g in range(i) if self.rules[g].rate == self.rules[i].rate]
            if before:  # one of them holds the flow already, so this one takes its share of the effort
                alone = Mul(*(1 - locked[g] for g in before))
                shares = self._shares(i, {g: locked[g] for g in before})
                line = [alone * held + (1 - alone) * share for held, share in zip(line, shares, strict=True)]
                constant = alone * constant
            free = [(ONE if i == j else ZERO) - slip_row[j] for j in range(len(line))]
            matrix.append([_mixed(locked[i], held, slips) for held, slips in zip(line, free, strict=True)])
            right.append(locked[i] * constant + (1 - locked[i]) * slip)
        return matrix, right

    def _shares(self, i: int, locked: Mapping[int, Expr]) -> list[Expr]:
        """A row that vanishes where an element has its share of what those locked before on its flow carry with it.

        The share is in proportion to what each can hold.
        """
        try:
            static = {k: self.rules[k].static.build(self.derivation.values) for k in (i, *locked)}
        except KeyError:  # what one can hold depends on the efforts that are to be found
            raise self._unknown_capacity() from None
        others = Add(*(locked[g] * static[g] for g in locked))
        whole = self._name(others + static[i], f"share_{i}")
        half = Rational(1, 2)  # where none can hold anything
        line = [ZERO] * len(self.rules)
        line[i] = Piecewise((others / whole, whole > 0), (half, True))
        own = Piecewise((static[i] / whole, whole > 0), (half, True))
        for g, is_locked in locked.items():
            line[g] = -self.rules[i].sign * self.rules[g].sign * is_locked * own
        return line

    def _are_determined(self, rates: list[list[Expr]]) -> bool:
        """Whether the efforts of all elements follow when all are locked, those on a common flow taken as one."""
        flows = [rule.rate for rule in self.rules]
        first = [i for i, flow in enumerate(flows) if flow not in flows[:i]]
        gains = [[rates[i][j] for j in first] for i in first]
        zero_test = self.derivation.zero_test

        def stand_in(value: Expr, hint: str) -> Expr:
            if not is_long(value, LONG):
                return value
            short = Dummy(hint, real=True)
            zero_test.define(short, value)
            return short

        try:
            solve_linear(gains, [ZERO] * len(gains), stand_in, lambda _: _SingularError(), zero_test.is_zero)
        except _SingularError:
            return False
        return True

    def _solve_where_determined(self, matrix: list[list[Expr]], right: list[Expr]) -> list[Expr]:
        """Elimination along the diagonal; an effort that the ones before leave no work for is zero.

        A body at rest between two stops, or one that friction and a stop both hold, is such a case: statically
        indeterminate, so that any efforts in balance will do. The rows have been brought to a diagonal of one, hence a
        pivot that vanishes is rounding of one.
        """
        n, pivots, kept = len(right), [], []
        for k, name in enumerate(self.names):
            pivot = self._name(matrix[k][k], f"pivot_{k}")
            keep = self.derivation.assign_as(
                f"determined_{name}", Piecewise((ONE, Abs(pivot) > _NO_PIVOT), (ZERO, True)), "1",
                f"zero where others hold the flow of {name} already",
            )  # fmt: skip
            pivots.append(self._name(pivot + 1 - keep, f"divisor_{k}"))
            kept.append(keep)
            for i in range(k + 1, n):
                if matrix[i][k] == 0:
                    continue
                ratio = self._name(keep * matrix[i][k] / pivots[k], f"ratio_{i}_{k}")
                for j in range(k + 1, n):
                    if matrix[k][j] != 0:
                        matrix[i][j] = self._name(matrix[i][j] - ratio * matrix[k][j], f"entry_{i}_{j}")
                right[i] = self._name(right[i] - ratio * right[k], f"right_{i}")
        efforts: list[Expr] = [ZERO] * n
        for k in reversed(range(n)):
            later = Add(*(matrix[k][j] * efforts[j] for j in range(k + 1, n)))
            efforts[k] = self._name(kept[k] * (right[k] - later) / pivots[k], f"effort_{k}")
        return efforts

    def _unknown_capacity(self) -> DerivationError:
        names = ", ".join(self.names)
        return DerivationError(
            f"{self.derivation.causal.graph.name}: how {names} share the effort on their flow is not determined, since "
            "what one of them can hold depends on that effort - join them into one, or derive the graph smooth",
            where=tuple(self.names),
        )


class _SingularError(Exception):
    """Gains that leave an effort free."""


def _mixed(locked: Expr, held: Expr, free: Expr) -> Expr:
    """One coefficient of an element that is locked or free."""
    return held if held == free else locked * held + (1 - locked) * free
