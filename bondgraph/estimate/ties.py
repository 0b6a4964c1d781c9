"""Ties: parameters that follow from free ones by an expression, ``k_r = 1.2*k_f``.

Expressions are read onto the tape of the compiler (:mod:`bondgraph.compile.ir.tape`) and differentiated there, so that
gradients by free parameters are exact by the chain rule.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.compile.front.parse import Reader, Value
from bondgraph.compile.ir.evaluate import evaluate
from bondgraph.compile.ir.tape import FUNCTIONS, Program, Tape
from bondgraph.compile.passes.tangent import tangents
from bondgraph.errors import EstimationError, ModelError, listed, wrong_kind
from bondgraph.syntax import parsed

#: Functions that an expression may call, by these names.
_CALLED = (*FUNCTIONS, "minimum", "maximum", "arctan2")


@dataclass(frozen=True)
class Tie:
    """A quantity that follows from free parameters.

    Parameters
    ----------
    name
        As for a free parameter, see :mod:`bondgraph.estimate.free`.
    expression
        Of names of free parameters, or of fixed ones of the model: numbers, ``+ - * / **`` and functions such as
        ``sqrt``, ``exp``, ``minimum``.

    Raises
    ------
    EstimationError
        If the expression cannot be read, or names nothing.

    Examples
    --------
    >>> tie = Tie("k_r", "1.2*k_f + sqrt(c)")
    >>> tie.variables
    ('c', 'k_f')
    >>> tie.values({"k_f": np.array([10.0]), "c": np.array([4.0])}).tolist()
    [14.0]
    >>> {name: float(slope) for name, slope in tie.slopes({"k_f": 10.0, "c": 4.0}).items()}
    {'c': 0.25, 'k_f': 1.2}
    """

    name: str
    expression: str

    def __post_init__(self) -> None:
        if not self.variables:
            raise EstimationError(f"{self._what}: names no parameter - free parameters tie it", where=(self.name,))
        _ = self._programs

    @property
    def _what(self) -> str:
        return f"tie {self.name} = {self.expression}"

    @cached_property
    def _tree(self) -> ast.expr:
        try:
            return parsed(self.expression.strip(), mode="eval").body
        except (SyntaxError, ValueError) as error:
            reason = error.msg if isinstance(error, SyntaxError) else error
            raise EstimationError(
                f"{self._what}: cannot be read ({reason}) - write it like 1.2*k_f", where=(self.name,)
            ) from None

    @cached_property
    def variables(self) -> tuple[str, ...]:
        """Names that the expression uses, sorted."""
        called = {id(node.func) for node in ast.walk(self._tree) if isinstance(node, ast.Call)}
        names = {n.id for n in ast.walk(self._tree) if isinstance(n, ast.Name) and id(n) not in called}
        return tuple(sorted(names))

    @cached_property
    def _programs(self) -> tuple[Program, Program]:
        """The expression, and its derivative by each variable."""
        tape = Tape()
        reader = Reader(ast.Module(body=[], type_ignores=[]), {}, tape)
        leaves = {name: tape.leaf("v", k) for k, name in enumerate(self.variables)}
        environment: Mapping[str, Value] = dict(leaves)
        try:
            node = reader.expression(_Calls().visit(self._tree), environment)
            moves = [tangents(reader, [node], {leaf: tape.constant(1.0)})[0] for leaf in leaves.values()]
        except (ModelError, KeyError):
            raise EstimationError(
                f"{self._what}: holds something else than numbers, names, + - * / ** and the functions "
                f"{', '.join(_CALLED)}",
                where=(self.name,),
            ) from None
        return tape.program([node]), tape.program(moves)

    def values(self, known: Mapping[str, FloatArray]) -> FloatArray:
        """Values (members,) at those of the variables, each (members,)."""
        rows = np.array([known[name] for name in self.variables], dtype=np.float64)
        (found,) = evaluate(self._programs[0], {"v": rows}, {})
        return np.broadcast_to(np.asarray(found, dtype=np.float64), rows.shape[1:])

    def slopes(self, known: Mapping[str, float]) -> dict[str, float]:
        """Derivatives by each variable, at numbers."""
        rows = np.array([known[name] for name in self.variables], dtype=np.float64)
        found = evaluate(self._programs[1], {"v": rows}, {})
        return {name: float(slope) for name, slope in zip(self.variables, found, strict=True)}


class _Calls(ast.NodeTransformer):
    """``sqrt(x)`` as ``np.sqrt(x)``, the form of generated modules."""

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if not isinstance(node.func, ast.Name):
            return node
        if node.func.id not in _CALLED or node.keywords:
            raise KeyError(node.func.id)
        attribute = ast.Attribute(ast.Name("np", ast.Load()), node.func.id, ast.Load())
        return ast.copy_location(ast.Call(attribute, node.args, []), node)


def read_ties(ties: Mapping[str, str] | Tie | Sequence[Tie]) -> tuple[Tie, ...]:
    """Ties given as name and expression, or as they are.

    Raises
    ------
    BondGraphError
        If something else is given, or an expression cannot be read.
    """
    if not isinstance(ties, Mapping):
        return tuple(listed("ties", ties, Tie, "tie"))
    wrong = next((text for text in ties.values() if not isinstance(text, str)), None)
    if wrong is not None:
        raise wrong_kind("ties", wrong, "tie")
    return tuple(Tie(*pair) for pair in ties.items())
