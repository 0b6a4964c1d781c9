"""Commands that run a model: simulate, filter, estimate."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

from bondgraph.build import build
from bondgraph.cli.between import inputs_between
from bondgraph.cli.fmus import is_fmu, simulate_fmu
from bondgraph.cli.folders import answer_folder
from bondgraph.cli.given_logs import read_given, read_parts
from bondgraph.cli.knowledge import posed, with_values
from bondgraph.cli.printing import say
from bondgraph.cli.tables import check_files, give_table
from bondgraph.cli.values import assignments, initial, names, set_values
from bondgraph.data.log import Log, MatchedLog
from bondgraph.data.matching import match, read_mapping
from bondgraph.data.select import decimate
from bondgraph.declare.files import load_graph
from bondgraph.declare.loading import is_model_file
from bondgraph.errors import OptionError, suggest
from bondgraph.estimate.checkpoint import FILE
from bondgraph.estimate.estimation import Settings
from bondgraph.estimate.estimation import estimate as run_estimate
from bondgraph.estimate.likelihood_profile import profile_likelihood, profile_table
from bondgraph.estimate.otherwise import with_inputs_compared
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.result import Estimate
from bondgraph.estimate.setup import filter_setup
from bondgraph.execute.executors import open_executor
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.noise import Noise
from bondgraph.filter.robust import parse_robust
from bondgraph.report.collect import versions
from bondgraph.report.estimation import limits, rough_note, write_estimate
from bondgraph.report.events import events_text, mark_events
from bondgraph.report.figures import save_figure
from bondgraph.report.filtering import filter_logs
from bondgraph.report.found import found_values, set_by, with_found_noise
from bondgraph.report.held_out import held_out_logs, held_out_table
from bondgraph.report.html import Provenance
from bondgraph.report.logs import grouped_notes
from bondgraph.report.manoeuvre import manoeuvre_figure
from bondgraph.report.misfits import misfit_sentences
from bondgraph.report.noise import noise_sentence
from bondgraph.report.plots import launch_figure
from bondgraph.report.profiles import write_profiles
from bondgraph.report.progress import WorkProgress
from bondgraph.report.scenarios import declared_noise, declared_panels, declared_scenario
from bondgraph.report.simulation import SimulationOptions, input_notes, simulate_graph, trajectory_log
from bondgraph.report.states_table import StatesTable
from bondgraph.report.tables import error_table, parameter_table, text_of
from bondgraph.simulate.model import Model
from bondgraph.text import text_table


def simulate(options: argparse.Namespace) -> int:
    """Simulate a graph over a table of inputs."""
    if options.scenario and options.inputs:
        raise OptionError("--scenario and --inputs both give the inputs - leave one out", where=("--scenario",))
    check_files((options.out, options.plot))
    if is_fmu(options.graph):
        return simulate_fmu(options)
    graph = inputs_between(load_graph(options.graph), options)
    inputs = _inputs(options)
    scenario = declared_scenario(options.graph, options.scenario) if options.scenario else None
    panels = declared_panels(options.graph) if options.plot else ()
    chosen = SimulationOptions(
        options.until, options.step, assignments(options.set, "--set"), initial(options.initial),
        options.rtol, options.atol, options.all, scenario, signals=bool(panels),
        smooth=not options.exact, mapping=read_mapping(options.map), start=options.start,
    )  # fmt: skip
    trajectory = simulate_graph(graph, inputs, chosen)
    if options.exact:
        print(events_text(trajectory), file=sys.stderr)
    trajectory.raise_if_failed()
    if scenario and scenario.left_out(trajectory.model):
        names = ", ".join(scenario.left_out(trajectory.model))
        print(f"left out, since {graph.name} does not have them: {names}", file=sys.stderr)
    if scenario is None:
        for line in input_notes(trajectory.model, inputs, chosen.values or {}, chosen.mapping):
            print(line, file=sys.stderr)
    log = trajectory_log(trajectory, inputs=True)
    if options.plot:
        title = f"{graph.name}: {scenario.meaning}" if scenario else graph.name
        figure = manoeuvre_figure(trajectory, panels, title) if panels else launch_figure(trajectory)
        mark_events(figure, trajectory)
        save_figure(figure, Path(options.plot))
        print(f"picture: {options.plot}", file=sys.stderr)
    give_table(log, options.out, bool(options.plot))
    return 0


def _inputs(options: argparse.Namespace) -> Log | None:
    """The table of inputs from ``--from`` on; where it ends, ``--until`` says to the simulation."""
    if not options.inputs:
        return None
    return read_given(options.inputs, argparse.Namespace(**{**vars(options), "until": None}))


def filter(options: argparse.Namespace) -> int:
    """Filter logs and write states with bands, innovations and consistency."""
    table = StatesTable(options.states, options.rounded)
    table.check()
    values = found_values(Path(options.found)) if options.found else {}
    model, driven, logs = model_and_logs(_with_found(options, values))
    noise: Noise | FilterModel | None = None
    if values:
        noise = with_found_noise(filter_setup(model, driven, logs).filter_model, values)
    elif not is_model_file(options.model):
        noise = declared_noise(options.model, model.name)
    made, folder = provenance(options, math.nan), answer_folder(options)
    robust = parse_robust(options.robust) if options.robust else None
    found = filter_logs(model, driven, logs, folder, options.smooth, options.start, noise, made, robust, table)
    say(found.text, whole=str(folder / "report.html"))
    return 1 if options.strict and found.misfits else 0


def _with_found(options: argparse.Namespace, values: Mapping[str, float]) -> argparse.Namespace:
    """The options with parameters set to what was found; what ``--set`` says comes after and holds."""
    if not values:
        return options
    if is_model_file(options.model):
        names = Model.from_file(options.model).names("parameter")
    else:
        names = tuple(one.name for one in load_graph(options.model).flatten().parameters)
    return argparse.Namespace(**{**vars(options), "set": [*set_by(values, names), *options.set]})


def estimate(options: argparse.Namespace) -> int:
    """Estimate parameters from logs."""
    model, driven, logs = model_and_logs(options)
    held_out = _held_out(options, model)
    problem = robust_problem(options, model, driven, logs)
    _require_free(names(options.profile or ()), problem)
    folder = answer_folder(options)
    if options.resume:
        tell_no_search(folder)
    with open_executor(options.executor) as workers:
        return _estimated(options, problem, search_settings(options), held_out, folder, workers)


def tell_no_search(folder: Path) -> None:
    """Say that there is no search to go on from, where a folder holds none."""
    if not (folder / FILE).is_file():
        print(f"no search to go on from in {folder}: starting anew", file=sys.stderr)


def robust_problem(
    options: argparse.Namespace, model: Model, driven: Sequence[str], logs: Sequence[MatchedLog]
) -> EstimationProblem:
    """The problem that options pose, with outliers weighed as ``--robust`` says."""
    problem = posed(options, model, driven, logs)
    if not options.robust:
        return problem
    return replace(problem, filter_model=replace(problem.filter_model, robust=parse_robust(options.robust)))


def search_settings(options: argparse.Namespace) -> Settings:
    """How an estimate is searched, by the options of a command."""
    return Settings(
        method=options.method, seed=options.seed, certify=options.certify, continuation=options.continuation,
        starts=options.starts,
    )  # fmt: skip


def _estimated(
    options: argparse.Namespace,
    problem: EstimationProblem,
    settings: Settings,
    held_out: Sequence[MatchedLog],
    folder: Path,
    workers: Executor | None,
) -> int:
    """Estimate, write and say what was found; the exit status."""
    with WorkProgress("estimating", None, "evaluations") as work:
        found = run_estimate(
            problem, settings, progress=work.trace, folder=folder, resume=options.resume, executor=workers
        )
        found = found if options.inputs_between else with_inputs_compared(found, work.trace)
    unseen = held_out_logs(found, held_out)
    data = write_estimate(found, folder, provenance(options, found.seconds), unseen)
    print(text_of(parameter_table(data.parameters)), end="")
    print(f"{found.end}\nnegative log-likelihood {found.nll:.4f} after {found.evaluations} evaluations")
    print(f"integrated by {found.certification}", noise_sentence(problem.filter_model), sep="\n")
    if not found.is_smooth:
        print(rough_note(found))
    if unseen:
        print(held_out_table(unseen))
        errors = [one for log in unseen for one in log.errors]
        print(text_of(error_table(errors, "held out: before and after the estimate (rms)")), end="")
    report = folder / "report.html"
    print(*limits(found), *misfit_sentences(found.misfits, report), *data.suspected, f"report: {report}", sep="\n")
    if options.profile is not None:
        _profiled(options, found, folder, workers)
    return 1 if not found.outcome.succeeded or (options.strict and found.misfits) else 0


def _require_free(profiled: Sequence[str], problem: EstimationProblem) -> None:
    """Refuse names of ``--profile`` that are not free, before anything is computed."""
    unknown = next((name for name in profiled if name not in problem.names), None)
    if unknown is not None:
        raise OptionError(
            f"--profile {unknown}: it is not free{suggest(unknown, problem.names)} - free are "
            f"{', '.join(problem.names)}",
            where=("--profile", unknown),
        )


def _profiled(options: argparse.Namespace, found: Estimate, folder: Path, workers: Executor | None) -> None:
    """Print and write profiles of an estimate, where there is something to profile."""
    told = any(map(math.isfinite, found.std.values()))
    if not math.isfinite(found.nll) or not (told or options.profile):
        print("profiles: none, since these logs tell no parameter that is free")
        return
    profiles = profile_likelihood(found, names(options.profile), executor=workers)
    print(f"{text_table(*profile_table(profiles))}\nprofiles: {write_profiles(profiles, folder)}")


def model_and_logs(options: argparse.Namespace) -> tuple[Model, tuple[str, ...], list[MatchedLog]]:
    """The model of a graph or of a generated module, the states that noise may drive, and the matched logs."""
    given: dict[str, float | str]
    if is_model_file(options.model):
        if options.inputs_between:
            raise OptionError(
                f"--inputs-between: the generated module {options.model} has that written in it - name the graph",
                where=("--inputs-between", options.model),
            )
        model, given = Model.from_file(options.model), assignments(options.set, "--set")
        driven = model.names("state")
    else:
        graph, given = set_values(inputs_between(load_graph(options.model), options), options.set)
        built = build(graph)
        model, driven = built.model, built.driven
    logs = _matched(options, options.data, model, given)
    for line in grouped_notes(logs):
        say(line, sys.stderr)
    return model, driven, logs


def _matched(
    options: argparse.Namespace, paths: Sequence[str], model: Model, given: dict[str, float | str]
) -> list[MatchedLog]:
    """Logs as the options of a command want them: columns renamed, values set, thinned to a rate."""
    mapping, inputs = read_mapping(options.map), {k: v for k, v in given.items() if k not in model.names("parameter")}
    read = [match(log, model, mapping, inputs) for path in paths for log in read_parts(path, options)]
    logs, rate = with_values(read, model, given), getattr(options, "rate", None)
    return logs if rate is None else [decimate(log, rate) for log in logs]


def _held_out(options: argparse.Namespace, model: Model) -> list[MatchedLog]:
    """Logs that an estimate is looked at with, and that decide nothing."""
    both = {*options.data} & {*options.holdout}
    if both:
        raise OptionError(
            f"{sorted(both)[0]} is given to --data and to --holdout - a log that was trained on confirms nothing",
            where=("--data", "--holdout"),
        )
    given = assignments(options.set, "--set")
    if not is_model_file(options.model):  # whose parameters are set in the graph
        given = {name: value for name, value in given.items() if name not in model.names("parameter")}
    return _matched(options, options.holdout, model, given)


def provenance(options: argparse.Namespace, duration: float) -> Provenance:
    """How a report was made, by the options of its command; a duration in s."""
    training, unseen = (tuple(Path(path).name for path in paths) for paths in (options.data, _unseen(options)))
    return Provenance(options.command_line, getattr(options, "seed", None), versions(), training, unseen, duration)


def _unseen(options: argparse.Namespace) -> Sequence[str]:
    return getattr(options, "holdout", ())
