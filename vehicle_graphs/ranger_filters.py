"""Filters of the Ranger: its sensors, its road, and how finely the models must be integrated between two samples.

The coast-down filter serves the runs in neutral, the full filter everything. The inclination of the road is a random
walk, the only process noise: what the vehicle does between two samples follows from its inputs.
"""

from __future__ import annotations

from bondgraph.filter.noise import Noise

#: Standard deviations of the sensors [rad/s, rad/s, m/s, m, rad].
SENSORS = {"engine_speed": 2.0, "axle_speed": 0.1, "forward_velocity": 0.05, "height": 0.05, "pitch": 0.003}
#: With one like it at the front axle, rad/s.
BOTH_AXLES = {**SENSORS, "front_axle_speed": SENSORS["axle_speed"]}

#: The random walk of the inclination, rad per sqrt(s). A road is smoother than any random walk; at this intensity the
#: predictions of the recorded coast-downs are as uncertain as they are wrong (with estimated parameters NIS 0.99 and
#: 1.00; at 0.005 they would be 1.03 and 1.04, at 0.01 0.95 and 0.96). The same road passes faster under a drive, where
#: 0.012 is the likeliest (``vehicle_graphs.ranger_recorded`` estimates it with the driveline).
INCLINATION_WALK = 0.007

#: What is not known at the first sample: speeds as their sensors read them, a body at rest on its springs.
START = {
    "engine_speed": 2.0, "rear_axle_speed": 0.1, "front_axle_speed": 0.5, "forward_velocity": 0.05, "height": 0.05,
    "inclination": 0.02, "heave": 0.002, "heave_rate": 0.02, "pitch": 0.004, "pitch_rate": 0.02,
    "sheave_displacement": 1e-4,
}  # fmt: skip

#: Samples come at 40 Hz. Fixed steps of Runge-Kutta 4 are stable to 2.78 over the fastest rate: 3600 1/s of the rear
#: tyre at standstill in neutral, up to 12000 1/s of the gripping belt.
_COASTING = Noise(SENSORS, {"inclination": INCLINATION_WALK}, START, substeps=40)
_DRIVING = Noise(SENSORS, {"inclination": INCLINATION_WALK}, START, substeps=120)
_MONITORED = Noise(BOTH_AXLES, {"inclination": INCLINATION_WALK}, START, substeps=120)

#: By name of the graph.
NOISE = {
    "ranger_full": _DRIVING,
    "ranger_full_awd": _DRIVING,
    "ranger_monitored": _MONITORED,
    "ranger_coast_down": _COASTING,
    "ranger_coast_down_quasi_static": _COASTING,
}
