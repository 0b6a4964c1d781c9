"""Faults of sensors: what a sensor shows beside what it should, as effects that change an output of the graph.

Those of ``SENSOR_FAULTS`` are candidates beside missing physics, tried on every measured output; the others are tried
where they are asked for. A fault is told from missing physics only as far as other sensors contradict it. Reference:
Isermann (2006), Fault-Diagnosis Systems; Blanke, Kinnaert, Lunze, Staroswiecki (2016), Diagnosis and Fault-Tolerant
Control.
"""

from __future__ import annotations

import math

from sympy import Abs, cos, sin

from bondgraph.coherent import coherent
from bondgraph.declare.effect import Effect, EffectFunction, Place, sensor_fault
from bondgraph.declare.functions import clip
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.declare.revision import revise_output
from bondgraph.effects.places import DELAY_LAW, PADE, delayed, lateness, over
from bondgraph.effects.ranges import ceiling, floor, sharpness
from bondgraph.errors import DeclarationError

_INSTRUMENT = "Doebelin (2003), Measurement Systems, chapter 3, instruments of first order"
_RADIATION = "DeWitt, Nutter (1988), Theory and Practice of Radiation Thermometry, radiation of surroundings"
_ENCODER = "de Silva (2007), Sensors and Actuators: Control System Instrumentation, errors of optical encoders"
#: Angles over which an eccentric disc shows, and its largest error [rad]: what is more would not be mounted.
_HALF_TURN, _LARGEST_ERROR = math.pi, 0.3
_REFERENCE = "Isermann (2006), Fault-Diagnosis Systems"


@sensor_fault
def sensor_bias(g: BondGraph, at: Place) -> Effect | None:
    """A constant that the sensor adds: a zero that was not set, an inclined mounting."""
    unit, one = _shown_unit(g, at)
    limit = 2.0 * at.scale.effort / one
    bias = g.parameter(f"bias_{at.name}", 0.0, unit, f"bias of {at.output}", (-limit, limit))
    revise_output(g, at.output, lambda shown: shown + bias)
    return _fault("bias", at, "shown = true + b", bias.name, "rest")


@sensor_fault
def sensor_scale(g: BondGraph, at: Place) -> Effect | None:
    """A wrong factor: a tyre radius, a number of teeth, an amplifier."""
    error = g.parameter(f"scale_{at.name}", 0.0, "1", f"relative error of scale of {at.output}", (-0.6, 0.6))
    revise_output(g, at.output, lambda shown: (1 + error) * shown)
    return _fault("scale", at, "shown = (1 + s)*true", error.name, "small and large values")


@sensor_fault
def sensor_drift(g: BondGraph, at: Place) -> Effect | None:
    """A value that wanders off evenly with time: a strain gauge that warms up, an integrated offset."""
    unit, one = _shown_unit(g, at)
    limit = 0.5 * at.scale.effort / one
    drift = g.parameter(f"drift_{at.name}", 0.0, f"{unit}/s" if unit else "", f"drift of {at.output}", (-limit, limit))
    revise_output(g, at.output, lambda shown: shown + drift * symbol("t"))
    return _fault("drift", at, "shown = true + d*t", drift.name, "rest at both ends of a long log")


@sensor_fault
def sensor_delay(g: BondGraph, at: Place) -> Effect | None:
    """A value that comes late: a filter in the amplifier, a slow bus; by two states, see :func:`delayed`."""
    name = f"delay_{at.name}"
    shown = next(output.expression for output in g.outputs if output.name == at.output)
    start, bounds = lateness(at)
    delay = g.parameter(name, start, "s", f"time by which {at.output} comes late", bounds)
    revise_output(g, at.output, delayed(g, at.name, shown, delay, _unit(g, at), at.output))
    return Effect(
        "sensor_delay", at.output, f"shown(t) = true(t - T), {DELAY_LAW}", (name,), adds_state=True,
        amplitudes=(0.4, 0.7), reference=PADE, channel=at.output, kind="delay", manoeuvre="quick changes",
    )  # fmt: skip


@sensor_fault
def sensor_lag(g: BondGraph, at: Place) -> Effect | None:
    """A value that follows by a first-order lag: a thermometer in a well, a smoothing filter, a damped needle."""
    name = f"lag_{at.name}"
    shown = next(output.expression for output in g.outputs if output.name == at.output)
    start, bounds = lateness(at)
    lag = g.parameter(name, start, "s", f"time in which {at.output} follows", bounds)
    follows = g.integral(
        f"following_{at.name}",
        lambda x: (shown - x) / lag,
        _unit(g, at),
        f"{at.output} as it follows",
        initial=at.output,
    )
    revise_output(g, at.output, follows)
    return Effect(
        "sensor_lag", at.output, "shown = x, dx/dt = (true - x)/T", (name,), adds_state=True, amplitudes=(0.4, 0.7),
        reference=_INSTRUMENT, channel=at.output, kind="lag", manoeuvre="quick changes",
    )  # fmt: skip


@sensor_fault
def sensor_ceiling(g: BondGraph, at: Place) -> Effect | None:
    """A range that ends: what exceeds it is shown as its end, an amplifier's supply or a converter's last number."""
    name = f"c_ceiling_{at.name}"  # c of the law: the ceiling itself would be infinite where there is none
    unit = over("1", _unit(g, at))
    c = g.parameter(name, 0.0, unit, f"1 over the ceiling of {at.output}", (0.0, 3.0 / at.scale.effort))
    n = sharpness(g, f"sharpness_ceiling_{at.name}")
    revise_output(g, at.output, lambda shown: ceiling(shown, c, n))
    return Effect(
        "sensor_ceiling", at.output, "shown = x/(1 + |c*x|^n)^(1/n), x true", (name,), amplitudes=(0.3, 0.6),
        shapes=(n.name,), grids=((n.name, (2.0, 6.0)),), reference=_REFERENCE, channel=at.output, kind="ceiling",
        manoeuvre="values up to the end of the range",
    )  # fmt: skip


@sensor_fault
def sensor_floor(g: BondGraph, at: Place) -> Effect | None:
    """A range that does not begin at zero: a pyrometer that sees what is around, a meter of an amplitude in noise.

    The law is one of values that keep their sign; where they change it, it is a bump at zero.
    """
    unit, one = _shown_unit(g, at)
    size = at.scale.effort / one
    c = g.parameter(f"c_floor_{at.name}", 0.0, unit, f"what {at.output} shows of nothing", (0.0, size))
    of = g.parameter(f"size_floor_{at.name}", size, unit, f"size of {at.output}")
    n = sharpness(g, f"sharpness_floor_{at.name}")
    revise_output(g, at.output, lambda shown: of * floor(shown / of, c / of, n))
    return Effect(
        "sensor_floor", at.output, "shown = x + (|x|^n + c^n)^(1/n) - |x|, x true", (c.name,), amplitudes=(0.3, 0.6),
        shapes=(n.name,), grids=((n.name, (2.0, 6.0)),), reference=_RADIATION, channel=at.output, kind="floor",
        manoeuvre="values near zero and large ones",
    )  # fmt: skip


@sensor_fault
def sensor_dead_zone(g: BondGraph, at: Place) -> Effect | None:
    """A sensor that shows nothing of small values: a threshold against noise, a pick-up that needs speed."""
    name = f"dead_zone_{at.name}"
    unit, one = _shown_unit(g, at)
    b = g.parameter(name, 0.0, unit, f"what {at.output} must exceed to be seen", (0.0, at.scale.effort / one))
    revise_output(g, at.output, lambda shown: shown - clip(shown, -b, b))
    return Effect(
        "sensor_dead_zone", at.output, "shown = x - clip(x, -b, b), x true", (name,), amplitudes=(0.03, 0.1, 0.3),
        reference=_REFERENCE, channel=at.output, kind="dead zone", manoeuvre="small values of both signs",
    )  # fmt: skip


@sensor_fault
def sensor_eccentricity(g: BondGraph, at: Place) -> Effect | None:
    """An encoder whose disc is not centred on its shaft: its error comes back with every turn."""
    unit, one = _shown_unit(g, at)
    if _unit(g, at) != "rad" or at.scale.flow < _HALF_TURN:
        return None
    limits = (-_LARGEST_ERROR / one, _LARGEST_ERROR / one)
    wave, shift = (
        g.parameter(f"{of}_{at.name}", 0.0, unit, f"{of} of the angle in the error of {at.output}", limits)
        for of in ("sine", "cosine")
    )
    revise_output(g, at.output, lambda shown: shown + wave * sin(shown) + shift * (cos(shown) - 1))
    return Effect(
        "sensor_eccentricity", at.output, "shown = x + a*sin(x) + b*(cos(x) - 1), x true", (wave.name, shift.name),
        reference=_ENCODER, channel=at.output, kind="eccentricity", manoeuvre="whole turns",
    )  # fmt: skip


@sensor_fault
def sensor_magnitude(g: BondGraph, at: Place) -> Effect | None:
    """A sensor that does not see the direction: a pulse counter, a tachometer behind a rectifier."""
    name = f"magnitude_{at.name}"
    share = g.parameter(name, 0.0, "1", f"share of {at.output} shown without its sign", (0.0, 1.5))
    revise_output(g, at.output, lambda shown: (1 - share) * shown + share * Abs(shown))
    return Effect(
        "sensor_magnitude", at.output, "shown = (1 - s)*true + s*|true|", (name,), amplitudes=(0.3, 0.67),
        channel=at.output, kind="magnitude",
        reference=_REFERENCE, manoeuvre="values of both signs",
    )  # fmt: skip


@sensor_fault
def sensor_square(g: BondGraph, at: Place) -> Effect | None:
    """A sensor that shows the square of what it senses: an orifice, a rectified and smoothed oscillation, a power."""
    name = f"square_{at.name}"
    share = g.parameter(name, 0.0, "1", f"share of {at.output} shown as its square", (0.0, 1.5))
    size = g.parameter(f"true_at_{at.name}", at.scale.effort, _unit(g, at), f"where the square of {at.output} is right")
    revise_output(g, at.output, lambda shown: (1 - share) * shown + share * shown**2 / size)
    return Effect(
        "sensor_square", at.output, "shown = (1 - s)*true + s*true^2/size", (name,), amplitudes=(0.3, 0.67),
        channel=at.output, kind="square",
        reference=_REFERENCE, manoeuvre="small and large values",
    )  # fmt: skip


#: All faults, in the order in which they are preferred where data do not tell them apart.
SENSOR_FAULTS: tuple[EffectFunction, ...] = (
    sensor_bias, sensor_scale, sensor_drift, sensor_delay, sensor_lag, sensor_ceiling, sensor_floor,
    sensor_dead_zone, sensor_eccentricity,
)  # fmt: skip


def _fault(kind: str, at: Place, law: str, coefficient: str, manoeuvre: str) -> Effect:
    return Effect(
        f"sensor_{kind}", at.output, law, (coefficient,), reference=_REFERENCE, channel=at.output, kind=kind,
        manoeuvre=manoeuvre,
    )  # fmt: skip


def _shown_unit(g: BondGraph, at: Place) -> tuple[str, float]:
    """The unit in which a sensor is declared, and one of it in coherent units; of one with an offset its coherent one.

    What a fault adds is a difference.
    """
    declared = next((output.shown_unit for output in g.outputs if output.name == at.output), "")
    try:
        return (declared, coherent(declared)[1]) if declared else (_unit(g, at), 1.0)
    except DeclarationError:
        return _unit(g, at), 1.0


def _unit(g: BondGraph, at: Place) -> str:
    return next((output.unit for output in g.outputs if output.name == at.output), "")
