"""A smoother that keeps bands only says, part after part backwards, what one says that keeps everything."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.errors import FilterError
from bondgraph.filter import smoother_bands as parts
from bondgraph.filter.bands import BandRecorder
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.runs import run, run_bands, run_smoothed
from bondgraph.filter.smoother import SmootherRun, smooth, smooth_step
from bondgraph.filter.smoother_bands import SmootherBands
from tests.filter.logs import driveline_filter, simulated_log
from tests.filter.test_bands import FILTERS, SWING, log, same


def same_smoothed(bands: SmootherBands, whole: SmootherRun) -> None:
    for name in ("time", "smoothed_mean", "smoothed_var"):
        np.testing.assert_array_equal(getattr(bands, name), getattr(whole, name), err_msg=name)


@pytest.mark.parametrize("part", [1, 7, 1000])
@pytest.mark.parametrize("name", FILTERS)
def test_it_has_the_bits_of_a_smoother_that_keeps_all(name: str, part: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "PART", part)
    whole = run(FILTERS[name], log())
    smoothed = run_smoothed(FILTERS[name], log())
    same_smoothed(smoothed, smooth(whole))
    same(smoothed.filtered, whole)
    assert smoothed.table() == smooth(whole).table()
    np.testing.assert_array_equal(smoothed.std("rate"), smooth(whole).std("rate"))


def test_noise_that_begins_within_a_log_makes_no_difference_between_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine of five states with noise nodes, in parts of many lengths."""
    model = driveline_filter(noise_nodes=2)
    measured = simulated_log(model, np.arange(40) * 0.025, seed=3)
    whole = smooth(run(model, measured))
    for part in (3, 16, 50):
        monkeypatch.setattr(parts, "PART", part)
        same_smoothed(run_smoothed(model, measured), whole)


def test_each_sample_follows_from_the_next_as_published() -> None:
    """Gains of many samples at once are those of one."""
    filtered = run(SWING, log())
    smoothed = smooth(filtered)
    for k in (0, 22, 58):
        mean, cov = smooth_step(
            filtered.filtered_mean[:, k], filtered.filtered_cov[..., k], filtered.cross_cov[..., k + 1],
            filtered.predicted_mean[:, k + 1], filtered.predicted_cov[..., k + 1],
            smoothed.smoothed_mean[:, k + 1], smoothed.smoothed_cov[..., k + 1],
        )  # fmt: skip
        np.testing.assert_allclose(smoothed.smoothed_mean[:, k], mean, rtol=1e-13)
        np.testing.assert_allclose(smoothed.smoothed_cov[..., k], cov, rtol=1e-12, atol=1e-18)


def test_the_numpy_filter_is_smoothed_to_the_same() -> None:
    same_smoothed(run_smoothed(SWING, log(), compiled=False), smooth(run(SWING, log(), compiled=False)))


def test_a_run_that_needs_finer_steps_is_smoothed_with_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """One step over three tenths of a second is unstable, two are not."""
    monkeypatch.setattr(parts, "PART", 16)
    model = driveline_filter(substeps=1)
    measured = simulated_log(driveline_filter(substeps=40), 0.3 * np.arange(60), seed=3)
    finer, repeated = BandRecorder.finer, []
    monkeypatch.setattr(BandRecorder, "finer", lambda recorder: repeated.append(1) or finer(recorder))
    same_smoothed(run_smoothed(model, measured), smooth(run(model, measured)))
    assert repeated


def test_a_run_that_fails_says_where_and_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "PART", 7)
    late = log()
    late.u[0, 40:] = 1e200  # a torque that no state survives
    for measured, start, compiled in ((late, [0.5, 0.0], True), (log(), [np.inf, 0.0], False)):
        with pytest.raises(FilterError) as whole:
            smooth(run(SWING, measured, x0=start, compiled=compiled))
        with pytest.raises(FilterError) as bands:
            run_smoothed(SWING, measured, x0=start, compiled=compiled)
        assert str(bands.value) == str(whole.value)


def test_covariances_are_told_backwards_and_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "PART", 16)
    seen = np.full((2, 2, 60), np.nan)
    stretches: list[tuple[int, int]] = []

    def told(own: slice, means: np.ndarray, covs: np.ndarray) -> None:
        stretches.append((own.start, own.stop))
        assert means.shape == (2, own.stop - own.start)
        seen[..., own] = covs

    smoothed = run_smoothed(SWING, log(), told=told)
    np.testing.assert_array_equal(seen, smooth(run(SWING, log())).smoothed_cov)
    assert len(stretches) > 3 and stretches[0][1] == 60 and stretches[-1][0] == 0
    assert all(before[0] == after[1] for before, after in itertools.pairwise(stretches))
    assert not any(getattr(smoothed, name).ndim > 2 for name in ("smoothed_mean", "smoothed_var"))


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_short_logs_have_one_part(samples: int) -> None:
    same_smoothed(run_smoothed(SWING, log(samples=samples)), smooth(run(SWING, log(samples=samples))))


def test_the_front_door_smooths_long_logs_and_says_how() -> None:
    smoothed = bg.filter_log(SWING, log(), keep="smoothed", initial="model")
    assert isinstance(smoothed, SmootherBands)
    same_smoothed(smoothed, smooth(run(SWING, log())))
    with pytest.raises(FilterError, match=r"bands have no covariances.* keep 'smoothed'"):
        bg.smooth(run_bands(SWING, log()))  # type: ignore[arg-type]


def test_bands_of_a_record_are_those_of_the_run() -> None:
    whole: FilterRun = run(replace(SWING, noise_nodes=3), log())
    same(bg.filter.FilterBands.of(whole), whole)
