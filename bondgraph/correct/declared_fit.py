"""Where a loop begins: the declared model, fitted to the training logs with its integration steps certified.

A log says nothing of its inputs between the samples. Straight lines lead an input that is held there, a controller's
output, by half a sample, and whatever comes late, a lag or a delay, would make good for that. So an input that is
constant in pieces in all logs is tried held as well. They weaken one that moves quickly, too: a signal behind a filter
is band limited, and is tried as such where that is another course. All ways have the same parameters: the likeliest is
taken where the odds are those of strong evidence. What the machine lacks may make held inputs likelier too, a late
sensor above all, or hide that they are: so the other way is tried once more with what was found, see
:func:`otherwise_after_all`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from bondgraph.build import BuiltModel, build
from bondgraph.correct.constants import INDIFFERENT, MEASUREMENTS_EACH
from bondgraph.correct.evidence.certified import refined
from bondgraph.correct.evidence.floors import without_floors
from bondgraph.correct.fits.rates import rated, with_followed_rates
from bondgraph.correct.gauge import with_gauge
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.models.resting import RESTING, with_resting_state
from bondgraph.data.log import FloatArray, MatchedLog
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
from bondgraph.estimate.inputs_before import with_inputs_before
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import Report, fit
from bondgraph.estimate.noise_starts import noisiest_start, noisy_starts, quiet_start
from bondgraph.estimate.otherwise import curved_inputs, lost_otherwise, moving_inputs
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

    ``graph`` may have rates among its inputs that no equation uses; ``otherwise`` says how inputs run between samples
    against the declaration, and ``cautions`` say so. ``straight`` are sets of inputs that may run another way than they
    do: held, those that are constant in ``pieces`` and all; band limited, those that are quick.
    """

    graph: BondGraph
    built: BuiltModel
    setup: FilterSetup
    fit: Fit
    check: Check
    train: tuple[MatchedLog, ...]
    holdout: tuple[MatchedLog, ...]
    otherwise: Mapping[str, Interpolation] = field(default_factory=dict)
    cautions: tuple[str, ...] = ()
    straight: tuple[Between, ...] = ()
    pieces: tuple[str, ...] = ()

    def running(self, way: Interpolation) -> tuple[str, ...]:
        """Inputs that run a way between samples against the declaration."""
        return tuple(name for name, own in self.otherwise.items() if own == way)


@dataclass(frozen=True)
class Between:
    """Inputs that may run another way between samples than straight."""

    names: tuple[str, ...]
    way: Interpolation

    @property
    def ways(self) -> dict[str, Interpolation]:
        """The way of each of them."""
        return dict.fromkeys(self.names, self.way)

    @property
    def words(self) -> str:
        """The way in words."""
        return "held" if self.way == "hold" else self.way


@dataclass(frozen=True)
class OtherwiseAfterAll:
    """Inputs that run another way between samples after all, ``nats`` likelier than as they did, beside a law.

    ``beside`` is false where that way alone does as much as the law. ``pieces`` are inputs that are constant in pieces.
    ``than`` says in words how they ran before.
    """

    inputs: Between
    nats: float
    beside: bool
    pieces: tuple[str, ...]
    than: str = "straight lines"


def fit_declared(
    graph: BondGraph, train: Sequence[MatchedLog], holdout: Sequence[MatchedLog], wishes: Wishes, report: Report
) -> DeclaredFit:
    """The declared model fitted to training logs, with inputs held or band limited between samples where likelier.

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
    model = found.built.model
    every = [] if wishes.inputs_as_declared else moving_inputs(model, found.train, "linear")
    pieces = tuple(one.name for one in every if one.in_pieces)
    sets = [Between(names, "hold") for names in dict.fromkeys((pieces, tuple(one.name for one in every)))]
    curved = Between(tuple(curved_inputs(model, found.train)) if every else (), "band limited")
    found = replace(found, straight=tuple(one for one in (*sets, curved) if one.names), pieces=pieces)
    for inputs in (Between(pieces, "hold"), curved):
        if not inputs.names or _otherwise(found.fit, found.built, inputs.ways, wishes.journal) > -INDIFFERENT:
            continue
        other = attempted(lambda one=inputs: _fitted_otherwise(graph, train, holdout, wishes, one), lambda why: None)  # type: ignore[misc]
        if other is not None and other.fit.nll < found.fit.nll - INDIFFERENT:
            nats = found.fit.nll - other.fit.nll
            said = _said(OtherwiseAfterAll(inputs, nats, False, pieces))
            held = tuple(one for one in sets if one.names and inputs == curved)  # a law may show quick ones to be held
            found = replace(other, cautions=(said, *other.cautions), straight=held, pieces=pieces)
            break
    report("fit the declared model", 1, 1)
    return found


def fit_otherwise(
    graph: BondGraph,
    train: Sequence[MatchedLog],
    holdout: Sequence[MatchedLog],
    wishes: Wishes,
    after: OtherwiseAfterAll,
) -> DeclaredFit | None:
    """The declared model with inputs as a law has shown them to run; None where it cannot be fitted."""
    other = attempted(lambda: _fitted_otherwise(graph, train, holdout, wishes, after.inputs), lambda why: None)
    return None if other is None else replace(other, cautions=(_said(after), *other.cautions))


def _fitted_otherwise(
    graph: BondGraph, train: Sequence[MatchedLog], holdout: Sequence[MatchedLog], wishes: Wishes, inputs: Between
) -> DeclaredFit:
    return replace(
        _fitted(with_inputs_between(graph, **inputs.ways), train, holdout, wishes), otherwise=dict(inputs.ways)
    )


def otherwise_after_all(
    begun: DeclaredFit, before: tuple[Fit, BuiltModel], after: tuple[Fit, BuiltModel], journal: Journal
) -> OtherwiseAfterAll | None:
    """Inputs that a law shows to run another way between samples, with which all begins anew; None where it does not.

    Parameters
    ----------
    begun
        The fit of the declared model; some of its inputs run straight.
    before, after
        Fits with their models, without the law and with it.
    journal
        Finished fits.

    What is missing hides half a sample, and a delay or lag would make good for it in the end. So with a law in the
    model all ways are compared again, of inputs that move at every sample too, which a controller may give; and a law
    that does no more than another way alone is none.
    """
    found, than = [], "band limited" if begun.running("band limited") else "straight lines"
    for inputs in begun.straight:
        alone = _otherwise(*before, inputs.ways, journal, before[0].nll - after[0].nll - INDIFFERENT)
        if before[0].nll + alone < after[0].nll + INDIFFERENT:
            found.append(OtherwiseAfterAll(inputs, -alone, False, begun.pieces, than))
            continue
        beside = _otherwise(*after, inputs.ways, journal)
        if beside < -INDIFFERENT:
            found.append(OtherwiseAfterAll(inputs, -beside, True, begun.pieces, than))
    return max(found, key=lambda one: one.nats, default=None)


def straight_is_likelier(begun: DeclaredFit, fitted: Fit, built: BuiltModel, journal: Journal) -> bool:
    """True where a corrected model is likelier with straight lines where inputs were taken to run another way."""
    return _otherwise(fitted, built, dict.fromkeys(begun.otherwise, "linear"), journal) < -INDIFFERENT


def _otherwise(
    fitted: Fit, built: BuiltModel, ways: Mapping[str, Interpolation], journal: Journal, least: float = 0.0
) -> float:
    """Nats by which a fitted model gets worse with its inputs otherwise between samples, searched from where it is.

    Nothing is searched that is not within reach of ``least`` nats.
    """
    return attempted(
        lambda: lost_otherwise(fitted, build(with_inputs_between(built.graph, **ways)).model, journal, least),
        lambda why: 0.0,
    )


def _said(after: OtherwiseAfterAll) -> str:
    names, pieces = after.inputs.names, set(after.inputs.names) <= set(after.pieces)
    verb = inflected(names, "is", "are")
    said = f"{verb} constant in pieces, and " if pieces else ""
    beside = " beside what was found first" if after.beside else ""
    held = after.inputs.way == "hold"
    advice = "hold=True for what a controller gives" if held else "between='band limited' for what a filter has passed"
    return (
        f"{few(list(names))} {said}{verb} taken as {after.inputs.words} between samples, {number(after.nats)} nats "
        f"likelier than {after.than}{beside} - declare {advice}, or say --inputs-between linear for what was measured"
    )


def _fitted(
    graph: BondGraph, train: Sequence[MatchedLog], holdout: Sequence[MatchedLog], wishes: Wishes
) -> DeclaredFit:
    before = build(graph)
    graph = with_followed_rates(graph if before.model.states else with_resting_state(graph))
    built = before if graph is before.graph else build(graph)
    if built is not before:
        train, holdout = rated(train, before.model, built.model), rated(holdout, before.model, built.model)
    train, holdout = (
        with_inputs_before(built.model, logs, built.model.theta(), wishes.initial, whatever_follows=True)
        for logs in (train, holdout)
    )
    setup = filter_setup(built.model, [name for name in built.driven if name != RESTING], train, wishes.process_noise)
    free = _all_free(setup, wishes.free)
    _check_enough(graph, train, len(free))
    problem = EstimationProblem(setup.filter_model, tuple(train), free, wishes.initial)
    least = setup.filter_model.substeps
    found, check = _certified(_by_long_steps(problem, wishes.journal), wishes.journal, least)
    for start in _elsewhere(problem, found):
        other = attempted(lambda at=start: _from(problem, at, wishes.journal), lambda why: None)  # type: ignore[misc]
        if other is not None and other.nll < found.nll - _TOLERANCE:
            sure = _certified(other, wishes.journal, least)
            found, check = min((found, check), sure, key=lambda one: one[0].nll)
    found, held = with_gauge(found, lambda posed, start: _from(posed, start, wishes.journal))
    if held:
        found, check = _certified(found, wishes.journal, least)
    cautions = tuple(map(str, held))
    return DeclaredFit(graph, built, setup, found, check, tuple(train), tuple(holdout), cautions=cautions)


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


def _certified(found: Fit, journal: Journal, substeps: int | None) -> tuple[Fit, Check]:
    """The fit with as little process noise as there is, and with steps so short that nothing depends on them."""
    return refined(without_floors(found, journal), journal, substeps)


def _elsewhere(problem: EstimationProblem, found: Fit) -> list[FloatArray]:
    """Points where another search of the declared model begins: with much noise, and off the bounds on which it rests.

    For what swings see :func:`bondgraph.estimate.noise_starts.noisiest_start`. An optimum may also lie on a bound and a
    better one inside: a rope rested on the softest that was allowed, and all masses had intervals that left out the
    truth. None of stiff models, whose fits are costly.
    """
    if problem.filter_model.is_stiff:
        return []
    starts = [noisiest_start(problem.free)]
    resting = found.held & np.array([one.target.kind == "parameter" for one in found.problem.free])
    if resting.any():
        begun = [one.coordinate(one.start) for one in found.problem.free]
        starts.append(np.where(resting, begun, found.point))
    return starts


def _from(problem: EstimationProblem, start: FloatArray, journal: Journal) -> Fit:
    return fit(problem, _MOST_ITERATIONS, _TOLERANCE, [start], journal=journal)


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
