"""Which strokes an element allows, and which equation of a multiport gives which of its variables."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from sympy import Expr, Symbol

from bondgraph.declare.elements import Node
from bondgraph.declare.modal_laws import is_modal
from bondgraph.declare.quantities import symbol
from bondgraph.derive.laws import inverse, slope
from bondgraph.derive.zero import is_regular

#: For every port, whether it receives the effort.
Pattern = tuple[bool, ...]

#: Multiports with more ports than this are only used in the form in which their laws are given.
_MOST_PORTS = 6

_TWO_PORTS: dict[str, tuple[Pattern, ...]] = {
    "TF": ((True, False), (False, True)),
    "GY": ((True, True), (False, False)),
}


def local(node: Node, variable: str, port: int) -> Symbol:
    """The element's own symbol of a variable at a port (counted from 1)."""
    return symbol(f"{variable}{port}" if node.is_field else variable)


def stroke_patterns(node: Node) -> tuple[Pattern, ...] | None:
    """The strokes that the laws of an R, X, TF or GY allow, the declared form first; None where all are possible.

    A law that can be solved for its other variable in closed form allows both strokes. One that cannot is used as it
    was given, since its inverse might have several branches; a residual is solved for whatever is not given.

    Examples
    --------
    >>> flow = symbol("flow")
    >>> stroke_patterns(Node("r", "R", laws=(("effort", flow**3),)))
    ((False,),)
    >>> stroke_patterns(Node("r", "R", laws=(("effort", 2 * flow),))) is None
    True
    >>> stroke_patterns(Node("m", "GY", laws=(("modulus", symbol("k")),)))
    ((True, True), (False, False))
    """
    if node.kind in _TWO_PORTS:
        return _TWO_PORTS[node.kind]
    if node.kind == "X":
        return tuple(tuple(f"flow{port}" in form for port in ports_of(node)) for form in forms(node))
    if node.kind != "R":
        return None
    if node.ports == 1:
        return _one_port(node)
    declared = _declared(node)
    implicit = node.laws[0][0].startswith("residual")
    if node.ports > _MOST_PORTS or not (implicit or _is_affine(node)):
        return (declared,)
    allowed = [p for p in itertools.product((False, True), repeat=node.ports) if _determines(node, p)]
    return tuple(sorted(allowed, key=lambda pattern: pattern != declared))


def ports_of(node: Node) -> range:
    """Numbers of an element's ports."""
    return range(1, node.ports + 1)


def forms(node: Node) -> list[dict[str, Expr]]:
    """The forms of a user-defined element: for each, which variables it gives and how."""
    found: dict[str, dict[str, Expr]] = {}
    for given, law in node.laws:
        number, _, variable = given.partition(".")
        found.setdefault(number, {})[variable] = law
    return list(found.values())


def _one_port(node: Node) -> tuple[Pattern, ...] | None:
    laws = dict(node.laws)
    if is_modal(laws):
        return ((False,),)
    if "residual" in laws or len(laws) == 2:
        return None
    given, law = next(iter(laws.items()))
    own = symbol("flow" if given == "effort" else "effort")
    return None if inverse(law, own, symbol(given)) is not None else ((given == "flow",),)


def _declared(node: Node) -> Pattern:
    return (node.laws[0][0].startswith("flow"),) * node.ports


def _is_affine(node: Node) -> bool:
    own = [local(node, variable, port) for variable in ("effort", "flow") for port in ports_of(node)]
    return not any(slope(law, used).free_symbols & set(own) for _, law in node.laws for used in own)


def equations_of(node: Node) -> list[Expr]:
    """The laws of an R as expressions in its efforts and flows that vanish."""
    laws = dict(node.laws)
    if node.ports == 1 and len(laws) == 2:
        del laws[node.laws[1][0]]
    return [law if given.startswith("residual") else symbol(given) - law for given, law in laws.items()]


def unknowns_of(node: Node, pattern: Pattern) -> list[Symbol]:
    """What an element gives at each port: the effort where it does not receive it, else the flow."""
    return [
        local(node, "flow" if takes else "effort", port) for port, takes in zip(ports_of(node), pattern, strict=True)
    ]


def _determines(node: Node, pattern: Pattern) -> bool:
    unknowns = unknowns_of(node, pattern)
    return is_regular([[slope(equation, unknown) for unknown in unknowns] for equation in equations_of(node)])


def match(equations: Sequence[Expr], unknowns: Sequence[Symbol], spare: bool = False) -> list[int] | None:
    """For each unknown the equation that is to give it, or None where the equations cannot give them all.

    An equation in which an unknown is linear, with a coefficient that depends on none of the others, is preferred;
    among those the order of declaration decides (augmenting paths, Kuhn 1955, Nav. Res. Logist. Q. 2). With ``spare``
    what is left over is paired too: an equation about other variables determines an unknown through the rest of the
    graph, as the output of an ideal operational amplifier follows from its input.

    Examples
    --------
    >>> x, y = symbol("x"), symbol("y")
    >>> match([y - 1, x + y**3], [x, y])
    [1, 0]
    """
    easy = [[bool((s := slope(e, u)) != 0 and not s.free_symbols & set(unknowns)) for e in equations] for u in unknowns]
    present = [[u in e.free_symbols for e in equations] for u in unknowns]
    giver: dict[int, int] = {}

    def augment(unknown: int, seen: set[int], allowed: list[list[bool]]) -> bool:
        for equation in sorted(range(len(equations)), key=lambda e: e != unknown):
            if allowed[unknown][equation] and equation not in seen:
                seen.add(equation)
                if equation not in giver or augment(giver[equation], seen, allowed):
                    giver[equation] = unknown
                    return True
        return False

    for allowed in (easy, present):
        for unknown in range(len(unknowns)):
            if unknown not in giver.values():
                augment(unknown, set(), allowed)
    if len(giver) < len(unknowns) and not spare:
        return None
    left = [unknown for unknown in range(len(unknowns)) if unknown not in giver.values()]
    giver |= zip([e for e in range(len(equations)) if e not in giver], left, strict=False)
    return [next(e for e, u in giver.items() if u == unknown) for unknown in range(len(unknowns))]
