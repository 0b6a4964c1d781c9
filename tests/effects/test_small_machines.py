"""Small machines with truths by scipy: what is counted as right, and a few of the counts."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.correct.evidence.trials import Added, Trial
from bondgraph.correct.loop import LoopSettings
from bondgraph.correct.models.candidates import candidates
from bondgraph.correct.places.probes import Signal
from bondgraph.correct.result import result_json
from bondgraph.correct.shapes.completions import arguments, stored_signals
from bondgraph.correct.shapes.formula import Formula
from bondgraph.correct.shapes.library import library
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import EffectFunction, Place, Scale
from bondgraph.effects.actuators import actuator_dead_zone
from bondgraph.effects.friction import coulomb_loss, heating_resistance
from bondgraph.effects.hysteresis import hysteresis_loss
from bondgraph.effects.loads import constant_flow
from bondgraph.effects.losses import relief
from bondgraph.effects.storages import added_inertia, hardening_spring, magnetic_saturation
from bondgraph.effects.thermal import ROOM, varying_heat_capacity
from bondgraph.estimate.setup import filter_setup
from bondgraph.report.closed_loop import report_data
from bondgraph.report.html import Provenance
from bondgraph.report.words import law_title
from tests.effects.machines import late
from tests.effects.machines.count import HELD_OUT, KINDS, TRAIN, asked, is_answer, is_in_group, is_right
from tests.effects.machines.electrical import CERAMIC, CHOKE, CLAMP, RING
from tests.effects.machines.hydraulic import PRESS, TANK, WORN_RAM
from tests.effects.machines.machine import Machine
from tests.effects.machines.mechanical import FAN, SLIDE, STRUT
from tests.effects.machines.mixed import SERVO
from tests.effects.machines.thermal import BLOCK, SINK


def test_there_are_four_machines_of_each_kind() -> None:
    assert {kind: len(known) for kind, known in KINDS.items()} == dict.fromkeys(KINDS, 4) and len(KINDS) == 5


@pytest.mark.parametrize("machine", [CERAMIC, TANK], ids=["ceramic", "tank"])
def test_a_log_shows_the_effect_and_only_then(machine: Machine) -> None:
    """Of the same seed, so that noise and inputs are the same."""
    on, off, again = machine.log(3), machine.log(3, effect=False), machine.log(3)
    np.testing.assert_array_equal(on.y, again.y)
    np.testing.assert_array_equal(on.u, off.u)
    assert np.sqrt(np.mean((on.y - off.y) ** 2)) > 5.0 * machine.noise[0]


@pytest.mark.parametrize(
    ("machine", "place", "function", "signals"),
    [
        (CHOKE, "loop", magnetic_saturation, {"flow of loop"}), (CHOKE, "loop", added_inertia, {"flow of loop"}),
        (RING, "loop", coulomb_loss, {"flow of loop"}), (RING, "loop", heating_resistance, {"flow of loop"}),
        (CLAMP, "node", relief, {"effort of node"}), (TANK, "level", constant_flow, set()),
        (STRUT, "leg", hardening_spring, {"displacement of coil"}), (SERVO, "loop", actuator_dead_zone, {"u"}),
        (STRUT, "leg", hysteresis_loss, {"bent_hysteresis_loss_leg"}),
    ],
)  # fmt: skip
def test_a_law_is_a_function_of_its_signals(
    machine: Machine, place: str, function: EffectFunction, signals: set[str]
) -> None:
    graph = machine.graph()
    (made,), _ = candidates(bg.build(graph), [function], [Place(handle(graph, place), Scale(10.0, 2.0))])
    assert arguments(Trial(made, 1.0), made.apply(graph)) == signals


def test_a_law_that_stores_has_its_own_signals_and_what_its_element_holds() -> None:
    graph = CERAMIC.graph()
    where = [Place(handle(graph, "node"), Scale(10.0, 2.0))]
    (made,), _ = candidates(bg.build(graph), [hardening_spring], where)
    stores = Trial(made, 1.0)
    told = stored_signals([stores], stores.candidate.apply(graph))
    assert told == {"effort of node", "displacement of ceramic"}
    assert stored_signals([], graph) == frozenset()


@pytest.mark.slow
def test_a_ceramic_condenser_is_found_and_its_twin_is_clean() -> None:
    found, twin = asked("ceramic", CERAMIC, True), asked("ceramic", CERAMIC, False)
    assert found.right and found.named == ("voltage_dependent_capacitance at node",)
    assert twin.verdict == "no missing effect"


def test_of_a_slowly_sampled_body_next_to_exact_means_next_to_exact() -> None:
    """What its least process noise walks in a time constant of 1200 s is far below the noise of its sensor, 0.1 K."""
    built = bg.build(SINK.graph())
    logs = [SINK.log(seed, effect=False) for seed in TRAIN]
    setup = filter_setup(built.model, built.driven, logs)
    (least,) = [one.lower for one in setup.noise if one.target.kind == "process"]
    assert least * np.sqrt(1200.0) / 550.0 < 0.1 * SINK.noise[0]


@pytest.mark.slow
def test_a_scale_of_the_heater_does_not_hide_process_noise() -> None:
    assert not asked("sink", SINK, False).named


@pytest.mark.slow
@pytest.mark.parametrize(
    "machine", [RING, CHOKE, TANK, PRESS, SINK, SLIDE, FAN, BLOCK, SERVO],
    ids=["ring", "choke", "tank", "press", "sink", "slide", "fan", "block", "servo"],
)  # fmt: skip
def test_a_law_of_another_form_is_one_law_at_its_place(machine: Machine) -> None:
    """What the dictionary's form leaves of it was a second law: an activation drop beside a contact drop."""
    assert asked("machine", machine, True).strict


@pytest.mark.slow
def test_places_that_the_sensor_does_not_tell_apart_are_told_as_a_group() -> None:
    """A current that a node loses by its voltage shows as a drop at the line before it; it belongs to the node."""
    closed = bg.close_loop(CLAMP.graph(), [CLAMP.log(seed) for seed in TRAIN], [CLAMP.log(HELD_OUT)])
    (found,) = closed.added
    assert is_right(CLAMP, closed, strict=True) and found.trial.candidate.place.label == "node"
    name = found.trial.candidate.effect.name
    told = [one for one in result_json(closed)["alternatives"] if one["indistinguishable"]]
    assert {"name": name, "junction": "line"}.items() <= told[0].items()
    notes = report_data(closed, result_json(closed), Provenance("close-loop")).notes
    title = law_title(name)
    assert f"These data do not tell {title} at node from {title} at line." in notes


def test_a_group_counts_only_where_the_result_names_it() -> None:
    """The right formula at the place that shows the same is right with its group, and wrong without."""
    line = Place(handle(CLAMP.graph(), "line"), Scale(20.0, 2.0))
    voltage = Signal("effort of node", "V", (np.linspace(0.0, 15.0, 50),))
    term = next(one for one in library([voltage], voltage) if one.kind.name == "cube")
    formula = Formula(line, "effort", "V", (term,), (1.0,))
    (made,), _ = candidates(bg.build(CLAMP.graph()), [formula.effect()], [line])
    added = Added(Trial(made, 1.0), made.effect.parameters)
    assert not is_answer(CLAMP, added)
    told = {"name": formula.name, "junction": "node", "indistinguishable": True, "round": 1}
    assert is_in_group(CLAMP, added, {"alternatives": [told]})
    for wrong in ({"indistinguishable": False}, {"junction": "line"}, {"round": 2}, {"name": "formula_of_another"}):
        assert not is_in_group(CLAMP, added, {"alternatives": [told | wrong]})


def test_a_capacity_is_as_declared_at_the_temperature_of_a_room() -> None:
    """Where what is around is an input, it was so at absolute zero: then it could not rise by much over 300 K."""
    graph, capacity, u = BLOCK.graph(), 360.0, np.array([100.0, 293.0])
    place = Place(handle(graph, "core"), Scale(600.0, 500.0))
    (made,), _ = candidates(bg.build(graph), [varying_heat_capacity], [place])
    (name,) = made.effect.coefficients
    for c in (0.0, 4e-3):
        for temperature in (ROOM, 450.0):
            stored = np.array([capacity * temperature])  # in what is declared of the capacity
            warms = made.model.rhs(0.0, stored, u, made.model.theta(**{name: c}))[0] / capacity
            flow = 100.0 - (temperature - 293.0) / 0.9
            assert warms == pytest.approx(flow / (capacity * (1.0 + c * (temperature - ROOM))))


@pytest.mark.slow
def test_a_leak_between_two_chambers_is_found() -> None:
    found = asked("ram", WORN_RAM, True)
    assert found.right and found.named[0].endswith("_between at front and back")


@pytest.mark.slow
def test_a_late_sensor_is_late_by_a_delay() -> None:
    """Of 70 ms the approximation leaves less than the sensor's noise, where two lags left twice as much beside it."""
    closed = bg.close_loop(late.hoist(), [late.log(seed, 0.07) for seed in TRAIN], [])
    assert closed.verdict == "sensor fault suspected"
    (fault,) = closed.added
    assert fault.trial.candidate.label == "sensor_delay at sensor speed" and not closed.disturbances
    assert closed.corrected.values["delay_speed"] == pytest.approx(0.07, rel=0.01)
    assert closed.corrected.values["J"] == pytest.approx(1.0, rel=0.01)
    assert closed.corrected.values["d"] == pytest.approx(3.0, rel=0.01)
    assert closed.corrected.values["std(speed)"] < 2.0 * late.NOISE[0]


@pytest.mark.slow
def test_a_slow_sensor_follows_by_a_lag() -> None:
    """Of a level in a stilling pipe a delay was found, a leak and a tank that narrows, while lags were not tried."""
    closed = bg.close_loop(late.hoist(), [late.log(seed, lag=0.15) for seed in TRAIN], [])
    assert closed.verdict == "sensor fault suspected"
    (fault,) = closed.added
    assert fault.trial.candidate.label == "sensor_lag at sensor speed" and not closed.disturbances
    assert closed.corrected.values["lag_speed"] == pytest.approx(0.15, rel=0.01)


@pytest.mark.slow
def test_a_motor_that_acts_late_is_late_by_a_delay() -> None:
    """A command of an inverter that acted 52 ms late was an inductance, a polarisation and a sensor's scale."""
    settings = LoopSettings(inputs_as_declared=True)  # taken as held they are late by half a sample already
    closed = bg.close_loop(late.hoist(), [late.log(seed, acting=0.06) for seed in TRAIN], [], settings=settings)
    (law,) = closed.added
    assert law.trial.candidate.label == "actuator_delay at drum" and not closed.disturbances
    assert closed.corrected.values["T_actuator_delay_drum"] == pytest.approx(0.06, rel=0.01)
    assert closed.corrected.values["J"] == pytest.approx(1.0, rel=0.01)
