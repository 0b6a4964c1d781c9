"""The equations of a model and its integration steps on jets: values with their first and second derivatives.

The equations are differentiated on their tape, forward in one direction, and what comes out forward in another. A stiff
method solves (1/(gamma h) I - J) k = r in every stage. Its solution moves with J, whose derivatives along k are those
of the product J v with v = k held: third derivatives of the laws, but only along the directions asked,

    W dk = dr + d(J v),    W d2k = d2r + d2(J v) + d(J dv) + d(J dv)',    W = 1/(gamma h) I - J.

So no entry of a Jacobian is differentiated by itself. Griewank and Walther (2008), Evaluating Derivatives, chapter 13.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.compile.ir.tape import Program
from bondgraph.compile.passes.tangent import tangents
from bondgraph.compile.rosenbrock import TABLEAUS, Tableau
from bondgraph.filter.filter_model import FilterModel
from bondgraph.filter.second_order import Jet, joined
from bondgraph.simulate.inputs import InputSegment
from bondgraph.simulate.stiff import step_lengths


class MovingModel:
    """The equations of a filter's model with first and second derivatives, along states and parameters that move.

    Parameters
    ----------
    filter_model
        Model, method, and the parameters that are states.
    theta
        Parameters (n_theta,) and how they move in D directions.

    Examples
    --------
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = FilterModel(pendulum(), {}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, method="ros3p")
    >>> theta = Jet.still(swing.model.theta(), 1)
    >>> rest = InputSegment(0.0, 0.1, np.zeros(1), np.zeros(1))
    >>> start = Jet(np.zeros((2, 1)), np.ones((2, 1, 1)), np.zeros((2, 1, 1, 1)))
    >>> MovingModel(swing, theta).moved(start, rest, 1, 1.0).d.shape
    (2, 1, 1)
    """

    def __init__(self, filter_model: FilterModel, theta: Jet) -> None:
        model = filter_model.model
        self._program, self._theta, self._size = model.program.anew(), theta, len(model.states)
        self._appended = [int(row) for row in filter_model.appended_index]
        self._tableau = TABLEAUS.get(filter_model.method)
        self._directions = theta.d.shape[-1]
        moving = {int(row) for row in np.flatnonzero(theta.d.any(axis=1))}.union(self._appended)
        self._places = [*(("x", i) for i in range(self._size)), *(("theta", i) for i in sorted(moving))]
        rows = self._program.rows
        self._rhs, self._output = (self._differentiated(rows["rhs"]), self._differentiated(rows["output"]))
        if self._tableau is not None:
            self._prepare_stiff()

    def _prepare_stiff(self) -> None:
        """Programs of the trend in time, and of what the Jacobian's product with a vector v moves by."""
        program, tape = self._program, self._program.tape
        self._trend = self._differentiated(program.trend_nodes())
        held = {tape.leaf("x", i): tape.leaf("v", i) for i in range(self._size)}
        pulled = tangents(program.reader, program.rows["rhs"], held)
        self._pull = tape.program(tangents(program.reader, pulled, self._seeds("_1")))
        vectors = [("v", i) for i in range(self._size)]
        self._second_pull = self._differentiated(pulled, vectors, parts=(2,))

    def _seeds(self, suffix: str, more: Sequence[tuple[str, int]] = ()) -> dict[int, int]:
        """Derivatives of all that moves in a direction, as leaves with this suffix."""
        tape = self._program.tape
        return {tape.leaf(name, i): tape.leaf(name + suffix, i) for name, i in (*self._places, *more)}

    def _differentiated(
        self, rows: Sequence[int], more: Sequence[tuple[str, int]] = (), parts: tuple[int, ...] = (0, 1, 2)
    ) -> Program:
        """Rows, their derivatives in one direction, and the derivatives of those in another; or some of these parts.

        ``more`` are vectors that move along straight lines.
        """
        program, tape = self._program, self._program.tape
        both = {tape.leaf(f"{name}_1", i): tape.leaf(f"{name}_12", i) for name, i in self._places}
        first = tangents(program.reader, rows, self._seeds("_1", more))
        second = tangents(program.reader, first, {**self._seeds("_2", more), **both})
        return tape.program([node for part in parts for node in (rows, first, second)[part]])

    def outputs(self, t: float, x: Jet, u: FloatArray) -> Jet:
        """Outputs (n_y, points) at states of the filter (n_s, points) and inputs (n_u,)."""
        return self._evaluated(self._output, self._leaves(x, t, u), x)

    def moved(self, x: Jet, segment: InputSegment, substeps: int, grading: float) -> Jet:
        """States of the filter after a segment of the inputs; appended parameters stay."""
        inner = x[: self._size]
        if self._tableau is None:
            step = (segment.end - segment.start) / substeps
            for k in range(substeps):
                inner = self._explicit(x, inner, segment, segment.start + k * step, step)
        else:
            t = segment.start
            for length in step_lengths(segment.end - segment.start, substeps, grading):
                inner = self._implicit(self._tableau, x, inner, segment, t, float(length))
                t += float(length)
        return joined([inner, x[self._size :]]) if self._appended else inner

    def _explicit(self, x: Jet, inner: Jet, segment: InputSegment, t: float, step: float) -> Jet:
        """A step as :class:`bondgraph.simulate.integrators.RK4` takes it."""

        def slope(share: float, state: Jet) -> Jet:
            now = t + share * step
            return self._evaluated(self._rhs, self._leaves(x, now, segment.at(now), state), x)

        slope_1 = slope(0.0, inner)
        slope_2 = slope(0.5, inner + slope_1 * (0.5 * step))
        slope_3 = slope(0.5, inner + slope_2 * (0.5 * step))
        slope_4 = slope(1.0, inner + slope_3 * step)
        return inner + (slope_1 + (slope_2 + slope_3) * 2.0 + slope_4) * (step / 6.0)

    def _implicit(self, tableau: Tableau, x: Jet, inner: Jet, segment: InputSegment, t: float, step: float) -> Jet:
        """A step as :class:`bondgraph.simulate.stiff.Rosenbrock` takes it."""
        u = segment.at(t)
        rates = (segment.right - segment.left) / (segment.end - segment.start)
        start = self._leaves(x, t, u, inner)
        matrix = self._matrix(x, inner, t, u, 1.0 / (tableau.gamma * step))
        trend = self._evaluated(self._trend, {**start, "du": rates}, x)
        stages: list[Jet] = []
        slope = trend
        for s in range(tableau.stages):
            if tableau.is_new(s):
                point = _summed(inner, tableau.a[s], stages)
                now = t + tableau.alpha[s] * step
                slope = self._evaluated(self._rhs, self._leaves(x, now, segment.at(now), point), x)
            right = slope + trend * (tableau.gammas[s] * step)
            stages.append(self._solved(matrix, start, _summed(right, [c / step for c in tableau.c[s]], stages)))
        return _summed(inner, tableau.m, stages)

    def _matrix(self, x: Jet, inner: Jet, t: float, u: FloatArray, diagonal: float) -> FloatArray:
        """The matrices W of a step, shape (points, n_x, n_x)."""
        theta = np.repeat(self._theta.v[:, np.newaxis], inner.v.shape[1], axis=1)
        theta[self._appended] = x.v[self._size :]
        jacobian = self._program.dense_jacobian("rhs", "x", t, inner.v, u, theta)
        found: FloatArray = diagonal * np.eye(self._size) - np.moveaxis(jacobian, -1, 0)
        return found

    def _solved(self, matrix: FloatArray, start: Mapping[str, Any], right: Jet) -> Jet:
        """The solution k (n_x, points) of W k = right, where W moves with the state at the start of the step."""
        batch = (right.v.shape[1], self._directions, self._directions)
        value = _solve(matrix, right.v)
        held = {**start, "v": value[..., np.newaxis, np.newaxis]}
        pulled = self._program.evaluate(self._pull, held, batch)[..., 0]
        slopes = _solve(matrix, right.d + pulled)
        moving = {**held, "v_1": slopes[..., :, np.newaxis], "v_2": slopes[..., np.newaxis, :]}
        return Jet(value, slopes, _solve(matrix, right.h + self._program.evaluate(self._second_pull, moving, batch)))

    def _leaves(self, x: Jet, t: float, u: FloatArray, inner: Jet | None = None) -> dict[str, Any]:
        """Vectors by name at states (n_x, points); parameters that are states are those of x (n_s, points)."""
        state, theta = (x[: self._size] if inner is None else inner), self._theta
        found: dict[str, Any] = {"t": (t,), "u": u}
        for name, values in (("x", _spread(state)), ("theta", _spread(theta[:, np.newaxis]))):
            found |= {f"{name}{suffix}": list(value) for suffix, value in zip(_SUFFIXES, values, strict=True)}
        followed = _spread(x[self._size :])
        for suffix, value in zip(_SUFFIXES, followed, strict=True):
            for row, own in zip(self._appended, value, strict=True):
                found[f"theta{suffix}"][row] = own
        return found

    def _evaluated(self, program: Program, leaves: Mapping[str, Any], x: Jet) -> Jet:
        """Rows (rows, points) of a program with all its derivatives."""
        batch = (x.v.shape[1], self._directions, self._directions)
        found = self._program.evaluate(program, leaves, batch)
        count = found.shape[0] // 3
        return Jet(found[:count, :, 0, 0], found[count : 2 * count, :, :, 0], found[2 * count :])


#: Values, derivatives in one direction and in the other, and second derivatives.
_SUFFIXES = ("", "_1", "_2", "_12")


def _spread(jet: Jet) -> tuple[FloatArray, ...]:
    """Values and derivatives, by :data:`_SUFFIXES`, with axes for points and both directions."""
    own = np.newaxis
    return jet.v[..., own, own], jet.d[..., :, own], jet.d[..., own, :], jet.h


def _summed(start: Jet, factors: Sequence[float], stages: Sequence[Jet]) -> Jet:
    """A start and multiples of the stages so far."""
    for factor, stage in zip(factors, stages, strict=True):
        start = start + stage * factor
    return start


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solutions of systems (points, n, n) for right sides (n, points, ...); NaN where one is singular."""
    rows: FloatArray = np.moveaxis(right, 1, 0)
    try:
        solved = np.linalg.solve(matrix, rows.reshape(*rows.shape[:2], -1))
    except np.linalg.LinAlgError:
        return np.full_like(right, np.nan)
    found: FloatArray = np.moveaxis(np.asarray(solved, dtype=np.float64).reshape(rows.shape), 0, 1)
    return found
