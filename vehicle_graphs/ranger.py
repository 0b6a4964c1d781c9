"""A utility vehicle of the Polaris Ranger's class with a mechanical rubber-belt CVT, assembled from its parts.

Engine, clutches, belt, gearbox, axles, tyres, body and ground are sub-graphs; any of them can be exchanged for another
with the same ports and inputs (``full().exchange("engine", mapped_engine())``, ``full(tyre=brush_tyre)``). The vehicle
is the one of P. M. Auby's thesis (2016), rebuilt from textbook physics where the thesis is not public.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sympy import Expr

from bondgraph.build import build
from bondgraph.declare.expressions import signal
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import symbol
from bondgraph.filter.filter_model import FilterModel
from vehicle_graphs.axles import End, axle
from vehicle_graphs.belt import rubber_belt
from vehicle_graphs.chassis import chassis, quasi_static_chassis
from vehicle_graphs.clutches import primary_clutch, secondary_clutch
from vehicle_graphs.engine import engine
from vehicle_graphs.gearbox import gearbox
from vehicle_graphs.ranger_filters import NOISE
from vehicle_graphs.ranger_scenarios import PANELS, SCENARIOS
from vehicle_graphs.terrain import terrain
from vehicle_graphs.tyres import Tyre, tanh_tyre

__all__ = [
    "NOISE",
    "PANELS",
    "SCENARIOS",
    "coast_down",
    "coast_down_quasi_static",
    "filter_model",
    "full",
    "full_awd",
    "monitored",
]

#: A function that declares a part.
Part = Callable[[], BondGraph]
#: Rear first: of storages that are geared together the one declared first is the state.
ENDS: tuple[End, ...] = ("rear", "front")

_FULL = """Ranger-class vehicle with rubber-belt CVT, rear drive: the whole vehicle."""
_MONITORED = """Ranger-class vehicle with rubber-belt CVT, rear drive, with speed sensors at both axles."""
_ALL_WHEELS = """Ranger-class vehicle with rubber-belt CVT, both axles geared to the secondary shaft."""
_COASTING = """Ranger-class vehicle coasting in neutral: axles, tyres, body and ground, nothing of engine and CVT."""
_QUASI_STATIC = """Ranger-class vehicle coasting in neutral on a suspension that follows at once."""


def full(engine: Part = engine, tyre: Tyre = tanh_tyre) -> BondGraph:
    """The whole vehicle with rear drive: eleven states, from the throttle to the ground.

    Examples
    --------
    >>> " ".join(part.name for part in full().subgraphs)
    'terrain body rear_axle front_axle rear_tyre front_tyre engine primary belt secondary gearbox'
    """
    g = BondGraph("ranger_full", doc=_FULL, source="vehicle_graphs/ranger.py")
    _vehicle(g, chassis(), tyre)
    _power_train(g, engine)
    g.bond("gearbox.output", "rear_axle.hub")
    _measure(g, engine_too=True)
    return g


def full_awd(engine: Part = engine, tyre: Tyre = tanh_tyre) -> BondGraph:
    """The whole vehicle with both axles geared: the front axle is a dependent storage too.

    Examples
    --------
    >>> full_awd().bonds[-1]
    Bond(source='gearbox.output', target='front_axle.hub')
    """
    g = BondGraph("ranger_full_awd", doc=_ALL_WHEELS, source="vehicle_graphs/ranger.py")
    _vehicle(g, chassis(), tyre)
    _power_train(g, engine)
    _measure(g, engine_too=True)
    g.bond("gearbox.output", "rear_axle.hub")
    g.bond("gearbox.output", "front_axle.hub")
    return g


def monitored(engine: Part = engine, tyre: Tyre = tanh_tyre) -> BondGraph:
    """The whole vehicle with rear drive and a speed sensor at its front axle too, for a monitor of its tyres.

    Examples
    --------
    >>> [output.name for output in monitored().outputs][-1]
    'front_axle_speed'
    """
    g = full(engine, tyre)
    g.name, g.doc = "ranger_monitored", _MONITORED
    g.measure("front_axle_speed", signal("flow", "front_axle.hub"), "rad/s", "front axle speed")
    return g


def coast_down(tyre: Tyre = tanh_tyre) -> BondGraph:
    """The vehicle in neutral: what coast-downs are filtered with.

    Examples
    --------
    >>> [output.name for output in coast_down().outputs]
    ['axle_speed', 'forward_velocity', 'height', 'pitch']
    """
    g = BondGraph("ranger_coast_down", doc=_COASTING, source="vehicle_graphs/ranger.py")
    _vehicle(g, chassis(), tyre)
    _measure(g)
    return g


def coast_down_quasi_static(tyre: Tyre = tanh_tyre) -> BondGraph:
    """The thesis' reduced coast-down model, kept to show its bias: no heave, and a pitch that follows at once.

    Examples
    --------
    >>> "pitch" in [signal.name for signal in coast_down_quasi_static().flatten().signals]
    True
    """
    g = BondGraph("ranger_coast_down_quasi_static", doc=_QUASI_STATIC, source="vehicle_graphs/ranger.py")
    thrust = signal("effort", "front_tyre.contact") + signal("effort", "rear_tyre.contact")
    _vehicle(g, quasi_static_chassis(), tyre, {"thrust": thrust})
    _measure(g)
    return g


def filter_model(graph: BondGraph, **changes: Any) -> FilterModel:
    """The filter of one of these graphs, with the noises of its sensors and of the road; ``changes`` are other fields.

    Examples
    --------
    >>> filter_model(coast_down()).process_noise
    {'inclination': 0.007}
    """
    return NOISE[graph.name].filter_model(build(graph).model, **changes)


def _vehicle(g: BondGraph, body: BondGraph, tyre: Tyre, bind: dict[str, Expr] | None = None) -> None:
    """Ground, body, axles and tyres. The rear axle comes before what is geared to it, so its speed is the state."""
    g.include("terrain", terrain(), bind={"speed": signal("flow", "body.forward")}, shared=True)
    slope = symbol("inclination")
    g.include("body", body, {"ground": "ground"}, {"slope": slope, **(bind or {})}, shared=True)
    for end in ENDS:
        g.include(f"{end}_axle", axle(end), {"hub": "hub"}, {"load": symbol(f"N_{end[0]}")}, shared=True)
    for end in ENDS:
        _wheels(g, end, tyre(end))


def _wheels(g: BondGraph, end: End, tyre: BondGraph) -> None:
    """Tyres between an axle and the ground."""
    radius = symbol("r_d") * symbol(f"radius_gain_{end[0]}")
    speeds = {"rolling": radius * signal("flow", f"{end}_axle.hub"), "ground": signal("flow", "body.ground")}
    bind = {"load": symbol(f"N_{end[0]}")} | {name: value for name, value in speeds.items() if name in tyre.quantities}
    g.include(f"{end}_tyre", tyre, {"contact": "contact"}, bind, shared=True)
    v_tyre = g.signal(f"v_tyre_{end[0]}", speeds["rolling"], "m/s", f"speed of the {end} tyres' circumference")
    g.signal(f"v_slip_{end[0]}", v_tyre - speeds["ground"], "m/s", f"slip velocity of the {end} tyres")
    g.transformer(f"{end}_wheels", radius, f"{end}_axle.hub", f"{end}_tyre.contact")
    g.bond(f"{end}_tyre.contact", "body.ground")


def _power_train(g: BondGraph, engine: Part) -> None:
    """Engine, CVT and gearbox; the pulleys are transformers whose moduli are the radii of the belt."""
    crank_speed, travel = signal("flow", "engine.crank"), signal("displacement", "primary.stops")
    g.include("engine", engine(), {"crank": "crank"}, shared=True)
    g.include("primary", primary_clutch(), {"sheave": "sheave"}, {"crank_speed": crank_speed}, shared=True)
    # what the secondary presses is felt at its end of the belt; the helix makes it follow the belt's force in turn
    F_s = g.signal("F_s", signal("effort", "belt_length", 2), "N", "clamp force of the secondary")
    clamps = {"primary_clamp": symbol("F_p"), "secondary_clamp": F_s}
    g.include("belt", rubber_belt(), {"belt": "belt"}, {"travel": travel, **clamps}, shared=True)
    belt_torque = symbol("r_s") * signal("effort", "belt.belt")
    bind = {"travel": travel, "belt_torque": belt_torque}
    g.include("secondary", secondary_clutch(), {"sheave": "sheave"}, bind, shared=True)
    g.include("gearbox", gearbox(), {"shaft": "shaft", "output": "output"}, {"belt_torque": belt_torque}, shared=True)
    g.transformer("primary_pulley", symbol("r_p"), "engine.crank", "belt.belt")
    g.transformer("secondary_pulley", 1 / symbol("r_s"), "belt.belt", "gearbox.shaft")
    # a belt of fixed length: what the primary gains, the secondary yields
    g.transformer("belt_length", symbol("wrap_ratio"), "primary.sheave", "secondary.sheave")


def _measure(g: BondGraph, engine_too: bool = False) -> None:
    """What the logs contain; the inclinometer stands on the body, its offset is that of the suspension at rest."""
    th_off = g.parameter("th_off", 0.0, "rad", "offset of the measured pitch", (-0.1, 0.1))
    quasi_static = "pitch" in dict(g.subgraphs[1].graph.quantities)
    pitch = symbol("pitch") if quasi_static else signal("displacement", "body.springs", 2)
    if engine_too:
        g.measure("engine_speed", signal("flow", "engine.crank"), "rad/s", "crankshaft speed")
    g.measure("axle_speed", signal("flow", "rear_axle.hub"), "rad/s", "rear axle speed")
    g.measure("forward_velocity", signal("flow", "body.forward"), "m/s", "forward velocity")
    g.measure("height", symbol("height"), "m", "height of the vehicle")
    g.measure("pitch", symbol("inclination") + pitch + th_off, "rad", "inclination of the body, with the offset")
