"""The library of terms: what a formula may be made of, with the signals that each kind of term makes sense for.

A term is a function of one signal, or a product of two, one perhaps to a power, times a coefficient with the unit.
Some have an inner parameter (a threshold, a reach, a period): it is tried at a few values and then estimated. The
library is small on purpose, and searched whole: a best subset found by exhaustive search is the best one there is,
which no greedy or thresholded regression promises. References: Brunton, Proctor and Kutz (2016), PNAS 113(15), for
libraries of terms; Bertsimas, King and Mazumder (2016), Annals of Statistics 44(2), for best subsets by exact search.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from sympy import Abs, Expr, Float, Symbol, cos, exp, sign, sin, tanh

from bondgraph.correct.places.probes import Signal, argument
from bondgraph.data.log import FloatArray
from bondgraph.declare.effect import SMOOTHING
from bondgraph.declare.functions import maximum, numeric

#: Shares of the samples below which a threshold is tried to lie.
_THRESHOLDS = (15.0, 30.0, 50.0, 70.0, 85.0)
#: Reaches of saturations and exponentials, as shares of the size of the signal.
_REACHES = (0.1, 0.3, 1.0)
#: Powers that are tried, from that of a shear-thinning grease to that of a varistor, and within which one is searched.
_EXPONENTS, _EXPONENT_SPAN = (0.4, 0.5, 0.75, 1.5, 2.5, 6.0, 15.0), (1.0 / 3.0, 30.0)
#: The same of what falls as its signal grows: a converter that draws constant power, a force over a gap. The span is a
#: convention.
_FALLING, _FALLING_SPAN = (-1.0, -2.0), (-4.0, -1.0 / 3.0)
#: A signal that never comes nearer to zero than this share of its size keeps away from it: a power that falls then
#: varies by less than a decade for each unit of its exponent. A convention.
_AWAY = 0.1
#: Periods of a position, as shares of the way it takes in the logs: from one and a half turns to twelve.
_TURNS = (1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0)
#: A signal counts as a position where its name or its unit says so.
_ANGLES = ("m", "rad")

#: Exponents of the second signal of a product that are tried beside one: of a current that is chopped twice, and of
#: conductances and resistances in a stream. The span is a convention.
_SCALES, _SCALE_SPAN = (-1.0, -0.5, 0.5, 2.0), (-3.0, 3.0)

_X, _Y = Symbol("x", real=True), Symbol("y", real=True)
_TURN = Float(2.0 * math.pi)
_SIZE, _INNER = Symbol("size", positive=True), Symbol("inner", real=True)


def identifier(words: str) -> str:
    """Words as a part of a name in a graph.

    Examples
    --------
    >>> identifier("flow of gearbox.input")
    'flow_of_gearbox_input'
    """
    return words.replace(" ", "_").replace(".", "_")


@dataclass(frozen=True)
class Kind:
    """A kind of term: its laws in ``x`` (two for a wave of unknown phase), and what its inner parameter means.

    ``x`` is the signal, or the product of two; where the laws have a ``y``, that is the second one.

    ``power``: the coefficient has the unit of the missing variable over that of the signal to this power, and over that
    of the second one to the ``second_power``. ``read`` are the laws as a person reads them, where that is shorter.
    ``alone``: a law of its own, and no part of a sum. ``bends``: a product with a form of the second signal.
    """

    name: str
    laws: tuple[Expr, ...]
    power: int
    inner: str = ""
    read: tuple[Expr, ...] = ()
    alone: bool = False
    second_power: int = 0
    bends: bool = False

    @property
    def has_second(self) -> bool:
        """True where the second signal has a place of its own in the laws."""
        return any(_Y in law.free_symbols for law in self.laws)


#: Kinds without an inner parameter; the width of a change of sign is that of smoothed dry friction.
_PLAIN = (
    Kind("line", (_X,), 1),
    Kind("square", (_X**2,), 2),
    Kind("cube", (_X**3,), 3),
    Kind("fourth_power", (_X**4,), 4),
    Kind("fifth_power", (_X**5,), 5),
    Kind("magnitude", (Abs(_X),), 1),
    Kind("signed_square", (_X * Abs(_X),), 2),
    Kind("sign", (tanh(_X / (SMOOTHING * _SIZE)),), 0),
)
_THRESHOLD = (
    Kind("step", ((1 + tanh((_X - _INNER) / (SMOOTHING * _SIZE))) / 2,), 0, "threshold"),
    Kind("ramp_above", (maximum(_X - _INNER, Float(0.0)),), 1, "threshold"),
    Kind("ramp_below", (maximum(_INNER - _X, Float(0.0)),), 1, "threshold"),
)
_REACH = (
    Kind("saturation", (tanh(_X / _INNER),), 0, "reach"),
    Kind("exponential", (exp(_X / _INNER) - 1,), 0, "reach"),
    Kind("falling_exponential", (1 - exp(-_X / _INNER),), 0, "reach"),
    Kind("hump", (2 * _X * _INNER / (_X**2 + _INNER**2),), 0, "reach"),
)
#: Of an angle, in radians: the weight of a lever, a door, a pendulum, about wherever it hangs.
_OF_ANGLES = (Kind("sine", (sin(_X),), 0), Kind("cosine", (cos(_X),), 0))
#: A power with the sign of its signal, which with others beside it would draw nearly any curve; its coefficient
#: is the value at the signal's size. Where the sign changes it is so smooth that a root is as steep as dry friction.
_POWER = Kind(
    "power", ((_X / _SIZE) * ((_X / _SIZE) ** 2 + SMOOTHING**4) ** ((_INNER - 1) / 2),), 0, "exponent",
    (sign(_X) * Abs(_X / _SIZE) ** _INNER,), alone=True,
)  # fmt: skip
#: The same with a negative exponent, for signals that keep away from zero.
_FALLING_POWER = replace(_POWER, name="falling_power")
_WAVE = Kind("wave", (sin(_TURN * _X / _INNER), cos(_TURN * _X / _INNER)), 0, "period")
_PRODUCT = Kind("product", (_X,), 1)
#: A product of one signal with a power of the size of another: what a stream or a command makes of a loss.
_SCALED = Kind(
    "power_product", (_X * ((_Y / _SIZE) ** 2 + SMOOTHING**4) ** (_INNER / 2),), 1, "exponent",
    (_X * Abs(_Y / _SIZE) ** _INNER,), alone=True,
)  # fmt: skip


def _by_form(form: Kind) -> Kind:
    """A product of one signal with a form of another: a resistance that grows as a battery empties."""
    law = form.laws[0].xreplace({_X: _Y})
    return Kind(f"{form.name}_product", (_X * law,), 1, form.inner, alone=True, second_power=form.power, bends=True)


def _plain(name: str) -> Kind:
    return next(kind for kind in _PLAIN if kind.name == name)


#: The same where it is no input that scales the loss of its place.
_SCALED_BY = replace(_SCALED, bends=True)
#: Forms by which one signal changes what another one does. What it does above a level alone is told by regimes.
_SQUARED, _SIGNED = _by_form(_plain("square")), _by_form(_plain("sign"))
_SIGNED_POWER = replace(_by_form(_POWER), name="signed_power_product", read=(_X * _POWER.read[0].xreplace({_X: _Y}),))
_PAST_THRESHOLD = tuple(_by_form(kind) for kind in _THRESHOLD if kind.power)
_WITHIN_REACH = tuple(_by_form(kind) for kind in _REACH)


@dataclass(frozen=True)
class Term:
    """A term of a formula: a kind, the names and units of one or two signals, and the value of its inner parameter.

    ``size`` is how large the signal becomes, ``inner`` where the inner parameter is tried, ``span`` its bounds.
    """

    kind: Kind
    signals: tuple[str, ...]
    units: tuple[str, ...]
    size: float
    inner: float = 0.0
    span: tuple[float, float] = (0.0, 0.0)

    @property
    def inner_unit(self) -> str:
        """Unit of the inner parameter; empty where that of a signal is not known."""
        if self.kind.inner == "exponent":
            return "1"
        return self.units[1] if self.kind.has_second else self.argument_unit

    @property
    def argument_unit(self) -> str:
        """Unit of what is x in the laws; empty where one is not known."""
        units = self.units[:1] if self.kind.has_second else self.units
        return (
            ""
            if not all(units)
            else "*".join(unit if unit.isalpha() or len(units) == 1 else f"({unit})" for unit in units)
        )

    @property
    def name(self) -> str:
        """Kind and signals as one identifier.

        Examples
        --------
        >>> Term(_PLAIN[2], ("displacement of spring",), ("m",), 0.2).name
        'cube_of_displacement_of_spring'
        """
        return f"{self.kind.name}_of_{identifier(' and '.join(self.signals))}"

    def laws(self, inner: Expr | float | None = None, read: bool = False) -> tuple[Expr, ...]:
        """The laws in signals of the graph, each for a coefficient of one; ``inner`` takes the place of its value.

        ``read``: as a person reads them.
        """
        argument_of = [argument(one) for one in self.signals]
        given = {_SIZE: Float(self.size), _INNER: Float(self.inner) if inner is None else inner}
        laws = (self.kind.read or self.kind.laws) if read else self.kind.laws
        if self.kind.has_second:
            given |= {_X: argument_of[0], _Y: argument_of[1]}
        else:
            given[_X] = argument_of[0] if len(argument_of) == 1 else argument_of[0] * argument_of[1]
        return tuple(law.xreplace(given) for law in laws)

    def courses(self, known: Sequence[Signal], log: int) -> FloatArray:
        """The laws along one log, shape (laws, n)."""
        own = [_named(known, name).values[log] for name in self.signals]
        if self.kind.has_second:
            return self.values(own[0], second=own[1])
        return self.values(np.prod(own, axis=0))

    def values(self, argument: FloatArray, inner: float | None = None, second: FloatArray | float = 0.0) -> FloatArray:
        """The laws at values (n,) of the signal, or of the product of two, and of the second, shape (laws, n)."""
        at = self.inner if inner is None else inner
        with np.errstate(over="ignore"):
            found = [
                np.broadcast_to(one(argument, self.size, at, second), argument.shape) for one in _numeric(self.kind)
            ]
        return np.array(found)


def _named(known: Sequence[Signal], name: str) -> Signal:
    return next(one for one in known if one.name == name)


@functools.lru_cache(maxsize=64)
def _numeric(kind: Kind) -> tuple[Callable[[FloatArray, float, float, FloatArray | float], FloatArray], ...]:
    """The laws as functions of values, size, inner parameter and values of a second signal."""
    return tuple(numeric((_X, _SIZE, _INNER, _Y), law) for law in kind.laws)


def library(known: Sequence[Signal], of: Signal) -> list[Term]:
    """The terms in one signal, products with others included, each inner parameter at every value it is tried at.

    Time is no argument of a law but through thresholds: what happens at a time is an event.
    """
    if of.name == "time":
        return []
    together = np.concatenate(of.values)
    size = float(np.percentile(np.abs(together), 99.0))
    if not size > 0.0:
        return []
    both = together.min() < 0.0 < together.max()
    plain = [kind for kind in _PLAIN if both or kind.name not in ("magnitude", "signed_square", "sign")]
    found = [Term(kind, (of.name,), (of.unit,), size) for kind in plain]
    found += _at_thresholds(_THRESHOLD, of, together, size) + _at_reaches(_REACH, of, size)
    found += [Term(_POWER, (of.name,), (of.unit,), size, n, _EXPONENT_SPAN) for n in _EXPONENTS]
    if not both and float(np.abs(together).min()) > _AWAY * size:
        found += [Term(_FALLING_POWER, (of.name,), (of.unit,), size, n, _FALLING_SPAN) for n in _FALLING]
    if of.unit == "rad":
        found += [Term(kind, (of.name,), (of.unit,), size) for kind in _OF_ANGLES]
    if _is_position(of):
        found += _waves(of, together, size)
    return found + _products(known, of)


def products(known: Sequence[Signal], own: str = "") -> list[Term]:
    """The products of every two signals, and those of one with forms of another: what these make of its loss.

    That one is called ``own``: the flow or effort of the place itself, on which a loss there depends. Forms are tried
    of either, and of a variable that an input multiplies.

    Time is left out, and what has two values alone: where a switch is on a law acts, which is told by regimes.
    """
    timeless = [one for one in known if one.name != "time" and np.unique(np.concatenate(one.values)).size > 2]
    every = [term for one in timeless for term in _products(timeless, one)]
    pairs = [(one, other) for one in timeless for other in timeless if one is not other]
    formed = [
        term
        for of, by in pairs
        if own in (of.name, by.name) or (is_variable(by) and not is_variable(of))
        for term in _formed(of, by)
    ]
    scaled = [term for of, by in pairs if own == of.name and not is_variable(by) for term in _scaled(of, by)]
    return [*{one.name: one for one in every}.values(), *scaled, *formed]


def is_variable(of: Signal) -> bool:
    """True for a signal that is a variable of the machine, such as an effort of a junction: no input, nor time."""
    return of.stored or " of " in of.name


def _scaled(of: Signal, by: Signal) -> list[Term]:
    """A signal times powers of the size of another; negative ones only where that keeps away from zero."""
    values = np.abs(np.concatenate(by.values))
    size = float(np.percentile(values, 99.0))
    if not size > 0.0 or not np.abs(np.concatenate(of.values)).max() > 0.0:
        return []
    least = _SCALE_SPAN[0] if float(values.min()) > _AWAY * size else 1.0 / 3.0
    span = (least, _SCALE_SPAN[1])
    names, units = (of.name, by.name), (of.unit, by.unit)
    return [Term(_SCALED, names, units, size, n, span) for n in _SCALES if n > least]


def two_signals(of: Signal, by: Signal) -> list[Term]:
    """All products of one signal with forms of another one, the plain product among them; of two inputs that alone."""
    plain = _products([of, by], of)
    return [*plain, *_scaled(of, by), *_formed(of, by)] if is_variable(of) or is_variable(by) else plain


def _formed(of: Signal, by: Signal) -> list[Term]:
    """A signal times forms of another one, which may be negative as well."""
    together = np.concatenate(by.values)
    size = float(np.percentile(np.abs(together), 99.0))
    if not size > 0.0 or not np.abs(np.concatenate(of.values)).max() > 0.0:
        return []
    terms = [
        Term(_SQUARED, (by.name,), (by.unit,), size),
        *_at_thresholds(_PAST_THRESHOLD, by, together, size),
        *_at_reaches(_WITHIN_REACH, by, size),
    ]
    if together.min() < 0.0 < together.max():
        terms.append(Term(_SIGNED, (by.name,), (by.unit,), size))
        terms += [Term(_SIGNED_POWER, (by.name,), (by.unit,), size, n, _EXPONENT_SPAN) for n in _EXPONENTS]
    both = [replace(one, signals=(of.name, by.name), units=(of.unit, by.unit)) for one in terms]
    return both + [replace(one, kind=_SCALED_BY) for one in _scaled(of, by) if is_variable(by) or not is_variable(of)]


def _at_thresholds(kinds: Sequence[Kind], of: Signal, together: FloatArray, size: float) -> list[Term]:
    span = (float(together.min()), float(together.max()))
    at = [float(value) for value in np.percentile(together, _THRESHOLDS)]
    return [Term(kind, (of.name,), (of.unit,), size, value, span) for kind in kinds for value in at]


def _at_reaches(kinds: Sequence[Kind], of: Signal, size: float) -> list[Term]:
    span = (0.03 * size, 10.0 * size)
    return [Term(kind, (of.name,), (of.unit,), size, share * size, span) for kind in kinds for share in _REACHES]


def _waves(of: Signal, together: FloatArray, size: float) -> list[Term]:
    way = float(np.ptp(together))
    return [Term(_WAVE, (of.name,), (of.unit,), size, way / n, (way / n * 0.8, way / n * 1.25)) for n in _TURNS]


def _products(known: Sequence[Signal], of: Signal) -> list[Term]:
    """Products of the signal with each other one that comes after it, time left out."""
    others = [one for one in known if one.name not in (of.name, "time")]
    found = []
    for one in others:
        first, second = sorted((of, one), key=lambda signal: signal.name)
        values = np.concatenate([a * b for a, b in zip(first.values, second.values, strict=True)])
        size = float(np.percentile(np.abs(values), 99.0))
        if size > 0.0:
            found.append(Term(_PRODUCT, (first.name, second.name), (first.unit, second.unit), size))
    return found


def _is_position(of: Signal) -> bool:
    """Whether a signal is a displacement or an integrated way, of which something may repeat."""
    return of.unit in _ANGLES
