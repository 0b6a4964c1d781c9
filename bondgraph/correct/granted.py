"""Time that a loop is granted: no round goes on when it is spent, and the answer is what was found by then."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from bondgraph.errors import EstimationError
from bondgraph.estimate.local import Report


@dataclass
class Clock:
    """A report that knows how long the work may take.

    Examples
    --------
    >>> told = []
    >>> clock = Clock(lambda *stage: told.append(stage), minutes=0.0)
    >>> clock("assess", 0, 1)  # what was begun is finished
    >>> strictly(clock)("score the candidates", 0, 1)  # doctest: +NORMALIZE_WHITESPACE
    Traceback (most recent call last):
        ...
    bondgraph.errors.EstimationError: the 0 minutes that were granted are spent - grant more with --minutes, in Python
    LoopSettings(minutes)
    """

    report: Report
    minutes: float
    begun: float = field(default_factory=lambda: time.monotonic())

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Report a stage, however late it is."""
        self.report(stage, done, total)

    @property
    def spent(self) -> bool:
        """True when the time is over."""
        return time.monotonic() - self.begun >= 60.0 * self.minutes

    def strict(self, stage: str, done: int, total: int) -> None:
        """The same report, which stops the work when the time is over.

        Raises
        ------
        EstimationError
            If it is.
        """
        if self.spent:
            granted = f"{self.minutes:g} minutes"
            more = "grant more with --minutes, in Python LoopSettings(minutes)"
            raise EstimationError(f"the {granted} that were granted are spent - {more}")
        self.report(stage, done, total)


def strictly(report: Report) -> Report:
    """The report that stops the work when its time is over, of one that has a time; every other as it is."""
    return report.strict if isinstance(report, Clock) else report


def in_round(report: Report, number: int) -> Report:
    """The report with the number of the round before each stage.

    Examples
    --------
    >>> told = []
    >>> in_round(lambda *stage: told.append(stage), 2)("score the candidates", 0, 1)
    >>> told
    [('round 2: score the candidates', 0, 1)]
    """
    return lambda stage, done, total: report(f"round {number}: {stage}", done, total)
