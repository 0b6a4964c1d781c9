"""Body of the Ranger on its suspension: forward motion, heave and pitch; or forward motion alone, quasi-static.

Pitch is nose-up positive and relative to the ground. Standard physics of a half car: Gillespie, *Fundamentals of
Vehicle Dynamics* (1992), chapters 1, 4 and 5.
"""

from __future__ import annotations

from dataclasses import dataclass

from sympy import Abs, Expr, Symbol, cos, sin

from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.functions import maximum
from bondgraph.declare.graph import BondGraph, Handle


@dataclass(frozen=True)
class _Frame:
    """Mass, geometry and springs, which both kinds of suspension need."""

    m: Symbol
    g: Symbol
    a: Symbol
    b: Symbol
    r_z: Symbol
    k_f: Expr
    k_r: Expr
    slope: Symbol


def chassis() -> BondGraph:
    """Body on springs and dampers: port ``ground`` (speed of the contact patches), input ``slope``.

    Both springs are one storage over heave and pitch, which are its displacements; the struts' dampers join the two
    motions. Signals: suspension forces ``S_f`` and ``S_r``, loads of the tyres ``N_f`` and ``N_r``.

    Examples
    --------
    >>> [signal.name for signal in chassis().signals]
    ['N_f0', 'N_r0', 'S_f', 'S_r', 'N_f', 'N_r']
    """
    g = BondGraph("chassis", doc=__doc__)
    frame = _frame(g)
    inertia = g.parameter("I", 1093.0, "kg m^2", "inertia of the body in pitch")
    g.require(inertia, "a body without positive inertia does not obey a moment")
    c_f = g.parameter("c_f", 3000.0, "N s/m", "front dampers")
    c_r = g.parameter("c_r", 5200.0, "N s/m", "rear dampers")

    ground = g.one_junction("ground", TRANSLATION)
    thrust = g.zero_junction("thrust", TRANSLATION)
    forward = _forward(g, frame)
    heave = g.one_junction("bounce", TRANSLATION)
    pitch = g.one_junction("tilt", ROTATION)
    g.bond(ground, thrust)
    g.bond(thrust, forward)
    g.transformer("lever", 1 / frame.r_z, thrust, pitch)

    g.inertance("bounce_mass", frame.m, at=heave, state="heave_rate")
    g.effort_source("weight", -frame.m * frame.g * cos(frame.slope), at=heave)
    g.inertance("tilt_inertia", inertia, at=pitch, state="pitch_rate")
    front, rear = _static_loads(g, frame)

    def energy(z: Expr, th: Expr) -> Expr:
        """Of both springs, preloaded with the weight."""
        compressed_front = front - frame.k_f * (z + frame.a * th)
        compressed_rear = rear - frame.k_r * (z - frame.b * th)
        return compressed_front**2 / (2 * frame.k_f) + compressed_rear**2 / (2 * frame.k_r)

    springs = g.field("C", "springs", energy=energy, at=(heave, pitch), state=("heave", "pitch"))
    front_damper = _strut(g, "front", heave, pitch, frame.a, c_f)
    rear_damper = _strut(g, "rear", heave, pitch, -frame.b, c_r)
    z, th = springs.port(1).displacement, springs.port(2).displacement
    S_f = front - frame.k_f * (z + frame.a * th) - front_damper.effort
    S_r = rear - frame.k_r * (z - frame.b * th) - rear_damper.effort
    _loads(g, S_f, S_r)
    return g


def quasi_static_chassis() -> BondGraph:
    """Body whose suspension follows the forces at once, as in the source thesis; it biases what is estimated.

    Loads are those of the static balance of moments; ``pitch`` is the moment over the stiffness of both springs.

    Examples
    --------
    >>> [signal.name for signal in quasi_static_chassis().signals]
    ['N_f', 'N_r', 'S_f', 'S_r', 'pitch']
    """
    g = BondGraph("quasi_static_chassis", doc=__doc__)
    thrust = g.input("thrust", "N", "force of all tyres along the ground")
    frame = _frame(g)
    ground = g.one_junction("ground", TRANSLATION)
    g.bond(ground, _forward(g, frame))
    wheelbase = frame.a + frame.b
    normal = frame.m * frame.g * cos(frame.slope)
    # friction is too low to lift an axle, so what the suspension carries presses on the ground
    front = g.signal("N_f", (frame.b * normal - frame.r_z * thrust) / wheelbase, "N", "load of the front tyres")
    rear = g.signal("N_r", (frame.a * normal + frame.r_z * thrust) / wheelbase, "N", "load of the rear tyres")
    g.signal("S_f", front, "N", "force of the front suspension")
    g.signal("S_r", rear, "N", "force of the rear suspension")
    stiffness = frame.a**2 * frame.k_f + frame.b**2 * frame.k_r
    g.signal("pitch", thrust * frame.r_z / stiffness, "rad", "pitch of the body relative to the ground")
    return g


def _frame(g: BondGraph) -> _Frame:
    slope = g.input("slope", "rad", "inclination of the ground, uphill positive", default=0.0)
    m = g.parameter("m", 1200.0, "kg", "vehicle 1040 kg with a payload of 160 kg")
    g.require(m, "a body without positive mass does not obey a force")
    gravity = g.parameter("g", 9.81, "m/s^2", "gravity")
    a = g.parameter("a", 1.26, "m", "centre of mass to the front axle")
    b = g.parameter("b", 0.79, "m", "centre of mass to the rear axle")
    r_z = g.parameter("r_z", 0.60, "m", "height of the centre of mass over the ground")
    for distance, end in ((a, "front"), (b, "rear")):
        g.require(distance, f"the centre of mass lies between the axles, or the {end} springs carry no weight")
    gain = g.parameter("spring_gain", 1.0, "1", "spring rates relative to k_f and k_r: the pitch stiffness", (0.6, 1.5))
    k_f = g.parameter("k_f", 41e3, "N/m", "front springs")
    k_r = g.parameter("k_r", 75e3, "N/m", "rear springs")
    for rate in (k_f, k_r):
        g.require(rate, "a spring without positive rate does not carry the body")
    return _Frame(m, gravity, a, b, r_z, gain * k_f, gain * k_r, slope)


def _forward(g: BondGraph, frame: _Frame) -> Handle:
    """Forward motion against air drag and gravity."""
    forward = g.one_junction("forward", TRANSLATION)
    rho = g.parameter("rho", 1.225, "kg/m^3", "air density")
    CdA = g.parameter("CdA", 1.4, "m^2", "drag coefficient times frontal area", (0.6, 2.4))
    g.inertance("mass", frame.m, at=forward, state="forward_velocity")
    g.resistance("air", lambda v: rho * CdA / 2 * v * Abs(v), at=forward)
    g.effort_source("gravity", -frame.m * frame.g * sin(frame.slope), at=forward)
    return forward


def _static_loads(g: BondGraph, frame: _Frame) -> tuple[Symbol, Symbol]:
    weight = frame.m * frame.g / (frame.a + frame.b)
    front = g.signal("N_f0", weight * frame.b, "N", "static load of the front springs")
    return front, g.signal("N_r0", weight * frame.a, "N", "static load of the rear springs")


def _strut(g: BondGraph, end: str, heave: Handle, pitch: Handle, arm: Expr, damping: Expr) -> Handle:
    """Damper of one axle: the heave of its end is that of the body and its pitch times the arm."""
    strut = g.zero_junction(f"{end}_strut", TRANSLATION)
    g.bond(heave, strut)
    g.transformer(f"{end}_arm", arm, pitch, strut)
    return g.resistance(f"{end}_damper", damping, at=strut)


def _loads(g: BondGraph, front: Expr, rear: Expr) -> None:
    S_f = g.signal("S_f", front, "N", "force of the front suspension")
    S_r = g.signal("S_r", rear, "N", "force of the rear suspension")
    g.signal("N_f", maximum(S_f, 0), "N", "load of the front tyres")
    g.signal("N_r", maximum(S_r, 0), "N", "load of the rear tyres")
