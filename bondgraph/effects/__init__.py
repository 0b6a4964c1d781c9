"""Effects that a declared machine may lack: each a function that extends a graph at a place.

Every function adds one element, or changes one, with coefficients that are zero when the effect is absent. The signs
are those of a loss: a positive coefficient takes energy out of the machine. A law is called in the words of the domain
in which it acts: ``creep`` is a leakage in a tank and a shunt in a circuit. Where two effects cannot be told apart the
earlier one is preferred. What is imported here is tried where nothing else is said; the modules hold further effects.

friction     what takes an effort: viscous, dry, Stribeck, quadratic, rolling at speed, cold oil
hysteresis   friction that gives way before it slides, as Dahl, as Bouc and Wen, and as LuGre have it; cells
losses       in proportion to the load, by direction, creep, slip, leaks, thresholds, centrifugal belt tension,
             tyres whose force builds up over a length
thermal      heat given away by conduction, convection, radiation; a heat capacity that changes, a change of phase
between      leaks, overflows, friction and fluid couplings between two junctions of one domain; clutches and
             couplings that slip
couplings    springs to the frame and between bodies, coils that share a flux, capacitance between two nodes
loads        constant efforts and flows, headwind, ripple
actuators    wrong scale, lag and delay of sources and ratios, ceiling, dead zone, play, bent map and rate of what
             follows a command; motors whose constant falls with the current, magnets that pull harder as a gap closes
ratios       cranks, universal joints and linkages, whose ratio moves with an angle or a stroke
relaxation   cells that polarise, walls that take up heat slowly, viscoelastic drag, masses on springs
storages     added inertia, capacity, compliance; stops, springs that harden, iron that saturates
vessels      gas, air in oil, tanks that are wider beyond a level
gaps         backlash of a spring, clearance of a coupling
bodies       inertia that changes with a position
lines        inertia of fluid or inductance in a line that has none, capacity of a node that has none
imperfect    resistances on the way into a storage, losses in the iron of a coil
fading       resistances that change with temperature or by what has passed, batteries that fall with their charge
streams      resistances that follow an input, such as the speed of a fan
sensors      faults of sensors, which the loop itself tries beside these
"""

# isort: off
# the order is that of preference
from bondgraph.effects.friction import coulomb_loss as coulomb_loss
from bondgraph.effects.friction import electrode_loss as electrode_loss
from bondgraph.effects.friction import heating_resistance as heating_resistance
from bondgraph.effects.hysteresis import hysteresis_loss as hysteresis_loss
from bondgraph.effects.hysteresis import voltage_hysteresis as voltage_hysteresis
from bondgraph.effects.friction import quadratic_loss as quadratic_loss
from bondgraph.effects.friction import rolling_speed_loss as rolling_speed_loss
from bondgraph.effects.friction import turbulent_loss as turbulent_loss
from bondgraph.effects.friction import eddy_current_drag as eddy_current_drag
from bondgraph.effects.friction import stribeck_loss as stribeck_loss
from bondgraph.effects.friction import viscous_loss as viscous_loss
from bondgraph.effects.friction import direction_dependent_drag as direction_dependent_drag
from bondgraph.effects.friction import warm_up_loss as warm_up_loss
from bondgraph.effects.actuators import actuator_lag as actuator_lag
from bondgraph.effects.actuators import actuator_delay as actuator_delay
from bondgraph.effects.actuators import actuator_scale as actuator_scale
from bondgraph.effects.loads import constant_effort as constant_effort
from bondgraph.effects.loads import constant_flow as constant_flow
from bondgraph.effects.loads import headwind as headwind
from bondgraph.effects.loads import ripple as ripple
from bondgraph.effects.losses import centrifugal_tension as centrifugal_tension
from bondgraph.effects.losses import creep as creep
from bondgraph.effects.losses import directional_loss as directional_loss
from bondgraph.effects.losses import orifice_leak as orifice_leak
from bondgraph.effects.losses import overflow as overflow
from bondgraph.effects.losses import relief as relief
from bondgraph.effects.losses import slip as slip
from bondgraph.effects.losses import torque_proportional_loss as torque_proportional_loss
from bondgraph.effects.thermal import heat_loss as heat_loss
from bondgraph.effects.thermal import convection as convection
from bondgraph.effects.thermal import radiation as radiation
from bondgraph.effects.thermal import varying_heat_capacity as varying_heat_capacity
from bondgraph.effects.thermal import latent_heat as latent_heat
from bondgraph.effects.storages import added_capacity as added_capacity
from bondgraph.effects.vessels import entrained_air as entrained_air
from bondgraph.effects.storages import added_compliance as added_compliance
from bondgraph.effects.storages import added_inertia as added_inertia
from bondgraph.effects.lines import line_inertia as line_inertia
from bondgraph.effects.lines import node_capacity as node_capacity
from bondgraph.effects.bodies import inertia_by_position as inertia_by_position
from bondgraph.effects.gaps import backlash as backlash
from bondgraph.effects.gaps import clearance as clearance
from bondgraph.effects.storages import end_stop as end_stop
from bondgraph.effects.vessels import gas_storage as gas_storage
from bondgraph.effects.vessels import stepped_tank as stepped_tank
from bondgraph.effects.storages import hardening_spring as hardening_spring
from bondgraph.effects.storages import magnetic_saturation as magnetic_saturation
from bondgraph.effects.storages import one_sided_stop as one_sided_stop
from bondgraph.effects.storages import progressive_spring as progressive_spring
from bondgraph.effects.storages import softening_spring as softening_spring
from bondgraph.effects.actuators import ratio_lag as ratio_lag
from bondgraph.effects.actuators import ratio_scale as ratio_scale
from bondgraph.effects.actuators import modulus_fading as modulus_fading
from bondgraph.effects.actuators import armature_reaction as armature_reaction
from bondgraph.effects.actuators import actuator_ceiling as actuator_ceiling
from bondgraph.effects.actuators import actuator_dead_zone as actuator_dead_zone
from bondgraph.effects.actuators import actuator_rate_limit as actuator_rate_limit
from bondgraph.effects.actuators import actuator_play as actuator_play
from bondgraph.effects.ratios import ratio_by_angle as ratio_by_angle
from bondgraph.effects.ratios import crank_ratio as crank_ratio
from bondgraph.effects.ratios import ratio_by_stroke as ratio_by_stroke
from bondgraph.effects.actuators import actuator_exponent as actuator_exponent
from bondgraph.effects.actuators import gap_dependence as gap_dependence
from bondgraph.effects.between import leak_between as leak_between
from bondgraph.effects.between import orifice_between as orifice_between
from bondgraph.effects.between import overflow_onward as overflow_onward
from bondgraph.effects.between import overflow_back as overflow_back
from bondgraph.effects.between import drag_between as drag_between
from bondgraph.effects.between import friction_between as friction_between
from bondgraph.effects.between import fluid_coupling_between as fluid_coupling_between
from bondgraph.effects.between import coupling_slip as coupling_slip
from bondgraph.effects.couplings import return_spring as return_spring
from bondgraph.effects.couplings import spring_between as spring_between
from bondgraph.effects.couplings import mutual_inductance as mutual_inductance
from bondgraph.effects.couplings import capacitance_between as capacitance_between
from bondgraph.effects.imperfect import storage_resistance as storage_resistance
from bondgraph.effects.imperfect import core_loss as core_loss
from bondgraph.effects.thermal import radiation_between as radiation_between
from bondgraph.effects.relaxation import polarisation as polarisation
from bondgraph.effects.relaxation import slow_heat_capacity as slow_heat_capacity
from bondgraph.effects.relaxation import dragged_mass as dragged_mass
from bondgraph.effects.relaxation import sprung_mass as sprung_mass
from bondgraph.effects.relaxation import viscoelastic_drag as viscoelastic_drag
from bondgraph.effects.fading import charge_fading as charge_fading
from bondgraph.effects.fading import temperature_dependence as temperature_dependence
from bondgraph.effects.fading import thermal_activation as thermal_activation
from bondgraph.effects.fading import source_temperature_dependence as source_temperature_dependence
from bondgraph.effects.fading import source_temperature_rise as source_temperature_rise
from bondgraph.effects.fading import clogging as clogging
from bondgraph.effects.exponents import resistance_exponent as resistance_exponent
from bondgraph.effects.exponents import critical_speed as critical_speed
from bondgraph.effects.streams import resistance_by_input as resistance_by_input
from bondgraph.effects.streams import valve_load_flow as valve_load_flow
