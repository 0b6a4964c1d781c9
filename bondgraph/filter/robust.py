"""Measurements that are not always what they seem: losses that keep outliers from an estimate.

A sensor that now and then reads something else gives innovations which no Gaussian expects. In the place of z^2/2, half
the square of an innovation over its standard deviation (each given the channels before it), stands a loss rho(z), and
the noise of the channel enters the update with its variance over the precision that rho gives it at z:

    Student t   rho = (nu + 1)/2 log(1 + z^2/(nu c^2))     precision (nu + 1)/(nu c^2 + z^2)
    Huber       rho = a z^2/2 to |z| = k, then straight    precision 1, beyond k/|z|
    gate        rho = a z^2/2 to |z| = k, then constant    precision 1, beyond 0: the value is not used

The factors c and a make all three unbiased where nothing is wrong: at Gaussian innovations the expectation of z rho'(z)
is one, so that an estimated standard deviation stays the one of the Gaussian core. The densities of Student and Huber
are normalised. A constant loss has no density; a gate is for noise levels that are known roughly, since a level so low
that everything is rejected would do well.

References: Huber (1964), Robust estimation of a location parameter, Ann. Math. Statist. 35(1); Lange, Little and Taylor
(1989), Robust statistical modeling using the t distribution, JASA 84(408), who advise four degrees of freedom;
Agamennoni, Nieto and Nebot (2012), Approximate inference in state-space models with heavy-tailed noise, IEEE Trans.
Signal Process. 60(10); Roth, Ozkan and Gustafsson (2013), A Student's t filter for heavy tailed process and measurement
noise, ICASSP; Chang (2014), Robust Kalman filtering based on Mahalanobis distance as outlier judging criterion, J.
Geodesy 88.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from bondgraph.arrays import FloatArray
from bondgraph.errors import FilterError, require_kind
from bondgraph.filter.kernel_robust import _score
from bondgraph.filter.kernel_types import Robustness

#: Gaussian measurements.
PLAIN = Robustness(0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Robust:
    """A loss for measurements with outliers, see the module's first lines.

    Parameters
    ----------
    kind
        ``"student"``, ``"huber"`` or ``"gate"``.
    value
        Degrees of freedom (from 1), threshold in standard deviations, or probability with which a good value passes
        the gate (its square is chi-square distributed). Usually 4, 1.345 (95 % efficient at a Gaussian), and 0.999.

    Raises
    ------
    FilterError
        If the kind is unknown or the value impossible.

    Examples
    --------
    >>> import bondgraph as bg
    >>> from bondgraph.simulate.example import pendulum
    >>> swing = bg.FilterModel(
    ...     pendulum(), {"rate": 0.1}, {"deflection": 0.05}, {"angle": 0.1, "rate": 0.1}, robust=bg.Robust("student")
    ... )
    >>> time = np.arange(40) * 0.05
    >>> y = 0.1 * np.cos(3.1 * time)[np.newaxis]
    >>> y[0, 20] = 5.0
    >>> run = bg.filter_log(swing, bg.MatchedLog("swing", time, np.zeros((1, 40)), y), compiled=False)
    >>> bool(abs(run.mean("angle")[20]) < 0.2)
    True
    """

    kind: str
    value: float = math.nan

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise FilterError(f"robust: kind {self.kind!r} is not known - use {', '.join(KINDS)}", where=(self.kind,))
        loss = KINDS[self.kind]
        if math.isnan(self.value):
            object.__setattr__(self, "value", loss.usual)
        if not loss.least <= self.value <= loss.most:
            raise FilterError(
                f"robust: {loss.meaning} of {self.kind!r} is {self.value!r} - give a number from {loss.least:g} to"
                f" {loss.most:g}",
                where=(self.kind,),
            )

    @functools.cached_property
    def numbers(self) -> Robustness:
        """What kernels read."""
        return KINDS[self.kind].numbers(1 + tuple(KINDS).index(self.kind), self.value)

    @property
    def refuses(self) -> bool:
        """True where a value can be kept from the filter altogether."""
        return KINDS[self.kind].refuses

    def counted(self, z: FloatArray) -> FloatArray:
        """Innovations over their standard deviations as large as they count, of any shape: z rho'(z) in their square.

        Its mean is one where nothing is wrong, as that of z^2 is for a Gaussian; outliers have no more weight in it
        than in the estimate.

        Examples
        --------
        >>> Robust("gate").counted(np.array([1.0, -20.0, np.nan])).round(2).tolist()
        [1.01, -0.0, nan]
        """
        scores = np.array([_score(self.numbers, value) for value in z.ravel()]).reshape(z.shape)
        found: FloatArray = np.copysign(np.sqrt(z * scores), z)
        return found


def parse_robust(text: str) -> Robust:
    """The loss of a text ``kind`` or ``kind:value``.

    Raises
    ------
    FilterError
        If there is no such kind, or the value is no number or impossible.

    Examples
    --------
    >>> parse_robust("huber"), parse_robust("gate:0.99")
    (Robust(kind='huber', value=1.345), Robust(kind='gate', value=0.99))
    """
    kind, colon, value = text.partition(":")
    try:
        number = float(value) if colon else math.nan
    except ValueError:
        number = math.inf
    if colon and not math.isfinite(number):
        raise FilterError(f"robust: {value!r} in {text!r} is no number - write {kind}:NUMBER", where=(text,))
    return Robust(kind, number)


def read_robust(given: Robust | str | None) -> Robust | None:
    """A loss as it is, or as a text such as ``"student"`` and ``"huber:2"``.

    Raises
    ------
    FilterError
        If a text is no loss.
    OptionError
        If something else is given.
    """
    if isinstance(given, str):
        return parse_robust(given)
    if given is not None:
        require_kind("robust", given, Robust, "loss")
    return given


def _student(code: int, degrees: float) -> Robustness:
    """Student t of the width at which a Gaussian's own standard deviation is the likeliest."""
    width = _student_width(degrees)
    norm = math.lgamma(0.5 * degrees) - math.lgamma(0.5 * (degrees + 1.0)) + 0.5 * math.log(degrees * math.pi)
    constant = norm + math.log(width) - 0.5 * math.log(2.0 * math.pi)
    return Robustness(code, degrees + 1.0, 1.0 / (degrees * width**2), constant)


@functools.cache
def _student_width(degrees: float) -> float:
    """The width c with E[(nu + 1) z^2/(nu c^2 + z^2)] = 1 for a standard Gaussian z."""
    from scipy.integrate import quad  # here: only those who are robust load it
    from scipy.optimize import brentq

    def excess(width: float) -> float:
        def share(z: float) -> float:
            return (degrees + 1.0) * z * z / (degrees * width**2 + z * z) * _normal(z)

        return 2.0 * float(quad(share, 0.0, 12.0, epsabs=1e-13)[0]) - 1.0

    return float(brentq(excess, 0.05, 2.0, xtol=1e-13))


def _huber(code: int, threshold: float) -> Robustness:
    factor = 1.0 / math.erf(threshold / math.sqrt(2.0))
    inside = math.sqrt(2.0 * math.pi / factor) * math.erf(threshold * math.sqrt(0.5 * factor))
    outside = 2.0 / (factor * threshold) * math.exp(-0.5 * factor * threshold**2)
    return Robustness(code, threshold, factor, math.log(inside + outside) - 0.5 * math.log(2.0 * math.pi))


def _gate(code: int, probability: float) -> Robustness:
    from scipy.special import ndtri  # here: only those who are robust load it

    threshold = float(ndtri(0.5 * (1.0 + probability)))
    factor = 1.0 / (probability - 2.0 * threshold * _normal(threshold))
    return Robustness(code, threshold, factor, 0.0)


def _normal(z: float) -> float:
    return math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)


@dataclass(frozen=True)
class Loss:
    """A kind of loss: what its number means, the usual one and the ends of its range, and what kernels read of it.

    ``numbers`` takes the code of the kind and its number; ``refuses`` tells that a value may not be used at all.
    """

    meaning: str
    usual: float
    least: float
    most: float
    numbers: Callable[[int, float], Robustness]
    refuses: bool = False


#: Losses by kind; their codes are their positions from one on, as ``kernel_robust`` has them.
KINDS: Mapping[str, Loss] = {
    "student": Loss("degrees of freedom", 4.0, 1.0, 1e4, _student),
    "huber": Loss("threshold", 1.345, 0.1, 10.0, _huber),
    "gate": Loss("probability", 0.999, 0.5, 1.0 - 1e-12, _gate, refuses=True),
}
