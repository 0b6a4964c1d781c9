"""Nodes and bonds of a bond graph as frozen values, and what each kind of node may declare.

Sign convention: power flows from a bond's tail (``source``) to its head (``target``). An element's own variables count
power as positive when it flows *into* the element: effort is the bond's effort, flow the bond's flow, with the opposite
sign where the bond points away from the element. A source's flow counts along its bond, whichever way that points.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from sympy import Expr, Symbol

from bondgraph.declare.domains import Domain
from bondgraph.declare.modal_laws import MODAL_LAWS, check_modal
from bondgraph.declare.other_names import such_as
from bondgraph.declare.quantities import ParameterStart, Start
from bondgraph.errors import DeclarationError, suggest

JUNCTIONS = ("0", "1")
SOURCES = ("Se", "Sf")
STORAGES = ("C", "I")
TWO_PORTS = ("TF", "GY")
MULTIPORTS = ("C", "I", "R", "X")
KINDS = (*JUNCTIONS, *SOURCES, "R", *STORAGES, *TWO_PORTS, "X")

#: The energy variable of each storage, and the power variable its law gives.
ENERGY_VARIABLE = {"C": "displacement", "I": "momentum"}
LAW_GIVES = {"C": "effort", "I": "flow"}

#: Laws of one-ports and two-ports: what may be given, in which of the element's own variables.
_LAWS: dict[str, dict[str, tuple[str, ...]]] = {
    "0": {},
    "1": {},
    "Se": {"effort": ()},
    "Sf": {"flow": ()},
    "R": {"effort": ("flow",), "flow": ("effort",), "residual": ("effort", "flow"), **MODAL_LAWS},
    "C": {
        "effort": ("displacement",),
        "displacement": ("effort",),
        "energy": ("displacement",),
        "residual": ("effort", "displacement"),
    },
    "I": {
        "flow": ("momentum",),
        "momentum": ("flow",),
        "energy": ("momentum",),
        "residual": ("flow", "momentum"),
    },
    "TF": {"modulus": ()},
    "GY": {"modulus": ()},
}
_NAME = re.compile(r"[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*\Z")
_FORM = re.compile(r"(\d+)\.(effort|flow)(\d+)\Z")


@dataclass(frozen=True)
class Node:
    """A junction or an element.

    ``laws`` pairs what is given with its expression: ``effort`` of an R, ``modulus`` of a TF, ``effort1`` .. of a
    field, ``energy`` of a storage, ``1.effort1``, ``1.flow2`` .. of the first form of a user-defined element.
    ``initial`` holds one start value per state (for a residual, where the search for its root starts); ``state`` is the
    state's own name where the user gave one; of a multiport it is the stem of numbered names, or one name per port with
    spaces between. ``starts``, empty or one per state, are signals of a log that come before ``initial``, or
    expressions of parameters of which ``initial`` is the value at the declared ones.
    ``initial_units``, empty or one per state, are those in which start values were given, empty for numbers in SI.
    """

    name: str
    kind: str
    domain: Domain | None = None
    laws: tuple[tuple[str, Expr], ...] = ()
    ports: int = 1
    initial: tuple[float, ...] = ()
    state: str = ""
    doc: str = field(default="")
    starts: tuple[Start | ParameterStart | None, ...] = ()
    initial_units: tuple[str, ...] = field(default=(), compare=False)

    def law(self, given: str) -> Expr | None:
        """The law that gives ``given``, or None."""
        return dict(self.laws).get(given)

    def start(self, port: int = 1) -> Start | ParameterStart | None:
        """The signal of a log, or the expression, at which the state of a port starts; None: at its number."""
        return self.starts[port - 1] if len(self.starts) >= port else None

    def state_name(self, port: int = 1) -> str:
        """The state's own name at a port, empty where none was given.

        Examples
        --------
        >>> springs = Node("springs", "C", ports=2, state="heave pitch")
        >>> springs.state_name(2), Node("springs", "C", ports=2, state="q").state_name(2)
        ('pitch', 'q2')
        """
        names = self.state.split()
        if len(names) == self.ports:
            return names[port - 1]
        return f"{self.state}{port if self.is_field else ''}" if self.state else ""

    @property
    def is_junction(self) -> bool:
        """Whether the node is a 0- or 1-junction."""
        return self.kind in JUNCTIONS

    @property
    def is_field(self) -> bool:
        """Whether the node is a multiport C, I or R, or an X."""
        return self.kind == "X" or (self.kind in MULTIPORTS and self.ports > 1)


@dataclass(frozen=True)
class Bond:
    """A power bond; positive power flows from ``source`` to ``target``."""

    source: str
    target: str

    def __str__(self) -> str:
        return f"{self.source} -> {self.target}"


def numbered(variable: str, ports: int) -> tuple[str, ...]:
    """A multiport's own names of a variable.

    Examples
    --------
    >>> numbered("flow", 2)
    ('flow1', 'flow2')
    """
    return tuple(f"{variable}{port}" for port in range(1, ports + 1))


def allowed_laws(kind: str, ports: int) -> dict[str, tuple[str, ...]]:
    """What a node of this kind may give as laws, and in which of its own variables.

    Examples
    --------
    >>> allowed_laws("R", 1)["flow"]
    ('effort',)
    >>> sorted(allowed_laws("C", 2))
    ['effort1', 'effort2', 'energy']
    """
    if kind in _LAWS and (ports == 1 or kind not in MULTIPORTS):
        return _LAWS[kind]
    efforts, flows = numbered("effort", ports), numbered("flow", ports)
    if kind in STORAGES:
        stored = numbered(ENERGY_VARIABLE[kind], ports)
        return {"energy": stored, **dict.fromkeys(numbered(LAW_GIVES[kind], ports), stored)}
    laws = dict.fromkeys(efforts, flows) | dict.fromkeys(flows, efforts)
    return laws | dict.fromkeys(numbered("residual", ports), (*efforts, *flows))


def own_variables(node: Node, given: str) -> tuple[str, ...] | None:
    """The element's own variables that the law of ``given`` may use, None where it may not give this.

    The laws of one form of an X are functions of what its ports take in that form.

    Examples
    --------
    >>> hall = Node("hall", "X", ports=2, laws=(("1.effort1", Symbol("u")), ("1.flow2", Symbol("i"))))
    >>> own_variables(hall, "1.flow2")
    ('flow1', 'effort2')
    """
    if node.kind != "X":
        return allowed_laws(node.kind, node.ports).get(given)
    if _FORM.match(given) is None:
        return None
    form = given.partition(".")[0] + "."
    taken = [name.removeprefix(form) for name, _ in node.laws if name.startswith(form)]
    return tuple(name.replace("effort", "_").replace("flow", "effort").replace("_", "flow") for name in taken)


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
            f"{graph}: node name {node.name!r} - use letters, digits and underscores{such_as(node.name)}",
            where=(node.name,),
        )
    if node.ports < 1 or (node.ports > 1 and node.kind not in MULTIPORTS):
        raise DeclarationError(
            f"{where}: {node.ports} ports - only C, I, R and X may have several ports, at least 1", where=(node.name,)
        )
    for given, _ in node.laws:
        if own_variables(node, given) is None:
            known = list(allowed_laws(node.kind, node.ports))
            raise DeclarationError(
                f"{where}: {a_kind(node.kind)} does not give {given!r}{suggest(given, known)} - it takes "
                f"{', '.join(known) or 'no law'}",
                where=(node.name,),
            )
    _check_complete(node, where)
    check_modal(node.name, [name for name, _ in node.laws], where)


def _check_complete(node: Node, where: str) -> None:
    given = {name for name, _ in node.laws}
    if node.kind == "X":
        _check_forms(node, where)
    elif node.is_field:
        whole = [{"energy"}, *(set(numbered(stem, node.ports)) for stem in ("effort", "flow", "residual"))]
        if given not in whole:
            raise DeclarationError(
                f"{where}: {a_kind(node.kind)} with {node.ports} ports needs an energy or {node.ports} laws of one "
                f"form, but has {', '.join(sorted(given)) or 'none'}",
                where=(node.name,),
            )
    elif not node.is_junction and not given:
        needed = " or ".join(name for name in allowed_laws(node.kind, 1) if name not in MODAL_LAWS)
        raise DeclarationError(f"{where}: {a_kind(node.kind)} needs a law - give its {needed}", where=(node.name,))
    elif given & {"residual", "energy"} and len(given) > 1:
        alone = "residual" if "residual" in given else "energy"
        raise DeclarationError(
            f"{where}: {a_kind(alone)} together with {' and '.join(sorted(given - {alone}))} - give either the one or "
            "the other",
            where=(node.name,),
        )


def _check_forms(node: Node, where: str) -> None:
    forms: dict[str, list[int]] = {}
    for given, _ in node.laws:
        found = _FORM.match(given)
        assert found is not None  # any other has been refused
        forms.setdefault(found[1], []).append(int(found[3]))
    for ports in forms.values() or [[]]:
        if sorted(ports) != list(range(1, node.ports + 1)):
            raise DeclarationError(
                f"{where}: an X with {node.ports} port(s) needs forms that give one effort or flow for each port, but "
                f"one gives them for port(s) {', '.join(map(str, ports)) or 'none'}",
                where=(node.name,),
            )


def a_kind(kind: str) -> str:
    """A kind with its article.

    Examples
    --------
    >>> a_kind("I"), a_kind("C")
    ('an I', 'a C')
    """
    return f"an {kind}" if kind in ("I", "R", "X", "Se", "Sf", "energy") else f"a {kind}"


def foreign_locals(symbols: Iterable[Symbol], allowed: tuple[str, ...]) -> list[str]:
    """Own-variable names among ``symbols`` that this law may not use."""
    return [symbol.name for symbol in symbols if symbol.name not in allowed]
