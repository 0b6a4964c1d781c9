"""Running the cases: one file each, in this process or by the workers of an executor, and on from where it stopped."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

from bondgraph.correct.loop import close_loop
from bondgraph.errors import DataError
from bondgraph.execute.tasks import WorkerDiedError, as_done
from vehicle_graphs.effect_study.cases import Case
from vehicle_graphs.effect_study.generate import draw
from vehicle_graphs.effect_study.machine import StudyMachine
from vehicle_graphs.effect_study.scoring import Hit, Outcome, compare

#: A process is replaced after so many cases: what is compiled for each stays in its memory (50 to 300 MB).
RENEWED = 10
#: Called with an outcome as soon as it is there.
Done = Callable[[Outcome], None]


def close_case(machine: StudyMachine, case: Case) -> Outcome:
    """Simulate a case, close the loop on its logs without the truth, then compare. What stops a loop is an outcome."""
    started, used = time.monotonic(), time.process_time()
    outcome = _begun(machine, case)
    try:
        drawn = draw(machine, case)
        outcome = replace(outcome, shown=drawn.shown, left=drawn.left, promise=drawn.promise)
        functions = machine.dictionary(case.missing_functions(machine))
        closed = close_loop(machine.graph(), drawn.train, drawn.holdout, functions, machine.settings)
        outcome = compare(outcome, closed, drawn)
    except Exception as error:  # a study of failures goes on: what stopped this case stands in its row of the table
        outcome = _failed(outcome, error)
    return replace(outcome, seconds=time.monotonic() - started, processor_seconds=time.process_time() - used)


def _begun(machine: StudyMachine, case: Case) -> Outcome:
    hits = tuple(Hit(kind.label, "failed") for kind in case.kinds(machine))
    return Outcome(case.family, case.subject, case.size, case.seed, hits)


def _failed(outcome: Outcome, error: Exception) -> Outcome:
    return replace(outcome, failure=f"{type(error).__name__}: {error}")


@dataclass(frozen=True)
class Study:
    """A folder of outcomes of cases on one machine."""

    folder: Path
    machine: StudyMachine

    @property
    def settings(self) -> list[object]:
        """What outcomes of one folder have in common."""
        machine = self.machine
        return [machine.name, machine.seconds, machine.train, machine.settings.level]

    def path(self, case: Case) -> Path:
        """The file of a case."""
        return self.folder / "cases" / f"{case.name}.json"

    def known(self, case: Case) -> Outcome | None:
        """The outcome of a case that was finished before.

        Raises
        ------
        DataError
            If it belongs to another study.
        """
        path = self.path(case)
        if not path.is_file():
            return None
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["settings"] != self.settings:
            raise DataError(
                f"{path}: was made with machine, seconds, logs, level = {kept['settings']}, now asked for "
                f"{self.settings} - take another folder or remove this one",
                where=(str(path),),
            )
        return Outcome.read(kept["outcome"])

    def keep(self, case: Case, outcome: Outcome) -> None:
        """Write an outcome."""
        path = self.path(case)
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        content = {"settings": self.settings, "outcome": outcome.written()}
        partial.write_text(json.dumps(content, indent=1), encoding="utf-8")
        partial.replace(path)

    def run(
        self, cases: Sequence[Case], done: Done, executor: Executor | None = None, until: float | None = None
    ) -> list[Outcome]:
        """The outcomes of all cases: from their files, or computed and written there.

        Parameters
        ----------
        cases
            In the order in which they are taken.
        done
            Called with every outcome.
        executor
            Whose workers take the cases, see :mod:`bondgraph.execute`; None: one after the other in this process.
        until
            Time of :func:`time.monotonic` after which no further case is begun.

        Raises
        ------
        DataError
            If the folder holds outcomes of another study.
        """
        found: dict[Case, Outcome] = {}
        for case in cases:
            kept = self.known(case)
            if kept is not None:
                found[case] = kept
                done(kept)
        due = [case for case in cases if case not in found]
        for case, outcome in _taken(self.machine, due, executor, until):
            self.keep(case, outcome)
            found[case] = outcome
            done(outcome)
        return [found[case] for case in cases if case in found]


def _taken(
    machine: StudyMachine, cases: Sequence[Case], executor: Executor | None, until: float | None
) -> Iterator[tuple[Case, Outcome]]:
    """Cases with their outcomes as they are finished."""

    def died(position: int, error: WorkerDiedError) -> Outcome:
        return _failed(_begun(machine, cases[position]), error)

    # of the clock, which processes share
    end = None if until is None else time.time() + until - time.monotonic()
    tasks = [(machine, case, end) for case in cases]
    for position, outcome in as_done(executor, _in_time, tasks, died):
        if outcome is not None:
            yield cases[position], outcome


def _in_time(machine: StudyMachine, case: Case, until: float | None) -> Outcome | None:
    """The outcome of a case, None if its time is over."""
    return None if until is not None and time.time() > until else close_case(machine, case)
