"""What an impact or a sudden lock does to the states.

An impulse P through an element changes every state by ``P`` times the gain of the state's rate in the element's effort,
since all finite efforts do nothing in no time. The impulse is the one after which the element's flow v is ``-e v``:

    x_after = x + c P,    c_k = d(dx_k/dt)/d(effort),    P = -(1 + e) v / sum of (dv/dx_k) c_k,

with the restitution e of an impact and e = 0 of an element that locks (Mosterman and Biswas 1998, J. Franklin Inst.
335(8); Brogliato 2016, Nonsmooth Mechanics, chapter 4). Momentum is conserved by construction, also through
transformers and dependent storages. A state that counts what passes (a heat, the integral of effort times flow) takes
the flows midway through the impulse. Other elements with modes pass no impulse: their capacity is finite.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

from sympy import Add, Expr, Symbol

from bondgraph.declare.quantities import Input, symbol
from bondgraph.derive.causality import CausalGraph
from bondgraph.derive.continuous import ContinuousDerivation
from bondgraph.derive.definitions import ONE, ZERO, Key, Law
from bondgraph.derive.equations import Assignment, ImplicitLoop, Mode, OutputEquation, Reset, StateEquations
from bondgraph.derive.jacobian import Jacobian, jacobian
from bondgraph.derive.linear import quotient
from bondgraph.errors import DerivationError

_Step = Assignment | ImplicitLoop


@dataclass(frozen=True)
class _Free:
    """The equations with the efforts of elements with modes as inputs, and the flows of these as outputs."""

    derivation: ContinuousDerivation
    equations: StateEquations
    names: tuple[str, ...]
    restitutions: tuple[Expr, ...]


def with_resets(causal: CausalGraph, modes: Sequence[Mode]) -> tuple[Mode, ...]:
    """The modes with what impacts and locks do to the states.

    Raises
    ------
    DerivationError
        If the gap of an impact does not open at the rate of its flow, or an impulse acts nonlinearly.
    """
    names = tuple(mode.element for mode in modes if mode.kind != "switch")
    if not names:
        return tuple(modes)
    free = _derive_free(causal, names)
    found = jacobian(free.equations, by=("x", "u"))
    resets = {name: _reset(free, found, index) for index, name in enumerate(names)}
    return tuple(
        mode if mode.kind == "switch" else dataclasses.replace(mode, reset=resets[mode.element]) for mode in modes
    )


def _derive_free(causal: CausalGraph, names: tuple[str, ...]) -> _Free:
    derivation = ContinuousDerivation(causal, smooth=False, free=True)
    variables = derivation.variables
    equations = derivation.equations()
    nodes = [causal.graph.nodes[name] for name in names]
    flows = [variables.own(variables.ports(node)[0], "flow") for node in nodes]
    laws = [variables.law(node.law("restitution") or ZERO) for node in nodes]
    derivation.compute([*(key for key, _ in flows), *(key for law in laws for key in law.depends)])
    _check_gaps(causal, names)
    outputs = tuple(
        OutputEquation(symbol(f"flow_{name}"), sign * derivation.values[key], "", "")
        for name, (key, sign) in zip(names, flows, strict=True)
    )
    efforts = tuple(Input(variables.modes.efforts[name].name, "") for name in names)
    equations = dataclasses.replace(
        equations,
        inputs=(*equations.inputs, *efforts),
        assignments=tuple(derivation.assignments),
        outputs=outputs,
    )
    return _Free(derivation, equations, names, tuple(law.build(derivation.values) for law in laws))


def _check_gaps(causal: CausalGraph, names: Sequence[str]) -> None:
    """Refuse an impact whose gap does not open as its flow says."""
    derivation = ContinuousDerivation(causal, smooth=False, free=True)
    variables = derivation.variables
    for name in names:
        node = causal.graph.nodes[name]
        gap = node.law("gap")
        if gap is None:
            continue
        flow, sign = variables.own(variables.ports(node)[0], "flow")
        key: Key = ("s", f"gap of {name}")
        variables.definitions[key] = law = variables.law(gap)
        variables.labels[key] = (f"gap_{name}", "", f"gap of {name}")
        rate = ZERO
        if isinstance(law, Law) and law.arguments:
            derivation.compute([flow, ("d", key)])
            rate = derivation.values["d", key]
        if not law.arguments or not derivation.zero_test.is_zero(rate - sign * derivation.values[flow]):
            raise DerivationError(
                f"{causal.graph.name}: {name}: its gap must open at the rate of its flow - give a gap whose rate is "
                "the flow of its junction, or turn the bond of the element round",
                where=(name,),
            )


def _reset(free: _Free, found: Jacobian, index: int) -> Reset:
    name, equations = free.names[index], free.equations
    column = len(equations.inputs) - len(free.names) + index
    gains = {e.row: e.value for e in found.block("derivatives", "u").entries if e.column == column}
    slopes = {e.column: e.value for e in found.block("outputs", "x").entries if e.row == index}
    mobility = Add(*(slopes[k] * gain for k, gain in gains.items() if k in slopes))
    if mobility == 0:
        raise DerivationError(
            f"{equations.name}: {name}: its flow does not react to its own effort, so it cannot lock or rebound - give "
            "its junction an inertance, or derive the graph smooth",
            where=(name,),
        )
    steps: tuple[_Step, ...] = (*equations.assignments, *found.assignments)
    given = set(free.derivation.variables.modes.efforts.values())
    symbols = [state.symbol for state in equations.states]
    moved = given | {symbols[k] for k in gains}
    counters = [k for k, gain in gains.items() if not moved.isdisjoint(_behind([gain], steps)[0])]
    refused = [k for k in counters if k in slopes] or [k for k in counters if not _is_counted(gains[k], given, steps)]
    if refused or not moved.isdisjoint(_behind(list(slopes.values()), steps)[0]):
        names = ", ".join(str(symbols[k]) for k in refused) or name
        raise DerivationError(
            f"{equations.name}: {name}: an impulse through it acts nonlinearly on {names} - use inertances with a "
            "constant inertia there, or derive the graph smooth",
            where=(name,),
        )
    impulse = quotient((ONE + free.restitutions[index]) * equations.outputs[index].expression, -mobility)
    midway = {symbols[k]: symbols[k] + gains[k] * impulse / 2 for k in gains if k not in counters}
    gains |= {k: _written_out(gains[k], steps).xreplace(midway) for k in counters}
    states = tuple(value + gains[k] * impulse if k in gains else value for k, value in enumerate(symbols))
    return Reset(_behind(states, steps)[1], states)


def _is_counted(gain: Expr, given: set[Symbol], steps: Sequence[_Step]) -> bool:
    """Whether a state that counts (a heat, a distance) can be advanced with the flows midway through the impulse."""
    behind, needed = _behind([gain], steps)
    return given.isdisjoint(behind) and all(isinstance(step, Assignment) for step in needed)


def _written_out(value: Expr, steps: Sequence[_Step]) -> Expr:
    """An expression with all assignments in their places."""
    for step in reversed(steps):
        if isinstance(step, Assignment) and step.symbol in value.free_symbols:
            value = value.xreplace({step.symbol: step.expression})
    return value


def _behind(values: Sequence[Expr], steps: Sequence[_Step]) -> tuple[set[Symbol], tuple[_Step, ...]]:
    """All symbols on which expressions depend, through assignments, and these assignments."""
    wanted = {used for value in values for used in value.free_symbols}
    needed = []
    for step in reversed(steps):
        if isinstance(step, Assignment):
            defined, parts = {step.symbol}, (step.expression,)
        else:
            defined = {*step.unknowns, *(local.symbol for local in step.body)}
            parts = (*step.residuals, *step.guesses, *(local.expression for local in step.body))
        if not wanted.isdisjoint(defined):
            needed.append(step)
            wanted |= {used for part in parts for used in part.free_symbols}
    return wanted, tuple(reversed(needed))
