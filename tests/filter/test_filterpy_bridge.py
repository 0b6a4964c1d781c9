"""Without a filterpy that redraws its sigma points there is no comparison."""

from __future__ import annotations

import sys

import filterpy
import numpy as np
import pytest

from bondgraph.errors import FilterError
from bondgraph.filter.filterpy_bridge import filterpy_filter
from tests.filter.logs import pendulum_filter


def test_the_object_has_the_noises_of_the_filter_model() -> None:
    ukf = filterpy_filter(pendulum_filter(alpha=0.4))
    np.testing.assert_allclose(ukf.P, np.diag([0.04, 0.25]))
    np.testing.assert_allclose(ukf.R, [[0.0025]])
    assert ukf.points_fn.alpha == 0.4


def test_older_versions_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(filterpy, "__version__", "1.4.5")
    with pytest.raises(FilterError, match=r"filterpy 1\.4\.5 does not draw the sigma points anew"):
        filterpy_filter(pendulum_filter())


def test_its_absence_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "filterpy", None)
    with pytest.raises(FilterError, match="filterpy is not installed"):
        filterpy_filter(pendulum_filter())
