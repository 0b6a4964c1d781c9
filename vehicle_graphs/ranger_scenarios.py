"""Manoeuvres of the Ranger, and what an engineer looks at in them.

The first six are those of the reference trajectories. All start at rest at idle with the belt released, if not said
otherwise; gear H, level ground.
"""

from __future__ import annotations

from math import radians

from bondgraph.simulate.scenario import Panel, Scenario

#: Rolling at 15 m/s on tyres of the default radius.
ROLLING = {"forward_velocity": 15.0, "rear_axle_speed": 15.0 / 0.315, "front_axle_speed": 15.0 / 0.315}

#: Manoeuvres by name.
SCENARIOS = {
    "full_throttle_launch": Scenario(
        "standstill, full throttle at 0.5 s", 30.0, {"throttle": [(0.5, 0.0), (0.6, 1.0)]}
    ),
    "part_throttle_steps": Scenario(
        "throttle in steps of 0.10, 0.20, 0.35, 0.15, 0.05", 60.0,
        {"throttle": [
            (1.0, 0.0), (3.0, 0.1), (15.0, 0.1), (15.5, 0.2), (27.0, 0.2), (27.5, 0.35), (40.0, 0.35), (40.5, 0.15),
            (50.0, 0.15), (50.5, 0.05),
        ]},
    ),
    "neutral_coast_down": Scenario("neutral from 15 m/s to rest", 45.0, {"gear": "N"}, ROLLING),
    "brake": Scenario(
        "launch, then brake 0.5, 0.2, 0.8, 0.3 to standstill", 20.0,
        {
            "throttle": [(0.5, 0.0), (1.0, 0.6), (8.0, 0.6), (8.2, 0.0)],
            "brake": [
                (9.0, 0.0), (9.2, 0.5), (10.0, 0.5), (10.2, 0.2), (11.5, 0.2), (11.7, 0.8), (13.5, 0.8), (14.0, 0.3),
            ],
        },
    ),
    "hill": Scenario(
        "the slope rises to 10 degrees and falls again, part and full throttle", 50.0,
        {
            "throttle": [(0.5, 0.0), (1.0, 0.7), (5.0, 0.7), (6.0, 1.0), (30.0, 1.0), (31.0, 0.4)],
            "inclination_rate": [
                (4.0, 0.0), (6.5, radians(4.0)), (9.0, 0.0), (32.0, 0.0), (35.0, -radians(10 / 3)), (38.0, 0.0),
            ],
        },
    ),
    "lift_off": Scenario(
        "full throttle, lift-off at speed, part throttle, lift-off", 45.0,
        {"throttle": [
            (0.5, 0.0), (0.6, 1.0), (12.0, 1.0), (12.1, 0.0), (26.0, 0.0), (26.5, 0.4), (32.0, 0.4), (32.2, 0.0),
        ]},
    ),
    "idle": Scenario("idle with the belt released", 10.0, {}),
    "throttle_ramp": Scenario("throttle opens by 0.01 per second", 30.0, {"throttle": [(0.0, 0.0), (30.0, 0.3)]}),
    "fast_throttle_ramp": Scenario("throttle opens by 0.02 per second", 20.0, {"throttle": [(0.0, 0.0), (20.0, 0.4)]}),
    "hill_start": Scenario(
        "full throttle from rest on a slope of 10 degrees", 40.0,
        {"throttle": [(0.0, 0.0), (0.1, 1.0)]}, {"inclination": radians(10.0)},
    ),
    "half_brake": Scenario(
        "half brake from 15 m/s in neutral", 4.0, {"gear": "N", "brake": [(0.5, 0.0), (0.6, 0.5)]}, ROLLING
    ),
    "engine_braking": Scenario(
        "lift-off at 21 m/s in gear", 60.0, {"throttle": [(0.5, 0.0), (0.6, 1.0), (14.0, 1.0), (14.1, 0.0)]}
    ),
    "reverse": Scenario("reverse at part throttle", 12.0, {"gear": "R", "throttle": [(0.5, 0.0), (1.0, 0.2)]}),
}  # fmt: skip

#: The picture of a manoeuvre, from the engine to the ground.
PANELS = (
    Panel("engine speed", "rpm", {"engine": "engine_speed"}),
    Panel("speeds", "km/h", {"vehicle": "forward_velocity", "rear tyres": "v_tyre_r", "front tyres": "v_tyre_f"}),
    Panel("CVT ratio", "1", {"r_s/r_p": "ratio"}),
    Panel("forces", "kN", {"primary clamp": "F_p", "secondary clamp": "F_s", "belt": "F_b"}),
    Panel("slip", "m/s", {"belt": "slip", "rear tyres": "v_slip_r", "front tyres": "v_slip_f"}),
    Panel("pitch of the body", "deg", {"pitch": "pitch"}),
)
