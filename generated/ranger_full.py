# Generated from vehicle_graphs/ranger.py -- do not edit.
# Regenerate with:  bondgraph generate vehicle_graphs.ranger:full
# Generator: bondgraph 0.2.0.dev0, sympy 1.14.0.  Equations: 9447235dee25ba2c
"""Ranger-class vehicle with rubber-belt CVT, rear drive: the whole vehicle.

States x:
      0  forward_velocity     [m/s]  flow of body.mass
      1  heave_rate           [m/s]  flow of body.bounce_mass
      2  pitch_rate           [rad/s]  flow of body.tilt_inertia
      3  heave                [m]  displacement of body.springs (port 1)
      4  pitch                [rad]  displacement of body.springs (port 2)
      5  rear_axle_speed      [rad/s]  flow of rear_axle.inertia
      6  front_axle_speed     [rad/s]  flow of front_axle.inertia
      7  engine_speed         [rad/s]  flow of engine.inertia
      8  sheave_displacement  [m]  displacement of primary.stops
      9  inclination          [rad]  inclination of the ground, uphill positive
     10  height               [m]  height of the vehicle

Inputs u:
      0  inclination_rate  [rad/s]  rate at which the inclination of the ground changes
      1  brake             [1]  brake pedal, 0 to 1
      2  throttle          [1]  throttle pedal, 0 to 1
      3  gear              [1]  gear lever

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
      9  I              [kg m^2]  inertia of the body in pitch
     10  c_f            [N s/m]  front dampers
     11  c_r            [N s/m]  rear dampers
     12  rho            [kg/m^3]  air density
     13  CdA            [m^2]  drag coefficient times frontal area
     14  J_r            [kg m^2]  rear axle with wheels
     15  brake_gain     [1]  brake torque relative to its nominal value, both axles
     16  T_br_max       [N m]  largest brake torque of the rear axle
     17  w_brake        [rad/s]  axle speed at which the brake reaches 76 % (smoothing)
     18  f_r            [1]  rolling resistance coefficient
     19  w_roll         [rad/s]  axle speed at which rolling resistance reaches 76 % (smoothing)
     20  r_d            [m]  dynamic tyre radius
     21  radius_gain_r  [1]  dynamic radius of the rear tyres relative to r_d
     22  J_f            [kg m^2]  front axle with wheels
     23  T_bf_max       [N m]  largest brake torque of the front axle
     24  radius_gain_f  [1]  dynamic radius of the front tyres relative to r_d
     25  mu             [1]  friction of tyre on gravel
     26  C_k            [1]  force over load per slip, small slip
     27  v_low          [m/s]  speed below which slip refers to it (standstill)
     28  J_e            [kg m^2]  engine with primary clutch
     29  b_d            [N m s]  drag of auxiliaries
     30  w_idle         [rad/s]  idle speed of the governor (1200 rpm)
     31  T_f0           [N m]  friction of the engine at standstill
     32  T_f1           [N m s]  friction of the engine per speed
     33  T_pk           [N m]  largest shaft torque
     34  w_pk           [rad/s]  speed of the largest torque (5000 rpm)
     35  a_t            [1]  curvature of the torque over speed
     36  w_max          [rad/s]  speed at which the limiter begins
     37  w_cut          [rad/s]  range over which the limiter closes
     38  k_u            [1]  filling per opening at the reference speed
     39  w_ref          [rad/s]  reference speed of the filling
     40  w_fill         [rad/s]  speed below which the filling grows no further
     41  x_max          [m]  travel of the primary sheave between its stops
     42  k_st           [N/m]  stiffness of the end stops
     43  c_x            [N s/m]  resistance to shifting: belt, bushings
     44  m_fw           [kg]  flyweights, all together; stands for m_fw r_f0 td0
     45  r_f0           [m]  radius of the flyweights, sheave open
     46  r_f1           [m]  growth of that radius over the travel
     47  td0            [1]  axial force per centrifugal force, sheave open
     48  td1            [1]  change of that ratio over the travel
     49  F_p0           [N]  preload of the pressure spring
     50  k_p            [N/m]  rate of the pressure spring
     51  al             [rad]  half of the groove angle (13 deg)
     52  C              [m]  distance of the pulleys' axes
     53  r_p_min        [m]  belt radius on the primary, sheave open
     54  r_s0           [m]  belt radius on the secondary then; fixes the length of the belt
     55  mu_b           [1]  friction of belt on sheave
     56  v_s            [m/s]  slip at which the belt carries 76 % of what it can
     57  F_s0           [N]  preload of the spring
     58  k_s            [N/m]  rate of the spring, per travel of the primary
     59  r_h            [m]  radius of the helix; stands for r_h tan_h
     60  tan_h          [1]  tangent of the helix angle
     61  G_H            [1]  shaft over axle speed in high gear
     62  G_L            [1]  shaft over axle speed in low gear
     63  G_R            [1]  shaft over axle speed in reverse
     64  eta            [1]  share of the belt's torque that arrives at the axle
     65  J_s            [kg m^2]  secondary clutch and shaft

Outputs y:
      0  engine_speed      [rad/s]  crankshaft speed
      1  axle_speed        [rad/s]  rear axle speed
      2  forward_velocity  [m/s]  forward velocity
      3  height            [m]  height of the vehicle
      4  pitch             [rad]  inclination of the body, with the offset
"""
import numpy as np

NAME = "ranger_full"
FORMAT = "bondgraph-module/1"
# name, unit, initial value, meaning
STATES = (
    ("forward_velocity", "m/s", 0.0, "flow of body.mass"),
    ("heave_rate", "m/s", 0.0, "flow of body.bounce_mass"),
    ("pitch_rate", "rad/s", 0.0, "flow of body.tilt_inertia"),
    ("heave", "m", 0.0, "displacement of body.springs (port 1)"),
    ("pitch", "rad", 0.0, "displacement of body.springs (port 2)"),
    ("rear_axle_speed", "rad/s", 0.0, "flow of rear_axle.inertia"),
    ("front_axle_speed", "rad/s", 0.0, "flow of front_axle.inertia"),
    ("engine_speed", "rad/s", 125.650494711, "flow of engine.inertia"),
    ("sheave_displacement", "m", -0.000249959694589, "displacement of primary.stops"),
    ("inclination", "rad", 0.0, "inclination of the ground, uphill positive"),
    ("height", "m", 0.0, "height of the vehicle"),
)
# name, unit, default, between samples ("linear" or "hold"), letters of a text signal, meaning
INPUTS = (
    ("inclination_rate", "rad/s", 0.0, "linear", None, "rate at which the inclination of the ground changes"),
    ("brake", "1", 0.0, "linear", None, "brake pedal, 0 to 1"),
    ("throttle", "1", 0.0, "linear", None, "throttle pedal, 0 to 1"),
    ("gear", "1", 10.0, "hold", {"H": 10.0, "L": 22.0, "R": -20.0, "N": 0.0}, "gear lever"),
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
    ("I", "kg m^2", 1093.0, None, None, "inertia of the body in pitch"),
    ("c_f", "N s/m", 3000.0, None, None, "front dampers"),
    ("c_r", "N s/m", 5200.0, None, None, "rear dampers"),
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
    ("J_e", "kg m^2", 0.06, None, None, "engine with primary clutch"),
    ("b_d", "N m s", 0.004, None, None, "drag of auxiliaries"),
    ("w_idle", "rad/s", 125.7, None, None, "idle speed of the governor (1200 rpm)"),
    ("T_f0", "N m", 4.0, 2.0, 7.0, "friction of the engine at standstill"),
    ("T_f1", "N m s", 0.02, None, None, "friction of the engine per speed"),
    ("T_pk", "N m", 75.0, 50.0, 100.0, "largest shaft torque"),
    ("w_pk", "rad/s", 523.6, None, None, "speed of the largest torque (5000 rpm)"),
    ("a_t", "1", 1.0, None, None, "curvature of the torque over speed"),
    ("w_max", "rad/s", 712.0, None, None, "speed at which the limiter begins"),
    ("w_cut", "rad/s", 20.0, None, None, "range over which the limiter closes"),
    ("k_u", "1", 5.0, 2.5, 8.0, "filling per opening at the reference speed"),
    ("w_ref", "rad/s", 314.16, None, None, "reference speed of the filling"),
    ("w_fill", "rad/s", 80.0, None, None, "speed below which the filling grows no further"),
    ("x_max", "m", 0.0296, None, None, "travel of the primary sheave between its stops"),
    ("k_st", "N/m", 1000000.0, None, None, "stiffness of the end stops"),
    ("c_x", "N s/m", 6000.0, None, None, "resistance to shifting: belt, bushings"),
    ("m_fw", "kg", 0.174, 0.12, 0.24, "flyweights, all together; stands for m_fw r_f0 td0"),
    ("r_f0", "m", 0.05, None, None, "radius of the flyweights, sheave open"),
    ("r_f1", "m", 0.025, None, None, "growth of that radius over the travel"),
    ("td0", "1", 0.69, None, None, "axial force per centrifugal force, sheave open"),
    ("td1", "1", -0.15, None, None, "change of that ratio over the travel"),
    ("F_p0", "N", 150.0, 80.0, 250.0, "preload of the pressure spring"),
    ("k_p", "N/m", 25300.0, 15000.0, 36000.0, "rate of the pressure spring"),
    ("al", "rad", 0.22689280275926285, None, None, "half of the groove angle (13 deg)"),
    ("C", "m", 0.265, None, None, "distance of the pulleys' axes"),
    ("r_p_min", "m", 0.038, None, None, "belt radius on the primary, sheave open"),
    ("r_s0", "m", 0.132, None, None, "belt radius on the secondary then; fixes the length of the belt"),
    ("mu_b", "1", 0.5, 0.3, 0.7, "friction of belt on sheave"),
    ("v_s", "m/s", 0.15, None, None, "slip at which the belt carries 76 % of what it can"),
    ("F_s0", "N", 400.0, None, None, "preload of the spring"),
    ("k_s", "N/m", 17000.0, None, None, "rate of the spring, per travel of the primary"),
    ("r_h", "m", 0.045, 0.03, 0.065, "radius of the helix; stands for r_h tan_h"),
    ("tan_h", "1", 1.0, None, None, "tangent of the helix angle"),
    ("G_H", "1", 10.0, None, None, "shaft over axle speed in high gear"),
    ("G_L", "1", 22.0, None, None, "shaft over axle speed in low gear"),
    ("G_R", "1", -20.0, None, None, "shaft over axle speed in reverse"),
    ("eta", "1", 0.95, None, None, "share of the belt's torque that arrives at the axle"),
    ("J_s", "kg m^2", 0.03, None, None, "secondary clutch and shaft"),
)
# name, unit, meaning
OUTPUTS = (
    ("engine_speed", "rad/s", "crankshaft speed"),
    ("axle_speed", "rad/s", "rear axle speed"),
    ("forward_velocity", "m/s", "forward velocity"),
    ("height", "m", "height of the vehicle"),
    ("pitch", "rad", "inclination of the body, with the offset"),
)


def _solve_r_s(r_s, C, L_b, r_p):
    """r_s [m] of the algebraic loop r_s (law of r_s), by damped Newton steps; nan where they fail."""
    _best_r_s, _step_r_s = r_s, 1.0 + np.abs(r_s)
    _error, _demand, _part = np.inf, 0.0, -2.0
    for _ in range(200):
        _r0 = np.pi*(r_p + r_s) + 2*np.sqrt(C**2 - (r_s - r_p)**2) + np.arcsin((r_s - r_p)/C)*(2*r_s - 2*r_p) - L_b
        _j0_0 = 2*np.arcsin((r_s - r_p)/C) + (2*r_p - 2*r_s)/np.sqrt(C**2 - (r_s - r_p)**2) + (2*r_s - 2*r_p)/(C*np.sqrt(1 - (r_s - r_p)**2/C**2)) + np.pi
        _trial = np.abs(_r0)
        _better = _trial < (1.0 - _demand*np.abs(_part))*_error
        _newton_r_s = -_r0/_j0_0
        _usable = (np.abs(_newton_r_s) < 1e9*(1.0 + np.abs(r_s))) & (np.abs(_newton_r_s) > 0.0)
        _demand = np.where(_better, np.where(_usable, 0.25, 0.0), _demand)
        _step_r_s = np.where(_better, np.where(_usable, _newton_r_s, 1.0 + np.abs(r_s)), _step_r_s)
        _error = np.where(_better, _trial, _error)
        _best_r_s = np.where(_better, r_s, _best_r_s)
        _part = np.where(_better, np.minimum(4.0*np.abs(_part), 1.0), -0.5*_part)
        _settled = (_error == 0.0) | (np.abs(_part) < 1e-18) | (np.abs(_part*_step_r_s) <= 4e-16*np.abs(_best_r_s))
        _part = np.where(_settled, 0.0, _part)
        if np.all(_part == 0.0):
            break
        r_s = _best_r_s + _part*_step_r_s
    _found = (_error == 0.0) | (np.abs(_step_r_s) <= 1e-6*np.abs(_best_r_s) + 1e-9)
    return np.where(_found, _best_r_s, np.nan)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    forward_velocity = x[0]
    heave_rate = x[1]
    pitch_rate = x[2]
    heave = x[3]
    pitch = x[4]
    rear_axle_speed = x[5]
    front_axle_speed = x[6]
    engine_speed = x[7]
    sheave_displacement = x[8]
    inclination = x[9]
    inclination_rate = u[0]
    brake = u[1]
    throttle = u[2]
    gear = u[3]
    m = theta[1]
    g = theta[2]
    a = theta[3]
    b = theta[4]
    r_z = theta[5]
    spring_gain = theta[6]
    k_f = theta[7]
    k_r = theta[8]
    I = theta[9]
    c_f = theta[10]
    c_r = theta[11]
    rho = theta[12]
    CdA = theta[13]
    J_r = theta[14]
    brake_gain = theta[15]
    T_br_max = theta[16]
    w_brake = theta[17]
    f_r = theta[18]
    w_roll = theta[19]
    r_d = theta[20]
    radius_gain_r = theta[21]
    J_f = theta[22]
    T_bf_max = theta[23]
    radius_gain_f = theta[24]
    mu = theta[25]
    C_k = theta[26]
    v_low = theta[27]
    J_e = theta[28]
    b_d = theta[29]
    w_idle = theta[30]
    T_f0 = theta[31]
    T_f1 = theta[32]
    T_pk = theta[33]
    w_pk = theta[34]
    a_t = theta[35]
    w_max = theta[36]
    w_cut = theta[37]
    k_u = theta[38]
    w_ref = theta[39]
    w_fill = theta[40]
    x_max = theta[41]
    k_st = theta[42]
    c_x = theta[43]
    m_fw = theta[44]
    r_f0 = theta[45]
    r_f1 = theta[46]
    td0 = theta[47]
    td1 = theta[48]
    F_p0 = theta[49]
    k_p = theta[50]
    al = theta[51]
    C = theta[52]
    r_p_min = theta[53]
    r_s0 = theta[54]
    mu_b = theta[55]
    v_s = theta[56]
    F_s0 = theta[57]
    k_s = theta[58]
    r_h = theta[59]
    tan_h = theta[60]
    G_H = theta[61]
    G_L = theta[62]
    G_R = theta[63]
    eta = theta[64]
    J_s = theta[65]
    F_body_air = (1/2)*rho*CdA*forward_velocity*np.abs(forward_velocity)  # [N] effort of body.air
    F_body_gravity = -m*g*np.sin(inclination)  # [N] effort of body.gravity
    N_r0 = m*g*a/(a + b)  # [N] static load of the rear springs
    F_body_rear_strut = c_r*(heave_rate - b*pitch_rate)  # [N] effort of body.rear_strut
    S_r = N_r0 - spring_gain*k_r*(heave - b*pitch) - F_body_rear_strut  # [N] force of the rear suspension
    N_r = np.maximum(S_r, 0.0)  # [N] load of the rear tyres
    m_rear_wheels = r_d*radius_gain_r  # modulus of rear_wheels
    v_body_ground = forward_velocity + r_z*pitch_rate  # [m/s] flow of body.ground
    slip_speed_r = np.maximum(np.maximum(np.abs(v_body_ground), np.abs(r_d*radius_gain_r*rear_axle_speed)), v_low)  # [m/s] speed that the slip of the rear tyres refers to
    F_rear_tyre_contact = mu*N_r*np.tanh(C_k*(rear_axle_speed*m_rear_wheels - v_body_ground)/(mu*slip_speed_r))  # [N] effort of rear_tyre.contact
    N_f0 = m*g*b/(a + b)  # [N] static load of the front springs
    F_body_front_strut = c_f*(heave_rate + a*pitch_rate)  # [N] effort of body.front_strut
    S_f = N_f0 - spring_gain*k_f*(heave + a*pitch) - F_body_front_strut  # [N] force of the front suspension
    N_f = np.maximum(S_f, 0.0)  # [N] load of the front tyres
    m_front_wheels = r_d*radius_gain_f  # modulus of front_wheels
    slip_speed_f = np.maximum(np.maximum(np.abs(v_body_ground), np.abs(r_d*radius_gain_f*front_axle_speed)), v_low)  # [m/s] speed that the slip of the front tyres refers to
    F_front_tyre_contact = mu*N_f*np.tanh(C_k*(front_axle_speed*m_front_wheels - v_body_ground)/(mu*slip_speed_f))  # [N] effort of front_tyre.contact
    F_body_thrust = F_rear_tyre_contact + F_front_tyre_contact  # [N] effort of body.thrust
    F_body_weight = -m*g*np.cos(inclination)  # [N] effort of body.weight
    F_body_springs1 = spring_gain*k_f*(heave + a*pitch) + spring_gain*k_r*(heave - b*pitch) - N_r0 - N_f0  # [N] effort of body.springs1
    tau_body_springs2 = b*(N_r0 - spring_gain*k_r*(heave - b*pitch)) - a*(N_f0 - spring_gain*k_f*(heave + a*pitch))  # [N m] effort of body.springs2
    tau_rear_axle_brake_discs = brake_gain*T_br_max*brake*np.tanh(rear_axle_speed/w_brake)  # [N m] effort of rear_axle.brake_discs
    tau_rear_axle_rolling = f_r*r_d*radius_gain_r*N_r*np.tanh(rear_axle_speed/w_roll)  # [N m] effort of rear_axle.rolling
    G = np.where(gear > 16, G_L, np.where(gear > 5, G_H, np.where(gear < -5, G_R, 0.0)))  # [1] ratio of the engaged gear, 0 in neutral
    omega_gearbox_shaft = rear_axle_speed*G  # [rad/s] flow of gearbox.shaft
    L_b = np.pi*(r_p_min + r_s0) + 2*np.sqrt(C**2 - (r_s0 - r_p_min)**2) + np.arcsin((r_s0 - r_p_min)/C)*(2*r_s0 - 2*r_p_min)  # [m] length of the belt
    r_p = r_p_min + (1/2)*np.minimum(np.maximum(sheave_displacement, 0.0), x_max)/np.tan(al)  # [m] belt radius on the primary
    r_s = _solve_r_s(r_s0 - (1/2)*np.minimum(np.maximum(sheave_displacement, 0.0), x_max)/np.tan(al), C, L_b, r_p)  # law of r_s
    travel_share = np.minimum(np.maximum(sheave_displacement/x_max, 0.0), 1.0)  # [1] sheave travel from open 0 to closed 1
    F_p = np.maximum(m_fw*engine_speed**2*(r_f0 + r_f1*travel_share)*(td0 + td1*travel_share) - F_p0 - k_p*np.maximum(sheave_displacement, 0.0), 0.0)  # [N] clamp force of the primary
    F_secondary_spring = -F_s0 - k_s*np.maximum(sheave_displacement, 0.0)  # [N] effort of secondary.spring
    F_belt_belt_part_1 = 2*mu_b*np.tanh((engine_speed*r_p - omega_gearbox_shaft*r_s)/v_s)/np.cos(al)  # loop of belt.traction, F_s
    F_belt_belt_part_2 = 1/(2*r_h*tan_h)  # loop of belt.traction, F_s
    F_belt_belt_branch_1 = F_p*F_belt_belt_part_1  # loop of belt.traction, F_s
    F_belt_belt_remainder_1 = np.abs(F_belt_belt_branch_1 - F_belt_belt_part_1*np.minimum(F_p, F_belt_belt_part_2*np.maximum(r_s*F_belt_belt_branch_1, 0.0) - F_secondary_spring))  # loop of belt.traction, F_s
    F_belt_belt_branch_2 = -F_secondary_spring*F_belt_belt_part_1  # loop of belt.traction, F_s
    F_belt_belt_remainder_2 = np.abs(F_belt_belt_branch_2 - F_belt_belt_part_1*np.minimum(F_p, F_belt_belt_part_2*np.maximum(r_s*F_belt_belt_branch_2, 0.0) - F_secondary_spring))  # loop of belt.traction, F_s
    F_belt_belt_best_of_2 = np.where(F_belt_belt_remainder_2 < (1/1000000)*F_belt_belt_remainder_1, F_belt_belt_branch_2, F_belt_belt_branch_1)  # loop of belt.traction, F_s
    F_belt_belt_least_of_2 = np.where(F_belt_belt_remainder_2 < (1/1000000)*F_belt_belt_remainder_1, F_belt_belt_remainder_2, F_belt_belt_remainder_1)  # loop of belt.traction, F_s
    F_belt_belt_branch_3 = -F_secondary_spring*F_belt_belt_part_1/(1 - r_s*F_belt_belt_part_1*F_belt_belt_part_2)  # loop of belt.traction, F_s
    F_belt_belt_remainder_3 = np.abs(F_belt_belt_branch_3 - F_belt_belt_part_1*np.minimum(F_p, F_belt_belt_part_2*np.maximum(r_s*F_belt_belt_branch_3, 0.0) - F_secondary_spring))  # loop of belt.traction, F_s
    F_belt_belt = np.where(F_belt_belt_remainder_3 < (1/1000000)*F_belt_belt_least_of_2, F_belt_belt_branch_3, F_belt_belt_best_of_2)  # [N] effort of belt.belt
    F_secondary_helix = -(1/2)*np.maximum(r_s*F_belt_belt, 0.0)/(r_h*tan_h)  # [N] effort of secondary.helix
    F_belt_length_secondary_sheave = -F_secondary_spring - F_secondary_helix  # [N] effort of bond belt_length -> secondary.sheave
    tau_gearbox_mesh_loss = G*r_s*F_belt_belt*(eta - 1)  # [N m] effort of gearbox.mesh_loss
    tau_rear_axle_inertia_part = G*r_s*F_belt_belt + tau_gearbox_mesh_loss - m_rear_wheels*F_rear_tyre_contact - tau_rear_axle_brake_discs - tau_rear_axle_rolling  # part of effort of rear_axle.inertia
    d_rear_axle_speed = tau_rear_axle_inertia_part/(J_r + J_s*G**2)  # rate of flow of rear_axle.inertia
    tau_front_axle_brake_discs = brake_gain*T_bf_max*brake*np.tanh(front_axle_speed/w_brake)  # [N m] effort of front_axle.brake_discs
    tau_front_axle_rolling = f_r*r_d*radius_gain_f*N_f*np.tanh(front_axle_speed/w_roll)  # [N m] effort of front_axle.rolling
    tau_engine_drag = b_d*engine_speed  # [N m] effort of engine.drag
    T_f = T_f0 + T_f1*engine_speed  # [N m] friction torque
    T_w = T_pk*np.minimum(np.maximum((w_max + w_cut - engine_speed)/w_cut, 0.0), 1.0)*(1 - a_t*(engine_speed - w_pk)**2/w_pk**2)  # [N m] wide-open torque
    idle_opening = np.minimum(np.maximum((0.6*w_idle - 0.6*engine_speed)/w_idle + 0.016, 0.0), 0.35)  # [1] opening by the idle governor
    opening = np.maximum(np.maximum(throttle, idle_opening), 1e-06)  # [1] throttle opening
    filling = k_u*w_ref*opening/np.maximum(engine_speed, w_fill)  # [1] filling of the cylinders
    T_e = (T_f + T_w)*(1 - np.exp(-filling))/(1 - np.exp(-filling/opening)) - T_f  # [N m] engine torque
    F_primary_stops = k_st*np.maximum(sheave_displacement - x_max, 0.0) - k_st*np.maximum(-sheave_displacement, 0.0)  # [N] effort of primary.stops
    lean = np.arcsin((r_s - r_p)/C)  # [rad] angle of the free strands to the line of centres
    wrap_ratio = (np.pi - 2*lean)/(2*lean + np.pi)  # [1] wrap angle of the primary over the secondary's
    v_primary_sheave = (F_p - F_primary_stops - F_belt_length_secondary_sheave*wrap_ratio)/c_x  # [m/s] flow of primary.sheave
    dx0 = (F_body_gravity + F_body_thrust - F_body_air)/m  # d(forward_velocity)/dt
    dx1 = (F_body_weight - F_body_rear_strut - F_body_front_strut - F_body_springs1)/m  # d(heave_rate)/dt
    dx2 = (b*F_body_rear_strut + r_z*F_body_thrust - a*F_body_front_strut - tau_body_springs2)/I  # d(pitch_rate)/dt
    dx3 = heave_rate  # d(heave)/dt
    dx4 = pitch_rate  # d(pitch)/dt
    dx5 = d_rear_axle_speed  # d(rear_axle_speed)/dt
    dx6 = (-m_front_wheels*F_front_tyre_contact - tau_front_axle_brake_discs - tau_front_axle_rolling)/J_f  # d(front_axle_speed)/dt
    dx7 = (T_e - r_p*F_belt_belt - tau_engine_drag)/J_e  # d(engine_speed)/dt
    dx8 = v_primary_sheave  # d(sheave_displacement)/dt
    dx9 = inclination_rate  # d(inclination)/dt
    dx10 = forward_velocity*np.sin(inclination)  # d(height)/dt
    return _stack(x, (dx0, dx1, dx2, dx3, dx4, dx5, dx6, dx7, dx8, dx9, dx10))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    forward_velocity = x[0]
    pitch = x[4]
    rear_axle_speed = x[5]
    engine_speed = x[7]
    inclination = x[9]
    height = x[10]
    th_off = theta[0]
    y0 = engine_speed  # engine_speed [rad/s]
    y1 = rear_axle_speed  # axle_speed [rad/s]
    y2 = forward_velocity  # forward_velocity [m/s]
    y3 = height  # height [m]
    y4 = th_off + pitch + inclination  # pitch [rad]
    return _stack(x, (y0, y1, y2, y3, y4))


def _stack(x, rows):
    """Rows, each a number or of the batch shape of x, as one array of shape (len(rows), *batch)."""
    stacked = np.empty((len(rows), *x.shape[1:]))
    for i, row in enumerate(rows):
        stacked[i] = row
    return stacked
