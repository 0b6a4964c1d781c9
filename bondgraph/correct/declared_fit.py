"""Where a loop begins: the declared model, fitted to the training logs with its integration steps certified.

A log says nothing of its inputs between the samples. Straight lines lead an input that is held there, a controller's
output, by half a sample, and whatever comes late, a lag or a delay, would make good for that. So an input that is
constant in pieces in all logs is tried held as well. The two ways have the same parameters: the likelier is taken where
the odds are those of strong evidence. What the machine lacks may make held inputs likelier too, a late sensor above
all, or hide that they are: so the other way is tried once more with what was found, see :func:`held_after_all`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.correct.constants import INDIFFERENT, MEASUREMENTS_EACH
from bondgraph.correct.evidence.certified import refined
from bondgraph.correct.evidence.floors import without_floors
from bondgraph.correct.fits.rates import rated, with_followed_rates
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.models.resting import RESTING, with_resting_state
from bondgraph.data.log import MatchedLog
from bondgraph.declare.editing import with_inputs_between
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.quantities import Interpolation
from bondgraph.errors import DataError
from bondgraph.estimate.certify import Check
from bondgraph.estimate.declared import free_parameters
from bondgraph.estimate.derivatives.linearised import is_linearised
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.free import FreeParameter, parse_target
from bondgraph.estimate.initial import InitialRule
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import Report, fit
from bondgraph.estimate.noise_starts import noisy_starts, quiet_start
from bondgraph.estimate.otherwise import lost_otherwise, moving_inputs
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.searches import with_longest_steps
from bondgraph.estimate.setup import FilterSetup, filter_setup
from bondgraph.text import few, inflected, number

#: The declared model is fitted to this many nats, far below what an effect must gain.
_TOLERANCE = 0.05
_MOST_ITERATIONS = 60


class Wishes(Protocol):
    """Wishes of a user for the fit of the declared model."""

    @property
    def process_noise(self) -> str:
        """As in :func:`bondgraph.estimate.setup.filter_setup`."""

    @property
    def free(self) -> tuple[str, ...]:
        """Names of what is free; none: all parameters with bounds."""

    @property
    def journal(self) -> Journal:
        """Finished fits."""

    @property
    def inputs_as_declared(self) -> bool:
        """True where inputs run between samples as declared, whatever the logs say."""

    @property
    def initial(self) -> InitialRule:
        """The rule by which states begin."""


@dataclass(frozen=True)
class DeclaredFit:
    """The declared model and its fit, with what was set up for it, and logs matched to it.

    ``graph`` may have rates among its inputs that no equation uses; ``held`` are inputs that are taken as held against
    the declaration, and ``cautions`` say so. ``straight`` are sets of inputs that run straight between samples and may
    be held: those that are constant in ``pieces``, and all.
    """

    graph: BondGraph
    built: BuiltModel
    setup: FilterSetup
    fit: Fit
    check: Check
    train: tuple[MatchedLog, ...]
    holdout: tuple[MatchedLog, ...]
    held: tuple[str, ...] = ()
    cautions: tuple[str, ...] = ()
    straight: tuple[tuple[str, ...], ...] = ()
    pieces: tuple[str, ...] = ()


@dataclass(frozen=True)
class HeldAfterAll:
    """Inputs that are held between samples after all, ``nats`` likelier than straight lines beside a law.

    ``beside`` is false where held inputs alone do as much as that. ``pieces`` are those that are constant in pieces.
    """

    names: tuple[str, ...]
    nats: float
    beside: bool
    pieces: tuple[str, ...]


def fit_declared(
    graph: BondGraph, train: Sequence[MatchedLog], holdout: Sequence[MatchedLog], wishes: Wishes, report: Report
) -> DeclaredFit:
    """The declared model fitted to training logs, inputs that are constant in pieces held where that is likelier.

    Raises
    ------
    DataError
        If the logs hold too little.
    EstimationError
        If the model cannot be fitted at all.
    BondGraphError
        If the graph is refused.
    """
    report("fit the declared model", 0, 1)
    found = _fitted(graph, train, holdout, wishes)
    every = [] if wishes.inputs_as_declared else moving_inputs(found.built.model, found.train, "linear")
    names = tuple(one.name for one in every if one.in_pieces)
    sets = dict.fromkeys((names, tuple(one.name for one in every)))
    found = replace(found, straight=tuple(one for one in sets if one), pieces=names)
    if names and _otherwise(found.fit, found.built, _held(names), wishes.journal) < -INDIFFERENT:
        held = attempted(lambda: _held_fit(graph, train, holdout, wishes, names), lambda why: None)
        if held is not None and held.fit.nll < found.fit.nll - INDIFFERENT:
            found = replace(held, cautions=(_said(HeldAfterAll(names, found.fit.nll - held.fit.nll, False, names)),))
    report("fit the declared model", 1, 1)
    return found


def fit_held(
    graph: BondGraph, train: Sequence[MatchedLog], holdout: Sequence[MatchedLog], wishes: Wishes, after: HeldAfterAll
) -> DeclaredFit | None:
    """The declared model with inputs held that a law has shown to be; None where it cannot be fitted."""
    held = attempted(lambda: _held_fit(graph, train, holdout, wishes, after.names), lambda why: None)
    return None if held is None else replace(held, cautions=(_said(after),))


def _held_fit(
    graph: BondGraph,
    train: Sequence[MatchedLog],
    holdout: Sequence[MatchedLog],
    wishes: Wishes,
    names: tuple[str, ...],
) -> DeclaredFit:
    return replace(_fitted(with_inputs_between(graph, **_held(names)), train, holdout, wishes), held=names)


def held_after_all(
    begun: DeclaredFit, before: tuple[Fit, BuiltModel], after: tuple[Fit, BuiltModel], journal: Journal
) -> HeldAfterAll | None:
    """Inputs that a law shows to be held between samples, with which all begins anew; None where it does not.

    Parameters
    ----------
    begun
        The fit of the declared model; some of its inputs run straight.
    before, after
        Fits with their models, without the law and with it.
    journal
        Finished fits.

    What is missing hides half a sample, and a delay or lag would make good for it in the end. So with a law in the
    model both ways are compared again, of inputs that move at every sample too, which a controller may give; and a law
    that does no more than held inputs do alone is none.
    """
    found = []
    for names in begun.straight:
        alone = _otherwise(*before, _held(names), journal)
        if before[0].nll + alone < after[0].nll + INDIFFERENT:
            found.append(HeldAfterAll(names, -alone, False, begun.pieces))
            continue
        beside = _otherwise(*after, _held(names), journal)
        if beside < -INDIFFERENT:
            found.append(HeldAfterAll(names, -beside, True, begun.pieces))
    return max(found, key=lambda one: one.nats, default=None)


def straight_is_likelier(begun: DeclaredFit, fitted: Fit, built: BuiltModel, journal: Journal) -> bool:
    """True where a corrected model is likelier with straight lines where inputs were taken as held."""
    return _otherwise(fitted, built, dict.fromkeys(begun.held, "linear"), journal) < -INDIFFERENT


def _held(names: Sequence[str]) -> dict[str, Interpolation]:
    return dict.fromkeys(names, "hold")


def _otherwise(fitted: Fit, built: BuiltModel, ways: Mapping[str, Interpolation], journal: Journal) -> float:
    """Nats by which a fitted model gets worse with its inputs otherwise between samples, searched from where it is."""
    return attempted(
        lambda: lost_otherwise(fitted, build(with_inputs_between(built.graph, **ways)).model, journal), lambda why: 0.0
    )


def _said(after: HeldAfterAll) -> str:
    verb, pieces = inflected(after.names, "is", "are"), set(after.names) <= set(after.pieces)
    said = f"{verb} constant in pieces, and " if pieces else ""
    beside = " beside what was found first" if after.beside else ""
    return (
        f"{few(list(after.names))} {said}{verb} taken as held between samples, {number(after.nats)} nats likelier than "
        f"straight lines{beside} - declare hold=True for what a controller gives, or say --inputs-between linear for "
        "what was measured"
    )


def _fitted(
    graph: BondGraph, train: Sequence[MatchedLog], holdout: Sequence[MatchedLog], wishes: Wishes
) -> DeclaredFit:
    before = build(graph)
    graph = with_followed_rates(graph if before.model.states else with_resting_state(graph))
    built = before if graph is before.graph else build(graph)
    if built is not before:
        train, holdout = rated(train, before.model, built.model), rated(holdout, before.model, built.model)
    setup = filter_setup(built.model, [name for name in built.driven if name != RESTING], train, wishes.process_noise)
    free = _all_free(setup, wishes.free)
    _check_enough(graph, train, len(free))
    problem = EstimationProblem(setup.filter_model, tuple(train), free, wishes.initial)
    found = without_floors(_by_long_steps(problem, wishes.journal), wishes.journal)
    found, check = refined(found, wishes.journal, setup.filter_model.substeps)  # before anything is scored
    return DeclaredFit(graph, built, setup, found, check, tuple(train), tuple(holdout))


def _by_long_steps(problem: EstimationProblem, journal: Journal) -> Fit:
    """The fit of a problem, of a stiff model with steps as long as they lead anywhere: a certificate shortens them.

    Its steps are set before anything is fitted, for noises that are guessed, and were four times too short then.
    """
    starts, first = noisy_starts(problem.free), quiet_start(problem.free, problem.start)

    def fitted(posed: EstimationProblem) -> Fit:
        return fit(posed, _MOST_ITERATIONS, _TOLERANCE, starts, journal=journal, first=first)

    if not is_linearised(problem):
        return fitted(problem)
    longer = with_longest_steps(problem, starts)
    return fitted(problem) if longer is problem else attempted(lambda: fitted(longer), lambda why: fitted(problem))


def _check_enough(graph: BondGraph, train: Sequence[MatchedLog], free: int) -> None:
    measured = sum(int(np.isfinite(log.y).sum()) for log in train)
    if measured < MEASUREMENTS_EACH * free:
        raise DataError(
            f"{graph.name}: {measured} measurements in {', '.join(log.name for log in train)} are too few for {free} "
            f"free parameters and noise levels - give longer logs, at least {MEASUREMENTS_EACH * free} measurements"
        )


def _all_free(setup: FilterSetup, names: Sequence[str]) -> tuple[FreeParameter, ...]:
    """The named parameters, or all with bounds, and all noise levels, which are free whether named or not.

    A machine all of whose parameters were measured may lack an effect too.
    """
    noise = {one.target for one in setup.noise}
    named = [name for name in names if parse_target(name) not in noise]
    bounded = any(info.lower is not None for info in setup.filter_model.model.parameters)
    return (*(free_parameters(setup, named) if bounded or named else ()), *setup.noise)
