"""Inputs that are likelier held, or straight, between samples than an estimate's model declares."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import bondgraph as bg
from bondgraph.cli import main
from bondgraph.data.log import MatchedLog

_MASS, _DRAG, _NOISE = 20.0, 8.0, 0.002
_QUICK = bg.Settings(method="gradient", starts=1)


def _cart(held: bool = False) -> bg.BondGraph:
    g = bg.BondGraph("cart")
    force = g.input("force", "N", hold=held)
    body = g.one_junction("body", bg.TRANSLATION)
    g.effort_source("motor", force, at=body)
    g.inertance("mass", g.parameter("m", 25.0, "kg", "", (5.0, 100.0)), at=body, state="v")
    g.resistance("drag", g.parameter("d", 6.0, "N s/m", "", (0.5, 50.0)), at=body)
    g.measure_flow("speed", body)
    return g


def _log(held: bool, samples: int) -> MatchedLog:
    """A cart behind a force that is held, or straight, between samples 0.1 s apart: the exact discrete system."""
    chance = np.random.default_rng(3)
    force = np.repeat(chance.uniform(-30.0, 30.0, 400 // samples), samples)
    system = tuple(np.array([[one]]) for one in (-_DRAG / _MASS, 1.0 / _MASS, 1.0, 0.0))
    a, b, c, d, _ = cont2discrete(system, 0.1, "zoh" if held else "foh")
    speed = lfilter([float(d[0, 0]), float((c @ b - a * d)[0, 0])], [1.0, -float(a[0, 0])], force)
    speed += _NOISE * chance.standard_normal(speed.size)
    return MatchedLog("run", 0.1 * np.arange(speed.size), force[np.newaxis], speed[np.newaxis])


@pytest.mark.parametrize(
    ("declared", "held", "samples"),
    [(False, True, 8), (False, True, 1), (False, False, 8), (False, False, 1), (True, False, 1), (True, True, 1)],
)
def test_the_other_way_is_told_where_it_is_likelier(declared: bool, held: bool, samples: int) -> None:
    found = bg.estimate(bg.build(_cart(declared)), _log(held, samples), settings=_QUICK)
    other = found.inputs_otherwise
    assert (other is not None) == (declared != held)
    if other is not None:
        assert other.names == ("force",) and other.way == ("hold" if held else "linear")
        assert other.in_pieces == (samples == 8)
        right = bg.estimate(bg.build(_cart(held)), _log(held, samples), settings=_QUICK)
        assert other.nats == pytest.approx(found.nll - right.nll, abs=1.0) and other.nats > 100.0
        assert other.sentence in found.summary()
        assert found.to_dict()["inputs_otherwise"] == {"inputs": ["force"], "way": other.way, "nats": other.nats}


def test_a_force_that_a_filter_has_passed_is_told_as_band_limited() -> None:
    time, chance = 0.1 * np.arange(600), np.random.default_rng(1)
    force, speed = np.zeros(600), _NOISE * chance.standard_normal(600)
    for hertz in (0.7, 1.9, 3.1):
        wave = 9.0 * np.exp(2j * np.pi * hertz * time)
        force += wave.real
        speed += (wave / (_DRAG + 2j * np.pi * hertz * _MASS)).real
    log = MatchedLog("run", time, force[np.newaxis], speed[np.newaxis])
    found = bg.estimate(bg.build(_cart()), log, settings=_QUICK)
    other = found.inputs_otherwise
    assert other is not None and (other.names, other.way) == (("force",), "band limited")
    assert "declare it with between='band limited' (--inputs-between force=band)" in found.summary()


def test_the_command_says_what_to_declare_and_not_where_it_was_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    bg.write_graph(_cart(), "cart.json")
    log = _log(True, 8)
    rows = zip(log.time, log.u[0], log.y[0], strict=True)
    table = "\n".join(["time [s],force [N],speed [m/s]", *(f"{t:.1f},{u},{y}" for t, u, y in rows)])
    Path("run.csv").write_text(table, encoding="utf-8")
    command = ["estimate", "cart.json", "--data", "run.csv", "--method", "gradient", "--starts", "1", "--out", "out"]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "nats likelier held than straight lines, and it is constant in pieces" in said
    assert "--inputs-between force=held" in said
    assert "likelier held" in Path("out/report.html").read_text(encoding="utf-8")
    assert main([*command, "--inputs-between", "linear"]) == 0
    assert "likelier held" not in capsys.readouterr().out
