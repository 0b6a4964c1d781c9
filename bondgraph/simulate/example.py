"""A small model, for examples and first trials."""

from __future__ import annotations

from bondgraph.compile.example import PENDULUM
from bondgraph.simulate.model import Model


def pendulum() -> Model:
    """A pendulum with the states ``angle`` and ``rate``, one input, three parameters and one output.

    Examples
    --------
    >>> pendulum().index("parameter", "length")
    0
    """
    return Model.from_text(PENDULUM, source="pendulum")
