"""Small machines of every domain, at which every effect of the dictionary can act: what its table is made from.

Their numbers are round ones of laboratory benches; nothing depends on them but the bounds of coefficients.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi

from sympy import Abs

from bondgraph.declare.domains import CHEMICAL, ELECTRICAL, HYDRAULIC, ROTATION, THERMAL, TRANSLATION
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.validation import node_domains


@dataclass(frozen=True)
class Bench:
    """A machine, and the sizes of effort and flow at its junctions by name of the domain."""

    graph: BondGraph
    scales: Mapping[str, Scale]

    @functools.cached_property
    def places(self) -> tuple[Place, ...]:
        """All its junctions, bonds, pairs of junctions of one kind and domain, and sensors."""
        g = self.graph
        known = {name: handle(g, name) for name in node_domains(g) if g.nodes[name].is_junction}
        scales = {name: self.scales[one.domain.name if one.domain else ""] for name, one in known.items()}
        found = [Place(one, scales[name]) for name, one in known.items()]
        found += [Place(known[bond.source], scales[bond.source], bond) for bond in g.bonds if bond.source in known]
        for first, second in itertools.combinations(known.values(), 2):
            if (first.domain, first.kind) == (second.domain, second.kind):
                found.append(Place.between(first, second, scales[first.name]))
        return (*found, *(Place.sensor(output.name, Scale(10.0, 5.0)) for output in g.outputs))


def drive() -> Bench:
    """A motor that moves a carriage on a bellows through a gear, an elastic shaft, a belt that may slip and a screw.

    A shorted voice coil moves with the bellows, and a magnet pulls at it. The same current brakes the spindle.
    """
    g = BondGraph("drive")
    torque = g.input("torque", "N m", "command of the motor")
    ratio = g.input("ratio", "1", "ratio of the gear", default=2.0)
    rotor, twist = g.one_junction("rotor", ROTATION), g.one_junction("twist", ROTATION)
    shaft, belt = g.zero_junction("shaft", ROTATION), g.zero_junction("belt", ROTATION)
    spindle, carriage = g.one_junction("spindle", ROTATION), g.one_junction("carriage", TRANSLATION)
    lead = g.parameter("screw_lead", 0.01, "m", "travel per turn")
    g.effort_source("motor", torque, at=rotor)
    g.inertance("inertia", g.parameter("J", 0.01, "kg m^2", "rotor"), at=rotor, state="omega")
    g.resistance("bearing", g.parameter("d", 0.01, "N m s", "bearing"), at=rotor)
    g.transformer("gear", 1 / ratio, rotor, shaft)
    g.bond(shaft, twist)
    g.compliance("spring", g.parameter("k", 100.0, "N m", "stiffness of the shaft"), at=twist, state="wound")
    g.resistance("damping", g.parameter("d_k", 0.1, "N m s", "its damping"), at=twist)
    g.bond(shaft, spindle)
    g.inertance("pulley", g.parameter("J_s", 0.02, "kg m^2", "spindle"), at=spindle, state="omega_s")
    g.bond(spindle, belt)
    g.transformer("screw", lead / (2 * pi), belt, carriage)
    grip = g.parameter("grip", 2.0, "N m s", "creep of the belt")
    g.resistance("tension", lambda flow: grip * flow, at=belt)
    g.inertance("mass", g.parameter("m", 20.0, "kg", "carriage"), at=carriage, state="v")
    drag = g.parameter("drag", 3.0, "N s^2/m^2", "air")
    g.resistance("air", lambda flow: drag * flow * Abs(flow), at=carriage)
    mount, bellows = g.zero_junction("mount", TRANSLATION), g.one_junction("bellows", TRANSLATION)
    g.bond(carriage, mount)
    pad = g.parameter("pad", 500.0, "N s/m", "pad that gives way beside the bellows")
    g.resistance("give", flow=lambda effort: effort / pad, at=mount)
    g.bond(mount, bellows)
    g.compliance("cushion", g.parameter("k_b", 500.0, "N/m", "stiffness of the bellows"), at=bellows, state="pressed")
    winding = g.inertance("winding", g.parameter("L_c", 0.01, "V s/A", "inductance of the voice coil"), state="i_c")
    g.gyrator("coil", g.parameter("k_c", 5.0, "N/A", "constant of the voice coil"), bellows, winding)
    current = g.input("current", "A", "current of the magnet")
    g.effort_source("magnet", g.parameter("k_p", 2.0, "N/A", "pull of the magnet") * current, at=bellows)
    blower, foot = g.one_junction("blower", ROTATION), g.one_junction("foot", TRANSLATION)
    g.transformer("joint", g.parameter("r_j", 1.0, "1", "ratio of a universal joint"), spindle, blower)
    g.resistance("blades", g.parameter("d_b", 0.05, "N m s", "drag of the blower"), at=blower)
    dyno, hold = g.one_junction("dyno", ROTATION), g.parameter("d_e", 2e-3, "N m s/A^2", "brake by eddy currents")
    g.transformer("strap", g.parameter("r_s", 3.0, "1", "ratio of a strap to a brake"), spindle, dyno)
    g.resistance("brake", lambda flow: hold * current**2 * flow, at=dyno)
    g.transformer("lever", g.parameter("r_l", 0.5, "1", "ratio of a lever"), bellows, foot)
    g.resistance("oil", g.parameter("d_o", 40.0, "N s/m", "damper under the lever"), at=foot)
    g.measure("position", g.integral("x", carriage.flow, "m", "position of the carriage"), "m")
    g.measure("turned", g.integral("angle", rotor.flow, "rad", "angle of the rotor"), "rad")
    g.measure_flow("speed", rotor, "speed of the rotor")
    return Bench(g, {"rotation": Scale(10.0, 20.0), "translation": Scale(50.0, 0.5)})


def circuit() -> Bench:
    """A coil with a condenser and a choke, whose wire warms a body and whose current turns a fan."""
    g = BondGraph("circuit")
    voltage = g.input("voltage", "V", "command of the amplifier")
    loop, node = g.one_junction("loop", ELECTRICAL), g.zero_junction("node", ELECTRICAL)
    load, tail = g.one_junction("load", ELECTRICAL), g.zero_junction("tail", ELECTRICAL)
    g.effort_source("amplifier", voltage, at=loop)
    g.inertance("coil", g.parameter("L", 0.1, "V s/A", "inductance"), at=loop, state="i")
    g.resistance("wire", g.parameter("R", 2.0, "V/A", "wire"), at=loop)
    fan = g.resistance("fan", g.parameter("d_f", 1e-3, "N m s", "drag of the fan"))
    g.gyrator("motor", g.parameter("k_m", 0.02, "N m/A", "constant of its motor"), loop, fan)
    g.bond(loop, node)
    g.compliance("condenser", 1 / g.parameter("C", 1e-3, "A s/V", "capacitance"), at=node, state="q")
    g.bond(node, load)
    g.resistance("lamp", g.parameter("R_l", 20.0, "V/A", "lamp"), at=load)
    g.effort_source("cell", g.parameter("E", 4.0, "V", "battery"), at=load)
    g.compliance("charge", 1 / g.parameter("C_b", 50.0, "A s/V", "capacity of the battery"), at=load, state="q_b")
    g.inertance("choke", g.parameter("L_l", 0.05, "V s/A", "inductance before the lamp"), at=load, state="i_l")
    g.bond(load, tail)
    g.compliance("second", 1 / g.parameter("C_2", 2e-3, "A s/V", "second condenser"), at=tail, state="q_2")
    lead, end = g.one_junction("lead", ELECTRICAL), g.zero_junction("end", ELECTRICAL)
    g.bond(tail, lead)
    g.resistance("cable", g.parameter("R_c", 0.5, "V/A", "cable"), at=lead)
    g.bond(lead, end)
    bleed = g.parameter("G_b", 0.01, "A/V", "bleeder at the end of the cable")
    g.resistance("bleeder", flow=lambda effort: bleed * effort, at=end)
    body = g.zero_junction("body", THERMAL)
    resistance = next(one for one in g.parameters if one.name == "R").symbol
    g.flow_source("heat", resistance * loop.flow**2, at=body)
    content = 50.0 * 293.0
    g.compliance("warm", 1 / g.parameter("C_T", 50.0, "J/K", "heat capacity"), at=body, state="Q_wire", initial=content)
    skin = g.one_junction("skin", THERMAL)
    g.bond(body, skin)
    g.resistance("air", g.parameter("R_T", 2.0, "K/W", "to what is around"), at=skin)
    g.bond(skin, g.effort_source("around", g.parameter("T_a", 293.0, "K", "temperature around")))
    g.measure_flow("current", loop, "current")
    return Bench(g, {"electrical": Scale(20.0, 2.0), "thermal": Scale(400.0, 10.0)})


def tanks() -> Bench:
    """A pump that fills a tank, from which a second one is filled through a pipe."""
    g = BondGraph("tanks")
    inflow = g.input("inflow", "m^3/s", "command of the pump")
    first, pipe = g.zero_junction("first", HYDRAULIC), g.one_junction("pipe", HYDRAULIC)
    second, outlet = g.zero_junction("second", HYDRAULIC), g.one_junction("outlet", HYDRAULIC)
    g.flow_source("pump", inflow, at=first)
    g.compliance("level", g.parameter("k", 1e6, "Pa/m^3", "pressure per volume"), at=first, state="V")
    g.bond(first, pipe)
    g.resistance("bore", g.parameter("R", 1e8, "Pa s/m^3", "pipe"), at=pipe)
    g.inertance("column", g.parameter("I", 1e6, "Pa s^2/m^3", "fluid in the pipe"), at=pipe, state="Q_pipe")
    g.bond(pipe, second)
    g.compliance("level_2", g.parameter("k_2", 2e6, "Pa/m^3", "pressure per volume"), at=second, state="V_2")
    drain, weir = g.zero_junction("drain", HYDRAULIC), g.one_junction("weir", HYDRAULIC)
    g.bond(second, outlet)
    g.resistance("valve", g.parameter("R_v", 2e8, "Pa s/m^3", "valve"), at=outlet)
    g.bond(outlet, drain)
    g.bond(drain, weir)
    g.resistance("edge", g.parameter("R_w", 3e7, "Pa s/m^3", "weir"), at=weir)
    g.measure_effort("pressure", second, "pressure in the second tank")
    return Bench(g, {"hydraulic": Scale(1e5, 1e-3)})


def oven() -> Bench:
    """A heated plate in a case that gives its heat to a room."""
    g = BondGraph("oven")
    power, room = g.input("power", "W", "heater"), g.input("room", "K", "temperature of the room", default=293.0)
    plate, gap = g.zero_junction("plate", THERMAL), g.one_junction("gap", THERMAL)
    case, wall = g.zero_junction("case", THERMAL), g.one_junction("wall", THERMAL)
    g.flow_source("heater", power, at=plate)
    g.compliance("heat", 1 / g.parameter("C", 500.0, "J/K", "plate"), at=plate, state="Q", initial=500.0 * 293.0)
    g.bond(plate, gap)
    g.resistance("filling", g.parameter("R", 0.5, "K/W", "filling"), at=gap)
    g.bond(gap, case)
    g.compliance("heat_2", 1 / g.parameter("C_2", 900.0, "J/K", "case"), at=case, state="Q_2", initial=900.0 * 293.0)
    paint, film = g.zero_junction("paint", THERMAL), g.one_junction("film", THERMAL)
    g.bond(case, wall)
    g.resistance("lagging", g.parameter("R_w", 0.1, "K/W", "lagging"), at=wall)
    g.bond(wall, paint)
    g.bond(paint, film)
    g.resistance("air", g.parameter("R_a", 0.3, "K/W", "air"), at=film)
    g.bond(film, g.effort_source("hall", room))
    g.measure_effort("temperature", plate, "temperature of the plate")
    return Bench(g, {"thermal": Scale(400.0, 300.0)})


def reactor() -> Bench:
    """A substance that is fed, and turns into another."""
    g = BondGraph("reactor")
    feed = g.input("feed", "mol/s", "what is fed")
    educt, product = g.zero_junction("educt", CHEMICAL), g.zero_junction("product", CHEMICAL)
    reaction = g.one_junction("reaction", CHEMICAL)
    g.flow_source("inlet", feed, at=educt)
    g.compliance("amount", g.parameter("k", 100.0, "J/mol^2", "potential per amount"), at=educt, state="n")
    g.bond(educt, reaction)
    g.resistance("barrier", g.parameter("R", 1e3, "J s/mol^2", "barrier"), at=reaction)
    g.bond(reaction, product)
    g.compliance("amount_2", g.parameter("k_2", 50.0, "J/mol^2", "potential per amount"), at=product, state="n_2")
    g.measure_effort("potential", product, "potential of the product")
    return Bench(g, {"chemical": Scale(1e3, 0.5)})


#: All benches, by the word for their domain.
BENCHES: Mapping[str, Callable[[], Bench]] = {
    "mechanical": drive, "electrical": circuit, "hydraulic": tanks, "thermal": oven, "chemical": reactor,
}  # fmt: skip
