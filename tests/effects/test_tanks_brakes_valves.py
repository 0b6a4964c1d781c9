"""Tanks with a step, brakes beyond their critical speed, valves that open: found on machines by other code."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph as bg
from bondgraph.correct.loop import ClosedLoop
from bondgraph.correct.result import intervals
from bondgraph.data.log import FloatArray


def surge_shaft() -> bg.BondGraph:
    """A tunnel with a surge shaft, whose section is declared as one."""
    g = bg.BondGraph("surge_shaft")
    tunnel, shaft = g.one_junction("tunnel", bg.HYDRAULIC), g.zero_junction("shaft", bg.HYDRAULIC)
    g.inertance("water", g.parameter("I", 3e5, "kg/m^4", "", (1e5, 9e5)), at=tunnel, state="Q")
    g.resistance("wall", g.parameter("R", 900.0, "Pa s/m^3", "", (200.0, 3e3)), at=tunnel)
    g.bond(tunnel, shaft)
    capacity = g.parameter("C", 2.4e-3, "m^3/Pa", "", (1e-3, 6e-3))
    g.compliance("surge", displacement=capacity, at=shaft, state="V")
    g.flow_source("turbine", -g.input("draw", "m^3/s"), at=shaft)
    g.measure_effort("pressure", shaft)
    g.measure_flow("stream", tunnel)
    return g


def roller() -> bg.BondGraph:
    """A roller with an eddy-current brake, declared in proportion to its speed."""
    g = bg.BondGraph("roller")
    current = g.input("current", "A")
    drum = g.one_junction("drum", bg.ROTATION)
    c = g.parameter("c", 0.045, "N m s/A^2", "", (0.01, 0.1))
    g.effort_source("motor", g.input("torque", "N m"), at=drum)
    g.inertance("inertia", g.parameter("J", 0.7, "kg m^2", "", (0.3, 2.0)), at=drum, state="omega")
    g.resistance("bearing", g.parameter("b", 0.05, "N m s", "", (0.01, 0.2)), at=drum)
    g.resistance("brake", lambda w: c * current**2 * w, at=drum)
    g.measure_flow("speed", drum)
    return g


def air_line() -> bg.BondGraph:
    """A pump's line and its receiver, with a pipe between them."""
    g = bg.BondGraph("air_line")
    line, vessel = g.zero_junction("line", bg.HYDRAULIC), g.zero_junction("vessel", bg.HYDRAULIC)
    through = g.one_junction("through", bg.HYDRAULIC)
    pipe, use = (
        g.parameter("G", 8e-9, "m^3/s/Pa", "", (2e-9, 3e-8)),
        g.parameter("Gu", 4e-9, "m^3/s/Pa", "", (1e-9, 2e-8)),
    )
    g.flow_source("pump", g.input("delivery", "m^3/s"), at=line)
    g.compliance("hose", displacement=g.parameter("C1", 1.5e-8, "m^3/Pa", "", (5e-9, 5e-8)), at=line)
    g.bond(line, through)
    g.bond(through, vessel)
    g.resistance("pipe", flow=lambda p: pipe * p, at=through)
    g.compliance("air", displacement=g.parameter("C2", 2e-7, "m^3/Pa", "", (5e-8, 6e-7)), at=vessel)
    g.resistance("users", flow=lambda p: use * p, at=vessel)
    g.measure_effort("before", line)
    g.measure_effort("behind", vessel)
    return g


def levels(chance: np.random.Generator, lower: float, upper: float, each: int, samples: int) -> FloatArray:
    """Steps between two levels, rounded over three samples."""
    held = np.repeat(chance.uniform(lower, upper, samples // each + 1), each)[:samples]
    return np.convolve(np.pad(held, 1, "edge"), np.ones(3) / 3, "valid")


def logged(
    name: str, time: FloatArray, u: FloatArray, rate: Callable[[FloatArray, FloatArray], list[float]], size: int,
    shown: Callable[[FloatArray], FloatArray], noise: tuple[float, ...], chance: np.random.Generator,
) -> bg.MatchedLog:  # fmt: skip
    """A run by scipy, with noise on what is shown."""

    def moving(t: float, x: FloatArray) -> list[float]:
        return rate(x, np.array([np.interp(t, time, one) for one in u]))

    step = time[1] - time[0]
    run = solve_ivp(moving, (0.0, time[-1]), np.zeros(size), t_eval=time, max_step=step, rtol=1e-8, atol=1e-12)
    y = shown(run.y)
    return bg.MatchedLog(name, time, u, y + np.array(noise)[:, np.newaxis] * chance.standard_normal(y.shape))


def surged(seed: int) -> bg.MatchedLog:
    """Beyond 12 kPa the shaft is wider by two fifths."""
    chance, time = np.random.default_rng(seed), 5.0 * np.arange(300)
    draw = levels(chance, 0.0, 14.0, 30, time.size)

    def pressure(volume: FloatArray) -> FloatArray:
        low = volume / 2e-3
        return np.where(low < 12e3, low, 12e3 + (volume - 24.0) / 2.8e-3)

    def rate(x: FloatArray, u: FloatArray) -> list[float]:
        return [float((-pressure(x[1:])[0] - 700.0 * x[0]) / 2.4e5), float(x[0] - u[0])]

    def shown(x: FloatArray) -> FloatArray:
        return np.array([pressure(x[1]), x[0]])

    return logged(f"run{seed}", time, draw[np.newaxis], rate, 2, shown, (500.0, 0.1), chance)


def braked(seed: int) -> bg.MatchedLog:
    """The brake is at its largest at 260 rad/s."""
    chance, time = np.random.default_rng(seed), 0.2 * np.arange(400)
    u = np.array([levels(chance, 0.5, 4.0, 40, time.size), levels(chance, 5.0, 25.0, 25, time.size)])

    def rate(x: FloatArray, u: FloatArray) -> list[float]:
        brake = 0.036 * u[0] ** 2 * x[0] / (1.0 + (x[0] / 260.0) ** 2)
        return [float((u[1] - 0.06 * x[0] - brake) / 0.8)]

    return logged(f"run{seed}", time, u, rate, 1, lambda x: x, (1.0,), chance)


def pumped(seed: int) -> bg.MatchedLog:
    """A check valve lets nothing pass below 9 kPa, and opens over some hundred pascals."""
    chance, time = np.random.default_rng(seed), 0.5 * np.arange(240)
    delivery = levels(chance, 0.0, 2.5e-4, 24, time.size)

    def rate(x: FloatArray, u: FloatArray) -> list[float]:
        drop = x[0] - x[1]
        stream = 7e-9 * 0.5e3 * np.logaddexp(0.0, (drop - 9e3) / 0.5e3)
        return [float((u[0] - stream) / 1.3e-8), float((stream - 3e-9 * x[1]) / 1.7e-7)]

    return logged(f"run{seed}", time, delivery[np.newaxis], rate, 2, lambda x: x, (1.2e3, 1.2e3), chance)


def closed(graph: bg.BondGraph, run: Callable[[int], bg.MatchedLog]) -> ClosedLoop:
    """The loop on two runs, with a third held out."""
    return bg.close_loop(graph, [run(1), run(2)], [run(3)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("graph", "run", "label", "value"),
    [
        (surge_shaft, surged, "stepped_tank at shaft", 1 / 1.4 - 1.0),
        (roller, braked, "critical_speed_of_brake at drum", None),
        (air_line, pumped, "opening_pressure at through", 9e3),
    ],
)
def test_it_is_found(
    graph: Callable[[], bg.BondGraph], run: Callable[[int], bg.MatchedLog], label: str, value: float | None
) -> None:
    """Each was something else: two leaks and a tank that narrows, a ramp of a product, a function of a pressure."""
    found = closed(graph(), run)
    assert [one.trial.candidate.label for one in found.added] == [label]
    (name,) = found.added[0].trial.candidate.effect.coefficients
    lower, upper = intervals(found.corrected)[name]
    if value is None:  # the critical speed is the usual one over the root of the coefficient
        model = found.corrected_built.model
        usual = float(model.theta()[model.index("parameter", f"r_{name[2:]}")])
        lower, upper, value = usual / upper**0.5, usual / lower**0.5, 260.0
    middle, reach = 0.5 * (lower + upper), 0.5 * (upper - lower)
    assert abs(middle - value) < 2.0 * reach < 0.4 * abs(value)
