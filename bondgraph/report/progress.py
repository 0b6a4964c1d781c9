"""Progress of long work on a terminal: how much is done, for how long, how long it still takes, and the best so far.

Each stage that is finished leaves a line that stays.

Where the output is no terminal, a file says once a minute how far the work is: logs and pipes of short work stay clean.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import ProgressColumn as RichColumn
from rich.text import Text

from bondgraph.estimate.objective import TraceRow
from bondgraph.report.numbers import shown

#: Seconds between lines where the output is no terminal: often enough to see that work goes on. A convention.
_EVERY = 60.0


class _Rate(RichColumn):
    """Steps per second."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text(f"{shown(speed)}/s" if speed else "", style="dim")


class WorkProgress:
    """A progress line for one long task; use it as a context.

    Parameters
    ----------
    what
        What is being done: ``"estimating"``.
    total
        Number of steps, or None if it is not known.
    unit
        What a step is: ``"evaluations"``.
    console
        Where to draw; standard error by default, so that results on standard output stay alone.

    Examples
    --------
    >>> import io
    >>> with WorkProgress("searching", 100, "evaluations", Console(file=io.StringIO())) as work:
    ...     work.advance(40, best=12.5)
    >>> work.done, work.best
    (40, 12.5)
    """

    def __init__(self, what: str, total: int | None, unit: str = "", console: Console | None = None) -> None:
        self.console = console or Console(stderr=True)
        self.done, self.best, self._stage = 0, math.inf, ""
        self._what, self._unit, self._total = what, unit, total
        self._begun = self._stage_begun = self._told = time.monotonic()
        columns = (
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(bar_width=28),
            MofNCompleteColumn(),
            TextColumn(unit, style="dim"),
            _Rate(),
            TimeElapsedColumn(),
            TextColumn("left", style="dim"),
            TimeRemainingColumn(compact=True),
            TextColumn("{task.fields[best]}"),
        )
        silent = not self.console.is_terminal
        self._progress = Progress(*columns, console=self.console, transient=True, disable=silent)
        self._task = self._progress.add_task(what, total=total, best="")

    def __enter__(self) -> WorkProgress:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._finish_stage()
        self._progress.stop()

    def advance(self, steps: int = 1, best: float | None = None) -> None:
        """Some more steps are done; ``best`` is the lowest value so far, if there is one to tell."""
        self.reach(self.done + steps, best)

    def reach(self, done: int, best: float | None = None) -> None:
        """So many steps are done in total."""
        self.done = done
        if best is not None and best < self.best:
            self.best = best
        text = f"best {shown(self.best, 6)}" if math.isfinite(self.best) else ""
        self._progress.update(self._task, completed=done, best=text)
        self._tell()

    def describe(self, what: str) -> None:
        """Say what is being done now."""
        self._progress.update(self._task, description=what)

    def stage(self, name: str, done: int, total: int) -> None:
        """So many of the steps of a stage are done; a new name ends the stage before, whose line stays."""
        if name != self._stage:
            self._finish_stage()
            self._stage, self.best = name, math.inf
            self._progress.reset(self._task, total=total, description=name)
        self.done, self._total = done, total
        self._progress.update(self._task, completed=done, total=total)
        self._tell()

    def _tell(self) -> None:
        """A line on where the work is, if the output is no terminal and the last one is a minute old."""
        now = time.monotonic()
        if self.console.is_terminal or now - self._told < _EVERY:
            return
        self._told = now
        of = f"/{self._total}" if self._total else ""
        best = f", best {shown(self.best, 6)}" if math.isfinite(self.best) else ""
        done = f"{self.done}{of} {self._unit}".rstrip()
        line = f"{_clock(now - self._begun)}  {self._stage or self._what}: {done}{best}"
        self.console.print(line, highlight=False, markup=False)

    def _finish_stage(self) -> None:
        """Leave a line on the stage that ends: when it ended, what it was, its steps, its time and its best."""
        now = time.monotonic()
        if self._stage and self.console.is_terminal:
            steps = f", {self.done} {self._unit}" if self._unit else f", {self.done} steps"
            best = f", best {shown(self.best, 6)}" if math.isfinite(self.best) else ""
            line = f"{_clock(now - self._begun)}  {self._stage}{steps} in {_clock(now - self._stage_begun)}{best}"
            self._progress.console.print(line, highlight=False, markup=False)
        self._stage_begun = now

    def trace(self, row: TraceRow) -> None:
        """Take over the state of a search; pass this method as the search's ``progress``.

        The best is that of the stage that is described: another stage may have other noises or other steps, and
        likelihoods of these do not compare.
        """
        if row.stage != self._stage:
            self._finish_stage()
            self._stage, self.best = row.stage, math.inf
        self.describe(row.stage)
        self.reach(row.evaluations, row.nll)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


@contextmanager
def status(what: str, console: Console | None = None) -> Iterator[None]:
    """A turning sign with a text while something of unknown length is done; nothing where there is no terminal."""
    shown_on = console or Console(stderr=True)
    if not shown_on.is_terminal:
        yield
        return
    with shown_on.status(what):
        yield
