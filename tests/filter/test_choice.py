"""The integration method is chosen by the rates of a model along its logs, once for all parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bondgraph.filter import choice
from bondgraph.filter.choice import STEP_TIMES_RATE, choose_method
from bondgraph.filter.discretisation import discretisation_error
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.likelihood import likelihood
from bondgraph.filter.planning import filtered_logs
from bondgraph.filter.runs import run
from tests.filter.logs import PlainLog, driveline_filter, simulated_log
from tests.simulate.samples import decay


def following(rate: float, **settings: object) -> tuple[FilterModel, PlainLog]:
    time = np.arange(60) * 0.1
    log = PlainLog("fast", time, np.stack([rate * np.sin(time), 0.0 * time]), np.sin(time)[None])
    noise = {"process_noise": {"level": 0.1}, "measurement_noise": {"reading": 0.1}, "initial_std": {"level": 0.1}}
    return FilterModel(decay(rate=rate), **noise, **settings), log  # type: ignore[arg-type]


@pytest.mark.parametrize("rate", [3.0, 100.0])
def test_a_slow_model_is_integrated_with_as_many_explicit_steps_as_it_needs(rate: float) -> None:
    model, log = following(rate, method="auto", substeps=2)
    chosen = choose_method(model, [log])
    assert chosen.method == "rk4"
    assert chosen.substeps == max(2, np.ceil(rate * 0.1 / STEP_TIMES_RATE))


def test_a_fast_model_is_integrated_with_a_stiff_method() -> None:
    model, log = following(1e4, method="auto")
    chosen = choose_method(model, [log])
    assert chosen.is_stiff
    assert chosen.plan is not None
    assert chosen.plan.method == chosen.method
    assert chosen.typical_substeps < 32
    assert choose_method(model, [log]) is chosen
    assert choose_method(chosen, [log]) is chosen


def first_runs(
    monkeypatch: pytest.MonkeyPatch, model: FilterModel, log: PlainLog
) -> tuple[list[FilterModel], FilterModel]:
    """The filters of the runs that a choice makes, and the choice."""
    runs: list[FilterModel] = []

    def recorded(used: FilterModel, *arguments: object) -> object:
        runs.append(used)
        return filtered_logs(used, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(choice, "filtered_logs", recorded)
    choice._chosen.cache_clear()
    chosen = choose_method(model, [log])
    choice._chosen.cache_clear()
    return runs, chosen


def test_a_plan_costs_one_run_of_few_steps_whatever_runge_kutta_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    """A filter declared with 120 steps of Runge-Kutta made a first run of 120 rodas4 steps: 67 values."""
    runs, chosen = first_runs(monkeypatch, *following(1e3, method="auto", noise_scheme="sampled", substeps=20))
    assert [(used.method, used.substeps, used.grading) for used in runs] == [("ros3p", 12, 1.0)]
    assert chosen.plan is not None
    assert chosen.plan == first_runs(monkeypatch, *following(1e3, method="auto", noise_scheme="sampled"))[1].plan


def test_the_first_run_serves_for_panels_and_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    runs, chosen = first_runs(monkeypatch, *following(10.0, method="auto"))
    assert chosen.noise_rule == runs[0].noise_rule
    assert len(runs) == 1


def test_a_first_run_that_was_too_coarse_for_its_plan_is_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choice, "_FIRST_STEPS", 1)
    runs, chosen = first_runs(monkeypatch, *following(300.0, method="auto", noise_scheme="sampled"))
    assert [used.substeps for used in runs] == [1, 2, 4][: len(runs)]
    assert len(runs) > 1
    monkeypatch.undo()
    assert chosen.plan is not None
    _, fine = first_runs(monkeypatch, *following(300.0, method="auto", noise_scheme="sampled"))
    assert fine.plan is not None
    assert chosen.plan.mean_substeps == pytest.approx(fine.plan.mean_substeps, rel=0.1)


def test_a_likelihood_says_what_was_chosen_and_carries_its_error() -> None:
    model, log = following(1e3, method="auto")
    rates = np.array([[1.0, 1e3, 3.0]])
    found = likelihood(model, log, rates)
    chosen = choose_method(model, [log])
    assert (found.method, found.substeps) == (chosen.method, chosen.typical_substeps)
    assert chosen.is_stiff
    assert int(np.argmin(found.nll)) == 1
    assert found.discretisation == discretisation_error(model, log, rates[:, 1])
    assert found.discretisation.negligible
    assert found.discretisation.step_times_rate > 10.0
    assert "beyond" not in str(found.discretisation)
    assert run(model, log).filter_model == chosen


def test_the_error_belongs_to_the_numbers_of_the_best_member() -> None:
    model = driveline_filter(substeps=6)
    log = simulated_log(model, np.arange(60) * 0.02, seed=2)
    values = {"noise_std": model.noise_std[:, None] * [1.0, 3.0], "x0": model.model.x0()[:, None] * [1.0, 1.01]}
    found = likelihood(model, [log, log], **values)
    m = int(np.argmin(found.nll))
    own = {name: array[:, m] for name, array in values.items()}
    assert found.discretisation == discretisation_error(model, [log, log], **own)


def test_a_choice_for_other_noises_is_not_taken_from_memory() -> None:
    """Filter models that look alike in print may need other steps: choices are remembered by content."""
    loose, log = following(3.0, method="auto")
    tight = replace(loose, measurement_noise={"reading": 0.2})
    assert repr(loose) == repr(tight)
    assert choose_method(loose, [log]).measurement_noise == {"reading": 0.1}
    assert choose_method(tight, [log]).measurement_noise == {"reading": 0.2}
    assert choose_method(replace(loose), [log]) is choose_method(loose, [log])
