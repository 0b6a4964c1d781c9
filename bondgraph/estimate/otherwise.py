"""Inputs that may run another way between samples than declared: how likely a fitted model is with them so.

A log says nothing of its inputs between the samples. Straight lines lead an input that is held there, a controller's
output, by half a sample; parameters, process noise and laws make good for that. Both ways have the same parameters, so
that the difference of their likelihoods is what speaks for one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.data.band_limited import BAND_LIMITED, curvature, is_even
from bondgraph.data.log import MatchedLog
from bondgraph.errors import BondGraphError
from bondgraph.estimate.derivatives.exact import derivatives
from bondgraph.estimate.derivatives.linearised import is_linearised
from bondgraph.estimate.excerpt import excerpt, on_beginnings
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.inputs_otherwise import InputsOtherwise
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit, left_open
from bondgraph.estimate.objective import Progress, SearchOutcome, TraceRow, fitted_expansion, silent
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.result import Estimate
from bondgraph.estimate.searches import ROUGH, ROUGH_ITERATIONS
from bondgraph.estimate.solvers.steps import newton_decrement
from bondgraph.simulate.between import running_otherwise
from bondgraph.simulate.late import given_rows
from bondgraph.simulate.model import Model

#: Nats that do not tell two explanations apart: odds of 20 to 1, from where evidence is called strong. Kass and Raftery
#: (1995), J. American Statistical Association 90(430).
INDIFFERENT = 3.0
#: Gains of fits over predicted ones: scores of smooth laws are right to a factor of two or three.
SMOOTH_OPTIMISM = 2.5
#: Share of samples at which an input moves below which it is constant in pieces: most samples, a convention.
_IN_PIECES = 0.5
#: Share of its scatter by which an input must run beside straight lines before it is tried as band limited: what
#: sensors of a good class are off, and a sine with some twenty samples in its period. A convention.
_CURVED = 0.01


@dataclass(frozen=True)
class MovingInput:
    """An input that varies, with the share of samples at which it moves."""

    name: str
    share: float

    @property
    def in_pieces(self) -> bool:
        """True for an input that is constant in pieces."""
        return self.share < _IN_PIECES


def moving_inputs(model: Model, logs: Sequence[MatchedLog], way: str) -> list[MovingInput]:
    """Inputs that run a way between samples and move; codes, rates and what follows another input are left out.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> steps = np.repeat([[0.0, 1.0]], 4)[np.newaxis]
    >>> log = MatchedLog("run", np.arange(8.0), steps, np.zeros((1, 8)))
    >>> [(one.name, one.in_pieces) for one in moving_inputs(pendulum(), [log], "linear")]
    [('drive', True)]
    """
    found = []
    for row, info in enumerate(model.inputs[known] for known in given_rows(model)):
        if info.interpolation == way and not info.rate_of and not info.letters:
            moved = np.concatenate([np.diff(log.u[row]) != 0.0 for log in logs])
            if moved.any():
                found.append(MovingInput(info.name, float(moved.mean())))
    return found


def curved_inputs(model: Model, logs: Sequence[MatchedLog]) -> list[str]:
    """Inputs that are straight between samples, and would not be if they were band limited; none at uneven times.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> time = np.arange(200.0)
    >>> quick, slow = ([MatchedLog("run", time, np.sin(time / n)[np.newaxis], np.zeros((1, 200)))] for n in (1, 30))
    >>> curved_inputs(pendulum(), quick), curved_inputs(pendulum(), slow)
    (['drive'], [])
    """
    if not all(is_even(log.time) for log in logs):
        return []
    moving = [one.name for one in moving_inputs(model, logs, "linear") if not one.in_pieces]
    rows = {info.name: row for row, info in enumerate(model.inputs[known] for known in given_rows(model))}
    return [name for name in moving if max(curvature(log.u[rows[name]]) for log in logs) > _CURVED]


def lost_otherwise(fitted: Fit, model: Model, journal: Journal | None = None, least: float = 0.0) -> float:
    """Nats by which a fit gets worse with another model of the same parameters, searched from where it is.

    One value with the derivatives of the fit tells first whether a gain is within reach, and of a stiff model a rough
    search on the beginnings of long logs: where none is, the loss that is left at best is returned. Zero where the
    other model diverges there.

    Parameters
    ----------
    fitted
        The fit.
    model
        The other model.
    journal
        Finished fits.
    least
        Nats that must be gained for the answer to matter.

    Raises
    ------
    EstimationError
        If the other model diverges in the search.
    """
    filter_model = replace(fitted.problem.filter_model, model=model)
    problem = replace(fitted.problem, filter_model=filter_model, free=at_optimum(fitted))
    seen = problem.terms(fitted.point[:, np.newaxis])
    if not np.isfinite(seen.sums()[0]):
        return 0.0
    around = fitted.expansion.around(seen)
    promise = SMOOTH_OPTIMISM * newton_decrement(problem, fitted.point, around)
    lost = around.sum - fitted.expansion.sum
    if lost - promise > -least:
        return lost - promise
    part = excerpt(problem) if is_linearised(problem) else None
    if part is None:
        return fit(problem, journal=journal).nll - fitted.nll
    begun = fit(part, ROUGH_ITERATIONS, ROUGH, journal=journal)
    behind = begun.nll - on_beginnings(fitted.problem, fitted.point)
    if behind > left_open(problem):
        return behind
    return fit(problem, starts=[begun.point, fitted.point], journal=journal).nll - fitted.nll


def with_inputs_compared(found: Estimate, progress: Progress = silent) -> Estimate:
    """The estimate with what is likelier than its inputs as declared between samples, if anything is.

    Straight inputs are tried held: those that are constant in pieces, and all; quick ones are tried band limited. Held
    ones that move at most samples are tried straight. An estimate whose search has no end, or that has several filter
    models, is returned itself.

    Parameters
    ----------
    found
        A finished estimate.
    progress
        Called before the comparison. An interruption (Ctrl-C) leaves the estimate as it was.
    """
    problem = found.problem
    if not (isinstance(problem, EstimationProblem) and found.outcome.succeeded and np.isfinite(found.nll)):
        return found
    tried = _tried(problem)
    if not tried:
        return found
    progress(TraceRow("inputs between samples", 0, found.evaluations, found.nll, tuple(found.point.tolist())))
    try:
        expansion = fitted_expansion(problem, found.point, derivatives)
        own = Fit(problem, found.point, found.nll, expansion, found.evaluations, SearchOutcome.CONVERGED)
        gains = [replace(one, nats=_gain(own, one)) for one in tried]
    except KeyboardInterrupt:
        return found
    best = max(gains, key=lambda one: one.nats)
    return replace(found, inputs_otherwise=best) if best.nats > INDIFFERENT else found


def _tried(problem: EstimationProblem) -> list[InputsOtherwise]:
    """Sets of inputs that may run another way, none of them twice."""
    model = problem.filter_model.model
    straight, held = (moving_inputs(model, problem.logs, way) for way in ("linear", "hold"))
    pieces = tuple(one.name for one in straight if one.in_pieces)
    every = tuple(one.name for one in straight)
    sets = [InputsOtherwise(names, "hold", names == pieces) for names in dict.fromkeys((pieces, every)) if names]
    moving = tuple(one.name for one in held if not one.in_pieces)
    curved = tuple(curved_inputs(model, problem.logs))
    sets += [InputsOtherwise(curved, BAND_LIMITED, False)] if curved else []
    return [*sets, *([InputsOtherwise(moving, "linear", False)] if moving else [])]


def _gain(own: Fit, other: InputsOtherwise) -> float:
    """Nats by which inputs that run another way are likelier; none where the model does not allow it."""
    if own.expansion.terms is None or not own.expansion.is_finite:
        return 0.0
    try:
        model = running_otherwise(own.problem.filter_model.model, **dict.fromkeys(other.names, other.way))
        return -lost_otherwise(own, model)
    except (BondGraphError, np.linalg.LinAlgError):
        return 0.0
