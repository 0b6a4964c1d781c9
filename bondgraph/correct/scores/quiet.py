"""Scores with the process noise held low: what a model lacks is then not taken for noise that drives it.

A declared model that lacks an effect is fitted with as much process noise as stands in for it. Its scores are those of
a filter that follows whatever it sees, and underrate the effect: they say what the data certainly ask for, but hardly
which of several laws. With the process noise at its lower bound the model has to explain the course of every log by
itself; the step of a score is then nearly that of a fit of the free simulation, from which a refit starts well. Its
p-values mean nothing where process noise is real, so that these scores choose what is refitted, and decide nothing.

A state that does nothing but integrate another, the position of a carriage, never forgets: whatever pushed the carriage
unseen and is over stays in every later position, and drowns in it what the model lacks. So process noise of its own
stays free there, by which a quiet model has to explain the course of the speed and not that of the position.

The likelihood of a free simulation may have many optima. A fit that must not end in a wrong one lowers the process
noise by steps, each from where the last one ended: precision annealing, Ye et al. (2015), Nonlinear Processes in
Geophysics 22.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.correct.fits.integrals import integrating
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.scores.scoring import Linearisation, Scored, linearisation, score_candidates
from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError, FilterError
from bondgraph.estimate.excerpt import excerpt
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.free import FreeParameter, declared_free
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit
from bondgraph.estimate.noise_bounds import process_bounds
from bondgraph.estimate.noise_starts import matched_levels
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.searches import ROUGH, with_longest_steps
from bondgraph.filter.filter_model import FilterModel

#: The quiet fit is only where scores are taken and refits start; of a stiff model, whose fits take long, the less.
_TOLERANCE, _STIFF_TOLERANCE, _MOST_ITERATIONS = 0.5, 2.0, 40
#: A fit by which a law is judged is right to this share of what is at stake, nats that the law gained elsewhere. The
#: hurdles of a law that gained a thousand are a hundredth of that: a convention.
_AT_STAKE = 0.01
#: Shares of the way down to its bounds (logarithms) at which the process noise is held, one after the other.
_DESCENT = (0.2, 0.4, 0.6, 0.8, 1.0)


@dataclass(frozen=True)
class Quiet:
    """The fit with process noise at its lower bounds, linearised, and the scores of candidates there in their order."""

    fit: Fit
    linear: Linearisation
    scored: Scored

    def of(self, found: Sequence[Candidate]) -> Quiet:
        """The same with the scores of other candidates."""
        return replace(self, scored=score_candidates(self.linear, found))


def quiet_fit(
    base: Fit,
    train: Sequence[MatchedLog],
    journal: Journal | None = None,
    walking: Sequence[str] | None = None,
    stake: float = 0.0,
) -> Fit | None:
    """A fit with its process noise at the lower bounds, everything else free as it was.

    ``walking`` are the states that keep noise of their own, None: those that only integrate, see
    :func:`bondgraph.correct.fits.integrals.integrating`. ``stake``: nats of a law that is judged by it.
    None where no process noise is free, or where the model diverges without it.
    """
    problem, levels = base.problem, _levels(base)
    if not levels:
        return None
    tolerance = max(_STIFF_TOLERANCE if problem.filter_model.is_stiff else _TOLERANCE, _AT_STAKE * stake)
    free = _kept(base, train, integrating(base) if walking is None else walking)
    model = _driven(base, free, {name: lowest for name, (_, lowest) in levels.items()})
    try:
        quiet = EstimationProblem(model, tuple(train), free, problem.initial)
        starts = [quiet.start, matched_levels(quiet, quiet.start)]
        return fit(quiet, _MOST_ITERATIONS, tolerance, starts, journal=journal, same=max(ROUGH, tolerance))
    except (EstimationError, FilterError):
        return None


def annealed_fit(
    base: Fit,
    train: Sequence[MatchedLog],
    journal: Journal | None = None,
    walking: Sequence[str] | None = None,
    stake: float = 0.0,
) -> Fit | None:
    """The quiet fit again, its process noise lowered by steps; the sensors may count as noisy as what they show varies.

    All but the last only lead somewhere, so that they are made on the beginnings of long logs, roughly, and with the
    longest integration steps that lead. None where :func:`quiet_fit` gives none, and of stiff models, which so many
    fits are too much for. ``walking`` and ``stake`` as there.
    """
    problem, levels = base.problem, _levels(base)
    if not levels or problem.filter_model.is_stiff:
        return None
    free = _kept(base, train, integrating(base) if walking is None else walking)
    free = tuple(_widened(one, problem, train) for one in free)
    fitted: Fit | None = None
    tolerance = max(_TOLERANCE, _AT_STAKE * stake)
    part = excerpt(EstimationProblem(_driven(base, free, {}), tuple(train), free, problem.initial))
    for share in _DESCENT:
        model = _driven(base, free, {name: level * (low / level) ** share for name, (level, low) in levels.items()})
        last = share == _DESCENT[-1]
        try:
            lowered = EstimationProblem(
                model, tuple(train if part is None or last else part.logs), free, problem.initial
            )
            starts = [lowered.start, matched_levels(lowered, lowered.start)]
            lowered = lowered if last else with_longest_steps(lowered, starts)
            least = tolerance if last else max(tolerance, ROUGH)
            fitted = fit(lowered, _MOST_ITERATIONS, least, starts, journal=journal, same=max(ROUGH, least))
        except EstimationError:
            return None
        free = at_optimum(fitted)
    return fitted


def _levels(base: Fit) -> dict[str, tuple[float, float]]:
    """Estimate and lower bound of the process noise of every driven state."""
    free = base.problem.free
    return {one.target.name: (base.values[one.name], one.lower) for one in free if one.target.kind == "process"}


def _kept(base: Fit, train: Sequence[MatchedLog], walking: Sequence[str]) -> tuple[FreeParameter, ...]:
    """The free parameters of a quiet fit, from where it is, and the noise of states that keep some."""
    own, model = [one for one in at_optimum(base) if one.target.kind != "process"], base.problem.filter_model.model
    noise = [
        declared_free(f"process({name})", base.problem.filter_model, logs=train, theta=base.theta)
        for name in walking
        if process_bounds(model, train, base.theta, model.index("state", name)) is not None
    ]
    return (*own, *noise)


def _driven(base: Fit, free: Sequence[FreeParameter], held: Mapping[str, float]) -> FilterModel:
    """The filter of a fit with other process noise, and with what is free of it."""
    noise = {one.target.name: one.start for one in free if one.target.kind == "process"}
    own = base.problem.filter_model
    return replace(own, process_noise={**own.process_noise, **held, **noise})


def _widened(one: FreeParameter, problem: EstimationProblem, train: Sequence[MatchedLog]) -> FreeParameter:
    """A sensor's noise that may be as large as what the sensor shows varies; any other parameter as it is."""
    if one.target.kind != "std":
        return one
    row = problem.filter_model.model.index("output", one.target.name)
    spread = float(np.nanstd(np.concatenate([log.y[row] for log in train])))
    return replace(one, upper=max(one.upper, spread))


def quiet_scores(
    base: Fit,
    train: Sequence[MatchedLog],
    found: Sequence[Candidate],
    journal: Journal | None = None,
    at: Sequence[Sequence[int]] | None = None,
) -> Quiet | None:
    """Scores of candidates on the quiet fit, None where there is none; ``at`` as for :func:`score_candidates`."""
    fitted = quiet_fit(base, train, journal)
    if fitted is None:
        return None
    linear = linearisation(fitted, train)
    return Quiet(fitted, linear, score_candidates(linear, found, at))


def is_driven(fitted: Fit, least: float) -> bool:
    """Whether process noise drives a state of a fit: it is worth ``least`` nats or more, see :attr:`Fit.driven`.

    What is worth less stands in for no more than that.
    """
    return not fitted.driven < least
