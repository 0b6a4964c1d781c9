"""Laws that switch: one-way elements, contacts, end stops, dry friction, junctions that open.

Each is an expression with :class:`~bondgraph.declare.functions.switch` in it. The same declaration is derived smooth
(for filters, gradients, fixed-step integration) or as jumps whose places are listed as events, by one flag of
``derive``; a simulation holds each switch on its side between events. The width is the range of the argument in which
the smooth form changes over; choose it small against the values that matter and large against what one integration
step moves.
"""

from __future__ import annotations

from typing import Any

from sympy import Expr

from bondgraph.declare.expressions import normalise
from bondgraph.declare.functions import switch


def positive_part(value: Any, width: Any) -> Expr:
    """``value`` where it is positive, else zero: a diode, a check valve, a cable, a freewheel.

    Examples
    --------
    >>> import sympy
    >>> positive_part(sympy.Symbol("u"), 0.1)
    u*switch(u, 0.1)
    """
    given = normalise(value)
    return given * switch(given, normalise(width))


def dry_friction(flow: Any, level: Any, width: Any) -> Expr:
    """Coulomb friction of a level that opposes the flow; also the torque of a slipping clutch of that capacity.

    Its smooth form is ``level*tanh(flow/width)``: below the width it creeps instead of sticking. Its exact form jumps
    and cannot stick: what comes to rest is declared by :func:`bondgraph.declare.modal.friction`.

    Examples
    --------
    >>> import sympy
    >>> dry_friction(sympy.Symbol("v"), sympy.Symbol("F_c"), 0.01)
    F_c*(2*switch(v, 0.01) - 1)
    """
    return normalise(level) * (2 * switch(normalise(flow), normalise(width)) - 1)


def end_stop(position: Any, lower: Any, upper: Any, stiffness: Any, width: Any) -> Expr:
    """The force of two stops of a stiffness, zero between them, as a law of a compliance.

    Examples
    --------
    >>> import sympy
    >>> x = sympy.Symbol("x", real=True)
    >>> end_stop(x, -1, 1, 100, 0.01).subs(x, 0).replace(switch, lambda value, _: sympy.Heaviside(value, 0))
    0
    """
    below, above = normalise(lower) - normalise(position), normalise(position) - normalise(upper)
    return normalise(stiffness) * (positive_part(above, width) - positive_part(below, width))


def contact(depth: Any, speed: Any, stiffness: Any, damping: Any, width: Any) -> Expr:
    """The force of a contact that pushes and never pulls, stiffness and damping growing from zero with the depth.

    The damping acts in proportion to the depth, so that the force does not jump when the contact opens or closes (Hunt
    and Crossley 1975, J. Appl. Mech. 42(2)). ``speed`` is the rate of ``depth``; ``damping`` is per depth [N s/m^2].

    Examples
    --------
    >>> import sympy
    >>> x, v = sympy.symbols("x v", real=True)
    >>> contact(x, v, 1000, 5, 0.001)
    x*(5*v + 1000)*switch(x, 0.001)
    """
    return positive_part(depth, width) * (normalise(stiffness) + normalise(damping) * normalise(speed))


def closed(command: Any, width: Any) -> Expr:
    """The modulus of a transformer that passes power only while ``command`` is positive: a switched junction.

    A transformer of this modulus between two junctions joins them or takes them apart without producing power (Asher
    1993, Proc. IMechE C 207). It must be given flow on its source side and effort on its target side, since the other
    way round would divide by zero when open.

    Examples
    --------
    >>> import sympy
    >>> closed(sympy.Symbol("pedal"), 0.05)
    switch(pedal, 0.05)
    """
    return switch(normalise(command), normalise(width))
