"""Derivation: from a causal graph to explicit state equations.

Causality is the order of computation: a topological sort of the definitions. Only real algebraic loops and dependent
storages (whose rates form linear loops) are solved, each on its own, never the whole system.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sympy import Expr, Symbol

from bondgraph.declare.expressions import signal
from bondgraph.declare.quantities import Input, symbol
from bondgraph.derive.causality import CausalGraph
from bondgraph.derive.definitions import Definition, Key, Law, Residual
from bondgraph.derive.equations import Assignment, ImplicitLoop, Mode, OutputEquation, StateEquations
from bondgraph.derive.loops import Loop, LoopSolver
from bondgraph.derive.order import components
from bondgraph.derive.size import is_long, is_small
from bondgraph.derive.variables import BondVariables
from bondgraph.derive.zero import ZeroTest
from bondgraph.errors import DerivationError

__all__ = ["Derivation", "bond_labels", "check_closed", "derive", "is_long", "is_small"]


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


class Derivation:
    """Values of the variables computed so far, in order, as expressions in named symbols."""

    def __init__(self, causal: CausalGraph, smooth: bool = True, free: bool = False) -> None:
        self.causal = causal
        self.smooth = smooth
        self.variables = BondVariables(causal, smooth, free)
        self.values: dict[Key, Expr] = {}
        self.assignments: list[Assignment | ImplicitLoop] = []
        self.loops: list[Loop] = []
        self.uses: dict[Key, int] = {}
        self.zero_test = ZeroTest()
        self.taken: dict[str, None] = dict.fromkeys([*causal.graph.quantities, "t", "x", "u", "theta"])
        for state in self.variables.states:
            self.values["x", state.symbol.name] = state.symbol
            self.taken[state.symbol.name] = None

    # ------------------------------------------------------------------ the whole

    def equations(self, bonds: bool = False, signals: bool = False) -> StateEquations:
        """All state derivatives and outputs."""
        graph, variables = self.causal.graph, self.variables
        rates = [("d", ("x", state.symbol.name)) for state in variables.states]
        measured = [(output, variables.law(output.expression)) for output in graph.outputs]
        every: list[Key] = []
        if bonds:
            every = [key for b in range(len(graph.bonds)) for key in (variables.effort(b), variables.flow(b))]
        if signals:
            every += [("s", named.name) for named in graph.signals]
        noted = variables.modes
        used = [*(key for _, law in measured for key in law.depends), *noted.depends()]
        self.compute([*rates, *used, *every])
        self._check_determined()
        outputs = [
            OutputEquation(symbol(output.name), law.build(self.values), output.unit, output.meaning)
            for output, law in measured
        ]
        outputs += self._bond_outputs() if bonds else []
        outputs += self._signal_outputs() if signals else []
        derivatives = tuple(self.values[rate] for rate in rates)
        modes = self._with_resets(noted.build(self.values))
        events = tuple(dict.fromkeys(function.expression for mode in modes for function in mode.functions))
        rates_used = self._input_rates([*derivatives, *(output.expression for output in outputs), *events])
        return StateEquations(
            name=graph.name,
            doc=graph.doc,
            source=graph.source,
            states=tuple(variables.states),
            inputs=(*graph.inputs, *rates_used, *noted.inputs()),
            parameters=graph.parameters,
            tables=graph.tables,
            assignments=tuple(self.assignments),
            derivatives=derivatives,
            outputs=tuple(outputs),
            events=events,
            modes=modes,
        )

    def _with_resets(self, modes: Sequence[Mode]) -> tuple[Mode, ...]:
        from bondgraph.derive.impulse import with_resets  # here: it derives what happens between events itself

        return tuple(modes) if self.variables.modes.free else with_resets(self.causal, modes)

    def compute(self, roots: Sequence[Key]) -> None:
        """Give every variable that the roots need a value, in order."""
        order = components(roots, self._depends)
        order = [members for members in order if members[0] not in self.values]
        for members in order:
            for key in members:
                for used in self._depends(key):
                    self.uses[used] = self.uses.get(used, 0) + 1
        for root in roots:
            self.uses[root] = self.uses.get(root, 0) + 1
        for members in order:
            if len(members) == 1 and not self._is_implicit(members[0]):
                self.assign(members[0])
            else:
                LoopSolver(self, members).solve()

    def _check_determined(self) -> None:
        """Solve the loops that nothing asked for too: a graph that leaves an effort or flow open is refused."""
        count = range(len(self.causal.graph.bonds))
        every: list[Key] = [read(bond) for bond in count for read in (self.variables.effort, self.variables.flow)]
        every += [("s", named.name) for named in self.causal.graph.signals]
        left = [key for key in every if key not in self.values]
        loops = [m for m in components(left, self._depends) if len(m) > 1 or m[0] in self._depends(m[0])]
        if any(members[0] not in self.values for members in loops):
            Derivation(self.causal, self.smooth, self.variables.modes.free).compute(left)

    def _depends(self, key: Key) -> Sequence[Key]:
        rule = self.variables.definition(key)
        return () if rule is None else rule.depends

    def _is_implicit(self, key: Key) -> bool:
        return isinstance(self.variables.definition(key), Residual) or key in self._depends(key)

    # ------------------------------------------------------------------ one variable

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

    # ------------------------------------------------------------------ outputs

    def _bond_outputs(self) -> list[OutputEquation]:
        outputs = []
        for variable, read in (("effort", self.variables.effort), ("flow", self.variables.flow)):
            for bond, label in enumerate(bond_labels(self.causal)):
                domain = self.variables.bond_domain(bond)
                unit = "" if domain is None else getattr(domain, f"{variable}_unit")
                value = self.values[read(bond)]
                outputs.append(OutputEquation(signal(variable, label), value, unit, f"{variable} of bond {label}"))
        return outputs

    def _signal_outputs(self) -> list[OutputEquation]:
        taken = {output.name for output in self.causal.graph.outputs}
        outputs = []
        for named in self.causal.graph.signals:
            name = f"signal({named.name})" if named.name in taken else named.name
            outputs.append(OutputEquation(symbol(name), self.values["s", named.name], named.unit, named.meaning))
        return outputs

    def _input_rates(self, results: Sequence[Expr]) -> list[Input]:
        """Inputs whose own rate a dependent storage needs: the rate becomes an input, where it is not declared."""
        used: set[Any] = set()
        for assignment in self.assignments:
            parts = (
                (assignment.expression,)
                if isinstance(assignment, Assignment)
                else (*assignment.residuals, *(a.expression for a in assignment.body))
            )
            used.update(*(part.free_symbols for part in parts))
        for value in results:
            used.update(value.free_symbols)
        found = []
        for declared in self.causal.graph.inputs:
            rate = self.variables.input_rates.get(declared.symbol)
            if rate is not None and rate in used and rate.name not in self.causal.graph.quantities:
                found.append(declared.rate(rate.name))
        return found


def bond_labels(causal: CausalGraph) -> list[str]:
    """``a->b`` for every bond; parallel bonds between the same nodes are numbered ``a->b#2``."""
    seen: dict[str, int] = {}
    labels = []
    for bond in causal.graph.bonds:
        label = f"{bond.source}->{bond.target}"
        seen[label] = seen.get(label, 0) + 1
        labels.append(label if seen[label] == 1 else f"{label}#{seen[label]}")
    return labels


def _is_physical(key: Key, rule: Definition) -> bool:
    """Named signals, and efforts and flows given by an element's law, keep their names: the physics stays readable."""
    if key[0] == "s":
        return True
    if not isinstance(rule, Law) or key[0] not in ("e", "f"):
        return False
    return bool(rule.arguments)


def check_closed(equations: StateEquations) -> None:
    """Raise DerivationError unless the equations use only states, inputs, parameters, ``t`` and assigned symbols."""
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
    foreign = sorted(str(used) for used in value.free_symbols - known)
    if foreign:
        raise DerivationError(
            f"{equations.name}: the equation of {where} uses {', '.join(foreign)}, which is neither a state, input nor "
            "parameter - please report this graph",
            where=(where,),
        )
