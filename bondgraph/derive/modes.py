"""Discrete modes of exactly derived models: sides of switches, friction that locks, impacts.

A mode is held between events, so that the equations are smooth wherever they are integrated: a switch stays on its side
until its argument has crossed zero, a locked clutch stays locked until the effort that keeps it so exceeds its
capacity. Each mode is a held input of the equations. The constrained effort of a locked element follows from

    d(flow)/dt = 0,        where  d(flow)/dt = a + sum of B_j effort_j  over all elements with modes,

a small linear system in closed form, the same for all combinations of locked and slipping elements (Pfeiffer and
Glocker 1996, Multibody Dynamics with Unilateral Contacts, chapter 3, for the theory of such systems).
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from sympy import Add, Dummy, Eq, Expr, Integer, Piecewise, Symbol

from bondgraph.declare.elements import Node
from bondgraph.declare.expressions import to_text
from bondgraph.declare.functions import switch
from bondgraph.declare.modal import smooth_effort
from bondgraph.declare.quantities import Input, symbol
from bondgraph.derive.definitions import ONE, ZERO, Constrained, Key, Law, Residual
from bondgraph.derive.equations import Assignment, ImplicitLoop, Mode, ModeKind, StateEquations, ZeroFunction
from bondgraph.derive.linear import quotient, solve_linear
from bondgraph.derive.size import is_long
from bondgraph.errors import DerivationError

if TYPE_CHECKING:
    from bondgraph.derive.loops import LoopSolver
    from bondgraph.derive.variables import BondVariables

#: Values of the modes and the words for them.
LETTERS: dict[ModeKind, tuple[tuple[str, float], ...]] = {
    "switch": (("by value", 0.0), ("positive", 1.0), ("negative", -1.0)),
    "friction": (("locked", 0.0), ("forward", 1.0), ("backward", -1.0)),
    "impact": (("apart", 0.0), ("touching", 1.0)),
}
#: The value at which the flow of an element is held at zero.
_CONSTRAINED = {"friction": 0, "impact": 1}
_LONG = 12


@dataclass(frozen=True)
class _Draft:
    """A mode before the equations are known: its zero functions as laws, with unit and meaning."""

    kind: ModeKind
    element: str
    functions: tuple[tuple[Law, str, str], ...]


@dataclass
class ModeNotes:
    """The modes of one graph, noted while its laws are read; ``owner`` is whose law is being read.

    ``free`` takes the efforts of elements with modes as given from outside, under the names in ``efforts``.
    """

    variables: BondVariables
    free: bool = False
    owner: str = ""
    efforts: dict[str, Symbol] = field(default_factory=dict)
    drafts: dict[Symbol, _Draft] = field(default_factory=dict)
    _sides: dict[Law, Symbol] = field(default_factory=dict)

    # ------------------------------------------------------------------ while laws are read

    def hold(self, expression: Expr, own: dict[Symbol, tuple[Key, int]]) -> Expr:
        """Switches as jumps that stay on the side on which they are held; by the value itself where they are not."""
        for used in sorted(expression.atoms(switch), key=str):
            value = used.args[0]
            law = self.variables.law(value, own)
            if law not in self._sides:
                side = symbol(self.variables._unused(f"side_{self.owner or 'output'}"))
                self._sides[law] = side
                self.drafts[side] = _Draft("switch", self.owner or "output", ((law, "", to_text(value)),))
            expression = expression.xreplace({used: held_jump(value, self._sides[law])})
        return expression

    def define(self, node: Node) -> None:
        """The effort of an element with modes: smooth, given from outside, or by its mode."""
        variables, port = self.variables, self.variables.ports(node)[0]
        variables.label_port(port)
        key, _ = variables.own(port, "effort")
        own = {symbol(v): variables.own(port, v) for v in ("effort", "flow")}
        laws = dict(node.laws)
        if variables.smooth:
            variables.definitions[key] = variables.law(smooth_effort(laws), own)
            return
        kind: ModeKind = "impact" if "gap" in laws else "friction"
        mode = symbol(variables._unused(f"mode_{node.name}"))
        self.drafts[mode] = _Draft(kind, node.name, self._functions(node, laws, own))
        if self.free:
            self.efforts[node.name] = symbol(variables._unused(f"effort_{node.name}"))
            variables.definitions[key] = Law(self.efforts[node.name], ())
            return
        slip = variables.law(mode * laws["capacity"] if kind == "friction" else ZERO, own)
        rate: Key = ("d", variables.own(port, "flow")[0])
        variables.definitions[key] = Constrained(node.name, rate, Eq(mode, _CONSTRAINED[kind]), slip)

    def _functions(
        self, node: Node, laws: Mapping[str, Expr], own: dict[Symbol, tuple[Key, int]]
    ) -> tuple[tuple[Law, str, str], ...]:
        variables, name = self.variables, node.name
        domain = variables.bond_domain(variables.ports(node)[0].bond)
        effort, flow, distance = (
            "" if domain is None else unit
            for unit in (
                domain and domain.effort_unit, domain and domain.flow_unit, domain and domain.displacement_unit,
            )
        )  # fmt: skip
        if "gap" in laws:
            rows = [
                (laws["gap"], distance, f"gap of {name}"),
                (-symbol("effort"), effort, f"push of {name}"),
                (symbol("flow"), flow, f"opening speed of {name}"),
            ]
        else:
            static = laws.get("static", laws["capacity"]).xreplace({symbol("flow"): ZERO})
            rows = [
                (symbol("flow"), flow, f"flow of {name}"),
                (static - symbol("effort"), effort, f"what {name} can carry forward beyond its effort"),
                (static + symbol("effort"), effort, f"what {name} can carry backward beyond its effort"),
            ]
        return tuple((variables.law(law, own), unit or "", meaning) for law, unit, meaning in rows)

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


# ---------------------------------------------------------------------- constrained efforts


def solve_constrained(solver: LoopSolver) -> None:
    """Give the members of a loop through constrained efforts their values.

    Raises
    ------
    DerivationError
        If an effort acts on its own flow nonlinearly or not at all, or several locked elements leave their efforts
        undetermined.
    """
    system = _ConstrainedSystem(solver)
    derivation = solver.derivation
    for key, value in zip(system.held, system.solve(), strict=True):
        derivation.values[key] = derivation.name(key, value)
    efforts = [derivation.values[key] for key in system.held]
    for key, (row, constant) in zip(system.rest, system.rest_rows, strict=True):
        rule = solver.rules[key]
        assert rule is not None
        value = Add(constant, *(a * effort for a, effort in zip(row, efforts, strict=True)))
        derivation.values[key] = derivation.named(key, rule, value)


class _ConstrainedSystem:
    """Rates of the flows as ``constant + row * efforts``, and the efforts that follow from the modes."""

    def __init__(self, solver: LoopSolver) -> None:
        self.solver, self.derivation = solver, solver.derivation
        self.held = [key for key in solver.torn if isinstance(solver.rules[key], Constrained)]
        self.rest = [key for key in solver.torn if key not in self.held]
        self.rules = [rule for key in self.held if isinstance(rule := solver.rules[key], Constrained)]
        self.names = [rule.element for rule in self.rules]
        self.coefficients: dict[Key, dict[Key, Expr]] = {key: {key: ONE} for key in solver.torn}
        self.constants = ChainMap(dict.fromkeys(solver.torn, ZERO), self.derivation.values)
        if any(isinstance(solver.rules[key], Residual) for key in solver.torn):
            raise self._nonlinear()
        for key in solver.order:
            self.coefficients[key], self.constants[key] = self._affine(key)
        self.rest_rows = self._eliminate()

    def _affine(self, key: Key) -> tuple[dict[Key, Expr], Expr]:
        row = self.solver._affine(key, self.coefficients, self.constants)
        if row is None:
            raise self._nonlinear()
        return row

    def _nonlinear(self) -> DerivationError:
        names = ", ".join(self.names)
        return DerivationError(
            f"{names}: its effort acts on its own flow through a nonlinear algebraic loop, so what keeps it locked has "
            "no closed form - put an inertance at its junction, or derive the graph smooth",
            where=tuple(self.names),
        )

    def _name(self, value: Expr, hint: str) -> Expr:
        if not is_long(value, _LONG):
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
        self._require_determined([row for row, _ in rates])
        return self._joint(rates, slips)

    def _row_of(self, key: Key) -> tuple[dict[Key, Expr], Expr]:
        return self.coefficients[key], self.constants[key]

    def _slip(self, rule: Constrained) -> tuple[list[Expr], Expr]:
        """The effort of a slipping element, which may depend on the other efforts (a normal force)."""
        key: Key = ("slip", rule.element)
        self.solver.rules[key] = rule.slip
        return self._by_efforts(*self._affine(key))

    def _joint(self, rates: list[tuple[list[Expr], Expr]], slips: list[tuple[list[Expr], Expr]]) -> list[Expr]:
        """One equation per element: its flow stays, where it is locked; its effort is the slipping one elsewhere.

        The first is divided by the element's own gain, so that both have the unit of an effort and the diagonal is one.
        """
        matrix, right = [], []
        for i, rule in enumerate(self.rules):
            (row, constant), (slip_row, slip) = rates[i], slips[i]
            locked = self.derivation.assign_as(
                f"locked_{rule.element}", Piecewise((ONE, rule.constrained), (ZERO, True)), "1",
                f"one while the flow of {rule.element} is held at zero",
            )  # fmt: skip
            line = []
            for j, of_rate in enumerate(row):
                held = ZERO if i == j or of_rate == 0 else locked * quotient(-of_rate, -row[i])
                line.append((ONE if i == j else ZERO) + held - (1 - locked) * slip_row[j])
            matrix.append(line)
            right.append(locked * quotient(constant, -row[i]) + (1 - locked) * slip)
        # no pivot vanishes, whatever is locked: the gains are those of a mass matrix, and regular with all locked
        return solve_linear(matrix, right, self._name, lambda _: self._undetermined(), lambda value: value == 0)

    def _require_determined(self, gains: list[list[Expr]]) -> None:
        """Refuse gains that are singular with all elements locked."""
        zero_test = self.derivation.zero_test

        def stand_in(value: Expr, hint: str) -> Expr:
            if not is_long(value, _LONG):
                return value
            short = Dummy(hint, real=True)
            zero_test.define(short, value)
            return short

        rows, zeros = [[*row] for row in gains], [ZERO] * len(gains)
        solve_linear(rows, zeros, stand_in, lambda _: self._undetermined(), zero_test.is_zero)

    def _undetermined(self) -> DerivationError:
        names = ", ".join(self.names)
        return DerivationError(
            f"{self.derivation.causal.graph.name}: with all of {names} locked their efforts are not determined, since "
            "their flows follow from each other - join those that share a flow into one, or put a compliance between "
            "them",
            where=tuple(self.names),
        )
