"""Declared quantities: inputs, parameters, tables. One declaration holds everything that is known about each.

Numbers and ``unit`` are in coherent SI; ``shown_unit`` is the declared unit where that is another.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Literal

from sympy import Expr, Symbol

from bondgraph.coherent import Displayed
from bondgraph.declare.expression_text import to_text

Interpolation = Literal["linear", "hold", "band limited"]


@functools.lru_cache(maxsize=16384)
def symbol(name: str) -> Symbol:
    """The sympy symbol of a declared name; all quantities of a bond graph are real.

    Examples
    --------
    >>> symbol("J").is_real
    True
    """
    return Symbol(name, real=True)


@dataclass(frozen=True)
class Input(Displayed):
    """A signal that comes from outside and is known: throttle, voltage, grade.

    A log may lack it only where a ``default`` is declared; ``zero_default`` tells one of zero from none at all.
    Between samples it runs linearly, is held, or is ``"band limited"``: the sum of sinc functions through them.
    ``letters`` maps the codes of a text signal (a gear lever) to values; such an input is always held between samples.
    ``rate_of`` names the input whose slope over time this one is; derivation adds those that equations need, and
    :func:`bondgraph.declare.editing.with_input_rates` those that they may come to need. ``late_of`` names the input
    that this one follows ``late_by`` seconds later; derivation adds those that laws use by
    :class:`bondgraph.declare.functions.delay`.
    """

    name: str
    unit: str
    meaning: str = ""
    default: float = 0.0
    interpolation: Interpolation = "linear"
    letters: tuple[tuple[str, float], ...] = ()
    rate_of: str = ""
    shown_unit: str = ""
    zero_default: bool = False
    late_of: str = ""
    late_by: float = 0.0

    @property
    def symbol(self) -> Symbol:
        """Symbol by which laws use the input."""
        return symbol(self.name)

    @property
    def has_default(self) -> bool:
        """Whether a default is declared."""
        return self.default != 0.0 or self.zero_default

    @property
    def is_held(self) -> bool:
        """Whether the input keeps its value between samples; its rate is then zero."""
        return self.interpolation == "hold"

    def rate(self, name: str) -> Input:
        """The input that is the slope of this one over time.

        Examples
        --------
        >>> Input("speed", "m/s").rate("d_speed").unit
        '(m/s)/s'
        """
        meaning = f"rate of {self.name} (a storage depends on it)"
        shown = _per_second(self.shown_unit)
        return Input(name, _per_second(self.unit), meaning, rate_of=self.name, shown_unit=shown)

    def late(self, name: str, seconds: float) -> Input:
        """The input that follows this one so many seconds later.

        Examples
        --------
        >>> Input("force", "N").late("late_force", 0.25).meaning
        'force of 0.25 s before'
        """
        meaning = f"{self.name} of {seconds:g} s before"
        return replace(self, name=name, meaning=meaning, letters=(), late_of=self.name, late_by=seconds)


@dataclass(frozen=True)
class Parameter(Displayed):
    """A constant with its unit; with ``bounds`` it may be estimated, without it is known and stays fixed.

    ``tolerance`` is the share of the value by which a known one may be off, two standard deviations; 0 says that it is
    exact, None that nothing is said of it.
    """

    name: str
    value: float
    unit: str
    meaning: str = ""
    bounds: tuple[float, float] | None = None
    shown_unit: str = ""
    tolerance: float | None = None

    @property
    def symbol(self) -> Symbol:
        """Symbol by which laws use the parameter."""
        return symbol(self.name)


@dataclass(frozen=True)
class Table(Displayed):
    """A tabulated function of one or two arguments, C1-smooth between its points and held at its ends.

    ``values`` is flat for one argument, one row per ``x`` for two. Between the points the interpolant is the monotone
    piecewise cubic of Fritsch and Carlson (1980), SIAM J. Numer. Anal. 17(2).
    """

    name: str
    x: tuple[float, ...]
    values: tuple[float, ...] | tuple[tuple[float, ...], ...]
    y: tuple[float, ...] = ()
    unit: str = ""
    argument_units: tuple[str, ...] = ()
    meaning: str = ""
    shown_unit: str = ""
    shown_argument_units: tuple[str, ...] = ()


@dataclass(frozen=True)
class Start:
    """Where a state starts in a log: at ``factor`` times the first value of an input or of a measured output.

    Examples
    --------
    >>> str(Start("speed")), str(Start("speed", 0.25))
    ('speed', '0.25*speed')
    """

    signal: str
    factor: float = 1.0

    def __str__(self) -> str:
        return self.signal if self.factor == 1.0 else f"{self.factor!r}*{self.signal}"


@dataclass(frozen=True)
class ParameterStart:
    """Where a state starts that follows parameters: at an ``expression`` of them, in coherent SI.

    Examples
    --------
    >>> str(ParameterStart(symbol("C") * symbol("T0")))
    'C*T0'
    """

    expression: Expr

    def __str__(self) -> str:
        return to_text(self.expression)


@dataclass(frozen=True)
class Integral(Displayed):
    """An extra state whose rate is an expression: the angle of a shaft, a distance travelled.

    It starts at ``initial``, or in a log at ``start``; of a start that follows parameters ``initial`` is the value at
    the declared ones.
    """

    name: str
    of: Expr
    unit: str = ""
    meaning: str = ""
    initial: float = 0.0
    shown_unit: str = ""
    start: Start | ParameterStart | None = None


@dataclass(frozen=True)
class NamedSignal(Displayed):
    """An expression with a name; it carries no power.

    With a ``guess`` the signal is implicit: it is the value of its own symbol at which the expression vanishes, and
    the search for it starts there.
    """

    name: str
    expression: Expr
    unit: str = ""
    meaning: str = ""
    guess: Expr | None = None
    shown_unit: str = ""


@dataclass(frozen=True)
class Requirement:
    """An expression of parameters that must be positive, or the machine is impossible, and why."""

    positive: Expr
    reason: str


@dataclass(frozen=True)
class Output(Displayed):
    """A measured quantity."""

    name: str
    expression: Expr
    unit: str = ""
    meaning: str = ""
    shown_unit: str = ""


def _per_second(unit: str) -> str:
    return "" if not unit else "1/s" if unit == "1" else f"({unit})/s"
