"""Laws that act in part of the operating space: found with their regime, and only where there is one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.constants import LEVEL
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.gate_worth import earned, in_its_signal
from bondgraph.correct.loop import ClosedLoop, close_loop
from bondgraph.correct.models.candidates import candidates, places
from bondgraph.correct.places.regimes import Regime, Side, in_regime
from bondgraph.correct.result import result_json
from bondgraph.correct.scores.scoring import linearisation, score_candidates
from bondgraph.correct.search import regimes
from bondgraph.correct.search.refit import refit_from
from bondgraph.correct.search.regimes import _gains
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import copy, handle, with_values
from bondgraph.declare.effect import EffectFunction, Place, Scale, effect_functions
from bondgraph.declare.files import read_graph, write_graph
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.derive.latex import latex
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit
from bondgraph.estimate.noise_starts import noisy_starts
from bondgraph.estimate.objective import expansion_of
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.report.closed_loop import explanation
from bondgraph.report.letters import with_levels
from bondgraph.report.python_lines import correction_lines
from bondgraph.report.regimes import regime_sentences
from bondgraph.simulate.simulation import simulate
from tests.correct import partly
from tests.correct.carriage import rides
from vehicle_graphs import emps

FAST = Regime("flow of shaft", "rad/s", "above", 12.0, (0.0, 20.0), 0.4)


def _loop(graph: BondGraph, logs: list[MatchedLog], held: MatchedLog) -> ClosedLoop:
    return close_loop(graph, logs, [held], effect_functions(effects))


@pytest.fixture(scope="module")
def rubbing() -> ClosedLoop:
    """A drive whose bearing drags above a speed only."""
    return _loop(partly.drive(), [partly.driven(seed) for seed in (1, 2)], partly.driven(9))


def _only(closed: ClosedLoop) -> tuple[str, dict[str, float], dict[str, tuple[float, float]]]:
    """Label of the only effect, and value and interval of its coefficient, its level and its width by their letter."""
    assert closed.verdict == "effect found"
    (told,) = result_json(closed)["effects"]
    known = {name.partition("_")[0]: one for name, one in told["coefficients"].items()}
    values = {name: one["value"] for name, one in known.items()}
    return closed.added[0].trial.candidate.label, values, {name: tuple(one["ci95"]) for name, one in known.items()}


@pytest.mark.slow
def test_drag_above_a_speed_is_found_with_its_speed(rubbing: ClosedLoop) -> None:
    label, values, intervals = _only(rubbing)
    assert label == "viscous_loss at shaft where speed of shaft is above a level"
    assert intervals["level"][0] < partly.ONSET < intervals["level"][1]
    assert values["c"] == pytest.approx(partly.RUB, rel=0.02)  # the truth comes in over a straight ramp
    assert rubbing.corrected.values["d"] == pytest.approx(partly.DRAG, rel=0.01)
    assert rubbing.confirmation is not None and rubbing.confirmation.standing == "confirmed"


@pytest.mark.slow
def test_a_regime_is_named_in_words_with_its_level(rubbing: ClosedLoop) -> None:
    assert "viscous_loss at shaft where speed of shaft is above 12.0 rad/s" in explanation(rubbing)
    (said,) = regime_sentences(rubbing)
    assert said.startswith(
        "Regime: viscous_loss at shaft acts where speed of shaft is above 12.01 rad/s [11.99, 12.02]; "
    )
    assert "; it comes and goes within 0." in said and " rad/s on both sides of that; the logs cover " in said
    assert said.endswith(" rad/s.")
    found, model = rubbing.added[0].trial.candidate.effect, rubbing.corrected.problem.filter_model.model
    assert with_levels(found, model, rubbing.corrected.values).endswith(", where speed of shaft is above 12.0 rad/s")
    (told,) = result_json(rubbing)["effects"]
    assert told["regime"] == {
        "signal": "flow of shaft", "quantity": "speed of shaft", "is": "above", "level": "level_c_viscous_loss_shaft",
    }  # fmt: skip


@pytest.mark.slow
def test_a_gated_law_is_a_law_of_the_graph(rubbing: ClosedLoop, tmp_path: object) -> None:
    """It stands in the corrected graph, its file, its Python lines, its equations and its module."""
    graph = rubbing.corrected_graph
    law = graph.nodes["viscous_loss_shaft"].law("effort")
    assert str(law) == (
        "c_viscous_loss_shaft*flow*switch(flow(shaft) - level_c_viscous_loss_shaft, width_c_viscous_loss_shaft)"
    )
    path = tmp_path / "corrected.json"  # type: ignore[operator]
    write_graph(graph, path)
    assert read_graph(path) == graph
    assert "switch(flow_shaft - level_c_viscous_loss_shaft" in correction_lines(partly.drive(), graph)
    assert "level_c_viscous_loss_shaft" in rubbing.corrected_text
    assert r"\tanh" in latex(derive(assign_causality(graph)))


def test_a_gate_closes_a_law_on_one_side_of_its_level() -> None:
    """Far above its level the drive has the law, far below it has none; the exact switch has no width at all."""
    graph = copy(partly.drive())
    effect = in_regime(effects.viscous_loss, FAST)(graph, Place(handle(graph, "shaft"), Scale(2.0, 20.0)))
    assert effect is not None and effect.regime == "speed of shaft is above a level"
    assert graph.parameters[-2].bounds == FAST.span
    gated = build(with_values(graph, {effect.coefficients[0]: 0.03})).model
    plain = build(partly.drive()).model
    for speed, drag in ((5.0, 0.1), (19.0, 0.13)):
        u = np.zeros(len(gated.inputs))
        slowed = gated.rhs(0.0, np.array([speed]), u, gated.theta())
        assert slowed == pytest.approx(plain.rhs(0.0, np.array([speed]), u, plain.theta(d=drag)), rel=1e-9)
    time = np.linspace(0.0, 2.0, 81)
    run = simulate(gated, time, np.array([np.full(81, 2.2), np.zeros(81)]), x0=np.array([5.0]), rtol=1e-8)
    assert run.x[0, -1] > FAST.level


def test_a_gate_between_two_levels_and_one_outside_of_them_add_up() -> None:
    """A law between two levels and the same outside of them are the law everywhere, at any width."""
    graph, place = copy(partly.drive()), Scale(2.0, 20.0)
    names = []
    sides: tuple[tuple[Side, EffectFunction], ...] = (
        ("between", effects.viscous_loss), ("outside", effects.quadratic_loss),
    )  # fmt: skip
    for side, law in sides:
        regime = Regime("clutch", "1", side, 0.3, (0.0, 1.0), 0.05, 0.7)
        effect = in_regime(law, regime)(graph, Place(handle(graph, "shaft"), place))
        assert effect is not None and effect.regime == f"clutch is {side} two levels"
        names += [effect.coefficients[0], *effect.shapes]
    assert [name.partition("_")[0] for name in names] == ["c", "level", "upper", "c", "level", "upper"]
    model, plain, speed = build(graph).model, build(partly.drive()).model, 2.0
    theta = model.theta(c_viscous_loss_shaft=0.03, c_quadratic_loss_shaft=0.03 / speed)
    for clutch in (0.1, 0.29, 0.5, 0.68, 0.9):
        slowed = model.rhs(0.0, np.array([speed]), np.array([0.0, clutch]), theta)
        everywhere = plain.rhs(0.0, np.array([speed]), np.array([0.0, clutch]), plain.theta(d=0.13))
        assert slowed == pytest.approx(everywhere, rel=1e-6)  # speed*abs(speed) has a width of its own
    only = model.theta(c_viscous_loss_shaft=0.03)
    for clutch, inside in ((0.1, 0.0), (0.5, 1.0), (0.9, 0.0)):
        slowed = model.rhs(0.0, np.array([speed]), np.array([0.0, clutch]), only)
        sole = plain.rhs(0.0, np.array([speed]), np.array([0.0, clutch]), plain.theta(d=0.1 + 0.03 * inside))
        assert slowed == pytest.approx(sole, rel=1e-3)  # the step has a width


@pytest.mark.parametrize(
    "function", [effects.added_inertia, effects.stribeck_loss, effects.warm_up_loss, effects.hysteresis_loss]
)
def test_what_keeps_or_has_a_shape_gets_no_gate(function: EffectFunction) -> None:
    graph = copy(partly.drive())
    place = Place(handle(graph, "shaft"), Scale(2.0, 20.0))
    assert function(copy(graph), place) is not None
    assert in_regime(function, FAST)(graph, place) is None


def test_sums_of_scores_are_the_gain_of_a_gated_regression() -> None:
    """Where nothing has a memory, what sums inside a gate give is what least squares with the gated column gain."""
    rng = np.random.default_rng(5)
    signal, law = rng.uniform(0.0, 3.0, 400), rng.uniform(0.5, 1.5, 400)
    free = np.column_stack([np.ones(400), signal])
    seen = rng.standard_normal(400) + 2.0 * law * (signal > 2.0)
    left = seen - free @ np.linalg.lstsq(free, seen, rcond=None)[0]
    expansion = expansion_of(np.column_stack([left, -free]), np.zeros((400, 3)), 0)
    gains = []
    for level in (1.0, 2.0):
        inside = np.where(signal > level, -law, 0.0)
        sums = np.concatenate([[inside @ left, inside @ inside], -free.T @ inside])[:, np.newaxis]
        gains += list(_gains(expansion, sums, float(law @ law), one_sided=False))
        both = np.column_stack([free, inside])
        rest = left - both @ np.linalg.lstsq(both, left, rcond=None)[0]
        assert gains[-1] == pytest.approx(0.5 * (left @ left - rest @ rest), rel=1e-9)
    assert gains[1] > 2.0 * gains[0]
    nearly_all = np.array([[3.0], [0.97 * float(law @ law)], [0.0], [0.0]])
    assert _gains(expansion, nearly_all, float(law @ law), one_sided=False) == [0.0]


@pytest.mark.slow
def test_a_leak_above_a_level_of_a_tank_is_found() -> None:
    closed = _loop(partly.tank(), [partly.filled(seed) for seed in (1, 2)], partly.filled(9))
    label, values, intervals = _only(closed)
    assert label == "leakage at level where pressure of level is above a level"
    assert intervals["level"][0] < partly.LEVEL < intervals["level"][1]
    assert values["c"] == pytest.approx(partly.VALVE, rel=0.01)


@pytest.mark.slow
def test_friction_of_a_worn_place_is_found_between_two_levels() -> None:
    """A bump of dry friction on the way: it was named by two half lines that overlapped there, and a disturbance."""
    closed = _loop(partly.slide(), [partly.slid(seed) for seed in (1, 2)], partly.slid(9))
    label, values, _ = _only(closed)
    assert label == "coulomb_loss at slide where displacement of spring is between two levels"
    assert 0.5 * (values["level"] + values["upper"]) == pytest.approx(partly.WORN, abs=0.005)
    half = math.sqrt(math.log(2.0)) * partly.REACH  # to where half of the friction is left
    assert values["upper"] - values["level"] == pytest.approx(2.0 * half, rel=0.15)
    (said,) = regime_sentences(closed)
    assert said.startswith("Regime: coulomb_loss at slide acts where displacement of spring is between 0.0")
    assert " m on both sides of each; the logs cover " in said
    (told,) = result_json(closed)["effects"]
    assert (told["regime"]["is"], told["regime"]["upper"]) == ("between", "upper_c_coulomb_loss_slide")


@pytest.mark.slow
def test_a_fan_that_comes_gradually_is_found_with_its_width() -> None:
    """A gate that opens over a third of the range lost against ramps while it was tried with a sharp edge only."""
    logs = [partly.driven(seed, 0.0, fan=partly.FAN, soft=0.08) for seed in (1, 2, 9)]
    label, values, intervals = _only(_loop(partly.drive(), logs[:2], logs[2]))
    assert label == "quadratic_loss at shaft where clutch is above a level"
    assert values["level"] == pytest.approx(0.6, abs=0.02)
    assert values["c"] == pytest.approx(partly.FAN, rel=0.05)
    assert intervals["width"][0] < 0.16 < intervals["width"][1]  # a logistic curve is a hyperbolic tangent of half


@pytest.mark.slow
def test_a_fan_is_found_where_its_clutch_is_on() -> None:
    logs = [partly.driven(seed, 0.0, fan=partly.FAN) for seed in (1, 2, 9)]
    label, values, _ = _only(_loop(partly.drive(), logs[:2], logs[2]))
    assert label == "quadratic_loss at shaft where clutch is above a level"
    assert values["c"] == pytest.approx(partly.FAN, rel=0.01) and 0.3 < values["level"] < 0.7


@pytest.mark.slow
def test_a_fan_that_always_runs_gets_no_gate() -> None:
    logs = [partly.driven(seed, 0.0, fan=partly.FAN, idle=1.0) for seed in (1, 2, 9)]
    label, values, _ = _only(_loop(partly.drive(), logs[:2], logs[2]))
    assert label == "quadratic_loss at shaft"
    assert values["c"] == pytest.approx(partly.FAN, rel=0.01)


@pytest.mark.slow
def test_a_fan_that_never_quite_stops_acts_everywhere_and_more_where_its_clutch_is_on() -> None:
    """Six tenths of it act everywhere, which completes what the clutch adds."""
    logs = [partly.driven(seed, 0.0, fan=partly.FAN, idle=0.6) for seed in (1, 2, 9)]
    gated, always = _loop(partly.drive(), logs[:2], logs[2]).added
    assert gated.trial.candidate.label == "quadratic_loss at shaft where clutch is above a level"
    assert always.completes == gated.trial.candidate.label
    assert always.trial.candidate.place.label == "shaft"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 21])
def test_a_machine_that_lacks_nothing_gets_no_regime(seed: int) -> None:
    for graph, logs in (
        (partly.drive(), [partly.driven(one, 0.0) for one in (seed, seed + 1, seed + 8)]),
        (partly.tank(), [partly.filled(one, 0.0) for one in (seed, seed + 1, seed + 8)]),
    ):
        closed = _loop(graph, logs[:2], logs[2])
        assert (closed.verdict, closed.added) == ("no missing effect", ())


def test_a_law_is_gated_in_the_place_of_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """theta() got multiple values for 'c_coulomb_loss_motor': all that a loop on a car had found was lost."""
    log, own = partly.driven(1), build(partly.drive())
    setup = filter_setup(own.model, own.driven, [log])
    base = fit(EstimationProblem(setup.filter_model, (log,), (*free_parameters(setup, ()), *setup.noise)))
    linear = linearisation(base, [log])
    where = places(own, [log], linear.runs, base.theta_of(own.model))
    found, _ = candidates(own, [effects.quadratic_loss], [one for one in where if one.label == "shaft"])
    context = Context(own, base, (log,), 10, LEVEL, 5.0, Journal())
    leader = refit_from(Trial(found[0], 1.0), [1e-3], context)
    monkeypatch.setattr(regimes, "_options", lambda linear, laws, *rest: [regimes.Option(laws[0], FAST, 1e9)])
    (gated,) = regimes.gated_in_place(leader, score_candidates(linear, found), where, context)
    assert gated.trial.candidate.label == "quadratic_loss at shaft where speed of shaft is above a level"
    assert np.isfinite(gated.prediction.gain) and gated.prediction.starts


@pytest.mark.slow
def test_a_gate_in_the_signal_of_its_law_is_worth_less_than_another_term_in_it() -> None:
    """Friction that differs by direction: dry friction that ended just below the top speed was called the law."""
    log, own = rides(), build(emps.start())
    setup = filter_setup(own.model, own.driven, [log])
    free = (*free_parameters(setup, ()), *setup.noise)
    base = fit(EstimationProblem(setup.filter_model, (log,), tuple(free)), starts=noisy_starts(free))
    linear = linearisation(base, [log])
    where = places(own, [log], linear.runs, base.theta_of(own.model))
    slow = Regime("flow of carriage", "m/s", "below", 0.09, (-0.13, 0.13), 0.002)
    found, _ = candidates(
        own, [in_regime(effects.coulomb_loss, slow)], [one for one in where if one.label == "carriage"]
    )
    context = Context(own, base, (log,), 10, LEVEL, 5.0, Journal())
    gated = refit_from(Trial(found[0], 0.0), [15.0], context)
    assert gated.evidence is not None and gated.evidence.delta_nll > 500.0
    doubted = earned(gated, [gated], where, context)
    assert doubted.evidence is not None and doubted.evidence.p_robust == 1.0
    assert "coulomb_loss everywhere and formula_" in doubted.remark and "explain more" in doubted.remark
    term = in_its_signal(gated, where, context)  # which takes part in its own name then
    assert (
        term is not None
        and term.evidence is not None
        and term.candidate.label.endswith("_of_flow_of_carriage at carriage")
    )
    assert not term.candidate.effect.regime and term.gate is None
