"""Functions of laws beyond sympy's own: minimum and maximum of two, clip, switches, delays and tabulated functions.

sympy's ``Min`` and ``Max`` compare their arguments with each other whenever one is built, which costs milliseconds for
symbolic ones and orders them by an internal key; the two-argument forms here keep what the engineer wrote.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import sympy
from sympy import Expr, Float, Function, Integer, Piecewise, Symbol


def _is_number(*values: Expr) -> bool:
    return all(value.is_Number for value in values)


def _evaluated(function: Callable[..., Expr], arguments: Iterable[Expr], prec: int) -> Expr | None:
    """A function of arguments such as ``pi`` at a precision in bits, as sympy asks for; None of what is no number."""
    values = [argument._evalf(prec) for argument in arguments]
    return function(*values) if _is_number(*values) else None


class minimum(Function):  # type: ignore[misc]  # noqa: N801 - a function, printed under this name
    """The smaller of two values.

    Examples
    --------
    >>> minimum(sympy.Symbol("a"), 2)
    minimum(a, 2)
    >>> minimum(1, 2)
    1
    """

    nargs = 2
    is_real = True

    @classmethod
    def eval(cls, a: Expr, b: Expr) -> Expr | None:
        """Evaluate where both arguments are numbers or equal."""
        if a == b:
            return a
        return sympy.Min(a, b) if _is_number(a, b) else None

    def _eval_evalf(self, prec: int) -> Expr | None:
        return _evaluated(sympy.Min, self.args, prec)

    def fdiff(self, argindex: int = 1) -> Expr:
        """One where the argument is the smaller, zero elsewhere."""
        a, b = self.args
        chosen = a <= b if argindex == 1 else b < a
        return Piecewise((Integer(1), chosen), (Integer(0), True))


class maximum(Function):  # type: ignore[misc]  # noqa: N801 - a function, printed under this name
    """The larger of two values.

    Examples
    --------
    >>> maximum(1, 2)
    2
    """

    nargs = 2
    is_real = True

    @classmethod
    def eval(cls, a: Expr, b: Expr) -> Expr | None:
        """Evaluate where both arguments are numbers or equal."""
        if a == b:
            return a
        return sympy.Max(a, b) if _is_number(a, b) else None

    def _eval_evalf(self, prec: int) -> Expr | None:
        return _evaluated(sympy.Max, self.args, prec)

    def fdiff(self, argindex: int = 1) -> Expr:
        """One where the argument is the larger, zero elsewhere."""
        a, b = self.args
        chosen = a >= b if argindex == 1 else b > a
        return Piecewise((Integer(1), chosen), (Integer(0), True))


def clip(value: Any, lower: Any, upper: Any) -> Expr:
    """``value`` held between ``lower`` and ``upper``.

    Examples
    --------
    >>> clip(sympy.Symbol("x"), 0, 1)
    minimum(maximum(x, 0), 1)
    """
    return minimum(maximum(sympy.sympify(value), sympy.sympify(lower)), sympy.sympify(upper))


class switch(Function):  # type: ignore[misc]  # noqa: N801 - a function, printed under this name
    """One where ``value`` is positive, zero where it is negative; ``width`` is the range in which it changes over.

    Derivation makes it a smooth step, ``(1 + tanh(value/width))/2``, or a jump with an event, by one flag
    (``derive(..., smooth=)``), so that one declaration serves a filter and an event-driven simulation.

    Examples
    --------
    >>> v = sympy.Symbol("v", real=True)
    >>> switch(v, 0.01)
    switch(v, 0.01)
    """

    nargs = 2
    is_real = True
    is_number = False  # of numbers, too: see TableFunction

    def fdiff(self, argindex: int = 1) -> Expr:
        """Derivative of the smooth step."""
        value, width = self.args
        steep = (1 - sympy.tanh(value / width) ** 2) / (2 * width)
        return steep if argindex == 1 else -steep * value / width


class delay(Function):  # type: ignore[misc]  # noqa: N801 - a function, printed under this name
    """An input, or an expression of inputs and parameters, as it was a number of seconds ago.

    Derivation makes an input of every input in it, which follows from the other one in every log and simulation; before
    the first sample it has the first value. A state cannot be delayed in this way.

    Examples
    --------
    >>> u = sympy.Symbol("u", real=True)
    >>> delay(u, 0.25), delay(delay(u, 0.25), 0.5), delay(u, 0)
    (delay(u, 0.25), delay(u, 0.75), u)
    """

    nargs = 2
    is_real = True
    is_number = False  # of numbers, too: see TableFunction

    @classmethod
    def eval(cls, value: Expr, seconds: Expr) -> Expr | None:
        """Evaluate what does not change, and a delay of a delay or of no length."""
        if seconds.is_zero or value.is_Number:
            return value
        if isinstance(value, delay) and _is_number(seconds, value.args[1]):
            return delay(value.args[0], value.args[1] + seconds)
        return None


def smooth_step(value: Expr, width: Expr) -> Expr:
    """A switch as a smooth step.

    Examples
    --------
    >>> smooth_step(sympy.Symbol("v"), sympy.Symbol("w"))
    tanh(v/w)/2 + 1/2
    """
    return (1 + sympy.tanh(value / width)) / 2


def numeric(arguments: Sequence[Symbol], law: Expr) -> Callable[..., Any]:
    """A law as a function of numbers or arrays, with the functions of this module, smooth switches and no delays.

    Examples
    --------
    >>> x = sympy.Symbol("x")
    >>> numeric([x], maximum(x - 1, 0) + switch(x, 0.1))(np.array([-2.0, 3.0])).tolist()
    [0.0, 3.0]
    """
    own = {
        "minimum": np.minimum, "maximum": np.maximum, "switch": lambda x, width: (1 + np.tanh(x / width)) / 2,
        "delay": lambda x, seconds: x,
    }  # fmt: skip
    found: Callable[..., Any] = sympy.lambdify(tuple(arguments), law, [own, "numpy"])
    return found


def jump(value: Expr, width: Expr) -> Expr:
    """A switch as a jump; the width does not matter.

    Examples
    --------
    >>> jump(sympy.Symbol("v"), sympy.Symbol("w"))
    Piecewise((1, v > 0), (0, True))
    """
    return Piecewise((Integer(1), value > 0), (Integer(0), True))


class TableFunction(Function):  # type: ignore[misc]
    """A declared table used in a law: ``name(argument)`` or ``name(argument_1, argument_2)``.

    Subclasses are made by :func:`table_function`; ``table_name`` holds the name of the table and ``derivative`` how
    often it is differentiated in each argument. Like sympy's undefined functions it is no number where its arguments
    are: sympy would try to evaluate a condition on it, and divides by zero in doing so.
    """

    table_name: str = ""
    derivative: tuple[int, ...] = ()
    is_real = True
    is_number = False

    def fdiff(self, argindex: int = 1) -> Expr:
        """The slope of the table in one argument, again a table function."""
        orders = list(self.derivative or (0,) * len(self.args))
        orders[argindex - 1] += 1
        return table_function(self.table_name, len(self.args), tuple(orders))(*self.args)


_TABLE_CLASSES: dict[tuple[str, int, tuple[int, ...]], type[TableFunction]] = {}


def table_function(name: str, arguments: int = 1, derivative: tuple[int, ...] = ()) -> type[TableFunction]:
    """The function class of the table ``name``; the same class for the same name, so that expressions compare equal.

    Examples
    --------
    >>> table_function("torque")(sympy.Symbol("w"))
    torque(w)
    >>> table_function("torque")(sympy.Symbol("w")).diff(sympy.Symbol("w"))
    torque_d1(w)
    """
    orders = derivative if any(derivative) else ()
    key = (name, arguments, orders)
    if key not in _TABLE_CLASSES:
        suffix = "_d" + "".join(str(i + 1) * order for i, order in enumerate(orders)) if orders else ""
        fields = {"table_name": name, "derivative": orders, "nargs": arguments, "is_real": True}
        _TABLE_CLASSES[key] = type(name + suffix, (TableFunction,), fields)
    return _TABLE_CLASSES[key]


def number(value: float) -> Expr:
    """An exact sympy number for a declared value: integers stay integers.

    Examples
    --------
    >>> number(2.0), number(0.5)
    (2, 0.500000000000000)
    """
    return Integer(int(value)) if float(value).is_integer() and abs(value) < 2**53 else Float(value)
