"""Linear models of state equations at an operating point, equilibria, modes, and transfer functions.

Numbers come from the assignments of the equations and of their Jacobian, evaluated in floats: derivatives are exact, no
step is chosen. Transfer functions of linear graphs are exact, by Cramer's rule,

    H(s) = d + (det(s I - A + b c) - det(s I - A)) / det(s I - A),

over rational functions of the parameters or, with numbers for the parameters, over the rational numbers, which also
serves large models.
"""

from __future__ import annotations

import enum
import functools
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import mpmath
import numpy as np
import numpy.typing as npt
import scipy.interpolate
import scipy.linalg
import scipy.optimize
import sympy
from sympy import QQ, Expr, Rational, Symbol
from sympy.polys.matrices import DomainMatrix

from bondgraph.declare.expressions import to_text
from bondgraph.declare.functions import TableFunction, maximum, minimum
from bondgraph.declare.quantities import Table, symbol
from bondgraph.derive.equations import Assignment, ImplicitLoop, OutputEquation, StateEquations
from bondgraph.derive.jacobian import Jacobian, JacobianBlock, Row, gradient, jacobian
from bondgraph.errors import DerivationError, suggest

FloatArray = npt.NDArray[np.float64]
Given = Mapping[str, float] | Sequence[float] | FloatArray | None
Values = dict[Symbol, Any]

#: The variable of transfer functions; unlike a parameter of that name it is not real.
LAPLACE_S = Symbol("s")

_UFUNCS: dict[Any, Callable[..., Any]] = {
    sympy.sin: np.sin, sympy.cos: np.cos, sympy.tan: np.tan, sympy.asin: np.arcsin, sympy.acos: np.arccos,
    sympy.atan: np.arctan, sympy.atan2: np.arctan2, sympy.sinh: np.sinh, sympy.cosh: np.cosh, sympy.tanh: np.tanh,
    sympy.asinh: np.arcsinh, sympy.acosh: np.arccosh, sympy.atanh: np.arctanh, sympy.exp: np.exp, sympy.log: np.log,
    sympy.Abs: np.abs, sympy.sign: np.sign, sympy.floor: np.floor, sympy.ceiling: np.ceil,
    minimum: np.minimum, maximum: np.maximum, sympy.Pow: np.power,
    sympy.Gt: np.greater, sympy.Ge: np.greater_equal, sympy.Lt: np.less, sympy.Le: np.less_equal,
    sympy.Eq: np.equal, sympy.Ne: np.not_equal, sympy.Not: np.logical_not,
}  # fmt: skip


# ---------------------------------------------------------------------- values at a point


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
            point |= _point(self.equations, kind, given)
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

    def _value(self, node: Any, values: Values) -> Any:
        if isinstance(node, Symbol):
            return values[node]
        if isinstance(node, sympy.Add):
            return sum(self._value(term, values) for term in node.args)
        if isinstance(node, sympy.Mul):
            return np.prod([self._value(factor, values) for factor in node.args])
        if node.is_number and not node.is_Boolean:
            return np.float64(node)
        if isinstance(node, sympy.Piecewise):
            chosen = (branch for branch, condition in node.args if self._value(condition, values))
            return self._value(next(chosen, sympy.nan), values)
        if isinstance(node, TableFunction):
            arguments = [self._value(argument, values) for argument in node.args]
            return self.tables[node.table_name](arguments, node.derivative or (0,) * len(arguments))
        if isinstance(node, sympy.And | sympy.Or):
            return (all if isinstance(node, sympy.And) else any)(self._value(part, values) for part in node.args)
        if node in (sympy.true, sympy.false):
            return bool(node)
        function = _UFUNCS.get(node.func)
        if function is None:
            raise DerivationError(
                f"{self.equations.name}: {to_text(node)} has no numeric value - write the law with arithmetic, tables "
                "and the functions of laws",
                where=(self.equations.name,),
            )
        return function(*(self._value(argument, values) for argument in node.args))

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


def _point(equations: StateEquations, kind: str, given: Given) -> Values:
    """Values of all states, inputs or parameters by symbol."""
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
    slopes = scipy.interpolate.PchipInterpolator
    hermite = scipy.interpolate.CubicHermiteSpline
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

Function = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def _root(function: Function, start: FloatArray) -> FloatArray:
    """Where residuals vanish: Newton's method or, where it does not settle, a slower search; nan where that fails too."""
    z, settled = _settled(function, start, start)
    if not settled:
        near = _bracketed(function, start[0]) if start.size == 1 else _least_squares(function, start)
        z, settled = (start, False) if near is None else _settled(function, near, start)
    return z if settled else np.full(start.shape, np.nan)


def _settled(function: Function, near: FloatArray, start: FloatArray) -> tuple[FloatArray, bool]:
    """The end of Newton's method, and whether only rounding moves it any more."""
    z, step = _polished(function, near, 20)
    slopes = function(z)[1]
    if not (np.isfinite(slopes).all() and np.isfinite(step).all()):
        return z, False
    rounding = np.abs(np.linalg.pinv(slopes)) @ (np.abs(slopes) @ np.abs(z))
    return z, bool((np.abs(step) <= 1e-9 * (rounding + np.abs(z - start))).all())


def _bracketed(function: Function, start: float) -> FloatArray | None:
    """A root of one residual between the start and the first point, ever further from it, where its sign differs."""

    def residual(z: float) -> float:
        return float(function(np.array([z]))[0][0])

    first = residual(start)
    if first == 0:
        return np.array([start])
    for width in 4.0 ** np.arange(-30, 30):
        for end in (start - width, start + width):
            if residual(end) * first <= 0:
                return np.array([scipy.optimize.brentq(residual, start, end, xtol=1e-300, rtol=1e-15)])
    return None


def _least_squares(function: Function, start: FloatArray, weights: FloatArray | float = 1.0) -> FloatArray | None:
    """The nearest point at which the sum of squared residuals is smallest, or None where a value is not finite."""
    if not start.size:
        return start
    try:
        found = scipy.optimize.least_squares(
            lambda z: weights * function(z)[0], start, jac=lambda z: np.reshape(weights, (-1, 1)) * function(z)[1],
            x_scale="jac", ftol=1e-15, xtol=1e-15, gtol=1e-15, max_nfev=500,
        )  # fmt: skip
    except (ValueError, np.linalg.LinAlgError):
        return None
    return np.asarray(found.x)


def _polished(function: Function, z: FloatArray, steps: int = 4) -> tuple[FloatArray, FloatArray]:
    """The point after some Newton steps of least length, and the last of them."""
    step = np.zeros(z.shape)
    for _ in range(steps):
        residual, slopes = function(z)
        if not (np.isfinite(slopes).all() and np.isfinite(residual).all()):
            return z, np.full(z.shape, np.inf)
        scaled, rows, columns = _scaled(slopes)
        step = -np.linalg.lstsq(scaled, rows * residual, rcond=1e-10)[0] * columns
        z = z + step
        if (np.abs(step) <= 1e-15 * np.abs(z)).all():
            break
    return z, step


def _scaled(slopes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A matrix whose rows and columns are of one size, so that its rank does not depend on units, and the factors."""

    def reciprocal(sizes: FloatArray) -> FloatArray:
        return 1.0 / np.where(sizes > 0, sizes, 1.0)

    rows = reciprocal(np.abs(slopes).max(axis=1, initial=0.0))
    columns = reciprocal(np.abs(rows[:, None] * slopes).max(axis=0, initial=0.0))
    return rows[:, None] * slopes * columns, rows, columns


# ---------------------------------------------------------------------- linear models


class Units(NamedTuple):
    """Units of the states, inputs and outputs of a linear model."""

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


@dataclass(frozen=True)
class LinearModel:
    """A model near an operating point: ``dx/dt = rates + A (x - x0) + B (u - u0)``, ``y = values + C .. + D ..``.

    Shapes: ``A`` (n_x, n_x), ``B`` (n_x, n_u), ``C`` (n_y, n_x), ``D`` (n_y, n_u), ``rates`` and ``x`` (n_x,), ``u``
    (n_u,), ``values`` (n_y,). An entry has the unit of its row (per second for rates) divided by that of its column.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: Units
    x: FloatArray
    u: FloatArray
    rates: FloatArray
    values: FloatArray


def linearise(
    equations: StateEquations,
    x: Given = None,
    u: Given = None,
    theta: Given = None,
    t: float = 0.0,
    slopes: Jacobian | None = None,
) -> LinearModel:
    """The linear model at an operating point, which need not be an equilibrium.

    Parameters
    ----------
    equations
        As derived.
    x, u, theta
        Operating point: all values in order of declaration, or some by name; the rest are initial or default values.
    t
        Time [s].
    slopes
        Jacobian by ``x`` and ``u`` where it is known already: for many points of one model.

    Raises
    ------
    DerivationError
        If a name is unknown, or equations or slopes have no finite value at the point.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> from bondgraph.derive.derivation import derive
    >>> g = BondGraph("car")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("engine", g.input("F", "N"), at=body)
    >>> _ = g.inertance("mass", 800.0, at=body, state="v")
    >>> _ = g.resistance("aero", lambda v: 0.4 * v**2, at=body)
    >>> model = linearise(derive(assign_causality(g)), x={"v": 20.0})
    >>> model.A.tolist(), model.B.tolist(), model.rates.tolist()
    ([[-0.02]], [[0.00125]], [-0.2])
    """
    slopes = slopes or jacobian(equations, by=("x", "u"))
    evaluator = Evaluator(equations)
    values = evaluator.run(slopes.assignments, evaluator.at(x, u, theta, t))
    states, inputs, outputs = equations.states, equations.inputs, equations.outputs
    model = LinearModel(
        _dense(evaluator, slopes.block("derivatives", "x"), values),
        _dense(evaluator, slopes.block("derivatives", "u"), values),
        _dense(evaluator, slopes.block("outputs", "x"), values),
        _dense(evaluator, slopes.block("outputs", "u"), values),
        tuple(state.symbol.name for state in states),
        tuple(signal.name for signal in inputs),
        tuple(str(output.symbol) for output in outputs),
        Units(tuple(s.unit for s in states), tuple(i.unit for i in inputs), tuple(o.unit for o in outputs)),
        np.array([values[state.symbol] for state in states], dtype=float),
        np.array([values[signal.symbol] for signal in inputs], dtype=float),
        np.array([evaluator.value(rate, values) for rate in equations.derivatives]),
        np.array([evaluator.value(output.expression, values) for output in outputs]),
    )
    _check_finite(equations, model, values)
    return model


def _dense(evaluator: Evaluator, block: JacobianBlock, values: Values) -> FloatArray:
    matrix = np.zeros(block.shape)
    for entry in block.entries:
        matrix[entry.row, entry.column] = evaluator.value(entry.value, values)
    return matrix


def _check_finite(equations: StateEquations, model: LinearModel, values: Values) -> None:
    numbers = (model.A, model.B, model.C, model.D, model.rates, model.values)
    if all(np.isfinite(array).all() for array in numbers):
        return
    bad = next((str(used) for used, value in values.items() if not np.isfinite(value)), "a derivative")
    raise DerivationError(
        f"{equations.name}: {bad} is {values.get(symbol(bad), 'not finite')} at this operating point - move the point "
        "away from where a law or its slope is not defined",
        where=(bad,),
    )


class Mode(NamedTuple):
    """A mode of a linear model: one real eigenvalue or one conjugate pair.

    ``natural_frequency`` is the modulus of the eigenvalue [rad/s], ``damping`` its ratio (1: no oscillation, negative:
    it grows), ``time_constant`` that of its decay [s] (negative where it grows, inf where it stays), ``state`` the
    state that takes part most.
    """

    eigenvalue: complex
    natural_frequency: float
    damping: float
    time_constant: float
    state: str


def modes(model: LinearModel) -> tuple[Mode, ...]:
    """Modes of a linear model, slowest first.

    A state takes part by the product of its right and left eigenvector (Perez-Arriaga, Verghese and Schweppe 1982, IEEE
    Trans. Power App. Syst. 101(9)), which does not depend on units.

    Examples
    --------
    >>> A, none = np.array([[0.0, 1.0], [-4.0, -0.4]]), np.zeros((0, 0))
    >>> units = Units(("m", "m/s"), (), ())
    >>> still = np.zeros(2)
    >>> oscillator = LinearModel(A, none, none, none, ("q", "v"), (), (), units, still, still[:0], still, still[:0])
    >>> [(round(m.natural_frequency, 3), round(m.damping, 3), round(m.time_constant, 3)) for m in modes(oscillator)]
    [(2.0, 0.1, 5.0)]
    """
    if not model.states:
        return ()
    eigenvalues, left, right = scipy.linalg.eig(model.A, left=True, right=True)
    shares = np.abs(left) * np.abs(right)
    found = []
    for value, share in zip(eigenvalues, shares.T, strict=True):
        if value.imag < 0:
            continue
        size = abs(value)
        damping = -value.real / size if size else float("nan")
        lasting = -1.0 / value.real if value.real else float("inf")
        state = model.states[int(np.argmax(share))]
        found.append(Mode(complex(value), float(size), float(damping), float(lasting), state))
    return tuple(sorted(found, key=lambda mode: (mode.natural_frequency, mode.eigenvalue.real)))


def mode_table(found: Sequence[Mode]) -> str:
    """Modes as aligned text, one row each.

    Examples
    --------
    >>> print(mode_table([Mode(-0.2 + 2j, 2.01, 0.0995, 5.0, "v")]))
    eigenvalue [1/s]    natural [Hz]  damping [1]  time constant [s]  state
    -0.2 +- 2j               0.3199       0.0995                  5  v
    """
    lines = [f"{'eigenvalue [1/s]':20}{'natural [Hz]':>12}{'damping [1]':>13}{'time constant [s]':>19}  state"]
    for mode in found:
        value = mode.eigenvalue
        shown = f"{value.real:.6g} +- {value.imag:.6g}j" if value.imag else f"{value.real:.6g}"
        numbers = f"{mode.natural_frequency / (2 * np.pi):>11.4g}{mode.damping:>13.4g}{mode.time_constant:>19.4g}"
        lines.append(f"{shown:20}{numbers}  {mode.state}")
    return "\n".join(lines)


# ---------------------------------------------------------------------- equilibria


class EquilibriumOutcome(enum.Enum):
    """How a search for an equilibrium ended; the value is the message."""

    FOUND = "the rates vanish at this point and nowhere near it"
    FAMILY = "the rates vanish at this point, and along a curve through it - hold a state to make it unique"
    NONE = (
        "no point was found where the rates vanish, they are smallest here"
        " - start elsewhere, or let states such as a distance go on moving"
    )
    NON_FINITE = "the equations have no finite value where the search went - start elsewhere"


@dataclass(frozen=True)
class Equilibrium:
    """The end of a search: the state ``x`` (n_x,), its ``rates`` (n_x,) and the states that are not determined."""

    x: FloatArray
    rates: FloatArray
    outcome: EquilibriumOutcome
    states: tuple[str, ...]
    free: tuple[str, ...]

    @property
    def found(self) -> bool:
        """Whether the rates vanish at ``x``."""
        return self.outcome in (EquilibriumOutcome.FOUND, EquilibriumOutcome.FAMILY)


def equilibrium(
    equations: StateEquations, u: Given = None, theta: Given = None, guess: Given = None, moving: Sequence[str] = ()
) -> Equilibrium:
    """The state near a guess at which the rates vanish under constant inputs.

    Parameters
    ----------
    equations
        As derived.
    u, theta, guess
        Inputs, parameters and first guess of the state, as in :func:`linearise`.
    moving
        States that may go on moving (a distance, a crank's angle): they are held at the guess.

    Raises
    ------
    DerivationError
        If a name is unknown. That there is no equilibrium is an outcome, not an error.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> from bondgraph.derive.derivation import derive
    >>> g = BondGraph("car")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("engine", g.input("F", "N"), at=body)
    >>> _ = g.inertance("mass", 800.0, at=body, state="v")
    >>> _ = g.resistance("aero", lambda v: 0.4 * v**2, at=body)
    >>> steady = equilibrium(derive(assign_causality(g)), u={"F": 360.0}, guess={"v": 10.0})
    >>> steady.x.round(9).tolist(), steady.outcome.name
    ([30.0], 'FOUND')
    """
    return _Search(equations, u, theta, guess, moving).run()


class _Search:
    """Rates as a function of the states that are not held, with the size that rounding and units give them."""

    def __init__(self, equations: StateEquations, u: Given, theta: Given, guess: Given, moving: Sequence[str]) -> None:
        self.names = tuple(state.symbol.name for state in equations.states)
        for name in moving:
            if name not in self.names:
                raise DerivationError(f"{equations.name}: no state {name!r}{suggest(name, self.names)}", where=(name,))
        self.equations, self.evaluator = equations, Evaluator(equations)
        self.slopes = jacobian(equations, of=("derivatives",))
        self.u, self.theta = u, theta
        self.guess = np.array(list(_point(equations, "state", guess).values()), dtype=float)
        self.solved = np.array([name not in moving for name in self.names], dtype=bool)

    def state(self, z: FloatArray) -> FloatArray:
        """The whole state, the held ones at their guess."""
        x = self.guess.copy()
        x[self.solved] = z
        return x

    def rates(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rates of the states that are solved for, and their slopes."""
        f, slopes, _ = self.all(self.state(z))
        return f[self.solved], slopes[np.ix_(self.solved, self.solved)]

    def all(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """All rates, their slopes, and the size of the terms that make them."""
        values = self.evaluator.run(self.slopes.assignments, self.evaluator.at(x, self.u, self.theta))
        f = np.array([self.evaluator.value(rate, values) for rate in self.equations.derivatives])
        matrices = [_dense(self.evaluator, block, values) for block in self.slopes.blocks]
        sizes = np.zeros(f.shape)
        for matrix, block in zip(matrices, self.slopes.blocks, strict=True):
            sizes += np.abs(matrix) @ np.abs([values[column] for column in block.columns])
        return f, matrices[0], sizes

    def run(self) -> Equilibrium:
        """Least squares on scaled rates, Newton steps to the end, then an honest look at the result."""
        start = self.guess[self.solved]
        f, _, size = self.all(self.guess)
        scale = np.maximum(size, np.abs(f))
        weights = 1.0 / np.where(scale > 0, scale, 1.0)[self.solved]
        near = _least_squares(self.rates, start, weights)
        if near is None:
            return self._result(self.guess, EquilibriumOutcome.NON_FINITE)
        z, step = _polished(self.rates, near)
        x = self.state(z)
        f, slopes, size = self.all(x)
        still = (np.abs(f) <= 1e-9 * np.maximum(size, scale))[self.solved]
        settled = np.abs(step) <= 1e-6 * (np.abs(z) + np.abs(z - start))
        if not (still.all() and settled.all()):
            return self._result(x, EquilibriumOutcome.NONE)
        free = self._free(slopes[np.ix_(self.solved, self.solved)])
        return self._result(x, EquilibriumOutcome.FAMILY if free else EquilibriumOutcome.FOUND, free)

    def _free(self, slopes: FloatArray) -> tuple[str, ...]:
        """States that can change without a rate appearing."""
        if not slopes.size:
            return ()
        _, sizes, directions = np.linalg.svd(_scaled(slopes)[0])
        null = directions[sizes <= 1e-10 * max(sizes.max(), 1e-300)]
        shares = np.abs(null).max(axis=0, initial=0.0)
        return tuple(str(name) for name in np.array(self.names)[self.solved][shares > 1e-6])

    def _result(self, x: FloatArray, outcome: EquilibriumOutcome, free: tuple[str, ...] = ()) -> Equilibrium:
        return Equilibrium(x, self.all(x)[0], outcome, self.names, free)


# ---------------------------------------------------------------------- transfer functions

#: States between input and output up to which a transfer function is expanded in symbols, and computed in numbers.
_SYMBOLIC_STATES, _NUMERIC_STATES = 10, 60
Sparse = dict[int, Any]


class PolesZeros(NamedTuple):
    """Poles and zeros [1/s], multiple ones repeated, and the ratio of the leading coefficients."""

    poles: npt.NDArray[np.complex128]
    zeros: npt.NDArray[np.complex128]
    gain: float


def transfer_function(model: StateEquations | LinearModel, input: str, output: str) -> Expr:
    """The transfer function from an input to an output, as a ratio of polynomials in ``s`` in lowest terms.

    Only the states between input and output take part, so the rest of a graph may be of any size and nonlinear. From
    equations it is exact, in the symbols of the parameters; from a linear model it has numbers for coefficients, the
    exact ones of the matrices as they stand.

    Parameters
    ----------
    model
        Equations of a linear graph, or a linear model (for nonlinear and for large graphs).
    input, output
        Names of an input and of an output or state.

    Returns
    -------
    Expr
        In :data:`LAPLACE_S` (a complex symbol ``s``) and the parameters.

    Raises
    ------
    DerivationError
        If a name is unknown, an equation on the way is not linear (the term is named) or changes with time, or there
        are too many states to expand.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> from bondgraph.derive.derivation import derive
    >>> g = BondGraph("oscillator")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("push", g.input("F", "N"), at=body)
    >>> _ = g.inertance("mass", g.parameter("m", 2.0, "kg"), at=body)
    >>> _ = g.compliance("spring", g.parameter("k", 8.0, "N/m"), at=body, state="q")
    >>> equations = derive(assign_causality(g))
    >>> transfer_function(equations, "F", "q"), transfer_function(linearise(equations), "F", "q")
    (1/(k + m*s**2), 1/(2*s**2 + 8))
    """
    numeric = isinstance(model, LinearModel)
    system = _numbers(model, input, output) if isinstance(model, LinearModel) else _symbols(model, input, output)
    system = _between(system)
    limit = _NUMERIC_STATES if numeric else _SYMBOLIC_STATES
    if len(system.A) > limit:
        what = (
            "computed - use the linear model itself" if numeric else "expanded in symbols - linearise the model first"
        )
        raise DerivationError(
            f"{len(system.A)} states lie between {input} and {output}, at most {limit} can be {what}", (input, output)
        )
    if isinstance(model, StateEquations):
        system = _constant(model, system, f"from {input} to {output}")
    return _ratio(system)


@dataclass(frozen=True)
class _System:
    """``dx/dt = A x + b u``, ``y = c x + d u``: rows of non-zero coefficients by column."""

    A: list[Sparse]
    b: Sparse
    c: Sparse
    d: Expr
    steps: Mapping[Symbol, Expr]

    def map(self, change: Callable[[Sparse], Sparse]) -> _System:
        """The system with every row and vector changed."""
        return replace(self, A=[change(row) for row in self.A], b=change(self.b), c=change(self.c))


def _numbers(model: LinearModel, input: str, output: str) -> _System:
    _check_known("input", input, model.inputs)
    _check_known("output or state", output, (*model.outputs, *model.states))
    column = model.inputs.index(input)
    if output in model.outputs:
        row = model.outputs.index(output)
        c, d = model.C[row], model.D[row, column]
    else:
        c, d = np.eye(len(model.states))[model.states.index(output)], np.float64(0.0)

    def sparse(values: FloatArray) -> Sparse:
        return {i: Rational(*float(value).as_integer_ratio()) for i, value in enumerate(values) if value}

    through = sparse(np.array([d])).get(0, sympy.S.Zero)
    return _System([sparse(row) for row in model.A], sparse(model.B[:, column]), sparse(c), through, {})


def _symbols(equations: StateEquations, input: str, output: str) -> _System:
    measured = {state.symbol.name: OutputEquation(state.symbol, state.symbol, "", "") for state in equations.states}
    measured |= {str(declared.symbol): declared for declared in equations.outputs}
    inputs = [signal.name for signal in equations.inputs]
    _check_known("input", input, inputs)
    _check_known("output or state", output, measured)
    slopes = jacobian(replace(equations, outputs=(measured[output],)), by=("x", "u"))
    A: list[Sparse] = [{} for _ in equations.states]
    for entry in slopes.block("derivatives", "x").entries:
        A[entry.row][entry.column] = entry.value
    column = inputs.index(input)
    b = {entry.row: entry.value for entry in slopes.block("derivatives", "u").entries if entry.column == column}
    c = {entry.column: entry.value for entry in slopes.block("outputs", "x").entries}
    d = [entry.value for entry in slopes.block("outputs", "u").entries if entry.column == column]
    steps: dict[Symbol, Expr] = {}
    for step in (*equations.assignments, *slopes.assignments):
        if isinstance(step, Assignment):
            steps[step.symbol] = step.expression
    return _System(A, b, c, d[0] if d else sympy.S.Zero, steps)


def _check_known(kind: str, name: str, known: Iterable[str]) -> None:
    if name not in known:
        raise DerivationError(f"transfer function: no {kind} {name!r}{suggest(name, known)}", where=(name,))


def _between(system: _System) -> _System:
    """The part of a system that its input reaches and its output sees."""
    following: dict[int, list[int]] = {i: [] for i in range(len(system.A))}
    for i, row in enumerate(system.A):
        for j in row:
            following[j].append(i)
    reached, seen = _closure(system.b, following), _closure(system.c, dict(enumerate(system.A)))
    kept = {i: k for k, i in enumerate(sorted(reached & seen))}
    part = system.map(lambda row: {kept[i]: value for i, value in row.items() if i in kept})
    return replace(part, A=[part.A[i] for i in kept])


def _closure(start: Iterable[int], following: Mapping[int, Iterable[int]]) -> set[int]:
    found: set[int] = set()
    stack = list(start)
    while stack:
        item = stack.pop()
        if item not in found:
            found.add(item)
            stack.extend(following[item])
    return found


def _constant(equations: StateEquations, system: _System, what: str) -> _System:
    """The system with assigned symbols replaced by what they stand for; refused where that is not constant."""
    known: dict[Expr, Expr] = {}

    def full(value: Expr) -> Expr:
        if value not in known:
            used = sorted((s for s in value.free_symbols if s in system.steps), key=str)
            known[value] = value.xreplace({s: full(system.steps[s]) for s in used})
        return known[value]

    found = replace(system.map(lambda row: {i: full(value) for i, value in row.items()}), d=full(system.d))
    values = [value for row in (*found.A, found.b, found.c) for value in row.values()] + [found.d]
    parameters = {parameter.symbol for parameter in equations.parameters}
    varying = sorted({str(used) for value in values for used in value.free_symbols - parameters})
    if varying:
        blame = _nonlinear_term(equations) or f"its coefficients depend on {varying[0]}"
        raise DerivationError(
            f"{equations.name}: there is no transfer function {what}: {blame} - linearise the model at an operating "
            "point first",
            where=(equations.name, *varying),
        )
    return found


def _nonlinear_term(equations: StateEquations) -> str:
    """The first term, in order of computation, whose slope is not constant."""
    varying = {symbol("t"), *(s.symbol for s in equations.states), *(i.symbol for i in equations.inputs)}
    rows: list[tuple[str, Expr]] = []
    for step in equations.assignments:
        if isinstance(step, ImplicitLoop):
            return f"{', '.join(map(str, step.unknowns))} (of the {step.meaning}) has no closed form"
        if step.expression.free_symbols & varying:
            varying.add(step.symbol)
            rows.append((step.symbol.name, step.expression))
    rows += [(f"d({s.symbol})/dt", rate) for s, rate in zip(equations.states, equations.derivatives, strict=True)]
    rows += [(str(output.symbol), output.expression) for output in equations.outputs]
    for name, value in rows:
        for term in sympy.Add.make_args(value):
            for used, slope in gradient(term, varying).items():
                if slope.free_symbols & varying:
                    return f"{to_text(term)} in {name} is not linear in {used}"
    return ""


def _ratio(system: _System) -> Expr:
    """``d + c adj(s I - A) b / det(s I - A)`` from two characteristic polynomials, in lowest terms.

    By the matrix determinant lemma ``det(s I - A + b c) = det(s I - A) + c adj(s I - A) b``. Berkowitz (1984), Inf.
    Process. Lett. 18(3), computes them without a division.
    """
    n = len(system.A)
    rows = [[_decimal(row.get(j, sympy.S.Zero)) for j in range(n)] for row in (*system.A, system.b, system.c)]
    domain, flat = sympy.construct_domain([*itertools.chain(*rows), _decimal(system.d)], field=True)
    *A, b, c = (flat[n * i : n * (i + 1)] for i in range(n + 2))
    fed_back = [[A[i][j] - b[i] * c[j] for j in range(n)] for i in range(n)]
    below, closed = (DomainMatrix(part, (n, n), domain).charpoly() if n else [domain.one] for part in (A, fed_back))
    above = [q - p + flat[-1] * p for p, q in zip(below, closed, strict=True)]
    if domain.is_Composite:
        scale = functools.reduce(lambda a, b: a.lcm(b), (value.denom for value in (*above, *below)))
        above, below = ([value * scale for value in part] for part in (above, below))
    top, bottom = (sympy.Poly([domain.to_sympy(value) for value in part], LAPLACE_S) for part in (above, below))
    factor, top, bottom = sympy.cancel((top.as_expr(), bottom.as_expr()))
    parts = zip(sympy.sympify(factor).as_numer_denom(), (top, bottom), strict=True)
    numerator, denominator = (sympy.collect(sympy.expand(scale * part), LAPLACE_S) for scale, part in parts)
    return numerator / denominator


def _decimal(value: Expr) -> Expr:
    """An expression whose floats are the decimals they are written with: 0.1 is a tenth."""
    return value.xreplace({number: Rational(repr(float(number))) for number in value.atoms(sympy.Float)})


def poles_zeros(transfer: Expr, parameters: Mapping[str, float] | None = None) -> PolesZeros:
    """Poles, zeros and gain of a transfer function, from its exact coefficients; multiple roots are split off first.

    Parameters
    ----------
    transfer
        A ratio of polynomials in :data:`LAPLACE_S`.
    parameters
        Values of the parameters in it.

    Raises
    ------
    DerivationError
        If a parameter has no value.

    Examples
    --------
    >>> found = poles_zeros(3 * (LAPLACE_S + 2) / (LAPLACE_S + 1) ** 2)
    >>> found.poles, found.zeros, found.gain
    (array([-1.+0.j, -1.+0.j]), array([-2.+0.j]), 3.0)
    """
    given = parameters or {}
    for used in sorted(transfer.free_symbols - {LAPLACE_S}, key=str):
        if used.name not in given:
            raise DerivationError(f"transfer function: parameter {used} has no value - give one", where=(used.name,))
    filled = transfer.xreplace({used: sympy.Float(given[used.name]) for used in transfer.free_symbols - {LAPLACE_S}})
    parts = sympy.fraction(sympy.together(_decimal(filled)))
    above, below = (sympy.Poly(part, LAPLACE_S, domain=QQ) for part in sympy.cancel(parts, LAPLACE_S)[1:])
    return PolesZeros(_roots(below), _roots(above), float(above.LC() / below.LC()))


def _roots(polynomial: sympy.Poly) -> npt.NDArray[np.complex128]:
    """Roots sorted by modulus, multiple ones repeated."""
    found = [root for factor, times in polynomial.sqf_list()[1] for root in _simple_roots(factor) for _ in range(times)]
    return np.array(sorted(found, key=lambda root: (round(abs(root), 12), root.imag)), dtype=complex)


def _simple_roots(polynomial: sympy.Poly) -> list[complex]:
    """Eigenvalues of a matrix made from the errors of the last approximation, in floats, until those are rounding.

    Fortune (2002), An Iterated Eigenvalue Algorithm for Approximating Roots of Univariate Polynomials, J. Symb. Comput.
    33(5).
    """
    degree = polynomial.degree()
    if polynomial.eval(0) == 0:
        return [0j, *_simple_roots(polynomial.quo(sympy.Poly(LAPLACE_S, LAPLACE_S)))]
    if degree == 0:
        return []
    with mpmath.workprec(80 + 16 * degree):
        coefficients = [mpmath.mpf(int(c.p)) / int(c.q) for c in map(Rational, polynomial.monic().all_coeffs())]
        size = mpmath.root(abs(coefficients[-1]), degree)
        scaled = [c / size**k for k, c in enumerate(coefficients)]
        roots = np.roots([float(c) for c in scaled]).astype(complex)
        for _ in range(100):
            errors = np.array([_error(scaled, roots, i) for i in range(degree)])
            if (np.abs(errors) <= 1e-14 * np.abs(roots)).all():
                break
            roots = np.linalg.eigvals(np.diag(roots) - errors)
        return [complex(root * size) for root in roots - errors]


def _error(coefficients: list[Any], roots: npt.NDArray[np.complex128], i: int) -> complex:
    """The polynomial at one approximate root over the product of its distances to the others."""
    here = mpmath.mpc(roots[i])
    distances = (here - mpmath.mpc(root) for j, root in enumerate(roots) if j != i)
    return complex(mpmath.polyval(coefficients, here) / mpmath.fprod(distances))
