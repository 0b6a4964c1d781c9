"""Effects that act in part of the data: what a gate multiplies."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph import effects
from bondgraph.build import build
from bondgraph.correct.scores.gates import Gate, gated
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import copy, handle, with_values
from bondgraph.declare.effect import Place, Scale
from bondgraph.simulate.simulation import simulate
from tests.correct.sled import added, pull, sled

SWITCH, MASS = 13.0, 25.0


@pytest.mark.parametrize("when", ["from", "until"])
def test_inertia_that_comes_or_goes_takes_no_speed_along(when: str) -> None:
    log: MatchedLog = pull(sled(), 1)
    graph = copy(sled())
    effect = gated(effects.added_inertia, Gate(when, log.name, SWITCH), [log])(  # type: ignore[arg-type]
        graph, Place(handle(graph, "runner"), Scale(150.0, 4.0))
    )
    assert effect is not None
    (inertia,) = effect.coefficients
    model = build(with_values(graph, {inertia: MASS})).model
    pieces = [build(sled()).model, build(added(effects.added_inertia, "runner", MASS)).model]
    first, last = pieces if when == "from" else pieces[::-1]
    k = int(np.searchsorted(log.time, SWITCH))
    before = simulate(first, log.time[: k + 1], log.u[:, : k + 1], rtol=1e-7)
    after = simulate(last, log.time[k:], log.u[:, k:], x0=before.x[:, -1], rtol=1e-7)
    whole = simulate(model, log.time, log.u, method="rk4", substeps=20)
    size = float(np.ptp(whole.x))
    assert np.abs(whole.x[:, : k - 2] - before.x[:, : k - 2]).max() < 1e-6 * size
    assert np.abs(whole.x[:, k + 2 :] - after.x[:, 2:]).max() < 5e-3 * size
    assert np.abs(after.x - simulate(first, log.time[k:], log.u[:, k:], x0=before.x[:, -1]).x).max() > 0.05 * size
