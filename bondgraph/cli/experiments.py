"""Commands that ask before an experiment or an estimation: sensitivity, design."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace

from bondgraph.build import BuiltModel, build
from bondgraph.cli.between import inputs_between
from bondgraph.cli.folders import answer_folder
from bondgraph.cli.given_logs import read_given, read_parts
from bondgraph.cli.knowledge import posed
from bondgraph.cli.runs import model_and_logs, provenance
from bondgraph.cli.values import assignments, names, set_values
from bondgraph.data.log import MatchedLog
from bondgraph.data.matching import match, match_inputs, match_outputs, read_mapping, renamed
from bondgraph.declare.files import load_graph
from bondgraph.declare.loading import is_model_file
from bondgraph.errors import OptionError, suggest
from bondgraph.estimate.analysis.ranking import rank_parameters
from bondgraph.estimate.analysis.rates import rate_table
from bondgraph.estimate.analysis.screening import (
    GlobalSensitivity,
    Response,
    global_sensitivity,
    likelihood_response,
    output_response,
    problem_bounds,
)
from bondgraph.estimate.declared import declared_problem
from bondgraph.estimate.design.answer import Design, standing
from bondgraph.estimate.design.discrimination import DiscriminationTable, Rival, discriminate
from bondgraph.estimate.design.information import rank_manoeuvres
from bondgraph.estimate.design.manoeuvres import Manoeuvre, blank_log, step_manoeuvres
from bondgraph.estimate.problem import EstimationProblem, pose
from bondgraph.execute.executors import open_executor
from bondgraph.files import finite
from bondgraph.filter.filter_model import FilterModel
from bondgraph.report.design import write_design
from bondgraph.report.scenarios import declared_noise, declared_scenario
from bondgraph.report.sensitivity import SensitivityAnswer, write_sensitivity
from bondgraph.simulate.model import Model


def sensitivity(options: argparse.Namespace) -> int:
    """Say which parameters logs can tell, and write a picture and a report."""
    rates = [_rate(text) for text in names(options.rates)]
    _refuse_unasked(options)
    model, driven, logs = model_and_logs(options)
    known = _declared_filter(options.model, model) if options.declared_noise else None
    problem = posed(options, model, driven, logs, known)
    folder = answer_folder(options)
    with open_executor(options.executor) as workers:
        screened = tuple(_screened(options, problem, workers)) if options.screen else ()
    answer = SensitivityAnswer(
        model.name, rank_parameters(problem), screened, rate_table(problem, rates) if rates else None
    )  # fmt: skip
    write_sensitivity(answer, folder, provenance(options, math.nan))
    print(json.dumps(finite(answer.to_dict()), indent=1) if options.json else answer.text())
    if not options.json:
        print(f"report: {folder / 'report.html'}")
    return 0


def _rate(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (value > 0.0 and math.isfinite(value)):
        raise OptionError(f"--rates {text}: give samples per second, such as 40,20,10,5", where=("--rates", text))
    return value


def _refuse_unasked(options: argparse.Namespace) -> None:
    """Refuse options of ``--global`` without it: they would change nothing."""
    for option, given in (("--response", options.response), ("--samples", options.samples)):
        if given and not options.screen:
            raise OptionError(f"{option}: it is one of --global - add --global morris or sobol", where=(option,))


def _screened(
    options: argparse.Namespace, problem: EstimationProblem, workers: Executor | None
) -> list[GlobalSensitivity]:
    """Global sensitivities of the responses that were asked."""
    if options.seed < 0:
        raise OptionError(f"--seed {options.seed}: give a whole number of at least 0", where=("--seed",))
    found = []
    for asked in names(options.response) or ["likelihood"]:
        response: Response
        if asked == "likelihood":
            response, meaning = likelihood_response(problem), "negative log-likelihood"
        else:
            output, _, reduction = asked.partition(":")
            response, meaning = output_response(problem, output, reduction or "rms"), asked  # type: ignore[arg-type]
        how = {"samples": options.samples, "seed": options.seed, "meaning": meaning}
        found.append(global_sensitivity(response, problem_bounds(problem), options.screen, executor=workers, **how))
    return found


def _declared_filter(reference: str, model: Model) -> FilterModel:
    noise = None if is_model_file(reference) else declared_noise(reference, model.name)
    if noise is None:
        raise OptionError(
            f"{reference} declares no noise for {model.name} - declare NOISE in the module of the graph, or leave"
            " --declared-noise out",
            where=("--declared-noise", reference),
        )
    return noise.filter_model(model)


def design(options: argparse.Namespace) -> int:
    """Say what planned manoeuvres would tell, and write pictures and a report."""
    if not (options.rate > 0.0 and math.isfinite(options.rate)):
        raise OptionError(f"--rate {options.rate:g}: give samples per second above zero", where=("--rate",))
    with open_executor(options.executor) as workers:
        machines = [_machine(options, reference, workers) for reference in (options.model, *options.rival)]
    folder = answer_folder(options)
    first = machines[0]
    manoeuvres = _manoeuvres(options, first)
    answer = Design(
        first.problem.filter_model.model.name,
        rank_manoeuvres(first.problem, manoeuvres, first.point, first.known),
        _told_apart(options, machines, manoeuvres),
    )
    write_design(answer, folder, provenance(options, math.nan))
    print(json.dumps(finite(answer.to_dict()), indent=1) if options.json else answer.summary())
    if not options.json:
        print(f"report: {folder / 'report.html'}")
    return 0


def _told_apart(
    options: argparse.Namespace, machines: Sequence[Rival], manoeuvres: Sequence[Manoeuvre]
) -> DiscriminationTable | None:
    return discriminate(machines, manoeuvres, options.error) if len(machines) > 1 else None


def _machine(options: argparse.Namespace, reference: str, workers: Executor | None) -> Rival:
    """A model with its noises, what is free in it, and where it stands: as declared, or fitted to logs at hand."""
    if is_model_file(reference):
        raise OptionError(f"{reference}: design takes declared graphs - name the graph", where=(reference,))
    graph, given = set_values(inputs_between(load_graph(reference), options), options.set)
    built = build(graph)
    mapping = read_mapping(options.map)
    logs = [match(log, built.model, mapping, given) for path in options.data for log in read_parts(path, options)]
    wanted = [name for name in names(options.free) if name in built.model.names("parameter") or "(" in name]
    if not logs:
        model = built.model
        blank = blank_log(model, 1.0 / options.rate)
        chosen = wanted or [info.name for info in model.parameters if info.lower is not None]
        problem = pose(_planned_filter(options, reference, model), blank, chosen, "model")
        return standing(reference, problem)
    return _fitted(options, reference, built, logs, wanted, workers)


def _fitted(
    options: argparse.Namespace,
    reference: str,
    built: BuiltModel,
    logs: Sequence[MatchedLog],
    wanted: list[str],
    workers: Executor | None,
) -> Rival:
    """A rival at its best on the logs at hand; without rivals where it is declared."""
    if options.noise or declared_noise(reference, built.model.name) is not None:
        chosen = wanted or [info.name for info in built.model.parameters if info.lower is not None]
        problem = pose(_planned_filter(options, reference, built.model), logs, chosen, options.start)
    else:
        problem = declared_problem(built.model, built.driven, logs, wanted, "none", options.start)
    return standing(reference, problem, fitted=bool(options.rival), executor=workers)


def _planned_filter(options: argparse.Namespace, reference: str, model: Model) -> FilterModel:
    """The filter of a plan: noises as given, or as declared beside the graph."""
    given = assignments(options.noise, "--noise")
    noise = declared_noise(reference, model.name)
    outputs = {info.name: info for info in model.outputs}
    sensors = {}
    for name, value in given.items():
        if not isinstance(value, float) or not value > 0.0:
            raise OptionError(
                f"--noise {name}={value}: give a standard deviation above zero, a space before the next NAME=STD",
                where=("--noise", name),
            )
        if name not in outputs and not options.rival:  # a rival may have it
            raise OptionError(
                f"--noise {name}: {model.name} has no output {name!r}{suggest(name, outputs)} - it has"
                f" {', '.join(outputs)}",
                where=("--noise", name),
            )
        if name in outputs:
            sensors[name] = outputs[name].coherent(value) - outputs[name].coherent(0.0)
    if noise is None and not sensors:
        raise OptionError(
            f"{reference}: no noise of a sensor is known - give --noise OUTPUT=STD for some of {', '.join(outputs)},"
            " or logs by --data",
            where=("--noise", reference),
        )
    if noise is None:
        return FilterModel(model, {}, sensors, {}, method="auto")
    declared = noise.filter_model(model)
    return replace(declared, measurement_noise={**declared.measurement_noise, **sensors})


def _manoeuvres(options: argparse.Namespace, first: Rival) -> list[Manoeuvre]:
    model = first.problem.filter_model.model
    found = [
        Manoeuvre.of_scenario(name, declared_scenario(options.model, name), model, 1.0 / options.rate)
        for name in names(options.scenario)
    ]
    mapping, given = read_mapping(options.map), set_values(load_graph(options.model), options.set)[1]
    for path in options.inputs:
        log = renamed(read_given(path, options), model, mapping)
        y = match_outputs(log, model)
        found.append(Manoeuvre.of_log(MatchedLog(log.name, log.time, match_inputs(log, model, given), y)))
    if options.data:
        found += step_manoeuvres(model, first.problem.logs)
    if not found:
        raise OptionError(
            "design: no manoeuvre is planned - give --scenario NAME ..., --inputs FILE ..., or logs at hand by --data",
            where=("--scenario",),
        )
    return found
