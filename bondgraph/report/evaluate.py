"""Evaluate a derived model at given points, in energy variables, with the effort and flow of every bond."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bondgraph.build import model_of
from bondgraph.declare.elements import STORAGES
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.requirements import check_requirements
from bondgraph.derive.causality import CausalGraph, assign_causality, bond_labels
from bondgraph.derive.derivation import Derivation
from bondgraph.errors import DataError, suggest
from bondgraph.report.energy import energy_name, energy_states, inertia_value
from bondgraph.simulate.modes import consistent_inputs

_POINT_KEYS = ("t", "states", "inputs", "input_derivatives", "parameters")
_ENERGY = re.compile(r"(displacement|momentum)(\d*)\((.+)\)\Z")


def evaluate(graph: BondGraph, points: Sequence[Mapping[str, Any]], *, smooth: bool = True) -> list[dict[str, Any]]:
    """Derivatives, outputs, signals and bond variables of a graph at given points.

    Parameters
    ----------
    graph
        The declared graph.
    points
        Objects with ``t``, ``states`` (by ``displacement(X)``, ``momentum(X)`` or a state's own name), ``inputs``,
        ``input_derivatives`` and ``parameters``; what is left out has its default.
    smooth
        As in :func:`~bondgraph.derive.derivation.derive`; if not, modes that are not given are those in which a
        simulation would begin at the point.

    Raises
    ------
    DataError
        If a point names something that the model does not have.
    BondGraphError
        If the graph is refused.

    Examples
    --------
    >>> g = BondGraph("mass")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("weight", -9.81, at=body)
    >>> _ = g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body)
    >>> evaluate(g, [{"states": {"momentum(mass)": 4.0}}])[0]["derivatives"]
    {'momentum(mass)': -9.81}
    """
    flat = graph.flatten()
    evaluators: dict[tuple[str, ...], _Evaluator] = {}
    answers = []
    for index, point in enumerate(points):
        _require(point, _POINT_KEYS, f"point {index}")
        given = {name: float(value) for name, value in point.get("parameters", {}).items()}
        if given:  # the declared values have been checked with the graph
            check_requirements(flat.requirements, flat.parameters, f"{graph.name}: point {index}", given)
        wanted = _wanted_independent(flat, point)
        if wanted not in evaluators:
            evaluators[wanted] = _Evaluator(assign_causality(graph, wanted), smooth)
        answers.append(evaluators[wanted].at(point, index))
    return answers


def _wanted_independent(flat: BondGraph, point: Mapping[str, Any]) -> tuple[str, ...]:
    """Storages whose energy variables a point gives: these are to be the independent ones."""
    named: dict[str, None] = {}
    for key in point.get("states", {}):
        found = _ENERGY.match(key)
        if found and found[3] in flat.nodes and flat.nodes[found[3]].kind in STORAGES:
            several = flat.nodes[found[3]].ports > 1 and found[2]
            named[f"{found[3]}.{found[2]}" if several else found[3]] = None
    return tuple(named)


class _Evaluator:
    def __init__(self, causal: CausalGraph, smooth: bool) -> None:
        self.causal = causal
        derivation = Derivation(causal, smooth)
        equations = derivation.equations(bonds=True, signals=True)
        self.variables = derivation.variables
        self.model = model_of(equations, f"{causal.graph.name} (derived)")
        self.own = len(causal.graph.outputs)
        self.energy = energy_states(self.variables)

    def at(self, point: Mapping[str, Any], number: int) -> dict[str, Any]:
        where = f"point {number}"
        theta = self._vector(point.get("parameters", {}), "parameter", self.model.theta(), where)
        values = {p.name: float(v) for p, v in zip(self.model.parameters, theta, strict=True)}
        x = self._states(point.get("states", {}), values, where)
        t = _number(point.get("t", 0.0), "t", where)
        u = self._with_modes(point, t, x, self._inputs(point, where), theta)
        with np.errstate(all="ignore"):  # a point outside a law's domain gives nan in the answer
            dx = self.model.rhs(t, x, u, theta)
            y = self.model.output(t, x, u, theta)
        bonds = self._bonds(y[self.own :])
        return {
            "derivatives": self._derivatives(point.get("states", {}), dx, values, bonds),
            "outputs": {
                info.name: float(v) for info, v in zip(self.model.outputs[: self.own], y[: self.own], strict=True)
            },
            "signals": self._signals(bonds, y),
            "bonds": bonds,
        }

    def _with_modes(self, point: Mapping[str, Any], t: float, x: Any, u: Any, theta: Any) -> Any:
        """The inputs with modes that fit the point, where it does not give them."""
        found = consistent_inputs(self.model, t, x, u, theta) if self.model.modes else u
        for name in set(point.get("inputs", {})) & {mode.input for mode in self.model.modes}:
            found[self.model.index("input", name)] = u[self.model.index("input", name)]
        return found

    def _vector(self, given: Mapping[str, Any], kind: Any, start: Any, where: str) -> Any:
        names = self.model.names(kind)
        for name, value in given.items():
            if name not in names:
                raise DataError(f"{where}: no {kind} {name!r}{suggest(name, names)}", where=(name,))
            start[names.index(name)] = _number(value, name, where)
        return start

    def _inputs(self, point: Mapping[str, Any], where: str) -> Any:
        letters = {info.name: info.letters for info in self.model.inputs if info.letters}
        given = dict(point.get("inputs", {}))
        for name, codes in letters.items():
            if isinstance(given.get(name), str):
                if given[name] not in codes:
                    raise DataError(f"{where}: {name} {given[name]!r} is none of {', '.join(codes)}", where=(name,))
                given[name] = codes[given[name]]
        names = self.model.names("input")
        declared = [quantity.name for quantity in self.causal.graph.inputs]
        rate_names = {used.name: rate.name for used, rate in self.variables.input_rates.items()}
        rates = {rate_names.get(name, ""): value for name, value in point.get("input_derivatives", {}).items()}
        for name in point.get("input_derivatives", {}):
            if name not in declared:
                raise DataError(f"{where}: no input {name!r}{suggest(name, declared)}", where=(name,))
        given |= {name: value for name, value in rates.items() if name in names}
        return self._vector(given, "input", self.model.u0(), where)

    def _states(self, given: Mapping[str, Any], parameters: Mapping[str, float], where: str) -> Any:
        names = self.model.names("state")
        x = self.model.x0()
        dependent = {energy_name(self.causal.graph.nodes[name], port) for name, port in self.causal.derivative}
        for name, value in given.items():
            if name in self.energy:
                state, inertia = self.energy[name]
                x[names.index(state)] = _number(value, name, where) / inertia_value(inertia, parameters)
            elif name in names:
                x[names.index(name)] = _number(value, name, where)
            elif name not in dependent:
                known = [*self.energy, *names]
                raise DataError(
                    f"{where}: no state {name!r}{suggest(name, known)} - use {', '.join(known)}", where=(name,)
                )
        return x

    def _derivatives(
        self, given: Mapping[str, Any], dx: Any, parameters: Mapping[str, float], bonds: Mapping[str, Any]
    ) -> dict[str, float]:
        names = self.model.names("state")
        by_name = {name: float(value) for name, value in zip(names, dx, strict=True)}
        by_energy = {
            name: by_name[state] * inertia_value(inertia, parameters) for name, (state, inertia) in self.energy.items()
        }
        inverse = {state: name for name, (state, _) in self.energy.items()}
        keys = list(given) or [inverse.get(name, name) for name in names]
        keys += [key for name in names if (key := inverse.get(name, name)) not in keys and name not in keys]
        known = {**by_name, **by_energy}
        return {key: known[key] if key in known else self._dependent_rate(key, bonds) for key in keys}

    def _dependent_rate(self, key: str, bonds: Mapping[str, Any]) -> float:
        found = _ENERGY.match(key)
        assert found is not None
        port = self.variables.ports(self.causal.graph.nodes[found[3]])[int(found[2] or 1) - 1]
        bond = bonds[bond_labels(self.causal)[port.bond]]
        return float(port.sign * bond["flow"]) if found[1] == "displacement" else float(bond["effort"])

    def _bonds(self, values: Any) -> dict[str, dict[str, float]]:
        labels = bond_labels(self.causal)
        count = len(labels)
        return {label: {"effort": float(values[i]), "flow": float(values[count + i])} for i, label in enumerate(labels)}

    def _signals(self, bonds: Mapping[str, Mapping[str, float]], y: Any) -> dict[str, float]:
        """The common variable of every junction, and the named signals."""
        labels = bond_labels(self.causal)
        found = {}
        for node in self.causal.graph.nodes.values():
            if node.is_junction:
                variable = "effort" if node.kind == "0" else "flow"
                first = self.variables.incidence[node.name][0][0]
                found[f"{variable}({node.name})"] = bonds[labels[first]][variable]
        named = self.causal.graph.signals
        return found | {s.name: float(value) for s, value in zip(named, y[self.own + 2 * len(labels) :], strict=True)}


def _number(value: Any, name: str, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DataError(f"{where}: {name} must be a number but is {value!r}", where=(name,))
    return float(value)


def _require(point: Mapping[str, Any], known: Sequence[str], where: str) -> None:
    if not isinstance(point, Mapping):
        raise DataError(f"{where}: expected an object with {', '.join(known)}", where=(where,))
    for key, value in point.items():
        if key not in known:
            raise DataError(f"{where}: unknown key {key!r}{suggest(key, known)}", where=(key,))
        if key != "t" and not isinstance(value, Mapping):
            raise DataError(f"{where}: {key} must be an object of names and numbers but is {value!r}", where=(key,))
