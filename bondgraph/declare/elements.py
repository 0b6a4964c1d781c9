"""Nodes and bonds of a bond graph as frozen values, and what each kind of node may declare.

Sign convention: power flows from a bond's tail (``source``) to its head (``target``). An element's own variables count
power as positive when it flows *into* the element: effort is the bond's effort, flow the bond's flow, with the opposite
sign where the bond points away from the element.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from sympy import Expr, Symbol

from bondgraph.declare.domains import Domain
from bondgraph.errors import DeclarationError, suggest

JUNCTIONS = ("0", "1")
SOURCES = ("Se", "Sf")
STORAGES = ("C", "I")
TWO_PORTS = ("TF", "GY")
KINDS = (*JUNCTIONS, *SOURCES, "R", *STORAGES, *TWO_PORTS)

#: The energy variable of each storage, and the power variable its law gives.
ENERGY_VARIABLE = {"C": "displacement", "I": "momentum"}
LAW_GIVES = {"C": "effort", "I": "flow"}

#: Laws of one-ports and two-ports: what may be given, in which of the element's own variables.
_LAWS: dict[str, dict[str, tuple[str, ...]]] = {
    "0": {},
    "1": {},
    "Se": {"effort": ()},
    "Sf": {"flow": ()},
    "R": {"effort": ("flow",), "flow": ("effort",), "residual": ("effort", "flow")},
    "C": {"effort": ("displacement",), "displacement": ("effort",)},
    "I": {"flow": ("momentum",), "momentum": ("flow",)},
    "TF": {"modulus": ()},
    "GY": {"modulus": ()},
}
_NAME = re.compile(r"[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*\Z")


@dataclass(frozen=True)
class Node:
    """A junction or an element.

    ``laws`` pairs what is given with its expression: ``effort`` of an R, ``modulus`` of a TF, ``effort1`` .. of a field,
    ``energy`` of a storage field. ``initial`` holds one start value per state; ``state`` is the state's own name where
    the user gave one.
    """

    name: str
    kind: str
    domain: Domain | None = None
    laws: tuple[tuple[str, Expr], ...] = ()
    ports: int = 1
    initial: tuple[float, ...] = ()
    state: str = ""
    doc: str = field(default="")

    def law(self, given: str) -> Expr | None:
        """The law that gives ``given``, or None."""
        return dict(self.laws).get(given)

    @property
    def is_junction(self) -> bool:
        """Whether the node is a 0- or 1-junction."""
        return self.kind in JUNCTIONS

    @property
    def is_field(self) -> bool:
        """Whether the node is a multiport C, I or R."""
        return self.kind in ("C", "I", "R") and self.ports > 1


@dataclass(frozen=True)
class Bond:
    """A power bond; positive power flows from ``source`` to ``target``."""

    source: str
    target: str

    def __str__(self) -> str:
        return f"{self.source} -> {self.target}"


def allowed_laws(kind: str, ports: int) -> dict[str, tuple[str, ...]]:
    """What a node of this kind may give as laws, and in which of its own variables.

    Examples
    --------
    >>> allowed_laws("R", 1)["flow"]
    ('effort',)
    >>> sorted(allowed_laws("C", 2))
    ['effort1', 'effort2', 'energy']
    """
    if ports == 1 or kind in TWO_PORTS:
        return _LAWS[kind]
    numbered = {name: tuple(f"{name}{port}" for port in range(1, ports + 1)) for name in ("effort", "flow")}
    if kind in STORAGES:
        stored = tuple(f"{ENERGY_VARIABLE[kind]}{port}" for port in range(1, ports + 1))
        return {"energy": stored, **{name: stored for name in numbered[LAW_GIVES[kind]]}}
    laws = {name: numbered["flow"] for name in numbered["effort"]}
    laws |= {name: numbered["effort"] for name in numbered["flow"]}
    return laws | {f"residual{port}": (*numbered["effort"], *numbered["flow"]) for port in range(1, ports + 1)}


def check_node(node: Node, graph: str) -> None:
    """Raise DeclarationError unless the node's kind, name, ports and laws fit together."""
    where = f"{graph}: {node.name}"
    if node.kind not in KINDS:
        raise DeclarationError(
            f"{where}: kind {node.kind!r} is not known{suggest(node.kind, KINDS)} - use one of {' '.join(KINDS)}",
            where=(node.name,),
        )
    if not _NAME.match(node.name):
        raise DeclarationError(
            f"{graph}: node name {node.name!r} - use letters, digits and underscores", where=(node.name,)
        )
    if node.ports < 1 or (node.ports > 1 and node.kind not in ("C", "I", "R")):
        raise DeclarationError(
            f"{where}: {node.ports} ports - only C, I and R may have several ports, at least 1", where=(node.name,)
        )
    known = allowed_laws(node.kind, node.ports)
    for given, _ in node.laws:
        if given not in known:
            raise DeclarationError(
                f"{where}: a {node.kind} does not give {given!r}{suggest(given, known)} - it takes "
                f"{', '.join(known) or 'no law'}",
                where=(node.name,),
            )
    _check_complete(node, where)


def _check_complete(node: Node, where: str) -> None:
    given = {name for name, _ in node.laws}
    if node.is_field:
        numbers = range(1, node.ports + 1)
        stems = ("effort", "flow", "residual")
        whole = [{"energy"}] + [{f"{stem}{port}" for port in numbers} for stem in stems]
        if given not in whole:
            raise DeclarationError(
                f"{where}: a {node.kind} with {node.ports} ports needs an energy or {node.ports} laws of one form, "
                f"but has {', '.join(sorted(given)) or 'none'}",
                where=(node.name,),
            )
        return
    if node.kind in STORAGES and LAW_GIVES[node.kind] not in given:
        given = set()
    if not node.is_junction and not given:
        needed = " or ".join(name for name in allowed_laws(node.kind, 1) if name not in ENERGY_VARIABLE.values())
        raise DeclarationError(f"{where}: a {node.kind} needs a law - give its {needed}", where=(node.name,))
    if "residual" in given and len(given) > 1:
        raise DeclarationError(
            f"{where}: a residual together with explicit laws - give either the residual or effort/flow",
            where=(node.name,),
        )


def foreign_locals(symbols: list[Symbol], allowed: tuple[str, ...]) -> list[str]:
    """Own-variable names among ``symbols`` that this law may not use."""
    return [symbol.name for symbol in symbols if symbol.name not in allowed]
