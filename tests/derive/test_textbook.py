"""Textbook systems against their known equations, and against the oracle."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC, ROTATION, TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import Derivation, derive
from bondgraph.derive.dimensions import check_dimensions
from tests.derive.compare import compare, loaded
from tests.derive.spec import damper, derivatives, force, graph, mass, outputs, same, speed, spring


def test_mass_spring_damper():
    g = graph(
        {"F": force(), "v": "1", "m": mass(), "k": spring(), "b": damper()},
        "F->v v->m v->k v->b",
        {"m": 2, "k": 3, "b": 4},
        "u",
    )
    assert same(derivatives(g), f_m="(u - k*q_k - b*f_m)/m", q_k="f_m")


def test_parallel_rlc_driven_by_a_current():
    nodes = {"s": speed(), "z": "0", "c": spring("1/C"), "l": mass("L"), "r": damper("R")}
    g = graph(nodes, "s->z z->c z->l z->r", {"C": 1e-6, "L": 1e-3, "R": 50}, "u")
    assert same(derivatives(g), q_c="u - f_l - q_c/(C*R)", f_l="q_c/(C*L)")


def test_dc_motor_with_units():
    g = BondGraph("dc_motor")
    u = g.input("u_a", "V")
    L, R, k = g.parameter("L_a", 0.01, "H"), g.parameter("R_a", 1.0, "ohm"), g.parameter("k_m", 0.1, "N m / A")
    J, b = g.parameter("J", 0.02, "kg m^2"), g.parameter("b", 0.1, "N m s")
    loop, shaft = g.one_junction("loop", ELECTRICAL), g.one_junction("shaft", ROTATION)
    g.effort_source("supply", u, at=loop)
    g.inertance("L", L, at=loop)
    g.resistance("R", R, at=loop)
    g.gyrator("machine", k, loop, shaft)
    g.inertance("rotor", J, at=shaft)
    g.resistance("bearing", b, at=shaft)
    g.measure_flow("omega", shaft)
    assert same(derivatives(g), i_L="(u_a - R_a*i_L - k_m*omega_rotor)/L_a", omega_rotor="(k_m*i_L - b*omega_rotor)/J")
    equations = derive(assign_causality(g))
    check_dimensions(equations)
    assert [state.unit for state in equations.states] == ["A", "rad/s"]
    assert equations.outputs[0].unit == "rad/s"


def test_two_mass_driveline():
    nodes = {
        "T": force(), "w1": "1", "J1": mass("J1"), "z": "0", "tw": "1", "k": spring("c"), "d": damper("d"),
        "w2": "1", "J2": mass("J2"), "load": damper("b"),
    }  # fmt: skip
    bonds = "T->w1 w1->J1 w1->z z->tw tw->k tw->d z->w2 w2->J2 w2->load"
    g = graph(nodes, bonds, {"J1": 1, "c": 200, "d": 0.3, "J2": 2, "b": 0.1}, "u")
    assert same(
        derivatives(g),
        f_J1="(u - c*q_k - d*(f_J1 - f_J2))/J1",
        q_k="f_J1 - f_J2",
        f_J2="(c*q_k + d*(f_J1 - f_J2) - b*f_J2)/J2",
    )


def test_hydraulic_line_of_two_lumps():
    g = BondGraph("line")
    p_in = g.input("p_in", "Pa")
    inertance, beta, R = (
        g.parameter("I_f", 1e6, "Pa s^2/m^3"),
        g.parameter("C_f", 1e-11, "m^3/Pa"),
        g.parameter("R_f", 1e8, "Pa s/m^3"),
    )
    before = None
    for i in (1, 2):
        flow, node = g.one_junction(f"flow{i}", HYDRAULIC), g.zero_junction(f"node{i}", HYDRAULIC)
        if before is None:
            g.effort_source("pump", p_in, at=flow)
        else:
            g.bond(before, flow)
        g.inertance(f"slug{i}", inertance, at=flow)
        g.resistance(f"wall{i}", R, at=flow)
        g.bond(flow, node)
        g.compliance(f"volume{i}", 1 / beta, at=node)
        before = node
    g.resistance("nozzle", flow=lambda p: p / (10 * R), at=before)
    check_dimensions(derive(assign_causality(g)))
    assert same(
        derivatives(g),
        Q_slug1="(p_in - R_f*Q_slug1 - q_volume1/C_f)/I_f",
        q_volume1="Q_slug1 - Q_slug2",
        Q_slug2="(q_volume1/C_f - R_f*Q_slug2 - q_volume2/C_f)/I_f",
        q_volume2="Q_slug2 - q_volume2/(10*C_f*R_f)",
    )


def test_wheatstone_bridge():
    nodes = {"s": force(), "top": "0", "left": "0", "right": "0"}
    nodes |= {f"b{i}": "1" for i in range(1, 5)} | {f"R{i}": damper(f"R{i}") for i in range(1, 5)}
    nodes |= {"middle": "1", "G": damper("Rg")}
    bonds = "s->top top->b1 b1->R1 b1->left left->b2 b2->R2 top->b3 b3->R3 b3->right right->b4 b4->R4 left->middle"
    bonds += " middle->G middle->right"
    values = {"R1": 1, "R2": 2, "R3": 3, "R4": 4, "Rg": 5}
    g = graph(nodes, bonds, values, "u", outputs=[{"name": "i_g", "variable": "flow", "at": "middle"}])
    determinant = "(R1*R2*R3 + R1*R2*R4 + R1*R3*R4 + R2*R3*R4 + Rg*(R1 + R2)*(R3 + R4))"
    assert same(outputs(g), i_g=f"u*(R2*R3 - R1*R4)/{determinant}")


def test_geared_inertias_share_one_state():
    nodes = {"T": force(), "a": "1", "J1": mass("J1"), "gear": ("TF", {"modulus": "n"}), "b": "1", "J2": mass("J2")}
    g = graph(
        nodes | {"drag": damper("c")},
        "T->a a->J1 a->gear gear->b b->J2 b->drag",
        {"J1": 1, "n": 3, "J2": 2, "c": 0.1},
        "u",
    )
    assert same(derivatives(g), f_J1="(u - n**2*c*f_J1)/(J1 + n**2*J2)")
    assert same(derivatives(g, ["J2"]), f_J2="(n*u - n**2*c*f_J2)/(J1 + n**2*J2)")


def pendulum(joint: bool) -> BondGraph:
    nodes = {
        "turn": "1", "mx": ("TF", {"modulus": "l*cos(theta)"}), "my": ("TF", {"modulus": "l*sin(theta)"}),
        "vx": "1", "vy": "1", "Mx": mass(), "My": mass(), "weight": ("Se", {"effort": "-m*g"}),
    }  # fmt: skip
    if joint:
        nodes = {"J": mass("J")} | nodes
    bonds = "turn->mx mx->vx vx->Mx turn->my my->vy vy->My weight->vy" + (" turn->J" if joint else "")
    integrals = [{"name": "theta", "of": "flow(turn)"}]
    return graph(nodes, bonds, {"m": 1.2, "l": 0.5, "g": 9.81, "J": 0.05}, integrals=integrals)


def test_pendulum_by_modulated_transformers():
    assert same(derivatives(pendulum(joint=True)), f_J="-m*g*l*sin(theta)/(J + m*l**2)", theta="f_J")
    assert compare(pendulum(joint=True)) == ""


def test_pendulum_without_inertia_at_the_joint_has_one_independent_mass():
    g = pendulum(joint=False)
    assert compare(g, 3) == ""
    found = derivatives(g)
    assert same(
        found, f_Mx="-g*sin(theta)*cos(theta) - f_Mx**2*sin(theta)/(l*cos(theta)**2)", theta="f_Mx/(l*cos(theta))"
    )


def test_slider_crank():
    travel = "-(r*sin(angle) + r**2*sin(angle)*cos(angle)/sqrt(l**2 - r**2*sin(angle)**2))"
    nodes = {
        "T": force(), "turn": "1", "J": mass("J"), "rod": ("TF", {"modulus": travel}), "slide": "1", "m": mass(),
        "F": damper(),
    }  # fmt: skip
    bonds = "T->turn turn->J turn->rod rod->slide slide->m slide->F"
    integrals = [{"name": "angle", "of": "flow(turn)"}]
    g = graph(nodes, bonds, {"J": 0.1, "r": 0.1, "l": 0.3, "m": 0.5, "b": 2.0}, "u", integrals=integrals)
    assert [compare(g, seed) for seed in range(3)] == ["", "", ""]


def test_rigid_body_turns_by_eulers_equations():
    nodes = {f"w{a}": "1" for a in "xyz"} | {f"I{a}": mass(f"J{a}") for a in "xyz"}
    nodes |= {f"g{a}": ("GY", {"modulus": f"momentum(I{a})"}) for a in "xyz"}
    bonds = "wx->Ix wy->Iy wz->Iz wx->gz gz->wy wy->gx gx->wz wz->gy gy->wx"
    g = graph(nodes, bonds, {"Jx": 1, "Jy": 2, "Jz": 3})
    assert same(
        derivatives(g), f_Ix="(Jy - Jz)*f_Iy*f_Iz/Jx", f_Iy="(Jz - Jx)*f_Iz*f_Ix/Jy", f_Iz="(Jx - Jy)*f_Ix*f_Iy/Jz"
    )


def coils(source: tuple[str, dict]) -> BondGraph:
    energy = "(L2*momentum1**2 - 2*M*momentum1*momentum2 + L1*momentum2**2)/(2*(L1*L2 - M**2))"
    nodes = {
        "s": source,
        "a": "1",
        "b": "1",
        "L": ("I", {"ports": 2, "energy": energy}),
        "R1": damper("R1"),
        "R2": damper("R2"),
    }
    return graph(nodes, "s->a a->L b->L a->R1 b->R2", {"L1": 1, "L2": 2, "M": 0.5, "R1": 1, "R2": 2}, "u")


def test_coupled_coils():
    assert same(
        derivatives(coils(force())),
        p_L1="u - R1*(L2*p_L1 - M*p_L2)/(L1*L2 - M**2)",
        p_L2="-R2*(L1*p_L2 - M*p_L1)/(L1*L2 - M**2)",
    )


def test_coupled_coils_driven_by_a_current_depend_on_its_rate():
    g = coils(speed())
    equations = derive(assign_causality(g))
    assert [given.name for given in equations.inputs] == ["u"]
    assert same(derivatives(g), p_L2="-R2*(p_L2 - M*u)/L2")
    assert compare(g) == ""


def test_nonlinear_storages_keep_momentum_and_displacement():
    nodes = {
        "F": force(),
        "v": "1",
        "m": ("I", {"flow": "momentum/sqrt(m**2 + momentum**2/c**2)"}),
        "k": ("C", {"effort": "k*displacement + k3*displacement**3"}),
    }
    g = graph(nodes, "F->v v->m v->k", {"m": 1, "c": 3, "k": 2, "k3": 5}, "u")
    assert same(derivatives(g), p_m="u - k*q_k - k3*q_k**3", q_k="p_m/sqrt(m**2 + p_m**2/c**2)")


def test_operational_amplifier_as_an_inverting_stage():
    nodes = {
        "v_in": force(), "a": "1", "R1": damper("R1"), "minus": "0", "b": "1", "R2": damper("R2"), "out": "0",
        "amplifier": ("Se", {"effort": "-A*effort(minus)"}), "load": damper("R_L"),
    }  # fmt: skip
    bonds = "v_in->a a->R1 a->minus minus->b b->R2 b->out amplifier->out out->load"
    values = {"R1": 1e3, "R2": 1e4, "A": 1e7, "R_L": 1e3}
    g = graph(nodes, bonds, values, "u", outputs=[{"name": "v_out", "variable": "effort", "at": "out"}])
    assert same(outputs(g), v_out="-A*R2*u/(R1 + R2 + A*R1)")


def diode_line(stages: int, law: dict[str, str]) -> BondGraph:
    """A ladder of capacitors joined by diodes: an RC line whose resistances have implicit laws."""
    nodes: dict = {"s": force()}
    bonds, before = [], "s"
    for i in range(stages):
        nodes |= {f"a{i}": "1", f"D{i}": ("R", law), f"z{i}": "0", f"C{i}": spring("1/C"), f"G{i}": damper("R")}
        bonds += [f"{before}->a{i}", f"a{i}->D{i}", f"a{i}->z{i}", f"z{i}->C{i}", f"z{i}->G{i}"]
        before = f"z{i}"
    return graph(nodes, " ".join(bonds), {"C": 1e-6, "R": 1e4, "Is": 1e-9, "Vt": 0.05, "r": 10.0}, "u")


def test_diode_line_with_residual_laws():
    explicit = diode_line(3, {"residual": "flow - Is*(exp(effort/Vt) - 1)"})
    assert not [step for step in derive(assign_causality(explicit)).assignments if hasattr(step, "residuals")]
    assert same(
        derivatives(diode_line(1, {"residual": "flow - Is*(exp(effort/Vt) - 1)"})),
        q_C0="Is*(exp((u - q_C0/C)/Vt) - 1) - q_C0/(C*R)",
    )
    implicit = diode_line(3, {"residual": "flow - Is*(exp((effort - r*flow)/Vt) - 1)"})
    equations = derive(assign_causality(implicit))
    loops = [step for step in equations.assignments if hasattr(step, "residuals")]
    assert [len(loop.unknowns) for loop in loops] == [1, 1, 1]
    module = loaded(equations)
    theta = np.array([given.value for given in equations.parameters])
    x, u = np.array([4e-7, 2e-7, 1e-7]), np.array([0.8])
    rates = module["rhs"](0.0, x, u, theta)
    volts = np.concatenate([u, x / 1e-6])
    currents = np.array([current(a - b) for a, b in itertools.pairwise(volts)])
    expected = currents - np.append(currents[1:], 0.0) - volts[1:] / 1e4
    np.testing.assert_allclose(rates, expected, rtol=1e-9)


def current(volts: float) -> float:
    """The diode's current with its series resistance, by bisection."""
    low, high = -1e-9, 1.0
    for _ in range(200):
        middle = (low + high) / 2
        exponent = min((volts - 10.0 * middle) / 0.05, 500.0)
        low, high = (middle, high) if middle < 1e-9 * np.expm1(exponent) else (low, middle)
    return low


def test_kirchhoff_meshes():
    nodes = {"s": force(), "m1": "1", "m2": "1", "m3": "1", "z12": "0", "z23": "0", "j12": "1", "j23": "1"}
    nodes |= {name: damper(name) for name in ("Ra", "Rb", "Rc", "Rd", "Re")}
    bonds = "s->m1 m1->Ra m1->z12 z12->j12 j12->Rb z12->m2 m2->Rc m2->z23 z23->j23 j23->Rd z23->m3 m3->Re"
    values = {name: 1.0 + i for i, name in enumerate(("Ra", "Rb", "Rc", "Rd", "Re"))}
    wanted = [{"name": f"i{i}", "variable": "flow", "at": f"m{i}"} for i in (1, 2, 3)]
    g = graph(nodes, bonds, values, "u", outputs=wanted)
    equations = derive(assign_causality(g))
    found = loaded(equations)["output"](0.0, np.zeros(0), np.array([10.0]), np.array(list(values.values())))
    a, b, c, d, e = values.values()
    meshes = np.array([[a + b, -b, 0.0], [-b, b + c + d, -d], [0.0, -d, d + e]])
    np.testing.assert_allclose(found, np.linalg.solve(meshes, [10.0, 0.0, 0.0]), rtol=1e-12)


def test_chemical_reaction_network():
    """Two reactions with mass-action kinetics, each a two-port R given by residuals of both its sides."""
    nodes: dict = {f"z{s}": "0" for s in "ABCD"}
    nodes |= {s: ("C", {"effort": f"RT*log(K_{s}*displacement)", "initial": 1.0}) for s in "ABCD"}
    for number in (1, 2):
        residuals = [f"flow1 - k{number}*(exp(effort1/RT) - exp(-effort2/RT))", "flow1 - flow2"]
        nodes[f"Re{number}"] = ("R", {"ports": 2, "residuals": residuals})
    nodes["forward"] = "1"
    bonds = "zA->A zB->B zC->C zD->D zA->forward zB->forward forward->Re1 zC->Re1 zC->Re2 zD->Re2"
    values = {"RT": 2.5, "k1": 0.3, "k2": 0.7} | {f"K_{s}": 1.0 + i for i, s in enumerate("ABCD")}
    g = graph(nodes, bonds, values)
    # both ports of a reaction count their flow into it, so here its second species is consumed as well
    found = derivatives(g)
    r1 = "k1*(K_A*q_A*K_B*q_B - 1/(K_C*q_C))"
    r2 = "k2*(K_C*q_C - 1/(K_D*q_D))"
    assert same(found, q_A=f"-{r1}", q_B=f"-{r1}", q_C=f"-{r1} - {r2}", q_D=f"-{r2}")


def test_reaction_with_the_product_on_an_outgoing_bond():
    nodes: dict = {f"z{s}": "0" for s in "ABC"}
    nodes |= {s: ("C", {"effort": f"RT*log(K_{s}*displacement)"}) for s in "ABC"}
    nodes |= {
        "in": "1",
        "Re": ("R", {"ports": 2, "residuals": ["flow1 - k*(exp(effort1/RT) - exp(effort2/RT))", "flow1 + flow2"]}),
    }
    values = {"RT": 2.5, "k": 0.3, "K_A": 1.0, "K_B": 2.0, "K_C": 3.0}
    g = graph(nodes, "zA->A zB->B zC->C zA->in zB->in in->Re Re->zC", values)
    rate = "k*(K_A*q_A*K_B*q_B - K_C*q_C)"
    assert same(derivatives(g), q_A=f"-{rate}", q_B=f"-{rate}", q_C=rate)


def beam(lumps: int) -> BondGraph:
    """A cantilever of lumped masses and bending springs (Karnopp et al. 2012, section 10.3): 2 states per lump."""
    g = BondGraph("beam")
    F = g.input("F", "N", "force at the tip")
    m, k, h = g.parameter("m", 0.2, "kg"), g.parameter("k_b", 4e3, "N m"), g.parameter("h", 0.05, "m")
    w = [g.one_junction(f"w{i}", TRANSLATION) for i in range(lumps)]
    for i, junction in enumerate(w):
        g.inertance(f"m{i}", m, at=junction)
    for i in range(lumps):
        # rate of the bending angle at station i: (w[i] - 2 w[i-1] + w[i-2])/h, fixed end: w = 0 before the first
        bend = g.one_junction(f"bend{i}", ROTATION)
        g.compliance(f"k{i}", k, at=bend)
        angle = g.zero_junction(f"angle{i}", ROTATION)
        g.bond(angle, bend)
        for offset, weight in ((0, 1), (1, -2), (2, 1)):
            if i - offset >= 0:
                g.transformer(f"t{i}_{offset}", weight / h, w[i - offset], angle)
    g.effort_source("tip", F, at=w[-1])
    return g


def test_beam_of_forty_states():
    g = beam(20)
    derivation = Derivation(assign_causality(g))
    equations = derivation.equations()
    assert len(equations.states) == 40 and not derivation.loops and not derivation.causal.derivative
    check_dimensions(equations)
    m, k, h = 0.2, 4e3, 0.05
    second = (np.eye(20) - 2 * np.eye(20, k=-1) + np.eye(20, k=-2)) / h
    module = loaded(equations)
    rng = np.random.default_rng(1)
    x, theta = rng.normal(size=40), np.array([m, k, h])
    v, q = x[:20], x[20:]
    assert [state.symbol.name for state in equations.states] == [f"v_m{i}" for i in range(20)] + [
        f"q_k{i}" for i in range(20)
    ]
    tip = np.zeros(20)
    tip[-1] = 3.0
    np.testing.assert_allclose(
        module["rhs"](0.0, x, np.array([3.0]), theta),
        np.concatenate([(tip - second.T @ (k * q)) / m, second @ v]),
        rtol=1e-10,
    )


def test_bouncing_ball_with_a_smooth_contact():
    law = "switch(-displacement, 1e-4)*k*displacement"
    nodes = {
        "v": "1",
        "m": mass(),
        "weight": ("Se", {"effort": "-m*g"}),
        "floor": ("C", {"effort": law, "initial": 1.0}),
    }
    g = graph(nodes, "weight->v v->m v->floor", {"m": 0.5, "g": 9.81, "k": 1e5})
    module = loaded(derive(assign_causality(g)))
    theta = np.array([0.5, 9.81, 1e5])
    above = module["rhs"](0.0, np.array([0.0, 1.0]), np.zeros(0), theta)
    below = module["rhs"](0.0, np.array([0.0, -0.01]), np.zeros(0), theta)
    np.testing.assert_allclose(above, [-9.81, 0.0], atol=1e-12)
    np.testing.assert_allclose(below, [1e5 * 0.01 / 0.5 - 9.81, 0.0], rtol=1e-12)
    exact = derive(assign_causality(g), smooth=False)
    assert [str(event) for event in exact.events] == ["-q_floor"]
    assert compare(g) == ""


@pytest.mark.parametrize("system", [pendulum(True), coils(force()), beam(3)])
def test_systems_agree_with_the_oracle(system):
    assert compare(system, 5) == ""
