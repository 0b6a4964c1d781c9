"""Exact derivatives of innovations equal central differences, in every kind of direction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.errors import FilterError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.gradient import Directions, innovation_tangents
from bondgraph.filter.likelihood import innovations, likelihood
from bondgraph.filter.ukf import Member
from bondgraph.simulate.outcome import Outcome
from tests.filter.logs import PlainLog, circuit_filter, driveline_filter, pendulum_filter, simulated_log, uneven_times

FIELDS = ("theta", "x0", "initial_std", "process_std", "noise_std")


def member_of(model: FilterModel) -> Member:
    return Member.of(model)


def random_directions(model: FilterModel, count: int, seed: int) -> Directions:
    """Directions that move everything at once, in proportion to its size."""
    rng, member = np.random.default_rng(seed), member_of(model)
    sizes = {name: np.abs(getattr(member, name)) for name in FIELDS}
    sizes["x0"] = np.maximum(sizes["x0"], 0.1)
    return Directions(**{name: size[:, None] * rng.normal(size=(size.size, count)) for name, size in sizes.items()})


def differences(model: FilterModel, log: PlainLog, directions: Directions, step: float) -> tuple[np.ndarray, ...]:
    member, count = member_of(model), directions.theta.shape[1]
    signs = np.repeat([1.0, -1.0], count)
    values = {
        name: getattr(member, name)[:, None] + step * signs * np.tile(getattr(directions, name), 2) for name in FIELDS
    }
    (record,) = innovations(model, log, **values)
    both = record.values, record.log_scales, likelihood(model, log, **values).nll
    return tuple((part[..., :count] - part[..., count:]) / (2.0 * step) for part in both)


@pytest.mark.parametrize(("alpha", "step", "tolerance"), [(1e-3, 1e-3, 2e-3), (0.1, 1e-5, 1e-5), (1.0, 1e-5, 1e-5)])
@pytest.mark.parametrize("make", [circuit_filter, pendulum_filter, driveline_filter])
def test_derivatives_equal_central_differences(make, alpha: float, step: float, tolerance: float) -> None:
    """With a small alpha the value itself is rounded to 1e-9, which differences by small steps magnify."""
    model = make(alpha=alpha)
    log = simulated_log(model, uneven_times(60, 0.02, seed=3), seed=1)
    log = replace(log, y=np.where(np.random.default_rng(4).random(log.y.shape) < 0.3, np.nan, log.y))
    directions = random_directions(model, 5, seed=7)
    (found,) = innovation_tangents(model, [log], [member_of(model)], [directions])
    assert found.outcome is Outcome.OK
    (record,) = innovations(model, log)
    np.testing.assert_allclose(found.values, record.values[..., 0], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found.log_scales, record.log_scales[..., 0], rtol=1e-7, atol=1e-7)
    d_values, d_log_scales, gradient = differences(model, log, directions, step)
    size = np.abs(d_values).max()
    np.testing.assert_allclose(found.d_values, d_values, rtol=tolerance, atol=tolerance * size)
    np.testing.assert_allclose(
        found.d_log_scales, d_log_scales, rtol=tolerance, atol=tolerance * np.abs(d_log_scales).max()
    )
    np.testing.assert_allclose(found.gradient, gradient, rtol=tolerance, atol=tolerance * np.abs(gradient).max())


@pytest.mark.parametrize("method", ["ros3p", "rodas4"])
@pytest.mark.parametrize("make", [circuit_filter, pendulum_filter, driveline_filter])
def test_derivatives_of_stiff_steps_are_exact_too(make, method: str) -> None:
    """The steps are so long that their own error is large: the derivative is that of the steps, not of the solution."""
    model = make(method=method, substeps=2, grading=1.7)
    log = simulated_log(model, np.arange(40) * 0.03, seed=1)
    directions = random_directions(model, 4, seed=7)
    (found,) = innovation_tangents(model, [log], [member_of(model)], [directions])
    assert found.outcome is Outcome.OK
    d_values, _, gradient = differences(model, log, directions, 1e-5)
    np.testing.assert_allclose(found.d_values, d_values, rtol=1e-5, atol=1e-5 * np.abs(d_values).max())
    np.testing.assert_allclose(found.gradient, gradient, rtol=1e-5, atol=1e-6 * np.abs(gradient).max())


def test_the_gradient_of_a_vehicle_equals_differences() -> None:
    """The engine, the continuously variable transmission and the car: tables, kinks, clamps."""
    from tests.simulate.points import model_of

    model = FilterModel(
        model_of("generated/driveline"), {"omega_primary": 2.0, "omega_axle": 0.5, "v_body": 0.1},
        {"engine_speed": 1.0, "speed": 0.1}, {"omega_primary": 5.0, "v_body": 0.5}, substeps=12,
    )  # fmt: skip
    log = simulated_log(model, np.arange(80) * 0.02, seed=5)
    log = replace(log, y=np.where(np.isnan(model.noise_std)[:, None], np.nan, log.y))
    directions = random_directions(model, 10, seed=3)
    still = replace(directions, noise_std=np.nan_to_num(directions.noise_std))
    (found,) = innovation_tangents(model, [log], [member_of(model)], [still])
    _, _, gradient = differences(model, log, still, 1e-5)
    np.testing.assert_allclose(found.gradient, gradient, rtol=1e-5, atol=1e-6 * np.abs(gradient).max())


def test_each_log_has_its_own_member_and_known_parameters_do_not_move() -> None:
    model = pendulum_filter()
    logs = [simulated_log(model, np.arange(25) * 0.05, seed=seed, name=f"log{seed}") for seed in (1, 2, 3)]
    logs[1] = replace(logs[1], theta_overrides={"length": 1.1})
    zero = {name: np.zeros((getattr(member_of(model), name).size, 1)) for name in FIELDS}
    length = Directions(**{**zero, "theta": np.array([[1.0], [0.0], [0.0]])})
    threaded = innovation_tangents(model, logs, [member_of(model)] * 3, [length] * 3, threads=3)
    alone = innovation_tangents(model, logs, [member_of(model)] * 3, [length] * 3, threads=1)
    for one, other in zip(threaded, alone, strict=True):
        np.testing.assert_array_equal(one.d_values, other.d_values)
    assert [found.log_name for found in alone] == ["log1", "log2", "log3"]
    assert not alone[1].d_values.any()
    assert alone[0].gradient[0] != 0.0


def test_directions_in_threads_are_those_in_one() -> None:
    model = pendulum_filter()
    log = simulated_log(model, np.arange(40) * 0.05, seed=4)
    directions = random_directions(model, 11, seed=7)
    still = replace(directions, noise_std=np.nan_to_num(directions.noise_std))
    (alone,) = innovation_tangents(model, [log], [member_of(model)], [still], threads=1)
    (threaded,) = innovation_tangents(model, [log], [member_of(model)], [still], threads=3)
    for field in ("values", "log_scales", "d_values", "d_log_scales"):
        np.testing.assert_array_equal(getattr(threaded, field), getattr(alone, field))


def test_a_failure_is_an_outcome() -> None:
    model = pendulum_filter()
    log = simulated_log(model, np.arange(25) * 0.05, seed=1)
    broken = replace(member_of(model), x0=np.array([np.nan, 0.0]))
    (found,) = innovation_tangents(model, [log], [broken], [random_directions(model, 2, seed=1)])
    assert found.outcome is Outcome.DIVERGED
    assert np.isnan(found.d_values).all()


@pytest.mark.parametrize("settings", [{"method": "auto"}, {"appended": {"length": 0.0}}])
def test_what_has_no_exact_gradient_is_told(settings: dict) -> None:
    model = pendulum_filter(**settings)
    with pytest.raises(FilterError, match="has no exact gradient"):
        innovation_tangents(model, [], [], [])
