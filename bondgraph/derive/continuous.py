"""What holds between events: the definitions sorted, loops solved, state derivatives and outputs.

Causality is the order of computation: a topological sort of the definitions. Only real algebraic loops and dependent
storages (whose rates form linear loops) are solved, each on its own, never the whole system.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from sympy import Expr

from bondgraph.declare.expressions import signal
from bondgraph.declare.quantities import Input, symbol
from bondgraph.derive.algebra import algebra
from bondgraph.derive.causality import bond_labels
from bondgraph.derive.computed import Computed
from bondgraph.derive.definitions import Key, Residual
from bondgraph.derive.equations import Assignment, Mode, OutputEquation, State, StateEquations
from bondgraph.derive.loops import LoopSolver
from bondgraph.derive.order import components


class ContinuousDerivation(Computed):
    """The state equations between events."""

    def equations(self, bonds: bool = False, signals: bool = False) -> StateEquations:
        """All state derivatives and outputs.

        Raises
        ------
        DerivationError
            If they cannot be found; also where computer algebra fails at a law.
        """
        with algebra(self.causal.graph.name):
            return self._equations(bonds, signals)

    def _equations(self, bonds: bool, signals: bool) -> StateEquations:
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
            OutputEquation(symbol(output.name), law.build(self.values), output.unit, output.meaning, output.shown_unit)
            for output, law in measured
        ]
        outputs += self._bond_outputs() if bonds else []
        outputs += self._signal_outputs() if signals else []
        derivatives = tuple(self.values[rate] for rate in rates)
        modes = self.with_resets(noted.build(self.values))
        events = tuple(dict.fromkeys(function.expression for mode in modes for function in mode.functions))
        rates_used = self._input_rates([*derivatives, *(output.expression for output in outputs), *events])
        return StateEquations(
            name=graph.name,
            doc=graph.doc,
            source=graph.source,
            states=_as_measured(variables.states, outputs),
            inputs=(*variables.inputs, *rates_used, *noted.inputs()),
            parameters=graph.parameters,
            tables=graph.tables,
            assignments=tuple(self.assignments),
            derivatives=derivatives,
            outputs=tuple(outputs),
            events=events,
            modes=modes,
        )

    def with_resets(self, modes: Sequence[Mode]) -> tuple[Mode, ...]:
        """The modes with what happens to the states where one begins; here nothing does."""
        return tuple(modes)

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
            ContinuousDerivation(self.causal, self.smooth, self.variables.modes.free).compute(left)

    def _depends(self, key: Key) -> Sequence[Key]:
        rule = self.variables.definition(key)
        return () if rule is None else rule.depends

    def _is_implicit(self, key: Key) -> bool:
        return isinstance(self.variables.definition(key), Residual) or key in self._depends(key)

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
            value = self.values["s", named.name]
            outputs.append(OutputEquation(symbol(name), value, named.unit, named.meaning, named.shown_unit))
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
        for declared in self.variables.inputs:
            rate = self.variables.input_rates.get(declared.symbol)
            if rate is not None and rate in used and rate.name not in self.causal.graph.quantities:
                found.append(declared.rate(rate.name))
        return found


def _as_measured(states: Sequence[State], outputs: Sequence[OutputEquation]) -> tuple[State, ...]:
    """The states; one that is measured under its own name is shown in the unit of that measurement."""
    measured = {output.symbol: output.shown_unit for output in outputs if output.expression == output.symbol}
    return tuple(
        replace(state, shown_unit=measured[state.symbol]) if measured.get(state.symbol) else state for state in states
    )
