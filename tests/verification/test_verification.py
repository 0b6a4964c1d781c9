"""Every published case is met by the toolkit itself, within the published tolerance, and none is left out."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.estimate.objective import Terms
from bondgraph.filter.sigma_points import MerweScaled
from tests.verification.claims import Answer, Claim, Published, Tolerance, Verdict, answered, own, published
from tests.verification.likelihoods import FREE, process_problem, search
from tests.verification.table import CLAIMS

ROOT = Path(__file__).resolve().parents[2]

PARAMETERS = [
    pytest.param(claim, id=claim.name, marks=[pytest.mark.slow] * claim.slow) for claim in CLAIMS if claim.answer
]


@pytest.fixture(scope="session")
def cases(shared_data: Path) -> dict[str, Published]:
    return published(shared_data / "published")


@pytest.mark.parametrize("claim", PARAMETERS)
def test_a_published_result_is_met(cases: dict[str, Published], claim: Claim) -> None:
    row = answered(claim, cases)
    expected = Verdict.NOT_EXPRESSIBLE if claim.reason else Verdict.HOLDS
    assert row.verdict is expected, f"{row.got!r}, expected {row.expected!r} within {row.tolerance}"


def test_noise_added_at_the_samples_is_told_from_noise_that_the_model_carries_on(cases: dict[str, Published]) -> None:
    # These cases could have shown it, had a Kalman filter of the tests not stood in for the toolkit's.
    case = cases["ctsmTMB_ou2d_lkf"]
    carried = process_problem(case)
    sampled = replace(carried, filter_model=replace(carried.filter_model, noise_scheme="sampled"))
    point = np.array(case["expected"]["par"])
    assert sampled.nll(point[:, np.newaxis])[0] - case["expected"]["nll"] == pytest.approx(3.5098, abs=1e-3)
    level = FREE.index("process(x1)")
    assert np.exp(search(sampled).point[level] - point[level]) == pytest.approx(0.757, abs=0.002)


def test_every_case_and_every_expected_value_has_a_claim(cases: dict[str, Published]) -> None:
    for name, case in cases.items():
        keys = set(case["expected"]) if isinstance(case["expected"], dict) else set()
        own_claims = [claim for claim in CLAIMS if claim.case == name]
        covered = {key for claim in own_claims for key in claim.covers}
        assert own_claims, name
        assert covered == keys, name
    assert {claim.case for claim in CLAIMS} == set(cases)
    assert len({claim.name for claim in CLAIMS}) == len(CLAIMS)


def test_every_claim_is_about_the_toolkit_or_says_why_not() -> None:
    for claim in CLAIMS:
        assert claim.answer is not None or claim.reason, claim.name
        assert bool(claim.where) == (claim.answer is not None), claim.name
        assert all(function.__module__.startswith("bondgraph.") for function in claim.where), claim.name


ONE = {"one": Published(Path(), {"id": "one", "source": "here", "tol": {}, "expected": {}})}


def claimed(got: object, **changes: object) -> Claim:
    claim = Claim("one", "a number", (MerweScaled.__post_init__,), lambda _: Answer([1.0, 2.0], _asked(got)), own(0.1))
    return replace(claim, **changes)


def _asked(got: object) -> object:
    MerweScaled(2, 1.0)
    return got


@pytest.mark.parametrize(
    ("got", "verdict"),
    [
        ([1.05, 1.95], Verdict.HOLDS),
        ([1.05, 1.85], Verdict.DIFFERS),
        ([np.nan, 2.0], Verdict.DIFFERS),
        ([[1.0, 2.0], [1.0, 2.2]], Verdict.DIFFERS),
    ],
)
def test_a_claim_holds_when_every_value_is_within_its_tolerance(got: object, verdict: Verdict) -> None:
    assert answered(claimed(got), ONE).verdict is verdict


def test_the_value_furthest_over_its_tolerance_is_shown() -> None:
    row = answered(claimed([1.06, 1.7], tolerance=lambda _: Tolerance(absolute=0.01, relative=0.1)), ONE)
    assert (row.expected, row.got, row.values) == (2.0, 1.7, 2)
    assert row.tolerance == "0.01 + 0.1 rel."
    exact = answered(claimed([1.0, 3.0], tolerance=lambda _: Tolerance()), ONE)
    assert (exact.verdict, exact.got, exact.tolerance) == (Verdict.DIFFERS, 3.0, "exact")


def test_an_answer_computed_without_the_toolkit_does_not_count() -> None:
    row = answered(claimed([1.0, 2.0], where=(Terms.sums,)), ONE)
    assert row.verdict is Verdict.NOT_CALLED


def test_what_cannot_be_expressed_is_shown_and_not_judged() -> None:
    row = answered(claimed([1.0, 9.0], reason="it is another method"), ONE)
    assert (row.verdict, row.got) == (Verdict.NOT_EXPRESSIBLE, 9.0)
    assert row.to_dict()["reason"] == "it is another method"


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "tests.verification", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )


def test_the_command_prints_a_line_per_claim(shared_data: Path, tmp_path: Path) -> None:
    run = command("--only", "filterpy_simplex", "ishigami", "--json", str(tmp_path / "rows.json"))
    assert run.returncode == 0, run.stderr
    assert "filterpy_simplex_points_moments" in run.stdout and "bondgraph.filter.sigma_points" in run.stdout
    assert run.stdout.endswith("3 agrees, 1 not expressible\n")
    first, *others = json.loads((tmp_path / "rows.json").read_text(encoding="utf-8"))
    assert [row["verdict"] for row in (first, *others)] == ["agrees"] * 3 + ["not expressible"]
    assert first["where"] == [f"bondgraph.filter.sigma_points.MerweScaled.{name}" for name in ("draw", "moments")]


def test_the_command_fails_when_a_result_differs(shared_data: Path, tmp_path: Path) -> None:
    given = json.loads((shared_data / "published" / "cases.json").read_text(encoding="utf-8"))
    for case in given["cases"]:
        if case["id"] == "julier_polar_to_cartesian":
            case["expected"]["mean"][1] += 0.1
    (tmp_path / "cases.json").write_text(json.dumps(given), encoding="utf-8")
    run = command("--cases", str(tmp_path), "--only", "julier_polar_to_cartesian: mean")
    assert run.returncode == 1 and "differs" in run.stdout


def test_without_the_cases_the_command_says_so(tmp_path: Path) -> None:
    run = command("--cases", str(tmp_path))
    assert run.returncode == 0 and "name its folder with --cases" in run.stderr


def test_a_claim_that_does_not_exist_is_refused(shared_data: Path) -> None:
    run = command("--only", "no such case")
    assert run.returncode == 2 and "no claim is called no such case" in run.stderr
