"""Power balance: what the sources supply is stored or dissipated, on every kind of graph; energies by quadrature."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.integrate
import scipy.interpolate
import sympy
from sympy import Abs, Piecewise, Rational, cos, exp, log, sin, sqrt, tanh

from bondgraph.declare.domains import ELECTRICAL, HYDRAULIC, ROTATION, THERMAL, TRANSLATION
from bondgraph.declare.elements import Node
from bondgraph.declare.functions import maximum, minimum, table_function
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Table, symbol
from bondgraph.declare.switching import end_stop, positive_part
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import check_closed, derive
from bondgraph.derive.dimensions import check_dimensions
from bondgraph.derive.power import integral, power_balance
from bondgraph.derive.values import Evaluator
from bondgraph.errors import BondGraphError, DerivationError
from tests.derive.random_graphs import RandomGraph

Q, P, A, K = symbol("displacement"), symbol("momentum"), symbol("a"), symbol("k")


def balance_of(graph, energies=None, smooth=True, **choice):
    return power_balance(assign_causality(graph, **choice), energies, smooth)


def values_at(balance, seed):
    """Stored energy, supplied, dissipated power and rate at a random point, and the power into each element."""
    equations = balance.equations
    rng = np.random.default_rng(seed)
    evaluator = Evaluator(equations)
    x, u = rng.uniform(-0.7, 0.7, len(equations.states)), rng.uniform(-1, 1, len(equations.inputs))
    values = evaluator.at(x, u, t=rng.uniform(0, 2))
    found = [evaluator.value(output.expression, values) for output in equations.outputs]
    return np.array(found), {e.element: evaluator.value(e.power, values) for e in balance.elements}


def check(balance, seeds=range(4), tolerance=1e-8):
    """The identity, and that the storages' power is the rate of the energy."""
    check_closed(balance.equations)
    kinds = {element.element: element.kind for element in balance.elements}
    compared = 0
    for seed in seeds:
        (_, supplied, dissipated, rate), powers = values_at(balance, seed)
        if not np.isfinite([supplied, dissipated, rate]).all():
            continue
        scale = max(1.0, abs(supplied), abs(dissipated), *(abs(power) for power in powers.values()))
        assert rate == pytest.approx(supplied - dissipated, abs=tolerance * scale)
        into_storages = sum(power for name, power in powers.items() if kinds[name] in ("C", "I"))
        assert rate == pytest.approx(into_storages, abs=tolerance * scale)
        compared += 1
    assert compared


# ---------------------------------------------------------------------- whole graphs


@pytest.mark.parametrize("linear", [True, False])
def test_the_balance_holds_on_random_graphs(linear):
    balanced = dependent = 0
    for seed in range(700, 730):
        graph = RandomGraph(seed, linear=linear, mesh=0.1).graph
        try:
            causal = assign_causality(graph)
            derive(causal)
        except BondGraphError:
            continue
        balance = power_balance(causal)
        if any(not np.isfinite(values_at(balance, s)[0]).all() for s in range(2)):
            continue
        check(balance, range(2), 1e-7)
        balanced += 1
        dependent += bool(causal.derivative)
    assert balanced >= 8
    assert dependent >= 2


def two_inertias(modulus):
    """Two inertias on both sides of a transformer: one follows the other."""
    g = BondGraph("geared")
    J, m, c, k = (g.parameter(n, v, "") for n, v in (("J", 0.3), ("m", 2.0), ("c", 0.4), ("k", 3.0)))
    shaft, body = g.one_junction("shaft"), g.one_junction("body")
    g.effort_source("drive", g.input("tau", ""), at=shaft)
    g.inertance("rotor", J, at=shaft, state="omega")
    g.transformer("gear", modulus(g), shaft, body)
    g.inertance("mass", m, at=body)
    g.resistance("drag", lambda v: c * v * Abs(v), at=body)
    g.compliance("spring", k, at=body, state="q")
    return g


def test_a_dependent_storage_keeps_its_energy():
    balance = balance_of(two_inertias(lambda g: g.parameter("n", 4.0, "")))
    J, m, n, k, omega, q = (symbol(name) for name in ("J", "m", "n", "k", "omega", "q"))
    known = {step.symbol: step.expression for step in balance.equations.assignments}
    stored = balance.stored.xreplace(known)
    assert sympy.expand(stored - J * omega**2 / 2 - m * (n * omega) ** 2 / 2 - k * q**2 / 2) == 0
    check(balance)


def test_a_dependent_storage_behind_a_modulated_transformer_keeps_its_energy():
    """The lever ratio changes with the position, so the mass matrix does too."""
    balance = balance_of(two_inertias(lambda g: 1 + sin(symbol("displacement(spring)")) / 3))
    assert any(element.element == "mass" and element.energy is not None for element in balance.elements)
    check(balance)


def test_a_dependent_nonlinear_storage_is_solved_for_its_energy():
    g = BondGraph("bus")
    bus = g.zero_junction("bus")
    g.compliance("first", lambda q: 2 * q + q**3, at=bus, state="q_first")
    g.compliance("second", lambda q: 3 * q + q**5, at=bus)
    g.flow_source("pump", g.input("i", ""), at=bus)
    g.resistance("leak", lambda e: e / 7, at=bus)
    check(balance_of(g))


def test_a_storage_that_depends_on_an_input_takes_the_rate_of_the_input():
    g = BondGraph("filter")
    loop = g.zero_junction("loop")
    g.effort_source("supply", g.input("u_s", "V"), at=loop)
    g.compliance("capacitor", g.parameter("k", 5.0, "1/F"), at=loop)
    g.resistance("load", g.parameter("R", 3.0, "ohm"), at=loop)
    balance = balance_of(g)
    assert [declared.name for declared in balance.equations.inputs] == ["u_s", "d_u_s"]
    u, rate, k, R = (symbol(name) for name in ("u_s", "d_u_s", "k", "R"))
    known = {step.symbol: step.expression for step in balance.equations.assignments}
    assert sympy.expand(balance.rate.xreplace(known) - u * rate / k) == 0
    assert sympy.expand(balance.dissipated.xreplace(known) - u**2 / R) == 0
    check(balance)


def test_sources_of_time_and_loops_balance():
    g = BondGraph("looped")
    a, t = g.parameter("a", 1.3, ""), symbol("t")
    one, z = g.one_junction("one"), g.zero_junction("z")
    g.effort_source("shaker", a * sin(3 * t), at=one)
    g.resistance("series", lambda f: f + f**3, at=one)
    g.bond(one, z)
    g.resistance("shunt", residual=lambda e, f: e + tanh(e) - f, at=z)
    far = g.one_junction("far")
    g.bond(z, far)
    g.resistance("bridge", 0.7, at=far)
    g.compliance("tank", lambda q: sympy.sinh(q), at=far)
    check(balance_of(g))


def test_gyrators_fields_and_elements_of_ones_own_balance():
    g = BondGraph("coils")
    a, b = g.one_junction("a"), g.one_junction("b")
    g.effort_source("supply", g.input("u", ""), at=a)
    g.field("I", "coupled", [lambda p1, p2: 3 * p1 - p2, lambda p1, p2: 2 * p2 - p1], at=[a, b])
    g.field("C", "plates", energy=lambda q1, q2: (q1 - q2) ** 2 + q1**4 + sin(q2), at=[a, b])
    g.field("R", "cross", [lambda f1, f2: 2 * f1 + f2, lambda f1, f2: f1 + 3 * f2], at=[a, b])
    shaft = g.one_junction("shaft")
    g.gyrator("machine", 0.5 + cos(symbol("momentum1(coupled)")) / 5, b, shaft)
    g.inertance("rotor", lambda p: p + p**3, at=shaft)
    balance = balance_of(g)
    energies = {element.element: element.energy for element in balance.elements}
    p1, p2 = symbol("p_coupled1"), symbol("p_coupled2")
    assert sympy.expand(energies["coupled"] - (Rational(3, 2) * p1**2 - p1 * p2 + p2**2)) == 0
    check(balance)


def test_bonds_may_point_either_way():
    g = BondGraph("reversed")
    loop = g.one_junction("loop")
    g.add_node(Node("battery", "Se", laws=(("effort", g.input("u", "")),)))
    g.bond(loop, "battery")
    g.add_node(Node("r", "R", laws=(("effort", 2 * symbol("flow")),)))
    g.bond("r", loop)
    g.add_node(Node("coil", "I", laws=(("flow", symbol("momentum") / 3),), initial=(0.0,)))
    g.bond("coil", loop)
    balance = balance_of(g)
    check(balance)
    (_, _, dissipated, _), powers = values_at(balance, 0)
    assert dissipated == powers["r"] > 0


def driveline():
    g = BondGraph("driveline")
    tau, J, m = g.input("tau", "N m"), g.parameter("J", 0.02, "kg m^2"), g.parameter("m", 260.0, "kg")
    k, c, r = g.parameter("k", 900.0, "N m/rad"), g.parameter("c", 0.6, "kg/m"), g.parameter("r", 0.28, "m")
    engine, shaft, body = g.one_junction("engine", ROTATION), g.zero_junction("shaft", ROTATION), g.one_junction("body")
    g.effort_source("combustion", tau, at=engine)
    g.inertance("crank", J, at=engine)
    g.bond(engine, shaft)
    g.compliance("elastic", k, at=shaft)
    g.transformer("wheel", r, shaft, body)
    g.inertance("car", m, at=body)
    g.resistance("aero", lambda v: c * v * Abs(v), at=body)
    return g


def test_the_four_quantities_are_outputs_in_joule_and_watt():
    g = driveline()
    balance = balance_of(g)
    outputs = balance.equations.outputs
    assert [str(o.symbol) for o in outputs] == [
        "stored_energy", "supplied_power", "dissipated_power", "stored_energy_rate",
    ]  # fmt: skip
    assert [o.expression for o in outputs] == [balance.stored, balance.supplied, balance.dissipated, balance.rate]
    assert {o.unit for o in outputs} == {""}  # the body's domain is not declared
    g = driveline()
    g.add_node(Node("ground", "1", TRANSLATION))
    g.bond("body", "ground")
    balance = balance_of(g)
    assert [o.unit for o in balance.equations.outputs] == ["J", "W", "W", "W"]
    check_dimensions(balance.equations)
    check(balance)
    assert balance.excluded == ()


def test_the_graph_itself_is_left_alone():
    g = driveline()
    causal = assign_causality(g)
    power_balance(causal)
    assert causal.graph.outputs == () and g.outputs == ()


# ---------------------------------------------------------------------- pseudo-bonds


def heated_winding():
    """A winding whose loss heats a wall; the loss element has an electrical and a thermal port."""
    g = BondGraph("winding")
    loop, wall = g.one_junction("loop", ELECTRICAL), g.zero_junction("wall", THERMAL)
    g.effort_source("supply", g.input("u", "V"), at=loop)
    g.inertance("coil", g.parameter("L", 0.1, "H"), at=loop, state="i")
    R, current = g.parameter("R", 2.0, "ohm"), symbol("flow1")
    g.add_node(Node("copper", "X", laws=(("1.effort1", R * current), ("1.flow2", -R * current**2)), ports=2))
    g.bond(loop, "copper")
    g.bond(wall, "copper")
    g.compliance("capacity", 1 / g.parameter("C", 40.0, "J/K"), at=wall)
    g.resistance("cooling", flow=lambda T: T / g.parameter("G", 3.0, "K/W"), at=wall)
    return g


def test_pseudo_bonds_are_left_out_and_named():
    balance = balance_of(heated_winding())
    assert balance.excluded == ("capacity", "cooling")
    assert [element.element for element in balance.elements] == ["supply", "coil", "copper"]
    i, L, R = symbol("i"), symbol("L"), symbol("R")
    assert balance.stored == L * i**2 / 2
    known = {step.symbol: step.expression for step in balance.equations.assignments}
    assert balance.dissipated.xreplace(known) == R * i**2
    check(balance)


def test_a_transformer_between_heat_and_true_power_is_refused():
    g = BondGraph("mixed")
    shaft, wall = g.one_junction("shaft", ROTATION), g.zero_junction("wall", THERMAL)
    g.effort_source("drive", 1.0, at=shaft)
    g.inertance("rotor", 1.0, at=shaft)
    g.transformer("coupling", 2.0, shaft, wall)
    g.resistance("cooling", flow=lambda T: T / 3, at=wall)
    with pytest.raises(DerivationError, match="mixed: TF coupling joins a pseudo-bond domain with a true one"):
        balance_of(g)


# ---------------------------------------------------------------------- energies


def spring(law, energies=None, smooth=True, **flags):
    g = BondGraph("spring")
    g.parameter("k", 1.7, "")
    g.parameter("a", 0.4, "")
    u = g.input("u", "")
    body = g.one_junction("body")
    if flags.get("table"):
        g.table("curve", [0.0, 1.0, 2.0], [0.0, 1.0, 4.0])
    g.inertance("mass", 2.0, at=body, state="v")
    g.effort_source("push", u, at=body)
    g.compliance("spring", law, at=body, state="q")
    return balance_of(g, energies, smooth)


LAWS = {
    "linear": K * Q,
    "preloaded": K * (Q - A),
    "hardening": K * Q + A * Q**3,
    "cubic about": K * (Q - A) ** 3,
    "one-sided": K * maximum(Q - A, 0),
    "hertz": K * maximum(0, Q - A) ** Rational(3, 2),
    "slack": K * minimum(Q + A, 0),
    "floor": maximum(Q, -A),
    "even": K * Q * Abs(Q),
    "root": K * sympy.sign(Q) * sqrt(Abs(Q)),
    "dry": K * sympy.sign(Q - A),
    "tanh": K * tanh(Q / A),
    "sinh": sympy.sinh(Q / A),
    "pendulum": K * sin(Q),
    "exponential": K * (exp(Q / A) - 1),
    "saturating": K * Q / sqrt(1 + Q**2 / A**2),
    "arc tangent": sympy.atan(K * Q),
    "log": log(1 + Q**2),
    "pneumatic": K / (3 - Q) - K / 3,
    "stops": Piecewise((K * (Q - A), Q > A), (K * (Q + A), Q < -A), (0, True)),
    "leaning": K * (Q - A) * Abs(A - Q),
    "tangent": sympy.tan(Q / 2),
    "mixed": K * Q * cos(Q) + 2,
    "any power": K * Abs(Q) ** (A + 1) * sympy.sign(Q),
    "any contact": maximum(Q - A, 0) ** (1 + A),
}


@pytest.mark.parametrize("name", LAWS)
def test_integrals_of_laws_equal_quadrature(name):
    law, values = LAWS[name], {K: 1.7, A: 0.4}
    found = integral(law, Q)
    assert found is not None
    force = sympy.lambdify(Q, law.subs(values).replace(maximum, sympy.Max).replace(minimum, sympy.Min))
    energy = sympy.lambdify(Q, found.subs(values).replace(maximum, sympy.Max).replace(minimum, sympy.Min))
    for end in (-1.3, -0.2, 0.0, 0.35, 0.9, 1.6):
        kinks = [kink for kink in (-0.4, 0.0, 0.4) if min(0, end) < kink < max(0, end)]
        expected = scipy.integrate.quad(force, 0.0, end, points=kinks or None, epsabs=1e-12, epsrel=1e-12)[0]
        assert float(energy(end)) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("name", ["hardening", "hertz", "stops", "pneumatic", "tanh"])
def test_graphs_with_nonlinear_storages_balance(name):
    check(spring(lambda q: LAWS[name].xreplace({Q: q})))


@pytest.mark.parametrize("end", [-3.0, -0.4, 0.0, 0.7, 1.6, 2.5, 9.0])
def test_tables_are_integrated_exactly(end):
    table = Table("curve", (-1.0, 0.0, 1.5, 2.5), (-4.0, 0.0, 1.0, 5.0))
    law = 2 * table_function("curve")(K * Q + Rational(1, 10)) + Q
    found = integral(law, Q, {"curve": table}).subs(K, Rational(4, 5))
    curve = scipy.interpolate.PchipInterpolator(table.x, table.values)

    def force(q):
        return 2 * float(curve(np.clip(0.8 * q + 0.1, -1.0, 2.5))) + q

    kinks = [(knot - 0.1) / 0.8 for knot in table.x if min(0, end) < (knot - 0.1) / 0.8 < max(0, end)]
    expected = scipy.integrate.quad(force, 0.0, end, points=kinks or None, epsabs=1e-12, epsrel=1e-12)[0]
    assert float(found.subs(Q, end)) == pytest.approx(expected, abs=1e-9)


def test_a_tabulated_spring_balances():
    check(spring(lambda q: table_function("curve")(q + A), table=True))


def test_laws_without_an_integral_need_their_energy():
    for law in (lambda q: exp(-(q**2)), lambda q: maximum(K * q, A * q**2), lambda q: maximum(q, A) ** 2 + K * q):
        with pytest.raises(
            DerivationError, match=r"of C spring is not known: its law has no integral .* - give it as ene"
        ):
            spring(law)
    with pytest.raises(
        DerivationError, match="has a table that cannot be integrated - use a table of its displacement"
    ):
        spring(lambda q: table_function("curve")(q**2), table=True)
    for law in (Abs(Q) ** A * maximum(Q, 0), Abs(Q) ** Q, 1 / Abs(Q) ** 1 * sympy.sinh(Q), sqrt(Q) * Abs(Q) ** A, Q**Q):
        assert integral(law, Q) is None
    with pytest.raises(DerivationError, match="given for C spring does not belong to its law"):
        spring(lambda q: table_function("curve")(q**2), {"spring": Q**2}, table=True)


def test_fields_of_tables_are_refused():
    g = BondGraph("field")
    g.table("curve", [0.0, 1.0], [0.0, 1.0])
    curve = table_function("curve")
    a, b = g.one_junction("a"), g.one_junction("b")
    g.field("C", "plates", [lambda q1, q2: curve(q1) + q2, lambda q1, q2: curve(q2) + q1], at=[a, b])
    g.inertance("m", 1.0, at=a)
    g.inertance("n", 1.0, at=b)
    with pytest.raises(DerivationError, match="C plates is not known: its law has a table that cannot be integrated"):
        balance_of(g)


def test_a_given_energy_is_used_and_checked():
    def law(q):
        return maximum(K * q, A * q)

    def energy(q):
        return q**2 / 2 * Piecewise((K, (K > A) & (q > 0)), (A, q > 0), (A, K > A), (K, True))

    balance = spring(law, {"spring": energy})
    check(balance)
    assert spring(law, {"spring": energy(Q)}).stored == balance.stored
    with pytest.raises(DerivationError, match=r"displacement\*\*2 given for C spring does not belong to its law"):
        spring(law, {"spring": lambda q: q**2})
    with pytest.raises(DerivationError, match="no storage 'sprong'; did you mean 'spring'"):
        spring(law, {"sprong": energy})


def test_given_energies_are_checked_against_every_form_of_a_law():
    effort = symbol("effort")
    laws = {
        "residual": (("residual", effort + effort**3 - Q - Q**3), Q**2 / 2),
        "displacement": (("displacement", effort**3 + 2 * effort), None),
        "energy": (("energy", Q**2 + Q**4), Q**2 + Q**4),
    }
    for law, energy in laws.values():
        g = BondGraph("given")
        body = g.one_junction("body")
        g.inertance("mass", 2.0, at=body)
        g.add_node(Node("spring", "C", laws=(law,), initial=(0.0,)))
        g.bond(body, "spring")
        with pytest.raises(DerivationError, match="does not belong to its law"):
            balance_of(g, {"spring": Q**5})
        if energy is not None:
            check(balance_of(g, {"spring": energy}))


def test_switches_store_energy_as_jumps_only():
    def law(q):
        return end_stop(q, -A, A, K, 0.01)

    check(spring(law, smooth=False))
    with pytest.raises(DerivationError, match="its law has no integral in closed form"):
        spring(law)
    assert not spring(lambda q: positive_part(q - A, 0.1) * K, smooth=False).stored.has(symbol("displacement"))


def test_storages_in_other_forms_have_their_energy():
    g = BondGraph("forms")
    body = g.one_junction("body")
    g.effort_source("push", g.input("u", ""), at=body)
    laws = {
        "by_energy": (("energy", Q**2 + Q**4),),
        "by_residual": (("residual", symbol("effort") * (1 + Q**2) - Q),),
        "by_inverse": (("displacement", tanh(symbol("effort"))),),
    }
    for name, law in laws.items():
        g.add_node(Node(name, "C", laws=law, initial=(0.0,)))
        g.bond(body, name)
    g.inertance("mass", 2.0, at=body)
    balance = balance_of(g)
    check(balance)
    energy = next(e.energy for e in balance.elements if e.element == "by_residual")
    q = symbol("q_by_residual")
    assert sympy.simplify(energy.diff(q) - q / (1 + q**2)) == 0


def test_a_law_that_uses_more_than_its_own_variables_is_refused():
    with pytest.raises(
        DerivationError, match="the law of C spring uses u, so its energy is not a function of its displ"
    ):
        spring(lambda q: K * q * (1 + symbol("u")))


def test_a_field_without_an_energy_is_refused():
    g = BondGraph("broken")
    a, b = g.one_junction("a"), g.one_junction("b")
    g.effort_source("supply", 1.0, at=a)
    g.field("C", "skew", [lambda q1, q2: q1 + q2, lambda q1, q2: q2 - q1], at=[a, b])
    g.resistance("r", 1.0, at=b)
    g.inertance("m", 1.0, at=a)
    with pytest.raises(DerivationError, match="C field skew stores no energy: its laws are not the gradient of one"):
        balance_of(g)


def test_names_of_the_users_outputs_do_not_matter():
    g = driveline()
    g.measure_flow("energy_of_car", "body", unit="m/s")
    assert balance_of(g).stored == balance_of(driveline()).stored


def test_hydraulic_line():
    """A tank filled through a line: the energy in the tank is rho g h^2 A / 2 in other letters."""
    g = BondGraph("line")
    tank, line = g.zero_junction("tank", HYDRAULIC), g.one_junction("line", HYDRAULIC)
    g.effort_source("pump", g.input("p", "Pa"), at=line)
    g.inertance("water", g.parameter("I", 1e6, "Pa s^2/m^3"), at=line, state="Q")
    g.resistance("wall", lambda q: g.parameter("R", 1e9, "Pa s^2/m^6") * q * Abs(q), at=line)
    g.bond(line, tank)
    g.compliance("level", g.parameter("rho_g_per_area", 5e3, "Pa/m^3"), at=tank, state="V")
    balance = balance_of(g)
    assert balance.stored == symbol("I") * symbol("Q") ** 2 / 2 + symbol("rho_g_per_area") * symbol("V") ** 2 / 2
    check_dimensions(balance.equations)
    check(balance)
