"""Time is no regime: what happens at a time in one log is told beside the law and enters no declaration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.fits.whiteness import whiteness
from bondgraph.correct.loop import ClosedLoop, close_loop
from bondgraph.correct.result import result_json
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import with_values
from bondgraph.declare.graph import BondGraph
from bondgraph.report.closed_loop import explanation, report_data
from bondgraph.report.html import Provenance
from bondgraph.simulate.simulation import simulate
from tests.correct.sled import FUNCTIONS, NOISE, added, pull, sled

WHEN, DRAG, PUSH = 22.0, 1.2, 30.0


def turning(before: BondGraph, after: BondGraph, when: float, seed: int, name: str) -> MatchedLog:
    """A log of a sled that is another one from a time on."""
    calm = pull(sled(), seed, name=name)
    first, last = (build(with_values(graph, {"c_guide": 10.0})).model for graph in (before, after))
    k = int(np.searchsorted(calm.time, when))
    begun = simulate(first, calm.time[: k + 1], calm.u[:, : k + 1], rtol=1e-8).raise_if_failed()
    ended = simulate(last, calm.time[k:], calm.u[:, k:], x0=begun.x[:, -1], rtol=1e-8).raise_if_failed()
    y = np.concatenate([begun.y[:, :-1], ended.y], axis=1)
    noise = np.array([[NOISE[one]] for one in first.names("output")])
    return replace(calm, y=y + noise * np.random.default_rng(seed).standard_normal(y.shape))


@pytest.fixture(scope="module")
def happened() -> ClosedLoop:
    """Drag from 22 s of the first of two logs on; before, it was the law "..., from 22 s of first", in all later logs.

    With the second log free of it, that made "until" or "from" of whichever fitted both logs least badly.
    """
    drag = added(effects.quadratic_loss, "runner", DRAG)
    logs = [turning(sled(), drag, WHEN, 1, "first"), pull(sled(), 101, name="second", c_guide=10.0)]
    return close_loop(sled(), logs, [pull(sled(), 50, name="held", c_guide=10.0)], FUNCTIONS)


def test_what_happens_at_a_time_is_an_event_with_its_time_log_and_size(happened: ClosedLoop) -> None:
    assert happened.added == () and happened.verdict == "unexplained residual"
    (event,) = result_json(happened)["events"]
    assert (event["name"], event["acts"], event["log"]) == ("quadratic_loss", "from", "first")
    assert event["time"] == pytest.approx(WHEN, abs=1.0)
    ((_, size),) = event["coefficients"].items()
    assert size["value"] == pytest.approx(DRAG, rel=0.03) and size["ci95"][0] < size["value"] < size["ci95"][1]


def test_the_corrected_declaration_has_no_event(happened: ClosedLoop) -> None:
    assert happened.corrected is happened.nominal
    assert happened.corrected_graph.nodes.keys() == sled().nodes.keys()
    assert not any("switch" in one.name or "quadratic" in one.name for one in happened.corrected_graph.parameters)
    assert happened.eventful is not None and happened.eventful.nll < happened.corrected.nll - 100.0


def test_an_event_is_said_and_not_called_a_law(happened: ClosedLoop) -> None:
    said = explanation(happened)
    assert "Something happened" in said and "of first" in said and "lacks" not in said
    notes = report_data(happened, {}, Provenance("", None, (), (), (), 0.0)).notes
    assert any(note.startswith("Event: quadratic_loss at") and "Time is no law" in note for note in notes)
    assert {one.action for one in happened.history} <= {"event", "stopped"}


def test_parameters_that_made_up_for_an_event_are_told_as_they_are_beside_it(happened: ClosedLoop) -> None:
    """Of a bearing that got worse at 12 s the inertia was 18 % off, and only the sentence on the event knew."""
    assert happened.eventful is not None and happened.eventful.values["c_guide"] == pytest.approx(10.0, rel=0.05)
    problem, point = happened.nominal.problem, happened.nominal.point.copy()
    point[problem.names.index("c_guide")] = problem.upper[problem.names.index("c_guide")]
    off = replace(happened, nominal=replace(happened.nominal, point=point))
    notes = report_data(off, {}, Provenance("", None, (), (), (), 0.0)).notes
    (said,) = [note for note in notes if note.startswith("A fit that knows of the event has c_guide = ")]
    assert said.endswith("the other estimates make up for it.")


@pytest.mark.slow
def test_a_law_is_found_beside_an_event_and_alone_in_the_declaration() -> None:
    drag = added(effects.quadratic_loss, "runner", DRAG)
    both = added(effects.constant_effort, "runner", PUSH, added(effects.quadratic_loss, "runner", DRAG))
    logs = [turning(drag, both, WHEN, 1, "first"), pull(drag, 101, name="second", c_guide=10.0)]
    found = close_loop(sled(), logs, [pull(drag, 50, name="held", c_guide=10.0)], FUNCTIONS)
    assert [one.trial.candidate.effect.name for one in found.events] == ["constant_effort"]
    assert [one.trial.candidate.effect.name for one in found.added] == ["quadratic_loss"]
    assert found.verdict == "effect found"
    # "innovations stay coloured" was said of the model without the event, which colours them
    assert all(one.p_value > 0.01 for one in found.whiteness)
    assert any(one.p_value < 1e-3 for one in whiteness(found.corrected, logs))
    (name,) = found.added[0].coefficients
    assert found.corrected.values[name] == pytest.approx(DRAG, rel=0.1)  # 1.55 where nothing is known of the event
    assert not any("load" in one.name for one in found.corrected_graph.parameters)
    (said,) = [one for one in found.cautions if one.startswith("a fit that knows of no event has")]
    assert f"{name} = 1.5" in said and "nats less" in said


def test_a_law_of_every_log_is_no_event() -> None:
    drag = added(effects.quadratic_loss, "runner", DRAG)
    found = close_loop(sled(), [pull(drag, seed, name=f"run{seed}") for seed in (1, 2, 3)], [], FUNCTIONS)
    assert found.events == () and [one.trial.candidate.label for one in found.added] == ["quadratic_loss at runner"]
