"""Elements with modes: dry friction and clutches that lock, impacts that rebound and come to rest.

Each is a resistance that gives its effort and is declared once. Derived smooth (the default) it is an ordinary law, as
filters and gradients need it. Derived exactly (``derive(..., smooth=False)``) it has modes that hold between events: in
the constrained mode its flow stays zero and its effort is whatever that takes, found from the equations themselves
(Karnopp 1985, J. Dyn. Syst. Meas. Control 107(1), without his small region of zero velocity; Asher 1993, Proc. IMechE C
207; Mosterman and Biswas 1998, J. Franklin Inst. 335(8)).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sympy import Expr, exp

from bondgraph.declare.elements import Node
from bondgraph.declare.handles import At, Handle, Law
from bondgraph.declare.laws import apply_law, as_expression
from bondgraph.declare.quantities import symbol
from bondgraph.declare.store import GraphStore
from bondgraph.declare.switching import contact, dry_friction

#: The smooth form of a static capacity has faded to the sliding one within about this many widths.
_FADED = 10


def friction(
    g: GraphStore, name: str, capacity: Law, *, width: Any, static: Any | None = None, at: At | None = None
) -> Handle:
    """Dry friction that locks: a bearing, a brake, a block on a belt, the plates of a clutch.

    Parameters
    ----------
    g
        The graph it is added to.
    name
        Name of the element, an R.
    capacity
        Effort while it slips, positive: an expression, or a function of the flow (a Stribeck curve).
    width
        Flow within which the smooth form changes over: ``capacity*tanh(flow/width)``. The exact form does not use it.
    static
        Effort it can carry while it is locked, where that is more than ``capacity``.
    at
        The junction whose flow it opposes.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("block")
    >>> v = g.one_junction("v", bg.TRANSLATION)
    >>> bg.friction(g, "floor", g.parameter("F_c", 3.0, "N"), width=g.parameter("v_s", 1e-3, "m/s"), at=v).kind
    'R'
    """
    laws = [
        ("capacity", apply_law(capacity, symbol("flow"), where=f"{g.name}: {name}")),
        ("width", as_expression(width, f"{g.name}: {name}")),
    ]
    if static is not None:
        laws.insert(1, ("static", as_expression(static, f"{g.name}: {name}")))
    return _bonded(g, Node(name, "R", laws=tuple(laws)), at)


def clutch(
    g: GraphStore, name: str, capacity: Law, drive: At, load: At, *, width: Any, static: Any | None = None
) -> Handle:
    """A clutch or brake between two 1-junctions: they share its torque, it opposes the difference of their speeds.

    A capacity of zero or below (a pedal pressed) leaves it open. Adds the 0-junction ``<name>_torque``.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("drive")
    >>> engine, shaft = g.one_junction("engine", bg.ROTATION), g.one_junction("shaft", bg.ROTATION)
    >>> width = g.parameter("w", 0.1, "rad/s")
    >>> _ = bg.clutch(g, "plates", g.parameter("grip", 40.0, "N m"), engine, shaft, width=width)
    >>> [str(bond) for bond in g.bonds]
    ['engine -> plates_torque', 'plates_torque -> shaft', 'plates_torque -> plates']
    """
    torque = g.add_node(Node(f"{name}_torque", "0", drive.domain if isinstance(drive, Handle) else None))
    g.bond(drive, torque)
    g.bond(torque, load)
    return friction(g, name, capacity, width=width, static=static, at=torque)


def impact(
    g: GraphStore,
    name: str,
    gap: Any,
    restitution: Any,
    *,
    stiffness: Any,
    width: Any,
    damping: Any = 0,
    at: At | None = None,
) -> Handle:
    """A contact: nothing while the gap is open, a rebound when it closes, rest where the rebounds die away.

    Parameters
    ----------
    g
        The graph it is added to.
    name
        Name of the element, an R.
    gap
        The distance; it widens at the rate of the element's flow (bond the element from the junction of that flow).
    restitution
        Share of the closing speed with which the gap opens again, between 0 and 1 (Newton's hypothesis).
    stiffness, width, damping
        Of the smooth form: a stiff spring and a damper in proportion to the depth (see
        :func:`~bondgraph.declare.switching.contact`), and the depth within which they set in.
    at
        The junction whose flow opens the gap.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("ball")
    >>> v = g.one_junction("v", bg.TRANSLATION)
    >>> height = g.integral("height", v.flow, "m", initial=1.0)
    >>> k, w = g.parameter("k", 1e6, "N/m"), g.parameter("w", 1e-6, "m")
    >>> bg.impact(g, "floor", height, 0.8, stiffness=k, width=w, at=v).kind
    'R'
    """
    laws = {"gap": gap, "restitution": restitution, "stiffness": stiffness, "damping": damping, "width": width}
    return _bonded(
        g, Node(name, "R", laws=tuple((key, as_expression(law, f"{g.name}: {name}")) for key, law in laws.items())), at
    )


def _bonded(g: GraphStore, node: Node, at: At | None) -> Handle:
    handle = g.add_node(node)
    if at is not None:
        g.bond(at, handle)
    return handle


def smooth_effort(laws: Mapping[str, Expr]) -> Expr:
    """The effort of an element with modes as an ordinary law of its flow.

    A static capacity becomes a peak that fades with the flow (Stribeck; Armstrong-Helouvry, Dupont and Canudas de Wit
    1994, Automatica 30(7), with the width of the smooth form in place of the Stribeck speed).

    Examples
    --------
    >>> F, w = symbol("F"), symbol("w")
    >>> smooth_effort({"capacity": F, "width": w})
    F*(2*switch(flow, w) - 1)
    """
    flow, width = symbol("flow"), laws["width"]
    if "gap" in laws:
        return -contact(-laws["gap"], -flow, laws["stiffness"], laws["damping"], width)
    level = laws["capacity"]
    if "static" in laws:
        level += (laws["static"] - level) * exp(-((flow / (_FADED * width)) ** 2))
    return dry_friction(flow, level, width)
