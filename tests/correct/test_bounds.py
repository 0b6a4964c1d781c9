"""Bounds of coefficients: they scale a search and hold no result; a law that takes energy never gives any."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
import sympy

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.cautions import resting
from bondgraph.correct.evidence.decide import robust_p_value
from bondgraph.correct.loop import LoopSettings, close_loop
from bondgraph.correct.models.candidates import candidates
from bondgraph.correct.round import one_round
from bondgraph.correct.scores.scoring import linearisation
from bondgraph.declare.domains import ROTATION
from bondgraph.declare.editing import copy, handle, with_bounds, with_values
from bondgraph.declare.effect import Effect, EffectFunction, Place, Scale, effect_functions, is_for
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.json_reader import graph_from_json
from bondgraph.declare.json_writer import graph_to_json
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.setup import filter_setup
from tests.correct import sled
from tests.correct.buggy import AIR, LOSS, RADIUS, buggy, coast
from vehicle_graphs import machine_effects

LAWS: tuple[EffectFunction, ...] = (
    effects.constant_effort, effects.viscous_loss, effects.coulomb_loss, effects.quadratic_loss,
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("process_noise", ["free", "none"])
def test_a_loss_twelve_times_its_bound_is_found_and_no_drift_of_a_sensor(process_noise: str) -> None:
    """A coast-down of a buggy: the bound was 0.078 where 1.22 is true.

    Every law of a loss ended on its bound, which counted as absent (p = 1): "unexplained residual" with process noise
    free or none, and a drift of the speed sensor led.
    """
    logs = [coast(1, 12.0), coast(2, 10.0), coast(3, 14.0)]
    found = close_loop(buggy(), logs, [coast(9, 13.0)], LAWS, LoopSettings(process_noise=process_noise))
    assert found.verdict == "effect found"
    (added,) = found.added  # wheel and body are tied rigidly, so the same law may stand at either
    own = added.trial.candidate.label
    assert {own, *added.trial.stands_for} >= {"viscous_loss at axle"} and own.startswith("viscous_loss")
    loss = LOSS if own == "viscous_loss at axle" else LOSS / RADIUS**2
    (name,) = added.coefficients
    assert found.corrected.values[name] == pytest.approx(loss, abs=4.0 * found.corrected.std[name])
    assert found.corrected.std[name] < 0.1 * loss
    assert found.corrected.values["air"] == pytest.approx(AIR, abs=4.0 * found.corrected.std["air"])
    before, after = (one.channels["speed"].simulation_rmse for one in (found.nominal_holdout, found.corrected_holdout))
    assert before > 2.0 and after < 0.07
    declared = added.trial.candidate.bounds(name)
    (kept,) = [one for one in graph_from_json(graph_to_json(found.corrected_graph)).parameters if one.name == name]
    assert declared[1] < 0.1 * loss or own == "viscous_loss at body"
    assert kept.value > 0.9 * loss and kept.bounds is not None and kept.value < kept.bounds[1]


def test_nothing_is_claimed_of_a_buggy_that_lacks_nothing() -> None:
    logs = [coast(k, start, loss=0.0, seconds=20.0) for k, start in ((1, 12.0), (2, 10.0), (3, 14.0))]
    found = close_loop(buggy(), logs, [], LAWS)
    assert (found.verdict, found.added, found.confirmation) == ("no missing effect", (), None)


def _free(lower: float, upper: float, start: float, **other: bool) -> FreeParameter:
    return FreeParameter("c_guide", lower, upper, start, **other)  # type: ignore[arg-type]


@pytest.mark.parametrize(("lower", "upper"), [(0.0, 0.05), (-0.02, 0.01)], ids=["loss", "signed"])
def test_a_search_goes_on_beyond_bounds_that_only_scale_it(lower: float, upper: float) -> None:
    log = sled.pull(sled.sled(), 3)
    base = sled.fitted([log])
    free = tuple(one for one in base.problem.free if one.name != "c_guide")
    at_most = fit(EstimationProblem(base.problem.filter_model, (log,), (*free, _free(lower, upper, 0.5 * upper))))
    assert at_most.values["c_guide"] == upper and at_most.nll > base.nll + 100.0
    wider = fit(
        EstimationProblem(base.problem.filter_model, (log,), (*free, _free(lower, upper, 0.5 * upper, widens=True)))
    )
    assert wider.values["c_guide"] == pytest.approx(base.values["c_guide"], rel=1e-3)
    assert wider.nll == pytest.approx(base.nll, abs=0.05)
    (kept,) = [one for one in wider.problem.free if one.name == "c_guide"]
    assert not np.any(wider.held & np.isin(wider.problem.names, ["c_guide"])) and kept.lower == (lower and kept.lower)


@pytest.mark.parametrize(("true", "chosen"), [(1.0, None), (4.0, "quadratic_loss at runner")])
def test_what_a_parameter_beyond_its_bound_explains_is_no_law(true: float, chosen: str | None) -> None:
    """The guide's friction is declared to be 2 N s/m at least. Where it is half of that a constant push gains 470 nats.

    The friction beyond its bound explains 3497.
    """
    drag = 0.0 if chosen is None else 3.0
    truth = with_bounds(sled.added(effects.quadratic_loss, "runner", drag), {"c_guide": (0.1, 60.0)})
    logs = [sled.pull(truth, seed, name=f"run{seed}", c_guide=true) for seed in (1, 2)]
    base = sled.fitted(logs)
    assert (resting(base) == ["c_guide"]) == (chosen is None)
    turn = one_round(sled.built(), base, logs, sled.FUNCTIONS)
    found = None if turn.chosen is None else turn.chosen.candidate.label
    assert found == chosen or (found is not None and chosen in turn.chosen.stands_for)  # type: ignore[union-attr]
    if chosen is None:
        refused = [one.remark for one in turn.trials if "beyond the declared bounds" in one.remark]
        assert refused and all(one.startswith("c_guide = ") and one.endswith("nats without it") for one in refused)


def test_zero_and_the_lower_bound_of_a_size_stay() -> None:
    """A loss that would be a gain, a compliance that would be rigid: what lies beyond is another thing."""
    log = sled.pull(sled.sled(), 3)
    base = sled.fitted([log])
    free = tuple(one for one in base.problem.free if one.name != "c_guide")
    size = FreeParameter("c_guide", 20.0, 50.0, 30.0, scale="log", widens=True)
    found = fit(EstimationProblem(base.problem.filter_model, (log,), (*free, size)))
    assert found.values["c_guide"] == 20.0 and found.problem.free[-1].upper == 50.0
    assert _free(0.0, 1.0, 0.0, widens=True).wider(10.0).lower == 0.0


def test_a_coefficient_on_its_upper_bound_is_not_absent() -> None:
    log = sled.pull(sled.sled(), 3)
    base = sled.fitted([log])
    free = tuple(one for one in base.problem.free if one.name != "c_guide")
    held = fit(
        EstimationProblem(base.problem.filter_model, (log,), (*free, _free(0.0, 0.9 * base.values["c_guide"], 5.0)))
    )
    assert held.held[-1] and robust_p_value(held, ["c_guide"]) < 1e-6  # was 1
    at_zero = replace(held, point=np.append(held.point[:-1], 0.0))
    assert robust_p_value(at_zero, ["c_guide"]) == 1.0


def pushed(g: BondGraph, at: Place) -> Effect | None:
    """A drag whose author forgot that it cannot push."""
    if at.junction.name != "runner":
        return None
    c = g.parameter("c_pushed", 0.0, "N/(m/s)^2", "drag", (-30.0, 30.0))
    g.resistance("pushed", lambda flow: c * flow * abs(flow), at=at.junction)
    return Effect("pushed", "pushed", "effort = c*flow*|flow|", ("c_pushed",))


def taken(g: BondGraph, at: Place) -> Effect | None:
    """The same, which says that it takes energy."""
    effect = pushed(g, at)
    return None if effect is None else replace(effect, name="taken", dissipative=True)


def test_names_do_not_tell_a_parameter_of_the_machine_from_a_shape_of_a_law() -> None:
    """A parameter named as an added law was taken for a shape of that law, and its bound for none."""
    graph = with_bounds(with_values(sled.sled(), {"c_guide": 4.0}), {"c_guide": (2.0, 5.0)})
    size = graph.parameter("k_guide", 1.0, "N s^2/m^2", "", (0.0, 5.0))
    speed = graph.parameter("v_guide", 20.0, "m/s", "", (19.0, 20.0))
    graph.resistance("law", lambda v: size * v * abs(v) / (1 + (v / speed) ** 2), at="runner")
    train = [sled.pull(sled.sled(), 3)]
    own = build(graph)
    setup = filter_setup(own.model, own.driven, train)
    free = [replace(one, widens=one.name == "k_guide") for one in (*free_parameters(setup, ()), *setup.noise)]
    base = fit(EstimationProblem(setup.filter_model, tuple(train), tuple(free)))
    resting = {one.name for one, rests in zip(base.problem.free, base.held, strict=True) if rests}
    assert {"c_guide", "v_guide"} <= resting
    bounded = linearisation(base, train, ["k_guide", "v_guide"]).bounded
    assert bounded is not None and bounded.shape[1] == 1
    every = linearisation(base, train).bounded
    assert every is not None and every.shape[1] == 2
    assert np.array_equal(every[:, 0], bounded[:, 0])
    assert linearisation(base, train, ["k_guide", "v_guide", "c_guide"]).bounded is None


@pytest.mark.slow
def test_a_loss_that_would_give_energy_is_refused() -> None:
    true = sled.added(effects.quadratic_loss, "runner", 1.2)
    logs = [sled.pull(true, seed, name=f"run{seed}", c_guide=30.0) for seed in (1, 2)]
    graph = copy(sled.sled())
    drag = 2.4  # declared, and twice what is true
    graph.resistance("drag", lambda flow: drag * flow * abs(flow), at=handle(graph, "runner"))
    found = {
        function: close_loop(graph, logs, [], (function,), LoopSettings(faults=False)) for function in (pushed, taken)
    }
    (signed,) = found[pushed].added
    assert found[pushed].corrected.values["c_pushed"] == pytest.approx(-1.2, rel=0.1)
    assert all(one.trial.candidate.effect.formula for one in found[taken].added)  # a drag declared too large is no loss
    assert signed.trial.candidate.bounds("c_pushed")[0] < 0.0


def test_a_dissipative_law_whose_coefficient_cannot_be_positive_is_told() -> None:
    def wrong(g: BondGraph, at: Place) -> Effect | None:
        effect = pushed(g, at)
        if effect is None:
            return None
        g._quantities["c_pushed"] = replace(g._quantities["c_pushed"], bounds=(-30.0, 0.0))  # type: ignore[call-arg]
        return replace(effect, dissipative=True)

    own = build(sled.sled())
    made, refused = candidates(own, [wrong], [Place(handle(own.graph, "runner"), Scale(150.0, 4.0))])
    assert made == [] and "may not be positive" in refused[0].why


@pytest.mark.parametrize("module", [effects, machine_effects], ids=["effects", "machine"])
def test_every_law_that_is_called_dissipative_takes_power_wherever_it_acts(module: ModuleType) -> None:
    rng = np.random.default_rng(3)
    seen = set()
    for function in effect_functions(module):
        for name, kind in (("axle", "1"), ("body", "1"), ("link", "0")):
            g = BondGraph("bench")
            domain = ROTATION if name == "axle" else buggy().nodes["body"].domain
            at = g.one_junction(name, domain) if kind == "1" else g.zero_junction(name, domain)
            far = g.zero_junction("far", domain)
            g.bond(far, at)
            effect = _tried(function, g, Place(at, Scale(10.0, 5.0)))
            if effect is None or not effect.dissipative or g.nodes[effect.element].kind != "R":
                continue
            seen.add(effect.name)
            (given, law), *_ = g.nodes[effect.element].laws
            own = sympy.Symbol("flow" if given == "effort" else "effort")
            free = sorted(law.free_symbols, key=str)
            power = sympy.lambdify(free, law * next(one for one in free if str(one) == str(own)), "numpy")
            values = [rng.normal(size=200) if one in _signals(law, g, own) else rng.uniform(0.1, 3.0) for one in free]
            assert np.all(power(*values) >= 0.0), effect.name
    assert seen >= ({"viscous_loss", "stribeck_loss", "creep"} if module is effects else {"cubic_loss"})


def _tried(function: EffectFunction, g: BondGraph, at: Place) -> Effect | None:
    return function(g, at) if is_for(function, at) else None


def _signals(law: sympy.Expr, g: BondGraph, own: sympy.Symbol) -> set[sympy.Basic]:
    """What may have any sign: the flow itself and signals of the graph, no parameters."""
    known = {parameter.name for parameter in g.parameters} | {"t"}
    return {one for one in law.free_symbols if str(one) not in known}


def test_the_dictionary_says_of_every_loss_that_it_takes_energy() -> None:
    """Whatever is called a loss, a creep or a slip may not give energy."""
    g = buggy()
    for function in (*effect_functions(effects), *effect_functions(machine_effects)):
        for name in ("axle", "body"):
            effect = _tried(function, copy(g), Place(handle(g, name), Scale(10.0, 5.0)))
            if effect is not None and effect.name.endswith(("loss", "creep", "slip")):
                assert effect.dissipative, effect.name
