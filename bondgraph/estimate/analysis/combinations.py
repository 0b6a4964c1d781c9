"""What acts only together: directions that logs leave open, said as products or sums of parameters.

Information in the logarithms of the parameters, scaled to a unit diagonal, has eigenvalues that do not depend on units.
A condition index above 30 names a near dependency, and parameters belong to it that have more than half of their
variance there: Belsley, Kuh and Welsch (1980), Regression Diagnostics, section 3.2. What the data do tell of such a
group is the space across from its open directions. In echelon form that space reads as one combination a row: in
logarithms a product of powers, in the values themselves a weighted sum. Near one point both are the same straight line,
so the likelihood decides: it is evaluated along both curves, and the one along which it rises least is the law.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import numpy as np

from bondgraph.estimate.joint import Problem
from bondgraph.estimate.objective import FloatArray
from bondgraph.estimate.symmetric import scaled_eigen

#: Condition index and share of variance from which a dependency counts (Belsley, Kuh and Welsch 1980, page 112).
CONDITION_INDEX, VARIANCE_SHARE = 30.0, 0.5
#: Cosine between the parts of two parameters in open directions from which they share one, a convention: groups that
#: share none are at right angles but for rounding.
_LINKED, _TINY = 0.05, float(np.finfo(float).tiny)
#: Exponents are multiples of 1 over these, up to 4: what laws of mechanics have.
_DENOMINATOR, _LARGEST = 4, 4.0
#: An exponent this far off a small fraction, relative to the largest of its row, is not that fraction.
_NEAR = 0.06
#: Factors by which the parameter moves that moves most along a curve: the first with an end inside all bounds counts.
#: They are conventions, as large as intervals of estimates are.
_FACTORS = (1.15, 1.07, 1.03)
#: A law holds if along it the likelihood rises by less than this share of what it rises when one moves alone; of two
#: along which it rises by less than the second share, which is rounding, the one of simple numbers is said.
_HOLDS, _EXACT = 3e-4, 1e-7

#: Choice of the groups of parameters that are looked at, by their names and their condition index.
Wanted = Callable[[Sequence[str], float], bool]


@dataclass(frozen=True)
class Combination:
    """A group of parameters of which the logs tell only some combinations.

    Parameters
    ----------
    names
        The group.
    known
        What the logs tell, in words: ``"mass*drag"``, ``"a + 2*b"``; one text for each independent combination.
    law
        ``"product"``, ``"sum"``, or ``"locally"`` where neither holds away from the point.
    condition
        Largest condition index of the group.
    rise
        Nats by which the likelihood rises along the law, and by which it rises when one parameter moves as far alone.
    """

    names: tuple[str, ...]
    known: tuple[str, ...]
    law: str
    condition: float
    rise: tuple[float, float]

    def __str__(self) -> str:
        """A sentence without the parameters that the logs tell alone.

        Examples
        --------
        >>> print(Combination(("a", "b", "c"), ("a*b^2", "c"), "product", 40.0, (0.0, 3.0)))
        a and b act only together, as a*b^2
        >>> print(Combination(("a", "b"), ("b",), "product", 40.0, (0.0, 3.0)))
        a: these logs tell next to nothing of it
        """
        group = [one for one in self.names if one not in self.known]
        if not self.together:
            return f"{_listed(group)}: these logs tell next to nothing of {'it' if len(group) == 1 else 'them'}"
        near = {"product": "as", "sum": "as", "locally": "near this point as"}[self.law]
        return f"{_listed(group)} act only together, {near} {_listed(self.together)}"

    @property
    def together(self) -> tuple[str, ...]:
        """The combinations of two parameters and more."""
        return tuple(one for one in self.known if one not in self.names)


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else ""


def combinations(
    problem: Problem, point: FloatArray, information: FloatArray, wanted: Wanted | None = None
) -> tuple[Combination, ...]:
    """Groups of parameters that act only together.

    Parameters
    ----------
    problem
        Free parameters and logs.
    point
        Coordinates, shape (n,).
    information
        Fisher information in them, shape (n, n).
    wanted
        Whether a group is looked at, by its names and its condition index; None: each is. What law it holds takes some
        values of the likelihood.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.estimate.derivatives.differences import central_differences
    >>> from bondgraph.estimate.objective import fitted_expansion
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(pendulum(), {"rate": 0.05}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, 2)
    >>> time = np.arange(100) * 0.05
    >>> log = bg.MatchedLog("swing", time, np.zeros((1, 100)), 0.45 * np.cos(3.1 * time)[np.newaxis])
    >>> problem = bg.pose(swing, log, ["length", "damping"])
    >>> told = fitted_expansion(problem, problem.start, central_differences).information
    >>> combinations(problem, problem.start, told)
    ()
    """
    values = problem.values(point)
    kinds = np.array([one.target.kind == "parameter" for one in problem.free])
    usable = np.flatnonzero(kinds & (values != 0.0) & (np.diag(information) > 0.0))
    if usable.size < 2:
        return ()
    slopes = np.array([one.slope(value) for one, value in zip(problem.free, values, strict=True)])[usable]
    factor = values[usable] / slopes  # derivative of a coordinate by the logarithm of its value
    others = np.setdiff1d(np.arange(values.size), usable)
    inner, following = _without(information, usable, others)
    relative = inner * np.outer(factor, factor)
    eigen = scaled_eigen(relative)
    index = np.sqrt(eigen.largest / np.maximum(eigen.values, 1e-15 * eigen.largest))
    open_ = index > CONDITION_INDEX
    if not open_.any():
        return ()
    directions = eigen.scale[:, np.newaxis] * eigen.vectors[:, open_]
    groups = _groups(eigen.values, eigen.vectors, open_)
    found = []
    for rows in groups:
        along = _Along(problem, point, usable[rows], others, following[:, rows])
        mostly = (eigen.vectors[np.ix_(rows, open_)] ** 2).sum(axis=0) > VARIANCE_SHARE  # directions of this group
        condition = float((index[open_][mostly] if mostly.any() else index[open_]).max())
        if wanted is None or wanted(along.names, condition):
            found.append(_combination(along, directions[rows], condition))
    return tuple(found)


def _without(information: FloatArray, kept: np.ndarray, others: np.ndarray) -> tuple[FloatArray, FloatArray]:
    """Information about some coordinates once the others have taken their share, and how these follow.

    Shapes (m, m) and (o, m): moves of the others for each move of one that is kept.
    """
    cross = information[np.ix_(others, kept)]
    following = -np.linalg.lstsq(information[np.ix_(others, others)], cross)[0] if others.size else cross
    share: FloatArray = information[np.ix_(kept, kept)] + cross.T @ following
    return share, following


def _groups(values: FloatArray, vectors: FloatArray, open_: np.ndarray) -> list[np.ndarray]:
    """Rows that have most of their variance in open directions, those that share a direction together.

    What the logs tell little of has a small part in every direction: its parts are compared with their own length.
    """
    shares = vectors**2 / np.maximum(values, 1e-15 * values.max())
    members = np.flatnonzero(shares[:, open_].sum(axis=1) > VARIANCE_SHARE * shares.sum(axis=1))
    own = vectors[:, open_] / np.maximum(np.linalg.norm(vectors[:, open_], axis=1, keepdims=True), _TINY)
    alike = np.abs(own @ own.T)
    groups: list[set[int]] = []
    for row in map(int, members):
        linked = [group for group in groups if any(alike[row, other] > _LINKED for other in group)]
        groups = [group for group in groups if group not in linked] + [set().union({row}, *linked)]
    return [np.array(sorted(group)) for group in groups if len(group) > 1]


@dataclass(frozen=True)
class _Along:
    """Some parameters of a problem that move, with others that follow: ``following`` (o, k) is coordinates for each."""

    problem: Problem
    point: FloatArray
    rows: np.ndarray
    others: np.ndarray
    following: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that move."""
        return tuple(self.problem.names[row] for row in self.rows)

    @property
    def values(self) -> FloatArray:
        """Values of the parameters that move, shape (k,)."""
        values: FloatArray = self.problem.values(self.point)[self.rows]
        return values

    def rise(self, ends: FloatArray) -> float:
        """Largest change of the likelihood in nats where the parameters have moved to other values (m, k).

        Ends beyond a bound do not count; infinite where none is left, or the likelihood has none.
        """
        free = [self.problem.free[row] for row in self.rows]
        inside = np.all((ends >= [one.lower for one in free]) & (ends <= [one.upper for one in free]), axis=1)
        if not inside.any():
            return math.inf
        members = np.repeat(self.point[:, np.newaxis], int(inside.sum()) + 1, axis=1)
        for row, one, values in zip(self.rows, free, ends[inside].T, strict=True):
            members[row, 1:] = [one.coordinate(float(value)) for value in values]
        members[self.others] += self.following @ (members - self.point[:, np.newaxis])[self.rows]
        nll = self.problem.nll(np.clip(members, self.problem.lower[:, np.newaxis], self.problem.upper[:, np.newaxis]))
        return float(np.abs(nll[1:] - nll[0]).max()) if np.isfinite(nll).all() else math.inf


def _combination(along: _Along, directions: FloatArray, condition: float) -> Combination:
    values, size = along.values, len(along.rows)
    names = along.names
    dimension = int(np.sum(np.linalg.svd(directions, compute_uv=False) > 0.05 * np.linalg.norm(directions, 2)))
    known = {law: _echelon(law.across(directions, values), dimension) for law in _LAWS}
    for factor in _FACTORS:
        alone = along.rise(_SUM.curve(values, values * np.eye(size)[:1], factor))
        rises = {law: along.rise(law.curve(values, _open_moves(known[law]), factor)) for law in _LAWS}
        if alone < math.inf and min(rises.values()) < math.inf:
            break
    best = min(_LAWS, key=lambda law: (max(rises[law], _EXACT * alone), not all(map(_is_simple, known[law]))))
    holds = rises[best] <= _HOLDS * alone
    said = best if holds else _PRODUCT
    written = tuple(said.written(_kept(names, row)) for row in known[said])
    return Combination(names, written, best.name if holds else "locally", condition, (rises[best], alone))


def _echelon(directions: FloatArray, dimension: int) -> FloatArray:
    """Reduced echelon form of what is across from some directions (k, m), shape (k - dimension, k).

    Small fractions are taken for the numbers near them, if all of a row are such.
    """
    left: FloatArray = np.linalg.svd(directions)[0]
    rows = left[:, dimension:].T.copy()
    used: list[int] = []
    for row in range(rows.shape[0]):
        sizes = np.abs(rows[row]) * ~np.isin(np.arange(rows.shape[1]), used)
        column = int(
            np.argmax(sizes > 0.5 * sizes.max())
        )  # the first of the large ones, so that names keep their order
        used.append(column)
        rows[row] /= rows[row, column]
        for other in range(rows.shape[0]):
            if other != row:
                rows[other] -= rows[other, column] * rows[row]
    return np.array([_simple(row) for row in rows]).reshape(rows.shape)


def _simple(row: FloatArray) -> FloatArray:
    """A row of small fractions near the one given, or that one."""
    near = np.array([float(Fraction(float(x)).limit_denominator(_DENOMINATOR)) for x in row])
    fits = np.abs(near - row).max() < _NEAR * np.abs(row).max() and np.abs(near).max() <= _LARGEST
    return near if fits else row


def _is_simple(row: FloatArray) -> bool:
    return all(float(Fraction(float(x)).limit_denominator(_DENOMINATOR)) == x for x in row)


def _open_moves(exponents: FloatArray) -> FloatArray:
    """Directions (m, k) along which all combinations (k - m, k) stay as they are."""
    moves: FloatArray = np.linalg.svd(exponents)[2][exponents.shape[0] :]
    return moves


def _kept(names: Sequence[str], row: FloatArray) -> list[tuple[str, float]]:
    """The parts of a combination that are not next to nothing."""
    return [(name, float(x)) for name, x in zip(names, row, strict=True) if abs(x) > _NEAR * np.abs(row).max()]


def _product_text(kept: Sequence[tuple[str, float]]) -> str:
    """Powers above and below a stroke.

    Examples
    --------
    >>> _product_text([("a", 1.0), ("b", -0.5), ("c", 2.0)])
    'a*c^2/b^(1/2)'
    """
    over = [_power(name, x) for name, x in kept if x > 0.0]
    under = [_power(name, -x) for name, x in kept if x < 0.0]
    below = under[0] if len(under) == 1 else f"({'*'.join(under)})"
    return ("*".join(over) or "1") + (f"/{below}" if under else "")


def _power(name: str, exponent: float) -> str:
    if exponent == 1.0:
        return name
    fraction = Fraction(exponent).limit_denominator(_DENOMINATOR)
    if float(fraction) != exponent:
        return f"{name}^{exponent:.2g}"
    return f"{name}^{fraction}" if fraction.denominator == 1 else f"{name}^({fraction})"


def _sum_text(kept: Sequence[tuple[str, float]]) -> str:
    """Terms with their weights.

    Examples
    --------
    >>> _sum_text([("a", 1.0), ("b", -2.0)])
    'a - 2*b'
    """
    terms = [(f"{abs(x):.3g}*" if abs(x) != 1.0 else "") + name for name, x in kept]
    signs = ["-" if x < 0.0 else "+" for _, x in kept]
    first = ("-" if signs[0] == "-" else "") + terms[0]
    return first + "".join(f" {sign} {term}" for sign, term in zip(signs[1:], terms[1:], strict=True))


class _Law(Protocol):
    """A form that combinations of parameters may have, with its curves through a point."""

    @property
    def name(self) -> str:
        """In a :class:`Combination`."""

    def across(self, directions: FloatArray, values: FloatArray) -> FloatArray:
        """Open directions (k, m) in what the law is linear in, of those in the logarithms of values (k,)."""

    def curve(self, values: FloatArray, moves: FloatArray, factor: float) -> FloatArray:
        """Values (2 m, k) at both ends of curves along moves (m, k) of what the law is linear in.

        The parameter that moves most, moves by the same factor under either law.
        """

    def written(self, kept: Sequence[tuple[str, float]]) -> str:
        """A combination in words; empty where nothing is left."""


class _Product:
    """Powers of the parameters, linear in their logarithms."""

    name = "product"

    def across(self, directions: FloatArray, values: FloatArray) -> FloatArray:
        """The same."""
        return directions

    def curve(self, values: FloatArray, moves: FloatArray, factor: float) -> FloatArray:
        """Logarithms move evenly."""
        found: FloatArray = values * np.exp(_both_sides(moves, math.log(factor)))
        return found

    def written(self, kept: Sequence[tuple[str, float]]) -> str:
        """Powers above and below a stroke."""
        return _product_text(kept)


class _Sum:
    """A weighted sum of the parameters themselves."""

    name = "sum"

    def across(self, directions: FloatArray, values: FloatArray) -> FloatArray:
        """Moves of values, which are those of logarithms times the values."""
        return directions * values[:, np.newaxis]

    def curve(self, values: FloatArray, moves: FloatArray, factor: float) -> FloatArray:
        """Values move evenly."""
        return values * (1.0 + _both_sides(moves / values, factor - 1.0))

    def written(self, kept: Sequence[tuple[str, float]]) -> str:
        """Terms with their signs."""
        return _sum_text(kept)


def _both_sides(shares: FloatArray, size: float) -> FloatArray:
    """Moves (2 m, k) to both sides of which the largest has a size."""
    scaled = shares / np.abs(shares).max(axis=1, keepdims=True)
    return np.concatenate([size * scaled, -size * scaled])


_PRODUCT, _SUM = _Product(), _Sum()
_LAWS: tuple[_Law, ...] = (_PRODUCT, _SUM)
