"""Frequency response of linear models: what a sine at an input does at an output."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from bondgraph.derive.linearisation import LinearModel
from bondgraph.derive.values import FloatArray

ComplexArray = npt.NDArray[np.complex128]


def frequency_response(model: LinearModel, frequencies: FloatArray) -> ComplexArray:
    """``C (2 pi i f - A)^-1 B + D`` at frequencies [Hz] (k,): shape (n_y, n_u, k), units of output over input.

    Examples
    --------
    >>> from bondgraph.declare.graph import BondGraph
    >>> from bondgraph.derive.causality import assign_causality
    >>> from bondgraph.derive.derivation import derive
    >>> from bondgraph.derive.linearisation import linearise
    >>> g = BondGraph("lag")
    >>> body = g.one_junction("body")
    >>> _ = g.effort_source("push", g.input("F", "N"), at=body)
    >>> _ = g.inertance("mass", 2.0, at=body)
    >>> _ = g.resistance("drag", 4.0, at=body)
    >>> g.measure_flow("v", body)
    >>> response = frequency_response(linearise(derive(assign_causality(g))), np.array([0.0, 2.0 / (2 * np.pi)]))
    >>> np.abs(response[0, 0]).round(6).tolist()
    [0.25, 0.176777]
    """
    size = len(model.states)
    shifted = 2j * np.pi * np.asarray(frequencies)[:, np.newaxis, np.newaxis] * np.eye(size) - model.A
    forced = np.broadcast_to(model.B.astype(complex), (len(frequencies), *model.B.shape))
    response: ComplexArray = model.C.astype(complex) @ np.linalg.solve(shifted, forced) + model.D
    return np.moveaxis(response, 0, -1)


def telling_frequencies(model: LinearModel, points: int = 400) -> FloatArray:
    """Frequencies [Hz] (points,), equally spaced in their logarithm, that hold all modes with a decade on either side.

    Examples
    --------
    >>> from bondgraph.derive.linearisation import Units
    >>> none, still = np.zeros((0, 0)), np.zeros(2)
    >>> A = np.diag([-2 * np.pi, -200 * np.pi])
    >>> model = LinearModel(A, none, none, none, ("a", "b"), (), (), Units((), (), ()), still, still, still, still)
    >>> telling_frequencies(model, 5).round(6).tolist()
    [0.1, 1.0, 10.0, 100.0, 1000.0]
    """
    rates = np.abs(np.linalg.eigvals(model.A)) / (2.0 * np.pi) if model.states else np.empty(0)
    rates = rates[rates > 1e-6 * rates.max(initial=0.0)]
    low, high = (rates.min(), rates.max()) if rates.size else (1.0, 1.0)
    return np.geomspace(0.1 * low, 10.0 * high, points)


#: Points in a decade beyond all modes, where a response is nearly straight in logarithms.
_A_DECADE = 20


@dataclass(frozen=True)
class Margins:
    """How far an output fed back to an input, ``u = r - y``, is from instability; infinite where nothing limits it.

    ``gain`` is the factor by which the response may grow, at ``gain_frequency`` [Hz] where its phase is -180 degrees;
    ``phase`` [rad] is what its phase may lose, at ``phase_frequency`` [Hz] where its magnitude is one. Of several such
    frequencies it is the one with the least margin: the gain next to one by its ratio, the phase next to zero. Both
    count in the coherent units of output and input. They tell of stability where the response itself is stable.

    K. J. Astrom, R. M. Murray (2021), Feedback Systems, 2nd ed., Princeton, section 10.3.
    """

    gain: float = np.inf
    gain_frequency: float = np.nan
    phase: float = np.inf
    phase_frequency: float = np.nan


def margins(model: LinearModel, output: int, given: int) -> Margins:
    """Margins of one output fed back to one input, by their indices.

    Crossings are looked for between the points of :func:`telling_frequencies` and found to rounding; those of a
    magnitude of one also beyond them, as far as the response can go on to grow or fall.

    Examples
    --------
    >>> from bondgraph.derive.linearisation import Units
    >>> one, none = np.zeros(1), np.zeros(3)
    >>> A = np.array([[-1.0, 0.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    >>> B, C = np.array([[4.0], [0.0], [0.0]]), np.array([[0.0, 0.0, 1.0]])
    >>> units = Units(("1",) * 3, ("1",), ("1",))
    >>> lags = LinearModel(A, B, C, np.zeros((1, 1)), ("a", "b", "c"), ("u",), ("y",), units, none, one, none, one)
    >>> found = margins(lags, 0, 0)  # 4 / (s + 1)^3, which oscillates at a gain of 8
    >>> round(found.gain, 9), round(2 * np.pi * found.gain_frequency, 9), round(found.phase, 4)
    (2.0, 1.732050808, 0.4737)
    """
    frequencies = telling_frequencies(model)

    def curve(frequency: float | FloatArray) -> ComplexArray:
        found: ComplexArray = frequency_response(model, np.atleast_1d(frequency))[output, given]
        return found

    turned = [f for f in _zeros(lambda f: curve(f).imag, frequencies) if curve(f)[0].real < 0.0]
    gains = [(float(1.0 / abs(curve(f)[0])), f) for f in turned]
    unit = _zeros(lambda f: np.abs(curve(f)) - 1.0, _as_far_as_one(frequencies, np.abs(curve(frequencies))))
    phases = [(float(np.angle(-curve(f)[0])), f) for f in unit]
    gain = min(gains, key=lambda one: abs(math.log(one[0])), default=(np.inf, np.nan))
    return Margins(*gain, *min(phases, key=lambda one: abs(one[0]), default=(np.inf, np.nan)))


def _as_far_as_one(frequencies: FloatArray, magnitude: FloatArray) -> FloatArray:
    """Frequencies with those beyond both ends at which a response that falls or grows there comes to one.

    Outside all modes a magnitude follows a power of the frequency, the first at least unless it is constant.
    """
    first, last = magnitude[0], magnitude[-1]
    low = min(first, 1.0 / first) if first > 0.0 else 1.0
    ends = 0.5 * low * frequencies[0], 2.0 * max(last, 1.0) * frequencies[-1]
    below, above = _between(ends[0], frequencies[0]), _between(frequencies[-1], ends[1])
    return np.concatenate([below[:-1], frequencies, above[1:]])


def _between(low: float, high: float) -> FloatArray:
    return np.geomspace(low, high, 2 + math.ceil(_A_DECADE * math.log10(high / low)))


def _zeros(function: Callable[[float | FloatArray], FloatArray], at: FloatArray) -> list[float]:
    """Zeros of a function between points where it changes its sign."""
    signs = np.sign(function(at))
    return [
        float(brentq(lambda f: float(function(f)[0]), at[k], at[k + 1], xtol=1e-13 * at[k]))
        for k in np.flatnonzero(signs[:-1] * signs[1:] < 0.0)
    ]
