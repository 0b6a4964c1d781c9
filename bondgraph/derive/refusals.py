"""Why strokes cannot be placed, in the user's names: both culprits, the chain between them, and the ways out."""

from __future__ import annotations

from collections.abc import Sequence

from bondgraph.declare.elements import LAW_GIVES, SOURCES, TWO_PORTS, Node
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.strokes import ContradictionError, Reason, StrokeSearch
from bondgraph.errors import CausalityError
from bondgraph.text import inflected

_OTHER = {"effort": "flow", "flow": "effort"}


def explain_chain(graph: BondGraph, reasons: Sequence[Reason | None], bond: int) -> str:
    """Reasons of a stroke back to the source, storage, law or choice it began with."""
    parts, seen = [], set()
    while bond not in seen:
        seen.add(bond)
        reason = reasons[bond]
        if reason is None:
            break
        parts.append(f"bond {graph.bonds[bond]}: {reason.text}")
        if reason.kind != "propagated" or not reason.causes:
            break
        bond = reason.causes[0]
    return " <- ".join(parts)


def clash(search: StrokeSearch, contradiction: ContradictionError, causes: Sequence[int]) -> str:
    """What would go wrong, as a clause: who else imposes the variable, or that nobody would."""
    node = search.graph.nodes[contradiction.node]
    culprits = _names(search, causes)
    with_them = f" beside {', '.join(culprits)}" if culprits else ""
    if not node.is_junction:
        return f"the strokes of {node.name} would not fit its law{with_them}"
    common = _common(node)
    if _is_strong(search, node, contradiction) and culprits:
        return f"{' and '.join(culprits)} already {inflected(culprits, 'determines', 'determine')} the {common}"
    if _is_strong(search, node, contradiction):
        return f"the {common} would be imposed twice"
    return f"no bond would impose the {common}{with_them}"


def refusal(search: StrokeSearch, contradiction: ContradictionError) -> CausalityError:
    """The error for demands that exclude each other whatever the storages do."""
    graph = search.graph
    bonds = list(contradiction.bonds)
    where = [f"bond {graph.bonds[bond]}" for bond in bonds]
    reasons = [reason for bond in search.roots(contradiction) if (reason := search.reasons[bond]) is not None]
    node = graph.nodes[contradiction.node]
    if contradiction.wanted is not None:
        bond, wanted = contradiction.wanted
        reasons.append(wanted)
        node = _imposing_junction(search, bond) or node
        what = f"{where[0]} cannot carry its stroke{_at(node)} ({wanted.text}) because {_already(search, bond)}"
    elif not node.is_junction:
        what = f"the law of {node.kind} {node.name} does not allow these strokes together: {_chains(search, bonds)}"
    elif _is_strong(search, node, contradiction):
        first = search.reasons[bonds[-1]]
        assert first is not None
        what = f"{where[-1]} cannot carry its stroke{_at(node)} ({first.text}) because the {_common(node)} of "
        what += f"{_junction(node)} is already imposed ({_chains(search, bonds[:-1])})"
    else:
        what = f"{_junction(node)}: no bond can impose its {_common(node)}: every neighbour takes it from the junction "
        what += f"({_chains(search, bonds)})"
    culprits = list(dict.fromkeys(reason.node for reason in reasons))
    todo = _ways_out(search, node, reasons)
    return CausalityError(f"{graph.name}: {what}; {todo}", where=tuple(dict.fromkeys([*where, *culprits])))


def _chains(search: StrokeSearch, bonds: Sequence[int]) -> str:
    return "; ".join(explain_chain(search.graph, search.reasons, bond) for bond in bonds)


def _already(search: StrokeSearch, bond: int) -> str:
    """Why a bond has the stroke it has, as a clause."""
    head, arrow, tail = explain_chain(search.graph, search.reasons, bond).partition(" <- ")
    return head.partition(": ")[2].replace(" imposes ", " already imposes ", 1) + (f" ({tail})" if arrow else "")


def _imposing_junction(search: StrokeSearch, bond: int) -> Node | None:
    reason = search.reasons[bond]
    node = search.graph.nodes[reason.node] if reason is not None else None
    return node if node is not None and node.is_junction else None


def _at(node: Node) -> str:
    return f" at {node.name}" if node.is_junction else ""


def _ways_out(search: StrokeSearch, node: Node, reasons: Sequence[Reason]) -> str:
    nodes = search.graph.nodes
    ways = []
    for reason in reasons:
        if nodes[reason.node].kind in ("R", "X"):
            gives = "effort" if reason.text.endswith("effort") else "flow"
            ways.append(f"give {reason.node} its law as {_OTHER[gives]}({gives})")
    sources = [reason.node for reason in reasons if nodes[reason.node].kind in SOURCES]
    if len(sources) > 1:
        ways.append(f"remove one of {', '.join(dict.fromkeys(sources))}")
    elif sources:
        ways.append(f"make {sources[0]} an {'Sf' if nodes[sources[0]].kind == 'Se' else 'Se'}")
    if node.is_junction and reasons:
        ways.append(f"separate them by a {'1' if node.kind == '0' else '0'}-junction with an element of its own")
    if not reasons:
        ways.append("no choice of strokes fits the junctions: change the kind of one, or remove a bond between them")
    return " or ".join(dict.fromkeys(ways))


def refuse_law(search: StrokeSearch, node: Node, bond: int) -> None:
    """Refuse a storage whose variable is imposed by a law: it would have to be differentiated through that law."""
    roots = search.roots_of([bond])
    reasons = [search.reasons[root] for root in roots]
    kinds = {reason.kind for reason in reasons if reason is not None}
    if "law" not in kinds or "integral" in kinds:
        return
    root, reason = next((b, r) for b, r in zip(roots, reasons, strict=True) if r is not None and r.kind == "law")
    law_bond = search.graph.bonds[root]
    at = law_bond.source if law_bond.target == reason.node else law_bond.target
    ends = search.graph.bonds[bond]
    neighbour = search.graph.nodes[ends.source if ends.target == node.name else ends.target]
    variable = "effort" if "effort" in reason.text else "flow"
    todo = f"give {reason.node} its law as {_OTHER[variable]}({variable}), or as a residual if that has no closed form,"
    if search.graph.nodes[reason.node].kind in TWO_PORTS:
        todo = f"exchange the sides of {reason.node},"
    imposed = f"the {LAW_GIVES[node.kind]} of {_junction(neighbour) if neighbour.is_junction else neighbour.name}"
    place = at if variable == "effort" else reason.node
    separator = "1" if LAW_GIVES[node.kind] == "effort" else "0"
    raise CausalityError(
        f"{search.graph.name}: bond {law_bond} cannot carry its stroke at {place} "
        f"({reason.text.replace('gives the', 'gives an' if variable == 'effort' else 'gives a')}) because {node.name} "
        f"already imposes {imposed}; {todo} or separate them by a {separator}-junction",
        where=(f"bond {law_bond}", node.name),
    )


def refuse_rings(graph: BondGraph) -> None:
    """Refuse junctions of one kind that are bonded into a ring: nothing determines what circulates in it."""
    parent: dict[str, str] = {}

    def find(name: str) -> str:
        while parent.get(name, name) != name:
            parent[name] = parent.get(parent[name], parent[name])
            name = parent[name]
        return name

    for bond in graph.bonds:
        source, target = graph.nodes[bond.source], graph.nodes[bond.target]
        if not source.is_junction or source.kind != target.kind:
            continue
        a, b = find(source.name), find(target.name)
        if a == b:
            free = "flow" if source.kind == "0" else "effort"
            raise CausalityError(
                f"{graph.name}: bond {bond} closes a ring of {source.kind}-junctions, in which any {free} could "
                "circulate; remove this bond, or put an element on a junction of the other kind into the ring",
                where=(f"bond {bond}",),
            )
        parent[b] = a


def _is_strong(search: StrokeSearch, node: Node, contradiction: ContradictionError) -> bool:
    """Whether a junction's variable is imposed twice (and not at all otherwise)."""
    if contradiction.wanted is not None:
        return True
    inward = dict(search.incidence[node.name])
    return any(
        search.receives(bond, inward[bond]) == (node.kind == "0") for bond in contradiction.bonds if bond in inward
    )


def _names(search: StrokeSearch, bonds: Sequence[int]) -> list[str]:
    reasons = [search.reasons[bond] for bond in bonds]
    return list(dict.fromkeys(reason.node for reason in reasons if reason is not None))


def _common(node: Node) -> str:
    return "effort" if node.kind == "0" else "flow"


def _junction(node: Node) -> str:
    return f"{node.kind}-junction {node.name}"
