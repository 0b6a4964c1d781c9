"""Scores with the process noise held low: what a model lacks is then not taken for noise that drives it.

A declared model that lacks an effect is fitted with as much process noise as stands in for it. Its scores are those of
a filter that follows whatever it sees, and underrate the effect: they say what the data certainly ask for, but hardly
which of several laws. With the process noise at its lower bound the model has to explain the course of every log by
itself; the step of a score is then nearly that of a fit of the free simulation, from which a refit starts well. Its
p-values mean nothing where process noise is real, so that these scores choose what is refitted, and decide nothing.

The likelihood of a free simulation may have many optima. A fit that must not end in a wrong one lowers the process
noise by steps, each from where the last one ended: precision annealing, Ye et al. (2015), Nonlinear Processes in
Geophysics 22.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.correct.fits.fit import Fit, fit
from bondgraph.correct.fits.journal import Journal
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.scores.scoring import Linearisation, Scored, linearisation, score_candidates
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.errors import EstimationError, FilterError
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.problem import EstimationProblem

#: The quiet fit is only where scores are taken and refits start; of a stiff model, whose fits take long, the less.
_TOLERANCE, _STIFF_TOLERANCE, _MOST_ITERATIONS = 0.5, 2.0, 40
#: Factors on the noise of the sensors at which the quiet fit looks for its start: what moved now counts as theirs.
_NOISIER = (1.0, 5.0, 25.0, 125.0)
#: Shares of the way down to its bounds (logarithms) at which the process noise is held, one after the other, and
#: factors on the noise of the sensors, which has to rise where that of the process falls.
_DESCENT = (0.2, 0.4, 0.6, 0.8, 1.0)
_RISING = tuple(5.0**k for k in range(9))
#: Shares of a score's step at which a refit is tried.
_STRIDES = (1.0, 0.5)
#: How far process noise is lowered from the fit without an effect to its bound, on its logarithmic scale.
_LOWERED = (1.0, 0.5, 0.0)
#: Coefficients start this share of their range away from a bound.
_MARGIN = 1e-6


@dataclass(frozen=True)
class Quiet:
    """The fit with process noise at its lower bounds, linearised, and the scores of candidates there in their order."""

    fit: Fit
    linear: Linearisation
    scored: Scored

    def of(self, found: Sequence[Candidate]) -> Quiet:
        """The same with the scores of other candidates."""
        return replace(self, scored=score_candidates(self.linear, found))


def quiet_fit(base: Fit, train: Sequence[MatchedLog], journal: Journal | None = None) -> Fit | None:
    """A fit with its process noise at the lower bounds, everything else free as it was.

    None where no process noise is free, or where the model diverges without it.
    """
    problem = base.problem
    low = {one.target.name: one.lower for one in problem.free if one.target.kind == "process"}
    if not low:
        return None
    tolerance = _STIFF_TOLERANCE if problem.filter_model.is_stiff else _TOLERANCE
    model = replace(problem.filter_model, process_noise={**problem.filter_model.process_noise, **low})
    values = base.values
    free = [
        replace(one, start=float(np.clip(values[one.name], one.lower, one.upper)))
        for one in problem.free
        if one.target.kind != "process"
    ]
    start = np.array([one.coordinate(one.start) for one in free])
    sensors = np.array([one.target.kind == "std" for one in free])
    starts = [start + np.where(sensors, np.log(factor), 0.0) for factor in _NOISIER]
    try:
        return fit(model, train, free, _MOST_ITERATIONS, tolerance, starts, journal=journal)
    except (EstimationError, FilterError):
        return None


def annealed_fit(base: Fit, train: Sequence[MatchedLog], journal: Journal | None = None) -> Fit | None:
    """The quiet fit again, its process noise lowered by steps; the sensors may count as noisy as what they show varies.

    None where :func:`quiet_fit` gives none, and of stiff models, which so many fits are too much for.
    """
    problem = base.problem
    process = {
        one.target.name: (base.values[one.name], one.lower) for one in problem.free if one.target.kind == "process"
    }
    if not process or problem.filter_model.is_stiff:
        return None
    free = [_widened(one, problem, train) for one in problem.free if one.target.kind != "process"]
    sensors = np.array([one.target.kind == "std" for one in free])
    fitted, values = None, base.values
    for share in _DESCENT:
        held = {name: level * (lowest / level) ** share for name, (level, lowest) in process.items()}
        model = replace(problem.filter_model, process_noise={**problem.filter_model.process_noise, **held})
        free = [replace(one, start=float(np.clip(values[one.name], one.lower, one.upper))) for one in free]
        start = np.array([one.coordinate(one.start) for one in free])
        starts = [start + np.where(sensors, np.log(factor), 0.0) for factor in _RISING]
        try:
            fitted = fit(model, train, free, _MOST_ITERATIONS, _TOLERANCE, starts, journal=journal)
        except EstimationError:
            return None
        values = fitted.values
    return fitted


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


def quiet_starts(base: Fit, quiet: Quiet, index: int, own: Sequence[FreeParameter]) -> list[FloatArray]:
    """Starts of the refit of one candidate, from the quiet fit along its step there, at several levels of noise.

    What a quiet fit leaves unexplained counts as noise of the sensors; that of the other fit may be nearer the truth.

    Parameters
    ----------
    base
        The fit without it, whose free parameters come first.
    quiet
        Scores on the quiet fit.
    index
        Which candidate.
    own
        Its coefficients, then its shapes.
    """
    problem, fitted = base.problem, quiet.fit
    rows = {name: k for k, name in enumerate(problem.names)}
    into = [rows[name] for name in fitted.problem.names]
    process = np.array([one.target.kind == "process" for one in problem.free])
    moving = np.array([one.target.kind == "parameter" for one in fitted.problem.free])
    step, follows = quiet.scored.scores.steps[index], np.zeros(fitted.point.size)
    follows[~fitted.held] = quiet.scored.scores.follows(index)
    shapes = quiet.scored.variants[index].shapes
    found = []
    for share in _STRIDES:
        reached = [one.coordinate(_inside(one, share * value)) for one, value in zip(own, step, strict=False)]
        rest = [one.coordinate(shapes.get(one.name, one.start)) for one in own[step.size :]]
        for lowered, sensors in itertools.product(_LOWERED, (fitted.point, base.point[into])):
            point = base.point.copy()
            point[into] = np.where(moving, fitted.point + share * follows, sensors)
            point[process] = base.point[process] + lowered * (problem.lower - base.point)[process]
            found.append(np.concatenate([point, reached, rest]))
    return found


def lowered_starts(base: Fit, quiet: Fit | None) -> list[FloatArray]:
    """Points (n,) of the free parameters of a fit: its own, with less process noise, and that of the quiet fit."""
    problem = base.problem
    process = np.array([one.target.kind == "process" for one in problem.free])
    found = [np.where(process, base.point + share * (problem.lower - base.point), base.point) for share in _LOWERED]
    if quiet is not None:
        rows = {name: k for k, name in enumerate(problem.names)}
        point = found[0].copy()
        moving = [k for k, one in enumerate(quiet.problem.free) if one.target.kind == "parameter"]
        point[[rows[quiet.problem.names[k]] for k in moving]] = quiet.point[moving]
        found.append(point)
    return found


def _inside(coefficient: FreeParameter, value: float) -> float:
    margin = _MARGIN * (coefficient.upper - coefficient.lower)
    return float(np.clip(value, coefficient.lower + margin, coefficient.upper - margin))
