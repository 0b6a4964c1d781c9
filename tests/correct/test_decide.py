"""The scatter of coefficients: how many blocks of time tell it, and what a test makes of few."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.constants import BLOCKS, LEVEL
from bondgraph.correct.evidence.decide import (
    channel_shares,
    choose,
    doubt,
    effective_blocks,
    gauge_p_value,
    robust_p_value,
    within_a_sample,
)
from bondgraph.correct.evidence.trials import Evidence, Trial
from bondgraph.correct.models.candidates import candidates
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.effects.losses import relief
from bondgraph.effects.sensors import sensor_scale
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.free import declared_free
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from tests.correct.sled import built, fitted, pull, sled
from tests.effects.machines.electrical import CLAMP

LOG = pull(sled(), 4)
#: Measured in the first tenth of its time, and the last sample.
SHORT = replace(LOG, y=np.where((LOG.time < 0.1 * LOG.time[-1]) | (LOG.time == LOG.time[-1]), LOG.y, np.nan))


def test_a_coefficient_that_few_blocks_show_rests_on_few() -> None:
    assert 0.3 * BLOCKS < effective_blocks(fitted([LOG]), ["c_guide"]) <= BLOCKS
    assert 1.0 <= effective_blocks(fitted([SHORT]), ["c_guide"]) <= 5.0


def test_what_is_held_rests_on_all_blocks_and_is_told_by_no_channel() -> None:
    base = fitted([pull(sled(), 3)])
    assert base.held[base.problem.names.index("process(v_sled)")]
    assert effective_blocks(base, ["process(v_sled)"]) == BLOCKS + 1  # the last sample begins one of its own
    assert channel_shares(base, ["process(v_sled)"]) == {"speed": 0.0, "force": 0.0}


def test_the_channels_that_tell_of_a_coefficient_share_it() -> None:
    shares = channel_shares(fitted([LOG]), ["c_guide"])
    assert sum(shares.values()) == pytest.approx(1.0)
    deaf = replace(LOG, y=np.where([[True], [False]], LOG.y, np.nan))
    assert channel_shares(fitted([deaf]), ["c_guide"])["speed"] == pytest.approx(1.0)


@pytest.mark.parametrize(("log", "least"), [(LOG, 0.0), (SHORT, 1e-9)], ids=["whole", "short"])
def test_fewer_blocks_make_a_test_more_careful(log: MatchedLog, least: float) -> None:
    base = fitted([log])
    even, uneven = (robust_p_value(base, ["c_guide"], uneven=one) for one in (False, True))
    assert even < uneven
    assert least <= uneven < least + 1e-6


#: Parameters that are larger or smaller by the same factor with no trace.
_SCALED = ("R", "C", "R_load", "c_breakdown_node")


def rail(holding: str = "") -> Fit:
    """A fit of a line with a condenser, a load and a threshold, of which the voltage is measured alone.

    All currents may be larger by the same factor, unless the resistance of the line is held.
    """
    graph = CLAMP.graph()
    effect = relief(graph, Place(handle(graph, "node"), Scale(12.0, 100.0)))
    assert effect is not None
    built = build(graph)
    log = CLAMP.log(5)
    setup = filter_setup(built.model, built.driven, [log], "none")
    names = [name for name in ("R", "C", "R_load", *effect.parameters) if name != holding]
    free = (*(declared_free(name, setup.filter_model, logs=[log]) for name in names), *setup.noise)
    starts = {"c_breakdown_node": 0.1, "e_breakdown_node": 9.0}
    begun = [replace(one, start=starts.get(one.name, one.start)) for one in free]
    wide = [
        replace(one, lower=1e-2 * one.lower, upper=1e2 * one.upper) if one.name in _SCALED else one for one in begun
    ]
    return fit(EstimationProblem(setup.filter_model, (log,), tuple(wide)))


def test_a_law_beside_a_gauge_is_judged_by_what_it_gains() -> None:
    law, shape = ["c_breakdown_node"], ["e_breakdown_node"]
    loose, tight = rail(), rail("R")
    assert loose.nll == pytest.approx(tight.nll, abs=3.0)  # the factor costs next to nothing
    assert robust_p_value(tight, law, shape) < 1e-10
    assert gauge_p_value(1000.0, loose, law, shape) < 1e-10
    assert gauge_p_value(0.0, loose, law, shape) == 1.0
    assert gauge_p_value(1000.0, tight, law, shape) == 1.0  # there is none
    effect = Effect("breakdown", "breakdown_node", "", tuple(law), shapes=tuple(shape))
    assert doubt(loose, effect) < 1e-6


@pytest.mark.parametrize("sensors", [1, 2])
@pytest.mark.parametrize(("law", "believed", "chosen"), [
    (20.0, True, ("quadratic_loss", "quadratic_loss")),  # a law that passes, within odds of 20 to 1
    (20.0, False, (None, "sensor_scale")),  # within odds of 20 to 1: it may stand for another law of its kind
    (2.0, False, ("sensor_scale", "sensor_scale")),
])  # fmt: skip
def test_a_fault_of_the_only_sensor_explains_more_than_any_law(
    sensors: int, law: float, believed: bool, chosen: tuple[str | None, str]
) -> None:
    """On the coupled drives a scale of their only sensor was chosen beside two laws that explained as much."""
    log = replace(LOG, y=np.where([[True], [sensors > 1]], LOG.y, np.nan))
    base = fitted([log])
    places = [Place(handle(sled(), "runner"), Scale(150.0, 4.0)), Place.sensor("speed", Scale(4.0, 4.0))]
    (drag, scale), _ = candidates(built(), [effects.quadratic_loss, sensor_scale], places)
    doubted = Evidence(law, 1e-9, 1e-9 if believed else 0.5, law, 10)
    trials = [Trial(drag, law, fit=base, evidence=doubted), Trial(scale, 22.0, fit=base, evidence=_SURE)]
    best = choose(trials, LEVEL)
    assert (best and best.candidate.effect.name) == chosen[sensors - 1]


_SURE = Evidence(22.0, 1e-9, 1e-9, 22.0, 10)


@pytest.mark.parametrize(("more", "own"), [(0.0, True), (2.9, True), (3.1, False)])
def test_one_more_law_must_do_better_than_a_form_of_a_law_that_is_there(more: float, own: bool) -> None:
    """What a law of another form leaves was found as a load at the next shaft."""
    base = fitted([LOG])
    place = Place(handle(sled(), "runner"), Scale(150.0, 4.0))
    (form, law), _ = candidates(built(), [effects.quadratic_loss, effects.constant_effort], [place])
    better = replace(_SURE, delta_nll=22.0 + more, bic_gain=22.0 + more)
    trials = [
        Trial(form, 22.0, fit=base, evidence=_SURE, completes="a law at the runner"),
        Trial(law, 22.0, fit=base, evidence=better),
    ]
    assert choose(trials, LEVEL) is trials[0 if own else 1]
    doubted = replace(trials[0], evidence=replace(_SURE, p_robust=0.5))
    assert choose([doubted, trials[1]], LEVEL) is trials[1]  # it must pass like every other


@pytest.mark.parametrize(("more", "function", "chosen"), [
    (0.0, effects.quadratic_loss, "quadratic_loss"),
    (2.9, effects.quadratic_loss, "quadratic_loss"),
    (3.1, effects.quadratic_loss, "sensor_scale"),
    (0.1, effects.constant_effort, "sensor_scale"),  # a drive has no claim on what a sensor may do
])  # fmt: skip
def test_a_loss_is_chosen_before_an_equally_likely_fault_of_a_sensor(
    more: float, function: EffectFunction, chosen: str
) -> None:
    """A vehicle that only rolls forwards: dry friction of the axle and a bias of its torque sensor tie exactly."""
    base = fitted([LOG])
    places = [Place(handle(sled(), "runner"), Scale(150.0, 4.0)), Place.sensor("speed", Scale(4.0, 4.0))]
    (law, fault), _ = candidates(built(), [function, sensor_scale], places)
    better = replace(_SURE, delta_nll=22.0 + more, bic_gain=22.0 + more)
    best = choose([Trial(law, 22.0, fit=base, evidence=_SURE), Trial(fault, 22.0, fit=base, evidence=better)], LEVEL)
    assert best is not None and best.candidate.effect.name == chosen


@pytest.mark.parametrize(("seconds", "refused"), [(0.07, True), (0.9, True), (1.1, False), (45.0, False)])
def test_a_lag_within_half_a_sample_is_no_law(seconds: float, refused: bool) -> None:
    """Of a cell sampled every 2 s a lag of 0.07 s was found, where a polarisation was missing."""
    model = build(_lagging()).model
    log = MatchedLog("cycle", 2.0 * np.arange(50), np.zeros((1, 50)), np.zeros((1, 50)))
    fitted = SimpleNamespace(
        values={"T_lag": seconds},
        problem=SimpleNamespace(filter_model=SimpleNamespace(model=model), logs=(log,)),
    )
    lag = Effect("actuator_lag", "push", "command follows by dx/dt = (u - x)/T", ("T_lag",), adds_state=True)
    loss = Effect("warm_up_loss", "loss", "effort = c*exp(-t/T)*flow", ("T_lag",))
    assert bool(within_a_sample(fitted, lag)) is refused  # type: ignore[arg-type]
    late = replace(lag, name="sensor_lag", channel="speed")
    assert within_a_sample(fitted, loss) == within_a_sample(fitted, late) == ""  # type: ignore[arg-type]


def _lagging() -> BondGraph:
    g = BondGraph("sled")
    body = g.one_junction("body", TRANSLATION)
    g.parameter("T_lag", 0.1, "s", "lag", (5e-3, 2.0))
    g.inertance("mass", 80.0, at=body, state="v")
    g.measure_flow("speed", body)
    return g
