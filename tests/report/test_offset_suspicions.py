"""Columns in degrees Celsius under kelvins are pointed out, and what is cold, hot or declared badly is not."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import bondgraph as bg
from bondgraph.build import BuiltModel
from bondgraph.cli import main
from bondgraph.data.log import Log, LogChannel, MatchedLog
from bondgraph.estimate.setup import filter_setup
from bondgraph.report.inspection import inspect_log
from bondgraph.report.suspicions import unit_suspicions

ZERO = 273.15


@functools.cache
def kettle(surrounded: bool = True, start: float = 293.15) -> BuiltModel:
    """Water over a heater, in a room whose temperature the logs hold or in nothing."""
    g = bg.BondGraph("kettle")
    capacity = g.parameter("C", 4000.0, "J/K", "", (1e3, 1e4))
    water = g.zero_junction("water", bg.THERMAL)
    g.flow_source("heater", g.input("power", "W", hold=True), at=water)
    g.compliance("heat", lambda q: q / capacity, at=water, state="q", initial=capacity * start)
    if surrounded:
        loss = g.parameter("G", 5.0, "W/K", "", (0.5, 50.0))
        wall, air = g.one_junction("wall", bg.THERMAL), g.zero_junction("air", bg.THERMAL)
        g.bond(water, wall)
        g.resistance("loss", lambda flow: flow / loss, at=wall)
        g.bond(wall, air)
        g.effort_source("ambient", g.input("room", "K"), at=air)
    g.measure_effort("T", water)
    return bg.build(g)


@functools.cache
def driven(seed: int, surrounded: bool = True, room: float = 293.0, begins: float = 295.0) -> MatchedLog:
    """A log in kelvins of a kettle whose parameters are 20 % off their declared values."""
    model, chance = kettle(surrounded).model, np.random.default_rng(seed)
    samples = 400
    theta = {one.name: one.value * float(np.exp(0.2 * chance.standard_normal())) for one in model.parameters}
    signals = {
        "power": np.repeat(chance.uniform(0.0, 600.0, 10), samples // 10),
        "room": room + np.cumsum(0.02 * chance.standard_normal(samples)),
    }
    u = np.array([signals[name] for name in model.names("input")])
    time = 2.0 * np.arange(samples)
    y = bg.simulate(model, time, u, theta, {"q": theta["C"] * begins}).y
    return MatchedLog("run", time, u, y + 0.3 * chance.standard_normal(samples))


def suspected(log: MatchedLog, surrounded: bool = True, start: float = 293.15) -> list[str]:
    built = kettle(surrounded, start)
    return unit_suspicions(filter_setup(built.model, built.driven, [log]).filter_model, log)


def in_celsius(log: MatchedLog, *names: str) -> MatchedLog:
    """The log with some columns in degC, under the header of kelvins."""
    inputs = kettle().model.names("input")
    rows = [inputs.index(name) for name in names if name != "T"]
    u = log.u.copy()
    u[rows] -= ZERO
    return replace(log, u=u, y=log.y - ZERO if "T" in names else log.y)


@pytest.mark.parametrize("names", [("T",), ("room",), ("room", "T")])
def test_celsius_is_pointed_out_with_column_values_and_header(names: tuple[str, ...]) -> None:
    for seed in range(5):
        (said,) = suspected(in_celsius(driven(seed), *names))
        headers = " and ".join(f"'{name} [degC]'" for name in names)
        assert "K as read, look like numbers in degC" in said
        assert said.endswith(f"as {headers}")


def test_fahrenheit_is_told_from_celsius() -> None:
    log = driven(1)
    (said,) = suspected(replace(log, y=1.8 * (log.y - ZERO) + 32.0))
    assert "'T [degF]'" in said


def test_a_body_that_nothing_surrounds_is_judged_by_its_declared_start() -> None:
    """Its equations follow any reading: only where it is declared to begin tells."""
    log = driven(2, surrounded=False)
    assert suspected(log, surrounded=False) == []
    (said,) = suspected(replace(log, y=log.y - ZERO), surrounded=False)
    assert "'T [degC]'" in said


def test_a_part_of_a_log_shorter_than_the_machine_is_slow_is_enough() -> None:
    log = in_celsius(driven(3), "T")
    (said,) = suspected(replace(log, time=log.time[:60], u=log.u[:, :60], y=log.y[:, :60]))
    assert "'T [degC]'" in said


@pytest.mark.slow
def test_kelvins_are_not_suspected_whatever_is_declared() -> None:
    said = [suspected(driven(seed, begins=float(273.0 + 8.0 * seed))) for seed in range(16)]
    said += [suspected(driven(seed), start=673.15) for seed in range(4)]  # declared to begin hot, and logged cold
    said += [suspected(driven(seed, room=20.0, begins=20.0), start=25.0) for seed in range(4)]  # a cold machine
    assert [one for each in said for one in each if "deg" in one] == []


def test_a_log_alone_tells_where_another_channel_shows_the_same() -> None:
    rng, time = np.random.default_rng(0), 0.5 * np.arange(100.0)
    room = 20.0 + np.sin(0.1 * time)
    wall = LogChannel("wall", "degC", room)

    def told(values: npt.NDArray[np.float64], unit: str) -> tuple[str, ...]:
        return inspect_log(Log("run", time, {"wall": wall, "air": LogChannel("air", unit, values)})).suspicions

    air = room + 0.2 * rng.standard_normal(100)
    (said,) = told(air, "K")
    assert said.startswith("'air' (") and "K as read" in said and said.endswith("'air [degC]'")
    assert told(air, "degC") == () and told(room + 12.0, "K") == () and told(air + 273.15, "K") == ()


def test_compare_and_estimate_say_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    bg.write_graph(kettle().graph, "kettle.json")
    log, names = in_celsius(driven(4), "T"), kettle().model.names("input")
    header = ",".join(["time [s]", *(f"{name} [{'W' if name == 'power' else 'K'}]" for name in names), "T [K]"])
    rows = [",".join(map(str, row)) for row in zip(log.time, *log.u, log.y[0], strict=True)]
    Path("run.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    assert main(["compare", "kettle.json", "--data", "run.csv", "--out", "seen"]) == 0
    assert "'T [degC]'" in capsys.readouterr().out
    quick = ["--method", "gradient", "--starts", "1", "--out", "fit"]
    main(["estimate", "kettle.json", "--data", "run.csv", *quick])
    assert "'T [degC]'" in capsys.readouterr().out
