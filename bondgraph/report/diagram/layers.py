"""Layered placement of one level of a drawing: layers, order within them, coordinates, tracks between them.

Method: K. Sugiyama, S. Tagawa, M. Toda (1981), IEEE Trans. SMC 11(2), in the form of E. Gansner, E. Koutsofios,
S. North, K.-P. Vo (1993), IEEE Trans. Software Engineering 19(3): layers and vertical coordinates are the optima of
linear programs, the order within the layers comes from barycentre sweeps and neighbour exchange.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import networkx as nx
import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_matrix

Edge = tuple[int, int]

SWEEPS = 12


def assign_layers(count: int, edges: Sequence[Edge], weights: Sequence[float] | None = None) -> list[int]:
    """Layer of every node so that each edge goes to a later layer and the edges are as short as possible.

    Parameters
    ----------
    count
        Number of nodes; edges join nodes ``0 .. count - 1`` and form no cycle.
    weights
        How much each edge's length counts (1 if not given).

    Examples
    --------
    >>> assign_layers(4, [(0, 1), (1, 2), (3, 2)])
    [0, 1, 2, 1]
    """
    if not edges:
        return [0] * count
    cost = np.full(count, 1e-3)
    for (start, end), weight in zip(edges, weights or [1.0] * len(edges), strict=True):
        cost[start] -= weight
        cost[end] += weight
    rows = np.repeat(np.arange(len(edges)), 2)
    columns = np.array(edges).ravel()
    values = np.tile([1.0, -1.0], len(edges))
    matrix = coo_matrix((values, (rows, columns)), shape=(len(edges), count)).tocsr()
    solution = linprog(cost, A_ub=matrix, b_ub=-np.ones(len(edges)), bounds=(0, None), method="highs")
    return [round(value) for value in solution.x]


def count_crossings(upper: Sequence[int], lower: Sequence[int], edges: Sequence[Edge]) -> int:
    """Crossings of straight edges between two neighbouring ordered layers.

    Examples
    --------
    >>> count_crossings([0, 1], [2, 3], [(0, 3), (1, 2)])
    1
    """
    first = {node: position for position, node in enumerate(upper)}
    second = {node: position for position, node in enumerate(lower)}
    placed = sorted((first[start], second[end]) for start, end in edges)
    return sum(a[0] < b[0] and a[1] > b[1] for index, a in enumerate(placed) for b in placed[index + 1 :])


@dataclass(frozen=True)
class Ordering:
    """Nodes of each layer from top to bottom, and how many crossings remain."""

    layers: tuple[tuple[int, ...], ...]
    crossings: int


def order_layers(layers: Sequence[Sequence[int]], edges: Sequence[Edge], fixed: frozenset[int]) -> Ordering:
    """Order the nodes within layers so that few edges cross.

    Parameters
    ----------
    layers
        Nodes of each layer in a first order.
    edges
        Edges between neighbouring layers, from the earlier to the later.
    fixed
        Layers (by index) whose order may not change.
    """
    between: list[list[Edge]] = [[] for _ in layers]
    where = {node: index for index, layer in enumerate(layers) for node in layer}
    for start, end in edges:
        between[where[start]].append((start, end))
    best: Ordering | None = None
    for first in _first_orders(layers, edges, fixed):
        candidate = _improve(first, between, fixed)
        if best is None or candidate.crossings < best.crossings:
            best = candidate
        if best.crossings == 0:
            break
    return best if best is not None else Ordering((), 0)


def _first_orders(
    layers: Sequence[Sequence[int]], edges: Sequence[Edge], fixed: frozenset[int]
) -> list[list[list[int]]]:
    """Orders to start from: depth-first from the first and from the last layer (both planar for trees), as given."""
    graph: nx.Graph[int] = nx.Graph()
    for layer in layers:
        graph.add_nodes_from(layer)
    graph.add_edges_from(edges)
    given = [list(layer) for layer in layers]
    orders = []
    for sequence in (given, given[::-1]):
        visited: dict[int, int] = {}
        for root in (node for layer in sequence for node in layer):
            if root not in visited:
                for node in nx.dfs_preorder_nodes(graph, root):
                    visited.setdefault(node, len(visited))
        orders.append(
            [layer if i in fixed else sorted(layer, key=visited.__getitem__) for i, layer in enumerate(given)]
        )
    return [*orders, given]


def _total(layers: Sequence[Sequence[int]], between: Sequence[Sequence[Edge]]) -> int:
    return sum(count_crossings(layers[i], layers[i + 1], between[i]) for i in range(len(layers) - 1))


def _improve(first: list[list[int]], between: list[list[Edge]], fixed: frozenset[int]) -> Ordering:
    """Barycentre sweeps forwards and backwards with neighbour exchange; the best order met is kept."""
    layers = [list(layer) for layer in first]
    best, fewest = [list(layer) for layer in layers], _total(layers, between)
    for sweep in range(SWEEPS):
        if fewest == 0:
            break
        forwards = sweep % 2 == 0
        for i in range(len(layers)) if forwards else range(len(layers) - 1, -1, -1):
            if i not in fixed:
                layers[i] = _barycentre_order(layers, between, i, forwards)
        _exchange(layers, between, fixed)
        crossings = _total(layers, between)
        if crossings < fewest:
            best, fewest = [list(layer) for layer in layers], crossings
    return Ordering(tuple(tuple(layer) for layer in best), fewest)


def _barycentre_order(layers: list[list[int]], between: list[list[Edge]], i: int, forwards: bool) -> list[int]:
    """Layer ``i`` sorted by the mean position of each node's neighbours in the layer just ordered."""
    j = i - 1 if forwards else i + 1
    if not 0 <= j < len(layers):
        return layers[i]
    position = {node: index for index, node in enumerate(layers[j])}
    neighbours: dict[int, list[int]] = {node: [] for node in layers[i]}
    for start, end in between[min(i, j)]:
        own, other = (end, start) if forwards else (start, end)
        neighbours[own].append(position[other])
    scale = max(len(layers[j]), 1) / max(len(layers[i]), 1)

    def key(item: tuple[int, int]) -> float:
        index, node = item
        places = neighbours[node]
        return sum(places) / len(places) if places else index * scale

    return [node for _, node in sorted(enumerate(layers[i]), key=key)]


def _exchange(layers: list[list[int]], between: list[list[Edge]], fixed: frozenset[int]) -> None:
    """Exchange neighbours within layers as long as this removes crossings."""

    def local(i: int) -> int:
        return sum(
            count_crossings(layers[k], layers[k + 1], between[k]) for k in (i - 1, i) if 0 <= k < len(layers) - 1
        )

    improved = True
    while improved:
        improved = False
        for i, layer in enumerate(layers):
            if i in fixed:
                continue
            for k in range(len(layer) - 1):
                before = local(i)
                layer[k], layer[k + 1] = layer[k + 1], layer[k]
                if local(i) < before:
                    improved = True
                else:
                    layer[k], layer[k + 1] = layer[k + 1], layer[k]


@dataclass(frozen=True)
class Alignment:
    """Wish that two attachment points lie at the same height: ``y[a] + offset_a = y[b] + offset_b``.

    ``channel`` is the index of the column that holds ``a``; ``b`` is in the next one.
    """

    a: int
    offset_a: float
    b: int
    offset_b: float
    weight: float
    channel: int


def place_vertically(
    layers: Sequence[Sequence[int]], above: Sequence[float], below: Sequence[float],
    alignments: Sequence[Alignment], gaps: Sequence[float],
) -> list[float]:  # fmt: skip
    """Heights of all nodes: order kept, no overlap, edges as straight as possible (a linear program).

    Parameters
    ----------
    above, below
        Extent of each node above and below its reference point.
    gaps
        Free space each node wants to its neighbours; between two nodes the larger counts.
    """
    count = len(above)
    rows: list[tuple[dict[int, float], float]] = []
    for layer in layers:
        for upper, lower in itertools.pairwise(layer):
            distance = below[upper] + above[lower] + max(gaps[upper], gaps[lower])
            rows.append(({upper: 1.0, lower: -1.0}, -distance))
    for k, wish in enumerate(alignments):
        shift = wish.offset_b - wish.offset_a
        rows.append(({wish.a: 1.0, wish.b: -1.0, count + k: -1.0}, shift))
        rows.append(({wish.a: -1.0, wish.b: 1.0, count + k: -1.0}, -shift))
    spread = count + len(alignments)  # one more variable: the total height, kept small where nothing else decides
    for node in range(count):
        rows.append(({node: 1.0, spread: -1.0}, -below[node]))
    cost = [1e-6] * count + [wish.weight for wish in alignments] + [0.02]
    bounds = [(extent, None) for extent in above] + [(0.0, None)] * (len(alignments) + 1)
    entries = [(i, j, value) for i, (row, _) in enumerate(rows) for j, value in row.items()]
    i_all, j_all, values = zip(*entries, strict=True)
    matrix = coo_matrix((values, (i_all, j_all)), shape=(len(rows), spread + 1)).tocsr()
    solution = linprog(cost, A_ub=matrix, b_ub=[right for _, right in rows], bounds=bounds, method="highs")
    return [round(float(value), 3) for value in solution.x[:count]]


def assign_tracks(ends: Sequence[tuple[float, float]], clearance: float) -> tuple[list[int | None], int]:
    """Tracks for the vertical pieces of edges in the channel between two layers.

    Parameters
    ----------
    ends
        Height of each edge at the left and at the right side of the channel.
    clearance
        Pieces closer than this must not share a track.

    Returns
    -------
    list, int
        Track of each edge (None where it is straight) and the number of tracks.

    Examples
    --------
    >>> assign_tracks([(0.0, 0.0), (10.0, 40.0), (20.0, 60.0)], 4.0)
    ([None, 1, 0], 2)
    """
    bent = [k for k, (left, right) in enumerate(ends) if abs(left - right) > 1e-6]
    order: nx.DiGraph[int] = nx.DiGraph()
    order.add_nodes_from(bent)
    for a in bent:
        for b in bent:
            if a < b and _spans_touch(ends[a], ends[b], clearance):
                first, second = (a, b) if _cost(ends[a], ends[b]) <= _cost(ends[b], ends[a]) else (b, a)
                order.add_edge(first, second)
    while not nx.is_directed_acyclic_graph(order):
        start, end = nx.find_cycle(order)[-1][:2]
        order.remove_edge(start, end)
        if not nx.has_path(order, start, end):
            order.add_edge(end, start)
    tracks: list[int | None] = [None] * len(ends)
    for k in nx.lexicographical_topological_sort(order):
        before = [tracks[j] for j in order.predecessors(k)]
        tracks[k] = max((track for track in before if track is not None), default=-1) + 1
    used = [track for track in tracks if track is not None]
    return tracks, max(used, default=-1) + 1


def _spans_touch(a: tuple[float, float], b: tuple[float, float], clearance: float) -> bool:
    return max(min(a), min(b)) <= min(max(a), max(b)) + clearance


def _cost(left: tuple[float, float], right: tuple[float, float]) -> int:
    """Crossings when the first edge's vertical piece lies left of the second's; pieces on one line count ten."""
    cost = 0
    for height, span in ((left[1], right), (right[0], left)):
        cost += min(span) < height < max(span)
    return cost + 10 * (abs(left[1] - right[0]) < 6)
