"""Frequency response of linear models: what a sine at an input does at an output."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

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
