# Generated from vehicle_graphs/driveline.py -- do not edit.
# Regenerate with:  bondgraph generate vehicle_graphs.driveline:driveline
# Generator: bondgraph 0.2.0.dev0, sympy 1.14.0.  Equations: 682eaa708fee6d1c
"""A driveline on a test bench: engine torque through a slipping belt and an elastic half-shaft to a vehicle.

States x:
      0  omega_primary  [rad/s]  flow of crankshaft
      1  omega_axle     [rad/s]  flow of axle_inertia
      2  twist_shaft    [rad]  displacement of half_shaft
      3  v_body         [m/s]  flow of vehicle

Inputs u:
      0  engine_torque  [N m]  torque of the engine, from its map
      1  grade          [1]  sine of the road's inclination, uphill positive

Parameters theta:
      0  J_primary  [kg m^2]  engine and primary sheave, from drawings
      1  c_engine   [N m s]  drag of the engine
      2  ratio      [1]  engine speed over axle speed, belt gripping
      3  tau_grip   [N m]  torque that the belt can carry
      4  w_slip     [rad/s]  slip speed at which the belt pulls 76 % of that
      5  J_axle     [kg m^2]  secondary sheave, gears and brake discs
      6  k_shaft    [N m/rad]  stiffness of the half-shaft
      7  d_shaft    [N m s/rad]  damping of the half-shaft
      8  r_tyre     [m]  dynamic tyre radius, measured
      9  m_vehicle  [kg]  vehicle with driver, weighed
     10  F_roll     [N]  rolling resistance
     11  v_roll     [m/s]  speed at which rolling resistance reaches 76 %
     12  c_aero     [kg/m]  air drag over speed squared, from a wind tunnel
     13  gravity    [m/s^2]  gravity

Outputs y:
      0  engine_speed  [rad/s]  crankshaft speed
      1  axle_speed    [rad/s]  axle speed
      2  shaft_torque  [N m]  torque in the half-shaft (strain gauge)
      3  speed         [m/s]  vehicle speed
"""
import numpy as np

NAME = "driveline"
FORMAT = "bondgraph-module/1"
# name, unit, initial value, meaning
STATES = (
    ("omega_primary", "rad/s", 120.0, "flow of crankshaft"),
    ("omega_axle", "rad/s", 20.0, "flow of axle_inertia"),
    ("twist_shaft", "rad", 0.0, "displacement of half_shaft"),
    ("v_body", "m/s", 6.0, "flow of vehicle"),
)
# name, unit, default, between samples ("linear" or "hold"), letters of a text signal, meaning
INPUTS = (
    ("engine_torque", "N m", 0.0, "linear", None, "torque of the engine, from its map"),
    ("grade", "1", 0.0, "linear", None, "sine of the road's inclination, uphill positive"),
)
# inputs that are zero where a log lacks them; the others with a default of 0.0 must be given
ZERO_DEFAULTS = ("grade",)
# name, unit, value, lower and upper bound (None: known, stays fixed), meaning
PARAMETERS = (
    ("J_primary", "kg m^2", 0.08, None, None, "engine and primary sheave, from drawings"),
    ("c_engine", "N m s", 0.02, 0.002, 0.2, "drag of the engine"),
    ("ratio", "1", 6.0, None, None, "engine speed over axle speed, belt gripping"),
    ("tau_grip", "N m", 70.0, 30.0, 150.0, "torque that the belt can carry"),
    ("w_slip", "rad/s", 12.0, None, None, "slip speed at which the belt pulls 76 % of that"),
    ("J_axle", "kg m^2", 2.5, None, None, "secondary sheave, gears and brake discs"),
    ("k_shaft", "N m/rad", 4000.0, 1000.0, 12000.0, "stiffness of the half-shaft"),
    ("d_shaft", "N m s/rad", 40.0, None, None, "damping of the half-shaft"),
    ("r_tyre", "m", 0.3, None, None, "dynamic tyre radius, measured"),
    ("m_vehicle", "kg", 600.0, None, None, "vehicle with driver, weighed"),
    ("F_roll", "N", 120.0, 20.0, 400.0, "rolling resistance"),
    ("v_roll", "m/s", 0.2, None, None, "speed at which rolling resistance reaches 76 %"),
    ("c_aero", "kg/m", 0.6, None, None, "air drag over speed squared, from a wind tunnel"),
    ("gravity", "m/s^2", 9.81, None, None, "gravity"),
)
# name, unit, meaning
OUTPUTS = (
    ("engine_speed", "rad/s", "crankshaft speed"),
    ("axle_speed", "rad/s", "axle speed"),
    ("shaft_torque", "N m", "torque in the half-shaft (strain gauge)"),
    ("speed", "m/s", "vehicle speed"),
)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    omega_primary = x[0]
    omega_axle = x[1]
    twist_shaft = x[2]
    v_body = x[3]
    engine_torque = u[0]
    grade = u[1]
    J_primary = theta[0]
    c_engine = theta[1]
    ratio = theta[2]
    tau_grip = theta[3]
    w_slip = theta[4]
    J_axle = theta[5]
    k_shaft = theta[6]
    d_shaft = theta[7]
    r_tyre = theta[8]
    m_vehicle = theta[9]
    F_roll = theta[10]
    v_roll = theta[11]
    c_aero = theta[12]
    gravity = theta[13]
    tau_engine_drag = c_engine*omega_primary  # [N m] effort of engine_drag
    tau_belt = tau_grip*np.tanh((omega_primary - ratio*omega_axle)/w_slip)  # [N m] effort of belt
    tau_half_shaft = k_shaft*twist_shaft  # [N m] effort of half_shaft
    omega_twist = omega_axle - v_body/r_tyre  # [rad/s] flow of twist
    tau_shaft_damping = d_shaft*omega_twist  # [N m] effort of shaft_damping
    tau_shaft = tau_half_shaft + tau_shaft_damping  # [N m] effort of shaft
    F_rolling = F_roll*np.tanh(v_body/v_roll)  # [N] effort of rolling
    F_air = c_aero*v_body*np.abs(v_body)  # [N] effort of air
    dx0 = (engine_torque - tau_engine_drag - tau_belt)/J_primary  # d(omega_primary)/dt
    dx1 = (ratio*tau_belt - tau_shaft)/J_axle  # d(omega_axle)/dt
    dx2 = omega_twist  # d(twist_shaft)/dt
    dx3 = (tau_shaft/r_tyre - m_vehicle*gravity*grade - F_rolling - F_air)/m_vehicle  # d(v_body)/dt
    return _stack(x, (dx0, dx1, dx2, dx3))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    omega_primary = x[0]
    omega_axle = x[1]
    twist_shaft = x[2]
    v_body = x[3]
    k_shaft = theta[6]
    d_shaft = theta[7]
    r_tyre = theta[8]
    tau_half_shaft = k_shaft*twist_shaft  # [N m] effort of half_shaft
    omega_twist = omega_axle - v_body/r_tyre  # [rad/s] flow of twist
    tau_shaft_damping = d_shaft*omega_twist  # [N m] effort of shaft_damping
    tau_shaft = tau_half_shaft + tau_shaft_damping  # [N m] effort of shaft
    y0 = omega_primary  # engine_speed [rad/s]
    y1 = omega_axle  # axle_speed [rad/s]
    y2 = tau_shaft  # shaft_torque [N m]
    y3 = v_body  # speed [m/s]
    return _stack(x, (y0, y1, y2, y3))


def _stack(x, rows):
    """Rows, each a number or of the batch shape of x, as one array of shape (len(rows), *batch)."""
    stacked = np.empty((len(rows), *x.shape[1:]))
    for i, row in enumerate(rows):
        stacked[i] = row
    return stacked
