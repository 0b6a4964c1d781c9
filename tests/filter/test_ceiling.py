"""Ceilings spare work and change nothing: what is given up is above its ceiling, all else is the same in every bit."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bondgraph.errors import FilterError
from bondgraph.filter import compiled as compiled_filter
from bondgraph.filter.compiled import CompiledFilter
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import Likelihood, innovations, likelihood
from bondgraph.filter.samples import Samples
from bondgraph.simulate.outcome import Outcome
from tests.filter.logs import PlainLog, circuit_filter, driveline_filter, pendulum_filter, simulated_log
from tests.filter.test_likelihood import spread
from tests.simulate.samples import decay

BOTH = pytest.mark.parametrize("compiled", [False, True])
MODELS = pytest.mark.parametrize("make", [circuit_filter, pendulum_filter, driveline_filter])


@pytest.fixture(autouse=True)
def short_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts of 16 samples whatever a call costs, as the numpy filter has them."""
    monkeypatch.setattr(compiled_filter, "_CALL", 1.0)


def test_a_quick_machine_is_asked_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """A call takes half a millisecond at least, and the kernel a tenth of that for 16 samples of one state."""
    monkeypatch.undo()
    model, whole = pendulum_filter(), driveline_filter()
    logs, values = three_logs(pendulum_filter, 60), scattered(model, 5)
    capped = likelihood(model, logs, ceilings=likelihood(model, logs, **values).nll.min(), **values)
    ends = np.cumsum([0, *(log.time.size for log in logs)]) / sum(log.time.size for log in logs)
    assert {round(share, 9) for share in capped.share} <= {round(end, 9) for end in ends}  # logs in one part
    samples = 600
    slow, quick = (
        CompiledFilter.of(one).nodes_of_a_call(Samples.of(one, simulated_log(one, 0.025 * np.arange(samples), seed=1)))
        for one in (whole, model)
    )
    assert slow < quick < samples


@functools.cache
def simulated(make: Callable[..., FilterModel], samples: int) -> PlainLog:
    """A log of a machine at its declared parameters, which several tests use."""
    return simulated_log(make(), np.arange(samples) * 0.025, seed=samples)


def three_logs(make: Callable[..., FilterModel], samples: int) -> list[PlainLog]:
    """Logs of different lengths in which values are missing here and there."""
    rng = np.random.default_rng(7)
    logs = [simulated(make, n) for n in (samples, samples // 2, samples + 9)]
    return [replace(log, y=np.where(rng.random(log.y.shape) < 0.3, np.nan, log.y)) for log in logs]


def scattered(model: FilterModel, members: int) -> dict[str, np.ndarray]:
    """Members of which some are far off, every number different, the noises too."""
    values = spread(model, members, seed=2)
    values["theta"] *= np.random.default_rng(3).uniform(1.0, 3.0, members) ** 2
    return values


def check_equal_below(capped: Likelihood, whole: Likelihood, ceilings: np.ndarray) -> None:
    kept = ~capped.abandoned
    assert (kept | (whole.nll > ceilings)).all()
    np.testing.assert_array_equal(capped.nll[kept], whole.nll[kept])
    np.testing.assert_array_equal(capped.nll_per_log[:, kept], whole.nll_per_log[:, kept])
    np.testing.assert_array_equal(capped.floored_pivots[kept], whole.floored_pivots[kept])
    assert np.isinf(capped.nll[~kept]).all()
    assert [capped.outcomes[m] for m in np.flatnonzero(~kept)] == [Outcome.ABANDONED] * int((~kept).sum())


@MODELS
@BOTH
def test_values_below_ceilings_are_the_same_in_every_bit(make: Callable[..., FilterModel], compiled: bool) -> None:
    model = make(appended={make().model.parameters[1].name: 0.01})
    members, samples = (53, 200) if compiled else (6, 24)
    logs, values = three_logs(make, samples), scattered(model, members)
    whole = likelihood(model, logs, compiled=compiled, **values)
    ceilings = whole.nll + np.random.default_rng(4).normal(0.0, 0.5 * np.std(whole.nll), members)
    for each in (ceilings, np.full(members, np.median(whole.nll)), np.full(members, np.inf), np.full(members, -1e9)):
        capped = likelihood(model, logs, compiled=compiled, ceilings=each, **values)
        check_equal_below(capped, whole, each)
        np.testing.assert_array_equal(capped.share[~capped.abandoned], 1.0)
    assert capped.abandoned.all() and not capped.share.any()  # the last ones could never be reached


def test_hopeless_members_are_given_up_early() -> None:
    model = driveline_filter()
    logs, values = three_logs(driveline_filter, 200), scattered(model, 40)
    whole = likelihood(model, logs, **values)
    capped = likelihood(model, logs, ceilings=whole.nll.min(), **values)
    assert capped.abandoned.sum() == 39
    assert capped.share[capped.abandoned].mean() < 0.7


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_threads_and_company_change_nothing(threads: int) -> None:
    model = driveline_filter()
    logs, values = three_logs(driveline_filter, 120), scattered(model, 37)
    ceilings = np.full(37, np.percentile(likelihood(model, logs, **values).nll, 30.0))
    together = likelihood(model, logs, ceilings=ceilings, threads=threads, **values)
    assert 0 < together.abandoned.sum() < 37
    for m in range(0, 37, 5):
        alone = likelihood(model, logs, ceilings=ceilings[m], **{name: array[:, m] for name, array in values.items()})
        assert (alone.nll[0], alone.share[0]) == (together.nll[m], together.share[m])


@MODELS
def test_numpy_gives_up_the_same_members_at_the_same_samples(make: Callable[..., FilterModel]) -> None:
    model = make()
    logs, values = three_logs(make, 60), scattered(model, 5)
    ceiling = np.median(likelihood(model, logs, **values).nll)
    fast, plain = (likelihood(model, logs, ceilings=ceiling, compiled=c, **values) for c in (True, False))
    assert fast.abandoned.any()
    assert fast.outcomes == plain.outcomes
    np.testing.assert_array_equal(fast.share, plain.share)


@MODELS
@pytest.mark.parametrize("points", [{}, {"alpha": 1.5, "beta": 0.0}, {"alpha": 1e-3}])
def test_no_sample_adds_less_than_the_noises_of_its_sensors(make: Callable[..., FilterModel], points: dict) -> None:
    """The bound itself, sample by sample, for noises of every size; beta 0 is the least for which it holds."""
    model = make(**points)
    (log, *_), values = three_logs(make, 80), scattered(model, 24)
    values["noise_std"] *= np.random.default_rng(5).uniform(1e-3, 10.0, 24)
    (record,) = innovations(model, log, **values)
    good = np.flatnonzero([outcome is Outcome.OK for outcome in record.outcomes])
    assert good.size > 12
    terms = (0.5 * record.values**2 + record.log_scales)[..., good].sum(axis=0)
    least = np.einsum("an,am->nm", record.measured, np.log(values["noise_std"][:, good]))
    assert (terms >= least - 1e-9).all()


def test_where_there_is_no_bound_nobody_is_given_up() -> None:
    """Covariances may lose their sign with beta below zero; a sensor without noise may add any negative amount."""
    model = pendulum_filter(alpha=1.0, beta=-0.5)
    logs, values = three_logs(pendulum_filter, 60), scattered(model, 8)
    assert not likelihood(model, logs, ceilings=-1e6, **values).abandoned.any()
    values["noise_std"][0, 3] = 0.0
    lowest = likelihood(pendulum_filter(), logs, ceilings=-1e6, **values)
    np.testing.assert_array_equal(lowest.abandoned, np.arange(8) != 3)


@BOTH
def test_members_that_diverge_are_no_members_given_up(compiled: bool) -> None:
    """The second one grows beyond all numbers with one step per sample, and not with two."""
    model = FilterModel(decay(), {"level": 0.1}, {"reading": 0.1}, {"level": 0.1}, noise_scheme="sampled", substeps=1)
    time = np.arange(400) * 0.5
    y = np.where(time < time[-5], np.nan, 0.0)[None]
    logs = [PlainLog("a", time, np.zeros((2, 400)), y), PlainLog("b", time[:40], np.zeros((2, 40)), y[:, :40] * 0.0)]
    rates = np.array([[1.0, 10.0, 1e9, 0.5]])
    whole = likelihood(model, logs, rates, compiled=compiled)
    np.testing.assert_array_equal(whole.refined, [False, True, True, False])
    assert np.isfinite(whole.nll[1])
    capped = likelihood(model, logs, rates, compiled=compiled, ceilings=np.array([np.inf, np.inf, np.inf, -1e4]))
    np.testing.assert_array_equal(capped.nll[:3], whole.nll[:3])
    np.testing.assert_array_equal(capped.refined, whole.refined)
    assert capped.outcomes == (*whole.outcomes[:3], Outcome.ABANDONED)
    assert capped.outcomes[2] is Outcome.DIVERGED


def test_ceilings_that_do_not_fit_are_told() -> None:
    model = pendulum_filter()
    log = simulated_log(model, np.arange(5) * 0.05, seed=1)
    with pytest.raises(FilterError, match=r"ceilings has shape \(3,\) for 1 members"):
        likelihood(model, log, ceilings=np.zeros(3))
