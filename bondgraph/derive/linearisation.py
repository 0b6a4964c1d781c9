"""Linear models of state equations at an operating point, equilibria and modes.

Numbers come from the assignments of the equations and of their Jacobian: derivatives are exact, no step is chosen.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import scipy.linalg

from bondgraph.declare.quantities import symbol
from bondgraph.derive.equations import StateEquations
from bondgraph.derive.jacobian import Jacobian, JacobianBlock, jacobian
from bondgraph.derive.values import (
    Evaluator,
    FloatArray,
    Given,
    Values,
    equilibrated,
    least_squares,
    newton_steps,
    point_values,
    vanishes,
)
from bondgraph.errors import DerivationError, suggest, wrong_kind
from bondgraph.text import count

# ---------------------------------------------------------------------- linear models


class Units(NamedTuple):
    """Units of the states, inputs and outputs of a linear model."""

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


@dataclass(frozen=True, repr=False)
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

    def __repr__(self) -> str:
        sizes = f"{count(len(self.states), 'state')}, {count(len(self.inputs), 'input')}"
        return f"<LinearModel: {sizes}, {count(len(self.outputs), 'output')}>"


class WithEquations(Protocol):
    """A model that knows its equations, such as one built from a graph."""

    @property
    def equations(self) -> StateEquations:
        """As derived."""


def linearise(
    equations: StateEquations | WithEquations,
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
        As derived, or a model built from a graph.
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
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("car")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("engine", g.input("F", "N"), at=body)
    >>> _ = g.inertance("mass", 800.0, at=body, state="v")
    >>> _ = g.resistance("aero", lambda v: 0.4 * v**2, at=body)
    >>> model = bg.linearise(bg.build(g), x={"v": 20.0})
    >>> model.A.tolist(), model.B.tolist(), model.rates.tolist()
    ([[-0.02]], [[0.00125]], [-0.2])
    """
    if not isinstance(equations, StateEquations) and not hasattr(equations, "equations"):
        raise wrong_kind("linearise", equations, "model")
    equations = equations if isinstance(equations, StateEquations) else equations.equations
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
        self.guess = np.array(list(point_values(equations, "state", guess).values()), dtype=float)
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
        near = least_squares(self.rates, start, weights)
        if near is None:
            return self._result(self.guess, EquilibriumOutcome.NON_FINITE)
        z, step = newton_steps(self.rates, near)
        x = self.state(z)
        f, slopes, size = self.all(x)
        slopes, size = slopes[np.ix_(self.solved, self.solved)], np.maximum(size, scale)[self.solved]
        if not vanishes(f[self.solved], slopes, size, step, np.abs(z) + np.abs(z - start)):
            return self._result(x, EquilibriumOutcome.NONE)
        free = self._free(slopes)
        return self._result(x, EquilibriumOutcome.FAMILY if free else EquilibriumOutcome.FOUND, free)

    def _free(self, slopes: FloatArray) -> tuple[str, ...]:
        """States that can change without a rate appearing."""
        if not slopes.size:
            return ()
        _, sizes, directions = np.linalg.svd(equilibrated(slopes)[0])
        null = directions[sizes <= 1e-10 * max(sizes.max(), 1e-300)]
        shares = np.abs(null).max(axis=0, initial=0.0)
        return tuple(str(name) for name in np.array(self.names)[self.solved][shares > 1e-6])

    def _result(self, x: FloatArray, outcome: EquilibriumOutcome, free: tuple[str, ...] = ()) -> Equilibrium:
        return Equilibrium(x, self.all(x)[0], outcome, self.names, free)
