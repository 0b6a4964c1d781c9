"""Effects that measured machines showed beyond the usual losses, tried beside :mod:`bondgraph.effects`."""

from bondgraph.effects.friction import cubic_loss as cubic_loss
from bondgraph.effects.friction import direction_dependent_drag as direction_dependent_drag
from bondgraph.effects.friction import shear_thinning_loss as shear_thinning_loss
from bondgraph.effects.friction import travel_dependent_friction as travel_dependent_friction
from bondgraph.effects.loads import drifting_load as drifting_load
from bondgraph.effects.loads import position_stiffness as position_stiffness
from bondgraph.effects.loads import ripple_cosine as ripple_cosine
from bondgraph.effects.loads import ripple_sine as ripple_sine
from bondgraph.effects.sensors import sensor_magnitude as sensor_magnitude
from bondgraph.effects.sensors import sensor_square as sensor_square
from bondgraph.effects.storages import uncounted_inertia as uncounted_inertia
