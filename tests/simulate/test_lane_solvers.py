"""Algebraic loops that are solved for all lanes at once: every lane with its own arguments."""

from __future__ import annotations

import numpy as np
import pytest
from sympy import tanh

from bondgraph.data.log import MatchedLog
from bondgraph.declare.domains import TRANSLATION
from bondgraph.declare.graph import BondGraph
from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import likelihood
from bondgraph.generate.module import render
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
