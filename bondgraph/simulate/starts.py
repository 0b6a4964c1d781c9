"""Where the states of a model start in a log: those that are declared to, at the first value of a signal."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bondgraph.arrays import FloatArray
from bondgraph.simulate.model import Model

#: A signal that comes later than this share of a log tells nothing of its beginning.
BEGINNING = 0.05


def starts_in(
    model: Model, time: FloatArray, u: FloatArray, y: FloatArray, x0: FloatArray | None = None
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Initial state (n_x,), and which of its parts a signal of the log gave.

    Parameters
    ----------
    model
        The model.
    time, u, y
        Times (n,), inputs (n_u, n), measured outputs (n_y, n), NaN where nothing was measured.
    x0
        Initial state (n_x,) where no signal gives one, as declared by default.

    Examples
    --------
    >>> import bondgraph as bg
    >>> g = bg.BondGraph("sled")
    >>> body = g.one_junction("body", bg.TRANSLATION)
    >>> _ = g.inertance("mass", g.parameter("m", 80.0, "kg"), at=body, initial="speed")
    >>> g.measure_flow("speed", body)
    >>> starts_in(bg.build(g), np.arange(2.0), np.zeros((0, 2)), np.array([[0.2, 0.3]]))[0].tolist()
    [0.2]
    """
    found = model.x0() if x0 is None else x0.copy()
    given = np.zeros(found.size, dtype=np.bool_)
    for start in model.starts:
        value = first_value(model, start.signal, time, u, y)
        if value is not None:
            row = model.index("state", start.state)
            found[row], given[row] = start.factor * value, True
    return found, given


def first_value(model: Model, signal: str, time: FloatArray, u: FloatArray, y: FloatArray) -> float | None:
    """The first value of an input, or of an output near the beginning of a log; None where it has none."""
    if signal in model.names("input"):
        return float(u[model.index("input", signal), 0])
    values = y[model.index("output", signal)]
    early = time <= time[0] + BEGINNING * (time[-1] - time[0])
    first = np.flatnonzero(~np.isnan(values) & early)
    return float(values[first[0]]) if first.size else None
