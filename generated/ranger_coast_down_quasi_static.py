# Generated from vehicle_graphs/ranger.py -- do not edit.
# Regenerate with:  bondgraph generate vehicle_graphs.ranger:coast_down_quasi_static
# Generator: bondgraph 0.2.0.dev0, sympy 1.14.0.  Equations: 63fd7ac3eb2e21a2
"""Ranger-class vehicle coasting in neutral on a suspension that follows at once.

States x:
      0  forward_velocity  [m/s]  flow of body.mass
      1  rear_axle_speed   [rad/s]  flow of rear_axle.inertia
      2  front_axle_speed  [rad/s]  flow of front_axle.inertia
      3  inclination       [rad]  inclination of the ground, uphill positive
      4  height            [m]  height of the vehicle

Inputs u:
      0  inclination_rate  [rad/s]  rate at which the inclination of the ground changes
      1  brake             [1]  brake pedal, 0 to 1

Parameters theta:
      0  th_off         [rad]  offset of the measured pitch
      1  m              [kg]  vehicle 1040 kg with a payload of 160 kg
      2  g              [m/s^2]  gravity
      3  a              [m]  centre of mass to the front axle
      4  b              [m]  centre of mass to the rear axle
      5  r_z            [m]  height of the centre of mass over the ground
      6  spring_gain    [1]  spring rates relative to k_f and k_r: the pitch stiffness
      7  k_f            [N/m]  front springs
      8  k_r            [N/m]  rear springs
      9  rho            [kg/m^3]  air density
     10  CdA            [m^2]  drag coefficient times frontal area
     11  J_r            [kg m^2]  rear axle with wheels
     12  brake_gain     [1]  brake torque relative to its nominal value, both axles
     13  T_br_max       [N m]  largest brake torque of the rear axle
     14  w_brake        [rad/s]  axle speed at which the brake reaches 76 % (smoothing)
     15  f_r            [1]  rolling resistance coefficient
     16  w_roll         [rad/s]  axle speed at which rolling resistance reaches 76 % (smoothing)
     17  r_d            [m]  dynamic tyre radius
     18  radius_gain_r  [1]  dynamic radius of the rear tyres relative to r_d
     19  J_f            [kg m^2]  front axle with wheels
     20  T_bf_max       [N m]  largest brake torque of the front axle
     21  radius_gain_f  [1]  dynamic radius of the front tyres relative to r_d
     22  mu             [1]  friction of tyre on gravel
     23  C_k            [1]  force over load per slip, small slip
     24  v_low          [m/s]  speed below which slip refers to it (standstill)

Outputs y:
      0  axle_speed        [rad/s]  rear axle speed
      1  forward_velocity  [m/s]  forward velocity
      2  height            [m]  height of the vehicle
      3  pitch             [rad]  inclination of the body, with the offset
"""
import numpy as np

NAME = "ranger_coast_down_quasi_static"
FORMAT = "bondgraph-module/1"
# name, unit, initial value, meaning
STATES = (
    ("forward_velocity", "m/s", 0.0, "flow of body.mass"),
    ("rear_axle_speed", "rad/s", 0.0, "flow of rear_axle.inertia"),
    ("front_axle_speed", "rad/s", 0.0, "flow of front_axle.inertia"),
    ("inclination", "rad", 0.0, "inclination of the ground, uphill positive"),
    ("height", "m", 0.0, "height of the vehicle"),
)
# name, unit, default, between samples ("linear" or "hold"), letters of a text signal, meaning
INPUTS = (
    ("inclination_rate", "rad/s", 0.0, "linear", None, "rate at which the inclination of the ground changes"),
    ("brake", "1", 0.0, "linear", None, "brake pedal, 0 to 1"),
)
# inputs that are zero where a log lacks them; the others with a default of 0.0 must be given
ZERO_DEFAULTS = ("inclination_rate", "brake")
# name, unit, value, lower and upper bound (None: known, stays fixed), meaning
PARAMETERS = (
    ("th_off", "rad", 0.0, -0.1, 0.1, "offset of the measured pitch"),
    ("m", "kg", 1200.0, None, None, "vehicle 1040 kg with a payload of 160 kg"),
    ("g", "m/s^2", 9.81, None, None, "gravity"),
    ("a", "m", 1.26, None, None, "centre of mass to the front axle"),
    ("b", "m", 0.79, None, None, "centre of mass to the rear axle"),
    ("r_z", "m", 0.6, None, None, "height of the centre of mass over the ground"),
    ("spring_gain", "1", 1.0, 0.6, 1.5, "spring rates relative to k_f and k_r: the pitch stiffness"),
    ("k_f", "N/m", 41000.0, None, None, "front springs"),
    ("k_r", "N/m", 75000.0, None, None, "rear springs"),
    ("rho", "kg/m^3", 1.225, None, None, "air density"),
    ("CdA", "m^2", 1.4, 0.6, 2.4, "drag coefficient times frontal area"),
    ("J_r", "kg m^2", 2.0, None, None, "rear axle with wheels"),
    ("brake_gain", "1", 1.0, 0.5, 1.5, "brake torque relative to its nominal value, both axles"),
    ("T_br_max", "N m", 1200.0, None, None, "largest brake torque of the rear axle"),
    ("w_brake", "rad/s", 0.5, None, None, "axle speed at which the brake reaches 76 % (smoothing)"),
    ("f_r", "1", 0.035, 0.01, 0.08, "rolling resistance coefficient"),
    ("w_roll", "rad/s", 0.3, None, None, "axle speed at which rolling resistance reaches 76 % (smoothing)"),
    ("r_d", "m", 0.315, 0.27, 0.36, "dynamic tyre radius"),
    ("radius_gain_r", "1", 1.0, None, None, "dynamic radius of the rear tyres relative to r_d"),
    ("J_f", "kg m^2", 2.0, None, None, "front axle with wheels"),
    ("T_bf_max", "N m", 1800.0, None, None, "largest brake torque of the front axle"),
    ("radius_gain_f", "1", 1.0, None, None, "dynamic radius of the front tyres relative to r_d"),
    ("mu", "1", 0.65, None, None, "friction of tyre on gravel"),
    ("C_k", "1", 10.0, None, None, "force over load per slip, small slip"),
    ("v_low", "m/s", 1.0, None, None, "speed below which slip refers to it (standstill)"),
)
# name, unit, meaning
OUTPUTS = (
    ("axle_speed", "rad/s", "rear axle speed"),
    ("forward_velocity", "m/s", "forward velocity"),
    ("height", "m", "height of the vehicle"),
    ("pitch", "rad", "inclination of the body, with the offset"),
)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    forward_velocity = x[0]
    rear_axle_speed = x[1]
    front_axle_speed = x[2]
    inclination = x[3]
    inclination_rate = u[0]
    brake = u[1]
    m = theta[1]
    g = theta[2]
    a = theta[3]
    b = theta[4]
    r_z = theta[5]
    rho = theta[9]
    CdA = theta[10]
    J_r = theta[11]
    brake_gain = theta[12]
    T_br_max = theta[13]
    w_brake = theta[14]
    f_r = theta[15]
    w_roll = theta[16]
    r_d = theta[17]
    radius_gain_r = theta[18]
    J_f = theta[19]
    T_bf_max = theta[20]
    radius_gain_f = theta[21]
    mu = theta[22]
    C_k = theta[23]
    v_low = theta[24]
    F_body_air = (1/2)*rho*CdA*forward_velocity*np.abs(forward_velocity)  # [N] effort of body.air
    F_body_gravity = -m*g*np.sin(inclination)  # [N] effort of body.gravity
    m_front_wheels = r_d*radius_gain_f  # modulus of front_wheels
    slip_speed_f = np.maximum(np.maximum(np.abs(forward_velocity), np.abs(r_d*radius_gain_f*front_axle_speed)), v_low)  # [m/s] speed that the slip of the front tyres refers to
    m_rear_wheels = r_d*radius_gain_r  # modulus of rear_wheels
    slip_speed_r = np.maximum(np.maximum(np.abs(forward_velocity), np.abs(r_d*radius_gain_r*rear_axle_speed)), v_low)  # [m/s] speed that the slip of the rear tyres refers to
    F_rear_tyre_contact_part = r_z*mu*np.tanh(C_k*(rear_axle_speed*m_rear_wheels - forward_velocity)/(mu*slip_speed_r))/(a + b)  # part of effort of rear_tyre.contact
    F_rear_tyre_contact_part_2 = r_z*mu*np.tanh(C_k*(rear_axle_speed*m_rear_wheels - forward_velocity)/(mu*slip_speed_r))/(a + b)  # part of effort of rear_tyre.contact
    F_rear_tyre_contact_part_3 = m*g*a*mu*np.cos(inclination)*np.tanh(C_k*(rear_axle_speed*m_rear_wheels - forward_velocity)/(mu*slip_speed_r))/(a + b)  # part of effort of rear_tyre.contact
    F_front_tyre_contact_part = -r_z*mu*np.tanh(C_k*(front_axle_speed*m_front_wheels - forward_velocity)/(mu*slip_speed_f))/(a + b)  # part of effort of front_tyre.contact
    F_front_tyre_contact_part_2 = -r_z*mu*np.tanh(C_k*(front_axle_speed*m_front_wheels - forward_velocity)/(mu*slip_speed_f))/(a + b)  # part of effort of front_tyre.contact
    F_front_tyre_contact_part_3 = m*g*b*mu*np.cos(inclination)*np.tanh(C_k*(front_axle_speed*m_front_wheels - forward_velocity)/(mu*slip_speed_f))/(a + b)  # part of effort of front_tyre.contact
    loop_pivot_1_1 = 1 - F_front_tyre_contact_part - F_rear_tyre_contact_part*F_front_tyre_contact_part_2/(1 - F_rear_tyre_contact_part_2)  # loop of rear_tyre.slip, front_tyre.slip
    loop_solution_1 = (F_rear_tyre_contact_part_3*F_front_tyre_contact_part_2/(1 - F_rear_tyre_contact_part_2) + F_front_tyre_contact_part_3)/loop_pivot_1_1  # loop of rear_tyre.slip, front_tyre.slip
    loop_solution_0 = (F_rear_tyre_contact_part_3 + F_rear_tyre_contact_part*loop_solution_1)/(1 - F_rear_tyre_contact_part_2)  # loop of rear_tyre.slip, front_tyre.slip
    N_r = (m*g*a*np.cos(inclination) + r_z*(loop_solution_1 + loop_solution_0))/(a + b)  # [N] load of the rear tyres
    N_f = (m*g*b*np.cos(inclination) - r_z*(loop_solution_1 + loop_solution_0))/(a + b)  # [N] load of the front tyres
    tau_rear_axle_brake_discs = brake_gain*T_br_max*brake*np.tanh(rear_axle_speed/w_brake)  # [N m] effort of rear_axle.brake_discs
    tau_rear_axle_rolling = f_r*r_d*radius_gain_r*N_r*np.tanh(rear_axle_speed/w_roll)  # [N m] effort of rear_axle.rolling
    tau_front_axle_brake_discs = brake_gain*T_bf_max*brake*np.tanh(front_axle_speed/w_brake)  # [N m] effort of front_axle.brake_discs
    tau_front_axle_rolling = f_r*r_d*radius_gain_f*N_f*np.tanh(front_axle_speed/w_roll)  # [N m] effort of front_axle.rolling
    dx0 = (F_body_gravity + loop_solution_1 + loop_solution_0 - F_body_air)/m  # d(forward_velocity)/dt
    dx1 = (-m_rear_wheels*loop_solution_0 - tau_rear_axle_brake_discs - tau_rear_axle_rolling)/J_r  # d(rear_axle_speed)/dt
    dx2 = (-m_front_wheels*loop_solution_1 - tau_front_axle_brake_discs - tau_front_axle_rolling)/J_f  # d(front_axle_speed)/dt
    dx3 = inclination_rate  # d(inclination)/dt
    dx4 = forward_velocity*np.sin(inclination)  # d(height)/dt
    return _stack(x, (dx0, dx1, dx2, dx3, dx4))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    forward_velocity = x[0]
    rear_axle_speed = x[1]
    front_axle_speed = x[2]
    inclination = x[3]
    height = x[4]
    th_off = theta[0]
    m = theta[1]
    g = theta[2]
    a = theta[3]
    b = theta[4]
    r_z = theta[5]
    spring_gain = theta[6]
    k_f = theta[7]
    k_r = theta[8]
    r_d = theta[17]
    radius_gain_r = theta[18]
    radius_gain_f = theta[21]
    mu = theta[22]
    C_k = theta[23]
    v_low = theta[24]
    m_front_wheels = r_d*radius_gain_f  # modulus of front_wheels
    slip_speed_f = np.maximum(np.maximum(np.abs(forward_velocity), np.abs(r_d*radius_gain_f*front_axle_speed)), v_low)  # [m/s] speed that the slip of the front tyres refers to
    m_rear_wheels = r_d*radius_gain_r  # modulus of rear_wheels
    slip_speed_r = np.maximum(np.maximum(np.abs(forward_velocity), np.abs(r_d*radius_gain_r*rear_axle_speed)), v_low)  # [m/s] speed that the slip of the rear tyres refers to
    F_rear_tyre_contact_part = r_z*mu*np.tanh(C_k*(rear_axle_speed*m_rear_wheels - forward_velocity)/(mu*slip_speed_r))/(a + b)  # part of effort of rear_tyre.contact
    F_rear_tyre_contact_part_2 = r_z*mu*np.tanh(C_k*(rear_axle_speed*m_rear_wheels - forward_velocity)/(mu*slip_speed_r))/(a + b)  # part of effort of rear_tyre.contact
    F_rear_tyre_contact_part_3 = m*g*a*mu*np.cos(inclination)*np.tanh(C_k*(rear_axle_speed*m_rear_wheels - forward_velocity)/(mu*slip_speed_r))/(a + b)  # part of effort of rear_tyre.contact
    F_front_tyre_contact_part = -r_z*mu*np.tanh(C_k*(front_axle_speed*m_front_wheels - forward_velocity)/(mu*slip_speed_f))/(a + b)  # part of effort of front_tyre.contact
    F_front_tyre_contact_part_2 = -r_z*mu*np.tanh(C_k*(front_axle_speed*m_front_wheels - forward_velocity)/(mu*slip_speed_f))/(a + b)  # part of effort of front_tyre.contact
    F_front_tyre_contact_part_3 = m*g*b*mu*np.cos(inclination)*np.tanh(C_k*(front_axle_speed*m_front_wheels - forward_velocity)/(mu*slip_speed_f))/(a + b)  # part of effort of front_tyre.contact
    loop_pivot_1_1 = 1 - F_front_tyre_contact_part - F_rear_tyre_contact_part*F_front_tyre_contact_part_2/(1 - F_rear_tyre_contact_part_2)  # loop of rear_tyre.slip, front_tyre.slip
    loop_solution_1 = (F_rear_tyre_contact_part_3*F_front_tyre_contact_part_2/(1 - F_rear_tyre_contact_part_2) + F_front_tyre_contact_part_3)/loop_pivot_1_1  # loop of rear_tyre.slip, front_tyre.slip
    loop_solution_0 = (F_rear_tyre_contact_part_3 + F_rear_tyre_contact_part*loop_solution_1)/(1 - F_rear_tyre_contact_part_2)  # loop of rear_tyre.slip, front_tyre.slip
    pitch = r_z*(loop_solution_1 + loop_solution_0)/(spring_gain*k_f*a**2 + spring_gain*k_r*b**2)  # [rad] pitch of the body relative to the ground
    y0 = rear_axle_speed  # axle_speed [rad/s]
    y1 = forward_velocity  # forward_velocity [m/s]
    y2 = height  # height [m]
    y3 = th_off + inclination + pitch  # pitch [rad]
    return _stack(x, (y0, y1, y2, y3))


def _stack(x, rows):
    """Rows, each a number or of the batch shape of x, as one array of shape (len(rows), *batch)."""
    stacked = np.empty((len(rows), *x.shape[1:]))
    for i, row in enumerate(rows):
        stacked[i] = row
    return stacked
