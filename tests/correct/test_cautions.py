"""Cautions on the declared model, in words that go with one name and with several."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import bondgraph as bg
from bondgraph.correct.cautions import after_delays, at_bounds, cautions_of
from bondgraph.correct.declared_fit import fit_declared
from bondgraph.correct.loop import LoopSettings
from bondgraph.correct.models.started import start_cautions
from bondgraph.declare.editing import with_bounds
from bondgraph.estimate.local import no_report
from tests.correct.windy_cart import cart, log


def _said(graph: bg.BondGraph) -> str:
    return " ".join(cautions_of(fit_declared(graph, [log(0.0)], [], LoopSettings(), no_report).fit, []))


def test_one_parameter_rests_and_several_rest_on_bounds() -> None:
    """A report said that d_d rest on their bounds."""
    one = _said(with_bounds(cart(), {"drag": (7.0, 9.0), "mass": (20.0, 900.0)}))
    assert "drag (9 N s/m) rests on its bound in the declared model" in one and "that it stands in for" in one
    both = _said(with_bounds(cart(), {"drag": (7.0, 9.0)}))
    assert (
        re.search(r"drag \(9 N s/m\), mass \(.* kg\) rest on their bounds", both) and "that they stand in for" in both
    )


def test_parameters_that_share_a_scale_are_said_to_act_only_together() -> None:
    """Of a chamber and its paddle a report asked for more variety, which tells no common scale."""

    def geared() -> bg.BondGraph:
        g = bg.BondGraph("cart")
        gain = g.parameter("gain", 1.0, "1", "", (0.1, 10.0))
        body = g.one_junction("body", bg.TRANSLATION)
        g.effort_source("push", gain * g.input("force", "N"), at=body)
        mass, drag = (
            g.parameter("mass", 50.0, "kg", "", (5.0, 500.0)),
            g.parameter("drag", 8.0, "N s/m", "", (0.8, 90.0)),
        )
        g.inertance("mass", mass, at=body, state="v", initial=3.0)
        g.resistance("wheels", lambda v: drag * v, at=body)
        g.measure_flow("speed", body)
        return g

    found = fit_declared(geared(), [log(0.0)], [], LoopSettings(), no_report)
    (said,) = found.cautions
    assert said.startswith("in these logs gain, mass and drag act only together, as ")
    assert not any("drive with more variety" in one for one in cautions_of(found.fit, []))


def test_one_state_stands_and_several_stand_somewhere() -> None:
    (one,), (both,) = start_cautions(["v"]), start_cautions(["v", "x"])
    assert "starts v at the declared value" in one and "where it stands" in one and "lead it -" in one
    assert "where they stand" in both and "lead them -" in both
    assert start_cautions([]) == []


def test_laws_after_a_delay_may_mend_its_approximation() -> None:
    """Of a late sensor false laws came after the delay, with no word of doubt; that of a command leaves nothing."""
    fitted = SimpleNamespace(values={"T_late": 0.0487})

    def law(name: str, *coefficients: str) -> Any:
        effect = SimpleNamespace(name=name, coefficients=coefficients)
        return SimpleNamespace(candidate=SimpleNamespace(effect=effect, label=f"{name} at armature"))

    delay, other = law("sensor_delay", "T_late"), law("polarisation", "c")
    (said,) = after_delays([delay, other], fitted)  # type: ignore[arg-type]
    assert said.startswith("sensor_delay at armature is") and "polarisation at armature" in said and "0.0487 s" in said
    exact = law("actuator_delay", "T_late")
    for laws in ([other, delay], [delay], [exact, other]):
        assert after_delays(laws, fitted) == []  # type: ignore[arg-type]


def test_a_parameter_that_left_its_bound_beside_a_law_is_not_told() -> None:
    """After a law was found a report said "or an effect is missing that it stands in for" of a bound left since."""
    graph = with_bounds(cart(), {"drag": (7.0, 9.0), "mass": (20.0, 900.0)})
    tight = fit_declared(graph, [log(0.0)], [], LoopSettings(), no_report).fit
    wide = fit_declared(with_bounds(graph, {"drag": (1.0, 90.0)}), [log(0.0)], [], LoopSettings(), no_report).fit
    assert any("drag" in one and "rests on its bound" in one for one in cautions_of(tight, [], tight))
    assert not any("rests on its bound" in one for one in cautions_of(tight, [], wide))


def test_a_parameter_on_its_bound_in_the_corrected_model_is_told_with_the_bound_and_its_unit() -> None:
    """Of a rope that was missing the bearing of a lift took what it could, down to its bound, without a word."""
    graph = with_bounds(cart(), {"drag": (7.0, 9.0), "mass": (20.0, 900.0)})
    fitted = fit_declared(graph, [log(0.0)], [], LoopSettings(), no_report).fit
    (said,) = at_bounds(fitted, "corrected", ["drag", "mass"])
    assert (
        said.startswith("drag (9 N s/m) rests on its bound in the corrected model") and "an effect is missing" in said
    )
    assert at_bounds(fitted, "corrected", ["another"]) == []
