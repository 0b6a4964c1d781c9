"""What must not matter: names, order, junctions split in two, the hash seed. And power is neither made nor lost."""

from __future__ import annotations

import dataclasses
import os
import random
import subprocess
import sys

import numpy as np
import pytest

from bondgraph.declare.elements import Bond, Node
from bondgraph.declare.expressions import signal, signal_name
from bondgraph.declare.functions import TableFunction, table_function
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.derive.causality import CausalGraph, assign_causality, bond_labels
from bondgraph.derive.derivation import derive
from bondgraph.errors import BondGraphError
from tests.derive.compare import energy_names, inertias, loaded
from tests.derive.random_graphs import RandomGraph


def solvable(first: int, count: int, linear: bool = False) -> list[tuple[int, BondGraph]]:
    found = []
    seed = first
    while len(found) < count:
        graph = RandomGraph(seed, linear=linear, mesh=0.05).graph
        try:
            if derive(assign_causality(graph)).states:
                found.append((seed, graph))
        except BondGraphError:
            pass
        seed += 1
    return found


GRAPHS = solvable(20_000, 12) + solvable(30_000, 6, linear=True)
IDS = [str(seed) for seed, _ in GRAPHS]


def answer(graph: BondGraph, energies: dict[str, float], u: float = 0.4) -> tuple[dict[str, float], dict[str, tuple]]:
    """Rates of the energy variables and the effort and flow of every bond, at given energy variables."""
    causal = assign_causality(graph, [name.partition("(")[2][:-1] for name in energies if "(" in name])
    equations = derive(causal, bonds=True)
    names, inertia = state_names(causal), inertias(causal)
    module = loaded(equations)
    scale = np.array([inertia.get(state.symbol.name, 1.0) for state in equations.states])
    x = np.array([energies[names[state.symbol.name]] for state in equations.states]) / scale
    inputs = np.array([u if given.name == graph.inputs[0].name else 0.3 for given in equations.inputs])
    theta = np.array([given.value for given in equations.parameters])
    rates = module["rhs"](0.2, x, inputs, theta) * scale
    values = module["output"](0.2, x, inputs, theta)
    count = len(graph.bonds)
    bonds = {label: (values[i], values[count + i]) for i, label in enumerate(bond_labels(causal))}
    return {names[s.symbol.name]: r for s, r in zip(equations.states, rates, strict=True)}, bonds


def state_names(causal: CausalGraph) -> dict[str, str]:
    """State name -> energy variable, or the integral itself."""
    return energy_names(causal) | {integral.name: integral.name for integral in causal.graph.integrals}


def energies_of(graph: BondGraph, seed: int) -> dict[str, float]:
    rng = random.Random(seed)
    return {name: rng.uniform(-0.6, 0.6) for name in state_names(assign_causality(graph)).values()}


def renamed(graph: BondGraph, name_of) -> BondGraph:
    """The same graph with other names of nodes and quantities."""
    twin = BondGraph(graph.name)
    symbols = {symbol(name): symbol(name_of(name)) for name in graph.quantities}

    def new(law):
        signals = {
            used: signal(read.variable, name_of(read.node), read.port)
            for used in law.free_symbols
            if (read := signal_name(used))
        }
        renamed_law = law.xreplace({**symbols, **signals})
        for used in sorted(renamed_law.atoms(TableFunction), key=str):
            renamed_law = renamed_law.replace(used.func, table_function(name_of(used.table_name)))
        return renamed_law

    for name, quantity in graph.quantities.items():
        changes = {key: new(getattr(quantity, key)) for key in ("of", "expression") if hasattr(quantity, key)}
        twin._quantities[name_of(name)] = dataclasses.replace(quantity, name=name_of(name), **changes)
    for node in graph.nodes.values():
        laws = tuple((given, new(law)) for given, law in node.laws)
        twin._nodes[name_of(node.name)] = dataclasses.replace(node, name=name_of(node.name), laws=laws)
    twin._bonds = [Bond(name_of(bond.source), name_of(bond.target)) for bond in graph.bonds]
    return twin


@pytest.mark.parametrize(("seed", "graph"), GRAPHS, ids=IDS)
def test_names_do_not_matter(seed, graph):
    energies = energies_of(graph, seed)

    def name_of(name: str) -> str:
        return f"n{(sum(map(ord, name)) * 7919 + len(name)) % 1000}_{name[::-1]}"

    rates, bonds = answer(graph, energies)
    other = {
        f"{key.partition('(')[0]}({name_of(key.partition('(')[2][:-1])})" if "(" in key else name_of(key): value
        for key, value in energies.items()
    }
    new_rates, new_bonds = answer(renamed(graph, name_of), other)
    np.testing.assert_allclose(list(new_rates.values()), list(rates.values()), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(list(new_bonds.values()), list(bonds.values()), rtol=1e-8, atol=1e-10)


def shuffled(graph: BondGraph, seed: int) -> BondGraph:
    """The same graph with junctions, one-ports and their bonds declared in another order."""
    rng = random.Random(seed)
    twin = BondGraph(graph.name)
    twin._quantities = dict(graph._quantities)
    names = list(graph.nodes)
    rng.shuffle(names)
    twin._nodes = {name: graph.nodes[name] for name in names}
    bonds = list(graph.bonds)
    multiports = [name for name, node in graph.nodes.items() if node.ports > 1]
    ordered = [bond for name in multiports for bond in bonds if name in (bond.source, bond.target)]
    free = [bond for bond in bonds if bond not in ordered]
    rng.shuffle(free)
    twin._bonds = [*free, *dict.fromkeys(ordered)] if len(set(bonds)) == len(bonds) else bonds
    return twin


@pytest.mark.parametrize(("seed", "graph"), GRAPHS, ids=IDS)
def test_the_order_of_bonds_and_nodes_does_not_matter(seed, graph):
    energies = energies_of(graph, seed)
    rates, bonds = answer(graph, energies)
    twin = shuffled(graph, seed)
    new_rates, new_bonds = answer(twin, energies)
    assert set(rates) == set(new_rates) and set(bonds) == set(new_bonds)
    for key, value in rates.items():
        assert new_rates[key] == pytest.approx(value, rel=1e-8, abs=1e-10)
    for key, value in bonds.items():
        assert new_bonds[key] == pytest.approx(value, rel=1e-8, abs=1e-10)


def split(graph: BondGraph, seed: int) -> BondGraph:
    """Every junction with three or more bonds as two of its kind, bonded to each other."""
    rng = random.Random(seed)
    twin = BondGraph(graph.name)
    twin._quantities = dict(graph._quantities)
    twin._nodes = dict(graph._nodes)
    twin._bonds = list(graph._bonds)
    for node in list(graph.nodes.values()):
        indices = [i for i, bond in enumerate(twin._bonds) if node.name in (bond.source, bond.target)]
        if not node.is_junction or len(indices) < 3:
            continue
        half = f"{node.name}_half"
        twin._nodes[half] = Node(half, node.kind, node.domain)
        for index in rng.sample(indices, len(indices) // 2):
            bond = twin._bonds[index]
            ends = [half if end == node.name else end for end in (bond.source, bond.target)]
            twin._bonds[index] = Bond(*ends)
        ends = (node.name, half) if rng.random() < 0.5 else (half, node.name)
        twin._bonds.append(Bond(*ends))
    return twin


@pytest.mark.parametrize(("seed", "graph"), GRAPHS, ids=IDS)
def test_a_junction_may_be_split_in_two(seed, graph):
    energies = energies_of(graph, seed)
    rates, _ = answer(graph, energies)
    twin = split(graph, seed)
    assert len(twin.bonds) > len(graph.bonds) or all(len(v) < 3 for n, v in graph.incidence().items() if n[0] == "j")
    new_rates, _ = answer(twin, energies)
    for key, value in rates.items():
        assert new_rates[key] == pytest.approx(value, rel=1e-8, abs=1e-10)


@pytest.mark.parametrize(("seed", "graph"), GRAPHS, ids=IDS)
def test_stored_power_is_supplied_less_dissipated(seed, graph):
    """Power into every storage, from every source and into every resistance, from the bonds' own variables."""
    _, bonds = answer(graph, energies_of(graph, seed))
    power = [effort * flow for effort, flow in bonds.values()]
    incidence = graph.incidence()
    total = {"C": 0.0, "I": 0.0, "R": 0.0, "Se": 0.0, "Sf": 0.0, "X": 0.0}
    size = 0.0
    for node in graph.nodes.values():
        into = [power[i] * (1 if inward else -1) for i, inward in incidence[node.name]]
        if node.is_junction or node.kind in ("TF", "GY"):
            assert sum(into) == pytest.approx(0.0, abs=1e-8 * (1 + sum(map(abs, into))))
        else:
            total[node.kind] += sum(into)
        if node.kind in ("R", "X") and not graph.tables:
            assert sum(into) >= -1e-9
        size += sum(map(abs, into))
    stored, supplied = total["C"] + total["I"], -total["Se"] - total["Sf"]
    assert stored == pytest.approx(supplied - total["R"] - total["X"], abs=1e-8 * (1 + size))


SCRIPT = """
from bondgraph.derive.causality import CausalGraph, assign_causality
from bondgraph.derive.causality import bond_labels
from bondgraph.derive.derivation import derive
from bondgraph.errors import BondGraphError
from bondgraph.generate.module import render
from tests.derive.random_graphs import RandomGraph
from tests.derive.test_textbook import beam, coils, diode_line, pendulum
from tests.derive.spec import speed
graphs = [RandomGraph(seed, linear=seed % 2 == 0, mesh=0.15).graph for seed in range(40_000, 40_020)]
graphs += [beam(4), pendulum(False), coils(speed())]
graphs += [diode_line(2, {"residual": "flow - Is*(exp((effort - r*flow)/Vt) - 1)"})]
for graph in graphs:
    try:
        print(render(derive(assign_causality(graph), bonds=True)))
    except BondGraphError as error:
        print(error, error.where)
"""


def test_text_and_messages_are_the_same_under_every_hash_seed():
    runs = []
    for seed in range(4):
        environment = {**os.environ, "PYTHONHASHSEED": str(seed), "PYTHONPATH": os.getcwd()}
        command = [sys.executable, "-W", "ignore", "-c", SCRIPT]
        runs.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment))
    texts = {run.communicate()[0] for run in runs}
    assert [run.returncode for run in runs] == [0] * 4
    assert len(texts) == 1 and len(texts.pop()) > 50_000
