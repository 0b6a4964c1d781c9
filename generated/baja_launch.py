# Generated from vehicle_graphs/baja.py -- do not edit.
# Regenerate with:  bondgraph generate vehicle_graphs.baja:launch
# Generator: bondgraph 0.2.0.dev0, sympy 1.14.0.  Equations: 7cc8d7b1a92ffd56
"""Terps Racing TR24 Baja car: full-throttle launch through a flyweight rubber-belt CVT (Gaged GX9).

States x:
      0  omega_engine  [rad/s]  flow of crankshaft
      1  x_sheave      [m]  displacement of primary_spring
      2  omega_wheel   [rad/s]  flow of wheel_inertia

Inputs u:
      0  throttle  [1]  throttle opening, 0 idle (no net torque) to 1 full

Parameters theta:
      0  engine_inertia             [kg m^2]  engine and primary clutch
      1  sheave_angle               [rad]  half of the groove angle
      2  primary_spring_rate        [N/m]  pressure spring of the primary (tune)
      3  primary_spring_preload     [m]  compression of that spring when open
      4  belt_clearance             [m]  sheave travel until it touches the belt
      5  longest_travel             [m]  travel of sheave and belt from touching to the stop
      6  stop_stiffness             [N/m]  stiffness of the end stops
      7  shift_damping              [N s/m]  resistance to shifting: belt, bushings
      8  flyweight_mass             [kg]  flyweights, all together (tune)
      9  belt_edge                  [m]  travel over which the edges of the belt take up the load
     10  primary_radius_rest        [m]  primary radius at the lowest ratio
     11  secondary_radius_rest      [m]  secondary radius at the lowest ratio
     12  secondary_spring_rate      [N/m]  compression spring of the secondary (tune)
     13  secondary_spring_preload   [m]  compression of that spring at the lowest ratio
     14  torsion_spring_rate        [N m/rad]  torsion spring of the secondary (tune)
     15  torsion_spring_pretension  [rad]  twist at the lowest ratio (tune)
     16  helix_angle                [rad]  helix against the plane of rotation (tune)
     17  helix_radius               [m]  radius of the helix
     18  helix_torque_share         [1]  share of the belt's torque felt by the helix, half if both sheaves grip alike
     19  traction                   [1]  friction of belt on sheave
     20  slip_speed                 [m/s]  slip at which the belt carries 76 % of what it can
     21  gear_reduction             [1]  secondary speed over wheel speed
     22  tyre_radius                [m]  tyre radius
     23  J_wheels                   [kg m^2]  four wheels
     24  J_secondary                [kg m^2]  secondary clutch
     25  m_vehicle                  [kg]  car with driver (500 lb)
     26  rolling_force              [N]  rolling resistance (10 lbf)
     27  creep_speed                [m/s]  speed at which rolling resistance reaches 76 % (smoothing)
     28  drag_area                  [m^2]  drag coefficient times frontal area
     29  air_density                [kg/m^3]  air density

Outputs y:
      0  engine_speed  [rad/s]  crankshaft speed
      1  wheel_speed   [rad/s]  speed of the driven wheels
"""
import numpy as np

NAME = "baja_launch"
FORMAT = "bondgraph-module/1"
# name, unit, initial value, meaning
STATES = (
    ("omega_engine", "rad/s", 213.62830044410592, "flow of crankshaft"),
    ("x_sheave", "m", 0.0, "displacement of primary_spring"),
    ("omega_wheel", "rad/s", 0.0, "flow of wheel_inertia"),
)
# name, unit, default, between samples ("linear" or "hold"), letters of a text signal, meaning
INPUTS = (
    ("throttle", "1", 1.0, "linear", None, "throttle opening, 0 idle (no net torque) to 1 full"),
)
# name, unit, value, lower and upper bound (None: known, stays fixed), meaning
PARAMETERS = (
    ("engine_inertia", "kg m^2", 0.0443903, None, None, "engine and primary clutch"),
    ("sheave_angle", "rad", 0.2181661564992912, None, None, "half of the groove angle"),
    ("primary_spring_rate", "N/m", 10507.6, None, None, "pressure spring of the primary (tune)"),
    ("primary_spring_preload", "m", 0.028575, None, None, "compression of that spring when open"),
    ("belt_clearance", "m", 0.0025, 0.0, 0.006, "sheave travel until it touches the belt"),
    ("longest_travel", "m", 0.01, None, None, "travel of sheave and belt from touching to the stop"),
    ("stop_stiffness", "N/m", 1000000.0, None, None, "stiffness of the end stops"),
    ("shift_damping", "N s/m", 4000.0, 2000.0, 20000.0, "resistance to shifting: belt, bushings"),
    ("flyweight_mass", "kg", 0.536, None, None, "flyweights, all together (tune)"),
    ("belt_edge", "m", 0.001, None, None, "travel over which the edges of the belt take up the load"),
    ("primary_radius_rest", "m", 0.02459625, None, None, "primary radius at the lowest ratio"),
    ("secondary_radius_rest", "m", 0.096057559896, None, None, "secondary radius at the lowest ratio"),
    ("secondary_spring_rate", "N/m", 2565.6, None, None, "compression spring of the secondary (tune)"),
    ("secondary_spring_preload", "m", 0.029845, None, None, "compression of that spring at the lowest ratio"),
    ("torsion_spring_rate", "N m/rad", 3.8323, None, None, "torsion spring of the secondary (tune)"),
    ("torsion_spring_pretension", "rad", 1.0471975511965976, None, None, "twist at the lowest ratio (tune)"),
    ("helix_angle", "rad", 0.6632251157578453, None, None, "helix against the plane of rotation (tune)"),
    ("helix_radius", "m", 0.0460375, None, None, "radius of the helix"),
    ("helix_torque_share", "1", 0.5, 0.4, 1.5, "share of the belt's torque felt by the helix, half if both sheaves grip alike"),
    ("traction", "1", 0.85, 0.2, 1.2, "friction of belt on sheave"),
    ("slip_speed", "m/s", 2.0, None, None, "slip at which the belt carries 76 % of what it can"),
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
    ("engine_speed", "rad/s", "crankshaft speed"),
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


_table_flyweights_radius_x = np.array([
    0.0, 0.0002, 0.0004, 0.0006, 0.0008, 0.001, 0.0012, 0.0014, 0.0016, 0.0018, 0.002, 0.0022, 0.0024, 0.0026, 0.0028,
    0.003, 0.0032, 0.0034, 0.0036, 0.0038, 0.004, 0.0042, 0.0044, 0.0046, 0.0048, 0.005, 0.0052, 0.0054, 0.0056, 0.0058,
    0.006, 0.0062, 0.0064, 0.0066, 0.0068, 0.007, 0.0072, 0.0074, 0.0076, 0.0078, 0.008, 0.0082, 0.0084, 0.0086, 0.0088,
    0.009, 0.0092, 0.0094, 0.0096, 0.0098, 0.01, 0.0102, 0.0104, 0.0106, 0.0108, 0.011, 0.0112, 0.0114, 0.0116, 0.0118,
    0.012, 0.0122, 0.0124, 0.0126, 0.0128, 0.013, 0.0132, 0.0134, 0.0136, 0.0138, 0.014, 0.0142, 0.0144, 0.0146, 0.0148,
    0.015, 0.0152, 0.0154, 0.0156, 0.0158, 0.016, 0.0162, 0.0164, 0.0166, 0.0168, 0.017, 0.0172, 0.0174, 0.0176, 0.0178,
    0.018,
])
_table_flyweights_radius_v = np.array([
    0.042245529454, 0.04228662863, 0.042327738323, 0.042368858545, 0.042409989301, 0.042451130603, 0.042492282458,
    0.042533444875, 0.042577664683, 0.042628835233, 0.042687176281, 0.042752937878, 0.042826417697, 0.042907969639,
    0.042998014902, 0.043097056387, 0.043205697736, 0.043324668913, 0.043454861261, 0.043597071404, 0.04374300635,
    0.04388844087, 0.04403336135, 0.044177754135, 0.044321605537, 0.044464901838, 0.044607629297, 0.044749774156,
    0.044891322644, 0.045032260986, 0.045172575407, 0.045312252141, 0.045451277434, 0.045589637552, 0.04572731879,
    0.045864307476, 0.04600058998, 0.046136152718, 0.046270982164, 0.046405064852, 0.046538387386, 0.04667093645,
    0.046802698807, 0.046933661318, 0.047063810938, 0.047193134731, 0.047321619876, 0.047449253672, 0.047576023547,
    0.047701917066, 0.047826921939, 0.047951026024, 0.048074217339, 0.048196484068, 0.048317814565, 0.048438197366,
    0.04855762119, 0.048676074952, 0.048793547763, 0.048910028942, 0.049025508018, 0.04913997474, 0.049253419077,
    0.049365831232, 0.049477201638, 0.04958752097, 0.049696780148, 0.04980497034, 0.04991208297, 0.050018109717,
    0.050123042526, 0.050226873603, 0.050329595428, 0.050431200748, 0.05053168259, 0.050631034254, 0.050729249323,
    0.050826321659, 0.05092224541, 0.051017015006, 0.051110625164, 0.051203070886, 0.051294347461, 0.051384450466,
    0.051473375763, 0.0515611195, 0.051647678112, 0.051733048316, 0.051817227113, 0.051900211785, 0.051981999892,
])
_table_flyweights_radius_d = np.array([
    0.20546958750002758, 0.2055221691363874, 0.20557478412956579, 0.2056274416272376, 0.20568014162042125,
    0.20573288911679743, 0.2057856766118897, 0.21318186268347228, 0.23720970795123308, 0.27260523709429213,
    0.3091473583930177, 0.34703397764288796, 0.38652866345617515, 0.4279420556733854, 0.47164683189408413,
    0.5180977324954744, 0.5678593084722192, 0.6216454385911231, 0.6796807312083607, 0.720242347748556,
    0.7284215163004105, 0.7258852248788388, 0.723280756267305, 0.7206079254231248, 0.7178665747594014,
    0.7150565717277796, 0.7121778162728771, 0.709230233320317, 0.7062137803495924, 0.7031284472903259,
    0.699974256628962, 0.6967512607876701, 0.6934595397471818, 0.690099216005372, 0.6866704445031891,
    0.6831734127461354, 0.6796083406799405, 0.6759754883589169, 0.6722751507089296, 0.6685076527672069,
    0.6646733695792496, 0.6607726985351703, 0.6568060823233044, 0.6527740007949302, 0.6486769615933092,
    0.6445155247315248, 0.6402902777096976, 0.6360018430982428, 0.6316508859585777, 0.6272381113593463,
    0.6227642517859979, 0.6182300773901092, 0.6136364032241203, 0.6089840693068637, 0.6042739558161331,
    0.5995069752243475, 0.5946840752464008, 0.5898062358437836, 0.5848744672285447, 0.5798898144128343,
    0.5748533525848093, 0.5697661817215083, 0.5646294371169212, 0.5594442786667647, 0.5542118866363013,
    0.5489334785917365, 0.5436102871018668, 0.538243572363634, 0.5328346118565749, 0.5273847083676207,
    0.5218951792794964, 0.5163673624472052, 0.5108026102018299, 0.5052022904156294, 0.4995677854185882,
    0.4939004855146688, 0.48820179561663063, 0.4824731284553073, 0.476715903941548, 0.47093154475381266,
    0.4651214808607053, 0.4592871423527896, 0.4534299667916275, 0.44755138660799526, 0.4416528293585927,
    0.4357357276013063, 0.4298015036872485, 0.4238515727004743, 0.41788734704945735, 0.4119102241333267,
    0.4059491225000465,
])


def _table_flyweights_radius(x):
    """Table flyweights_radius [m]: radius of the rollers at a sheave travel, held beyond the ends."""
    return _curve(x, _table_flyweights_radius_x, _table_flyweights_radius_v, _table_flyweights_radius_d)


_table_flyweights_lift_x = np.array([
    0.0, 0.0002, 0.0004, 0.0006, 0.0008, 0.001, 0.0012, 0.0014, 0.0016, 0.0018, 0.002, 0.0022, 0.0024, 0.0026, 0.0028,
    0.003, 0.0032, 0.0034, 0.0036, 0.0038, 0.004, 0.0042, 0.0044, 0.0046, 0.0048, 0.005, 0.0052, 0.0054, 0.0056, 0.0058,
    0.006, 0.0062, 0.0064, 0.0066, 0.0068, 0.007, 0.0072, 0.0074, 0.0076, 0.0078, 0.008, 0.0082, 0.0084, 0.0086, 0.0088,
    0.009, 0.0092, 0.0094, 0.0096, 0.0098, 0.01, 0.0102, 0.0104, 0.0106, 0.0108, 0.011, 0.0112, 0.0114, 0.0116, 0.0118,
    0.012, 0.0122, 0.0124, 0.0126, 0.0128, 0.013, 0.0132, 0.0134, 0.0136, 0.0138, 0.014, 0.0142, 0.0144, 0.0146, 0.0148,
    0.015, 0.0152, 0.0154, 0.0156, 0.0158, 0.016, 0.0162, 0.0164, 0.0166, 0.0168, 0.017, 0.0172, 0.0174, 0.0176, 0.0178,
    0.018,
])
_table_flyweights_lift_v = np.array([
    0.205469593623, 0.205522165394, 0.205574779975, 0.20562743767, 0.205680138782, 0.205732883617, 0.205785672482,
    0.205838505684, 0.238290739405, 0.273588641708, 0.310029655503, 0.347833663394, 0.38725853111, 0.428610702801,
    0.472259443433, 0.518656343904, 0.5683625873, 0.622087948868, 0.680748048595, 0.730903161166, 0.728434993547,
    0.725898862921, 0.723294556675, 0.720621888633, 0.717880699851, 0.715070859403, 0.71219226515, 0.709244844486,
    0.706228555068, 0.703143385521, 0.699989356114, 0.696766519413, 0.693474960899, 0.690114799558, 0.686686188431,
    0.683189315135, 0.679624402335, 0.675991708181, 0.6722915267, 0.668524188142, 0.66469005928, 0.660789543657,
    0.656823081785, 0.652791151292, 0.648694267007, 0.644532981003, 0.640307882563, 0.63601959811, 0.631668791056,
    0.627256161607, 0.622782446497, 0.618248418661, 0.613654886855, 0.609002695199, 0.604292722671, 0.59952588253,
    0.594703121682, 0.589825419983, 0.584893789484, 0.579909273611, 0.574872946294, 0.569785911036, 0.564649299926,
    0.5594642726, 0.554232015154, 0.548953739, 0.543630679683, 0.538264095649, 0.532855266977, 0.527405494064,
    0.521916096285, 0.516388410608, 0.510823790191, 0.505223602946, 0.499589230084, 0.493922064634, 0.488223509959,
    0.482494978246, 0.476737888996, 0.470953667506, 0.465143743348, 0.459309548855, 0.453452517608, 0.447574082934,
    0.441675676414, 0.435758726413, 0.429824656623, 0.423874884629, 0.417910820506, 0.411933865435, 0.40594541036,
])
_table_flyweights_lift_d = np.array([
    0.262751830000102, 0.262965836441734, 0.2631806458568957, 0.2633969727710274, 0.2636148221758523,
    0.2638342040752956, 0.264055120971589, 0.5274732778106316, 169.07652775666705, 179.30175345847542,
    185.54999941793935, 192.98714354222784, 201.82763699380106, 212.34715809303057, 224.9044206893791,
    239.97296392542074, 258.18857781106595, 280.4219541507748, 270.37615817690624, 0.0, -12.508438110980954,
    -12.848831713001832, -13.19022169786474, -13.532473969873644, -13.875450472573956, -14.219009254053393,
    -14.563004567335868, -14.907286968980749, -15.251703421645507, -15.59609742943095, -15.940309168731787,
    -16.284175633038167, -16.62753079125614, -16.97020575748027, -17.312028964439083, -17.652826357838578,
    -17.99242160741067, -18.330636306731364, -18.667290200985583, -19.002201417253815, -19.335186711979897,
    -19.666061723963047, -19.994641224428957, -20.320739401874146, -20.644170123116336, -20.96474722962772,
    -21.282284821870597, -21.596597550278517, -21.90750092937282, -22.214811624459262, -22.518347782205733,
    -22.817929316090137, -23.11337823078395, -23.404518938258, -23.69117855723806, -23.973187233817203,
    -24.250378441423415, -24.522589283618345, -24.789660801546358, -25.051438264457904, -25.307771447085127,
    -25.55851491987418, -25.80352831919832, -26.042676597549075, -26.275830285924535, -26.502865734328335,
    -26.723665331617116, -26.938117718343964, -27.14611799409123, -27.347567897952786, -27.542375983190222,
    -27.73045777526016, -27.91173589905598, -28.08614020916233, -28.25360790224433, -28.414083589882637,
    -28.56751937071451, -28.71387489578294, -28.85311738837905, -28.98522167156894, -29.110170158254377,
    -29.22795283104022, -29.338567212278583, -29.44201831148151, -29.53831854534541, -29.627487650083275,
    -29.709552591417793, -29.78454742953182, -29.852513193886782, -29.913497733249493, -29.97102538500028,
])


def _table_flyweights_lift(x):
    """Table flyweights_lift [1]: radial lift of the rollers per sheave travel, held beyond the ends."""
    return _curve(x, _table_flyweights_lift_x, _table_flyweights_lift_v, _table_flyweights_lift_d)


_table_secondary_radius_at_x = np.array([
    0.02459625, 0.025423213226, 0.026250176451, 0.027077139677, 0.027904102903, 0.028731066128, 0.029558029354,
    0.03038499258, 0.031211955805, 0.032038919031, 0.032865882257, 0.033692845482, 0.034519808708, 0.035346771934,
    0.036173735159, 0.037000698385, 0.037827661611, 0.038654624836, 0.039481588062, 0.040308551288, 0.041135514513,
    0.041962477739, 0.042789440965, 0.04361640419, 0.044443367416, 0.045270330642, 0.046097293867, 0.046924257093,
    0.047751220319, 0.048578183544, 0.04940514677, 0.050232109996, 0.051059073221, 0.051886036447, 0.052712999673,
    0.053539962898, 0.054366926124, 0.05519388935, 0.056020852576, 0.056847815801, 0.057674779027, 0.058501742253,
    0.059328705478, 0.060155668704, 0.06098263193, 0.061809595155, 0.062636558381, 0.063463521607, 0.064290484832,
    0.065117448058, 0.065944411284, 0.066771374509, 0.067598337735, 0.068425300961, 0.069252264186, 0.070079227412,
    0.070906190638, 0.071733153863, 0.072560117089, 0.073387080315, 0.07421404354,
])
_table_secondary_radius_at_v = np.array([
    0.096057559896, 0.09550407004, 0.094945959866, 0.094383191933, 0.093815728083, 0.09324352942, 0.092666556295,
    0.092084768288, 0.09149812419, 0.090906581983, 0.090310098816, 0.089708630994, 0.089102133947, 0.088490562213,
    0.087873869412, 0.087252008227, 0.086624930374, 0.085992586579, 0.085354926552, 0.084711898957, 0.084063451387,
    0.083409530331, 0.082750081145, 0.082085048022, 0.081414373952, 0.080738000697, 0.080055868747, 0.079367917288,
    0.078674084159, 0.077974305817, 0.07726851729, 0.076556652135, 0.075838642396, 0.075114418549, 0.074383909462,
    0.073647042334, 0.07290374265, 0.072153934119, 0.071397538618, 0.070634476131, 0.069864664683, 0.069088020276,
    0.068304456821, 0.067513886058, 0.066716217487, 0.065911358286, 0.065099213224, 0.064279684579, 0.063452672041,
    0.062618072617, 0.061775780534, 0.060925687126, 0.060067680726, 0.059201646549, 0.058327466566, 0.057445019376,
    0.056554180068, 0.055654820079, 0.054746807036, 0.053830004602, 0.052904272303,
])
_table_secondary_radius_at_d = np.array([
    -0.6665105283184096, -0.672086007918799, -0.6776956443343157, -0.6833509863227346, -0.6890529147622757,
    -0.6948023298486333, -0.7006001529333354, -0.7064473284256978, -0.7123448211589233, -0.7182936237986096,
    -0.7242947515613929, -0.7303492423515247, -0.7364581644461317, -0.7426226134331417, -0.7488437094718138,
    -0.7551226036052319, -0.7614604803485489, -0.7678585510884552, -0.7743180623961567, -0.7808402955494732,
    -0.7874265640442061, -0.7940782202628934, -0.8007966537191405, -0.8075832933177761, -0.8144396087553233,
    -0.8213671128510661, -0.8283673614814564, -0.8354419572638824, -0.8425925515568133, -0.8498208422040091,
    -0.8571285823739274, -0.8645175776026119, -0.8719896888959711, -0.8795468363026478, -0.8871910024490464,
    -0.8949242309422233, -0.9027486315596318, -0.9106663865693579, -0.9186797478691197, -0.9267910430033677,
    -0.9350026791995217, -0.9433171451955839, -0.9517370157536595, -0.9602649574445117, -0.9689037298345589,
    -0.9776561911556813, -0.9865253035524679, -0.9955141391301917, -1.0046258825071677, -1.0138638361274934,
    -1.0232314311816135, -1.032732228822815, -1.0423699279895478, -1.052148376407881, -1.0620715715744704,
    -1.0721436736014776, -1.082369013840016, -1.0927521010326293, -1.103297634478274, -1.1140105130991274,
    -1.1248350639191165,
])


def _table_secondary_radius_at(x):
    """Table secondary_radius_at [m]: secondary radius that keeps the length of the belt, against the primary radius, held beyond the ends."""
    return _curve(x, _table_secondary_radius_at_x, _table_secondary_radius_at_v, _table_secondary_radius_at_d)


_table_wrap_ratio_x = np.array([
    0.02459625, 0.025423213226, 0.026250176451, 0.027077139677, 0.027904102903, 0.028731066128, 0.029558029354,
    0.03038499258, 0.031211955805, 0.032038919031, 0.032865882257, 0.033692845482, 0.034519808708, 0.035346771934,
    0.036173735159, 0.037000698385, 0.037827661611, 0.038654624836, 0.039481588062, 0.040308551288, 0.041135514513,
    0.041962477739, 0.042789440965, 0.04361640419, 0.044443367416, 0.045270330642, 0.046097293867, 0.046924257093,
    0.047751220319, 0.048578183544, 0.04940514677, 0.050232109996, 0.051059073221, 0.051886036447, 0.052712999673,
    0.053539962898, 0.054366926124, 0.05519388935, 0.056020852576, 0.056847815801, 0.057674779027, 0.058501742253,
    0.059328705478, 0.060155668704, 0.06098263193, 0.061809595155, 0.062636558381, 0.063463521607, 0.064290484832,
    0.065117448058, 0.065944411284, 0.066771374509, 0.067598337735, 0.068425300961, 0.069252264186, 0.070079227412,
    0.070906190638, 0.071733153863, 0.072560117089, 0.073387080315, 0.07421404354,
])
_table_wrap_ratio_v = np.array([
    0.666525407179, 0.672090145051, 0.677699729137, 0.683355019083, 0.689056894513, 0.694806255713, 0.700604024353,
    0.706451144229, 0.712348582037, 0.718297328181, 0.72429839761, 0.730352830691, 0.736461694118, 0.742626081861,
    0.748847116155, 0.755125948525, 0.761463760866, 0.767861766563, 0.77432121166, 0.780843376087, 0.787429574935,
    0.794081159795, 0.800799520152, 0.80758608485, 0.814442323623, 0.821369748696, 0.828369916464, 0.835444429251,
    0.842594937159, 0.849823140001, 0.857130789331, 0.864519690581, 0.8719917053, 0.879548753508, 0.887192816178,
    0.894925937833, 0.9027502293, 0.910667870587, 0.918681113936, 0.926792287027, 0.935003796363, 0.943318130846,
    0.951737865543, 0.960265665679, 0.968904290849, 0.977656599471, 0.986525553515, 0.995514223493, 1.004625793761,
    1.013863568135, 1.023230975856, 1.032731577919, 1.042369073807, 1.052147308641, 1.062070280801, 1.072142150035,
    1.082367246104, 1.092750078006, 1.103295343815, 1.114007941205, 1.124892978691,
])
_table_wrap_ratio_d = np.array([
    6.702008731878797, 6.756129916587493, 6.810876371935753, 6.866674316266334, 6.923548329474116, 6.981523816372221,
    7.0406270789970415, 7.100885348718515, 7.1623267876086425, 7.224980564638429, 7.2888768957145516, 7.354047047669965,
    7.420523423260823, 7.488339610354874, 7.557530387284098, 7.628131817874851, 7.700181309838325, 7.773717626764521,
    7.848780993991444, 7.925413163673507, 8.003657439420586, 8.083558790707508, 8.165163929939553, 8.248521351031325,
    8.333681455274156, 8.420696641810395, 8.509621357483667, 8.600512244560733, 8.693428247078543, 8.788430673054863,
    8.88558336418769, 8.984952823430358, 9.086608297386212, 9.190621971085408, 9.297069116250546, 9.406028205049243,
    9.517581129191557, 9.631813375873913, 9.748814202391301, 9.868676836186808, 9.991498722674608, 10.117381762843092,
    10.246432510237092, 10.378762494493904, 10.514488500857029, 10.65373282546305, 10.796623656003707, 10.9432954194276,
    11.093889101049673, 11.248552703192491, 11.407441677924886, 11.570719329770041, 11.738557372439123,
    11.911136466539068, 12.088646734590325, 12.271288442724932, 12.459272676451173, 12.652821994559796,
    12.852171280233744, 13.05756859054139, 13.266923133644037,
])


def _table_wrap_ratio(x):
    """Table wrap_ratio [1]: wrap angle of the primary over that of the secondary, against the primary radius, held beyond the ends."""
    return _curve(x, _table_wrap_ratio_x, _table_wrap_ratio_v, _table_wrap_ratio_d)


def rhs(t, x, u, theta):
    """dx/dt, shape (n_x, *batch)."""
    omega_engine = x[0]
    x_sheave = x[1]
    omega_wheel = x[2]
    throttle = u[0]
    engine_inertia = theta[0]
    sheave_angle = theta[1]
    primary_spring_rate = theta[2]
    primary_spring_preload = theta[3]
    belt_clearance = theta[4]
    longest_travel = theta[5]
    stop_stiffness = theta[6]
    shift_damping = theta[7]
    flyweight_mass = theta[8]
    belt_edge = theta[9]
    primary_radius_rest = theta[10]
    secondary_radius_rest = theta[11]
    secondary_spring_rate = theta[12]
    secondary_spring_preload = theta[13]
    torsion_spring_rate = theta[14]
    torsion_spring_pretension = theta[15]
    helix_angle = theta[16]
    helix_radius = theta[17]
    helix_torque_share = theta[18]
    traction = theta[19]
    slip_speed = theta[20]
    gear_reduction = theta[21]
    tyre_radius = theta[22]
    J_wheels = theta[23]
    J_secondary = theta[24]
    m_vehicle = theta[25]
    rolling_force = theta[26]
    creep_speed = theta[27]
    drag_area = theta[28]
    air_density = theta[29]
    tau_combustion = throttle*_table_engine_torque(omega_engine)  # [N m] effort of combustion
    m_flyweights = flyweight_mass*omega_engine*_table_flyweights_lift(x_sheave)*_table_flyweights_radius(x_sheave)  # modulus of flyweights
    F_primary_spring = primary_spring_rate*(primary_spring_preload + x_sheave) + stop_stiffness*np.maximum(x_sheave - belt_clearance - longest_travel, 0.0) - stop_stiffness*np.maximum(-x_sheave, 0.0)  # [N] effort of primary_spring
    belt_travel = x_sheave - belt_clearance  # [m] sheave travel since it met the belt
    contact = np.minimum(np.maximum(belt_travel/belt_edge + 1, 0.0), 1.0)  # [1] share of the axial load on the belt
    primary_radius = primary_radius_rest + np.maximum(belt_travel, 0.0)/np.tan(sheave_angle)  # [m] effective radius of the primary
    secondary_radius = _table_secondary_radius_at(primary_radius)  # [m] effective radius of the secondary
    secondary_opening = np.tan(sheave_angle)*(secondary_radius_rest - secondary_radius)  # [m] travel of the secondary sheave from its rest
    secondary_spring_force = secondary_spring_rate*(secondary_spring_preload + secondary_opening) + torsion_spring_rate*(torsion_spring_pretension + secondary_opening/(helix_radius*np.tan(helix_angle)))/(helix_radius*np.tan(helix_angle))  # [N] axial force of both springs of the secondary
    belt_friction = 2*traction/np.cos(sheave_angle)  # [1] belt force per clamp force in full slip
    feedback_gain = helix_torque_share*secondary_radius/(helix_radius*np.tan(helix_angle))  # [1] helix force per belt force
    primary_clamp = np.maximum(flyweight_mass*omega_engine**2*_table_flyweights_lift(x_sheave)*_table_flyweights_radius(x_sheave) - primary_spring_rate*(primary_spring_preload + x_sheave), 0.0)*np.minimum(5*contact, 1.0)  # [N] clamp force of the primary
    drive_limit = belt_friction*np.minimum(primary_clamp, secondary_spring_force/np.maximum(1 - belt_friction*feedback_gain, 0.001))  # [N] belt force in full slip, driving
    omega_secondary = gear_reduction*omega_wheel  # [rad/s] flow of secondary
    overrun_limit = belt_friction*np.minimum(primary_clamp, secondary_spring_force)  # [N] belt force in full slip, overrun
    F_belt = drive_limit*np.tanh(np.maximum(omega_engine*primary_radius - secondary_radius*omega_secondary, 0.0)/slip_speed) + overrun_limit*np.tanh(np.minimum(omega_engine*primary_radius - secondary_radius*omega_secondary, 0.0)/slip_speed)  # [N] effort of belt
    F_helix = -feedback_gain*np.maximum(F_belt, 0.0)  # [N] effort of helix
    v_shift = (omega_engine*m_flyweights - F_primary_spring - contact*_table_wrap_ratio(primary_radius)*(secondary_spring_force - F_helix))/shift_damping  # [m/s] flow of shift
    v_body = tyre_radius*omega_wheel  # [m/s] flow of body
    F_rolling = rolling_force*np.tanh(v_body/creep_speed)  # [N] effort of rolling
    F_aero = (1/2)*drag_area*air_density*v_body*np.abs(v_body)  # [N] effort of aero
    tau_wheel_inertia_part = -J_secondary*gear_reduction**2/J_wheels - m_vehicle*tyre_radius**2/J_wheels  # part of effort of wheel_inertia
    d_omega_wheel = (gear_reduction*secondary_radius*F_belt - tyre_radius*(F_rolling + F_aero))/(J_wheels*(1 - tau_wheel_inertia_part))  # rate of flow of wheel_inertia
    dx0 = (tau_combustion - primary_radius*F_belt - m_flyweights*v_shift)/engine_inertia  # d(omega_engine)/dt
    dx1 = v_shift  # d(x_sheave)/dt
    dx2 = d_omega_wheel  # d(omega_wheel)/dt
    return _stack(x, (dx0, dx1, dx2))


def output(t, x, u, theta):
    """y, shape (n_y, *batch)."""
    omega_engine = x[0]
    omega_wheel = x[2]
    y0 = omega_engine  # engine_speed [rad/s]
    y1 = omega_wheel  # wheel_speed [rad/s]
    return _stack(x, (y0, y1))


def _stack(x, rows):
    """Rows, each a number or of the batch shape of x, as one array of shape (len(rows), *batch)."""
    stacked = np.empty((len(rows), *x.shape[1:]))
    for i, row in enumerate(rows):
        stacked[i] = row
    return stacked
