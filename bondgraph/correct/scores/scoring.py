"""Scores of candidates on a fitted model: their responses through the linearised filter, free parameters taken out."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bondgraph.correct.fits.times import Times, term_times
from bondgraph.correct.models.candidates import Candidate, Variant
from bondgraph.correct.models.failures import attempted
from bondgraph.correct.scores.score import LEFT, Projected, Scores, project, scores, solve
from bondgraph.data.log import FloatArray, MatchedLog
from bondgraph.estimate.fitted import Fit
from bondgraph.estimate.free import FreeParameter
from bondgraph.estimate.objective import Expansion, expansion_of, over_terms
from bondgraph.execute.threads import available_cores, in_threads
from bondgraph.filter.filter_run import FilterRun
from bondgraph.filter.linear.recursion import respond_into
from bondgraph.filter.linear.response import Change, LinearLog, Path, linearise, model_change, together, unchanged
from bondgraph.simulate.model import Model

#: Lanes that go through the filter at once, and candidates of which the lanes do; changes no number.
_LANES, _ABREAST = 32, 8
#: Free parameters are shifted by this share of their bounds.
_SHIFT = 1e-5


@dataclass(frozen=True, repr=False)
class Linearisation:
    """A fitted model with its filter linearised along every training log.

    ``runs`` are those of the filter. ``free`` and ``scales`` (n_terms, 1 + free) hold the terms of the likelihood and
    of their logarithmic scales, with their derivatives by the free coordinates that do not rest on a bound; ``times``
    the times of the terms. ``begun`` (n_x, n_y) are, per log, the shifts of its start by what outputs show more;
    ``bounded`` (n_terms, k) the derivatives by parameters that rest on a bound.
    """

    base: Fit
    model: Model
    runs: tuple[FilterRun, ...]
    logs: tuple[LinearLog, ...]
    free: FloatArray
    scales: FloatArray
    times: Times
    begun: tuple[FloatArray, ...] = ()
    bounded: FloatArray | None = None

    def __repr__(self) -> str:
        return f"<Linearisation {self.model.name}: {self.free.shape[0]} terms, {self.count} free>"

    @property
    def count(self) -> int:
        """Number of free coordinates."""
        return int(self.free.shape[1]) - 1

    def columns(self, changes: Sequence[Change]) -> FloatArray:
        """Responses (n_terms, lanes) to changes given per log."""
        return self.columns_and_states(changes, [()] * len(self.logs))[0]

    def columns_and_states(
        self, changes: Sequence[Change], at: Sequence[Sequence[int]]
    ) -> tuple[FloatArray, tuple[FloatArray, ...]]:
        """Responses (n_terms, lanes), and per log the shifts of the filtered states (at, n_x, lanes) at its samples."""
        edges = [*range(0, changes[0].outputs.shape[2], _LANES), changes[0].outputs.shape[2]]

        def some(part: int, log: int) -> Change:
            own = slice(edges[part], edges[part + 1])
            return Change(*(a[..., own] for a in _arrays(changes[log])))

        return self.responses(np.diff(edges).tolist(), some, at)

    def responses(
        self, sizes: Sequence[int], changes: Callable[[int, int], Change], at: Sequence[Sequence[int]] | None = None
    ) -> tuple[FloatArray, tuple[FloatArray, ...]]:
        """As :meth:`columns_and_states`, of changes that are made when they are needed, on all cores.

        ``changes(part, log)`` makes those of a part, of ``sizes[part]`` lanes, along one log.
        """
        at = [()] * len(self.logs) if at is None else at
        edges = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
        found = np.zeros((self.free.shape[0], edges[-1]))
        states = [
            np.empty((len(own), linear.slope.shape[2], edges[-1])) for linear, own in zip(self.logs, at, strict=True)
        ]
        rows = np.cumsum([0, *(linear.whitened.size for linear in self.logs)])

        def respond_to(part: int) -> None:
            for k, linear in enumerate(self.logs):
                own = found[rows[k] : rows[k + 1]].reshape(*linear.whitened.shape, -1)
                change = changes(part, k)
                begun = np.einsum("ij,jl->il", self.begun[k], change.outputs[:, 0])
                moved = respond_into(own, int(edges[part]), linear, replace(change, begun=begun), at[k])
                states[k][..., edges[part] : edges[part + 1]] = moved

        in_threads(available_cores(), respond_to, range(len(sizes)))
        return found, tuple(states)

    def expansion(self, columns: FloatArray) -> Expansion:
        """Gradient and information in the free coordinates, then those of responses (n_terms, lanes)."""
        scales = np.concatenate([self.scales, np.zeros(columns.shape)], axis=1)
        return expansion_of(np.concatenate([self.free, columns], axis=1), scales, 0)

    def each_alone(self, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Score and information (lanes,) of each response (n_terms, lanes) with the free coordinates taken out.

        What :meth:`projected` has on its diagonal, at a fraction of its cost; no information where only rounding is
        left.
        """
        z, free, scales = self.free[:, 0], self.free[:, 1:], self.scales[:, 1:]
        spread = free + z[:, np.newaxis] * scales
        inner = over_terms(spread, spread) + 2.0 * over_terms(scales, scales)
        gradient = over_terms(free, z[:, np.newaxis])[:, 0] + scales.sum(axis=0)
        across = over_terms(spread, columns)
        share = solve(inner, across)
        own = np.einsum("ij,ij->j", columns, columns)
        left = own - np.einsum("ij,ij->j", across, share)
        score = -(over_terms(columns, z[:, np.newaxis])[:, 0] - share.T @ gradient)
        return score, np.where(left > LEFT * np.maximum(own, np.finfo(float).tiny), left, 0.0)

    def left_by_parameters(self, columns: FloatArray) -> FloatArray:
        """Share (lanes,) of what responses (n_terms, lanes) tell that parameters leave, those on bounds among them.

        What a parameter would do beyond its bound is a question of the bound, and no law.
        """
        everything = self
        if self.bounded is not None:
            free, still = np.concatenate([self.free, self.bounded], axis=1), np.zeros(self.bounded.shape)
            everything = replace(self, free=free, scales=np.concatenate([self.scales, still], axis=1))
        own = np.einsum("ij,ij->j", columns, columns)
        share: FloatArray = everything.each_alone(columns)[1] / np.maximum(own, np.finfo(float).tiny)
        return share

    def projected(self, columns: FloatArray) -> Projected:
        """Scores of responses (n_terms, lanes) with the free coordinates taken out."""
        return project(self.expansion(columns), self.count, self.times)


def _arrays(change: Change) -> tuple[FloatArray, FloatArray, FloatArray]:
    return change.start, change.end, change.outputs


def linearisation(base: Fit, train: Sequence[MatchedLog], added: Collection[str] = ()) -> Linearisation:
    """Linearise the filter of a fit along its training logs.

    ``added`` names the coefficients and shapes of effects that were added; what the machine does at a bound is no
    question of them, a shape of a law ends where its signal does.
    """
    model = base.problem.filter_model.model
    runs = tuple(base.runs(train))
    logs = base.linear_logs if base.fits(train) else None
    if logs is None:
        logs = tuple(linearise(run, log, base.theta) for run, log in zip(runs, train, strict=True))
    kept = np.flatnonzero(~base.held)
    terms = base.expansion.terms
    assert terms is not None  # fits keep their terms
    chosen = np.concatenate([[0], 1 + kept])
    free, scales = terms.innovations[:, chosen].copy(), terms.log_scales[:, chosen].copy()
    begun = tuple(base.problem.start_shifts(log, linear.path.theta) for log, linear in zip(train, logs, strict=True))
    bare = Linearisation(base, model, runs, logs, free, scales, term_times(base.problem), begun)
    moved = {
        column: base.problem.free[index]
        for column, index in enumerate(kept, start=1)
        if base.problem.free[index].target.kind == "parameter"
    }
    resting = _resting(base, added)
    every = [*moved.values(), *resting]
    if not every:
        return bare
    responses = bare.columns([together([_moved(linear.path, base, one) for one in every]) for linear in logs])
    timed = bare.times.sample >= 0
    if resting:
        bare = replace(bare, bounded=responses[:, len(moved) :])
        responses = responses[:, : len(moved)]
    for column, response in zip(moved, responses.T, strict=True):
        free[timed, column], scales[timed, column] = response[timed], 0.0
    return bare


def _resting(base: Fit, added: Collection[str]) -> list[FreeParameter]:
    """Parameters of the machine that rest on a bound."""
    held = (one for one, rests in zip(base.problem.free, base.held, strict=True) if rests)
    return [one for one in held if one.target.kind == "parameter" and one.target.name not in added]


def _moved(path: Path, base: Fit, parameter: FreeParameter) -> Change:
    """The change per unit of the coordinate of one parameter; none where the log knows its value."""
    value = base.values[parameter.name]
    size = _SHIFT * (parameter.upper - parameter.lower)
    size = -size if value + size > parameter.upper else size
    theta = path.theta.copy()
    if parameter.name not in path.log.theta_overrides:
        theta[base.problem.filter_model.model.index("parameter", parameter.name)] += size
    return model_change(path, base.problem.filter_model.model, theta, size / parameter.slope(value))


def candidate_change(path: Path, candidate: Candidate, variant: Variant) -> Change:
    """The changes by the coefficients of a candidate, a lane each."""
    known = path.parameters(candidate.model) | dict(variant.shapes)
    lanes = []
    for name, size in zip(candidate.effect.coefficients, variant.sizes, strict=True):
        theta = candidate.model.theta(**known, **{name: size})
        lanes.append(model_change(path, candidate.model, theta, size))
    return together(lanes)


@dataclass(frozen=True, repr=False)
class Scored:
    """Candidates with the variant of each that fits best, its responses and its scores.

    ``columns`` holds one (n_terms, coefficients) per candidate, ``states`` per log the shifts of the filtered states at
    the gates (gates, n_x, candidates) by the first coefficient; ``tests`` is how many variants were tried in all that
    move anything measured. ``failed`` says of candidates, by their position, why they have no response: they score
    nothing. ``unseen`` are positions of those whose response is none: a leak at an ideal source of pressure.
    """

    candidates: tuple[Candidate, ...]
    variants: tuple[Variant, ...]
    columns: tuple[FloatArray, ...]
    states: tuple[FloatArray, ...]
    scores: Scores
    tests: int
    failed: Mapping[int, str] = field(default_factory=dict)
    unseen: frozenset[int] = frozenset()

    def __repr__(self) -> str:
        return f"<Scored: {len(self.candidates)} candidates, {self.tests} tests>"


def score_candidates(
    linear: Linearisation, found: Sequence[Candidate], at: Sequence[Sequence[int]] | None = None
) -> Scored:
    """Score every candidate in every variant, and keep the best variant of each.

    ``at`` holds samples of each log at which the shifts of the states are kept too.
    """
    every = [(candidate, variant) for candidate in found for variant in candidate.variants]
    at = [()] * len(linear.logs) if at is None else at
    if not every:
        empty = np.zeros((linear.free.shape[0], 0))
        return Scored((), (), (), (), scores(linear.expansion(empty), linear.count, np.zeros(0, dtype=bool)), 0)
    sizes = [len(candidate.effect.coefficients) for candidate, _ in every]
    failed: dict[int, str] = {}
    columns, states = _responses(linear, every, sizes, at, failed)
    result = _scores(linear, columns, [candidate for candidate, _ in every], sizes)
    edges = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    best: dict[int, int] = {}
    for j, k in enumerate(k for k, candidate in enumerate(found) for _ in candidate.variants):
        if k not in best or result.gain[j] > result.gain[best[k]]:
            best[k] = j
    chosen = [best[k] for k in range(len(found))]
    own = tuple(columns[:, edges[j] : edges[j + 1]] for j in chosen)
    picked = _scores(linear, np.concatenate(own, axis=1), found, [sizes[j] for j in chosen])
    kept = tuple(part[..., edges[chosen]] for part in states)
    why = {k: failed[j] for k, j in enumerate(chosen) if j in failed}
    moved = [bool(columns[:, first:end].any()) for first, end in itertools.pairwise(edges)]
    unseen = frozenset(k for k, part in enumerate(own) if k not in why and not part.any())
    variants = tuple(every[j][1] for j in chosen)
    return Scored(tuple(found), variants, own, kept, picked, sum(moved), why, unseen)


def _responses(
    linear: Linearisation,
    every: Sequence[tuple[Candidate, Variant]],
    sizes: Sequence[int],
    at: Sequence[Sequence[int]],
    failed: dict[int, str],
) -> tuple[FloatArray, tuple[FloatArray, ...]]:
    """Responses to the coefficients of candidates, so many each; none, and why in ``failed``, of one that has none."""
    firsts = range(0, len(every), _ABREAST)

    def one(path: Path, k: int) -> Change:
        def none(why: str) -> Change:
            failed[k] = why
            return unchanged(path, sizes[k])

        return attempted(lambda: candidate_change(path, *every[k]), none)

    def some(part: int, log: int) -> Change:
        path = linear.logs[log].path
        return together([one(path, k) for k in range(firsts[part], min(firsts[part] + _ABREAST, len(every)))])

    for log in linear.logs:
        _ = log.path.declared  # once, before threads ask for it
    columns, states = linear.responses([sum(sizes[first : first + _ABREAST]) for first in firsts], some, at)
    edges = np.cumsum([0, *sizes])
    for k, (first, end) in enumerate(itertools.pairwise(edges)):
        if k not in failed and not np.isfinite(columns[:, first:end]).all():
            failed[k] = "its response grows beyond all numbers"
        if k in failed:
            columns[:, first:end] = 0.0
            for part in states:
                part[..., first:end] = 0.0
    return columns, states


def _scores(linear: Linearisation, columns: FloatArray, found: Iterable[Candidate], sizes: Sequence[int]) -> Scores:
    one_sided = np.concatenate([candidate.lower >= 0.0 for candidate in found])
    return scores(linear.expansion(columns), linear.count, one_sided, linear.times, sizes)
