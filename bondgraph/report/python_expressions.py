"""Expressions of laws as Python, for lines that a user pastes into a declaration.

Every function that the text of a graph may use has a name to import here: sympy's, those of
:mod:`bondgraph.declare.functions`, and declared tables. Names of quantities that Python, or the lines themselves, use
for something else get an underscore.
"""

from __future__ import annotations

import ast
import keyword
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import sympy

from bondgraph.declare.domains import DOMAINS
from bondgraph.declare.expressions import FUNCTIONS, to_text
from bondgraph.declare.quantities import Table
from bondgraph.syntax import parsed

_SIGNAL = re.compile(r"(flow|effort|displacement|momentum)(\d*)\Z")
_OWN_FUNCTIONS = ("minimum", "maximum", "switch", "delay")
#: Functions of sympy that are none of its classes.
_ROOTS = ("sqrt", "cbrt")
#: Joints of conditions and what they are called: text joins them by words, which Python cannot do with symbols.
_JOINTS: dict[type[ast.boolop], str] = {ast.And: "And", ast.Or: "Or"}
_RELATIONS: dict[type[ast.cmpop], str] = {
    ast.Lt: "Lt", ast.LtE: "Le", ast.Gt: "Gt", ast.GtE: "Ge", ast.Eq: "Eq", ast.NotEq: "Ne",
}  # fmt: skip
#: Names of the lines themselves: the graph, and what they import beside functions of laws.
_NAMES_OF_LINES = {
    "g", "pi", "abs", "Rational", "Piecewise", "And", "Or", "Not", *_RELATIONS.values(), "symbol", "signal",
    "table_function", "revise_law", "revise_laws", "revise_output", "revise_integral", "split_bond", "share_effort",
    "Bond", "Node", "Domain", *(name.upper() for name in DOMAINS), "with_values", "with_bounds", "with_inputs_between",
}  # fmt: skip
#: Words that text of laws may hold as they are: those of its conditions.
_WORDS_OF_CONDITIONS = {"and", "or", "not", "True", "False"}
#: Put before a name that is a word of Python, so that the text can be parsed.
_ESCAPED = "_word_of_python_"


class UnwritableError(Exception):
    """A change for which there are no lines."""


@dataclass
class Writer:
    """Lines while they are collected, with the imports and names that they need.

    ``quantities`` are those of the corrected graph, by name; ``later`` names integrals whose rate is given at the end.
    """

    quantities: Mapping[str, Any] = field(default_factory=dict)

    lines: list[str] = field(default_factory=list)
    imports: dict[str, set[str]] = field(default_factory=dict)
    known: dict[str, str] = field(default_factory=dict)
    later: set[str] = field(default_factory=set)

    def use(self, module: str, name: str) -> str:
        """Import a name."""
        self.imports.setdefault(module, set()).add(name)
        return name

    def variable(self, name: str) -> str:
        """A variable of the lines for a quantity, which no other has."""
        taken = {*self.known.values(), *FUNCTIONS, *_NAMES_OF_LINES}
        variable = re.sub(r"\W", "_", name)
        while variable in taken or keyword.iskeyword(variable):
            variable += "_"
        self.known[name] = variable
        return variable

    def expression(self, value: Any, own: Iterable[str] = ()) -> str:
        """An expression as Python; quantities that are no variables of the lines yet become some."""
        text = re.sub(r"\b[A-Za-z_]\w*\b", _escaped, to_text(value))
        tree = parsed(text, mode="eval")
        return ast.unparse(_Translator(self, set(own)).visit(tree))

    def symbol(self, name: str) -> str:
        """The variable of a declared quantity."""
        if name not in self.known:
            made = self.use("bondgraph.declare.quantities", "symbol")
            self.lines.append(f"{self.variable(name)} = {made}({name!r})")
        return self.known[name]

    def signal(self, variable: str, port: str, node: str) -> str:
        """The variable of a flow, effort, displacement or momentum elsewhere in the graph."""
        key = f"{variable}{port}({node})"
        if key not in self.known:
            made = self.use("bondgraph.declare.expressions", "signal")
            self.known[key] = self.variable(f"{variable}{port}_{node}")
            given = f"{variable!r}, {node!r}" + (f", {port}" if port else "")
            self.lines.append(f"{self.known[key]} = {made}({given})")
        return self.known[key]


def _escaped(found: re.Match[str]) -> str:
    word = found[0]
    return _ESCAPED + word if keyword.iskeyword(word) and word not in _WORDS_OF_CONDITIONS else word


class _Translator(ast.NodeTransformer):
    """The tree of an expression in the variables and imports of a writer; ``own`` are arguments of the law itself."""

    def __init__(self, writer: Writer, own: set[str]) -> None:
        self._writer, self._own = writer, own

    def visit_Name(self, node: ast.Name) -> ast.AST:
        name = node.id.removeprefix(_ESCAPED)
        if name in self._own:
            return node
        if name == "pi" and name not in self._writer.quantities:
            return ast.Name(self._writer.use("sympy", "pi"))
        return ast.Name(self._writer.symbol(name))

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        return ast.Name(self._writer.symbol(_dotted(node)))

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """An operation; a fraction of whole numbers stays one, which Python would make a number with a point."""
        if isinstance(node.op, ast.Div) and _is_whole(node.left) and _is_whole(node.right):
            return self._called("Rational", [node.left, node.right])
        return self.generic_visit(_number_last(node))

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        return self._called(_JOINTS[type(node.op)], [self.visit(value) for value in node.values])

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        if isinstance(node.op, ast.Not):
            return self._called("Not", [self.visit(node.operand)])
        return self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        """A relation of two sides, by its function: Python turns ``0 < x`` into another one."""
        sides = [self.visit(node.left), *(self.visit(side) for side in node.comparators)]
        return self._called(_RELATIONS[type(node.ops[0])], sides)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        name = _dotted(node.func)
        own = _SIGNAL.match(name)
        if own and len(node.args) == 1:
            return ast.Name(self._writer.signal(own[1], own[2], _dotted(node.args[0])))
        arguments: list[Any] = [self.visit(argument) for argument in node.args]
        if isinstance(self._writer.quantities.get(name), Table):
            made = ast.Name(self._writer.use("bondgraph.declare.functions", "table_function"))
            given: list[Any] = [ast.Constant(name), *([ast.Constant(2)] if len(arguments) == 2 else [])]
            return ast.Call(ast.Call(made, given, []), arguments, [])
        if name == "Abs":
            return ast.Call(ast.Name("abs"), arguments, [])
        if name in _OWN_FUNCTIONS:
            return ast.Call(ast.Name(self._writer.use("bondgraph.declare.functions", name)), arguments, [])
        if name not in _ROOTS and not isinstance(getattr(sympy, name, None), sympy.FunctionClass):
            raise UnwritableError(f"the function {name}")
        return self._called(name, arguments)

    def _called(self, name: str, arguments: list[Any]) -> ast.Call:
        """The call of a function of sympy."""
        return ast.Call(ast.Name(self._writer.use("sympy", name)), arguments, [])


def _number_last(node: ast.BinOp) -> ast.BinOp:
    """A product of a number, a sum and more with the number last: Python would multiply the terms of a sum by it."""
    chain: list[tuple[ast.operator, ast.expr]] = []
    first: ast.expr = node
    while isinstance(first, ast.BinOp) and isinstance(first.op, ast.Mult | ast.Div):
        chain.insert(0, (first.op, first.right))
        first = first.left
    negative = isinstance(first, ast.UnaryOp) and isinstance(first.op, ast.USub)
    number: ast.expr = ast.Constant(1) if negative else first
    factors = [(ast.Mult(), first.operand), *chain] if isinstance(first, ast.UnaryOp) and negative else chain
    if not isinstance(number, ast.Constant) or len(factors) < 2 or not isinstance(factors[0][0], ast.Mult):
        return node
    if not _is_sum(factors[0][1]):
        return node
    made = factors[0][1]
    for operator, factor in factors[1:]:
        made = ast.BinOp(made, operator, factor)
    return ast.BinOp(made, ast.Mult(), ast.UnaryOp(ast.USub(), number) if negative else number)


def _is_sum(node: ast.expr) -> bool:
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub)


def _dotted(node: ast.expr) -> str:
    """The name that stands in the text of a graph."""
    return ast.unparse(node).replace(_ESCAPED, "")


def _is_whole(node: ast.expr) -> bool:
    """True for a whole number, or one with a minus."""
    own = node.operand if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else node
    return isinstance(own, ast.Constant) and isinstance(own.value, int)
