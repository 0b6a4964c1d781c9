"""Values of state equations at a point, in floats: no generated module is needed, only the assignments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from sympy import Expr, Symbol

from bondgraph.declare.expressions import to_text
from bondgraph.declare.floats import NoFloatError, float_value
from bondgraph.declare.quantities import Table, symbol
from bondgraph.derive.equations import Assignment, ImplicitLoop, StateEquations
from bondgraph.derive.jacobian import Row, gradient
from bondgraph.errors import DerivationError, suggest

FloatArray = npt.NDArray[np.float64]
#: Values given in order of declaration, or by name.
Given = Mapping[str, float] | Sequence[float] | FloatArray | None
#: Values of symbols at one point.
Values = dict[Symbol, Any]
#: Residuals of some unknowns, and their Jacobian.
Residuals = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


class Evaluator:
    """Values of the expressions of state equations at one point, in floats.

    Overflow and undefined operations give inf and nan, as in a generated module.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> from bondgraph.derive.derivation import derive
    >>> g = BondGraph("mass")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("push", g.input("F", "N"), at=body)
    >>> _ = g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body, state="v")
    >>> equations = derive(assign_causality(g))
    >>> evaluator = Evaluator(equations)
    >>> values = evaluator.at(u={"F": 3.0})
    >>> float(evaluator.value(equations.derivatives[0], values))
    1.5
    """

    def __init__(self, equations: StateEquations) -> None:
        self.equations = equations
        self.tables = {table.name: _table_values(table) for table in equations.tables}
        self._slopes: dict[str, list[Row]] = {}

    def at(self, x: Given = None, u: Given = None, theta: Given = None, t: float = 0.0) -> Values:
        """Values of time, states, inputs, parameters and all assigned symbols.

        Parameters
        ----------
        x, u, theta
            All values in order of declaration, or some by name; the rest have their initial or default values.
        t
            Time [s].

        Raises
        ------
        DerivationError
            If a name is unknown or the number of values does not fit.
        """
        point: Values = {symbol("t"): np.float64(t)}
        for kind, given in (("state", x), ("input", u), ("parameter", theta)):
            point |= point_values(self.equations, kind, given)
        return self.run(self.equations.assignments, point)

    def run(self, steps: Iterable[Assignment | ImplicitLoop], values: Values) -> Values:
        """The values together with those that the steps assign."""
        values = dict(values)
        with np.errstate(all="ignore"):
            for step in steps:
                if isinstance(step, ImplicitLoop):
                    self._loop(step, values)
                else:
                    values[step.symbol] = self._value(step.expression, values)
        return values

    def value(self, expression: Expr, values: Values) -> np.float64:
        """The value of an expression."""
        with np.errstate(all="ignore"):
            return np.float64(self._value(expression, values))

    def _value(self, expression: Expr, values: Values) -> Any:
        try:
            return float_value(expression, values, self.tables)
        except NoFloatError as error:
            raise DerivationError(
                f"{self.equations.name}: {to_text(error.args[0])} has no numeric value - write the law with arithmetic,"
                " tables and the functions of laws",
                where=(self.equations.name,),
            ) from None

    # ------------------------------------------------------------------ algebraic loops

    def _loop(self, loop: ImplicitLoop, values: Values) -> None:
        """Solve a loop in place: its unknowns and the symbols of its body, nan where there is no solution."""
        if loop.name not in self._slopes:
            active = {*loop.unknowns, *(local.symbol for local in loop.body)}
            expressions = [*(local.expression for local in loop.body), *loop.residuals]
            self._slopes[loop.name] = [gradient(expression, active) for expression in expressions]

        def residuals(unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
            values.update(zip(loop.unknowns, unknowns, strict=True))
            return self._residuals(loop, values)

        start = np.array([self._value(guess, values) for guess in loop.guesses])
        residuals(_root(residuals, start))

    def _residuals(self, loop: ImplicitLoop, values: Values) -> tuple[FloatArray, FloatArray]:
        size = len(loop.unknowns)
        tangents: dict[Symbol, FloatArray] = dict(zip(loop.unknowns, np.eye(size), strict=True))
        slopes = iter(self._slopes[loop.name])

        def tangent() -> FloatArray:
            row = np.zeros(size)
            for used, slope in next(slopes).items():
                row += self._value(slope, values) * tangents[used]
            return row

        for local in loop.body:
            values[local.symbol] = self._value(local.expression, values)
            tangents[local.symbol] = tangent()
        found = np.array([self._value(residual, values) for residual in loop.residuals], dtype=float)
        return found, np.array([tangent() for _ in loop.residuals])


def point_values(equations: StateEquations, kind: str, given: Given) -> Values:
    """Values of all states, inputs or parameters (``kind``: state, input, parameter) by symbol.

    Raises
    ------
    DerivationError
        If a name is unknown or the number of values does not fit.
    """
    if kind == "state":
        defaults = {state.symbol.name: state.initial for state in equations.states}
    elif kind == "input":
        defaults = {signal.name: signal.default for signal in equations.inputs}
    else:
        defaults = {parameter.name: parameter.value for parameter in equations.parameters}
    if isinstance(given, Mapping):
        for name in given:
            if name not in defaults:
                raise DerivationError(f"{equations.name}: no {kind} {name!r}{suggest(name, defaults)}", where=(name,))
        return {symbol(name): np.float64(given.get(name, value)) for name, value in defaults.items()}
    values = list(defaults.values()) if given is None else list(given)
    if len(values) != len(defaults):
        raise DerivationError(
            f"{equations.name}: {len(values)} {kind} values were given, the model has {len(defaults)} - give one for "
            f"each of {', '.join(defaults) or 'none'}, or some by name",
            where=(equations.name,),
        )
    return {symbol(name): np.float64(value) for name, value in zip(defaults, values, strict=True)}


def _table_values(table: Table) -> Callable[[Sequence[float], Sequence[int]], float]:
    """A table's interpolant and its derivatives: values held beyond the ends, slopes zero there."""
    from scipy.interpolate import CubicHermiteSpline as hermite  # noqa: N813 - scipy takes half a second to load, and
    from scipy.interpolate import PchipInterpolator as slopes  # noqa: N813 - who only differentiates needs none of it

    axes = [np.array(knots) for knots in (table.x, table.y) if knots]
    grid = np.array(table.values)
    along = [slopes(knots, grid, axis=axis)(knots, nu=1) for axis, knots in enumerate(axes)]
    if len(axes) == 2:
        cross = (slopes(axes[1], along[0], axis=1)(axes[1], nu=1) + slopes(axes[0], along[1])(axes[0], nu=1)) / 2

    def value(arguments: Sequence[float], orders: Sequence[int]) -> float:
        if any(order and not k[0] <= a <= k[-1] for a, order, k in zip(arguments, orders, axes, strict=True)):
            return 0.0
        held = [float(np.clip(argument, knots[0], knots[-1])) for argument, knots in zip(arguments, axes, strict=True)]
        line = hermite(axes[0], grid, along[0])(held[0], nu=orders[0])
        if len(axes) == 2:
            line_slopes = hermite(axes[0], along[1], cross)(held[0], nu=orders[0])
            line = hermite(axes[1], line, line_slopes)(held[1], nu=orders[1])
        return float(line)

    return value


# ---------------------------------------------------------------------- roots


def _root(function: Residuals, start: FloatArray) -> FloatArray:
    """Where residuals vanish: Newton's method, a slower search where it does not settle; nan where both fail."""
    z, settled = _settled(function, start, start)
    if not settled:
        near = _bracketed(function, start[0]) if start.size == 1 else least_squares(function, start)
        z, settled = (start, False) if near is None else _settled(function, near, start)
    return z if settled else np.full(start.shape, np.nan)


def _settled(function: Residuals, near: FloatArray, start: FloatArray) -> tuple[FloatArray, bool]:
    """The end of Newton's method, and whether only rounding moves it any more."""
    z, step = newton_steps(function, near, 20)
    residual, slopes = function(z)
    if not residual.any():
        return z, True
    size = np.abs(slopes) @ (np.abs(z) + np.abs(z - start))
    return z, vanishes(residual, slopes, size, step, np.abs(z) + np.abs(z - start))


def vanishes(residual: FloatArray, slopes: FloatArray, size: FloatArray, step: FloatArray, moved: FloatArray) -> bool:
    """Whether residuals are zero but for rounding, and the last step too.

    ``size`` is that of the terms of each residual, ``moved`` that of each unknown. Both are asked of each by itself, or
    within rounding of the largest in scales in which no slope exceeds one.

    Examples
    --------
    >>> one = np.ones(1)
    >>> vanishes(1e-16 * one, np.eye(1), one, 1e-16 * one, one), vanishes(0.1 * one, np.eye(1), one, 0.1 * one, one)
    (True, False)
    """
    if not (np.isfinite(slopes).all() and np.isfinite(residual).all() and np.isfinite(step).all()):
        return False
    _, rows, columns = equilibrated(slopes)
    rounding = 1e-12 * (moved / columns).max(initial=0.0)
    zero = (np.abs(residual) <= 1e-9 * size) | (rows * np.abs(residual) <= rounding)
    settled = (np.abs(step) <= 1e-6 * moved) | (np.abs(step) / columns <= rounding)
    return bool(zero.all() and settled.all())


def _bracketed(function: Residuals, start: float) -> FloatArray | None:
    """A root of one residual between the start and the first point, ever further from it, where its sign differs."""
    from scipy.optimize import brentq

    def residual(z: float) -> float:
        return float(function(np.array([z]))[0][0])

    first = residual(start)
    for width in 4.0 ** np.arange(-30, 30):
        for end in (start - width, start + width):
            if residual(end) * first <= 0:
                return np.array([brentq(residual, start, end, xtol=1e-300, rtol=1e-15)])
    return None


def least_squares(function: Residuals, start: FloatArray, weights: FloatArray | float = 1.0) -> FloatArray | None:
    """The nearest point at which the sum of squared residuals is smallest, or None where a value is not finite.

    Examples
    --------
    >>> least_squares(lambda z: (z**2 - 9, np.diag(2 * z)), np.array([1.0])).round(9).tolist()
    [3.0]
    """
    from scipy.optimize import least_squares as smallest

    if not start.size:
        return start
    try:
        found = smallest(
            lambda z: weights * function(z)[0], start, jac=lambda z: np.reshape(weights, (-1, 1)) * function(z)[1],
            x_scale="jac", ftol=1e-15, xtol=1e-15, gtol=1e-15, max_nfev=500,
        )  # fmt: skip
    except (ValueError, np.linalg.LinAlgError):
        return None
    return np.asarray(found.x)


def newton_steps(function: Residuals, z: FloatArray, steps: int = 4) -> tuple[FloatArray, FloatArray]:
    """The point after Newton steps of least length, while they make the residuals smaller, and the last of them.

    Examples
    --------
    >>> newton_steps(lambda z: (z**2 - 2, np.diag(2 * z)), np.array([1.0]), 10)[0].round(12).tolist()
    [1.414213562373]
    """
    step = np.zeros(z.shape)
    residual, slopes = function(z)
    for _ in range(steps):
        if not (np.isfinite(slopes).all() and np.isfinite(residual).all()):
            return z, np.full(z.shape, np.inf)
        scaled, rows, columns = equilibrated(slopes)
        step = -np.linalg.lstsq(scaled, rows * residual, rcond=1e-10)[0] * columns
        next_residual, next_slopes = function(z + step)
        if not np.abs(rows * next_residual).max(initial=0.0) < np.abs(rows * residual).max(initial=0.0):
            break
        z, residual, slopes = z + step, next_residual, next_slopes
    return z, step


def equilibrated(slopes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A matrix whose rows and columns are of one size, so that its rank has no units, and the factors.

    Examples
    --------
    >>> equilibrated(np.array([[1e6, 2.0], [0.0, 1e-3]]))[0].tolist()
    [[1.0, 2e-06], [0.0, 1.0]]
    """

    def reciprocal(sizes: FloatArray) -> FloatArray:
        return 1.0 / np.where(sizes > 0, sizes, 1.0)

    rows = reciprocal(np.abs(slopes).max(axis=1, initial=0.0))
    columns = reciprocal(np.abs(rows[:, None] * slopes).max(axis=0, initial=0.0))
    return rows[:, None] * slopes * columns, rows, columns
