"""BMW i3 on the road: electric motor, one gear, car; given the motor torque, the acceleration is to be explained.

``start`` is inertia and rolling resistance. The car's own accelerometer reads dv/dt + g sin(grade), that is, the
force of wheels and air on the body per mass: the missing force follows from it without knowing the road, and mass
times its error is the force error. The brake pedal is not in the data. The functions with the signature of an effect
are candidates of their own for ``bondgraph close-loop``; ``corrected`` is the graph with what the training trips
asked for.

Sources: M. Steinstraeter, J. Buberger, D. Trifonov (2020), *Battery and Heating Data in Real Driving Cycles*, IEEE
DataPort, doi 10.21227/6jr9-5235, for the trips; the maker's data sheet of the i3 (60 Ah) for gear ratio, tyre and mass.
"""

from __future__ import annotations

from collections.abc import Sequence

from sympy import Expr, tanh

from bondgraph import effects
from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.editing import with_values
from bondgraph.declare.effect import Effect, Place, Scale
from bondgraph.declare.functions import maximum
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from vehicle_graphs.named_effects import Extension, acting_at, with_effects

#: Curb mass of the data sheet (1195 kg) and two persons or one with luggage.
MASS = 1345.0
GRAVITY = 9.81
#: Force and speed that scale the bounds of added effects: hard acceleration, a country road.
SCALE = Scale(4000.0, 28.0)
#: Temperature at which the rolling resistance is declared.
REFERENCE_TEMPERATURE = 293.15

#: Accelerator from which on no foot is on the brake.
PRESSED = 0.01

#: What the training trips asked for, in the order in which they did; ``i3_chain`` finds it.
CHOSEN = ("air_drag", "cold_rolling", "gear_loss")
#: The parameters that it then estimates; the mass has the rotating parts and what the accelerometer reads too little.
ESTIMATED = {
    "mass": 1547.6, "rolling_coefficient": 0.010999, "c_quadratic_loss_body": 0.32125, "c_cold_rolling_hub": 4.5095,
    "share_torque_proportional_loss_hub": 0.064376,
}  # fmt: skip
#: Those of ``start``.
ESTIMATED_AT_START = {"mass": 1600.0, "rolling_coefficient": 0.02082}


def start() -> BondGraph:
    """Inertia and rolling resistance behind motor, gear and tyre.

    Examples
    --------
    >>> [parameter.name for parameter in start().parameters if parameter.bounds]
    ['mass', 'rolling_coefficient']
    """
    g = BondGraph("i3", doc=__doc__, source="vehicle_graphs/i3.py")
    torque = g.input("motor_torque", "N m", "torque of the electric motor, negative when it recuperates")
    g.input("sin_grade", "1", "sine of the road's inclination from the map, uphill positive", default=0.0)
    g.input("ambient", "K", "temperature outside", default=REFERENCE_TEMPERATURE)
    g.input("pedal", "1", "accelerator, 0 released", default=1.0)

    motor = g.one_junction("motor", ROTATION)
    wheels = g.one_junction("wheels", ROTATION)
    body = g.one_junction("body", TRANSLATION)
    hub = g.one_junction("hub", TRANSLATION)
    ratio = g.parameter("gear_ratio", 9.665, "1", "motor speed over wheel speed, data sheet")
    radius = g.parameter("tyre_radius", 0.345, "m", "rolling radius of 155/70 R19")
    mass = g.parameter("mass", MASS, "kg", "car with people", (1100.0, 1800.0))
    rolling = g.parameter("rolling_coefficient", 0.012, "1", "rolling resistance over weight", (0.004, 0.04))
    gravity = g.parameter("gravity", GRAVITY, "m/s^2", "gravity")
    creep = g.parameter("creep_speed", 0.3, "m/s", "speed at which rolling resistance reaches 76 % (smoothing)")
    slope = g.parameter("slope_share", 0.0, "1", "share of the map's inclination that the car felt")

    g.effort_source("machine", torque, at=motor)
    g.transformer("gear", 1 / ratio, motor, wheels)
    g.transformer("tyre", radius, wheels, hub)
    g.resistance("rolling", lambda v: rolling * mass * gravity * tanh(v / creep), at=hub)
    g.bond(hub, body)
    vehicle = g.inertance("vehicle", mass, at=body, state="v_body")
    weight = slope * mass * gravity * symbol("sin_grade")
    g.effort_source("weight", -weight, at=body)

    g.measure_flow("speed", body, "speed of the car")
    bias = g.parameter("accelerometer_bias", 0.0, "m/s^2", "reading at rest on the level: how the sensor is mounted")
    g.measure(
        "acceleration", (vehicle.effort + weight) / mass + bias, "m/s^2", "accelerometer along the car: dv/dt and slope"
    )
    return g


def cold_rolling(g: BondGraph, at: Place) -> Effect | None:
    """Rolling resistance that rises when it is cold: tyres, grease and gear oil."""
    if not _has(g, "ambient") or at.bond is not None or at.junction.name != "hub":
        return None
    name = f"cold_rolling_{at.name}"
    rise = g.parameter(
        f"c_{name}", 0.0, "N/K", f"rolling resistance gained per kelvin below {REFERENCE_TEMPERATURE} K", (-10.0, 10.0)
    )
    warm = g.parameter(f"t_{name}", REFERENCE_TEMPERATURE, "K", "temperature of the declared rolling resistance")
    g.effort_source(name, -rise * (warm - symbol("ambient")) * _forwards(at), at=at.junction)
    return Effect("cold_rolling", name, "effort = c*(T0 - ambient)*tanh(v/w)", (f"c_{name}",))


def cold_air(g: BondGraph, at: Place) -> Effect | None:
    """Air drag that rises with the density of cold air."""
    if not _has(g, "ambient") or at.bond is not None or at.junction.name != "body":
        return None
    name = f"cold_air_{at.name}"
    limit = at.scale.effort / at.scale.flow**2 / 20.0
    rise = g.parameter(f"c_{name}", 0.0, "kg/(m K)", "air drag over speed squared gained per kelvin", (0.0, limit))
    warm = g.parameter(f"t_{name}", REFERENCE_TEMPERATURE, "K", "temperature of the declared air drag")
    speed = at.junction.flow
    # never a drive: above the temperature of the declared drag nothing is gained
    colder = maximum(warm - symbol("ambient"), 0)
    g.effort_source(name, -rise * colder * speed * abs(speed), at=at.junction)
    return Effect("cold_air", name, "effort = c*max(T0 - ambient, 0)*v*|v|", (f"c_{name}",))


def friction_brake(g: BondGraph, at: Place) -> Effect | None:
    """Friction brakes that help when the motor recuperates as much as it may: a force per torque beyond a limit."""
    if not _has(g, "motor_torque") or at.bond is not None or at.junction.name != "hub":
        return None
    name = f"friction_brake_{at.name}"
    gain = g.parameter(f"c_{name}", 0.0, "1/m", "braking force per torque beyond the limit", (0.0, 200.0))
    limit = g.parameter(f"limit_{name}", 45.0, "N m", "recuperation above which the brakes are taken to help")
    g.effort_source(name, -gain * maximum(-symbol("motor_torque") - limit, 0) * _forwards(at), at=at.junction)
    return Effect("friction_brake", name, "effort = c*max(-torque - limit, 0)", (f"c_{name}",))


def released_brake(g: BondGraph, at: Place) -> Effect | None:
    """Friction brakes while the accelerator is released: the driver's foot is then where no sensor of these data is."""
    if not _has(g, "pedal") or at.bond is not None or at.junction.name != "hub":
        return None
    name = f"released_brake_{at.name}"
    force = g.parameter(f"c_{name}", 0.0, "N", "mean braking force", (0.0, at.scale.effort))
    pressed = g.parameter(f"p_{name}", PRESSED, "1", "pedal from which on no foot is on the brake")
    released = maximum(1 - symbol("pedal") / pressed, 0)
    g.effort_source(name, -force * released * _forwards(at), at=at.junction)
    return Effect("released_brake", name, "effort = c*max(1 - pedal/p, 0)", (f"c_{name}",))


def _has(g: BondGraph, name: str) -> bool:
    return any(declared.name == name for declared in g.inputs)


def _forwards(at: Place) -> Expr:
    return tanh(at.junction.flow / symbol("creep_speed"))


#: Effects that may be added, by name, and where.
EFFECTS: dict[str, Extension] = {
    "air_drag": acting_at(effects.quadratic_loss, "body", SCALE),
    "viscous_loss": acting_at(effects.viscous_loss, "hub", SCALE),
    "gear_loss": acting_at(effects.torque_proportional_loss, "hub", SCALE),
    "gear_loss_by_direction": acting_at(effects.directional_loss, "hub", SCALE),
    "rotating_inertia": acting_at(effects.added_inertia, "body", SCALE),
    "friction_towards_standstill": acting_at(effects.stribeck_loss, "hub", SCALE),
    "cold_rolling": acting_at(cold_rolling, "hub", SCALE),
    "cold_air": acting_at(cold_air, "body", SCALE),
    "friction_brake": acting_at(friction_brake, "hub", SCALE),
    "released_brake": acting_at(released_brake, "hub", SCALE),
}


def corrected() -> BondGraph:
    """The car with every effect that the training trips asked for, at the values estimated from them.

    Examples
    --------
    >>> corrected().name
    'i3'
    """
    return with_values(declared(CHOSEN), ESTIMATED)


def declared(names: Sequence[str]) -> BondGraph:
    """The car with the named effects.

    Raises
    ------
    OptionError
        If an effect is not known.

    Examples
    --------
    >>> [parameter.name for parameter in declared(["air_drag"]).parameters][-1]
    'c_quadratic_loss_body'
    """
    return with_effects(start(), EFFECTS, names)
