"""``bondgraph profile``: tables, sentences on open and bent profiles, files, and going on after a stop."""

from __future__ import annotations

import json
import math
import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bondgraph.cli import main, profiles, runs
from bondgraph.estimate import likelihood_profile
from bondgraph.estimate.estimation import estimate
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.profile import ProfileCurve, profile_curve
from bondgraph.estimate.result import Estimate

QUICK = ["--process-noise", "none", "--method", "gradient", "--starts", "1", "--certify", "none"]


def _asked(graph: Path, log: Path, out: Path, *more: str) -> list[str]:
    return ["profile", str(graph), "--data", str(log), *QUICK, "--out", str(out), *more]


def _result(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return content


@pytest.mark.rendered
def test_profiles_are_printed_and_written(
    motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "found"
    assert main(_asked(motor_file, run_file, out, "--free", "b,R_a", "--of", "R_a")) == 0
    said = capsys.readouterr().out
    assert "profile from" in said and "covariance from" in said and "Profile and curvature agree: R_a." in said
    ((name, found),) = _result(out)["parameters"].items()
    assert name == "R_a" and found["unit"] == "ohm" and found["open"] == [False, False]
    np.testing.assert_allclose(found["interval"], found["curvature"], rtol=1e-2)
    assert found["interval"][0] < found["value"] < found["interval"][1]
    assert (out / "profile.png").stat().st_size > 5_000
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Profile and curvature agree" in page and "std(omega)" in page and "<img" in page


def test_what_acts_only_in_a_sum_is_open_on_one_side(
    motor: dict[str, Any], run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of two bearings only the sum is told: one ends where the other is at its bound, and nowhere on the other side."""
    path = tmp_path / "motor.json"
    alone, both = tmp_path / "alone", tmp_path / "both"
    path.write_text(json.dumps(motor), encoding="utf-8")
    assert main(_asked(path, run_file, alone, "--free", "b", "--of", "b")) == 0
    motor["graph"]["parameters"].append({"name": "b_2", "value": 0.02, "unit": "N m s", "bounds": [0.01, 1.0]})
    motor["nodes"].append({"id": "seal", "kind": "R", "effort": "b_2*flow"})
    motor["bonds"].append({"source": "shaft", "target": "seal"})
    path.write_text(json.dumps(motor), encoding="utf-8")
    capsys.readouterr()
    assert main(_asked(path, run_file, both, "--free", "b,b_2", "--of", "b")) == 0
    said = capsys.readouterr().out
    assert "b is open below: the data forbid no value down to its bound, 0.01 N m s." in said
    assert "the curvature does not tell it" in said and "--free NAME=LOWER:UPPER" in said
    assert "nan" not in (both / "report.html").read_text(encoding="utf-8").partition("<h2>The estimate")[2][:4000]
    sum_of_both, found = (_result(out)["parameters"]["b"] for out in (alone, both))
    assert found["open"] == [True, False] and found["std"] is None and found["curvature"] == [None, None]
    assert found["interval"][0] == pytest.approx(0.01)
    assert found["interval"][1] == pytest.approx(sum_of_both["interval"][1] - 0.01, rel=1e-4)


def test_profiles_that_are_finished_are_not_computed_again(
    motor_file: Path,
    run_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A stop during the second profile leaves the first; --resume computes the second, with the bits of one run."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    whole, out = tmp_path / "whole", tmp_path / "stopped"
    computed: list[int] = []

    def counted(*given: Any) -> ProfileCurve:
        computed.append(given[2])
        return profile_curve(*given)

    def stopping(*given: Any) -> ProfileCurve:
        if computed:
            os.kill(os.getpid(), signal.SIGINT)
        return counted(*given)

    free = ["--free", "b,R_a", "--of", "b", "R_a"]
    try:
        assert main(_asked(motor_file, run_file, whole, *free)) == 0
        monkeypatch.setattr(likelihood_profile, "profile_curve", stopping)
        assert main(_asked(motor_file, run_file, out, *free)) == 130
    finally:
        signal.signal(signal.SIGINT, before)
    assert "go on with --resume" in capsys.readouterr().err and not (out / "result.json").exists()
    assert {path.name for path in out.iterdir()} == {"checkpoint.npz", "profiles.json"}
    computed.clear()
    monkeypatch.setattr(likelihood_profile, "profile_curve", counted)
    assert main(_asked(motor_file, run_file, out, *free, "--resume")) == 0
    assert computed == [1]
    assert _result(out) == _result(whole)
    assert main(_asked(motor_file, run_file, out, *free, "--resume", "--level", "0.9")) == 0
    assert computed == [1, 0, 1]  # another level has profiles of its own
    narrow, wide = _result(out)["parameters"]["b"]["interval"], _result(whole)["parameters"]["b"]["interval"]
    assert wide[0] < narrow[0] < narrow[1] < wide[1]


def test_answers_in_json(motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(_asked(motor_file, run_file, tmp_path / "out", "--free", "b=0.12:0.2", "--of", "b", "--json")) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["parameters"]["b"]["open"][0] and found["logs"] == ["run"]
    assert "b is open below: it rests on its bound, 0.12 N m s" in found["said"][0]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--of", "R"], "--of R: it is not free"),
        (["--of", "std(omga)"], "did you mean 'std(omega)'?"),
        (["--level", "1.5"], "must lie between 0 and 1"),
        (["--free", "bb"], "did you mean 'b'?"),
    ],
)
def test_impossible_profiles_are_refused(
    options: list[str], said: str, motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "no"
    try:
        assert main(_asked(motor_file, run_file, out, "--free", "b", *options)) == 2
    except SystemExit as left:  # of the parser
        assert left.code == 2
    assert said in capsys.readouterr().err and not (out / "result.json").exists()


def test_the_search_of_a_finished_estimate_is_taken(
    motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fit, free = tmp_path / "fit", ["--free", "b,R_a"]
    assert main(["estimate", *_asked(motor_file, run_file, fit, *free)[1:]]) == 0
    before = {path.name: path.read_bytes() for path in fit.iterdir()}
    asked = _asked(motor_file, run_file, tmp_path / "profiles", *free, "--of", "b", "--estimate", str(fit))
    assert main(asked) == 0
    assert {path.name: path.read_bytes() for path in fit.iterdir()} == before
    found, known = (_result(folder) for folder in (tmp_path / "profiles", fit))
    assert found["parameters"]["b"]["value"] == known["parameters"]["b"]["value"] and found["nll"] == known["nll"]
    assert not (tmp_path / "profiles" / "checkpoint.npz").exists()
    assert main([*asked, "--seed", "3"]) == 2 and "belongs to another estimation" in capsys.readouterr().err
    assert main([*asked[:-1], str(tmp_path / "none")]) == 2
    assert "holds no checkpoint.npz" in capsys.readouterr().err


@pytest.mark.parametrize("more", [["profile"], ["estimate", "--profile"]])
def test_an_estimate_without_a_likelihood_has_no_profiles(
    more: list[str],
    motor_file: Path,
    run_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """``estimate --profile`` divided by the number of profiles, of which there was none."""

    def failing(*given: Any, **named: Any) -> Estimate:
        found = estimate(*given, **named)
        unknown = np.full(found.covariance.shape, np.nan)
        return replace(found, nll=math.inf, covariance=unknown, outcome=SearchOutcome.NO_FINITE_POINT)

    for module in (runs, profiles):
        monkeypatch.setattr(module, "run_estimate", failing)
    out = tmp_path / "fit"
    command, *options = _asked(motor_file, run_file, out, "--free", "b", *more[1:])
    assert main([more[0], *options]) == 1 and command == "profile"
    said = capsys.readouterr()
    assert "profiles: none" in said.out or "nothing is profiled" in said.err
    assert not (out / "profile.png").exists()


def test_a_name_that_is_not_free_is_told_before_the_search(
    motor_file: Path, run_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """``estimate --profile`` told a misspelt name when the search was over, with exit status 2 beside an answer."""
    out = tmp_path / "fit"
    given = ["estimate", str(motor_file), "--data", str(run_file), "--free", "b", "--out", str(out)]
    assert main([*given, "--profile", "c"]) == 2
    said = capsys.readouterr()
    assert "--profile c: it is not free" in said.err and "free are b" in said.err
    assert not said.out and not out.exists()
