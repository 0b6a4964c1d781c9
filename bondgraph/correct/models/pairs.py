"""Pairs of junctions of one domain between which something may leak or rub.

Two chambers, nodes or bodies (0-junctions) exchange a flow by the difference of their efforts; two moving parts
(1-junctions) an effort by the difference of their speeds. Only neighbours are paired: two with one junction between
them, directly or through transformers and gyrators, or two of which one drives an element at the other by a signal: a
jet that falls into a tank. Heat needs no way that somebody declared: it passes through frames and air, so that any two
bodies are paired, and any two nodes of a circuit, whose leakage creeps over boards and through moist insulation. So are
any two coils of a circuit, which a flux may join through air or iron. Two that are rigidly tied have no difference of
their own.
"""

from __future__ import annotations

import itertools

import networkx as nx
import numpy as np

from bondgraph.data.log import FloatArray
from bondgraph.declare.domains import CHEMICAL, ELECTRICAL, HYDRAULIC, ROTATION, THERMAL, TRANSLATION
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale
from bondgraph.declare.elements import JUNCTIONS, TWO_PORTS
from bondgraph.declare.expressions import signal_name
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.validation import node_domains

#: Kind of the junctions of each domain between which something flows or rubs.
_KIND = {ELECTRICAL: "0", HYDRAULIC: "0", THERMAL: "0", CHEMICAL: "0", ROTATION: "1", TRANSLATION: "1"}
#: Domains in which something passes between any two of them.
_EVERYWHERE = (THERMAL, ELECTRICAL)
#: A difference smaller than this share of what it is a difference of is rounding.
_SHARE = 1e-6


def sizes(values: FloatArray) -> FloatArray:
    """The 99th percentile of each row's magnitude (rows,); single spikes set no scale."""
    found: FloatArray = np.percentile(np.abs(values), 99.0, axis=-1)
    return found


def pairs(graph: BondGraph, flat: BondGraph, values: tuple[FloatArray, FloatArray], smoothing: float) -> list[Place]:
    """Junctions that are paired, with the size of their difference and of what passes through the lesser of them.

    Parameters
    ----------
    graph, flat
        The graph, and itself with its parts dissolved.
    values
        Efforts and flows of the bonds of ``flat`` along the logs, each (bonds, samples).
    smoothing
        As in :class:`bondgraph.declare.effect.Place`.
    """
    bonds = flat.incidence()
    found = []
    for first, second in neighbours(flat):
        common, through = values if flat.nodes[first].kind == "0" else values[::-1]
        rows = [[index for index, _ in bonds[name]] for name in (first, second)]
        apart = float(sizes(common[rows[0][0]] - common[rows[1][0]]))
        passing = min(float(sizes(through[own]).max()) for own in rows)
        if min(apart, passing) > 0.0 and apart > _SHARE * float(sizes(common[rows[0][0]])):
            scale = Scale(apart, passing) if flat.nodes[first].kind == "0" else Scale(passing, apart)
            found.append(Place.between(handle(graph, first), handle(graph, second), scale, smoothing))
    return found


def neighbours(flat: BondGraph) -> list[tuple[str, str]]:
    """Names of the junctions of each pair, in the order of their declaration.

    Examples
    --------
    >>> g = BondGraph("line")
    >>> tanks = [g.zero_junction(name, HYDRAULIC) for name in ("a", "b", "c")]
    >>> for k in (0, 1):
    ...     pipe = g.one_junction(f"pipe{k}", HYDRAULIC)
    ...     _ = g.bond(tanks[k], pipe), g.bond(pipe, tanks[k + 1])
    >>> neighbours(g.flatten())
    [('a', 'b'), ('b', 'c')]
    """
    network: nx.Graph[str] = nx.Graph((bond.source, bond.target) for bond in flat.bonds)
    domains = node_domains(flat)
    kinds = {name: domain and _KIND.get(domain) for name, domain in domains.items()}
    own = [
        name
        for name, node in flat.nodes.items()
        if node.is_junction and (node.kind == kinds[name] or (domains[name] == ELECTRICAL and _has_coil(flat, name)))
    ]
    chosen = [name for name in own if not _is_difference(flat, name)]
    tied, driven = _tied(flat, chosen), _driven(flat, chosen)
    found = []
    for first, second in itertools.combinations(chosen, 2):
        if flat.nodes[first].kind != flat.nodes[second].kind:
            continue
        if domains[first] == domains[second] and tied[first] != tied[second] and first in network and second in network:
            if domains[first] in _EVERYWHERE or {first, second} in driven:
                found.append((first, second))
                continue
            others = {name for name in chosen if domains[name] == domains[first]} - {first, second}
            between = network.subgraph(set(network) - others)
            if _one_junction_apart(flat, between, first, second):
                found.append((first, second))
    return found


def _has_coil(flat: BondGraph, name: str) -> bool:
    """True for the 1-junction of an inductance."""
    bonds = [(flat.bonds[index], inward) for index, inward in flat.incidence()[name]]
    kinds = {flat.nodes[bond.source if inward else bond.target].kind for bond, inward in bonds}
    return flat.nodes[name].kind == "1" and "I" in kinds


def _is_difference(flat: BondGraph, name: str) -> bool:
    """True for the 1-junction of a spring or damper: its speed is a difference of others already."""
    if flat.nodes[name].kind != "1":
        return False
    bonds = [(flat.bonds[index], inward) for index, inward in flat.incidence()[name]]
    kinds = [flat.nodes[bond.source if inward else bond.target].kind for bond, inward in bonds]
    return "I" not in kinds and sum(kind in (*JUNCTIONS, *TWO_PORTS) for kind in kinds) < 2


def _tied(flat: BondGraph, chosen: list[str]) -> dict[str, int]:
    """The number of the group of each junction; those of a group are tied by bonds or transformers alone.

    Transformers between two speeds, or two efforts, tie them; one between a pressure and a speed ties nothing.
    """
    transformers = {name for name, node in flat.nodes.items() if node.kind == "TF"}
    groups: dict[str, int] = {}
    for kind in JUNCTIONS:
        own = {name for name, node in flat.nodes.items() if node.kind == kind}
        rigid: nx.Graph[str] = nx.Graph()
        rigid.add_nodes_from(own)
        rigid.add_edges_from(
            (bond.source, bond.target) for bond in flat.bonds if {bond.source, bond.target} <= own | transformers
        )
        groups |= {name: len(groups) + k for k, group in enumerate(nx.connected_components(rigid)) for name in group}
    return {name: groups[name] for name in chosen}


def _driven(flat: BondGraph, chosen: list[str]) -> list[set[str]]:
    """Pairs of junctions of which one drives an element at the other by a signal."""
    beside = {
        name: [
            bond.target if bond.source == name else bond.source
            for bond in flat.bonds
            if name in (bond.source, bond.target)
        ]
        for name, node in flat.nodes.items()
        if not node.is_junction
    }
    found = []
    for name, ends in beside.items():
        read = {
            known.node for _, law in flat.nodes[name].laws for one in law.free_symbols if (known := signal_name(one))
        }
        found += [{end, other} for end in ends for other in read if {end, other} <= set(chosen) and end != other]
    return found


def _one_junction_apart(flat: BondGraph, network: nx.Graph[str], first: str, second: str) -> bool:
    try:
        way = nx.shortest_path(network, first, second)[1:-1]
    except nx.NetworkXNoPath:
        return False
    junctions = [name for name in way if flat.nodes[name].is_junction]
    return len(junctions) == 1 and all(flat.nodes[name].kind in TWO_PORTS for name in way if name not in junctions)
