"""Steps keep the values they had before their arithmetic was printed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bondgraph.compile.lanes.load import load_lanes
from bondgraph.compile.rosenbrock import TABLEAUS
from bondgraph.simulate.inputs import InputSegment
from tests.simulate.points import model_of, points_of
from tests.simulate.test_stiff import advanced

#: States after two steps from three points (``points_of`` with seed 11), by model and method.
VALUES = json.loads((Path(__file__).parent / "values" / "steps.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("method", ["rk4", *sorted(TABLEAUS)])
@pytest.mark.parametrize("name", ["driveline", "orifices", "generated/driveline", "generated/ranger_full"])
def test_steps_give_the_values_of_separate_loops_over_rows(name: str, method: str) -> None:
    model, (_, x, u, theta) = model_of(name), points_of(name, 3, seed=11)
    segment = InputSegment(0.1, 0.1 + 2e-4, u[:, 0], u[:, 0] + 1e-3 * np.abs(u[:, 0]))
    grading = 1.0 if method == "rk4" else 1.5
    found, _ = advanced(load_lanes(model, method != "rk4"), model, method, 2, grading, segment, x, theta)
    expected = np.array(VALUES[f"{name} {method}"]).T
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-14 * np.abs(expected).max())
