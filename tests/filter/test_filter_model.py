"""Filter models say at once what they cannot mean."""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

from bondgraph.errors import FilterError
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.follows import Follow
from bondgraph.filter.plan import IntervalSteps, StepPlan
from bondgraph.filter.robust import Robust
from bondgraph.filter.samples import Samples, interval_substeps
from bondgraph.simulate.model import Model
from tests.filter.logs import PlainLog, circuit_filter, driveline_filter, pendulum_filter
from tests.simulate.samples import sample


def test_vectors_follow_the_order_of_the_model() -> None:
    model = driveline_filter(appended={"tau_grip": 0.5}, measurement_noise={"wheel_speed": 0.3})
    assert model.state_names == ("omega_engine", "omega_wheel", "q_shaft", "v_body", "tau_grip")
    assert model.process_std.tolist() == [3.0, 0.5, 0.0, 0.1, 0.5]
    assert model.start_std.tolist() == [10.0, 1.0, 0.01, 0.3, 0.0]
    assert model.appended_index.tolist() == [3]
    np.testing.assert_array_equal(model.noise_std, [np.nan, 0.3, np.nan])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"process_noise": {"rat": 1.0}}, "process_noise names 'rat'; did you mean 'rate'"),
        ({"measurement_noise": {"angle": 1.0}}, "measurement_noise names 'angle'"),
        ({"measurement_noise": {}}, "no output is measured"),
        ({"measurement_noise": {"deflection": 0.0}}, "give a finite standard deviation above zero"),
        ({"initial_std": {"angle": -1.0}}, "initial_std of 'angle' is -1.0"),
        ({"initial_std": {"length": 0.1}}, "initial_std names 'length'"),
        ({"process_noise": {"rate": np.inf}}, "process_noise of 'rate' is inf"),
        ({"appended": {"lenght": 0.0}}, "appended names 'lenght'; did you mean 'length'"),
        ({"substeps": 0}, "at least one step"),
        ({"method": "rk5"}, "filter method 'rk5' is not known"),
        ({"alpha": 0.0}, "alpha must be positive"),
    ],
)
def test_mistakes_are_told(changes: dict[str, object], message: str) -> None:
    with pytest.raises(FilterError) as error:
        pendulum_filter(**changes)
    assert message in str(error.value)


def test_settings_do_not_follow_later_changes_of_their_source() -> None:
    noise = {"rate": 0.3}
    model = pendulum_filter(process_noise=noise)
    noise["rate"] = 9.0
    assert model.process_std.tolist() == [0.0, 0.3]


LOG = PlainLog("run", np.arange(4.0), np.zeros((1, 4)), np.zeros((1, 4)))


@pytest.mark.parametrize(
    ("log", "message"),
    [
        (PlainLog("run", np.arange(4.0), np.zeros((2, 4)), LOG.y), "inputs have shape (2, 4), pendulum needs"),
        (PlainLog("run", np.arange(4.0), np.zeros((1, 4)), np.zeros((1, 3))), "outputs have shape (1, 3)"),
        (PlainLog("run", np.zeros(4), np.zeros((1, 4)), np.zeros((1, 4))), "times must increase"),
        (PlainLog("run", np.arange(4.0), np.array([[0, np.nan, 0, 0]]), LOG.y), "'drive' has no value at t = 1"),
        (PlainLog("run", np.arange(4.0), LOG.u, np.array([[0, 0, np.inf, 0]])), "'deflection' is infinite at t = 2 s"),
        (PlainLog("run", np.arange(4.0), LOG.u, LOG.y, {"lenght": 1.0}), "no parameter 'lenght' in pendulum; did you"),
    ],
)  # fmt: skip
def test_logs_that_do_not_fit_are_told(log: PlainLog, message: str) -> None:
    with pytest.raises(FilterError) as error:
        Samples.of(pendulum_filter(), log)
    assert str(error.value).startswith("run: ")
    assert message in str(error.value)


def test_a_channel_without_declared_noise_is_not_used_in_silence() -> None:
    model = driveline_filter(measurement_noise={"wheel_speed": 0.3})
    time = np.arange(3.0)
    y = np.full((3, 3), np.nan)
    Samples.of(model, PlainLog("run", time, np.zeros((3, 3)), y))
    y[0, 1] = 1.0
    with pytest.raises(FilterError, match="output 'engine_speed' is measured but measurement_noise does not name it"):
        Samples.of(model, PlainLog("run", time, np.zeros((3, 3)), y))


def test_gaps_get_proportionally_more_steps() -> None:
    time = np.array([0.0, 1.0, 2.05, 3.0, 7.1, 8.1])
    assert interval_substeps(time, 5).tolist() == [5, 5, 5, 20, 5]
    assert interval_substeps(np.array([3.0]), 5).size == 0


CHANGES: list[dict[str, object]] = [
    {"process_noise": {"angle": 0.02, "rate": 0.31}},
    {"measurement_noise": {"deflection": 0.051}},
    {"initial_std": {"angle": 0.2}},
    {"substeps": 3},
    {"method": "ros3p"},
    {"grading": 1.1},
    {"alpha": 0.2},
    {"beta": 2.5},
    {"kappa": 0.5},
    {"appended": {"length": 0.0}},
    {"appended": {"length": 0.1}},
    {"robust": Robust("student")},
    {"robust": Robust("student", 3.0)},
    {"plan": StepPlan.of("rk4", {"key": IntervalSteps(np.array([2]), np.ones(1))})},
    {"plan": StepPlan.of("rk4", {"key": IntervalSteps(np.array([3]), np.ones(1))})},
    {"noise_scheme": "sampled"},
    {"noise_nodes": 2},
    {"noise_reach": 12.0},
    {"process_correlation": {("angle", "rate"): 0.1}},
    {"initial_correlation": {("angle", "rate"): 0.1}},
    {"follows": {"angle": Follow(0.1)}},
    {"follows": {"angle": Follow(0.1, (("rate", 1.0),))}},
]


def test_a_digest_tells_every_filter_model_from_every_other() -> None:
    """Caches and checkpoints are keyed by it; the repr is for people and says little."""
    digests = [pendulum_filter(**changes).digest for changes in [{}, *CHANGES]]
    assert len(set(digests)) == len(digests)
    fields = {field.name for field in dataclasses.fields(FilterModel)} - {"model", "measurement_correlation"}
    assert fields == {name for changes in CHANGES for name in changes}, "a field that the digest may miss"
    assert (
        pendulum_filter(alpha=np.float64(0.1), process_noise={"angle": np.float64(0.02), "rate": 0.3}).digest
        == digests[0]
    )
    longer = replace(pendulum_filter(), model=Model.from_text(sample("pendulum").text.replace("9.81", "9.82")))
    assert longer.digest != digests[0]
    two = circuit_filter()
    assert replace(two, measurement_correlation={("current", "voltage"): 0.1}).digest != two.digest
