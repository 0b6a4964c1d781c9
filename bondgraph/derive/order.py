"""Order of computation: strongly connected components of the dependency graph, and a feedback set to tear a loop."""

from __future__ import annotations

from collections.abc import Callable, Container, Hashable, Iterable, Sequence
from typing import TypeVar

K = TypeVar("K", bound=Hashable)


def components(roots: Iterable[K], depends: Callable[[K], Sequence[K]]) -> list[list[K]]:
    """Strongly connected components, dependencies first (Tarjan 1972, SIAM J. Comput. 1(2), without recursion).

    Examples
    --------
    >>> edges = {"a": ["b"], "b": ["c"], "c": ["b"]}
    >>> components(["a"], lambda key: edges[key])
    [['b', 'c'], ['a']]
    """
    index: dict[K, int] = {}
    low: dict[K, int] = {}
    on_stack: dict[K, bool] = {}
    stack: list[K] = []
    found: list[list[K]] = []
    for root in roots:
        if root in index:
            continue
        work: list[tuple[K, int]] = [(root, 0)]
        while work:
            key, position = work.pop()
            if key not in index:
                index[key] = low[key] = len(index)
                stack.append(key)
                on_stack[key] = True
            children = depends(key)
            for offset in range(position, len(children)):
                child = children[offset]
                if child not in index:
                    work += [(key, offset), (child, 0)]
                    break
                if on_stack.get(child):
                    low[key] = min(low[key], low[child])
            else:
                if low[key] == index[key]:
                    found.append(_pop_component(key, stack, on_stack, index))
    return found


def _pop_component(key: K, stack: list[K], on_stack: dict[K, bool], index: dict[K, int]) -> list[K]:
    members: list[K] = []
    while True:
        member = stack.pop()
        on_stack[member] = False
        members.append(member)
        if member == key:
            return sorted(members, key=index.__getitem__)


def tear(
    members: Sequence[K],
    depends: Callable[[K], Sequence[K]],
    must: Sequence[K] = (),
    prefer: Container[K] = (),
) -> tuple[list[K], list[K]]:
    """Variables to guess so that the rest of a loop follows in order, and that order.

    Greedy: the member with the most connections within its loop is torn first (Lempel and Barnett 1964 show that small
    feedback sets rarely need more), from among ``prefer`` where one of these is in the loop. ``must`` members are torn
    in any case.

    Examples
    --------
    >>> edges = {"b": ["c"], "c": ["b"]}
    >>> tear(["b", "c"], lambda key: edges[key])
    (['b'], ['c'])
    """
    torn = list(must)
    while True:
        rest = [member for member in members if member not in set(torn)]
        inside = set(rest)

        def within(key: K, inside: set[K] = inside) -> list[K]:
            return [child for child in depends(key) if child in inside]

        parts = components(rest, within)
        cyclic = [part for part in parts if len(part) > 1 or part[0] in within(part[0])]
        if not cyclic:
            return torn, [part[0] for part in parts]
        torn += [_most_connected(part, within, prefer) for part in cyclic]


def _most_connected(part: Sequence[K], within: Callable[[K], Sequence[K]], prefer: Container[K]) -> K:
    inside = set(part)
    incoming = dict.fromkeys(part, 0)
    outgoing = dict.fromkeys(part, 0)
    for key in part:
        for child in within(key):
            if child in inside:
                incoming[child] += 1
                outgoing[key] += 1
    return max(part, key=lambda key: (key in prefer, incoming[key] * outgoing[key]))
