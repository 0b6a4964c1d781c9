"""What declaring gives back: handles of nodes, whose variables are signals; laws as functions; kinds of one's own."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeAlias, TypeVar

import sympy
from sympy import Expr, Symbol

from bondgraph.declare.domains import Domain
from bondgraph.declare.expressions import signal
from bondgraph.declare.laws import apply_law, as_expression, call_law, callable_law
from bondgraph.errors import DeclarationError

__all__ = ["At", "ElementType", "Handle", "Law", "SubGraph", "apply_law", "callable_law"]

_Graph = TypeVar("_Graph")

#: A law: a function of the element's own variables, an expression in them, or the coefficient of a linear law.
Law: TypeAlias = Callable[..., Any] | Expr | float


@dataclass(frozen=True)
class Handle:
    """A declared node: pass it as ``at=``, read its variables as signals in other laws."""

    name: str
    kind: str
    domain: Domain | None
    number: int = 0

    def port(self, number: int) -> Handle:
        """One port of a multiport or two-port, counted from 1 in the order of its bonds; read its variables.

        Examples
        --------
        >>> Handle("gear", "TF", None).port(2).flow
        flow2(gear)
        """
        return dataclasses.replace(self, number=number)

    @property
    def effort(self) -> Symbol:
        """The effort as a signal (of a 0-junction, or of an element's bond)."""
        return signal("effort", self.name, self.number)

    @property
    def flow(self) -> Symbol:
        """The flow as a signal (of a 1-junction, or of an element's bond)."""
        return signal("flow", self.name, self.number)

    @property
    def displacement(self) -> Symbol:
        """The displacement of a compliance as a signal."""
        return signal("displacement", self.name, self.number)

    @property
    def momentum(self) -> Symbol:
        """The momentum of an inertance as a signal."""
        return signal("momentum", self.name, self.number)


At: TypeAlias = Handle | str


@dataclass(frozen=True)
class SubGraph(Generic[_Graph]):
    """A graph used as a part of another; ``ports`` names the inner junctions that outer bonds may reach.

    ``bind`` gives inner inputs and parameters as expressions of the outer graph. The quantities of a ``shared`` part
    keep their own names, so that parts which declare the same one share it.
    """

    name: str
    graph: _Graph
    ports: tuple[tuple[str, str], ...]
    bind: tuple[tuple[str, Expr], ...] = ()
    shared: bool = False


@dataclass(frozen=True)
class ElementType:
    """A kind of element of one's own: its ports, the strokes it allows, and its law, in one place.

    ``forms`` pairs what the element gives at each port, ``"effort"`` or ``"flow"``, with the law in that form: a
    function of what it takes at each port (the other variable), in the same order, that returns one expression per
    port. Each form is one allowed set of strokes; the first is preferred. Own variables count power into the element
    as positive.

    Examples
    --------
    A permanent-magnet motor with its winding resistance: it takes the voltage and the speed and gives the current and
    the torque that brakes the shaft (negative, since it drives), or it takes the current instead of the voltage.

    >>> R, k = sympy.symbols("R k", real=True)
    >>> motor = ElementType({
    ...     ("flow", "effort"): lambda u, omega: ((u - k * omega) / R, -k * (u - k * omega) / R),
    ...     ("effort", "effort"): lambda i, omega: (R * i + k * omega, -k * i),
    ... })
    >>> motor.ports, [given for given, _ in motor.laws()]
    (2, ['1.flow1', '1.effort2', '2.effort1', '2.effort2'])
    """

    forms: Mapping[tuple[str, ...], Callable[..., Any]]

    @property
    def ports(self) -> int:
        """Number of ports."""
        return len(next(iter(self.forms)))

    def laws(self, where: str = "element") -> tuple[tuple[str, Expr], ...]:
        """The laws of all forms as pairs of what is given (``1.flow1``: by the first form, at port 1) and how.

        ``where`` is the graph and the element, for messages.
        """
        pairs: list[tuple[str, Expr]] = []
        for number, (gives, law) in enumerate(self.forms.items(), start=1):
            if not set(gives) <= {"effort", "flow"}:
                raise DeclarationError(
                    f"{where}: form {gives}: a port gives its 'effort' or its 'flow'", where=tuple(gives)
                )
            taken = [
                Symbol(f"{'flow' if given == 'effort' else 'effort'}{port}", real=True)
                for port, given in enumerate(gives, start=1)
            ]
            values = _values(law, taken, gives, where)
            if len(values) != len(gives):
                raise DeclarationError(
                    f"{where}: form {gives}: the law returns {len(values)} value(s) for {len(gives)} port(s) - return "
                    "one for each, in their order",
                    where=(where.rpartition(": ")[2],),
                )
            names = [f"{number}.{given}{port}" for port, given in enumerate(gives, start=1)]
            pairs += zip(names, (as_expression(value, where, law) for value in values), strict=True)
        return tuple(pairs)


def _values(law: Callable[..., Any], taken: Sequence[Symbol], gives: tuple[str, ...], where: str) -> tuple[Any, ...]:
    """What the law of a form returns, one value per port."""
    values = call_law(law, taken, where)
    if not isinstance(values, list | tuple | sympy.Tuple):
        as_expression(values, where, law)
        values = (values,)
    return tuple(values)
