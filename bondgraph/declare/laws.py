"""Laws as an engineer writes them, functions or expressions, made into expressions or refused with what to write.

A law is called once, with symbols: it must return one expression. Functions of numpy and math, ``if`` and ``and`` want
numbers; here their failure becomes one error that names the element, the line and the remedy.
"""

from __future__ import annotations

import inspect
import linecache
import numbers
import re
import traceback
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import sympy
from sympy import Expr, Symbol
from sympy.logic.boolalg import Boolean

from bondgraph.coherent import is_quantity
from bondgraph.declare.expressions import FUNCTIONS, normalise
from bondgraph.errors import BondGraphError, LawError, suggest

#: Names of numpy and math for functions that laws have under another name.
_OTHER_NAMES = {
    "arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2", "arcsinh": "asinh", "arccosh": "acosh",
    "arctanh": "atanh", "fabs": "Abs", "absolute": "Abs", "power": "**", "maximum": "maximum", "minimum": "minimum",
    "max": "maximum", "min": "minimum", "fmax": "maximum", "fmin": "minimum", "clip": "clip", "heaviside": "Heaviside",
    "where": "Piecewise", "hypot": "sqrt(a**2 + b**2)", "interp": "g.table(...)", "copysign": "sign", "pow": "**",
    "ceil": "ceiling",
}  # fmt: skip
#: Functions of the toolkit's own, and where they are.
_OWN = {
    name: f"from bondgraph.declare.functions import {name}"
    for name in ("maximum", "minimum", "clip", "switch", "delay")
}
_CHOOSE = (
    "choose by switch(value, width) (from bondgraph.declare.functions import switch), "
    "sympy.Piecewise((value, condition), ...), or maximum and minimum of bondgraph.declare.functions"
)
#: Longer lines of code are not shown.
_LONGEST = 100
_CALLED = re.compile(r"(?:\b(?:np|numpy|math|cmath)\.)?\b([A-Za-z_]\w*)\(")


def callable_law(law: Any) -> bool:
    """Whether a law is given as a function (and not as the coefficient of a linear one)."""
    return callable(law) and not isinstance(law, sympy.Basic)


def apply_law(law: Any, *own: Symbol, where: str = "law") -> Expr:
    """A law as an expression of the element's own variables.

    Parameters
    ----------
    law
        A function of the own variables, or an expression of them.
    own
        The own variables, in the order in which the function takes them.
    where
        Graph and element, for the message.

    Raises
    ------
    LawError
        If the function fails or takes something else, or what it gives is no expression.

    Examples
    --------
    >>> apply_law(lambda v: 3 * v, Symbol("flow"), where="sled: runners")
    3*flow
    >>> import math
    >>> apply_law(math.tanh, Symbol("flow"), where="sled: runners")
    Traceback (most recent call last):
    ...
    bondgraph.errors.LawError: sled: runners: the law `tanh` applies tanh of numbers to a symbol - use sympy's tanh
    (from sympy import tanh)
    """
    if not callable_law(law):
        return as_expression(law, where)
    return as_expression(call_law(law, own, where), where, law)


def call_law(law: Callable[..., Any], own: Sequence[Symbol], where: str) -> Any:
    """What a function of a law returns for its own variables, as it is.

    Raises
    ------
    LawError
        If it fails, or takes other arguments.
    """
    _check_arguments(law, own, where)
    try:
        return law(*own)
    except BondGraphError:
        raise
    except Exception as error:
        place, code = _failing_code(error, law)
        raise _refusal(where, place, *_why(error, code or f"{getattr(law, '__name__', '')}()")) from error


def as_expression(value: Any, where: str, law: Callable[..., Any] | None = None) -> Expr:
    """A value that somebody wrote as an expression; ``law`` is the function that returned it, if one did.

    Raises
    ------
    LawError
        If it is none: nothing, a text, a list, a function, a condition.

    Examples
    --------
    >>> as_expression(2.0, "sled: mass")
    2
    """
    if isinstance(value, np.ndarray | np.generic) and np.ndim(value) == 0:
        value = value.item()
    if is_quantity(value) or (isinstance(value, Expr | numbers.Number) and not isinstance(value, bool)):
        return normalise(value)
    problem, todo = _no_expression(value, law is not None)
    raise _refusal(where, _place_of(law) if law is not None else None, problem, todo)


def _no_expression(value: Any, returned: bool) -> tuple[str, str]:
    """What is wrong with a value that is no expression, and what to do."""
    verb = "returns" if returned else "is"
    if value is None:
        return f"{verb} nothing", "write `return` before its value" if returned else "give an expression"
    if isinstance(value, bool | Boolean):
        todo = _CHOOSE if returned else "write Piecewise((value, condition), ...)"
        return f"{verb} a condition, not a value ({value})", todo
    if isinstance(value, str):
        return f"{verb} the text {value!r}", "write it as an expression of declared symbols, without quotes"
    if callable(value):
        return f"{verb} a function", "give an expression of inputs, parameters and signals, such as shaft.flow"
    kind = type(value).__name__
    if hasattr(value, "flow") and hasattr(value, "name"):
        return f"{verb} the node {value.name}", f"give one of its variables, such as {value.name}.flow"
    if isinstance(value, list | tuple | np.ndarray):
        return f"{verb} {_article(kind)} of {np.size(value)} values", "give one expression"
    return f"{verb} {_article(kind)} ({value!r})", "give one expression or number"


def _article(kind: str) -> str:
    return f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"


def _check_arguments(law: Callable[..., Any], own: Sequence[Symbol], where: str) -> None:
    try:
        signature = inspect.signature(law)
    except (TypeError, ValueError):  # a function of C says nothing of its arguments
        return
    try:
        signature.bind(*own)
    except TypeError:
        names = ", ".join(str(one) for one in own) or "nothing"
        takes = ", ".join(signature.parameters) or "nothing"
        raise _refusal(
            where, _place_of(law), f"takes ({takes})", f"write it as a function of {len(own)}: ({names})"
        ) from None


def _refusal(where: str, place: str | None, problem: str, todo: str) -> LawError:
    law = "what is given" if place is None else f"the law {place}"
    node = where.rpartition(": ")[2]
    return LawError(f"{where}: {law} {problem} - {todo}", where=(node,))


# ------------------------------------------------------------------ why a law failed


def _why(error: Exception, code: str) -> tuple[str, str]:
    """What went wrong in a law, and what to write instead."""
    text = str(error)
    if isinstance(error, NameError):
        return f"uses {error.name!r}, which is not defined", _import_of(error.name or "", "declare or import it first")
    if missing := re.search(r"has no callable (\w+) method|ufunc '(\w+)' not supported", text):
        name = _called(code) or missing[1] or missing[2]
        return f"applies numpy's {name} to a symbol", _import_of(name, "use the function of sympy")
    if isinstance(error, TypeError) and re.search(r"[Cc]annot (convert|round) |must be real number", text):
        name = _called(code)
        problem = f"applies {name or 'a function'} of numbers to a symbol"
        if name in ("float", "int", "round"):
            return problem, "leave it out, or use sympy's floor (from sympy import floor)"
        return problem, _import_of(name, "use sympy's functions, which take symbols")
    if isinstance(error, TypeError) and "truth value" in text:
        name = _called(code)
        if name in ("max", "min", "maximum", "minimum", "clip", "where", "heaviside"):
            return f"compares symbols by {name}", _import_of(name, _CHOOSE)
        return "asks which of two symbols is larger, which only numbers answer", _CHOOSE
    if isinstance(error, AttributeError) and re.match(r"module '[\w.]+' has no attribute", text):
        return f"uses a function that its module lacks ({text})", _import_of(error.name or "", "correct the function")
    return f"fails ({type(error).__name__}: {text})", "correct the function"


def _called(code: str) -> str:
    """The first function that a piece of code calls, without its module."""
    found = _CALLED.search(code)
    return found[1] if found else ""


def _import_of(name: str, otherwise: str) -> str:
    """How a function of that name is had in a law."""
    known = _OTHER_NAMES.get(name, name)
    if known in _OWN:
        return f"use {known} ({_OWN[known]})"
    if known == "Piecewise" or (known in FUNCTIONS and hasattr(sympy, known)):
        return f"use sympy's {known} (from sympy import {known})"
    if known != name:
        return f"use {known}"
    hint = suggest(name, FUNCTIONS)
    return otherwise + hint


# ------------------------------------------------------------------ where it stands


def _failing_code(error: Exception, law: Callable[..., Any]) -> tuple[str, str]:
    """The innermost code of the law's own file that an error came through: as a message shows it, and its text."""
    own = getattr(getattr(inspect.unwrap(law), "__code__", None), "co_filename", None)
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == own]
    if not frames:
        return _place_of(law), ""
    frame = frames[-1]
    number = frame.lineno or 0
    line = linecache.getline(frame.filename, number)
    code = line
    if number == frame.end_lineno and frame.colno is not None and frame.end_colno is not None:
        code = line.encode()[frame.colno : frame.end_colno].decode(errors="replace")  # positions count bytes
    fits = len(line.strip()) <= _LONGEST or len(code) > _LONGEST
    return _shown(line if fits else code, frame.filename, number), code or line


def _place_of(law: Callable[..., Any]) -> str:
    """The first line of a law as a message shows it; its name where there is no source."""
    function = inspect.unwrap(law)
    try:
        lines, number = inspect.getsourcelines(function)
    except (OSError, TypeError):
        return f"`{getattr(function, '__name__', type(law).__name__)}`"
    return _shown(lines[0].strip(), inspect.getsourcefile(function) or "", number)


def _shown(code: str, filename: str, number: int) -> str:
    file = re.split(r"[/\\]", filename)[-1]
    line = f"line {number} of {file}" if file else f"line {number}"
    return f"`{code.strip()}` ({line})" if 0 < len(code.strip()) <= _LONGEST else f"in {line}"
