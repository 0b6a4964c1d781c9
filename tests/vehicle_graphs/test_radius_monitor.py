"""The monitor of the tyres: parameters that change nothing until they do, and what it finds on a few drives."""

from __future__ import annotations

import numpy as np
import pytest

from bondgraph.build import build
from vehicle_graphs.radius_monitor import CHANGES, monitor, row, watch
from vehicle_graphs.ranger import full, monitored


def test_radii_of_the_axles_are_those_of_the_vehicle_times_their_gains() -> None:
    model = build(full()).model
    x = model.x0(forward_velocity=8.0, rear_axle_speed=26.0, front_axle_speed=25.6, engine_speed=300.0)
    both = model.theta(r_d=0.3)
    gains = model.theta(radius_gain_f=0.3 / 0.315, radius_gain_r=0.3 / 0.315)
    np.testing.assert_allclose(
        model.rhs(0.0, x, model.u0(), both), model.rhs(0.0, x, model.u0(), gains), rtol=1e-12, atol=1e-12
    )
    front = model.theta(radius_gain_f=0.94)
    moved = model.rhs(0.0, x, model.u0(), front) - model.rhs(0.0, x, model.u0(), model.theta())
    names = model.names("state")
    assert moved[names.index("front_axle_speed")] > 0.0  # a smaller wheel is behind the road, which turns it faster
    assert moved[names.index("rear_axle_speed")] == 0.0


def test_the_front_axle_is_read_beside_what_the_whole_vehicle_reads() -> None:
    assert [one.name for one in monitored().outputs] == [*(one.name for one in full().outputs), "front_axle_speed"]


@pytest.mark.slow
def test_a_falling_radius_is_named_and_nothing_else() -> None:
    model = monitor()
    for change in ("", *CHANGES):
        found = [watch(model, seed, 8.0, change) for seed in (1, 2)]
        name, drives, named, false, *_ = row(change, found)
        assert (name, drives, false) == (change or "nothing", "2", "0")
        assert named == ("2" if change else "0")
        assert all(one.delay < 0.5 for one in found if change)
