"""Storages that follow an input: they are offered, scored and found by the slope of that input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bondgraph.build import build
from bondgraph.correct.fits.rates import rated, with_followed_rates, with_notes_of_used_rates
from bondgraph.correct.loop import ClosedLoop, close_loop
from bondgraph.correct.models.candidates import candidates
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.editing import handle, with_input_rates, with_values, without_input_rates
from bondgraph.declare.effect import Effect, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.effects import constant_effort, quadratic_loss
from bondgraph.errors import DeclarationError
from bondgraph.simulate.simulation import simulate
from tests.correct.sled import sled
from vehicle_graphs.machine_effects import uncounted_inertia

NOISE = np.array([[0.3], [0.01]])
FUNCTIONS = (constant_effort, quadratic_loss, uncounted_inertia)
#: Mass of the table [kg], which nobody declared.
MASS = 1.5


def shaker(hold: bool = False, load_cell: bool = True) -> BondGraph:
    """A table that is moved at a given speed drags a sled by a spring; the force on it is measured. It has no mass."""
    g = BondGraph("shaker", doc="a table on a shaker drags a sled")
    speed = g.input("speed", "m/s", "speed of the table", hold=hold)
    guide = g.parameter("c_guide", 4.0, "N s/m", "guide of the table", (1.0, 20.0))
    stiffness = g.parameter("k_spring", 60.0, "N/m", "spring between table and sled")
    mass = g.parameter("m_sled", 5.0, "kg", "sled, weighed")
    drag = g.parameter("c_sled", 8.0, "N s/m", "runners of the sled", (2.0, 40.0))
    table, body = g.one_junction("table", TRANSLATION), g.one_junction("body", TRANSLATION)
    pull, stretch = g.zero_junction("pull", TRANSLATION), g.one_junction("stretch", TRANSLATION)
    coil = g.flow_source("coil", speed, at=table)
    g.resistance("guide", lambda v: guide * v, at=table)
    g.bond(table, pull)
    g.bond(pull, stretch)
    g.compliance("spring", stiffness, at=stretch, state="stretch_spring")
    g.bond(pull, body)
    g.inertance("sled", mass, at=body, state="v_sled")
    g.resistance("runners", lambda v: drag * v, at=body)
    if load_cell:
        g.measure_effort("force", coil, "force on the table")
    g.measure_flow("sled_speed", body, "speed of the sled")
    return g


def with_table(load_cell: bool = True) -> BondGraph:
    """The shaker whose table has the mass that it has."""
    graph = shaker(load_cell=load_cell)
    effect = uncounted_inertia(graph, Place(handle(graph, "table"), Scale(40.0, 1.0)))
    assert isinstance(effect, Effect)
    return with_values(graph, {effect.coefficients[0]: MASS})


def shaken(graph: BondGraph, seed: int, name: str) -> MatchedLog:
    """Twenty seconds of a table moved by sines of random phase, as the declared shaker would be given them."""
    rng = np.random.default_rng([seed, 11])
    time = 0.05 * np.arange(400)
    speed = sum(0.3 * np.sin(w * time + rng.uniform(0.0, 6.0)) for w in (1.1, 2.7, 5.3))
    run = simulate(build(graph).model, time, {"speed": speed}, rtol=1e-8).raise_if_failed()
    return MatchedLog(name, time, np.array([speed]), run.y + NOISE * rng.standard_normal(run.y.shape))


@pytest.fixture(scope="module")
def found() -> ClosedLoop:
    train = [shaken(with_table(), seed, f"run{seed}") for seed in (1, 2)]
    return close_loop(shaker(), train, [shaken(with_table(), 3, "held")], FUNCTIONS)


def test_a_mass_at_a_given_speed_is_found_with_its_size(found: ClosedLoop) -> None:
    (effect,) = found.added
    assert effect.trial.candidate.label == "uncounted_inertia at table"
    (name,) = effect.coefficients
    assert found.corrected.values[name] == pytest.approx(MASS, abs=4.0 * found.corrected.std[name])
    assert found.corrected.std[name] < 0.05 * MASS
    (held,) = found.corrected_holdout.logs
    assert held.channels["force"].simulation_rmse == pytest.approx(NOISE[0, 0], rel=0.15)
    (before,) = found.nominal_holdout.logs
    assert before.channels["force"].simulation_rmse > 2.0 * NOISE[0, 0]


def test_its_score_points_to_it_with_the_slopes_that_the_filter_takes(found: ClosedLoop) -> None:
    trial = next(one for one in found.rounds[0].trials if one.candidate.label == "uncounted_inertia at table")
    assert trial.step[0] == pytest.approx(MASS, rel=0.1)
    log, path = found.nominal.problem.logs[0], found.rounds[0].linear.logs[0].path
    assert_allclose(path.u[1, 1:-1], 0.5 * (log.u[1, :-2] + log.u[1, 1:-1]))  # at a sample the mean of both sides


def test_the_corrected_graph_asks_for_nothing_but_the_declared_inputs(found: ClosedLoop) -> None:
    assert [one.name for one in found.corrected_graph.inputs] == ["speed"]
    assert build(found.corrected_graph).model.names("input") == ("speed", "d_speed")  # as equations with a mass need
    assert found.corrected_text == build(found.corrected_graph).text
    assert "d_speed" not in [one.name for one in found.rounds[0].signals]  # no law of the graph could name it


def test_with_nothing_missing_nothing_is_claimed_and_no_rate_is_left() -> None:
    closed = close_loop(shaker(), [shaken(shaker(), seed, f"run{seed}") for seed in (4, 5)], [], FUNCTIONS)
    assert closed.added == ()
    assert build(closed.corrected_graph).model.names("input") == ("speed",)
    assert closed.corrected_text == build(closed.corrected_graph).text != closed.corrected_built.text


def test_rates_are_taken_where_a_storage_would_follow_an_input_and_nowhere_else() -> None:
    assert [one.rate_of for one in with_followed_rates(shaker()).inputs] == ["", "speed"]
    force_driven, held = sled(), shaker(hold=True)
    assert with_followed_rates(force_driven) is force_driven
    assert with_followed_rates(held) is held


def test_a_ratio_that_follows_an_input_asks_for_its_rate() -> None:
    g = BondGraph("variator")
    ratio = g.input("ratio", "1", default=2.0)
    engine, wheel = g.one_junction("engine"), g.one_junction("wheel")
    g.transformer("belt", ratio, engine, wheel)
    g.inertance("flywheel", g.parameter("J", 2.0, "kg m^2"), at=wheel)
    assert [one.rate_of for one in with_followed_rates(g).inputs] == ["", "ratio"]


def test_the_load_of_a_storage_that_no_sensor_shows_has_its_rate_too() -> None:
    """The sizes of places are those of every bond: the load on the coil is asked for although nothing measures it."""
    blind = with_table(load_cell=False)
    assert build(blind).model.names("input") == ("speed",)
    train = [shaken(with_table(), seed, f"run{seed}") for seed in (1, 2)]
    assert close_loop(blind, [replace(log, y=log.y[1:]) for log in train], [], FUNCTIONS).added == ()


def test_rates_that_no_equation_uses_change_no_rate_of_a_state() -> None:
    plain, wide = build(shaker()).model, build(with_followed_rates(shaker())).model
    states, rng = np.array([0.1, -0.4]), np.random.default_rng(0)
    for speed, slope in rng.normal(size=(5, 2)):
        given, more = np.array([speed]), np.array([speed, slope])
        assert_allclose(wide.rhs(0.0, states, more, wide.theta()), plain.rhs(0.0, states, given, plain.theta()))
        assert_allclose(wide.output(0.0, states, more, wide.theta()), plain.output(0.0, states, given, plain.theta()))


def test_logs_get_the_slopes_of_their_inputs_and_say_so() -> None:
    plain, wide = build(shaker()).model, build(with_followed_rates(shaker())).model
    log = MatchedLog("log", np.array([0.0, 1.0, 3.0]), np.array([[0.0, 2.0, 1.0]]), np.zeros((2, 3)))
    (made,) = rated([log], plain, wide)
    assert_allclose(made.u, [[0.0, 2.0, 1.0], [2.0, -0.5, -0.5]])
    assert "the slope of input 'speed' is taken from its samples" in made.notes[-1]
    assert with_notes_of_used_rates([made], build(with_followed_rates(shaker())).equations)[0].notes == log.notes
    table = build(with_followed_rates(with_table())).equations
    assert with_notes_of_used_rates([made], table)[0].notes == made.notes


def test_what_needs_a_rate_that_the_model_does_not_have_is_refused_with_advice() -> None:
    _, refused = candidates(build(shaker()), [uncounted_inertia], [Place(handle(shaker(), "table"), Scale(40.0, 1.0))])
    assert [no.why for no in refused] == [
        "would need the rate of input speed, which the model does not have - declare that storage in the graph, its "
        "size a parameter with bounds"
    ]


def test_rates_are_refused_of_what_has_none() -> None:
    with pytest.raises(DeclarationError, match="shaker: no input 'sped'; did you mean 'speed'"):
        with_input_rates(shaker(), ["sped"])
    with pytest.raises(DeclarationError, match="input speed is held between samples and has no rate"):
        with_input_rates(shaker(hold=True), ["speed"])
    assert without_input_rates(with_input_rates(shaker(), ["speed"])) == shaker()
