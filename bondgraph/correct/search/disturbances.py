"""Disturbances: efforts, flows and signals that nothing measures and that wander at random with a memory of their own.

A filter takes what it does not know of for white noise, which has no memory: then a wind that lasts for seconds leaves
its innovations coloured for ever, and no law explains it. As a shaping filter that white noise drives it has a spectrum
with a corner,

    dx/dt = -x/T + noise,

whose intensity and time T are estimated like everything else. References: Maybeck (1979), Stochastic Models,
Estimation, and Control, volume 1, section 4.11; Gelb (1974), Applied Optimal Estimation, section 2.5.

It is tried where noise drives a state of the fitted model and innovations stay coloured although no law passes the
tests. It is no law: it says how large and how long-lived the unknown is, and where it acts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from bondgraph.build import BuiltModel, build
from bondgraph.correct.constants import INDIFFERENT
from bondgraph.correct.evidence.trials import Evidence, Trial
from bondgraph.correct.fits.assess import gain_p_value
from bondgraph.correct.fits.whiteness import whiteness
from bondgraph.correct.models.candidates import Candidate
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.models.shaping_filters import at_sensor, at_state
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.errors import DataError
from bondgraph.estimate.derivatives.exact import compile_exact
from bondgraph.estimate.derivatives.linearised import is_linearised
from bondgraph.estimate.excerpt import excerpt, on_beginnings
from bondgraph.estimate.fitted import Fit, at_optimum
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.journal import Journal
from bondgraph.estimate.local import fit, left_open, refitted
from bondgraph.estimate.problem import EstimationProblem
from bondgraph.estimate.searches import ROUGH, ROUGH_ITERATIONS
from bondgraph.estimate.setup import filter_setup
from bondgraph.execute.threads import in_threads
from bondgraph.filter.compiled import CompiledFilter
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.follows import Follow
from bondgraph.simulate.late import inputs_of
from bondgraph.text import number

#: Corner times that are tried, as shares of the logarithm from a sample to the length of the longest log.
_TIMES = (0.15, 0.3, 0.45, 0.6, 0.75, 0.9)
#: Its noise carries as much as the white noise in its place, or a tenth or ten times that.
_INTENSITIES = (0.1, 1.0, 10.0)
#: It is searched as far again beyond these. A bound in the unit of what nothing measures would mean nothing.
_FARTHEST = (1e-2, 1e2)
_ITERATIONS, _TOLERANCE = 40, 0.05
#: Disturbances of stiff models that are searched at once: a filter of one log takes one thread.
_ABREAST = 2
#: Share of the longest time that logs can tell from which a time is that.
_ALL = 0.99


@dataclass(frozen=True)
class Disturbance:
    """A disturbance that was estimated: its trial, the state that it is, its corner time in s, its size (std).

    ``unit`` is that of the size: of a sensor the one in which it is declared.
    ``lasts``: that time is the longest that these logs can tell, so that it may be a drift. ``period``, in s: it
    repeats, zero of what does not.
    """

    trial: Trial
    state: str
    seconds: float
    size: float
    unit: str
    lasts: bool = False
    period: float = 0.0

    def __str__(self) -> str:
        if self.period:
            size = f"standard deviation {number(self.size)}{f' {self.unit}' if self.unit else ''}"
            kept = f"{number(self.seconds)} s{' or more, as long as the logs' if self.lasts else ''}"
            what = f"something that nothing measures repeats every {number(self.period)} s"
            return f"{self.trial.candidate.place.label}: {what}, {size}, and keeps its rhythm for {kept}"
        sensor = bool(self.trial.candidate.effect.channel)
        what = "its noise has a memory" if sensor else "something that nothing measures wanders, as if at random"
        size = f"standard deviation {number(self.size)}{f' {self.unit}' if self.unit else ''}"
        time = f"correlation time {number(self.seconds)} s{self._doubt}"
        return f"{self.trial.candidate.place.label}: {what}, {size}, {time}"

    @property
    def _doubt(self) -> str:
        return " or more, as long as the logs: it may be a slow drift" if self.lasts else ""


def disturbances(
    built: BuiltModel,
    base: Fit,
    train: Sequence[MatchedLog],
    level: float,
    journal: Journal | None = None,
    *,
    sensors: bool = True,
    worth: float = 0.0,
    rival: Fit | None = None,
) -> Trial | None:
    """The disturbance that explains most, if it passes its tests; None where innovations are white or nothing passes.

    Parameters
    ----------
    built, base, train
        The model without it, its fit and the logs of that.
    level
        Chance of a false alarm over all that are tried.
    journal
        Finished fits.
    sensors
        Whether the noise of a sensor with a memory is one too.
    worth, rival
        Nats beyond the penalty that it must gain to be of use, and the fit that gains them otherwise, if there is one:
        what is clearly behind is not searched to its end.
    """
    tests = whiteness(base, train)
    if not any(test.p_value * len(tests) < level for test in tests):
        return None
    coloured = [test.channel for test in tests if sensors and test.p_value * len(tests) < level]
    made = [
        *(one for one in (at_state(built, train, name) for name in _driven_states(base, level)) if one is not None),
        *(one for one in (at_sensor(built, train, name) for name in coloured) if one is not None),
    ]
    abreast = _ABREAST if base.problem.filter_model.is_stiff else 1
    posed = [attempted(lambda one=one: _posed(built, one[0], one[1], base), lambda why: None) for one in made]  # type: ignore[misc]
    begun = in_threads(
        abreast, lambda one: attempted(lambda: _begun(one, base), lambda why: None),
        [one for one in posed if one is not None],
    )  # fmt: skip
    leading = _leading([one for one in begun if one is not None], base, rival)
    beat = base.nll - worth - _penalty(base.problem, len(made))
    for one in leading:
        attempted(lambda one=one: _compile(one.problem), lambda why: None)  # type: ignore[misc]
    trials = in_threads(
        abreast,
        lambda one: attempted(
            lambda: _estimated(one, base, len(made), beat, journal), lambda why: Trial(one.candidate, 0.0, failed=why)
        ),
        leading,
    )
    passed = [one for one in trials if one.evidence is not None and one.evidence.accepted(level)]
    return max(passed, key=_worth, default=None)


def _worth(trial: Trial) -> float:
    """Nats beyond the penalty; what the machine could do as well is not blamed on a sensor."""
    assert trial.evidence is not None  # it was estimated
    return trial.evidence.bic_gain - (INDIFFERENT if trial.candidate.effect.channel else 0.0)


def described(trial: Trial, fitted: Fit) -> Disturbance:
    """A disturbance as a fit that has it describes it."""
    state = trial.candidate.effect.element
    name = trial.candidate.effect.shapes[0]
    time, (_, longest) = fitted.values[name], trial.candidate.bounds(name)
    noise = fitted.values[f"process({state})"]
    model, channel = fitted.problem.filter_model.model, trial.candidate.effect.channel
    known = model.outputs if channel else model.states
    info = next(one for one in known if one.name == (channel or state))
    period = sum(fitted.values[name] for name in trial.candidate.effect.shapes[1:])
    size = info.shown(noise * float(np.sqrt((0.25 if period else 0.5) * time)))
    return Disturbance(trial, state, time, size, info.display_unit, time >= _ALL * longest, period)


def _driven_states(base: Fit, level: float) -> list[str]:
    """States whose noise the fit needs, those that it needs most first."""
    problem = base.problem
    rows = [k for k, one in enumerate(problem.free) if one.target.kind == "process"]
    if not rows:
        return []
    points = np.repeat(base.point[:, np.newaxis], len(rows), axis=1)
    points[rows, range(len(rows))] = problem.lower[rows]
    lost = problem.nll(points) - base.nll
    need = 0.5 * float(stats.chi2.isf(level / len(rows), 1))
    order = sorted(range(len(rows)), key=lambda k: -float(lost[k]))
    return [problem.free[rows[k]].target.name for k in order if not lost[k] < need]


@dataclass(frozen=True)
class _Posed:
    """A disturbance with its problem and the points (n,) at which its search may start."""

    candidate: Candidate
    built: BuiltModel
    problem: EstimationProblem
    starts: list[FloatArray]


def _posed(built: BuiltModel, candidate: Candidate, state: str, base: Fit) -> _Posed:
    """The problem of a disturbance, its filter compiled: text is parsed before threads start."""
    extended = build(candidate.apply(built.graph))
    problem = _problem(extended, candidate, state, base)
    if is_linearised(problem):
        CompiledFilter.of(problem.filter_model)
    return _Posed(candidate, extended, problem, _starts(problem, candidate, state, base))


def _compile(problem: EstimationProblem) -> None:
    """Compile the derivatives that end the search of a stiff model, before threads start."""
    if is_linearised(problem):
        compile_exact(problem)


@dataclass(frozen=True)
class _Begun:
    """A disturbance with its problem and where to go on; of a stiff model its gain on the beginnings of long logs."""

    candidate: Candidate
    built: BuiltModel
    problem: EstimationProblem
    point: FloatArray
    gain: float | None


def _begun(posed: _Posed, base: Fit) -> _Begun:
    """The best of its starts; of a stiff model a rough search goes on from there on the beginnings of long logs."""
    candidate, extended, problem, points = posed.candidate, posed.built, posed.problem, posed.starts
    part = excerpt(problem)
    values = (part or problem).nll(np.array(points).T)
    best = points[int(np.argmin(np.where(np.isfinite(values), values, np.inf)))]
    if part is None or not is_linearised(problem):
        return _Begun(candidate, extended, problem, best, None)
    rough = fit(part, ROUGH_ITERATIONS, ROUGH, [best])
    return _Begun(candidate, extended, problem, rough.point, on_beginnings(base.problem, base.point) - rough.nll)


def _leading(begun: Sequence[_Begun], base: Fit, rival: Fit | None) -> list[_Begun]:
    """Disturbances that are not clearly behind, on the beginnings of long logs: the best, a rival, the fit without."""
    gains = [one.gain for one in begun if one.gain is not None]
    if gains and rival is not None:
        gains.append(on_beginnings(base.problem, base.point) - on_beginnings(rival.problem, rival.point))
    least = max(gains, default=0.0)
    return [one for one in begun if one.gain is None or one.gain >= max(least, 0.0) - left_open(one.problem)]


def _estimated(begun: _Begun, base: Fit, tried: int, beat: float, journal: Journal | None) -> Trial:
    """The trial of a disturbance, estimated with everything else as far as it may reach the value to beat."""
    candidate, problem = begun.candidate, begun.problem
    fitted = fit(problem, _ITERATIONS, _TOLERANCE, [begun.point], beat, journal)
    if fitted.nll > beat + left_open(problem):
        why = f"gains {base.nll - fitted.nll:.1f} nats, clearly less than what explains it otherwise"
        return Trial(candidate, base.nll - fitted.nll, built=begun.built, remark=why)
    own, (time,) = candidate.effect.element, candidate.effect.shapes
    at_rest = _starting(problem.filter_model, own, fitted.values[f"process({own})"], fitted.values[time])
    fitted = refitted(fitted, at_rest, journal)
    gain = base.nll - fitted.nll
    ratio = float(stats.chi2.sf(2.0 * max(gain, 0.0), 2))  # its intensity and its time
    along = gain_p_value(base.own_runs, fitted.own_runs)
    worth = gain - _penalty(problem, tried)
    evidence = Evidence(gain, min(1.0, ratio * tried), min(1.0, along * tried), worth, tried)
    return Trial(candidate, gain, built=begun.built, fit=fitted, evidence=evidence)


def _penalty(problem: EstimationProblem, tried: int) -> float:
    """Nats for the intensity and the time of a disturbance, and for how many were tried."""
    measured = sum(int(np.isfinite(log.y).sum()) for log in problem.logs)
    return float(np.log(max(measured, 2))) + float(np.log(max(tried, 1)))


def _problem(extended: BuiltModel, candidate: Candidate, state: str, base: Fit) -> EstimationProblem:
    """The problem of the model with a disturbance, its noise and its time free beside everything else."""
    own, train = candidate.effect.element, base.problem.logs
    setup = filter_setup(extended.model, [own], train, with_nodes=False)
    level = next((one for one in setup.noise if one.name == f"process({own})"), None)
    if level is None:
        raise DataError(f"{candidate.label}: no channel of the logs shows it - measure a quantity that it moves")
    used = base.problem.filter_model
    filter_model = replace(
        used,
        model=extended.model,
        process_noise={**used.process_noise, own: setup.filter_model.process_noise[own]},
        initial_std={**used.initial_std, own: setup.filter_model.initial_std[own]},
        follows={**used.follows, own: Follow(0.0)},  # what a sensor shows is the state at first
    )
    (name,) = candidate.effect.shapes
    lower, upper = candidate.bounds(name)
    time = FreeParameter(name, lower, upper, float(np.sqrt(lower * upper)), scale="log")
    problem = EstimationProblem(filter_model, train, (*at_optimum(base), time, level), base.problem.initial)
    noise = _alike(problem, candidate, state, base, time.start)
    least, most = (_alike(problem, candidate, state, base, seconds) for seconds in (upper, lower))
    level = replace(level, lower=least * _FARTHEST[0], upper=most * _FARTHEST[1], start=noise)
    return replace(
        problem, filter_model=_starting(problem.filter_model, own, noise, time.start),
        free=(*problem.free[:-1], level),
    )  # fmt: skip


def _starting(filter_model: FilterModel, own: str, noise: float, seconds: float) -> FilterModel:
    """The filter whose disturbance starts anywhere in the distribution that it has at any time."""
    width = noise * float(np.sqrt(0.5 * seconds))
    return replace(filter_model, initial_std={**filter_model.initial_std, own: width})


def _starts(problem: EstimationProblem, candidate: Candidate, state: str, base: Fit) -> list[FloatArray]:
    """Points (n,) at several times and intensities, the white noise in its place as low as it may be.

    Of a sensor's own noise the white part stays; its coloured part starts as large as that. Intensities that end on the
    same bound are one point.
    """
    time, level = problem.free[-2], problem.free[-1]
    quiet = base.point.copy()
    if state:
        row = problem.names.index(f"process({state})")
        quiet[row] = problem.lower[row]
    found = []
    for share in _TIMES:
        seconds = float(time.lower * (time.upper / time.lower) ** share)
        alike = _alike(problem, candidate, state, base, seconds)
        for many in _INTENSITIES:
            ends = [time.coordinate(seconds), level.coordinate(float(np.clip(many * alike, level.lower, level.upper)))]
            found.append(np.concatenate([quiet, ends]))
    return list({point.tobytes(): point for point in found}.values())


def _alike(problem: EstimationProblem, candidate: Candidate, state: str, base: Fit, seconds: float) -> float:
    """The noise with which a disturbance carries as much as the white noise in its place."""
    if not state:
        return base.values[f"std({candidate.effect.channel})"] * float(np.sqrt(2.0 / seconds))
    return base.values[f"process({state})"] / (_push(problem, candidate, state, base) * seconds)


def _push(problem: EstimationProblem, candidate: Candidate, state: str, base: Fit) -> float:
    """How fast a disturbance of one moves the state that it acts on, in the middle of the first log."""
    model = problem.filter_model.model
    (run, log), theta = (base.own_runs[0], problem.logs[0]), problem.batch(problem.start[:, np.newaxis]).theta[:, 0]
    middle = log.time.size // 2
    x = np.zeros(len(model.states))
    x[: run.filtered_mean.shape[0]] = run.filtered_mean[:, middle][: x.size]
    slopes = model.jacobian_x(float(log.time[middle]), x, inputs_of(model, log)[:, middle], theta)
    push = abs(float(slopes[model.index("state", state), model.index("state", candidate.effect.element)]))
    return push if np.isfinite(push) and push > 0.0 else 1.0
