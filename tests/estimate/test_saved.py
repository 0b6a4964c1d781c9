"""Results go to files and come back the same; files that are wrong are refused, and do nothing."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.errors import OptionError
from bondgraph.estimate.analysis.ranking import rank_parameters
from bondgraph.estimate.analysis.rates import rate_table
from bondgraph.estimate.analysis.screening import global_sensitivity
from bondgraph.estimate.design.discrimination import Rival, discriminate
from bondgraph.estimate.design.information import rank_manoeuvres
from bondgraph.estimate.design.manoeuvres import Manoeuvre
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.joint import pose_joint
from bondgraph.estimate.posterior import sample_posterior
from bondgraph.estimate.priors import MultivariateNormal, Normal
from bondgraph.estimate.result import Estimate
from bondgraph.filter.bands import FilterBands
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.robust import Robust
from bondgraph.filter.smoother import SmootherRun
from bondgraph.simulate.example import pendulum
from bondgraph.simulate.model import Model
from bondgraph.simulate.stored import Kept, store, stored

SWING = bg.FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)
SETTINGS = bg.Settings(method="gradient", starts=2)


def log(name: str = "swing", samples: int = 80) -> bg.MatchedLog:
    time = 0.05 * np.arange(samples)
    y = 0.5 * np.cos(3.1 * time) + 0.05 * np.random.default_rng(1).standard_normal(samples)
    y[7] = np.nan
    return bg.MatchedLog(name, time, np.zeros((1, samples)), y[np.newaxis], {"gravity": 9.8}, ("hail",), ("a note",))


def same(one: object, other: object) -> bool:
    """Whether two trees of records hold the same."""
    if isinstance(one, Model):
        return one == other
    if dataclasses.is_dataclass(one):
        return type(one) is type(other) and all(
            same(getattr(one, own.name), getattr(other, own.name)) for own in dataclasses.fields(one) if own.init
        )
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, dict):
        return isinstance(other, dict) and list(one) == list(other) and all(same(one[k], other[k]) for k in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))  # type: ignore[arg-type]
    return one == other or (one != one and other != other)


def posed() -> dict[str, Any]:
    told = Normal("length", 1.0, 0.2)
    both = MultivariateNormal.of(["length", "damping"], np.array([1.0, 0.1]), np.diag([0.1, 0.1]), ["linear", "linear"])
    robust = dataclasses.replace(SWING, robust=Robust("huber"), measurement_correlation={})
    return {
        "plain": bg.pose(SWING, log(), ["length", "std(deflection)", FreeParameter("x0(rate, swing)", -1.0, 1.0, 0.0)]),
        "ties and priors": bg.pose(SWING, log(), ["length"], ties={"damping": "0.1*length"}, priors=[told]),
        "robust": bg.pose(robust, [log(), log("other", 60)], ["length", "damping"], priors=[both]),
        "planned": bg.pose(dataclasses.replace(SWING, method="auto"), log(), ["length"]),
        "joint": pose_joint([bg.pose(SWING, log(), ["length"]), bg.pose(SWING, log("other"), ["length", "damping"])]),
    }


@pytest.mark.parametrize("name", posed())
def test_an_estimate_comes_back_with_its_problem(name: str, tmp_path: Path) -> None:
    found = bg.estimate(posed()[name], settings=SETTINGS)
    again = Estimate.load(found.save(tmp_path / "fit.npz"))
    assert same(again, found) and again.to_dict() == found.to_dict() and again.summary() == found.summary()
    assert [one.nll for one in again.runs] == [one.nll for one in found.runs]
    point = found.point[:, np.newaxis]
    assert again.problem.nll(point)[0] == found.problem.nll(point)[0]


def test_an_interrupted_estimate_without_a_value_comes_back(tmp_path: Path) -> None:
    found = dataclasses.replace(
        bg.estimate(posed()["plain"], settings=SETTINGS), nll=float("inf"), roughness=float("nan")
    )  # fmt: skip
    again = Estimate.load(found.save(tmp_path / "fit.npz"))
    assert again.nll == float("inf") and np.isnan(again.roughness)


def test_filter_runs_come_back(tmp_path: Path) -> None:
    driven = dataclasses.replace(SWING, noise_nodes=2)
    whole, bands = bg.filter_log(driven, log()), bg.filter_log(driven, log(), keep="bands")
    again = FilterRun.load(whole.save(tmp_path / "run.npz"))
    assert same(again, whole) and again.nll == whole.nll
    smoothed = bg.smooth(whole)
    assert same(bg.smooth(again), smoothed)  # nodes are kept
    assert same(SmootherRun.load(smoothed.save(tmp_path / "smoothed.npz")), smoothed)
    assert same(FilterBands.load(bands.save(tmp_path / "bands.npz")), bands)
    with pytest.raises(OptionError, match=r"bands\.npz: holds a FilterBands, no FilterRun"):
        FilterRun.load(tmp_path / "bands.npz")


def _planned() -> tuple[bg.EstimationProblem, list[Manoeuvre]]:
    still = bg.MatchedLog("any", 0.05 * np.arange(60), np.zeros((1, 60)), np.zeros((1, 60)))
    problem = bg.pose(SWING, still, ["length", "damping"], initial="model")
    return problem, [Manoeuvre(f"from {a}", still.time, still.u, {"angle": a}) for a in (0.1, 1.0)]


RESULTS: dict[str, Callable[[], Kept]] = {
    "posterior": lambda: sample_posterior(bg.estimate(posed()["plain"], settings=SETTINGS), 5, burn=2),
    "sensitivity": lambda: bg.sensitivity(bg.pose(SWING, log(), ["length", "damping"])),
    "ranking": lambda: rank_parameters(bg.pose(SWING, log(), ["length", "damping"])),
    "rates": lambda: rate_table(bg.pose(SWING, log(), ["length"]), [20.0, 5.0]),
    "global": lambda: global_sensitivity(lambda x: x[0], {"a": (0.0, 1.0), "b": (0.0, 1.0)}, samples=16),
    "design": lambda: rank_manoeuvres(*_planned()),
    "discrimination": lambda: discriminate(
        [Rival("one", _planned()[0], np.array([1.0, 0.5])), Rival("other", _planned()[0], np.array([2.0, 0.5]))],
        _planned()[1],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", RESULTS)
def test_what_follows_from_estimates_comes_back(name: str, tmp_path: Path) -> None:
    found = RESULTS[name]()
    again = type(found).load(found.save(tmp_path / "found.npz"))
    assert same(again, found) and again.table() == found.table()  # type: ignore[attr-defined]


def test_a_machine_that_was_built_comes_back_as_its_equations(tmp_path: Path) -> None:
    g = bg.BondGraph("sled")
    force, mass = g.input("force", "N"), g.parameter("mass", 80.0, "kg", "", (20.0, 200.0))
    body = g.one_junction("body", bg.TRANSLATION)
    g.effort_source("push", force, at=body)
    g.inertance("sled", mass, at=body, state="v")
    model = bg.build(g)
    again = stored(Model, store(model, tmp_path / "sled.npz"))
    assert again == model and again.text == model.text


def _write(path: Path, text: str, **arrays: np.ndarray) -> Path:
    np.savez(path, text=np.array(text), **arrays)
    return path


@pytest.mark.parametrize("words", [
    {"record": "os:system", "fields": {}},
    {"record": "bondgraph.files:write_text", "fields": {}},
    {"record": "bondgraph.nowhere:Estimate", "fields": {}},
    {"record": "bondgraph.simulate.model:load", "fields": {"path": "x"}},
    {"record": "bondgraph.data.log:MatchedLog", "fields": {"name": "a", "unheard": 1}},
    {"enum": "bondgraph.data.log:MatchedLog", "is": "OK"},
    {"model": "import os\nos.remove('x')"},
    {"array": "a7"},
])  # fmt: skip
def test_wrong_files_are_refused(words: dict, tmp_path: Path) -> None:
    path = _write(tmp_path / "fit.npz", json.dumps({"format": 1, "value": words}))
    with pytest.raises(OptionError, match=r"fit\.npz: cannot be read"):
        Estimate.load(path)


def test_missing_damaged_and_newer_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="no such file"):
        Estimate.load(tmp_path / "fit.npz")
    (tmp_path / "cut.npz").write_bytes(b"PK\x03\x04 cut off")
    with pytest.raises(OptionError, match="cannot be read"):
        Estimate.load(tmp_path / "cut.npz")
    with pytest.raises(OptionError, match="format 2"):
        Estimate.load(_write(tmp_path / "newer.npz", json.dumps({"format": 2, "value": None})))


def test_what_is_no_record_is_not_written(tmp_path: Path) -> None:
    @dataclasses.dataclass
    class Holder:
        what: object

    with pytest.raises(OptionError, match="a function cannot be saved"):
        store(Holder(same), tmp_path / "holder.npz")
    assert not list(tmp_path.iterdir())
