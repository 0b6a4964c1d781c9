"""What the Ranger does in manoeuvres its driver would know; defaults, level gravel, high gear if not said otherwise.

The numbers are those of the description of the vehicle; they were computed by another program, so they test the model
and not only that it stays the same. Speeds in rpm and km/h where a driver reads them so.
"""

from __future__ import annotations

import functools
import math

import numpy as np
import numpy.typing as npt
import pytest

from bondgraph.derive.causality import assign_causality
from bondgraph.derive.derivation import derive
from bondgraph.generate.module import render
from bondgraph.simulate.model import Model
from bondgraph.simulate.scenario import Scenario
from bondgraph.simulate.simulation import simulate
from bondgraph.simulate.trajectory import Trajectory
from vehicle_graphs.ranger import SCENARIOS, full

FloatArray = npt.NDArray[np.float64]

KMH = 1 / 3.6
RPM = math.pi / 30
WEIGHT = 1200 * 9.81


@functools.cache
def vehicle() -> Model:
    """The vehicle with its named signals (clamp forces, slip, ratio) as outputs."""
    return Model.from_text(render(derive(assign_causality(full()), signals=True)))


class Run:
    """A manoeuvre: quantities over time by name, and when something first happens."""

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory, self.time = trajectory, trajectory.time
        self.speed, self.rpm = self["forward_velocity"], self["engine_speed"] / RPM
        self.acceleration: FloatArray = np.gradient(self.speed, self.time)

    def __getitem__(self, name: str) -> FloatArray:
        state = name in self.trajectory.model.names("state")
        return self.trajectory.state(name) if state else self.trajectory.output(name)

    def first(self, happens: npt.NDArray[np.bool_], after: float = 0.0) -> int:
        """Index of the first sample after some time at which something happens."""
        found = np.flatnonzero(happens & (self.time >= after))
        assert found.size, "it does not happen"
        return int(found[0])

    def at(self, time: float) -> int:
        """Index of the sample at a time."""
        return int(np.argmin(np.abs(self.time - time)))


@functools.cache
def manoeuvre(name: str, step: float = 0.01) -> Run:
    return Run(drive(SCENARIOS[name], step))


def drive(scenario: Scenario, step: float, **options: object) -> Trajectory:
    model = vehicle()
    run = simulate(
        model, scenario.times(step), scenario.signal(model), x0=scenario.start(model), compiled=True,
        **({"rtol": 1e-8} | options),  # type: ignore[arg-type]
    )  # fmt: skip
    return run.raise_if_failed()


# ---------------------------------------------------------------------- idle and pulling away


def test_idles_at_1200_rpm_with_the_belt_released() -> None:
    run = manoeuvre("idle")
    assert run.rpm[-1] == pytest.approx(1200, abs=2)
    assert np.all(run["F_p"] == 0) and np.all(run["F_b"] == 0)
    assert np.all(np.abs(run.speed) < 1e-9)


def test_slow_throttle_clamps_creeps_locks_and_shifts_up_in_turn() -> None:
    run = manoeuvre("throttle_ramp")
    clamps = run.first(run["F_p"] > 0)
    pulls = run.first(0.95 * 10 * run["F_b"] * run["r_s"] / 0.315 > 0.035 * WEIGHT)
    creeps = run.first(run.speed > 0.1)
    locks = run.first(run["slip"] < 0.3)
    shifts = run.first(run["ratio"] < 0.99 * run["ratio"][0])
    assert clamps < pulls < creeps < locks < shifts
    assert run.rpm[[clamps, pulls, creeps, locks, shifts]] == pytest.approx([1510, 1950, 2000, 2870, 3300], abs=40)
    assert run.speed[locks] == pytest.approx(2.6, abs=0.1)


def test_faster_throttle_locks_at_higher_engine_speed() -> None:
    run = manoeuvre("fast_throttle_ramp")
    assert run.rpm[run.first(run["slip"] < 0.3)] == pytest.approx(3200, abs=30)


# ---------------------------------------------------------------------- full throttle

START = 0.5


def test_full_throttle_locks_the_belt_after_one_second() -> None:
    run = manoeuvre("full_throttle_launch")
    locks = run.first(run["slip"] < 0.3, after=START + 0.2)
    assert run.time[locks] - START == pytest.approx(1.0, abs=0.05)
    assert run.rpm[locks] == pytest.approx(5380, abs=20)
    assert run.speed[locks] == pytest.approx(2.6, abs=0.1)


def test_full_throttle_spins_the_rear_wheels_and_squats() -> None:
    run = manoeuvre("full_throttle_launch")
    spin = run["v_slip_r"]
    assert spin.max() == pytest.approx(2.6, abs=0.1)
    over = run.first(spin < 0.3 * spin.max(), after=float(run.time[np.argmax(spin)]))
    assert run.time[over] - START == pytest.approx(1.7, abs=0.1)
    assert run.rpm[run.time < 5].max() == pytest.approx(5580, abs=20)
    assert run.acceleration.max() == pytest.approx(4.7, abs=0.1)
    assert np.degrees(run["pitch"].max()) == pytest.approx(1.85, abs=0.02)


def test_full_throttle_holds_the_engine_speed_while_the_ratio_runs_through() -> None:
    run = manoeuvre("full_throttle_launch")
    shifted = run.first(run["sheave_displacement"] >= 0.0296)
    assert run.time[shifted] - START == pytest.approx(16, abs=0.3)
    assert run.speed[shifted] / KMH == pytest.approx(88, abs=1)
    assert run["ratio"][[0, shifted]] == pytest.approx([3.47, 0.763], abs=0.005)
    while_shifting = run.rpm[(run.time > START + 2) & (run.time < run.time[shifted])]
    assert [while_shifting.min(), while_shifting.max()] == pytest.approx([5370, 5790], abs=15)


def test_full_throttle_times_and_top_speed() -> None:
    run = manoeuvre("full_throttle_launch")
    for speed, time in ((50, 4.9), (80, 12.5)):
        assert run.time[run.first(run.speed > speed * KMH)] - START == pytest.approx(time, abs=0.1)
    assert run.speed[-1] / KMH == pytest.approx(105, abs=1)
    assert run.rpm[-1] == pytest.approx(6840, abs=20)


# ---------------------------------------------------------------------- part throttle, lift-off, coasting


@pytest.mark.parametrize(("throttle", "speed"), [(0.1, 35.7), (0.2, 65.5), (0.3, 81.7)])
def test_steady_throttle_settles_at_a_speed(throttle: float, speed: float) -> None:
    run = Run(drive(Scenario("steady", 150.0, {"throttle": [(0.0, 0.0), (2.0, throttle)]}), 0.5))
    assert run.speed[-1] / KMH == pytest.approx(speed, rel=0.01)


def test_lift_off_brakes_with_the_engine_until_the_belt_is_released() -> None:
    run = manoeuvre("engine_braking")
    slowing = run.first(run.speed < 21, after=14.2)
    assert run.acceleration[slowing] == pytest.approx(-0.9, abs=0.05)
    released = run.first(run["F_p"] == 0, after=15.0)
    assert run.speed[released] == pytest.approx(2, abs=0.4)


def test_neutral_coast_down_decelerates_ever_less() -> None:
    run = manoeuvre("neutral_coast_down")
    assert run.acceleration[run.at(0.3)] == pytest.approx(-0.49, abs=0.02)
    for speed, deceleration in ((3.0, -0.34), (1.0, -0.33)):
        assert run.acceleration[run.first(run.speed < speed)] == pytest.approx(deceleration, abs=0.01)
    assert [run.speed[run.at(time)] for time in (5, 15, 30)] == pytest.approx([12.7, 8.6, 3.2], abs=0.05)
    assert abs(run.speed[-1]) < 0.05


# ---------------------------------------------------------------------- brake, hill, reverse


def test_half_brake_dives() -> None:
    run = manoeuvre("half_brake")
    braking = (run.time > 1.2) & (run.speed > 1.5)
    assert run.acceleration[braking].min() == pytest.approx(-4.3, abs=0.05)
    assert run.acceleration[braking].max() == pytest.approx(-4.2, abs=0.05)
    settled = run.first(run.speed < 3.0)
    assert np.degrees(run["pitch"][settled]) == pytest.approx(-1.55, abs=0.02)


def test_climbs_ten_degrees_at_full_throttle() -> None:
    run = manoeuvre("hill_start")
    later = run.at(20.0)
    assert run.speed[[later, -1]] == pytest.approx([14.0, 14.4], abs=0.1)
    assert run.rpm[[later, -1]] == pytest.approx([5440, 5450], abs=10)
    assert run["ratio"][[later, -1]] == pytest.approx([1.24, 1.21], abs=0.01)


def test_drives_backwards_in_reverse() -> None:
    run = manoeuvre("reverse")
    assert run.speed[-1] < -3
    assert np.degrees(run["pitch"][run.first(run.speed < -0.5)]) < 0  # the nose goes down


# ---------------------------------------------------------------------- the price of a fixed step


@pytest.mark.parametrize(("step", "wrong"), [(0.5e-3, False), (1e-3, True), (2e-3, True)])
def test_fixed_steps_of_a_millisecond_err_quietly(step: float, wrong: bool) -> None:
    scenario = SCENARIOS["full_throttle_launch"]
    exact = manoeuvre("full_throttle_launch", 0.02)["engine_speed"]
    fixed = drive(scenario, 0.02, method="rk4", substeps=round(0.02 / step)).state("engine_speed")
    assert (float(np.max(np.abs(fixed / exact - 1))) > 0.015) == wrong
