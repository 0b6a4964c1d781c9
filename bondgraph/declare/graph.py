"""The builder: a bond graph declared step by step, in the order in which an engineer draws it.

Everything after the graph is immutable; only :class:`BondGraph` grows. A mistake is found at the declaring line, except
what can only be known at the end (a junction without bonds, a signal of a node declared later), which
:meth:`BondGraph.validate` finds before causality is assigned.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NoReturn, Self

from bondgraph.declare.composition import depth_of, flatten
from bondgraph.declare.element_builder import ElementBuilder
from bondgraph.declare.handles import At, ElementType, Handle, Law, SubGraph, apply_law, callable_law
from bondgraph.declare.limits import DEEPEST_PART
from bondgraph.declare.other_names import refuse_name
from bondgraph.declare.quantities import Input, Parameter
from bondgraph.declare.quantity_builder import QuantityBuilder
from bondgraph.declare.validation import validate
from bondgraph.errors import DeclarationError, suggest
from bondgraph.shown import Drawn

__all__ = ["At", "BondGraph", "ElementType", "Handle", "Law", "SubGraph", "apply_law", "callable_law"]


class BondGraph(QuantityBuilder, ElementBuilder, Drawn):
    """A bond graph under construction.

    Parameters
    ----------
    name
        Name of the model; the generated module is called so.
    doc
        What the graph describes; its first line heads the generated module.
    source
        Where it is declared, for the header of the generated module.

    Raises
    ------
    DeclarationError
        By every method, at the line that declares something impossible.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("rotor", doc="a rotor with a bearing")
    >>> torque = g.input("torque", "N m", "driving torque")
    >>> J = g.parameter("J", 0.02, "kg m^2", "rotor inertia", (0.01, 0.05))
    >>> b = g.parameter("b", 0.1, "N m s", "bearing friction")
    >>> shaft = g.one_junction("shaft", bg.ROTATION)
    >>> _ = g.effort_source("drive", torque, at=shaft)
    >>> _ = g.inertance("rotor", J, at=shaft)
    >>> _ = g.resistance("bearing", lambda omega: b * omega, at=shaft)
    >>> _ = g.measure_flow("omega", shaft, "shaft speed")
    >>> [str(bond) for bond in g.bonds]
    ['drive -> shaft', 'shaft -> rotor', 'shaft -> bearing']
    """

    if not TYPE_CHECKING:  # a checker says by itself which names there are not

        def __getattr__(self, name: str) -> NoReturn:
            refuse_name(name, (one for one in dir(type(self)) if not one.startswith("_")))

    def include(
        self,
        name: str,
        graph: Self,
        ports: Mapping[str, str] | None = None,
        bind: Mapping[str, Any] | None = None,
        *,
        shared: bool = False,
    ) -> SubGraph[Self]:
        """Use a graph as a part; outer bonds reach it as ``"name.port"``.

        ``bind`` replaces inputs and parameters of the part by expressions of this graph, which are in coherent SI; a
        mere number is in the unit in which the part declares what it replaces. Inner names get the part's
        name and a dot in front; with ``shared`` those of quantities stay as they are, and parts that declare the same
        quantity (the tyre radius, the throttle) share it.
        """
        if name in self._nodes or name in self._subgraphs:
            raise DeclarationError(f"{self.name}: {name} is declared twice - use another name", (name,))
        if depth_of(graph) >= DEEPEST_PART:
            raise DeclarationError(
                f"{self.name}: {name}: parts stand more than {DEEPEST_PART} deep inside each other - put fewer parts "
                "into parts",
                where=(name,),
            )
        for port, inner in (ports or {}).items():
            if not graph.has_node(inner):
                raise DeclarationError(
                    f"{self.name}: port {name}.{port}: {graph.name} has no node {inner!r}{suggest(inner, graph.nodes)}",
                    where=(f"{name}.{port}",),
                )
        replaceable: list[Input | Parameter] = [*graph.inputs, *graph.parameters]
        declared = {one.name: one for one in replaceable}
        given = {key: _in_si(value, declared.get(key)) for key, value in (bind or {}).items()}
        bound = {key: self._checked(value, (), f"{name}.{key}") for key, value in given.items()}
        for key in bound:
            if key not in declared:
                raise DeclarationError(
                    f"{self.name}: {name}: {graph.name} has no input or parameter {key!r}{suggest(key, declared)}",
                    where=(f"{name}.{key}",),
                )
        part = SubGraph(name, graph, tuple((ports or {}).items()), tuple(bound.items()), shared)
        self._subgraphs[name] = part
        try:
            flatten(self)
        except DeclarationError:
            del self._subgraphs[name]
            raise
        return part

    def exchange(self, name: str, graph: Self) -> None:
        """Replace the part ``name`` by another graph with the same ports."""
        if name not in self._subgraphs:
            raise DeclarationError(f"{self.name}: no part {name!r}{suggest(name, self._subgraphs)}", where=(name,))
        order = list(self._subgraphs)
        old = self._subgraphs.pop(name)
        try:
            new = [key for key, _ in old.bind if key in graph.quantities]
            self.include(name, graph, dict(old.ports), {key: dict(old.bind)[key] for key in new}, shared=old.shared)
        except DeclarationError:
            self._subgraphs[name] = old
            raise
        finally:
            self._subgraphs = {key: self._subgraphs[key] for key in order}

    def validate(self) -> None:
        """Raise DeclarationError for what can only be known when the graph is complete.

        Bonds per element, junctions without bonds, mixed domains, signals of nodes that do not exist.
        """
        validate(self.flatten())

    def flatten(self) -> Self:
        """The same machine without parts: inner names get the part's name and a dot in front."""
        return flatten(self)


def _in_si(value: Any, declared: Input | Parameter | None) -> Any:
    """A number that is bound in the place of a declared quantity, in coherent SI; expressions are that already."""
    return value if declared is None or not isinstance(value, int | float) else declared.coherent(value)
