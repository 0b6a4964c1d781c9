"""Likelihoods of batches: members, threads, logs, failures."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph.errors import FilterError, ModelError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import innovations, likelihood, negative_log_likelihood
from bondgraph.filter.runs import run
from bondgraph.simulate.outcome import Outcome
from tests.filter.logs import PlainLog, circuit_filter, driveline_filter, pendulum_filter, simulated_log
from tests.simulate.samples import decay

BOTH = pytest.mark.parametrize("compiled", [False, True])


def spread(model: FilterModel, members: int, seed: int) -> dict[str, np.ndarray]:
    """Numbers of every kind, different for every member."""
    rng = np.random.default_rng(seed)

    def columns(values: np.ndarray) -> np.ndarray:
        return values[:, None] * rng.uniform(0.8, 1.25, (values.size, members))

    return {
        "theta": columns(model.model.theta()),
        "noise_std": columns(model.noise_std),
        "process_std": columns(model.process_std),
        "initial_std": columns(model.start_std),
        "x0": columns(model.model.x0()) + 0.01 * rng.normal(size=(len(model.model.states), members)),
    }


@pytest.mark.parametrize("make", [circuit_filter, pendulum_filter, driveline_filter])
def test_members_of_a_batch_equal_single_evaluations(make) -> None:
    model = make(appended={make().model.parameters[1].name: 0.01})
    log = simulated_log(model, np.arange(40) * 0.025, seed=1)
    values = spread(model, 5, seed=2)
    batch = likelihood(model, log, **values)
    assert batch.outcomes == (Outcome.OK,) * 5
    for m in range(5):
        one = {name: array[:, m] for name, array in values.items()}
        assert likelihood(model, log, **one).nll[0] == batch.nll[m]
        assert run(model, log, **one).nll == pytest.approx(batch.nll[m], rel=1e-12)
        plain = likelihood(model, log, compiled=False, **one)
        assert plain.nll[0] == pytest.approx(batch.nll[m], rel=1e-9)


@pytest.mark.parametrize("scheme", ["sampled", "continuous"])
def test_a_member_by_itself_has_the_bits_it_has_in_a_block(scheme: str) -> None:
    """Alone its matrices are worked on along their rows, in a block across members; with gaps in what is measured."""
    model = replace(driveline_filter(), noise_scheme=scheme)
    log = simulated_log(model, np.arange(30) * 0.025, seed=3)
    log.y[0, 3:9] = np.nan
    log.y[:, 12] = np.nan
    values = spread(model, 6, seed=5)
    (together,) = innovations(model, log, **values)
    for m in range(6):
        (alone,) = innovations(model, log, **{name: array[:, m] for name, array in values.items()})
        np.testing.assert_array_equal(alone.values[..., 0], together.values[..., m])
        np.testing.assert_array_equal(alone.log_scales[..., 0], together.log_scales[..., m])


def test_the_number_of_threads_changes_no_bit() -> None:
    model = driveline_filter()
    logs = [simulated_log(model, np.arange(30) * 0.025, seed=seed) for seed in (1, 2)]
    values = spread(model, 7, seed=3)
    one = likelihood(model, logs, threads=1, **values)
    for threads in (2, 3, 16):
        more = likelihood(model, logs, threads=threads, **values)
        np.testing.assert_array_equal(more.nll_per_log, one.nll_per_log)
    a, b = (innovations(model, logs, threads=threads, **values) for threads in (1, 4))
    for first, second in zip(a, b, strict=True):
        np.testing.assert_array_equal(first.values, second.values)


def test_likelihoods_of_logs_add_up() -> None:
    model = pendulum_filter()
    logs = [simulated_log(model, np.arange(25) * 0.05, seed=seed) for seed in (4, 5, 6)]
    together = likelihood(model, logs)
    apart = [likelihood(model, log).nll[0] for log in logs]
    np.testing.assert_allclose(together.nll_per_log[:, 0], apart, rtol=0)
    assert together.nll[0] == pytest.approx(sum(apart), rel=1e-14)


def test_each_log_may_have_its_own_start_and_its_known_parameters() -> None:
    model = pendulum_filter()
    first, second = (simulated_log(model, np.arange(25) * 0.05, seed=seed) for seed in (7, 8))
    heavy = replace(second, theta_overrides={"length": 1.4})
    theta = np.stack([model.model.theta(length=length) for length in (0.9, 1.1)], axis=1)
    starts = [np.array([[0.4, 0.6], [0.1, -0.1]]), None]
    both = likelihood(model, [first, heavy], theta, x0=starts)
    np.testing.assert_array_equal(both.nll_per_log[0], likelihood(model, first, theta, x0=starts[0]).nll)
    known = model.model.theta(length=1.4)
    np.testing.assert_array_equal(both.nll_per_log[1], np.repeat(likelihood(model, second, known).nll, 2))


@BOTH
def test_whitened_innovations_make_up_the_likelihood(compiled: bool) -> None:
    model = driveline_filter()
    log = simulated_log(model, np.arange(40) * 0.025, seed=9)
    log = replace(log, y=np.where(np.random.default_rng(1).random(log.y.shape) < 0.3, np.nan, log.y))
    values = spread(model, 3, seed=4)
    (record,) = innovations(model, log, compiled=compiled, **values)
    count = np.count_nonzero(~np.isnan(log.y))
    np.testing.assert_array_equal(record.measured, ~np.isnan(log.y))
    assert record.values.shape == record.log_scales.shape == (3, 40, 3)
    assert not record.values[~record.measured].any()
    terms = 0.5 * record.values**2 + record.log_scales
    expected, _ = negative_log_likelihood(model, log, compiled=compiled, **values)
    np.testing.assert_allclose(terms.sum(axis=(0, 1)) + 0.5 * count * np.log(2 * np.pi), expected, rtol=1e-12)


@BOTH
def test_a_diverging_member_is_an_outcome(compiled: bool) -> None:
    model = FilterModel(decay(), {"level": 0.1}, {"reading": 0.1}, {"level": 0.1}, substeps=2)
    time = np.arange(200) * 0.5
    logs = [PlainLog("a", time, np.zeros((2, 200)), np.exp(-time)[None]) for _ in range(2)]
    rates = np.array([[1.0, 1e9, 0.9]])
    result = likelihood(model, logs, rates, compiled=compiled)
    assert result.outcomes == (Outcome.OK, Outcome.DIVERGED, Outcome.OK)
    assert np.isinf(result.nll[1])
    alone = likelihood(model, logs, rates[:, [0, 2]], compiled=compiled)
    np.testing.assert_array_equal(result.nll[[0, 2]], alone.nll)
    (record, _) = innovations(model, logs, rates, compiled=compiled)
    assert np.isnan(record.values[..., 1]).all()
    assert np.isfinite(record.values[..., [0, 2]]).all()
    failed = run(model, logs[0], rates[:, 1], compiled=compiled)
    assert failed.outcome is Outcome.DIVERGED
    assert failed.nll == np.inf
    finished = int(np.searchsorted(time, failed.ended_at))
    assert np.isfinite(failed.filtered_mean[:, : finished + 1]).all()
    assert np.isnan(failed.filtered_mean[:, finished + 1 :]).all()
    with pytest.raises(FilterError, match="a: the state grew without bound"):
        failed.raise_if_failed()


@BOTH
def test_a_start_that_is_not_finite_is_an_outcome(compiled: bool) -> None:
    model = circuit_filter()
    log = simulated_log(model, np.arange(5) * 0.05, seed=1)
    result = likelihood(model, log, x0=[np.nan, 0.0], compiled=compiled)
    assert result.outcomes == (Outcome.DIVERGED,)
    failed = run(model, log, x0=[np.nan, 0.0], compiled=compiled)
    assert np.isnan(failed.filtered_mean).all()


@BOTH
def test_an_innovation_covariance_that_is_not_positive_is_an_outcome(compiled: bool) -> None:
    """With beta below alpha squared the weights may cancel: here all of the spread is shift."""
    model = pendulum_filter(alpha=2.0, beta=-40.0, kappa=0.0)
    log = simulated_log(pendulum_filter(), np.arange(10) * 0.05, seed=1)
    result = likelihood(model, log, x0=[np.pi / 2, 0.0], noise_std=[1e-3], compiled=compiled)
    assert result.outcomes == (Outcome.NOT_POSITIVE,)
    assert np.isinf(result.nll[0])


@BOTH
def test_lost_directions_are_counted(compiled: bool) -> None:
    """Two readings of a level known to 1e9, one of them with hardly any noise: what remains is below rounding."""
    model = FilterModel(decay(rate=0.0), {}, {"reading": 1e-9}, {"level": 1e9})
    log = PlainLog("exact", np.arange(4.0), np.zeros((2, 4)), np.ones((1, 4)))
    result = likelihood(model, log, compiled=compiled)
    assert result.outcomes == (Outcome.OK,)
    assert result.floored_pivots[0] == 1
    assert run(model, log, compiled=compiled).floored_pivots == 1


def test_states_known_exactly_are_no_loss() -> None:
    model = FilterModel(decay(), {}, {"reading": 0.1}, {})
    log = PlainLog("known", np.arange(5) * 0.1, np.zeros((2, 5)), np.exp(-np.arange(5) * 0.1)[None])
    result = likelihood(model, log)
    assert result.floored_pivots[0] == 0
    assert result.nll[0] == pytest.approx(5 * (np.log(0.1) + 0.5 * np.log(2 * np.pi)), abs=1e-4)


@pytest.mark.parametrize(
    ("values", "error", "message"),
    [
        ({"theta": np.ones(2)}, ModelError, "theta has shape (2,) where (3,) or (3, 1) is needed"),
        ({"theta": np.ones((3, 2)), "noise_std": np.ones((1, 3))}, ModelError, "ambiguous"),
        ({"noise_std": np.ones(2)}, ModelError, "noise_std has shape (2,)"),
        ({"x0": [None, None]}, FilterError, "x0 has 2 entries for 1 logs"),
    ],
)
def test_numbers_that_do_not_fit_are_told(values: dict, error: type[Exception], message: str) -> None:
    model = pendulum_filter()
    log = simulated_log(model, np.arange(5) * 0.05, seed=1)
    with pytest.raises(error) as caught:
        likelihood(model, log, **values)
    assert message in str(caught.value)


def test_no_log_and_too_many_members_are_told() -> None:
    model = pendulum_filter()
    with pytest.raises(FilterError, match="there is no log to filter"):
        likelihood(model, [])
    log = simulated_log(model, np.arange(5) * 0.05, seed=1)
    with pytest.raises(FilterError, match="run takes one member, not 2"):
        run(model, log, np.ones((3, 2)))


def test_names_of_states_are_checked() -> None:
    model = pendulum_filter()
    filtered = run(model, simulated_log(model, np.arange(5) * 0.05, seed=1))
    with pytest.raises(FilterError, match="no state 'rat'; did you mean 'rate'"):
        filtered.mean("rat")


@pytest.mark.slow
def test_first_use_in_a_fresh_process_may_be_with_threads(tmp_path: Path) -> None:
    """Compilation parses Python text, which must happen before the threads start (it failed in CPython 3.11)."""
    script = (
        "import numpy as np\n"
        "from bondgraph.data.log import MatchedLog\n"
        "from bondgraph.filter.filter_model import FilterModel\n"
        "from bondgraph.filter.likelihood import likelihood\n"
        "from bondgraph.simulate.example import pendulum\n"
        "model = pendulum()\n"
        "swing = FilterModel(model, {'rate': 0.1}, {'deflection': 0.05}, {'angle': 0.1, 'rate': 0.1})\n"
        "time = np.arange(20) * 0.05\n"
        "log = MatchedLog('swing', time, np.zeros((1, 20)), 0.5 * np.cos(3.1 * time)[np.newaxis])\n"
        "theta = np.repeat(model.theta()[:, np.newaxis], 16, axis=1)\n"
        "print(np.isfinite(likelihood(swing, log, theta, threads=8).nll).all())\n"
    )
    environment = {**os.environ, "BONDGRAPH_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment, check=False)
    assert done.stdout.strip() == "True", done.stderr
