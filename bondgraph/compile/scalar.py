"""Rewrite the text of a generated module into scalar functions that numba compiles.

    rhs(t, x, u, theta) -> array     becomes   rhs_into(t, x, u, theta, out_)      for one state, without allocation
    np.where(c, a, b)                becomes   a if c else b
    np.all(c), np.any(c)             become    c
    np.searchsorted(..."right")      becomes   search_right(...), see bondgraph.compile.table_kernel
    return _stack(x, (a, b))         becomes   out_[0] = a; out_[1] = b

Tables and the Newton functions of algebraic loops (every other function of the module) are rewritten in the same way
and keep their names, so one text is the source of both forms.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Callable, Sequence

from bondgraph.compile.loader import REQUIRED
from bondgraph.errors import ModelError

#: Name of the result argument; the underscore keeps it apart from declared names.
RESULT = "out_"
_EQUATIONS = {"rhs": "rhs_into", "output": "output_into"}


def scalar_source(tree: ast.Module, decorator: str = "", helper_decorator: str = "") -> str:
    r"""Constants and scalar functions of a generated module as Python text.

    Parameters
    ----------
    tree
        The module, as :func:`bondgraph.compile.loader.parse_module` gives it.
    decorator, helper_decorator
        Lines put before the equations, and before the functions they call, such as ``@jit``.

    Raises
    ------
    ModelError
        If a function has a form that has no scalar equivalent.

    Examples
    --------
    >>> text = "def output(t, x, u, theta):\n    return _stack(x, (np.where(x[0] > 0, x[0], 0.0),))"
    >>> print(scalar_source(ast.parse(text)))
    def output_into(t, x, u, theta, out_):
        out_[0] = x[0] if x[0] > 0 else 0.0
    """
    parts: list[str] = []
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) not in REQUIRED:
            parts.append(ast.unparse(node))
        elif isinstance(node, ast.FunctionDef) and node.name != "_stack":
            function = ast.fix_missing_locations(_scalar_function(node))
            line = decorator if node.name in _EQUATIONS else helper_decorator
            parts.append((f"{line}\n" if line else "") + ast.unparse(function))
    return "\n\n".join(parts)


def _scalar_function(function: ast.FunctionDef) -> ast.FunctionDef:
    is_equation = function.name in _EQUATIONS
    body: list[ast.stmt] = []
    for statement in function.body:
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
            continue
        scalar = _Scalar().visit(copy.deepcopy(statement))
        body.extend(_stores(scalar, function.name) if is_equation else [scalar])
    result = copy.deepcopy(function)
    result.body = body or [ast.Pass()]
    if is_equation:
        result.name = _EQUATIONS[function.name]
        result.args.args.append(ast.arg(arg=RESULT))
    return result


def _stores(statement: ast.stmt, function: str) -> list[ast.stmt]:
    """``return _stack(x, rows)`` as one store per row; tuple assignments from a vector as one assignment per name."""
    if isinstance(statement, ast.Return):
        return [
            ast.Assign(targets=[_element(RESULT, i, ast.Store())], value=row)
            for i, row in enumerate(_stacked_rows(statement, function))
        ]
    if isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Name):
        target = statement.targets[0]
        if isinstance(target, ast.Tuple):
            vector = statement.value.id
            return [
                ast.Assign(targets=[name], value=_element(vector, i, ast.Load())) for i, name in enumerate(target.elts)
            ]
    return [statement]


def _element(vector: str, index: int, context: ast.expr_context) -> ast.Subscript:
    return ast.Subscript(value=ast.Name(id=vector, ctx=ast.Load()), slice=ast.Constant(value=index), ctx=context)


def _stacked_rows(statement: ast.Return, function: str) -> list[ast.expr]:
    call = statement.value
    if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "_stack":
        rows = call.args[-1]
        if isinstance(rows, ast.Tuple | ast.List):
            return list(rows.elts)
    raise ModelError(
        f"{function}: must end in 'return _stack(x, (row, ...))' - regenerate the module", where=(function,)
    )


class _Scalar(ast.NodeTransformer):
    """numpy expressions over a batch as expressions over one number."""

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        name = _numpy_name(node.func)
        if name == "searchsorted" and [ast.unparse(keyword) for keyword in node.keywords] == ["side='right'"]:
            return ast.Call(func=ast.Name(id="search_right", ctx=ast.Load()), args=node.args, keywords=[])
        rewrite = _REWRITES.get(name)
        return node if rewrite is None else rewrite(node.args)

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.op, ast.BitAnd | ast.BitOr):  # generated modules join truth values with them, never bits
            operator = ast.And() if isinstance(node.op, ast.BitAnd) else ast.Or()
            return ast.BoolOp(op=operator, values=[node.left, node.right])
        return node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.op, ast.Invert):  # ~ of a truth value is a number outside numpy
            return ast.UnaryOp(op=ast.Not(), operand=node.operand)
        return node


def _numpy_name(function: ast.expr) -> str:
    if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name) and function.value.id == "np":
        return function.attr
    return ""


def _numpy_call(name: str, *arguments: ast.expr) -> ast.expr:
    function = ast.Attribute(value=ast.Name(id="np", ctx=ast.Load()), attr=name, ctx=ast.Load())
    return ast.Call(func=function, args=list(arguments), keywords=[])


def _where(arguments: Sequence[ast.expr]) -> ast.expr:
    condition, if_true, if_false = arguments
    return ast.IfExp(test=condition, body=if_true, orelse=if_false)


def _first(arguments: Sequence[ast.expr]) -> ast.expr:
    return arguments[0]


def _tuple(arguments: Sequence[ast.expr]) -> ast.expr:
    return ast.Tuple(elts=list(arguments), ctx=ast.Load())


def _clip(arguments: Sequence[ast.expr]) -> ast.expr:
    value, lower, upper = arguments
    return _numpy_call("minimum", _numpy_call("maximum", value, lower), upper)


def _constant(value: float) -> Callable[[Sequence[ast.expr]], ast.expr]:
    return lambda _: ast.Constant(value=value)


def _boolean(operator: ast.boolop) -> Callable[[Sequence[ast.expr]], ast.expr]:
    return lambda arguments: ast.BoolOp(op=operator, values=list(arguments))


_REWRITES: dict[str, Callable[[Sequence[ast.expr]], ast.expr]] = {
    "where": _where,
    "all": _first,
    "any": _first,
    "asarray": _first,
    "array": _first,
    "float64": _first,
    "broadcast_arrays": _tuple,
    "clip": _clip,
    "zeros_like": _constant(0.0),
    "ones_like": _constant(1.0),
    "full_like": lambda arguments: arguments[1],
    "logical_and": _boolean(ast.And()),
    "logical_or": _boolean(ast.Or()),
    "logical_not": lambda arguments: ast.UnaryOp(op=ast.Not(), operand=arguments[0]),
}
