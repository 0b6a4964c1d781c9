"""Sample graphs for the drawing tests: a DC motor, a two-mass driveline, and a vehicle of sub-graphs with signals."""

from __future__ import annotations

from bondgraph.report.drawing import Drawing, DrawnBond, DrawnNode, Kind, Stroke


class Sketch:
    """Collects nodes, bonds and signals of a drawing in short form."""

    def __init__(self, title: str) -> None:
        self.title = title
        self.nodes: list[DrawnNode] = []
        self.bonds: list[DrawnBond] = []
        self.signals: list[tuple[str, str]] = []

    def node(self, name: str, kind: Kind, domain: str = "", law: str = "") -> str:
        self.nodes.append(DrawnNode(name, kind, domain, law))
        return name

    def bond(self, source: str, target: str, stroke: Stroke | None = None) -> None:
        self.bonds.append(DrawnBond(source, target, stroke))

    def on(self, junction: str, name: str, kind: Kind, law: str, stroke: Stroke, inwards: bool = False) -> str:
        """A one-port at a junction; power is positive into it unless ``inwards`` (into the junction)."""
        self.node(name, kind, "", law)
        ends = (name, junction) if inwards else (junction, name)
        self.bond(*ends, stroke)
        return name

    def two_port(
        self, name: str, kind: Kind, law: str, source: str, target: str, strokes: tuple[Stroke, Stroke]
    ) -> str:
        self.node(name, kind, "", law)
        self.bond(source, name, strokes[0])
        self.bond(name, target, strokes[1])
        return name

    def drawing(self) -> Drawing:
        return Drawing(self.title, tuple(self.nodes), tuple(self.bonds), tuple(self.signals))


def dc_motor() -> Drawing:
    s = Sketch("dc_motor")
    s.node("loop", "1", "electrical")
    s.node("shaft", "1", "rotation")
    s.on("loop", "supply", "Se", "u_a", "target", inwards=True)
    s.on("loop", "L", "I", "momentum/L_a", "target")
    s.on("loop", "R", "R", "R_a·flow", "source")
    s.two_port("machine", "GY", "k_m", "loop", "shaft", ("source", "target"))
    s.on("shaft", "rotor", "I", "momentum/J", "target")
    s.on("shaft", "bearing", "R", "b·flow", "source")
    return s.drawing()


def two_mass_driveline() -> Drawing:
    s = Sketch("two_mass_driveline")
    for name in ("motor", "load"):
        s.node(name, "1", "rotation")
    s.node("shaft", "0", "rotation")
    s.node("twist", "1", "rotation")
    s.on("motor", "torque", "Se", "tau_motor", "target", inwards=True)
    s.on("motor", "J_motor", "I", "momentum/J_motor", "target")
    s.on("motor", "bearing", "R", "b_motor·flow", "source")
    s.bond("motor", "shaft", "source")
    s.bond("shaft", "twist", "target")
    s.on("twist", "spring", "C", "k_shaft·displacement", "source")
    s.on("twist", "damper", "R", "d_shaft·flow", "source")
    s.bond("shaft", "load", "target")
    s.on("load", "J_load", "I", "momentum/J_load", "target")
    s.on("load", "drag", "R", "tau_coulomb·tanh(flow/omega_0) + c_quadratic·flow·|flow|", "source")
    s.on("load", "weight", "Se", "m_load·g·r_drum", "target", inwards=True)
    return s.drawing()


def _engine(s: Sketch) -> None:
    s.node("engine.crank", "1", "rotation")
    s.on("engine.crank", "engine.combustion", "Se", "torque_map(flow(engine.crank), throttle)", "target", inwards=True)
    s.on("engine.crank", "engine.inertia", "I", "momentum/J_engine", "target")
    s.on("engine.crank", "engine.drag", "R", "b_d·flow", "source")
    s.signals.append(("engine.crank", "engine.combustion"))


def _cvt(s: Sketch) -> None:
    s.node("cvt.primary.shift", "1", "translation")
    s.on("cvt.primary.shift", "cvt.primary.flyweights", "Se",
         "m_fw·(r_f0 + r_f1·s)·flow(engine.crank)²·(td0 + td1·s)", "target", inwards=True)  # fmt: skip
    s.on("cvt.primary.shift", "cvt.primary.spring", "C", "F_p0 + k_p·displacement", "source")
    s.on("cvt.primary.shift", "cvt.primary.shift_friction", "R", "c_x·flow", "target")
    s.on("cvt.primary.shift", "cvt.primary.stops", "C",
         "k_st·maximum(displacement - x_max, 0) - k_st·maximum(-displacement, 0)", "source")  # fmt: skip
    s.node("cvt.secondary.sheave", "1", "translation")
    s.on("cvt.secondary.sheave", "cvt.secondary.spring", "C", "F_s0 + k_s·displacement", "source")
    s.on("cvt.secondary.sheave", "cvt.secondary.helix", "Se", "tau_s/(2·r_h·tan_h)", "target", inwards=True)
    s.two_port("cvt.wedge", "TF", "wrap_p/wrap_s", "cvt.primary.shift", "cvt.secondary.sheave", ("source", "source"))
    s.node("cvt.belt_in", "1", "translation")
    s.node("cvt.belt", "0", "translation")
    s.on("cvt.belt", "cvt.belt_slip", "R", "2·mu_b/cos_al·minimum(F_p, F_s)·tanh(flow/v_s)", "target")
    s.node("cvt.belt_out", "1", "translation")
    s.two_port("cvt.radius_primary", "TF", "1/r_p(x_c)", "engine.crank", "cvt.belt_in", ("source", "source"))
    s.bond("cvt.belt_in", "cvt.belt", "source")
    s.bond("cvt.belt", "cvt.belt_out", "target")
    s.node("cvt.output", "1", "rotation")
    s.two_port("cvt.radius_secondary", "TF", "r_s(x_c)", "cvt.belt_out", "cvt.output", ("target", "target"))
    s.on("cvt.output", "cvt.secondary_inertia", "I", "momentum/J_s", "source")
    s.signals += [
        ("engine.crank", "cvt.primary.flyweights"),
        ("cvt.primary.shift", "cvt.radius_primary"),
        ("cvt.primary.shift", "cvt.radius_secondary"),
        ("cvt.primary.shift", "cvt.wedge"),
        ("cvt.belt", "cvt.secondary.helix"),
        ("cvt.secondary.sheave", "cvt.belt_slip"),
    ]


def _axle(s: Sketch, name: str, driven: bool) -> None:
    s.node(f"{name}.hub", "1", "rotation")
    s.on(f"{name}.hub", f"{name}.wheels", "I", f"momentum/J_{name}", "target")
    s.on(f"{name}.hub", f"{name}.brake", "R", f"brake·T_{name}·tanh(flow/0.5)", "source")
    s.on(f"{name}.hub", f"{name}.rolling", "R", "f_r·N·r_d·tanh(flow/0.3)", "source")
    if driven:
        s.two_port(f"{name}.gearbox", "TF", "gear", "cvt.output", f"{name}.hub", ("target", "target"))
        s.on(f"{name}.hub", f"{name}.gear_loss", "R", "(1 - eta)·gear·F_b·r_s", "source")
    s.node(f"{name}.contact", "0", "translation")
    s.two_port(f"{name}.radius", "TF", "r_d", f"{name}.hub", f"{name}.contact", ("source", "source"))
    s.on(f"{name}.contact", f"{name}.tyre", "R", "mu·N·tanh(C_k·slip/mu)", "target")


def _body(s: Sketch) -> None:
    s.node("body.forward", "1", "translation")
    s.on("body.forward", "body.mass", "I", "momentum/m", "target")
    s.on("body.forward", "body.aero", "R", "rho/2·CdA·flow·|flow|", "source")
    s.on("body.forward", "body.grade", "Se", "-m·g·sin(inclination)", "target", inwards=True)
    s.node("body.pitch", "1", "rotation")
    s.node("body.heave", "1", "translation")
    s.on("body.pitch", "body.pitch_inertia", "I", "momentum/I_p", "target")
    s.on("body.heave", "body.heave_mass", "I", "momentum/m", "target")
    s.on("body.heave", "body.weight", "Se", "-m·g·cos(inclination)", "target", inwards=True)
    for end, arm in (("front", "a"), ("rear", "-b")):
        s.node(f"body.{end}", "1", "translation")
        s.node(f"body.{end}_sum", "0", "translation")
        s.bond("body.heave", f"body.{end}_sum", "target")
        s.two_port(f"body.{end}_arm", "TF", arm, "body.pitch", f"body.{end}_sum", ("target", "target"))
        s.bond(f"body.{end}_sum", f"body.{end}", "source")
        s.on(f"body.{end}", f"body.{end}_spring", "C", f"k_{end}·displacement", "source")
        s.on(f"body.{end}", f"body.{end}_damper", "R", f"c_{end}·flow", "source")
    s.two_port("body.squat", "TF", "r_z", "body.forward", "body.pitch", ("source", "source"))


def vehicle() -> Drawing:
    """A vehicle with a belt CVT: nested sub-graphs, loops, modulation, long laws, derivative causality."""
    s = Sketch("vehicle")
    _engine(s)
    _cvt(s)
    _axle(s, "rear_axle", driven=True)
    _axle(s, "front_axle", driven=False)
    _body(s)
    for end in ("rear", "front"):
        s.bond(f"{end}_axle.contact", "body.forward", "source")
        s.signals.append((f"body.{end}", f"{end}_axle.tyre"))
        s.signals.append((f"body.{end}", f"{end}_axle.rolling"))
    return s.drawing()


SAMPLES = {"dc_motor": dc_motor, "two_mass_driveline": two_mass_driveline, "vehicle": vehicle}
