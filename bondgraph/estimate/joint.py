"""Joint problems: logs that different filter models explain, with parameters shared by name.

Coast-downs are filtered with a model of a rolling vehicle and drives with one of the whole; both speak about the tyre
radius. Each part is an :class:`~bondgraph.estimate.problem.EstimationProblem` of its own logs; the negative
log-likelihood is the sum of theirs plus the priors, which are told once. A parameter of single logs (a payload) is a
free parameter ``m(run1)`` of a part that has this log alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from bondgraph.data.log import MatchedLog
from bondgraph.errors import EstimationError, listed
from bondgraph.estimate.coordinates import AbstractProblem, checked_priors
from bondgraph.estimate.free import FreeParameter, parse_target
from bondgraph.estimate.objective import Below, FloatArray, Terms
from bondgraph.estimate.priors import Prior, read_priors
from bondgraph.estimate.problem import EstimationProblem, check_logs
from bondgraph.estimate.ties import Tie, read_ties
from bondgraph.filter.filter_model import FilterModel
from bondgraph.text import count, few

#: Places of a part's coordinates among those of the whole.
Rows = npt.NDArray[np.intp]


@dataclass(frozen=True, repr=False)
class JointProblem(AbstractProblem):
    """Several problems as one; build it with :func:`pose_joint`.

    Parameters
    ----------
    problems
        The parts. Their free parameters are among ``free`` by name; they have no priors of their own.
    free
        What to estimate, in this order.
    priors
        What is known of free and tied values from elsewhere.

    Raises
    ------
    EstimationError
        If two logs have one name, or a prior is about something else.
    """

    problems: tuple[EstimationProblem, ...]
    free: tuple[FreeParameter, ...]
    priors: tuple[Prior, ...] = ()

    def __post_init__(self) -> None:
        check_logs(self.name, self.logs, self.free)
        tied = [tie.name for part in self.problems for tie in part.ties]
        free = checked_priors(self.free, tied, self.priors)
        object.__setattr__(self, "free", free)
        own = {one.name: replace(one, prior_mean=None, prior_std=None) for one in free}
        parts = (replace(part, free=tuple(own[name] for name in part.names), priors=()) for part in self.problems)
        object.__setattr__(self, "problems", tuple(parts))

    def __repr__(self) -> str:
        samples = sum(log.time.size for log in self.logs)
        data = f"{count(len(self.logs), 'log')}, {count(samples, 'sample')}"
        return f"<JointProblem {self.name}: free {few(self.names)}; {data}>"

    @property
    def name(self) -> str:
        """Names of the models."""
        return " + ".join(dict.fromkeys(part.name for part in self.problems))

    @property
    def parts(self) -> tuple[EstimationProblem, ...]:
        """Problems with one filter model each."""
        return self.problems

    @cached_property
    def logs(self) -> tuple[MatchedLog, ...]:
        """Logs of all parts."""
        return tuple(log for part in self.problems for log in part.logs)

    @cached_property
    def rows(self) -> tuple[Rows, ...]:
        """Places of each part's coordinates."""
        return tuple(np.array([self.names.index(name) for name in part.names]) for part in self.problems)

    def with_filters(self, filter_models: Iterable[FilterModel]) -> JointProblem:
        """The same with other filter models, one per part."""
        pairs = zip(self.problems, filter_models, strict=True)
        return self.with_parts([replace(part, filter_model=used) for part, used in pairs])

    def with_parts(self, parts: Iterable[EstimationProblem]) -> JointProblem:
        """The same with other parts of the same free parameters."""
        return replace(self, problems=tuple(parts))

    def known_values(self, values: FloatArray) -> Mapping[str, FloatArray]:
        """Free and tied quantities by name, each (members,), at values of the free ones (n, members)."""
        known: dict[str, FloatArray] = {}
        for part, rows in zip(self.problems, self.rows, strict=True):
            known.update(part.known_values(values[rows]))
        return known

    def known_slopes(self, point: FloatArray) -> Mapping[str, FloatArray]:
        """Derivatives (n,) of free and tied quantities by the coordinates, by name, at a point (n,)."""
        known: dict[str, FloatArray] = {}
        for part, rows in zip(self.problems, self.rows, strict=True):
            for name, slopes in part.known_slopes(point[rows]).items():
                known[name] = np.zeros(point.size)
                known[name][rows] = slopes
        return known

    def nll(self, points: FloatArray) -> FloatArray:
        """Negative log-likelihood plus priors at coordinates (n, members), shape (members,)."""
        total = self.prior_values(points)
        for part, rows in zip(self.problems, self.rows, strict=True):
            total = total + part.nll(points[rows])
        return total

    def nll_below(self, points: FloatArray, ceilings: FloatArray) -> Below:
        """Values as :meth:`nll` as far as they are below ceilings (members,); above, members may be given up.

        A ceiling is that of the sum, so the parts before the last are filtered whole.
        """
        *others, last = zip(self.problems, self.rows, strict=True)
        before = self.prior_values(points)
        for part, rows in others:
            before = before + part.nll(points[rows])
        part, rows = last
        found = part.nll_below(points[rows], ceilings - before)
        share = (len(others) + found.share) / len(self.problems)
        return Below(found.nll + before, found.abandoned, share)

    def terms(self, points: FloatArray) -> Terms:
        """Scalar terms at coordinates (n, members): those of the parts one after the other, then priors."""
        found = [part.terms(points[rows]) for part, rows in zip(self.problems, self.rows, strict=True)]
        priors = self.prior_terms(points)
        return Terms(
            np.concatenate([*(one.innovations for one in found), priors]),
            np.concatenate([*(one.log_scales for one in found), np.zeros(priors.shape)]),
        )


#: What an estimation can solve.
Problem = EstimationProblem | JointProblem


def pose_joint(
    problems: EstimationProblem | Sequence[EstimationProblem],
    per_log: str | Sequence[str] = (),
    ties: Mapping[str, str] | Tie | Sequence[Tie] = (),
    priors: Prior | Sequence[Prior] = (),
) -> JointProblem:
    """Pose several problems as one, with free parameters of one name shared.

    Parameters
    ----------
    problems
        Each with its own filter model, logs and free parameters; their priors count once each. A shared parameter is
        searched within the bounds that all of them give, from where the first starts.
    per_log
        Names of free parameters that have a value of their own in every log, ``m(run1)``.
    ties
        Quantities that follow from free parameters of any of the problems, in every model that has them.
    priors
        What is known of free and tied values from elsewhere.

    Returns
    -------
    JointProblem
        Checked.

    Raises
    ------
    EstimationError
        If bounds, scales or priors of one parameter contradict each other, or a name is unknown.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.1}, {"deflection": 0.02}, {"angle": 0.1, "rate": 0.1})
    >>> time = np.arange(40) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 40)), 0.5 * np.cos(3.1 * time)[np.newaxis])
    >>> logs = [log, replace(log, name="second")]
    >>> pose_joint([bg.pose(swing, logs, ["length", "damping"])], per_log=["length"]).names
    ('length(swing)', 'damping', 'length(second)')
    """
    given, split = (
        listed("pose_joint", problems, EstimationProblem, "posed problem"),
        listed("per_log", per_log, str, "name"),
    )
    if not given:
        raise EstimationError("pose_joint: there is no problem - give those of bg.pose(filter_model, logs, free)")
    equations = read_ties(ties)
    parts = [alone for problem in given for alone in _per_log(problem, split)]
    found: dict[str, FreeParameter] = {}
    for one in (parameter for part in parts for parameter in part.free):
        found[one.name] = _merged(found[one.name], one) if one.name in found else one
    _check_names(found, parts, split, equations)
    together = tuple(dict.fromkeys([prior for problem in given for prior in problem.priors] + [*read_priors(priors)]))
    tied = [_tied(replace(part, priors=()), equations, found) for part in parts]
    return JointProblem(tuple(tied), tuple(found.values()), together)


def _per_log(problem: EstimationProblem, names: Sequence[str]) -> list[EstimationProblem]:
    """The problem, or one for each of its logs if it frees something that has a value in each."""
    own = [name for name in names if name in problem.names]
    if not own:
        return [problem]
    parts = []
    for k, log in enumerate(problem.logs):
        free = [
            replace(one, name=f"{one.name}({log.name})") if one.name in own else one
            for one in problem.free
            if one.target.log in (None, log.name)
        ]
        initial = problem.initial if isinstance(problem.initial, str) else problem.initial[k : k + 1]
        known = [one for one in free if not (one.name.startswith("std(") and _unmeasured(one, problem, log))]
        parts.append(replace(problem, logs=(log,), free=tuple(known), initial=initial, priors=()))
    return parts


def _unmeasured(parameter: FreeParameter, problem: EstimationProblem, log: MatchedLog) -> bool:
    row = problem.filter_model.model.index("output", parameter.target.name)
    return bool(np.isnan(log.y[row]).all())


def _merged(first: FreeParameter, other: FreeParameter) -> FreeParameter:
    """One parameter of two problems."""
    lower, upper = max(first.lower, other.lower), min(first.upper, other.upper)
    priors = {(one.prior_mean, one.prior_std) for one in (first, other) if one.prior_mean is not None}
    if not lower < upper or first.scale != other.scale or len(priors) > 1:
        what = "bounds leave nothing in common" if not lower < upper else "scales or priors differ"
        raise EstimationError(
            f"free parameter {first.name!r}: its {what} between the problems - give both one FreeParameter",
            where=(first.name,),
        )
    mean, std = next(iter(priors), (None, None))
    start = min(max(first.start, lower), upper)
    return replace(first, lower=lower, upper=upper, start=start, prior_mean=mean, prior_std=std)


def _check_names(
    free: Mapping[str, FreeParameter], parts: Sequence[EstimationProblem], per_log: Sequence[str], ties: Sequence[Tie]
) -> None:
    split = {parse_target(name).name for name in free if parse_target(name).kind == "parameter" and "(" in name}
    missing = next((name for name in per_log if name not in split), None)
    if missing is not None:
        raise EstimationError(
            f"per_log: {missing!r} is not a free parameter of a model - free it in one of the problems",
            where=(missing,),
        )
    known = {name for part in parts for name in part.filter_model.model.names("parameter")}
    for tie in ties:
        target = parse_target(tie.name)
        if target.kind == "parameter" and target.name not in known:
            raise EstimationError(f"tie of {tie.name!r}: no model has such a parameter", where=(tie.name,))


def _tied(part: EstimationProblem, ties: Sequence[Tie], free: Mapping[str, FreeParameter]) -> EstimationProblem:
    """The part with the ties of what its model has, and the free parameters that these follow from."""
    model = part.filter_model.model
    own = [
        tie for tie in ties
        if parse_target(tie.name).kind != "parameter" or parse_target(tie.name).name in model.names("parameter")
    ]  # fmt: skip
    wanted = dict.fromkeys(name for tie in own for name in tie.variables if name in free and name not in part.names)
    return replace(part, free=(*part.free, *(free[name] for name in wanted)), ties=(*part.ties, *own))
