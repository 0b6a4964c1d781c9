# Generated from vehicle_graphs/baja.py -- do not edit.
# Regenerate with:  bondgraph generate vehicle_graphs.baja:launch_given_engine
# Generator: bondgraph 0.2.0.dev0, sympy 1.14.0.  Equations: b18c7a6dc645047a
"""Terps TR24 Baja car: the engine's power carried to the wheels at the measured engine speed.

States x:
      0  omega_wheel  [rad/s]  flow of wheel_inertia

Inputs u:
      0  throttle      [1]  throttle opening, 0 idle (no net torque) to 1 full
      1  engine_speed  [rad/s]  measured crankshaft speed

Parameters theta:
      0  lowest_ratio    [1]  secondary over primary radius with the sheaves open
      1  slowest_engine  [rad/s]  engine speed below which a reading is not believed
      2  gear_reduction  [1]  secondary speed over wheel speed
      3  tyre_radius     [m]  tyre radius
      4  J_wheels        [kg m^2]  four wheels
      5  J_secondary     [kg m^2]  secondary clutch
      6  m_vehicle       [kg]  car with driver (500 lb)
      7  rolling_force   [N]  rolling resistance (10 lbf)
      8  creep_speed     [m/s]  speed at which rolling resistance reaches 76 % (smoothing)
      9  drag_area       [m^2]  drag coefficient times frontal area
     10  air_density     [kg/m^3]  air density

Outputs y:
      0  wheel_speed  [rad/s]  speed of the driven wheels
"""
import numpy as np

NAME = "baja_launch_given_engine"
FORMAT = "bondgraph-module/1"
# name, unit, initial value, meaning
STATES = (
    ("omega_wheel", "rad/s", 0.0, "flow of wheel_inertia"),
)
# name, unit, default, between samples ("linear" or "hold"), letters of a text signal, meaning
INPUTS = (
    ("throttle", "1", 1.0, "linear", None, "throttle opening, 0 idle (no net torque) to 1 full"),
    ("engine_speed", "rad/s", 213.62830044410592, "linear", None, "measured crankshaft speed"),
)
# name, unit, value, lower and upper bound (None: known, stays fixed), meaning
PARAMETERS = (
    ("lowest_ratio", "1", 3.90537418901, None, None, "secondary over primary radius with the sheaves open"),
    ("slowest_engine", "rad/s", 104.71975511965977, None, None, "engine speed below which a reading is not believed"),
    ("gear_reduction", "1", 8.32, None, None, "secondary speed over wheel speed"),
    ("tyre_radius", "m", 0.3175, None, None, "tyre radius"),
    ("J_wheels", "kg m^2", 0.98534, None, None, "four wheels"),
    ("J_secondary", "kg m^2", 0.00485413, None, None, "secondary clutch"),
    ("m_vehicle", "kg", 226.8, None, None, "car with driver (500 lb)"),
    ("rolling_force", "N", 44.48, 20.0, 200.0, "rolling resistance (10 lbf)"),
    ("creep_speed", "m/s", 0.05, None, None, "speed at which rolling resistance reaches 76 % (smoothing)"),
    ("drag_area", "m^2", 0.546, None, None, "drag coefficient times frontal area"),
    ("air_density", "kg/m^3", 1.225, None, None, "air density"),
)
# name, unit, meaning
OUTPUTS = (
    ("wheel_speed", "rad/s", "speed of the driven wheels"),
)


def _curve(x, knots, values, slopes):
    """Piecewise cubic Hermite polynomial: value, held beyond the ends."""
    i = np.searchsorted(knots[1:-1], x, side="right")
    h = knots[i + 1] - knots[i]
    s = np.minimum(np.maximum((x - knots[i])/h, 0.0), 1.0)
    a0 = (1 + 2*s)*(1 - s)**2
    a1 = s**2*(3 - 2*s)
    b0 = h*s*(1 - s)**2
    b1 = h*s**2*(s - 1)
    return a0*values[i] + a1*values[i + 1] + b0*slopes[i] + b1*slopes[i + 1]


_table_engine_torque_x = np.array([
    0.0, 188.49555921538757, 209.43951023931953, 230.3834612632515, 251.32741228718345, 272.2713633111154,
    293.21531433504737, 314.1592653589793, 335.1032163829112, 356.0471674068432, 376.99111843077515, 397.9350694547071,
])
_table_engine_torque_v = np.array([25.4, 25.4, 25.8, 26.4, 26.8, 26.7, 26.6, 26.4, 25.7, 24.8, 23.9, 0.0])
_table_engine_torque_d = np.array([
    0.0, 0.0, 0.022918311805232967, 0.022918311805232967, 0.0, -0.004774648292756842, -0.006366197723675752,
    -0.014854461355243735, -0.03760035530546027, -0.04297183463481175, -0.08282474578806474, -1.6902254956359282,
])


def _table_engine_torque(x):
    """Table engine_torque [N m]: torque at full throttle, held beyond the ends."""
    return _curve(x, _table_engine_torque_x, _table_engine_torque_v, _table_engine_torque_d)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    omega_wheel = x[0]
    throttle = u[0]
    engine_speed = u[1]
    lowest_ratio = theta[0]
    slowest_engine = theta[1]
    gear_reduction = theta[2]
    tyre_radius = theta[3]
    J_wheels = theta[4]
    J_secondary = theta[5]
    m_vehicle = theta[6]
    rolling_force = theta[7]
    creep_speed = theta[8]
    drag_area = theta[9]
    air_density = theta[10]
    omega_secondary = gear_reduction*omega_wheel  # [rad/s] flow of secondary
    v_body = tyre_radius*omega_wheel  # [m/s] flow of body
    F_rolling = rolling_force*np.tanh(v_body/creep_speed)  # [N] effort of rolling
    F_aero = (1/2)*drag_area*air_density*v_body*np.abs(v_body)  # [N] effort of aero
    tau_secondary_reduction_part = throttle*_table_engine_torque(engine_speed)/np.maximum(omega_secondary/np.maximum(engine_speed, slowest_engine), 1/lowest_ratio)  # part of effort of bond secondary -> reduction
    tau_wheel_inertia_part = -J_secondary*gear_reduction**2/J_wheels - m_vehicle*tyre_radius**2/J_wheels  # part of effort of wheel_inertia
    d_omega_wheel = (gear_reduction*tau_secondary_reduction_part - tyre_radius*(F_rolling + F_aero))/(J_wheels*(1 - tau_wheel_inertia_part))  # rate of flow of wheel_inertia
    dx0 = d_omega_wheel  # d(omega_wheel)/dt
    return _stack(x, (dx0,))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    omega_wheel = x[0]
    y0 = omega_wheel  # wheel_speed [rad/s]
    return _stack(x, (y0,))


def _stack(x, rows):
    """Rows, each a number or of the batch shape of x, as one array of shape (len(rows), *batch)."""
    stacked = np.empty((len(rows), *x.shape[1:]))
    for i, row in enumerate(rows):
        stacked[i] = row
    return stacked
