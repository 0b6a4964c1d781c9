"""Best subsets of the library at a place: every sum of up to three terms, by what the linearised filter tells of them.

The responses of the innovations to all terms, free parameters taken out, give score and information of every sum at
once: its gain is r' D^-1 r / 2, so that sums are searched exhaustively without a refit. What the free parameters of the
model can take is left of no term: a line in the displacement of a spring whose stiffness is free is not offered.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from bondgraph.correct.constants import FREE_TAKE, INDIFFERENT
from bondgraph.correct.places.probes import Probe, Signal, shaped
from bondgraph.correct.scores.score import Projected, solve
from bondgraph.correct.scores.scoring import Linearisation
from bondgraph.correct.shapes.library import Term, library, products
from bondgraph.data.log import FloatArray
from bondgraph.filter.linear.response import Change

#: Terms of a sum at most.
MOST_TERMS = 3
#: Sums of three are made of so many terms, those that gain most alone or beside the best: more are more than 2300 sums.
_OF_THREE = 25
#: Products whose information is formed at once, which takes the square of their number. A convention.
_AT_ONCE = 32
#: Sums whose least eigenvalue of scaled information is below this are one term but for rounding.
_ALIKE = 1e-6


@dataclass(frozen=True)
class Sum:
    """A sum of terms: their coefficients as the linear filter estimates them (laws,), and its gain in nats.

    ``worth`` is the gain less half a logarithm of the measurements for every parameter, and less the logarithm of how
    many sums of so many terms were tried.
    """

    terms: tuple[Term, ...]
    step: FloatArray
    gain: float
    worth: float


@dataclass(frozen=True)
class Terms:
    """The terms of a library at one place with their scores; ``edges`` (terms + 1,) are the columns of each."""

    probe: Probe
    terms: tuple[Term, ...]
    edges: FloatArray
    score: FloatArray
    information: FloatArray

    def columns(self, chosen: Sequence[int]) -> list[int]:
        """Columns of some terms."""
        return [column for k in chosen for column in range(int(self.edges[k]), int(self.edges[k + 1]))]

    def responses(self, linear: Linearisation, chosen: Sum, known: Sequence[Signal]) -> FloatArray:
        """Responses (n_terms, laws) to the laws of a sum."""
        return _responses(linear, self.probe, chosen.terms, known)


def scored_terms(linear: Linearisation, probe: Probe, known: Sequence[Signal], of: Sequence[Signal]) -> Terms:
    """The terms in some signals at one place, those of which parameters leave something."""
    terms = list({(one.name, one.inner): one for signal in of for one in library(known, signal)}.values())
    return _scored(linear, probe, known, terms)


def scored_products(linear: Linearisation, probe: Probe, known: Sequence[Signal]) -> Terms:
    """The products of signals at one place, those of which parameters leave something; each is looked at alone.

    What they tell together is formed of a few at once, and is zero between these.
    """
    own = f"{'flow' if probe.variable == 'effort' else 'effort'} of {probe.place.label}"
    every = products(known, own)
    parts = [_scored(linear, probe, known, every[first : first + _AT_ONCE]) for first in range(0, len(every), _AT_ONCE)]
    sizes = [len(term.kind.laws) for part in parts for term in part.terms]
    return Terms(
        probe, tuple(term for part in parts for term in part.terms), np.cumsum([0, *sizes]),
        np.concatenate([np.zeros(0), *(part.score for part in parts)]),
        block_diag(*(part.information for part in parts)),
    )  # fmt: skip


def _scored(linear: Linearisation, probe: Probe, known: Sequence[Signal], terms: Sequence[Term]) -> Terms:
    sizes = [len(term.kind.laws) for term in terms]
    columns = _responses(linear, probe, terms, known)
    projected = linear.projected(columns)
    left = linear.left_by_parameters(columns) > FREE_TAKE
    edges = np.cumsum([0, *sizes])
    kept = [k for k in range(len(terms)) if left[edges[k] : edges[k + 1]].all()]
    return _only(Terms(probe, tuple(terms), edges, projected.score, projected.information), kept, projected)


def elsewhere(linear: Linearisation, chosen: Sum, own: Probe, other: Probe, known: Sequence[Signal]) -> Sum | None:
    """The same terms at another place, where their responses are the same; None where the logs tell the two apart.

    Of two responses with the correlation r one loses the share 1 - r^2 of its gain in the place of the other.
    """
    here, there = (_responses(linear, probe, chosen.terms, known) for probe in (own, other))
    if lost(linear, here, there) * chosen.gain >= INDIFFERENT:
        return None
    projected = linear.projected(there)
    told = _best(projected.score, projected.information)
    return None if told is None else replace(chosen, step=told[0], gain=told[1])


def lost(linear: Linearisation, columns: FloatArray, others: FloatArray) -> float:
    """Share of what some responses (n_terms, k) explain that is lost where others (n_terms, m) take their place."""
    projected = linear.projected(np.concatenate([columns, others], axis=1))
    information, split = projected.information, columns.shape[1]
    inner, across = information[:split, :split], information[:split, split:]
    kept = np.trace(solve(inner, across @ solve(information[split:, split:], across.T))) / split
    return float(1.0 - min(kept, 1.0))


def _responses(linear: Linearisation, probe: Probe, terms: Sequence[Term], known: Sequence[Signal]) -> FloatArray:
    """Responses (n_terms, laws) to the laws of terms; none where a term grows beyond all numbers."""

    def one_term(part: int, log: int) -> Change:
        return shaped(probe.changes[log], terms[part].courses(known, log))

    columns, _ = linear.responses([len(term.kind.laws) for term in terms], one_term)
    columns[:, ~np.isfinite(columns).all(axis=0)] = 0.0
    return columns


def _only(every: Terms, kept: Sequence[int], projected: Projected) -> Terms:
    """The terms that are kept."""
    rows = every.columns(kept)
    sizes = [len(every.terms[k].kind.laws) for k in kept]
    return Terms(
        every.probe, tuple(every.terms[k] for k in kept), np.cumsum([0, *sizes]), projected.score[rows],
        projected.information[np.ix_(rows, rows)],
    )  # fmt: skip


def best_sums(found: Terms, measured: int, most: int = MOST_TERMS, each: int = 4) -> list[Sum]:
    """The best sums of one term, of two, up to ``most``; ``each`` of every length, the best first.

    Of sums that differ in an inner parameter alone the best is kept.
    """
    listed: list[Sum] = []
    for size in range(1, most + 1):
        ranked = sorted(_of_size(found, size, measured), key=lambda one: -one.worth)
        kept: dict[tuple[str, ...], Sum] = {}
        for one in ranked:
            kept.setdefault(tuple(term.name for term in one.terms), one)
        listed += list(kept.values())[:each]
    return listed


def tried(found: Terms, size: int) -> int:
    """How many sums of so many terms there are, without terms that are laws of their own in sums of several."""
    count = sum(size == 1 or not term.kind.alone for term in found.terms)
    return math.comb(count, size) if count >= size else 0


def _of_size(found: Terms, size: int, measured: int) -> Iterator[Sum]:
    parts = [k for k, term in enumerate(found.terms) if size == 1 or not term.kind.alone]
    pool = parts if size < MOST_TERMS else _foremost(found, parts)
    among = math.log(max(tried(found, size), 1))
    for chosen in itertools.combinations(pool, size):
        terms = tuple(found.terms[k] for k in chosen)
        if len({term.name for term in terms}) < size:
            continue
        rows = found.columns(chosen)
        told = _best(found.score[rows], found.information[np.ix_(rows, rows)])
        if told is None:
            continue
        step, gain = told
        parameters = len(rows) + sum(bool(term.kind.inner) for term in terms)
        yield Sum(terms, step, gain, gain - 0.5 * parameters * math.log(max(measured, 2)) - among)


def _best(score: FloatArray, information: FloatArray) -> tuple[FloatArray, float] | None:
    """Step and gain of some columns together; None where they are one but for rounding."""
    scale = 1.0 / np.sqrt(np.diag(information))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    if values[0] < _ALIKE:
        return None
    step = scale * (vectors @ ((vectors.T @ (scale * score)) / values))
    return step, 0.5 * float(score @ step)


def _foremost(found: Terms, parts: Sequence[int]) -> list[int]:
    """Terms for sums of three: those that gain most alone, and most beside the one that does."""
    if not parts:
        return []
    order = sorted(parts, key=lambda k: -_gain(found, [k]))
    second = [order[0], *sorted(order[1:], key=lambda k: -_gain(found, [order[0], k]))]
    mixed = dict.fromkeys(k for pair in zip(order, second, strict=True) for k in pair)
    return list(mixed)[:_OF_THREE]


def _gain(found: Terms, chosen: Sequence[int]) -> float:
    rows = found.columns(chosen)
    told = _best(found.score[rows], found.information[np.ix_(rows, rows)])
    return 0.0 if told is None else told[1]
