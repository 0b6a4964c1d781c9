"""Commands that close the loop: close-loop on measured logs, demo on simulated ones."""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from bondgraph.build import build
from bondgraph.cli.between import inputs_between
from bondgraph.cli.effects import chosen_effects, without_place
from bondgraph.cli.folders import answer_folder
from bondgraph.cli.given_logs import read_given
from bondgraph.cli.printing import say
from bondgraph.cli.values import names, set_values
from bondgraph.correct.loop import ClosedLoop, LoopSettings
from bondgraph.correct.loop import close_loop as run_loop
from bondgraph.data.matching import read_mapping
from bondgraph.declare.effect import EffectFunction
from bondgraph.declare.files import load_graph
from bondgraph.declare.graph import BondGraph
from bondgraph.estimate.journal import Journal
from bondgraph.execute.executors import open_executor
from bondgraph.files import output_folder
from bondgraph.report.closed_loop import compare_with_truth, summary
from bondgraph.report.collect import versions
from bondgraph.report.html import Provenance
from bondgraph.report.logs import Splits, training_and_held_out
from bondgraph.report.progress import WorkProgress
from bondgraph.report.python_lines import write_python
from bondgraph.report.saved_correction import write_closed_loop


def close_loop(options: argparse.Namespace) -> int:
    """Find what a declared graph lacks, from measured logs."""
    declared = load_graph(options.graph)
    functions = chosen_effects(options.effects, options.without)
    graph, given = set_values(inputs_between(declared, options), options.set)
    logs = training_and_held_out(
        build(graph).model, options.data, options.holdout, read_mapping(options.map), options.rate, given,
        lambda path: read_given(path, options), options.across_gaps,
    )  # fmt: skip
    for line in logs.said:
        say(line, sys.stderr)
    closed, made = _closed(options, graph, logs, functions)
    known = {one.candidate.function.__name__ for turn in closed.rounds for one in turn.trials}
    known |= {one.effect for turn in closed.rounds for one in turn.refused}
    if unheard := without_place(options.effects, known):
        say(unheard, sys.stderr)
    told = summary(write_closed_loop(closed, Path(options.out), made, said=logs.split, declared=declared))
    say(told, whole=str(Path(options.out) / "report.html"))
    contradicted = closed.verdict == "effect not confirmed"
    print(*write_python(Path(options.out), declared, closed.corrected_graph, options.graph, contradicted), sep="\n")
    print(f"report: {Path(options.out) / 'report.html'}")
    return 0


def demo(options: argparse.Namespace) -> int:
    """Simulate a machine with an undeclared effect, close the loop on its logs, then compare with the truth."""
    bench = importlib.import_module(options.module)
    functions = chosen_effects(options.effects, options.without)
    folder = output_folder(Path(options.out))
    print(f"seed {options.seed}: simulating drives of a machine with an effect that {bench.GRAPH} does not declare")
    missing = None if options.no_effect else bench.pick(options.seed)
    data, holdout, truth = bench.write_drives(options.seed, folder, missing)
    graph = load_graph(bench.GRAPH)
    print(f"closing the loop on {', '.join(path.name for path in data)}; {holdout[0].name} is held out")
    logs = training_and_held_out(build(graph).model, data, holdout, {}, options.rate)
    closed, made = _closed(options, graph, logs, functions)
    print(summary(write_closed_loop(closed, folder, made)))
    print(f"report: {folder / 'report.html'}")
    answer = compare_with_truth(closed, truth.effect, truth.junction, truth.coefficients)
    write_closed_loop(closed, folder, made, {"truth": dataclasses.asdict(truth), "correct": answer.correct})
    print(f"\nonly now the truth: {answer.text}")
    return 0 if answer.correct else 1


def _closed(
    options: argparse.Namespace, graph: BondGraph, logs: Splits, functions: Sequence[EffectFunction]
) -> tuple[ClosedLoop, Provenance]:
    """The closed loop, and how it was made."""
    started = time.monotonic()
    journal = _journal(options)
    with open_executor(options.executor) as workers, WorkProgress("closing the loop", None) as work:
        settings = LoopSettings(
            level=options.level, max_effects=options.max_effects, refits=options.refits,
            minutes=options.minutes,
            process_noise=options.process_noise,
            free=tuple(names(options.free)), faults=not options.no_faults, tables=options.tables,
            journal=replace(journal, executor=workers), without=tuple(names(options.without)),
            inputs_as_declared=bool(getattr(options, "inputs_between", [])),
            initial=getattr(options, "start", "measured"),
        )  # fmt: skip

        def report(stage: str, done: int, total: int) -> None:
            work.stage(stage, done, total)

        closed = run_loop(graph, logs.training, logs.held_out, functions, settings, report)
    seed = getattr(options, "seed", None)
    made = Provenance(
        options.command_line, seed, versions(), _names(logs.training), _names(logs.held_out), time.monotonic() - started
    )
    return closed, made


def _journal(options: argparse.Namespace) -> Journal:
    """The journal of finished fits in the folder of the answer, begun anew unless it is to be gone on from."""
    journal = Journal(answer_folder(options))
    if options.resume and not journal.exists:  # it was stopped before the first fit was finished
        print(f"no finished fits in {options.out}: starting anew", file=sys.stderr)
    journal.start(options.resume)
    return journal


def _names(logs: Sequence[object]) -> tuple[str, ...]:
    return tuple(str(getattr(log, "name", "")) for log in logs)
