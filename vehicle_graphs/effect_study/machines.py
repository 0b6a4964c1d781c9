"""The machines of the study: the utility vehicle with its CVT, and a driveline on a bench that is quick to simulate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from bondgraph import effects
from bondgraph.correct.loop import LoopSettings
from bondgraph.data.log import FloatArray
from bondgraph.declare.effect import Scale, effect_functions
from bondgraph.effects import sensors
from bondgraph.simulate.batch import simulate_batch
from bondgraph.simulate.model import Model
from vehicle_graphs import ranger
from vehicle_graphs.demo import SENSOR_NOISE
from vehicle_graphs.driveline import driveline
from vehicle_graphs.effect_study.machine import Kind, StudyMachine
from vehicle_graphs.ranger_filters import SENSORS

#: Losses that grow with speed come near each other at the speeds of a drive; so do those that grow with the load.
_WITH_SPEED = ("viscous_loss", "quadratic_loss", "rolling_speed_loss", "headwind", "warm_up_loss", "stribeck_loss")
_WITH_LOAD = ("torque_proportional_loss", "directional_loss")


def _others(name: str, family: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(other for other in family if other != name)


def bench_drive(model: Model, time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Torque in steps of some seconds with ramps between and overrun now and then, on a rolling road of known profile.

    Examples
    --------
    >>> u = bench_drive(BENCH.model()[0], np.arange(0.0, 30.0, 0.05), np.random.default_rng(1))
    >>> u.shape, bool(abs(u[1]).max() < 0.04)
    ((2, 600), True)
    """
    knots = np.arange(0.0, time[-1] + 6.0, 3.0)
    levels = rng.uniform(12.0, 55.0, knots.size)
    overrun = rng.uniform(size=knots.size) < 0.2
    overrun[0] = False  # a drive begins settled at its first level
    levels[overrun] = -8.0
    torque = np.interp(time, np.sort(np.concatenate([knots, knots + 2.2])), np.repeat(levels, 2))
    periods, phases = np.array([37.0, 19.0, 11.0]), rng.uniform(0.0, 2.0 * np.pi, 3)
    grade = np.array([0.02, 0.012, 0.006]) @ np.sin(2.0 * np.pi * time / periods[:, np.newaxis] + phases[:, np.newaxis])
    return np.array([torque, grade])


def vehicle_drive(model: Model, time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Throttle of changing size with lift-offs, and the brake now and then, in high gear."""
    knots = np.arange(0.0, time[-1] + 5.0, 2.5)
    throttle = rng.uniform(0.1, 0.9, knots.size) * (rng.random(knots.size) > 0.2)
    throttle[:2] = 0.0, 0.6  # from rest, at idle
    pressed = np.interp(time, knots, throttle)
    stops = np.where(rng.random(knots.size) > 0.85, rng.uniform(0.05, 0.2, knots.size), 0.0)
    u = np.repeat(model.u0()[:, np.newaxis], time.size, axis=1)
    u[model.index("input", "throttle")] = pressed
    u[model.index("input", "brake")] = np.where(pressed < 0.05, np.interp(time, knots, stops), 0.0)
    return u


#: Waves of a road, each with its longest and shortest wavelength in m and the standard deviation of its slope: hills,
#: and waves that pitch the body. Lengths are those of the logs of another simulator, ``ranger_logs``.
_HILLS, _WAVES = (600.0, 100.0, np.radians(2.0)), (15.0, 4.0, np.radians(0.5))


def road_drive(model: Model, time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A drive as :func:`vehicle_drive` over hills and waves: the inclination's rate is that at level ground's speed.

    A wave that a vehicle passes at 0 to 20 m/s is no random walk of the inclination, nor white at any time scale.
    """
    u = vehicle_drive(model, time, rng)
    level = simulate_batch(model, time, u, model.theta(), model.x0(), method=RANGER.method, substeps=RANGER.substeps)
    speed = level.x[model.index("state", "forward_velocity"), :, 0]
    way = cumulative_trapezoid(speed, time, initial=0.0)
    rise = np.zeros(time.size)
    for longest, shortest, std in (_HILLS, _WAVES):
        numbers = 2.0 * np.pi / np.geomspace(longest, shortest, 12)
        phases = rng.uniform(0.0, 2.0 * np.pi, numbers.size)
        turned = np.cos(np.outer(way, numbers) + phases) @ numbers  # of slopes by the way
        rise += std * np.sqrt(2.0 / numbers.size) * speed * turned
    u[model.index("input", "inclination_rate")] = rise
    return u


#: What is not among them: friction of constant size on the body and viscous friction anywhere, which the free friction
#: of engine and tyres imitates; a constant load on the body, which rolling resistance is as long as the vehicle rolls
#: forwards.
BENCH = StudyMachine(
    name="bench",
    graph=driveline,
    functions=effect_functions(effects),
    kinds=(
        Kind(effects.coulomb_loss, "axle", 10.0, in_part=True),
        Kind(effects.quadratic_loss, "body", 0.05, relatives=_others("quadratic_loss", _WITH_SPEED), outside=True),
        Kind(
            effects.rolling_speed_loss, "body", 200.0, relatives=_others("rolling_speed_loss", _WITH_SPEED)
        ),
        Kind(effects.torque_proportional_loss, "axle", 0.02, relatives=_others("torque_proportional_loss", _WITH_LOAD)),
        Kind(effects.directional_loss, "axle", 0.05, ratios=(0.2,)),
        Kind(effects.added_inertia, "body", 20.0, outside=True, in_part=True),
        Kind(effects.actuator_scale, "primary", -0.02, in_part=True),
        Kind(effects.constant_effort, "primary", -0.5),
        Kind(effects.slip, "belt", 1e-4, relatives=("creep",)),
        Kind(effects.centrifugal_tension, "belt", 1e-6, outside=True),
        Kind(effects.stribeck_loss, "axle", 20.0, ratios=(0.3,), shapes=(10.0,)),
        Kind(effects.warm_up_loss, "primary", 0.01, shapes=(15.0,), relatives=("viscous_loss",)),
        Kind(effects.headwind, "body", 0.5, relatives=_others("headwind", _WITH_SPEED)),
        Kind(effects.actuator_lag, "primary", 0.03, outside=True),
        Kind(effects.added_compliance, "wheel -> tyre", 1e-4, shapes=(1.0,)),
        Kind(effects.backlash, "twist", 0.002, largest=0.2),
    ),
    faults=tuple(
        Kind(fault, output, guess)
        for output, sizes in {
            "engine_speed": (1.0, 0.01, 0.05, 0.02),
            "axle_speed": (0.1, 0.01, 0.005, 0.02),
            "shaft_torque": (4.0, 0.02, 0.1, 0.05),
            "speed": (0.05, 0.01, 0.002, 0.02),
        }.items()
        for fault, guess in zip(
            (sensors.sensor_bias, sensors.sensor_scale, sensors.sensor_drift, sensors.sensor_delay), sizes, strict=True
        )
    ),
    pairs=(
        (Kind(effects.quadratic_loss, "body", 0.05), Kind(effects.slip, "belt", 1e-4)),
        (Kind(effects.coulomb_loss, "axle", 10.0), Kind(effects.actuator_scale, "primary", -0.02)),
        (Kind(effects.added_inertia, "body", 20.0), Kind(sensors.sensor_scale, "axle_speed", 0.01)),
    ),
    masking=(
        (Kind(effects.actuator_scale, "primary", 0.02), Kind(effects.torque_proportional_loss, "axle", 0.02)),
        (Kind(effects.added_inertia, "body", 20.0), Kind(effects.actuator_scale, "primary", 0.02)),
    ),
    noise=SENSOR_NOISE,
    excite=bench_drive,
    scale=Scale(400.0, 20.0),
    rate=20.0,
    seconds=30.0,
    train=1,
    settle=20.0,
    substeps=8,
)  # fmt: skip

#: Estimated are engine and clutches; what coast-downs tell (rolling resistance, drag, brakes, tyre radius) is known.
#: Effects that change the law of an element (headwind, centrifugal tension) are not among them, for its elements are
#: parts; nor creep or slip of the belt, whose clamp grows with its force: that closes a nonlinear loop, which cannot be
#: solved from everywhere; nor friction with hysteresis at the sheave, which with a scale that serves all places would
#: give way by metres before it slides.
RANGER = StudyMachine(
    name="ranger",
    graph=ranger.full,
    functions=effect_functions(effects),
    kinds=(
        Kind(
            effects.quadratic_loss, "body.forward", 0.2, relatives=_others("quadratic_loss", _WITH_SPEED), outside=True
        ),
        Kind(effects.coulomb_loss, "rear_axle.hub", 20.0, in_part=True),
        Kind(effects.viscous_loss, "gearbox.shaft", 0.01, relatives=_others("viscous_loss", _WITH_SPEED)),
        Kind(effects.torque_proportional_loss, "gearbox.shaft", 0.03),
        Kind(effects.added_inertia, "body.forward", 60.0, in_part=True),
        Kind(effects.creep, "rear_tyre.contact", 1e-4, outside=True),
        Kind(effects.coulomb_loss, "primary.sheave", 100.0),
        Kind(effects.stribeck_loss, "rear_axle.hub", 60.0, ratios=(0.3,), shapes=(4.0,)),
        Kind(effects.directional_loss, "gearbox.shaft", 0.3, ratios=(0.2,)),
        Kind(effects.constant_effort, "body.forward", 50.0),
        Kind(effects.viscous_loss, "engine.crank", 0.003, relatives=_others("viscous_loss", _WITH_SPEED)),
        Kind(effects.warm_up_loss, "engine.crank", 0.01, shapes=(20.0,), relatives=("viscous_loss",)),
        Kind(effects.added_inertia, "engine.crank", 0.01),
        Kind(effects.rolling_speed_loss, "body.forward", 50.0, relatives=_others("rolling_speed_loss", _WITH_SPEED)),
        Kind(effects.added_compliance, "gearbox.output -> rear_axle.hub", 1e-4, shapes=(2.5,)),
    ),
    faults=tuple(
        Kind(fault, output, guess)
        for output, sizes in {
            "engine_speed": (4.0, 0.02, 0.2, 0.03),
            "axle_speed": (0.2, 0.01, 0.01, 0.03),
            "forward_velocity": (0.1, 0.01, 0.005, 0.03),
        }.items()
        for fault, guess in zip(
            (sensors.sensor_bias, sensors.sensor_scale, sensors.sensor_drift, sensors.sensor_delay), sizes, strict=True
        )
    ),
    pairs=((Kind(effects.quadratic_loss, "body.forward", 0.2), Kind(effects.creep, "rear_tyre.contact", 1e-4)),),
    masking=((Kind(effects.added_inertia, "body.forward", 60.0), Kind(sensors.sensor_scale, "axle_speed", 0.01)),),
    noise=SENSORS,
    excite=vehicle_drive,
    scale=Scale(1000.0, 20.0),
    rate=20.0,
    seconds=45.0,
    train=1,
    settle=2.0,
    substeps=48,
    method="rodas4",
    sizing=8,
    settings=LoopSettings(free=("T_pk", "T_f0", "k_u", "m_fw", "F_p0", "k_p", "r_h", "mu_b")),
)  # fmt: skip

#: The same on a road that nothing measures, everything free that has bounds.
ROAD = replace(
    RANGER, name="road", excite=road_drive, rate=40.0, seconds=60.0, substeps=24, sizing=8, settings=LoopSettings(),
    hidden=("inclination_rate",),
)  # fmt: skip

#: By the name on the command line.
MACHINES = {machine.name: machine for machine in (RANGER, ROAD, BENCH)}
