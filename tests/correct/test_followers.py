"""Storages and lags that an effect adds start where the machine stands, not at a declared zero."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import BuiltModel, build
from bondgraph.correct.evidence.context import Context
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.fits.assess import assess
from bondgraph.correct.models.candidates import Candidate, candidates, places
from bondgraph.correct.models.followers import followers
from bondgraph.correct.models.started import with_declared_starts
from bondgraph.correct.search.refit import refit
from bondgraph.data.log import Log, LogChannel, MatchedLog
from bondgraph.declare.domains import ROTATION, THERMAL
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.json_writer import graph_to_json
from bondgraph.effects.sensors import sensor_lag
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from bondgraph.filter.follows import with_followers
from bondgraph.report.simulation import SimulationOptions, simulate_graph
from bondgraph.simulate.simulation import simulate

RATIO, J_M, J_F, DRAG, SOFT = 4.0, 4e-4, 0.02, 4e-4, 6.0


def rig() -> BondGraph:
    """A motor and a fan behind a gear, the shaft between them declared as rigid."""
    g = BondGraph("rig")
    torque = g.input("torque", "N m")
    J_motor, J_fan = g.parameter("J_motor", J_M, "kg m^2"), g.parameter("J_fan", J_F, "kg m^2")
    drag = g.parameter("drag", DRAG, "N m s^2", "air", (1e-4, 2e-3))
    motor, shaft, wheel = (g.one_junction(name, ROTATION) for name in ("motor", "shaft", "wheel"))
    g.effort_source("drive", torque, at=motor)
    g.inertance("rotor", J_motor, at=motor, state="w_motor")
    g.transformer("gearbox", 1 / g.parameter("ratio", RATIO, ""), motor, shaft)
    g.bond(shaft, wheel)
    g.inertance("blades", J_fan, at=wheel, state="w_fan")
    g.resistance("air", lambda w: drag * w * abs(w), at=wheel)
    g.measure_flow("speed", motor)
    return g


@functools.cache
def built() -> BuiltModel:
    return build(rig())


def elastic() -> BuiltModel:
    found = [one for one in offered() if one.effect.name == "added_compliance"]
    return build(found[0].apply(rig()))


def lagging() -> BuiltModel:
    return build(next(one for one in offered() if one.effect.name == "actuator_lag").apply(rig()))


def offered() -> list[Candidate]:
    log = running(0)
    base = fitted(0)
    where = places(built(), [log], base.runs([log]), base.theta)
    return candidates(built(), [effects.added_compliance, effects.actuator_lag], where)[0]


@functools.cache
def running(seed: int) -> MatchedLog:
    """A log of the fan on a soft shaft that begins in motion, at 240 rad/s of the motor under 0.3 N m."""
    time = 0.02 * np.arange(300)
    torque = 0.3 + 0.1 * np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, 16), 20)[:300]
    torque[:20] = 0.3
    g = BondGraph("truth")
    given = g.input("torque", "N m")
    motor, fan = g.one_junction("motor", ROTATION), g.one_junction("fan", ROTATION)
    shaft, twist = g.zero_junction("shaft", ROTATION), g.one_junction("twist", ROTATION)
    fast = g.one_junction("fast", ROTATION)
    start = float(np.sqrt(0.3 * RATIO / DRAG))
    g.effort_source("drive", given, at=motor)
    g.inertance("rotor", g.parameter("J_m", J_M, "kg m^2"), at=motor, initial=RATIO * start, state="w_motor")
    g.transformer("gearbox", 1 / g.parameter("n", RATIO, ""), motor, fast)
    g.bond(fast, shaft)
    g.bond(shaft, twist)
    g.bond(shaft, fan)
    g.compliance("spring", g.parameter("k", SOFT, "N m/rad"), at=twist, initial=0.3 * RATIO / SOFT)
    g.resistance("damper", g.parameter("d", 0.05, "N m s/rad"), at=twist)
    g.inertance("blades", g.parameter("J_f", J_F, "kg m^2"), at=fan, initial=start, state="w_fan")
    drag = g.parameter("drag", DRAG, "N m s^2")
    g.resistance("air", lambda w: drag * w * abs(w), at=fan)
    g.measure_flow("speed", motor)
    run = simulate(build(g).model, time, torque[np.newaxis], rtol=1e-8).raise_if_failed()
    noise = 0.2 * np.random.default_rng([seed, 1]).standard_normal(run.y.shape)
    return MatchedLog(f"run{seed}", time, torque[np.newaxis], run.y + noise)


@functools.cache
def fitted(*seeds: int) -> Fit:
    logs = tuple(map(running, seeds))
    setup = filter_setup(built().model, built().driven, logs)
    return fit(EstimationProblem(setup.filter_model, tuple(logs), (*free_parameters(setup, ()), *setup.noise)))


def test_an_inertia_set_free_starts_at_the_speed_it_was_tied_to_and_a_spring_at_its_load() -> None:
    after = elastic()
    new = [name for name in after.model.names("state") if name not in built().model.names("state")]
    assert len(new) == 2 and built().model.names("state") != after.model.names("state")
    speed, torque = 219.0, 0.3
    known = built().model.names("state")
    x = np.array([speed if name == "w_motor" else speed / RATIO for name in known])
    starts = followers(built(), after, x, np.array([torque]), {})
    assert set(starts) == set(new)
    begun = with_followers(after.model, after.model.x0(**dict(zip(known, x, strict=True))), np.array([torque]), starts)
    values = dict(zip(after.model.names("state"), begun, strict=True))
    assert values["w_motor"] == pytest.approx(RATIO * values["w_fan"], rel=1e-6)
    # under this load the rigid machine neither gains nor loses speed, and the spring carries what the air takes
    rates = dict(
        zip(
            after.model.names("state"),
            after.model.rhs(0.0, begun, np.array([torque]), after.model.theta()),
            strict=True,
        )
    )
    assert abs(rates["w_motor"]) < 0.02 * torque / J_M and abs(rates["w_fan"]) < 0.02 * RATIO * torque / J_F


def test_bonds_without_a_finite_value_tell_nothing_of_a_start() -> None:
    """A point at which a law overflows, as a gap of a log had one, raised a warning about infinity less infinity."""
    known = built().model.names("state")
    far = np.full(len(known), 1e200)  # the air takes the square of that
    assert isinstance(followers(built(), elastic(), far, np.array([0.3]), {}), dict)


def test_a_lag_starts_at_its_command() -> None:
    after = lagging()
    (new,) = (name for name in after.model.names("state") if name not in built().model.names("state"))
    x = np.full(len(built().model.states), 50.0)
    (follow,) = followers(built(), after, x, np.array([0.3]), {}).values()
    for torque in (0.3, -0.2, 1.5):
        assert follow.value({"torque": torque, "w_motor": 10.0, "w_fan": 2.5}) == pytest.approx(torque, abs=1e-6)
    assert new.startswith("given_")


def test_the_free_simulation_of_a_log_that_begins_in_motion_starts_right() -> None:
    # started at zero the fan first takes all the speed of the motor: 47.97 rad/s where the rigid model has 1.23
    train, unseen = (running(1), running(2)), running(3)
    base = fitted(1, 2)
    candidate = next(one for one in offered() if one.effect.name == "added_compliance")
    context = Context(built(), base, train, 10, 0.01, 5.0)
    found = refit(Trial(candidate, 0.0), [], context)
    assert found.fit is not None and found.gain > 50.0
    problem = found.fit.problem
    row = problem.filter_model.model.index("state", "w_fan")
    assert problem.initial_states[0][row] == pytest.approx(float(train[0].y[0, 0]) / RATIO, rel=0.02)
    after = assess(found.fit, [unseen]).channels["speed"].simulation_rmse
    assert after < assess(base, [unseen]).channels["speed"].simulation_rmse
    assert after < 1.0


@pytest.mark.parametrize("kind", ["elastic", "lagging"])
def test_a_corrected_declaration_says_where_its_states_start(kind: str) -> None:
    """Read back from its file and simulated, the fan started at the declared zero."""
    after = {"elastic": elastic, "lagging": lagging}[kind]()
    base, log = fitted(0), running(0)
    path = base.runs([log])[0].filtered_mean
    follows = followers(built(), after, path[: len(built().model.states), 0], log.u[:, 0], {})
    rows = [base.problem.filter_model.model.names("state").index("w_motor")] * len(after.model.states)
    declared, left = with_declared_starts(after, follows, [log], [path[rows]])
    graph = graph_from_json(graph_to_json(declared.graph))
    started = {one.state: (one.signal, one.factor) for one in build(graph).model.starts}
    if kind == "elastic":
        assert started == {"w_fan": ("speed", 1 / RATIO)} and left == ("q_added_compliance_motor_gearbox",)
    else:
        assert started == {"given_actuator_lag_motor": ("torque", 1.0)} and left == ()
    columns = {"torque": LogChannel("torque", "N m", log.u[0]), "speed": LogChannel("speed", "rad/s", log.y[0])}
    begun = simulate_graph(graph, Log("run", log.time, columns), SimulationOptions()).x[:, 0]
    x0 = dict(zip(declared.model.names("state"), begun, strict=True))
    if kind == "elastic":
        assert x0["w_fan"] == pytest.approx(log.y[0, 0] / RATIO) and x0["w_motor"] == 0.0
    else:
        assert x0["given_actuator_lag_motor"] == log.u[0, 0]
    assert with_declared_starts(after, {}, [log], [path[rows]]) == (after, ())


def kiln() -> BondGraph:
    """A body that is heated; its heat capacity is declared half as large again as it is."""
    g = BondGraph("kiln")
    power = g.input("P", "W", hold=True)
    capacity = g.parameter("C", 57000.0, "J/K", "body", (1e4, 2e5))
    loss = g.parameter("G", 12.0, "W/K", "walls", (2.0, 40.0))
    body, walls = g.zero_junction("body", THERMAL), g.one_junction("walls", THERMAL)
    g.flow_source("heater", power, at=body)
    g.compliance("heat", 1 / capacity, at=body, state="H", initial=57000.0 * 350.0)
    g.bond(body, walls)
    g.resistance("loss", 1 / loss, at=walls)
    g.bond(walls, g.effort_source("around", 293.0))
    g.measure_effort("temperature", body)
    return g


def test_a_late_thermometer_starts_at_what_it_shows_whatever_the_heat_capacity() -> None:
    """By the declared capacity the body was to begin at 350 K; by the estimated one it began at 533 K."""
    chance, time = np.random.default_rng(3), np.arange(400) * 20.0
    power = np.repeat(chance.uniform(0.0, 9000.0, 10), 40)
    body, shown = np.empty(400), np.empty(400)
    body[0] = shown[0] = 350.0
    for k in range(399):  # steps of a second
        t, s = body[k], shown[k]
        for _ in range(20):
            t, s = t + (power[k] - 10.0 * (t - 293.0)) / 38000.0, s + (t - s) / 110.0
        body[k + 1], shown[k + 1] = t, s
    y = (shown + 0.5 * chance.standard_normal(400))[np.newaxis]
    own = build(kiln())
    log = MatchedLog("kiln", time, power[np.newaxis], y)
    setup = filter_setup(own.model, own.driven, [log], "none")
    base = fit(EstimationProblem(setup.filter_model, (log,), (*free_parameters(setup, ()), *setup.noise)))
    where = places(own, [log], base.runs([log]), base.theta)
    (late,), _ = candidates(own, [sensor_lag], [one for one in where if one.output])
    done = refit(Trial(late, 0.0), [], Context(own, base, (log,), 10, 0.01, 5.0))
    assert done.fit is not None
    assert done.fit.values["C"] == pytest.approx(38000.0, rel=0.02)
    assert done.fit.values["lag_temperature"] == pytest.approx(110.0, rel=0.05)
    heat, following = done.fit.problem.batch(done.fit.point[:, np.newaxis]).x0[0][:, 0]
    assert heat / done.fit.values["C"] == pytest.approx(following, abs=0.5)
    assert following == pytest.approx(y[0, 0], abs=1.0)
