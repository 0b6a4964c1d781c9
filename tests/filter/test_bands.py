"""A filter of which only bands are kept says, part after part, what one says that keeps everything."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import bondgraph as bg
from bondgraph.data.log import MatchedLog
from bondgraph.errors import OptionError
from bondgraph.filter import bands as parts
from bondgraph.filter.abstract_run import normalised_innovations
from bondgraph.filter.bands import FilterBands
from bondgraph.filter.consistency import consistency, misfits
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.robust import Robust
from bondgraph.filter.runs import run, run_bands
from bondgraph.simulate.example import pendulum
from bondgraph.simulate.outcome import Outcome

SWING = FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, substeps=2)


def log(samples: int = 60, step: float = 0.05) -> MatchedLog:
    """A swing that is noisy, measured unevenly, and not at all for a while."""
    chance = np.random.default_rng(3)
    time = step * np.cumsum(chance.uniform(0.5, 1.5, samples))
    y = 0.5 * np.cos(3.1 * time) + 0.05 * chance.standard_normal(samples)
    y[20:24] = np.nan
    return MatchedLog("swing", time, 0.1 * chance.standard_normal((1, samples)), y[np.newaxis])


FILTERS = {
    "plain": SWING,
    "noise between samples": replace(SWING, noise_nodes=3, noise_reach=30.0),
    "stiff": replace(SWING, method="ros3p", substeps=3),
    "robust": replace(SWING, robust=Robust("huber")),
    "appended": replace(SWING, appended={"length": 0.01}, process_noise={"rate": 0.1},
                        initial_std={"angle": 0.1, "rate": 0.1, "length": 0.05}),
}  # fmt: skip


def same(bands: FilterBands, whole: FilterRun) -> None:
    for name in ("time", "y", "filtered_mean", "filtered_var", "output_mean", "output_var", "whitened", "log_scales"):
        np.testing.assert_array_equal(getattr(bands, name), getattr(whole, name), err_msg=name)
    for name in ("nll", "outcome", "ended_at", "cause", "floored_pivots", "log_name"):
        assert getattr(bands, name) == getattr(whole, name), name


@pytest.mark.parametrize("part", [1, 7, 1000])
@pytest.mark.parametrize("name", FILTERS)
def test_bands_have_the_bits_of_a_filter_that_keeps_all(name: str, part: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "PART", part)
    whole = run(FILTERS[name], log())
    bands = run_bands(FILTERS[name], log())
    same(bands, whole)
    np.testing.assert_array_equal(normalised_innovations(bands), normalised_innovations(whole))
    assert consistency(bands) == consistency(whole) and misfits([bands]) == misfits([whole])
    assert bands.table() == whole.table() and bands.summary().split("\n", 1)[1] == whole.summary().split("\n", 1)[1]
    np.testing.assert_array_equal(bands.std("rate"), whole.std("rate"))


def test_the_numpy_filter_keeps_the_same() -> None:
    same(run_bands(SWING, log(), compiled=False), run(SWING, log(), compiled=False))


@pytest.mark.parametrize("part", [5, 1000])
def test_a_run_that_diverges_ends_where_and_why_it_does(part: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "PART", part)
    late = log()
    late.u[0, 40:] = 1e200  # a torque that no state survives
    whole, bands = run(SWING, late), run_bands(SWING, late)
    assert whole.outcome is not Outcome.OK and np.isnan(bands.filtered_mean[:, -1]).all()
    same(bands, whole)


def test_covariances_are_told_and_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "PART", 16)
    seen = np.full((2, 2, 60), np.nan)
    stretches: list[tuple[int, int]] = []

    def told(own: slice, means: np.ndarray, covs: np.ndarray) -> None:
        stretches.append((own.start, own.stop))
        assert means.shape == (2, own.stop - own.start)
        seen[..., own] = covs

    whole = run(SWING, log())
    bands = run_bands(SWING, log(), told=told)
    np.testing.assert_array_equal(seen, whole.filtered_cov)
    assert len(stretches) > 3 and stretches[0][0] == 0 and stretches[-1][1] == 60
    assert all(before[1] == after[0] for before, after in itertools.pairwise(stretches))
    assert not any(getattr(bands, name, np.empty(0)).ndim > 2 for name in FilterBands.__dataclass_fields__
                   if isinstance(getattr(bands, name), np.ndarray))  # fmt: skip


def test_a_day_of_a_vehicle_is_kept_in_as_many_numbers_as_its_bands_have() -> None:
    """Its rows grow with the states; those of a filter that keeps all with their square."""
    kept = run_bands(SWING, log(samples=500))
    assert kept.nbytes == 8 * 500 * (1 + 1 + 2 * 2 + 4 * 1)
    whole = run(SWING, log(samples=500))
    everything = sum(getattr(whole, name).nbytes for name in FilterRun.__dataclass_fields__
                     if isinstance(getattr(whole, name), np.ndarray))  # fmt: skip
    assert everything == 8 * 500 * (1 + 1 + 2 * 2 + 3 * 4 + 4 * 1)


def test_the_front_door_keeps_what_is_asked() -> None:
    bands, whole = (bg.filter_log(SWING, log(), keep=keep) for keep in ("bands", "all"))
    assert isinstance(bands, FilterBands) and isinstance(whole, FilterRun)
    same(bands, whole)
    with pytest.raises(OptionError, match="keep 'some' is not known"):
        bg.filter_log(SWING, log(), keep="some")  # type: ignore[call-overload]
