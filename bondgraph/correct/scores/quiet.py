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

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.scores.scoring import Linearisation, Scored, linearisation, score_candidates
from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError, FilterError
from bondgraph.estimate.excerpt import excerpt
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit
from bondgraph.estimate.problem import EstimationProblem

#: The quiet fit is only where scores are taken and refits start; of a stiff model, whose fits take long, the less.
_TOLERANCE, _STIFF_TOLERANCE, _MOST_ITERATIONS = 0.5, 2.0, 40
#: Factors on the noise of the sensors at which the quiet fit looks for its start: what moved now counts as theirs.
_NOISIER = (1.0, 5.0, 25.0, 125.0)
#: Shares of the way down to its bounds (logarithms) at which the process noise is held, one after the other, and
#: factors on the noise of the sensors, which has to rise where that of the process falls.
_DESCENT = (0.2, 0.4, 0.6, 0.8, 1.0)
_RISING = tuple(5.0**k for k in range(9))


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
        return fit(model, train, free, _MOST_ITERATIONS, tolerance, starts, journal=journal, initial=problem.initial)
    except (EstimationError, FilterError):
        return None


def annealed_fit(base: Fit, train: Sequence[MatchedLog], journal: Journal | None = None) -> Fit | None:
    """The quiet fit again, its process noise lowered by steps; the sensors may count as noisy as what they show varies.

    The steps only lead somewhere, so that all but the last are made on the beginnings of long logs. None where
    :func:`quiet_fit` gives none, and of stiff models, which so many fits are too much for.
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
    part = excerpt(replace(problem, logs=tuple(train), free=tuple(free)))
    for share in _DESCENT:
        held = {name: level * (lowest / level) ** share for name, (level, lowest) in process.items()}
        model = replace(problem.filter_model, process_noise={**problem.filter_model.process_noise, **held})
        free = [replace(one, start=float(np.clip(values[one.name], one.lower, one.upper))) for one in free]
        start = np.array([one.coordinate(one.start) for one in free])
        starts = [start + np.where(sensors, np.log(factor), 0.0) for factor in _RISING]
        try:
            logs = train if part is None or share == _DESCENT[-1] else part.logs
            fitted = fit(
                model, logs, free, _MOST_ITERATIONS, _TOLERANCE, starts, journal=journal, initial=problem.initial
            )
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
