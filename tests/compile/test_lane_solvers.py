"""Algebraic loops that are solved for all lanes at once: every lane with its own arguments."""

from __future__ import annotations

import numpy as np
import pytest
from sympy import tanh

from bondgraph.compile.lanes.writer import lane_text
from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import likelihood
from bondgraph.generate.module import render
from bondgraph.simulate.batch import simulate_batch
from bondgraph.simulate.model import Model


def model() -> Model:
    """A mass pushed through a spring on a hardening damper, whose force follows from a nonlinear loop."""
    g = BondGraph("hardening", doc="A mass behind a hardening damper in series with a linear one.")
    push, m = g.input("push", "N"), g.parameter("m", 2.0, "kg", "mass", (1.0, 4.0))
    b, c = g.parameter("b", 3.0, "N s/m"), g.parameter("c", 0.4, "N s^3/m^3")
    edge = g.parameter("edge", 1.0, "m/s")
    body, link, other = (
        g.one_junction("body", TRANSLATION), g.zero_junction("link", TRANSLATION), g.one_junction("other", TRANSLATION),
    )  # fmt: skip
    g.effort_source("drive", push, at=body)
    g.inertance("mass", m, at=body, state="v")
    g.bond(body, link)
    g.bond(link, other)
    g.resistance("soft", b, at=link)
    stiffening = g.signal(
        "stiffening", c * (1 + tanh(body.flow / edge) ** 2), "N s^3/m^3", "differs between sigma points"
    )
    g.resistance("hard", lambda speed: stiffening * speed**3 + b * speed, at=other)
    g.measure_flow("speed", body)
    g.measure_effort("force", link)
    return Model.from_text(render(derive(assign_causality(g))))


@pytest.mark.parametrize("method", ["rk4", "ros3p"])
def test_sigma_points_side_by_side_solve_a_loop_as_they_do_one_by_one(method: str) -> None:
    swing = FilterModel(model(), {"v": 0.4}, {"speed": 0.05, "force": 0.2}, {"v": 0.8}, substeps=4, method=method)
    time = np.arange(60) * 0.05
    y = np.array([np.sin(time), 2.0 * np.sin(time)])
    log = MatchedLog("drive", time, 9.0 * np.cos(3.0 * time)[np.newaxis], y)
    assert "_solve_" in swing.model.text
    side_by_side, one_by_one = (likelihood(swing, [log], compiled=compiled).nll[0] for compiled in (True, False))
    assert side_by_side == pytest.approx(one_by_one, rel=1e-11)


def saturating() -> Model:
    """A mass whose drag solves a saturating equation, from a guess from which plain Newton steps run away."""
    g = BondGraph("saturating", doc="A mass whose drag follows from a saturating law.")
    push, m = g.input("push", "N"), g.parameter("m", 2.0, "kg", "mass", (1.0, 4.0))
    steep, edge = g.parameter("steep", 5.0, "1"), g.parameter("edge", 1.0, "m/s")
    body = g.one_junction("body", TRANSLATION)
    g.effort_source("drive", push, at=body)
    g.inertance("mass", m, at=body, state="v")
    share = g.implicit_signal(
        "share", lambda z: tanh(steep * z) + 0.01 * z - tanh(body.flow / edge) / 2, "1", "share of the drag", guess=1.5
    )
    b = g.parameter("b", 30.0, "N")
    g.resistance("drag", lambda speed: b * share + speed * 0, at=body)
    g.measure_flow("speed", body)
    return Model.from_text(render(derive(assign_causality(g))))


def test_lanes_take_plain_steps_first_and_guarded_ones_where_these_fail() -> None:
    model_ = saturating()
    text = lane_text(model_.program, stiff=True).source
    assert "quick_" in text
    assert "left = 0" in text
    start = np.array([np.linspace(-3.0, 3.0, 16)])
    pushes = np.array([20.0 * np.sin(np.arange(20) * 0.1)])
    ends = [
        simulate_batch(model_, np.arange(20) * 0.1, pushes, x0=start, method=method, substeps=4, compiled=compiled).x
        for method in ("rk4", "ros3p")
        for compiled in (True, False)
    ]
    assert np.isfinite(ends[0]).all()
    assert ends[0] == pytest.approx(ends[1], rel=1e-11, abs=1e-13)
    assert ends[2] == pytest.approx(ends[3], rel=1e-11, abs=1e-13)
