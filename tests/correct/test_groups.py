"""Candidates that the sensors cannot tell apart, and sizes that no log could show."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.evidence.decide import detectable
from bondgraph.correct.evidence.trials import Trial
from bondgraph.correct.models.candidates import Candidate, candidates
from bondgraph.correct.scores.score import Scores
from bondgraph.correct.scores.scoring import Scored, linearisation, score_candidates
from bondgraph.correct.search.groups import alike
from bondgraph.declare.editing import handle
from bondgraph.declare.effect import Place, Scale
from bondgraph.report.html import Power
from bondgraph.report.tables import power_table, text_of
from tests.correct.sled import added, built, fitted, pull, sled


def scored_at(**flows: float) -> tuple[list[Candidate], Scored]:
    """Drag at the two rigidly tied places of a sled that lacks it, by the flows that bound its coefficient there."""
    log = pull(added(effects.quadratic_loss, "runner", 3.0), 1)
    where = [Place(handle(sled(), name), Scale(150.0, flow)) for name, flow in flows.items()]
    found, _ = candidates(built(), [effects.quadratic_loss], where)
    return found, score_candidates(linearisation(fitted([log]), [log]), found)


@pytest.mark.parametrize(
    ("flows", "first"),
    [({"drum": 13.0, "runner": 4.0}, "runner"), ({"drum": 13.0, "runner": 40.0}, "drum")],
)
def test_a_group_is_represented_where_its_law_may_be_as_large_as_its_score_asks(
    flows: dict[str, float], first: str
) -> None:
    """Bounded by the scale of its place to a tenth of what was missing, the runner still stood for the group."""
    found, scored = scored_at(**flows)
    groups = alike([Trial(one, 9.0) for one in found], scored.scores, 1.0)
    assert found[groups[0][0]].place.label == first and len(groups) == 1


def test_a_size_beyond_the_bounds_of_its_law_is_not_called_detectable() -> None:
    """At a place with next to no flow a size of 4e14 was "found nine times in ten"."""
    found, scored = scored_at(drum=13.0, runner=4.0)
    seen = detectable(found, scored.scores, 10.0, [])
    assert all(math.isfinite(one.size) for one in seen)
    faint = dataclasses.replace(scored.scores, information=scored.scores.information * [1.0, 1e-30])
    assert [math.isfinite(one.size) for one in detectable(found, faint, 10.0, [])] == [True, False]
    sizes = [Power(one.effect, one.junction, one.size, one.unit) for one in detectable(found, faint, 10.0, [])]
    shown = text_of(power_table(sizes))
    assert "not with these logs" in shown and "e+" not in shown


def test_laws_that_part_as_they_grow_are_refitted_each() -> None:
    """A spring that nears a limit begins as one with a cube: it stood for that one, which explained 111 nats less."""
    g = sled()
    stiffness = g.parameter("stiffness", 80.0, "N/m")
    g.compliance("strap", lambda x: stiffness * x, at=handle(g, "runner"), state="x")
    own = build(g)
    place = Place(handle(g, "runner"), Scale(150.0, 4.0))
    found, _ = candidates(
        own, [effects.hardening_spring, effects.softening_spring, effects.progressive_spring], [place]
    )
    hard, soft, rising = found
    assert (hard.bends, soft.bends, rising.bends) == (False, True, False)
    assert hard.parts_from(soft) and soft.parts_from(hard)
    assert not hard.parts_from(rising) and not soft.parts_from(soft)
    two, steps = np.full(2, 50.0), (np.array([-1.0]), np.array([1.0]))
    same = Scores(two, steps, two, np.array([[1.0, -1.0], [-1.0, 1.0]]), np.ones((1, 2)), np.full(2, 1e-9))
    assert alike([Trial(hard, 50.0), Trial(soft, 50.0)], same, 1.0) == [[0], [1]]
    assert alike([Trial(hard, 50.0), Trial(rising, 50.0)], same, 1.0) == [[0, 1]]
