"""Tyres: dissipators between the circumference of the wheels and the ground, one law to swap for another.

Every law fills the same part: port ``contact`` (the tyre force; speeds of circumference and ground), inputs ``load``,
``rolling`` (speed of the circumference) and ``ground`` (speed of the contact patch). With the same slip stiffness
``C_k`` and friction ``mu`` they agree for small slip.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from sympy import Abs, Expr, Symbol, atan, sin, tanh

from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.functions import clip, maximum
from bondgraph.declare.graph import BondGraph
from vehicle_graphs.axles import End

#: A tyre law as a part: the end of the vehicle gives its names.
Tyre = Callable[[End], BondGraph]


@dataclass(frozen=True)
class _Contact:
    """A part with what laws of the slip need; ``reference`` is the speed that the slip refers to."""

    g: BondGraph
    load: Symbol
    rolling: Symbol
    ground: Symbol
    mu: Symbol
    C_k: Symbol
    reference: Symbol


def tanh_tyre(end: End) -> BondGraph:
    """The nominal law, ``mu N tanh(C_k kappa/mu)`` of the slip kappa; stiff at standstill.

    Examples
    --------
    >>> [signal.name for signal in tanh_tyre("front").signals]
    ['slip_speed_f', 'F_xf']
    """
    c = _contact(end)
    return _with_law(c.g, end, lambda slip: c.mu * c.load * tanh(c.C_k * slip / c.reference / c.mu))


def slip_velocity_tyre(end: End) -> BondGraph:
    """Force by slip velocity instead of slip, ``mu N tanh(K v_slip/(mu N))``: no stiffness at standstill."""
    g = BondGraph(f"{end}_tyre", doc=__doc__)
    load, mu = _load(g), _friction(g)
    K = g.parameter("K", 2500.0, "N s/m", "tyre force per slip velocity")
    N_low = g.parameter("N_low", 1.0, "N", "load below which the slope of the law stays finite")
    return _with_law(g, end, lambda slip: mu * load * tanh(K * slip / (mu * maximum(load, N_low))))


def brush_tyre(end: End) -> BondGraph:
    """Brush model with a parabolic pressure: Pacejka, *Tire and Vehicle Dynamics* (2012), chapter 3."""
    c = _contact(end)

    def force(slip: Expr) -> Expr:
        sliding = clip(c.C_k * slip / c.reference / (3 * c.mu), -1, 1)  # at one the whole contact slides
        return c.mu * c.load * sliding * (3 - 3 * Abs(sliding) + sliding**2)

    return _with_law(c.g, end, force)


def pacejka_tyre(end: End) -> BondGraph:
    """Magic formula in the longitudinal slip: Pacejka, *Tire and Vehicle Dynamics* (2012), chapter 4."""
    c = _contact(end)
    C_x = c.g.parameter("C_x", 1.65, "1", "shape factor of the magic formula")
    E_x = c.g.parameter("E_x", 0.3, "1", "curvature factor of the magic formula")

    def force(slip: Expr) -> Expr:
        steep = c.C_k * slip / c.reference / (C_x * c.mu)
        return c.mu * c.load * sin(C_x * atan(steep - E_x * (steep - atan(steep))))

    return _with_law(c.g, end, force)


def relaxation_tyre(end: End) -> BondGraph:
    """The nominal law of a slip that builds up over a length: one state per axle, ``tyre_slip_f``, ``tyre_slip_r``.

    First-order relaxation: Pacejka, *Tire and Vehicle Dynamics* (2012), chapter 7.
    """
    c = _contact(end)
    length = c.g.parameter("relaxation_length", 0.3, "m", "distance over which the slip builds up")
    kappa = c.g.integral(
        f"tyre_slip_{end[0]}", lambda slip: (c.rolling - c.ground - c.reference * slip) / length, "1",
        f"slip of the {end} tyres",
    )  # fmt: skip
    return _with_law(c.g, end, lambda _: c.mu * c.load * tanh(c.C_k * kappa / c.mu))


def _contact(end: End) -> _Contact:
    g = BondGraph(f"{end}_tyre", doc=__doc__)
    load = _load(g)
    rolling = g.input("rolling", "m/s", "speed of the tyre's circumference")
    ground = g.input("ground", "m/s", "speed of the contact patch")
    mu = _friction(g)
    C_k = g.parameter("C_k", 10.0, "1", "force over load per slip, small slip")
    v_low = g.parameter("v_low", 1.0, "m/s", "speed below which slip refers to it (standstill)")
    reference = g.signal(
        f"slip_speed_{end[0]}", maximum(maximum(Abs(ground), Abs(rolling)), v_low), "m/s",
        f"speed that the slip of the {end} tyres refers to",
    )  # fmt: skip
    return _Contact(g, load, rolling, ground, mu, C_k, reference)


def _load(g: BondGraph) -> Symbol:
    return g.input("load", "N", "force of the tyres on the ground")


def _friction(g: BondGraph) -> Symbol:
    return g.parameter("mu", 0.65, "1", "friction of tyre on gravel")


def _with_law(g: BondGraph, end: End, law: Callable[[Expr], Expr]) -> BondGraph:
    contact = g.zero_junction("contact", TRANSLATION)
    g.resistance("slip", law, at=contact)
    g.signal(f"F_x{end[0]}", contact.effort, "N", f"longitudinal force of the {end} tyres")
    return g
