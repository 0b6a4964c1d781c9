"""The verbs of the front door that ask before an estimation or an experiment: sensitivity, design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any, TypeAlias, TypedDict, Unpack, overload

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.data.given import GivenLog, all_matched, inputs_matched
from bondgraph.data.log import MatchedLog
from bondgraph.errors import OptionError, require_kind, suggest, wrong_kind
from bondgraph.estimate.derivatives.exact import derivatives
from bondgraph.estimate.design.answer import Design, standing
from bondgraph.estimate.design.discrimination import ERROR, discriminate
from bondgraph.estimate.design.information import rank_manoeuvres
from bondgraph.estimate.design.manoeuvres import Manoeuvre, blank_log, step_manoeuvres
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.initial import Initial
from bondgraph.estimate.joint import Problem
from bondgraph.estimate.likelihoods import LikelihoodFunction
from bondgraph.estimate.objective import Expand
from bondgraph.estimate.priors import Prior
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.result import Estimate
from bondgraph.estimate.sensitivities import Sensitivity
from bondgraph.estimate.sensitivities import sensitivity as problem_sensitivity
from bondgraph.estimate.ties import Tie
from bondgraph.execute.executors import open_executor
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.robust import Robust
from bondgraph.simulate.model import Model
from bondgraph.simulate.scenario import Scenario
from bondgraph.verbs import bounded, pose

#: A plan: a planned log, a scenario, or a log of which the times and inputs count.
Plan: TypeAlias = Manoeuvre | Scenario | GivenLog
#: A machine of a design: without noises, with them, posed with what is free in it, or estimated.
Machine: TypeAlias = Model | FilterModel | EstimationProblem | Estimate


class Posed(TypedDict, total=False):
    """Keywords of a problem beside its model, logs and free parameters, see :func:`bondgraph.verbs.pose`."""

    initial: Initial
    likelihood: LikelihoodFunction | None
    ties: Mapping[str, str] | Tie | Sequence[Tie]
    priors: Prior | Sequence[Prior]
    process_noise: str
    columns: Mapping[str, str] | None
    constants: Mapping[str, float | str] | None
    robust: Robust | str | None


@overload
def sensitivity(model: Problem, point: FloatArray | None, /, *, jacobian: Expand = derivatives) -> Sensitivity: ...


@overload
def sensitivity(model: Problem, *, point: FloatArray | None = None, jacobian: Expand = derivatives) -> Sensitivity: ...


@overload
def sensitivity(
    model: Model | FilterModel,
    logs: GivenLog | Sequence[GivenLog],
    free: str | Sequence[str | FreeParameter] = (),
    *,
    point: FloatArray | None = None,
    jacobian: Expand = derivatives,
    **posed: Unpack[Posed],
) -> Sensitivity: ...


def sensitivity(
    model: Model | FilterModel | Problem,
    logs: Any = (),
    free: str | Sequence[str | FreeParameter] = (),
    *,
    point: FloatArray | None = None,
    jacobian: Expand = derivatives,
    **posed: Unpack[Posed],
) -> Sensitivity:
    """Information of logs about parameters, before anything is estimated.

    Parameters
    ----------
    model, logs, free
        As for :func:`bondgraph.verbs.estimate`: a model or filter model with its logs, or a posed problem alone. The
        times, inputs and gaps of the logs count, and where the model stands.
    point
        Coordinates of the problem, shape (n,), which may follow a posed problem directly; None: where searches start.
    jacobian
        Gives the information and the terms it comes from; by default exact derivatives where they repay.
    **posed
        What else :func:`bondgraph.verbs.pose` takes: ``ties``, ``priors``, ``columns``, ``constants`` and so on.

    Raises
    ------
    BondGraphError
        If a log does not fit the model, a name is unknown, or the model diverges there.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> time = np.arange(100) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 100)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> list(bg.sensitivity(pendulum(), log, ["length"], process_noise="none").to_dict()["parameters"])
    ['length', 'std(deflection)']
    """
    if not isinstance(model, Problem):
        require_kind("sensitivity", model, (Model, FilterModel), "model")
        return problem_sensitivity(pose(model, logs, free, **posed), point, jacobian)
    where = logs if isinstance(logs, np.ndarray) else None
    if free or posed or (where is None and logs is not None and len(logs)):
        raise OptionError(
            "sensitivity: a posed problem has its own logs, free parameters, ties and priors - give it alone"
        )
    return problem_sensitivity(model, where if point is None else point, jacobian)


def design(
    model: Machine,
    manoeuvres: Plan | Sequence[Plan] | Mapping[str, Plan] = (),
    free: str | Sequence[str | FreeParameter] = (),
    *,
    noise: Mapping[str, float] | None = None,
    logs: GivenLog | Sequence[GivenLog] = (),
    rivals: Machine | Sequence[Machine] | Mapping[str, Machine] = (),
    error: float = ERROR,
    rate: float = 40.0,
    initial: Initial = "measured",
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    executor: str | Executor | None = "serial",
) -> Design:
    """Rank manoeuvres before anybody drives them: what they would tell of parameters, and of rival models.

    Parameters
    ----------
    model
        A model, with ``noise`` or ``logs``; a filter model, whose noises are known; a posed problem or an estimate,
        whose logs are at hand.
    manoeuvres
        What might be driven: ``Manoeuvre`` of ``bondgraph.estimate``, ``Scenario`` of ``bondgraph.simulate``, or logs
        of which times and inputs count, as read, files or data frames; one, several, or several by name.
    free
        Parameters that an estimation would free; empty: all that declare bounds. Rivals free those that they have.
    noise
        Standard deviations of sensors by output, in coherent SI.
    logs
        Logs at hand: what they tell is known before, noises that are not given are taken from them, and steps of each
        input within their range are tried too.
    rivals
        Other models of the same machine, of which one may be the true one; with logs all are fitted to them first.
    error
        Chance of a wrong decision between rivals.
    rate
        Samples of scenarios in 1/s.
    initial
        Where states start in the logs at hand.
    columns, constants
        Name of a column -> name in the model; values of inputs that a log lacks.
    executor
        Who evaluates members where rivals are fitted, see :func:`bondgraph.execute.executors.open_executor`.

    Returns
    -------
    Design
        With the tables ``information`` and ``discrimination``, the latter None without rivals.

    Raises
    ------
    BondGraphError
        If nothing is planned, no noise is known, a name is unknown, or a model diverges in a manoeuvre.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate import Scenario
    >>> from bondgraph.simulate.example import pendulum
    >>> plans = {f"from {angle}": Scenario("let go", 3.0, {}, {"angle": angle}) for angle in (0.1, 1.0)}
    >>> bg.design(pendulum(), plans, ["length", "damping"], noise={"deflection": 0.05})
    <Design of pendulum: 2 manoeuvres; best: from 1.0>
    """
    if not rate > 0.0:
        raise OptionError(f"design: a rate of {rate:g} - give samples per second above zero", where=("rate",))
    own, named = _model_of(model), _by_name([model], rivals)
    step, told = 1.0 / rate, _checked(noise or {}, [_model_of(machine) for machine in named.values()])
    with open_executor(executor) as workers:
        machines = []
        for name, machine in named.items():
            at_hand = all_matched(logs, _model_of(machine), columns, constants)
            chosen = free if machine is model else _those_of(_model_of(machine), free)
            problem, point = _posed(machine, at_hand, chosen, told, step, initial)
            machines.append(standing(name, problem, point, fitted=len(named) > 1, executor=workers))
    plans = _plans(manoeuvres, own, step, columns, constants)
    if machines[0].known is not None:
        plans += step_manoeuvres(own, machines[0].problem.logs)
    information = rank_manoeuvres(machines[0].problem, plans, machines[0].point, machines[0].known)
    return Design(own.name, information, discriminate(machines, plans, error) if len(named) > 1 else None)


def _model_of(machine: Machine) -> Model:
    problem = machine.problem if isinstance(machine, Estimate) else machine
    if isinstance(problem, EstimationProblem):
        return problem.filter_model.model
    if isinstance(problem, FilterModel):
        return problem.model
    if not isinstance(problem, Model):
        raise wrong_kind("design", problem, "model")
    return problem


def _checked(noise: Mapping[str, float], models: Sequence[Model]) -> Mapping[str, float]:
    """Noises of which each is above zero and belongs to some model."""
    known = list(dict.fromkeys(name for model in models for name in model.names("output")))
    for name, std in noise.items():
        if name not in known:
            raise OptionError(
                f"design: noise of {name!r}, but no model has that output{suggest(name, known)} - known here:"
                f" {', '.join(known)}",
                where=("noise", name),
            )
        if not std > 0.0:
            raise OptionError(
                f"design: noise of {name} {std:g} - give a standard deviation above zero", where=("noise", name)
            )
    return noise


def _by_name(
    first: Sequence[Machine], rivals: Machine | Sequence[Machine] | Mapping[str, Machine]
) -> dict[str, Machine]:
    """Machines by the names of their models or as given; a name that is taken already gets a number."""
    several = rivals.items() if isinstance(rivals, Mapping) else [(None, one) for one in _several(rivals)]
    named: dict[str, Machine] = {}
    for given, machine in [*((None, one) for one in first), *several]:
        name = given or _model_of(machine).name
        taken = sum(other.partition(" (")[0] == name for other in named)
        named[f"{name} ({taken + 1})" if taken else name] = machine
    return named


def _several(given: Any) -> list[Any]:
    """One thing or several as a list."""
    return list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [given]


def _those_of(model: Model, free: str | Sequence[str | FreeParameter]) -> list[str | FreeParameter]:
    """Free parameters that a rival has."""
    known = model.names("parameter")
    return [one for one in _several(free) if not isinstance(one, str) or one in known or "(" in one]


def _posed(
    machine: Machine,
    logs: Sequence[MatchedLog],
    free: str | Sequence[str | FreeParameter],
    noise: Mapping[str, float],
    step: float,
    initial: Initial,
) -> tuple[EstimationProblem, FloatArray | None]:
    """The problem of a machine, and where its parameters are expected if an estimate says so."""
    posed, point = (machine.problem, machine.point) if isinstance(machine, Estimate) else (machine, None)
    if isinstance(posed, EstimationProblem):
        if logs or noise or free:
            raise OptionError("design: a posed problem has its own logs, noises and free parameters - give it alone")
        return posed, point
    model = _model_of(machine)
    known = _with_noise(posed if isinstance(posed, FilterModel) else model, noise)
    if logs:
        return pose(known, logs, free, initial, process_noise="none"), None
    if not isinstance(known, FilterModel):
        raise OptionError(
            f"design: no noise of a sensor of {model.name} is known - give noise, for some of"
            f" {', '.join(model.names('output'))}, or logs",
            where=("noise",),
        )
    return pose(known, blank_log(model, step), free or bounded(model), "model"), None


def _with_noise(machine: Model | FilterModel, noise: Mapping[str, float]) -> Model | FilterModel:
    """The filter of a machine with noises of sensors that are given; a model without any stays as it is."""
    given = {name: value for name, value in noise.items() if name in _model_of(machine).names("output")}
    if isinstance(machine, FilterModel):
        return replace(machine, measurement_noise={**machine.measurement_noise, **given}) if given else machine
    return FilterModel(machine, {}, given, {}, method="auto") if given else machine


def _plans(
    given: Plan | Sequence[Plan] | Mapping[str, Plan],
    model: Model,
    step: float,
    columns: Mapping[str, str] | None,
    constants: Mapping[str, float | str] | None,
) -> list[Manoeuvre]:
    """All that might be driven, in the order in which it is given."""
    named = given.items() if isinstance(given, Mapping) else [("", one) for one in _several(given)]
    plans = []
    for k, (name, one) in enumerate(named, start=1):
        if isinstance(one, Scenario):
            plan = Manoeuvre.of_scenario(one.meaning, one, model, step)
        elif isinstance(one, Manoeuvre):
            plan = one
        else:
            plan = Manoeuvre.of_log(inputs_matched(one, model, columns, constants, f"plan{k}"))
        plans.append(replace(plan, name=name) if name else plan)
    return plans
