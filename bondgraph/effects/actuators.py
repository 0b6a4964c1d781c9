"""Actuators that do not give what they are told: wrong maps, lags, delays, ceilings, dead zones, slow rates.

An actuator is a source, a resistance, a transformer or a gyrator whose law follows an input of the graph: a motor's
torque, a heater, a brake, a valve, a ratio. Levers and switches, which are held between samples and have no unit, are
none. A motor is one too, whose constant falls as its current or its stroke grows.

References: Guzzella, Onder (2010), Introduction to Modeling and Control of Internal Combustion Engine Systems, chapter
2, for the lag of an engine's torque; Tao, Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor
Nonlinearities, for dead zones; Hippe (2006), Windup in Control, for ceilings; Krause, Wasynczuk, Sudhoff, Pekarek
(2013), Analysis of Electric Machinery and Drive Systems, for motors.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence

from sympy import Expr, tanh

from bondgraph.declare.domains import ELECTRICAL
from bondgraph.declare.effect import SMOOTHING, Effect, Place
from bondgraph.declare.elements import TWO_PORTS, Node
from bondgraph.declare.expressions import signal
from bondgraph.declare.functions import clip, delay
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Input
from bondgraph.declare.revision import replace_input, revise_law
from bondgraph.effects.places import (
    BENT,
    closer_delay,
    commanded,
    commands,
    delays_at,
    effort_unit,
    flow_unit,
    gyrators_at,
    has_flow,
    is_motion,
    lateness,
    over,
)
from bondgraph.effects.ranges import ceiling, sharpness
from bondgraph.effects.storages import spring_at

_ENGINE = (
    "Guzzella, Onder (2010), Introduction to Modeling and Control of Internal Combustion Engine Systems, chapter 2"
)
_CEILING = "Hippe (2006), Windup in Control"
_DEAD_ZONE = "Tao, Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor Nonlinearities"
_DEAD_TIME = "Normey-Rico, Camacho (2007), Control of Dead-time Processes"
_MACHINERY = "Krause, Wasynczuk, Sudhoff, Pekarek (2013), Analysis of Electric Machinery and Drive Systems"
_CURVES = "Lyons (1982), Lyons' Valve Designer's Handbook, for inherent characteristics of valves"
_GAP = "Woodson, Melcher (1968), Electromechanical Dynamics, chapter 3"
#: Powers of the current with which a motor's constant falls: from its own to that of iron that saturates late. A
#: convention; the square is the first term of an even curve.
_FADING = (1.0, 4.0)
#: Powers of the current with which an armature takes the field: from poles that saturate early to iron that saturates
#: late. A convention, as wide below one as above.
_TAKEN = (0.5, 2.0)
#: Share of a motor's field that its armature may take at the largest current: beyond all of it the torque would
#: turn round. A convention.
_WEAKENED = 0.9
#: The least half play that is looked for, as a share of what the source gives at most: less hides in noise. A
#: convention.
_LEAST_PLAY = 0.003
#: Share of a gap that a stroke may close: the pull is 25 times as large then, and the law has a pole at the whole gap.
_CLOSED = 0.8
#: What an element of each kind gives.
_GIVES = {"Se": "effort", "Sf": "flow", "R": "effort", "TF": "modulus", "GY": "modulus"}
#: Sources and resistances, which give an effort or a flow.
_SOURCES = ("Se", "Sf", "R")
#: Within this share of its range a rate-limited command follows by a lag and not at its largest rate.
_NEAR = 0.02


def actuator_scale(g: BondGraph, at: Place) -> Effect | None:
    """An actuator whose map is wrong by a factor: a torque model, a calibration."""
    return _scaled(g, at, "actuator_scale", _SOURCES)


def ratio_scale(g: BondGraph, at: Place) -> Effect | None:
    """A commanded ratio that is wrong by a factor: a gear's teeth, a pump's displacement, a motor's constant."""
    return _scaled(g, at, "ratio_scale", TWO_PORTS)


def _scaled(g: BondGraph, at: Place, effect: str, kinds: Sequence[str]) -> Effect | None:
    found = [node for node, _ in commanded(g, at, kinds) if node.law(_GIVES[node.kind]) is not None]
    if not found:
        return None
    node = found[0]
    name = f"{effect}_{at.name}"
    share = g.parameter(f"s_{name}", 0.0, "1", f"share by which {node.name} is stronger", (-0.6, 0.6))
    given = _GIVES[node.kind]
    revise_law(g, node.name, given, lambda old: (1 + share) * old)
    return Effect(
        effect, node.name, f"{given} = (1 + s)*declared", (share.name,), reference=_ENGINE,
        manoeuvre="the command at several levels",
    )  # fmt: skip


def modulus_fading(g: BondGraph, at: Place) -> Effect | None:
    """Constant of a motor that falls as its iron saturates: with the square of the current, or where its power bends.

    Torque and voltage fall alike, so that it loses no power.
    """
    motor = _motor_at(g, at)
    if motor is None:
        return None
    name = f"modulus_fading_{at.name}"
    c = g.parameter(f"c_{name}", 0.0, "1", "what the constant falls by at the largest flow", (0.0, 2.0))
    most = g.parameter(f"r_{name}", at.scale.flow, flow_unit(at), "largest flow")
    n = g.parameter(f"n_{name}", 2.0, "1", "power of the flow", _FADING)
    x, w = at.junction.flow / most, at.smoothing
    revise_law(g, motor, "modulus", lambda old: old / (1 + c * (x**2 + w**2) ** (n / 2)))
    return Effect(
        "modulus_fading", motor, "modulus = declared/(1 + c*(x^2 + w^2)^(n/2)), x = flow/r", (c.name,),
        widths=(n.name,), reference=_MACHINERY, manoeuvre="small and large currents, at standstill and at speed",
    )  # fmt: skip


def armature_reaction(g: BondGraph, at: Place) -> Effect | None:
    """Constant of a motor whose armature weakens the field in proportion to its current, either way round.

    Where the poles saturate it takes less of the field the larger the current, and the power falls below one.
    """
    motor = _motor_at(g, at)
    if motor is None:
        return None
    name = f"armature_reaction_{at.name}"
    limit = _WEAKENED / at.scale.flow
    c = g.parameter(f"c_{name}", 0.0, over("1", flow_unit(at)), "1 over the current without a field", (0.0, limit))
    most = g.parameter(f"r_{name}", at.scale.flow, flow_unit(at), "largest flow")
    n = g.parameter(f"n_{name}", 1.0, "1", "power of the flow", _TAKEN)
    x, w = at.junction.flow / most, at.smoothing
    revise_law(g, motor, "modulus", lambda old: old * (1 - c * most * (x**2 + w**2) ** (n / 2)))
    return Effect(
        "armature_reaction", motor, "modulus = declared*(1 - c*r*|flow/r|^n)", (c.name,), widths=(n.name,),
        reference=_MACHINERY, manoeuvre="small and large currents, at standstill and at speed",
    )  # fmt: skip


def _motor_at(g: BondGraph, at: Place) -> str | None:
    """The only gyrator at a circuit's 1-junction, if its modulus follows nothing."""
    motors = gyrators_at(g, at) if has_flow(at) and at.domain == ELECTRICAL else []
    known = {parameter.symbol for parameter in g.flatten().parameters}
    law = motors[0].law("modulus") if len(motors) == 1 else None
    return motors[0].name if law is not None and law.free_symbols <= known else None


def stroke_fading(g: BondGraph, at: Place) -> Effect | None:
    """Constant of a motor that falls away from the middle of its stroke: a voice coil that leaves its magnet's gap.

    Force and voltage fall alike, so that it loses no power.
    """
    motors = gyrators_at(g, at) if is_motion(at) else []
    spring = spring_at(g, at, straight=False)
    known = {parameter.symbol for parameter in g.flatten().parameters}
    law = motors[0].law("modulus") if len(motors) == 1 else None
    if spring is None or law is None or not law.free_symbols <= known:
        return None
    name = f"stroke_fading_{at.name}"
    limit = 3.0 / spring.way**2
    c = g.parameter(f"c_{name}", 0.0, over("1", spring.unit, 2), "1 over the square of a displacement", (0.0, limit))
    stroke = signal("displacement", spring.name)
    revise_law(g, motors[0].name, "modulus", lambda old: old / (1 + c * stroke**2))
    return Effect(
        "stroke_fading", motors[0].name, "modulus = declared/(1 + c*q^2), q = displacement", (c.name,),
        reference="Klippel (2006), J. Audio Engineering Society 54(10)", manoeuvre="small and large strokes in one log",
    )  # fmt: skip


def actuator_lag(g: BondGraph, at: Place) -> Effect | None:
    """A command that acts late, by a first-order lag: manifold filling, brake pressure, a current controller."""
    return _lagging(g, at, "actuator_lag", _SOURCES)


def ratio_lag(g: BondGraph, at: Place) -> Effect | None:
    """A commanded ratio that follows late: a gear that shifts, a variable pump or belt, a field that builds up."""
    return _lagging(g, at, "ratio_lag", TWO_PORTS)


def _lagging(g: BondGraph, at: Place, effect: str, kinds: Sequence[str]) -> Effect | None:
    found = _first(g, at, kinds)
    if found is None:
        return None
    node, command = found
    name = f"{effect}_{at.name}"
    start, bounds = lateness(at)
    lag = g.parameter(f"T_{name}", start, "s", f"time in which {node.name} follows its command", bounds)
    own = command.symbol
    given = g.integral(
        f"given_{name}", lambda x: (own - x) / lag, command.unit, f"{command.name} as {node.name} gives it",
        initial=_start(node, command),
    )  # fmt: skip
    replace_input(g, command.name, given)
    return Effect(
        effect, node.name, "command follows by dx/dt = (u - x)/T", (lag.name,), adds_state=True,
        amplitudes=(0.35, 0.65), reference=_ENGINE, manoeuvre="steps of the command",
    )  # fmt: skip


def actuator_delay(g: BondGraph, at: Place) -> Effect | None:
    """A command that acts late: a bus, an inverter's cycle, a pipe that has to be passed.

    It takes no states: what a command was is known. Between neighbours among :func:`delays_at` the law is their mean.
    """
    found = _first(g, at, _SOURCES)
    if found is None:
        return None
    node, command = found
    name = f"actuator_delay_{at.name}"
    known, interval = delays_at(at)
    start, (least, most) = lateness(at)
    late = g.parameter(f"T_{name}", at.near[0] or start, "s", f"time by which {node.name} acts late", (least, most))
    step = g.parameter(f"interval_{name}", interval, "s", "interval between samples")
    given: Expr = command.symbol
    for earlier, later in itertools.pairwise(known):
        share = clip((late / step - earlier) / (later - earlier), 0, 1)
        given += share * (delay(command.symbol, later * interval) - delay(command.symbol, earlier * interval))
    replace_input(g, command.name, given)
    return Effect(
        "actuator_delay", node.name, "command(t - T)", (late.name,), adds_state=True,
        amplitudes=tuple(math.log(one * interval / least) / math.log(most / least) for one in known[1:-1]),
        reference=_DEAD_TIME, manoeuvre="steps of the command", closer=functools.partial(closer_delay, at),
    )  # fmt: skip


def actuator_ceiling(g: BondGraph, at: Place) -> Effect | None:
    """A source that cannot give more than so much: a current limit, a saturated amplifier, a pump at its largest."""
    found = _source(g, at)
    if found is None:
        return None
    node, given, unit, size = found
    name = f"actuator_ceiling_{at.name}"
    meaning = f"1 over the ceiling of {node.name}"
    c = g.parameter(f"c_{name}", 0.0, over("1", unit), meaning, (0.0, 3.0 / size))
    n = sharpness(g, f"n_{name}")
    revise_law(g, node.name, given, lambda old: ceiling(old, c, n))
    return Effect(
        "actuator_ceiling", node.name, f"{given} = x/(1 + |c*x|^n)^(1/n), x declared", (c.name,),
        amplitudes=(0.3, 0.6), shapes=(n.name,), grids=((n.name, (2.0, 6.0)),), reference=_CEILING,
        manoeuvre="commands small and at their largest",
    )  # fmt: skip


def actuator_dead_zone(g: BondGraph, at: Place) -> Effect | None:
    """A source that gives nothing until its command exceeds a threshold: a valve's overlap, a motor's driver."""
    found = _source(g, at)
    if found is None:
        return None
    node, given, unit, size = found
    name = f"actuator_dead_zone_{at.name}"
    b = g.parameter(f"b_{name}", 0.0, unit, f"what {node.name} must exceed before it acts", (0.0, size))
    revise_law(g, node.name, given, lambda old: old - clip(old, -b, b))
    return Effect(
        "actuator_dead_zone", node.name, f"{given} = x - clip(x, -b, b), x declared", (b.name,),
        amplitudes=(0.03, 0.1, 0.3), reference=_DEAD_ZONE, manoeuvre="small commands of both signs",
    )  # fmt: skip


def actuator_play(g: BondGraph, at: Place) -> Effect | None:
    """A source that stays where it is until its command has turned back by a play: a valve's linkage, a rack's gear.

    Within the play nothing moves; beyond it what is given follows in the time between two samples.
    """
    found = _source(g, at)
    if found is None:
        return None
    node, given, unit, size = found
    name = f"actuator_play_{at.name}"
    bounds = (_LEAST_PLAY * size, size)
    half = g.parameter(f"b_{name}", (bounds[0] * bounds[1]) ** 0.5, unit, f"half of the play of {node.name}", bounds)
    interval = g.parameter(f"follows_{name}", float(f"{at.times[0]:.9g}"), "s", "time in which it follows beyond")
    wanted = node.law(given)

    def rate(x: Expr) -> Expr:
        away = wanted - x
        return (away - clip(away, -half, half)) / interval

    revise_law(g, node.name, given, g.integral(f"moved_{name}", rate, unit, f"what {node.name} gives"))
    return Effect(
        "actuator_play", node.name, f"d({given})/dt = (e - clip(e, -b, b))/T, e = x - {given}, x declared",
        (half.name,), adds_state=True, amplitudes=(0.4, 0.7), reference=_DEAD_ZONE,
        manoeuvre="commands that turn back, small and large",
    )  # fmt: skip


def actuator_exponent(g: BondGraph, at: Place) -> Effect | None:
    """A source whose map is bent: a heater that gives the square of its command, a valve that opens ever wider."""
    found = _source(g, at)
    if found is None:
        return None
    node, given, unit, size = found
    name = f"actuator_exponent_{at.name}"
    b = g.parameter(f"b_{name}", 0.0, "1", f"exponent of {node.name} beyond a straight map", BENT)
    right = g.parameter(f"right_{name}", size, unit, f"where {node.name} gives what is declared")
    revise_law(g, node.name, given, lambda old: old * ((old / right) ** 2 + SMOOTHING**4) ** (b / 2))
    return Effect(
        "actuator_exponent", node.name, f"{given} = x*|x/r|^b, x declared", (b.name,), amplitudes=(0.15, 0.3),
        reference=_CURVES, manoeuvre="commands small and at their largest",
    )  # fmt: skip


def gap_dependence(g: BondGraph, at: Place) -> Effect | None:
    """A commanded effort that grows as a gap closes, by the square: an electromagnet, a plate capacitor, a suction cup.

    A negative coefficient means that the gap opens with the displacement.
    """
    spring = spring_at(g, at, straight=False) if is_motion(at) else None
    sources = [node for node, _ in commanded(g, at, ("Se",)) if "." not in node.name]
    if spring is None or len(sources) != 1:
        return None
    name = f"gap_dependence_{at.name}"
    limit = _CLOSED / spring.way
    c = g.parameter(f"c_{name}", 0.0, over("1", spring.unit), "1 over the gap", (-limit, limit))
    stroke = signal("displacement", spring.name)
    revise_law(g, sources[0].name, "effort", lambda old: old / (1 - c * stroke) ** 2)
    return Effect(
        "gap_dependence", sources[0].name, "effort = declared/(1 - c*q)^2, q = displacement", (c.name,),
        reference=_GAP, manoeuvre="the same command at both ends of the stroke",
    )  # fmt: skip


def actuator_rate_limit(g: BondGraph, at: Place) -> Effect | None:
    """A source that follows its command no faster than at a largest rate: a servo valve, a stepper, a slow heater."""
    found = _source(g, at)
    if found is None:
        return None
    node, given, unit, size = found
    name = f"actuator_rate_limit_{at.name}"
    slow = g.parameter(f"T_{name}", 0.5, "s", f"time in which {node.name} goes through {size:.3g} {unit}", (0.02, 20.0))
    whole = g.parameter(f"range_{name}", size, unit, "range that takes that time")
    wanted = node.law(given)
    reached = g.integral(
        f"reached_{name}",
        lambda x: whole / slow * tanh((wanted - x) / (_NEAR * whole)),
        unit,
        f"what {node.name} gives",
    )
    revise_law(g, node.name, given, reached)
    return Effect(
        "actuator_rate_limit", node.name, f"d({given})/dt = r/T*tanh((x - {given})/(0.02*r)), x declared", (slow.name,),
        adds_state=True, amplitudes=(0.35, 0.65), reference=_CEILING, manoeuvre="small and large steps of the command",
    )  # fmt: skip


def _first(g: BondGraph, at: Place, kinds: Sequence[str]) -> tuple[Node, Input] | None:
    """The first element here that follows a command, where no element before it does: it stands for all of them."""
    nodes = g.flatten().nodes.values()
    for node, command in commanded(g, at, kinds, temperatures=True):
        followers = (one.name for one in nodes if one.kind in _GIVES and command in commands(g, at, one))
        if next(followers, "") == node.name:
            return node, command
    return None


def _start(node: Node, command: Input) -> object:
    """Where the lagging command starts: a ratio must not start at zero, where nothing is transmitted."""
    return (command.name, command.default or 1.0) if node.kind in TWO_PORTS else 0.0


def _source(g: BondGraph, at: Place) -> tuple[Node, str, str, float] | None:
    """The source here that follows an input, what it gives, the unit of that, and its size."""
    for node, _ in commanded(g, at, ("Se", "Sf")):
        if "." not in node.name:
            if node.kind == "Se":
                return node, "effort", effort_unit(at), at.scale.effort
            return node, "flow", flow_unit(at), at.scale.flow
    return None
