"""Transfer functions: ratios of determinants in exact arithmetic.

With symbols for the parameters of a linear graph, or with the numbers of a linear model.
"""

from __future__ import annotations

import functools
import operator
import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import mpmath
import numpy as np
import numpy.typing as npt
import sympy
from sympy import QQ, ZZ, Expr, Rational, Symbol
from sympy.polys.fields import field
from sympy.polys.matrices import DomainMatrix

from bondgraph.declare.expressions import to_text
from bondgraph.declare.quantities import symbol
from bondgraph.derive.equations import Assignment, ImplicitLoop, OutputEquation, StateEquations
from bondgraph.derive.jacobian import gradient, jacobian
from bondgraph.derive.linearisation import LinearModel
from bondgraph.derive.values import FloatArray
from bondgraph.errors import DerivationError, suggest

#: The variable of transfer functions; unlike a parameter of that name it is not real.
LAPLACE_S = Symbol("s")

#: States between input and output up to which a transfer function is expanded in symbols, and computed in numbers.
_SYMBOLIC_STATES, _NUMERIC_STATES = 10, 60
_PRIME = (1 << 61) - 1
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
    >>> from bondgraph.derive.linearisation import linearise
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
    atoms = _atoms(model, system, f"from {input} to {output}") if isinstance(model, StateEquations) else []
    limit = _NUMERIC_STATES if numeric else _SYMBOLIC_STATES
    if len(system.A) > limit:
        what = (
            "computed - use the linear model itself" if numeric else "expanded in symbols - linearise the model first"
        )
        raise DerivationError(
            f"{len(system.A)} states lie between {input} and {output}, at most {limit} can be {what}", (input, output)
        )
    return _numeric(system) if numeric else _symbolic(system, atoms)


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


def _atoms(equations: StateEquations, system: _System, what: str) -> list[Expr]:
    """Parameters in the coefficients, and expressions of them that are not rational; refused where others appear."""
    found: dict[Expr, None] = {}
    stack, seen = [value for row in (*system.A, system.b, system.c) for value in row.values()], set[Expr]()
    stack.append(system.d)
    while stack:
        node = stack.pop()
        if node in seen:
            continue
        seen.add(node)
        if node in system.steps:
            stack.append(system.steps[node])
        elif isinstance(node, sympy.Add | sympy.Mul) or (isinstance(node, sympy.Pow) and node.exp.is_Integer):
            stack.extend(node.args)
        elif not node.is_Number:
            found[_resolved(node, system.steps)] = None
            stack.extend(node.free_symbols)
    parameters = {parameter.symbol for parameter in equations.parameters}
    varying = sorted({str(used) for node in found for used in node.free_symbols - parameters})
    if varying:
        raise DerivationError(
            f"{equations.name}: there is no transfer function {what}: {next(_nonlinear_terms(equations))} - linearise "
            "the model at an operating point first",
            where=(equations.name, *varying),
        )
    return sorted(found, key=lambda atom: (not atom.is_Symbol, str(atom)))


def _nonlinear_terms(equations: StateEquations) -> Iterator[str]:
    """The terms whose slopes are not constant, in order of computation."""
    varying = {symbol("t"), *(s.symbol for s in equations.states), *(i.symbol for i in equations.inputs)}
    rows: list[tuple[str, Expr]] = []
    for step in equations.assignments:
        if isinstance(step, ImplicitLoop):
            yield f"{', '.join(map(str, step.unknowns))} (of the {step.meaning}) has no closed form"
        elif step.expression.free_symbols & varying:
            varying.add(step.symbol)
            rows.append((step.symbol.name, step.expression))
    rows += [(f"d({s.symbol})/dt", rate) for s, rate in zip(equations.states, equations.derivatives, strict=True)]
    rows += [(str(output.symbol), output.expression) for output in equations.outputs]
    for name, value in rows:
        for term in sympy.Add.make_args(value):
            for used, slope in gradient(term, varying).items():
                if slope.free_symbols & varying:
                    yield f"{to_text(term)} in {name} is not linear in {used}"


def _symbolic(system: _System, atoms: Sequence[Expr]) -> Expr:
    """``det [[s I - A, b], [-c, d]] / det(s I - A)`` over polynomials, each row times its divisor."""
    names = [atom if atom.is_Symbol else sympy.Dummy() for atom in atoms]
    K, s, *generators = field([LAPLACE_S, *names], ZZ)
    exact = _Exact(system.steps, dict(zip(atoms, generators, strict=True)), K.to_domain())
    n = len(system.A)
    rows, divisors = [], []
    for i, coefficients in enumerate([*system.A, system.c]):
        row = {j: -exact.value(value) for j, value in coefficients.items()}
        if i < n:
            row[i] = row.get(i, K.zero) + s
        row[n] = exact.value(system.b.get(i, sympy.S.Zero) if i < n else system.d)
        divisors.append(functools.reduce(lambda a, b: a.lcm(b), (value.denom for value in row.values()), K.ring.one))
        rows.append({j: value.numer * divisors[i].exquo(value.denom) for j, value in row.items() if value})
    above = _determinant(rows)
    below = _determinant([{j: value for j, value in row.items() if j < n} for row in rows[:-1]]) * divisors[-1]
    above, below = _lowest(K, above, below, divisors)
    numerator, denominator = (sympy.collect(part.as_expr(), LAPLACE_S) for part in (above, below))
    return (numerator / denominator).xreplace(dict(zip(names, atoms, strict=True)))


def _determinant(rows: Sequence[Mapping[int, Any]]) -> Any:
    """Expanded along rows, each minor of the remaining columns computed once: no division, zeros skipped."""
    known: dict[int, Any] = {0: 1}

    def minor(row: int, columns: int) -> Any:
        if columns not in known:
            inside = [j for j in range(columns.bit_length()) if columns >> j & 1]
            terms = (
                (-1) ** k * rows[row][j] * minor(row + 1, columns & ~(1 << j))
                for k, j in enumerate(inside)
                if j in rows[row]
            )
            known[columns] = sum(terms)
        return known[columns]

    return minor(0, (1 << len(rows)) - 1)


def _lowest(K: Any, above: Any, below: Any, divisors: Sequence[Any]) -> tuple[Any, Any]:
    """Two polynomials without what the divisors of the rows brought in, and without common roots in s."""
    ring = K.ring
    above, below = ring(above), ring(below)
    if not above:
        return ring.zero, ring.one
    common = functools.reduce(ring.monomial_gcd, (*above.itermonoms(), *below.itermonoms()))
    above, below = (part.quo_term((common, ring.domain.one)) for part in (above, below))
    factors = dict.fromkeys(factor for divisor in divisors for factor, _ in divisor.factor_list()[1] if len(factor) > 1)
    for factor in factors:
        while not (first := above.div(factor))[1] and not (second := below.div(factor))[1]:
            above, below = first[0], second[0]
    if _share_a_root(above, below):
        ratio = K(above) / K(below)
        above, below = ratio.numer, ratio.denom
    content = ring.domain.gcd(above.content(), below.content())
    return above.quo_ground(content), below.quo_ground(content)


def _share_a_root(above: Any, below: Any) -> bool:
    """Whether two polynomials may have a common root in s, tried at random parameters modulo a prime."""
    draw = random.Random(0)
    point = [draw.randrange(1, _PRIME) for _ in above.ring.gens[1:]]
    images = []
    for part in (above, below):
        image: dict[int, int] = {}
        for (power, *powers), coefficient in part.iterterms():
            factors = (pow(value, k, _PRIME) for value, k in zip(point, powers, strict=True) if k)
            image[power] = (image.get(power, 0) + functools.reduce(operator.mul, factors, int(coefficient))) % _PRIME
        images.append(sympy.Poly.from_dict(image, LAPLACE_S, modulus=_PRIME))
    return bool(images[0].gcd(images[1]).degree() > 0)


def _numeric(system: _System) -> Expr:
    """``d + c adj(s I - A) b / det(s I - A)`` from two characteristic polynomials over the rationals.

    By the matrix determinant lemma ``det(s I - A + b c) = det(s I - A) + c adj(s I - A) b``. Berkowitz (1984), Inf.
    Process. Lett. 18(3), computes them without a division.
    """
    n, exact = len(system.A), _Exact({}, {}, QQ)
    *A, b, c = ([exact.value(row.get(j, sympy.S.Zero)) for j in range(n)] for row in (*system.A, system.b, system.c))
    fed_back = [[A[i][j] - b[i] * c[j] for j in range(n)] for i in range(n)]
    below, closed = (DomainMatrix(part, (n, n), QQ).charpoly() if n else [QQ.one] for part in (A, fed_back))
    above = [q - p + exact.value(system.d) * p for p, q in zip(below, closed, strict=True)]
    parts = (sympy.Poly.from_list(part, LAPLACE_S, domain=QQ) for part in (above, below))
    numerator, denominator = sympy.Poly.cancel(*parts, include=True)
    return numerator.as_expr() / denominator.as_expr()


def _resolved(atom: Expr, steps: Mapping[Symbol, Expr]) -> Expr:
    while used := {name: steps[name] for name in atom.free_symbols if name in steps}:
        atom = atom.xreplace(used)
    return atom


class _Exact:
    """Values of rational expressions in a field, every assigned symbol computed once."""

    def __init__(self, steps: Mapping[Symbol, Expr], known: dict[Expr, Any], domain: Any) -> None:
        self.steps, self.known, self.domain = steps, known, domain

    def value(self, node: Expr) -> Any:
        """The value of an expression."""
        if node not in self.known:
            self.known[node] = self._compute(node)
        return self.known[node]

    def _compute(self, node: Expr) -> Any:
        if node in self.steps:
            return self.value(self.steps[node])
        if isinstance(node, sympy.Add | sympy.Mul):
            combine = operator.add if isinstance(node, sympy.Add) else operator.mul
            return functools.reduce(combine, map(self.value, node.args))
        if isinstance(node, sympy.Pow) and node.exp.is_Integer:
            return self.value(node.base) ** int(node.exp)
        atom = _resolved(node, self.steps)
        return self.known[atom] if atom in self.known else self.domain.from_sympy(_decimal(node))


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
