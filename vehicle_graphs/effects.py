"""Effects of vehicles, by the name that they had before they moved to :mod:`bondgraph.effects`."""

from bondgraph.effects.actuators import actuator_lag as actuator_lag
from bondgraph.effects.actuators import actuator_scale as actuator_scale
from bondgraph.effects.friction import coulomb_loss as coulomb_loss
from bondgraph.effects.friction import quadratic_loss as quadratic_loss
from bondgraph.effects.friction import rolling_speed_loss as rolling_speed_loss
from bondgraph.effects.friction import stribeck_loss as stribeck_loss
from bondgraph.effects.friction import viscous_loss as viscous_loss
from bondgraph.effects.friction import warm_up_loss as warm_up_loss
from bondgraph.effects.gaps import backlash as backlash
from bondgraph.effects.hysteresis import hysteresis_loss as hysteresis_loss
from bondgraph.effects.loads import constant_effort as constant_effort
from bondgraph.effects.loads import headwind as headwind
from bondgraph.effects.losses import centrifugal_tension as centrifugal_tension
from bondgraph.effects.losses import creep as creep
from bondgraph.effects.losses import directional_loss as directional_loss
from bondgraph.effects.losses import slip as slip
from bondgraph.effects.losses import torque_proportional_loss as torque_proportional_loss
from bondgraph.effects.storages import added_compliance as added_compliance
from bondgraph.effects.storages import added_inertia as added_inertia
