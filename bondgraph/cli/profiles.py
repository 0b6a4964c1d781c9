"""The command that profiles the likelihood of an estimate."""

from __future__ import annotations

import argparse
import json
import math
import sys
from concurrent.futures import Executor
from pathlib import Path

from bondgraph.cli.folders import answer_folder
from bondgraph.cli.printing import say
from bondgraph.cli.runs import model_and_logs, provenance, robust_problem, search_settings, tell_no_search
from bondgraph.cli.values import names
from bondgraph.errors import OptionError, suggest
from bondgraph.estimate.checkpoint import FILE
from bondgraph.estimate.estimation import estimate as run_estimate
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.likelihood_profile import profile_likelihood
from bondgraph.estimate.objective import SearchOutcome
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.result import Estimate
from bondgraph.execute.executors import open_executor
from bondgraph.report.profiles import ProfileAnswer, write_profile_answer
from bondgraph.report.progress import WorkProgress

#: Finished profiles stand in this file, so that the fits of a loop in the same folder stay.
_PROFILES = "profiles.json"


def profile(options: argparse.Namespace) -> int:
    """Estimate, then say how far parameters can go, and write a picture and a report."""
    model, driven, logs = model_and_logs(options)
    problem = robust_problem(options, model, driven, logs)
    wanted = _wanted(options, problem)
    folder = answer_folder(options)
    with open_executor(options.executor) as workers:
        found = _estimated(options, problem, folder, workers)
        if found.outcome is SearchOutcome.INTERRUPTED:
            raise KeyboardInterrupt
        if not math.isfinite(found.nll):
            print(f"{found.end}\nnothing is profiled", file=sys.stderr)
            return 1
        answer = _profiled(options, found, wanted, folder, workers)
    write_profile_answer(answer, folder, provenance(options, found.seconds))
    if options.json:
        print(json.dumps(answer.to_dict(), indent=1))
    else:
        say(f"{found.end}\nintegrated by {found.certification}\n{answer.text()}")
        print(f"report: {folder / 'report.html'}")
    return 0 if found.outcome.succeeded else 1


def _wanted(options: argparse.Namespace, problem: EstimationProblem) -> tuple[str, ...]:
    """The parameters of ``--of``, or all that are free, before anything is computed."""
    wanted = tuple(dict.fromkeys(names(options.of))) or problem.names
    unknown = next((name for name in wanted if name not in problem.names), None)
    if unknown is not None:
        raise OptionError(
            f"--of {unknown}: it is not free{suggest(unknown, problem.names)} - free are {', '.join(problem.names)}",
            where=("--of", unknown),
        )
    return wanted


def _estimated(
    options: argparse.Namespace, problem: EstimationProblem, folder: Path, workers: Executor | None
) -> Estimate:
    """The estimate: searched, gone on with, or with the search that another command has finished."""
    resume, kept = options.resume or bool(options.estimate), Path(options.estimate or folder)
    if options.estimate and not (kept / FILE).is_file():
        raise OptionError(
            f"--estimate {kept}: holds no {FILE} - give the folder that bondgraph estimate wrote, or leave it out",
            where=("--estimate", str(kept)),
        )
    if options.resume and not options.estimate:
        tell_no_search(folder)
    with WorkProgress("estimating", None, "evaluations") as work:
        return run_estimate(
            problem, search_settings(options), progress=work.trace, folder=kept, resume=resume, executor=workers
        )


def _profiled(
    options: argparse.Namespace, found: Estimate, wanted: tuple[str, ...], folder: Path, workers: Executor | None
) -> ProfileAnswer:
    """The profiles, of which each that is finished is noted in the folder."""
    journal = Journal(folder, file=_PROFILES)
    journal.start(options.resume)
    with WorkProgress("profiles", len(wanted), "profiles") as work:

        def progress(done: int, total: int) -> None:
            work.stage("profiles", done, total)

        return ProfileAnswer(
            found, profile_likelihood(found, wanted, options.level, workers, progress=progress, journal=journal)
        )
