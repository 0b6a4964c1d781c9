"""Terps Racing TR24 Baja car: full-throttle launch through a flyweight rubber-belt CVT (Gaged GX9).

Engine from its torque table, flyweight primary with its ramp, torque-sensing secondary with helix, belt of fixed length
that may slip, gear reduction, wheels, vehicle. ``launch`` is given nothing but the throttle; ``launch_given_engine`` is
given the measured engine speed and carries the engine's power to the wheels, ``launch_with_engine_inertia`` less what
spins the engine up; ``corrected`` has what the training launches asked for (``baja_chain`` repeats the choice).

Parameters: Terps Racing, University of Maryland, https://github.com/shua5115/Terps-Racing-Baja-Simulator, commit
d2b059c (``src/trb.cpp``, ``include/trb.hpp``; MIT, copyright 2024 Yehoshua Halle). A comment marks what it lacks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from sympy import Expr, tan, tanh

from bondgraph import effects
from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.editing import with_values
from bondgraph.declare.effect import Scale
from bondgraph.declare.functions import TableFunction, clip, maximum, minimum
from bondgraph.declare.graph import BondGraph, Handle
from vehicle_graphs import machine_effects
from vehicle_graphs.cvt import BeltRadii, belt_radii, belt_traction, flyweights, torque_feedback_gain
from vehicle_graphs.cvt_geometry import BeltGeometry, FlyweightRamp, rounded, secondary_radius
from vehicle_graphs.named_effects import Extension, acting_at, with_effects

RPM = math.pi / 30

#: Kohler CH440 at full throttle with its governor at 3800 rpm: crankshaft speed [rpm], torque [N m].
ENGINE_TORQUE = (
    (0, 25.4), (1800, 25.4), (2000, 25.8), (2200, 26.4), (2400, 26.8), (2600, 26.7), (2800, 26.6), (3000, 26.4),
    (3200, 25.7), (3400, 24.8), (3600, 23.9), (3800, 0.0),
)  # fmt: skip

#: Engine and primary clutch [kg m^2].
ENGINE_INERTIA = 0.0327756 + 0.0116147

#: What the training launches asked for, in the order in which they did; ``baja_chain`` finds it.
CHOSEN = ("engine_quadratic_drag", "engine_inertia", "engine_load")
#: The parameters that it then estimates. Load and drag together take 1.5 N m off the losses at 2500 rpm and add 7.6 N m
#: at 3600 rpm: torque beyond a table that falls too late towards the governor. The rolling force rests on its bound.
ESTIMATED = {
    "rolling_force": 200.0, "c_quadratic_loss_engine": 1.2392e-4, "inertia_uncounted_inertia_engine": 0.062423,
    "load_constant_effort_engine": -10.0354,
}  # fmt: skip

_POWER_BALANCE = """Terps TR24 Baja car: the engine's power carried to the wheels at the measured engine speed."""

SHEAVE_ANGLE = math.radians(12.5)
SHEAVE_TRAVEL = 0.010
#: The belt pulls at 38.25 % of its height of 14.5 mm above the bottom of the groove.
PRIMARY_RADIUS = 0.01905 + 0.3825 * 0.0145

BELT = BeltGeometry(
    centre_distance=0.23114,
    belt_length=0.8636,
    smallest_primary=PRIMARY_RADIUS,
    largest_primary=PRIMARY_RADIUS + 1.1 * SHEAVE_TRAVEL / math.tan(SHEAVE_ANGLE),
)

#: Ramp height in mm: 17.5 - 0.205 z up to z = 5 mm, then 20.25 - 0.805 z + 0.01 z^2; here in m.
RAMP = FlyweightRamp(
    pivot_radius=0.04187742519,
    arm_length=0.03302,
    roller_radius=0.00635,
    cage_radius=0.06523137756,
    offset=0.0378775,
    corner=0.005,
    straight=(0.0175, -0.205),
    curved=(0.02025, -0.805, 10.0),
)


def launch() -> BondGraph:
    """The whole car from the throttle: three states, engine speed, sheave travel and wheel speed.

    Examples
    --------
    >>> [parameter.name for parameter in launch().parameters if parameter.bounds]
    ['belt_clearance', 'shift_damping', 'helix_torque_share', 'traction', 'rolling_force']
    """
    g = BondGraph("baja_launch", doc=__doc__, source="vehicle_graphs/baja.py")
    throttle = g.input("throttle", "1", "throttle opening, 0 idle (no net torque) to 1 full", default=1.0)

    # 1-junctions share a flow (one speed); the belt is a 0-junction: one belt force, two speeds and their slip
    engine = g.one_junction("engine", ROTATION)
    belt = g.zero_junction("belt", TRANSLATION)
    secondary = g.one_junction("secondary", ROTATION)
    shift = g.one_junction("shift", TRANSLATION)
    secondary_sheave = g.one_junction("secondary_sheave", TRANSLATION)

    _engine(g, engine, throttle)
    sheave_angle = g.parameter("sheave_angle", SHEAVE_ANGLE, "rad", "half of the groove angle")
    travel, spring_force, belt_travel = _primary_sheave(g, shift)
    mass = g.parameter("flyweight_mass", 0.536, "kg", "flyweights, all together (tune)")
    weight_force = flyweights(g, "flyweights", RAMP, crank=engine, shift=shift, mass=mass, travel=travel, largest=0.018)
    contact, clamp = _engagement(g, weight_force - spring_force, belt_travel)
    smallest = g.parameter("primary_radius_rest", PRIMARY_RADIUS, "m", "primary radius at the lowest ratio")
    primary_radius = g.signal(
        "primary_radius", smallest + maximum(belt_travel, 0) / tan(sheave_angle), "m", "effective radius of the primary"
    )
    radii = belt_radii(g, BELT, primary_radius, sheave_angle)
    # a belt of fixed length: what the primary gains the secondary must yield, once the sheave touches the belt
    g.modulated_transformer("belt_length", radii.wrap_ratio * contact, shift, secondary_sheave)
    springs, gain = _secondary_sheave(g, secondary_sheave, belt, radii)

    g.modulated_transformer("primary_pulley", primary_radius, engine, belt)
    traction = g.parameter("traction", 0.85, "1", "friction of belt on sheave", (0.2, 1.2))
    # Not in the source, an assumption: large enough that fixed steps of a millisecond resolve the gripping belt; it
    # makes the belt creep by some per cent under load.
    slip_speed = g.parameter("slip_speed", 2.0, "m/s", "slip at which the belt carries 76 % of what it can")
    belt_traction(
        g, "belt_slip", at=belt, primary_clamp=clamp, secondary_clamp=springs, feedback_gain=gain,
        traction=traction, sheave_angle=sheave_angle, slip_speed=slip_speed,
    )  # fmt: skip
    g.modulated_transformer("secondary_pulley", 1 / radii.secondary, belt, secondary)
    wheels = _driveline(g, secondary)

    g.measure_flow("engine_speed", engine, "crankshaft speed")
    g.measure_flow("wheel_speed", wheels, "speed of the driven wheels")
    return g


def launch_given_engine() -> BondGraph:
    """Terps TR24 Baja car, its engine's power carried to the wheels at the measured engine speed: one state.

    A quasi-static power balance: the belt passes the torque of the table in whatever ratio the two speeds have, or
    slips where that is lower than the lowest ratio of the pulleys. Nothing about clutches or shifting enters.

    Examples
    --------
    >>> [signal.name for signal in launch_given_engine().inputs]
    ['throttle', 'engine_speed']
    """
    g = BondGraph("baja_launch_given_engine", doc=_POWER_BALANCE, source="vehicle_graphs/baja.py")
    throttle = g.input("throttle", "1", "throttle opening, 0 idle (no net torque) to 1 full", default=1.0)
    engine_speed = g.input("engine_speed", "rad/s", "measured crankshaft speed", default=2040 * RPM)

    engine = g.one_junction("engine", ROTATION)
    belt = g.zero_junction("belt", ROTATION)
    secondary = g.one_junction("secondary", ROTATION)

    (lowest,) = rounded(secondary_radius(BELT, PRIMARY_RADIUS) / PRIMARY_RADIUS)
    lowest_ratio = g.parameter("lowest_ratio", lowest, "1", "secondary over primary radius with the sheaves open")
    torque = _torque_table(g)
    g.effort_source("combustion", throttle * torque(engine_speed), at=engine)
    g.bond(engine, belt)
    slip = maximum(engine_speed - lowest_ratio * secondary.flow, 0)
    g.flow_source("belt_slip", -slip, at=belt)
    slowest = g.parameter("slowest_engine", 1000 * RPM, "rad/s", "engine speed below which a reading is not believed")
    speed_ratio = secondary.flow / maximum(engine_speed, slowest)
    g.modulated_transformer("variator", maximum(speed_ratio, 1 / lowest_ratio), belt, secondary)
    wheels = _driveline(g, secondary)

    g.measure_flow("wheel_speed", wheels, "speed of the driven wheels")
    return g


def launch_with_engine_inertia() -> BondGraph:
    """The power balance of ``launch_given_engine``, less what spins engine and primary up.

    Their speed is an input here, so that their inertia takes a torque by the slope of that input: no further state.

    Examples
    --------
    >>> [parameter.name for parameter in launch_with_engine_inertia().parameters][-1]
    'engine_inertia'
    """
    g = launch_given_engine()
    inertia = g.parameter("engine_inertia", ENGINE_INERTIA, "kg m^2", "engine and primary clutch")
    g.inertance("crankshaft", inertia, at="engine")
    return g


#: Torque and speed of the engine at full power, and force and speed of the car: they scale the bounds of added effects.
ENGINE_SCALE, BODY_SCALE = Scale(26.0, 380.0), Scale(2700.0, 19.0)


#: Effects that may be added to ``launch_given_engine``, by name, and where.
EFFECTS: dict[str, Extension] = {
    "engine_inertia": acting_at(machine_effects.uncounted_inertia, "engine", ENGINE_SCALE),
    "engine_load": acting_at(effects.constant_effort, "engine", ENGINE_SCALE),
    "engine_drag": acting_at(effects.viscous_loss, "engine", ENGINE_SCALE),
    "engine_quadratic_drag": acting_at(effects.quadratic_loss, "engine", ENGINE_SCALE),
    "engine_cubic_drag": acting_at(machine_effects.cubic_loss, "engine", ENGINE_SCALE),
    "belt_loss": acting_at(effects.torque_proportional_loss, "engine", ENGINE_SCALE),
    "payload": acting_at(effects.added_inertia, "body", BODY_SCALE),
    "viscous_rolling": acting_at(effects.viscous_loss, "body", BODY_SCALE),
    "air_drag": acting_at(effects.quadratic_loss, "body", BODY_SCALE),
}


def corrected() -> BondGraph:
    """The power balance with every effect that the training launches asked for, at the values estimated from them.

    Examples
    --------
    >>> corrected().name
    'baja_launch_given_engine'
    """
    return with_values(declared(CHOSEN), ESTIMATED)


def declared(names: Sequence[str]) -> BondGraph:
    """The power balance of ``launch_given_engine`` with the named effects.

    Raises
    ------
    OptionError
        If an effect is not known.

    Examples
    --------
    >>> [parameter.name for parameter in declared(["engine_drag"]).parameters][-1]
    'c_viscous_loss_engine'
    """
    return with_effects(launch_given_engine(), EFFECTS, names)


def _torque_table(g: BondGraph) -> type[TableFunction]:
    speed, torque = np.array(ENGINE_TORQUE, dtype=float).T
    return g.table(
        "engine_torque", (speed * RPM).tolist(), torque.tolist(), "N m", "rad/s", meaning="torque at full throttle"
    )


def _engine(g: BondGraph, engine: Handle, throttle: Expr) -> None:
    inertia = g.parameter("engine_inertia", ENGINE_INERTIA, "kg m^2", "engine and primary clutch")
    torque = _torque_table(g)
    g.inertance("crankshaft", inertia, at=engine, initial=2040 * RPM, state="omega_engine")
    g.effort_source("combustion", throttle * torque(engine.flow), at=engine)


def _primary_sheave(g: BondGraph, shift: Handle) -> tuple[Expr, Expr, Expr]:
    """The sheave with spring, stops and damping; returns its travel, its spring's force and the travel of the belt."""
    rate = g.parameter("primary_spring_rate", 10507.6, "N/m", "pressure spring of the primary (tune)")
    preload = g.parameter("primary_spring_preload", 0.028575, "m", "compression of that spring when open")
    # Not in the source, an assumption that the measured launches suggested: without play the flat start of the ramp
    # presses too little to pull away as they do. The value is the middle of where the ramp steepens (1.4 to 3.8 mm).
    clearance = g.parameter("belt_clearance", 0.0025, "m", "sheave travel until it touches the belt", (0.0, 0.006))
    longest = g.parameter("longest_travel", SHEAVE_TRAVEL, "m", "travel of sheave and belt from touching to the stop")
    stop = g.parameter("stop_stiffness", 1e6, "N/m", "stiffness of the end stops")
    damping = g.parameter("shift_damping", 4000.0, "N s/m", "resistance to shifting: belt, bushings", (2e3, 2e4))

    def effort(x: Expr) -> Expr:
        return rate * (preload + x) - stop * maximum(-x, 0) + stop * maximum(x - clearance - longest, 0)

    sheave = g.compliance("primary_spring", effort, at=shift, state="x_sheave")
    g.resistance("shift_friction", damping, at=shift)
    belt_travel = g.signal("belt_travel", sheave.displacement - clearance, "m", "sheave travel since it met the belt")
    return sheave.displacement, rate * (preload + sheave.displacement), belt_travel


def _engagement(g: BondGraph, force: Expr, belt_travel: Expr) -> tuple[Expr, Expr]:
    """How far the sheave bears on the belt (0 to 1), and the axial force with which the primary clamps it."""
    edge = g.parameter("belt_edge", 0.001, "m", "travel over which the edges of the belt take up the load")
    contact = g.signal("contact", clip(1 + belt_travel / edge, 0, 1), "1", "share of the axial load on the belt")
    # The belt rests on the hub until the primary outweighs the secondary; what clamps it is what the primary presses,
    # from the first touch on.
    clamp = g.signal("primary_clamp", maximum(force, 0) * minimum(5 * contact, 1), "N", "clamp force of the primary")
    return contact, clamp


def _secondary_sheave(g: BondGraph, sheave: Handle, belt: Handle, radii: BeltRadii) -> tuple[Expr, Expr]:
    """Springs and helix of the secondary; returns the force of the springs and the torque feedback per belt force."""
    rate = g.parameter("secondary_spring_rate", 2565.6, "N/m", "compression spring of the secondary (tune)")
    preload = g.parameter("secondary_spring_preload", 0.029845, "m", "compression of that spring at the lowest ratio")
    torsion = g.parameter("torsion_spring_rate", 3.8323, "N m/rad", "torsion spring of the secondary (tune)")
    twist = g.parameter("torsion_spring_pretension", math.radians(60), "rad", "twist at the lowest ratio (tune)")
    angle = g.parameter("helix_angle", math.radians(38), "rad", "helix against the plane of rotation (tune)")
    radius = g.parameter("helix_radius", 0.0460375, "m", "radius of the helix")
    share = g.parameter(
        "helix_torque_share", 0.5, "1", "share of the belt's torque felt by the helix, half if both sheaves grip alike",
        (0.4, 1.5),
    )  # fmt: skip
    lead = radius * tan(angle)
    springs = g.signal(
        "secondary_spring_force",
        rate * (preload + radii.opening) + torsion * (twist + radii.opening / lead) / lead,
        "N",
        "axial force of both springs of the secondary",
    )
    gain = g.signal(
        "feedback_gain", torque_feedback_gain(share, radii.secondary, radius, angle), "1", "helix force per belt force"
    )
    # Both depend on the position of the belt, which is a state already: no storages of their own.
    g.effort_source("secondary_springs", -springs, at=sheave)
    g.effort_source("helix", -gain * maximum(belt.effort, 0), at=sheave)
    return springs, gain


def _driveline(g: BondGraph, secondary: Handle) -> Handle:
    """Reduction, wheels and vehicle behind the secondary; returns the junction of the wheels."""
    wheels = g.one_junction("wheels", ROTATION)
    body = g.one_junction("body", TRANSLATION)
    reduction = g.parameter("gear_reduction", 8.32, "1", "secondary speed over wheel speed")
    tyre_radius = g.parameter("tyre_radius", 0.3175, "m", "tyre radius")
    g.transformer("reduction", 1 / reduction, secondary, wheels)
    g.transformer("tyre", tyre_radius, wheels, body)

    J_wheels = g.parameter("J_wheels", 0.98534, "kg m^2", "four wheels")
    J_secondary = g.parameter("J_secondary", 0.00485413, "kg m^2", "secondary clutch")
    m_vehicle = g.parameter("m_vehicle", 226.8, "kg", "car with driver (500 lb)")
    # rigidly geared: one state, and the causality assignment makes the other two dependent
    g.inertance("wheel_inertia", J_wheels, at=wheels, state="omega_wheel")
    g.inertance("secondary_inertia", J_secondary, at=secondary)
    g.inertance("vehicle_mass", m_vehicle, at=body)

    rolling = g.parameter("rolling_force", 44.48, "N", "rolling resistance (10 lbf)", (20.0, 200.0))
    creep = g.parameter("creep_speed", 0.05, "m/s", "speed at which rolling resistance reaches 76 % (smoothing)")
    drag_area = g.parameter("drag_area", 0.546, "m^2", "drag coefficient times frontal area")
    rho = g.parameter("air_density", 1.225, "kg/m^3", "air density")
    g.resistance("rolling", lambda v: rolling * tanh(v / creep), at=body)
    g.resistance("aero", lambda v: rho * drag_area / 2 * v * abs(v), at=body)
    return wheels
