"""Closing the loop on logs as a user holds them; its result with graph, tables and report."""

from __future__ import annotations

import functools
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields, replace

import numpy as np

from bondgraph.build import build
from bondgraph.correct.loop import ClosedLoop, LoopSettings
from bondgraph.correct.loop import close_loop as close_matched
from bondgraph.data.given import GivenLog, all_matched
from bondgraph.data.log import MatchedLog
from bondgraph.declare.effect import EFFECTS, EffectFunction, effect_functions
from bondgraph.declare.files import load_graph
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.loading import load_module
from bondgraph.errors import OptionError, require_kind
from bondgraph.estimate.local import Report, no_report
from bondgraph.execute.executors import open_executor
from bondgraph.report.collect import versions
from bondgraph.report.html import Provenance
from bondgraph.report.saved_correction import AbstractCorrection, SavedCorrection, declared_graph, saved_correction


@dataclass(frozen=True, repr=False)
class Correction(ClosedLoop, AbstractCorrection):
    """A closed loop with its corrected graph and its report; ``made`` says how it came about.

    :meth:`save` keeps all but fits, runs and candidates, and :meth:`load` reads it: the same numbers, tables, plots and
    pages in another process.
    """

    made: Provenance = field(default_factory=lambda: Provenance("bondgraph.close_loop"))

    @functools.cached_property
    def kept(self) -> SavedCorrection:
        """What a file keeps of it."""
        return saved_correction(self, self.made)

    @property
    def graph(self) -> BondGraph:
        """The declaration with the added effects and the estimated values."""
        return self.corrected_graph

    @property
    def declared(self) -> BondGraph:
        """The graph as it was declared."""
        return declared_graph(self)

    @property
    def _module(self) -> str:
        return self.corrected_text


def close_loop(
    graph: BondGraph | str,
    train: GivenLog | Sequence[GivenLog],
    holdout: GivenLog | Sequence[GivenLog] = (),
    effects: Sequence[EffectFunction] | None = None,
    settings: LoopSettings | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float | str] | None = None,
    progress: Report = no_report,
    executor: str | Executor | None = "serial",
    across_gaps: bool = False,
) -> Correction:
    """Find what a declared graph lacks, from measured logs.

    Parameters
    ----------
    graph
        The declared graph, or a reference such as ``sled.py:sled``. Parameters with bounds are free unless
        ``settings.free`` names others.
    train, holdout
        Logs as read, matched, files or data frames. Held-out logs are assessed and decide nothing.
    effects
        Effect functions to try; None: those of the toolkit.
    settings
        Levels and limits.
    columns
        Name of a column -> name in the model, where they differ.
    constants
        Values (or letters) of inputs that a log lacks.
    progress
        Called with a stage, its step and the number of its steps.
    executor
        Who computes the fits, ``"processes:2"`` or ``"dask://host:8786"``, see
        :func:`bondgraph.execute.executors.open_executor`; it changes no number.
    across_gaps
        Lead models across jumps in time. If not, parts between jumps are logs of their own, see
        :func:`bondgraph.data.select.split_at_gaps`.

    Raises
    ------
    BondGraphError
        If the graph is refused, a log does not fit it or is both trained on and held out, or there is too little in
        the logs to estimate anything.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("sled")
    >>> body = g.one_junction("body", bg.TRANSLATION)
    >>> _ = g.inertance("mass", 80.0, at=body)
    >>> bg.close_loop(g, train=[])
    Traceback (most recent call last):
        ...
    bondgraph.errors.DataError: sled: no training log - give at least one with --data
    """
    started = time.monotonic()
    require_kind("close_loop", graph, (BondGraph, str), "graph")
    declared = load_graph(graph) if isinstance(graph, str) else graph
    model = build(declared).model
    training = all_matched(train, model, columns, constants, "train", not across_gaps)
    held_out = all_matched(holdout, model, columns, constants, "holdout", not across_gaps)
    _refuse_both(training, held_out)
    functions = effect_functions(load_module(EFFECTS)) if effects is None else effects
    own = settings or LoopSettings()
    with open_executor(executor) as workers:
        journal = own.journal if workers is None else replace(own.journal, executor=workers)
        closed = close_matched(declared, training, held_out, functions, replace(own, journal=journal), progress)
    names = [tuple(log.name for log in logs) for logs in (training, held_out)]
    made = Provenance("bondgraph.close_loop", None, versions(), names[0], names[1], time.monotonic() - started)
    return Correction(**{one.name: getattr(closed, one.name) for one in fields(ClosedLoop)}, made=made)


def _refuse_both(training: Sequence[MatchedLog], held_out: Sequence[MatchedLog]) -> None:
    for log in held_out:
        for other in training:
            if _is_same(log, other):
                raise OptionError(
                    f"close_loop: {log.name} is given to train and to holdout - a log that was trained on confirms "
                    "nothing",
                    where=("train", "holdout"),
                )


def _is_same(log: MatchedLog, other: MatchedLog) -> bool:
    """True for two logs that hold the same numbers, whatever they are called."""
    pairs = ((log.time, other.time), (log.u, other.u), (log.y, other.y))
    return all(np.array_equal(one, another, equal_nan=True) for one, another in pairs)
