"""Effects that a declared machine may lack: each a function that extends a graph at a place.

Every function adds one element, or changes one, with coefficients that are zero when the effect is absent. The signs
are those of a loss: a positive coefficient takes energy out of the machine. Where two effects cannot be told apart the
earlier one is preferred. Faults of sensors are tried beside these by the loop itself.

friction     viscous, dry, Stribeck, quadratic, rolling at speed, cold oil, hysteresis
losses       in proportion to the load, by direction, creep, slip, centrifugal belt tension
loads        constant (grade, mounting), headwind, wrong scale or lag of an actuator
storages     added inertia, compliance, backlash
"""

from vehicle_graphs.effects.friction import (
    coulomb_loss,
    hysteresis_loss,
    quadratic_loss,
    rolling_speed_loss,
    stribeck_loss,
    viscous_loss,
    warm_up_loss,
)
from vehicle_graphs.effects.loads import actuator_lag, actuator_scale, constant_effort, headwind
from vehicle_graphs.effects.losses import centrifugal_tension, creep, directional_loss, slip, torque_proportional_loss
from vehicle_graphs.effects.storages import added_compliance, added_inertia, backlash

__all__ = [
    "actuator_lag",
    "actuator_scale",
    "added_compliance",
    "added_inertia",
    "backlash",
    "centrifugal_tension",
    "constant_effort",
    "coulomb_loss",
    "creep",
    "directional_loss",
    "headwind",
    "hysteresis_loss",
    "quadratic_loss",
    "rolling_speed_loss",
    "slip",
    "stribeck_loss",
    "torque_proportional_loss",
    "viscous_loss",
    "warm_up_loss",
]
