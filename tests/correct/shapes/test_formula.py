"""Formulas: terms as laws and as numbers, best sums, elements, text and Python, and what free parameters take."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
import sympy

import bondgraph as bg
from bondgraph.arrays import FloatArray
from bondgraph.correct.loop import LoopSettings, close_loop
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.places.probes import Signal, argument, probes, signals
from bondgraph.correct.places.unexplained import distinct, splines
from bondgraph.correct.result import intervals, result_json
from bondgraph.correct.scores.scoring import linearisation
from bondgraph.correct.shapes import subsets
from bondgraph.correct.shapes.formula import Formula, formula_of
from bondgraph.correct.shapes.library import Term, library, products
from bondgraph.correct.shapes.subsets import Terms, best_sums, scored_products
from bondgraph.correct.shapes.words import moved_parameters
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.local import Fit, fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.report.formulas import formula_sentences
from bondgraph.report.missing import missing_efforts
from tests.correct import sled
from vehicle_graphs import effects

MASS, STIFFNESS, DAMPING, CUBE = 2.0, 50.0, 3.0, 900.0
RNG = np.random.default_rng(5)
WAY = Signal("displacement of spring", "m", (RNG.uniform(-0.3, 0.3, 200),))
SPEED = Signal("flow of body", "m/s", (RNG.uniform(-2.0, 2.0, 200),))
PULL = Signal("pull", "N", (RNG.uniform(1.0, 30.0, 200),))
KNOWN = (WAY, SPEED, PULL)


def swing() -> bg.BondGraph:
    """A mass on a spring with a damper; the force is known, stiffness and damping are free."""
    g = bg.BondGraph("swing")
    pull = g.input("pull", "N")
    k = g.parameter("stiffness", STIFFNESS, "N/m", "", (5.0, 500.0))
    c = g.parameter("damping", DAMPING, "N s/m", "", (0.1, 50.0))
    body = g.one_junction("body", TRANSLATION)
    g.effort_source("drive", pull, at=body)
    g.inertance("mass", g.parameter("m", MASS, "kg"), at=body, state="v")
    g.compliance("spring", lambda x: k * x, at=body, state="x")
    g.resistance("damper", c, at=body)
    g.measure_displacement("way", "spring", "deflection", "m")
    return g


def log(cube: float, seed: int, samples: int = 500) -> MatchedLog:
    """The truth by scipy, with a spring that hardens; force in steps of 0.4 s, sampled at 20 Hz."""
    from scipy.integrate import solve_ivp

    rng = np.random.default_rng(seed)
    time = 0.05 * np.arange(samples)
    force = np.repeat(rng.uniform(-15.0, 15.0, samples // 8 + 1), 8)[:samples]

    def rates(t: float, x: FloatArray) -> list[float]:
        way, speed = x
        pull = np.interp(t, time, force)
        return [speed, (pull - DAMPING * speed - STIFFNESS * way - cube * way**3) / MASS]

    found = solve_ivp(rates, (0.0, time[-1]), [0.0, 0.0], t_eval=time, rtol=1e-8, atol=1e-10, max_step=0.05).y[0]
    return MatchedLog("run", time, force[np.newaxis], (found + 1e-3 * rng.standard_normal(samples))[np.newaxis])


def every_term() -> list[Term]:
    return [*(term for one in (WAY, SPEED, PULL) for term in library(KNOWN, one)), *products(KNOWN, SPEED.name)]


@pytest.mark.parametrize("term", every_term(), ids=lambda term: f"{term.name}-{term.inner:.3g}")
def test_a_term_is_the_same_as_a_law_and_along_a_log(term: Term) -> None:
    courses = term.courses(KNOWN, 0)[:, :7]
    for k in range(7):
        at = {argument(one.name): one.values[0][k] for one in KNOWN}
        laws = [float(sympy.N(law.subs(at).replace(bg.declare.functions.maximum, sympy.Max))) for law in term.laws()]
        np.testing.assert_allclose(courses[:, k], laws, rtol=1e-9, atol=1e-12)


def test_terms_fit_their_signals() -> None:
    kinds = {one.name: {term.kind.name for term in library(KNOWN, one)} for one in KNOWN}
    assert "wave" in kinds["displacement of spring"] and "wave" not in kinds["flow of body"]
    assert not {"sign", "signed_square", "magnitude"} & kinds["pull"]  # it never changes its sign
    assert library(KNOWN, Signal("time", "s", (np.arange(200.0),))) == []


def test_the_best_sums_are_those_of_least_squares() -> None:
    terms = tuple({one.name: one for one in every_term() if not one.kind.inner}.values())
    columns = np.concatenate([one.courses(KNOWN, 0) for one in terms]).T
    truth = 3.0 * WAY.values[0] ** 3 - 0.2 * SPEED.values[0] * np.abs(SPEED.values[0])
    y = truth + 0.01 * RNG.standard_normal(200)
    found = Terms(None, terms, np.arange(len(terms) + 1), columns.T @ y, columns.T @ columns)  # type: ignore[arg-type]
    best = next(one for one in best_sums(found, 200) if len(one.terms) == 2)
    assert {one.name for one in best.terms} == {"cube_of_displacement_of_spring", "signed_square_of_flow_of_body"}
    gains = {}
    for pair in itertools.combinations(range(len(terms)), 2):
        left = np.linalg.lstsq(columns[:, pair], y, rcond=None)[1]
        gains[pair] = 0.5 * (y @ y - left[0]) if left.size else 0.0
    assert best.gain == pytest.approx(max(gains.values()), rel=1e-9)


def formula(g: bg.BondGraph, variable: str, *terms: Term) -> Formula:
    place = Place(handle(g, "body" if variable == "effort" else "node"), Scale(20.0, 2.0))
    laws = sum(len(one.kind.laws) for one in terms)
    return Formula(place, variable, "N" if variable == "effort" else "m/s", terms, (1.0,) * laws)  # type: ignore[arg-type]


def _term(kind: str, of: Signal) -> Term:
    return next(one for one in library(KNOWN, of) if one.kind.name == kind)


SUMS = (
    (_term("cube", WAY),), (_term("signed_square", SPEED),), (_term("sign", SPEED), _term("step", SPEED)),
    (_term("ramp_above", PULL),), (_term("wave", WAY), _term("saturation", SPEED)), (_term("exponential", WAY),),
    (_term("product", PULL), _term("magnitude", SPEED), _term("ramp_below", WAY)),
    (next(one for one in products(KNOWN, SPEED.name) if one.kind.name == "power_product"),),
)  # fmt: skip


@pytest.mark.parametrize("terms", SUMS, ids=lambda terms: "+".join(one.kind.name for one in terms))
def test_its_lines_of_python_declare_the_same_machine(terms: tuple[Term, ...]) -> None:
    g = swing()
    found = formula(g, "effort", *terms)
    (made,), refused = candidates(bg.build(g), [found.effect()], [found.place])
    assert refused == [] and formula_of(made.function) is found
    values = {name: 0.1 * (k + 1) for k, name in enumerate(made.effect.parameters)}
    pasted = swing()
    exec(found.python(values), {"g": pasted})
    one, other = made.model, bg.build(pasted).model
    x, u = np.array([0.7, -0.2]), np.array([4.0])
    np.testing.assert_allclose(
        one.rhs(0.0, x, u, one.theta(**values)), other.rhs(0.0, x, u, other.theta()), rtol=1e-12, atol=1e-12
    )
    bare = bg.build(swing()).model
    taken = MASS * (bare.rhs(0.0, x, u, bare.theta()) - other.rhs(0.0, x, u, other.theta()))
    signals_there = (Signal(WAY.name, "m", (x[1:],)), Signal(SPEED.name, "m/s", (x[:1],)), Signal("pull", "N", (u,)))
    coefficients = iter(values[name] for name in made.effect.coefficients)
    inner = iter(values[name] for name in made.effect.shapes)
    law = 0.0
    for term in terms:
        own = [next(s for s in signals_there if s.name == n).values[0] for n in term.signals]
        x, second = (own[0], own[1]) if term.kind.has_second else (np.prod(own, axis=0), 0.0)
        laws = term.values(x, next(inner) if term.kind.inner else None, second)
        law += sum(next(coefficients) * float(one[0]) for one in laws)
    assert taken[0] == pytest.approx(law, rel=1e-9)


def test_it_reads_as_a_law_with_its_unit() -> None:
    found = formula(swing(), "effort", _term("cube", WAY))
    values = {found.coefficients()[0].name: 3.7812}
    assert found.text(values) == "effort = 3.78*x^3  [N], x the displacement of spring"
    assert found.coefficients()[0].unit == "N/m^3"
    product = formula(swing(), "effort", _term("product", PULL))
    assert product.text() == "effort = c*x*y, x the displacement of spring and y the pull"
    assert product.coefficients()[0].unit == "N/(m*N)"


@pytest.mark.parametrize("terms", SUMS, ids=lambda terms: "+".join(one.kind.name for one in terms))
def test_no_number_has_more_digits_than_its_interval_supports(terms: tuple[Term, ...]) -> None:
    """A law was told as 0.05555555555555555*x, and its lines of Python had all digits of a double."""
    g = swing()
    found = formula(g, "effort", *terms)
    every = [*found.coefficients(), *found.inner()]
    values = {one.name: (1.0 if one.bounds[0] < 1.0 < one.bounds[1] else one.start) / 3.0 for one in every}
    ends = {name: (0.9 * value, 1.1 * value) for name, value in values.items()}
    text, lines = found.text(values, ends).partition(" = ")[2], found.python(values, ends)
    assert max(len(digits.strip("0")) for digits in re.findall(r"\d[\d.]*", text.replace(".", ""))) <= 3
    for name, value in values.items():
        (told,) = re.findall(rf"g.parameter\('{name}', ([^,]*),", lines)
        assert float(told) == pytest.approx(value, abs=0.06 * 0.1 * abs(value)) and len(told.strip("-0.")) <= 4
    pasted = swing()
    exec(lines, {"g": pasted})  # what is rounded still is a law with a value in its bounds


def fitted(train: list[MatchedLog]) -> Fit:
    built = bg.build(swing())
    setup = filter_setup(built.model, built.driven, train)
    return fit(EstimationProblem(setup.filter_model, tuple(train), (*free_parameters(setup, ()), *setup.noise)))


def test_products_that_are_scored_a_few_at_a_time_gain_as_all_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    train = [log(CUBE, 1)]
    base, built = fitted(train), bg.build(swing())
    linear = linearisation(base, train)
    where = places(built, train, linear.runs, base.theta)
    known = distinct(signals(built, linear, where))
    (body,) = (one for one in probes(built, linear, where) if one.place.label == "body")
    several = scored_products(linear, body, known)
    monkeypatch.setattr(subsets, "_AT_ONCE", 100000)
    whole = scored_products(linear, body, known)
    assert len(several.terms) > 2 * 32 and several.terms == whole.terms
    assert np.array_equal(several.edges, whole.edges)
    assert several.score == pytest.approx(whole.score, rel=1e-9)
    own, every = ([(one.terms, one.gain) for one in best_sums(each, 500, 1, 1000)] for each in (several, whole))
    assert [one for one, _ in own] == [one for one, _ in every]
    assert [gain for _, gain in own] == pytest.approx([gain for _, gain in every], rel=1e-9)


def test_what_a_free_parameter_can_take_is_no_part_of_a_shape() -> None:
    train = [log(CUBE, 1)]
    base, built = fitted(train), bg.build(swing())
    linear = linearisation(base, train)
    where = places(built, train, linear.runs, base.theta_of(built.model))
    known = distinct(signals(built, linear, where))
    assert {"displacement of spring", "flow of body"} <= {one.name for one in known}
    probed = [one for one in probes(built, linear, where) if one.variable == "effort"]
    found = next(one for one in splines(linear, probed, known) if one.signal.name == "displacement of spring")
    assert found.taken == ("stiffness",)
    cosine = found.values @ found.knots / (np.linalg.norm(found.values) * np.linalg.norm(found.knots))
    assert abs(cosine) < 0.05  # a straight line is what the stiffness takes
    bent = found.knots**3
    bent -= found.knots * (bent @ found.knots) / (found.knots @ found.knots)
    assert np.corrcoef(found.values, bent)[0, 1] > 0.9


@pytest.mark.slow
def test_a_formula_wins_over_wrong_relatives_and_names_the_law() -> None:
    """Without a hardening spring among the effects "backlash at body" was the answer."""
    offered = (effects.backlash, effects.quadratic_loss)
    closed = close_loop(swing(), [log(CUBE, 1)], [log(CUBE, 3)], offered, LoopSettings(max_effects=1))
    (added,) = closed.added
    assert closed.verdict == "effect found"
    assert added.trial.candidate.effect.name == "formula_cube_of_displacement_of_spring"
    (entry,) = result_json(closed)["effects"]
    (value,) = entry["coefficients"].values()
    assert value["ci95"][0] < CUBE < value["ci95"][1]
    assert entry["formula"]["known_as"] == "hardening spring"
    assert closed.corrected.values["stiffness"] == pytest.approx(STIFFNESS, rel=0.02)
    (sentence,) = formula_sentences(closed)
    assert sentence.startswith("Formula at body: effort = ")
    assert "x the displacement of spring, known as hardening spring" in sentence
    said = re.search(r"; beside it stiffness \(spring\) is (\S+) N/m, (\S+) without", sentence)
    assert said is not None and float(said[1]) == pytest.approx(STIFFNESS, rel=0.02)
    assert float(said[2]) == pytest.approx(closed.nominal.values["stiffness"], rel=0.01)
    (picture,) = missing_efforts(closed)
    assert picture.x_label == "displacement of spring [m]" and picture.x.size == picture.missing.size == 500
    np.testing.assert_allclose(picture.law, value["value"] * picture.law_x**3, rtol=1e-9)


@pytest.mark.slow
def test_where_nothing_is_missing_no_formula_is_found() -> None:
    closed = close_loop(swing(), [log(0.0, 1)], [], (effects.quadratic_loss,))
    assert (closed.verdict, closed.added) == ("no missing effect", ())


def test_parameters_that_stood_in_for_a_law_are_those_of_the_machine_alone() -> None:
    """A report said that 4771 Pa of a check valve had lain in a law that was gone by then."""
    stiff, slack = (sled.fitted([sled.pull(sled.sled(), 1, c_guide=value)]) for value in (30.0, 10.0))
    ((name, now, before),) = moved_parameters(stiff, slack, sled.sled())
    assert name == "c_guide (guide)" and float(now.partition(" ")[0]) == pytest.approx(10.0, abs=0.5)
    assert float(before) == pytest.approx(30.0, abs=1.0)
    assert moved_parameters(stiff, slack, bg.BondGraph("another")) == []


@pytest.mark.parametrize(("lowest", "offered"), [(6.0, True), (0.5, False), (-6.0, False)])
def test_a_power_may_fall_where_its_signal_keeps_away_from_zero(lowest: float, offered: bool) -> None:
    """A converter that draws constant power was an offset and a breakdown of a bus."""
    voltage = Signal("effort of bus", "V", (np.linspace(lowest, 15.0, 200),))
    falling = [term for term in library([voltage], voltage) if term.kind.name == "falling_power"]
    assert bool(falling) is offered
    for term in falling:
        (drawn,) = term.values(voltage.values[0], -1.0)
        np.testing.assert_allclose(drawn, term.size / voltage.values[0], rtol=1e-6)
        assert term.span[1] < 0.0 and term.inner_unit == "1"


def lever(weight: float = 0.0) -> bg.BondGraph:
    """A lever on a counter spring with grease; its weight about the hinge is not declared."""
    g = bg.BondGraph("lever")
    torque = g.input("torque", "N m", hold=True)
    k = g.parameter("stiffness", 40.0, "N m/rad", "", (8.0, 200.0))
    b = g.parameter("grease", 5.0, "N m s/rad", "", (1.0, 40.0))
    hinge = g.one_junction("hinge", bg.ROTATION)
    g.effort_source("drive", torque, at=hinge)
    g.inertance("leaf", 2.1, at=hinge, state="w")
    g.compliance("spring", lambda a: k * a + weight * sympy.sin(a), at=hinge, state="a")
    g.resistance("bearing", b, at=hinge)
    g.measure_displacement("angle", "spring", "encoder")
    return g


def opened(seed: int) -> MatchedLog:
    """The lever pushed in steps of 2 s, to 1.5 rad; sampled at 10 Hz."""
    rng = np.random.default_rng(seed)
    time = 0.1 * np.arange(600)
    torque = np.repeat(rng.uniform(0.0, 70.0, 30), 20)
    true = bg.build(bg.declare.editing.with_values(lever(38.0), {"stiffness": 26.0, "grease": 7.0})).model
    angle = bg.simulate(true, time, torque[np.newaxis], rtol=1e-9).raise_if_failed().y
    return MatchedLog("run", time, torque[np.newaxis], angle + 0.01 * rng.standard_normal(angle.shape))


@pytest.mark.slow
def test_the_weight_of_a_lever_is_a_sine_of_its_angle() -> None:
    """A power and an exponential stood for it: 63 N m/rad of spring for 26, and five numbers for one."""
    closed = close_loop(lever(), [opened(1)], [opened(2)], (effects.quadratic_loss,), LoopSettings(max_effects=1))
    (found,) = closed.added
    formula = formula_of(found.trial.candidate.function)
    assert formula is not None and [one.kind.name for one in formula.terms] == ["sine"]
    (name,), ends = found.coefficients, intervals(closed.corrected)
    for own, true in ((name, 38.0), ("stiffness", 26.0), ("grease", 7.0)):
        middle, reach = sum(ends[own]) / 2.0, ends[own][1] - ends[own][0]  # four standard deviations long
        assert true == pytest.approx(middle, abs=reach)
    assert "known as weight of a lever" in " ".join(formula_sentences(closed))


def test_sines_are_of_angles_alone() -> None:
    angle = Signal("displacement of spring", "rad", WAY.values)
    assert {"sine", "cosine"} <= {one.kind.name for one in library([angle], angle)}
    assert not {"sine", "cosine"} & {one.kind.name for one in every_term()}
